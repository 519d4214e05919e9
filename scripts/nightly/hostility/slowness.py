"""Requests that do not come to an end, and clients that go before theirs does."""

from .attack import Attack, Scene, message


def attacks(scene: Scene) -> list[Attack]:
    """Requests that do not come to an end: each is ended by the service."""
    drip = [piece for letter in b"GET /livez HTTP/1.1\r\nHost: localh" for piece in (bytes([letter]), 1.0)]
    head = b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    query = f"POST /v1/maps/{scene.sdf}/query HTTP/1.1\r\n".encode() + head.split(b"\r\n", 1)[1]
    found = [
        Attack("a connection that says nothing", [b""], ("closed",), 45.0),
        Attack("a header without an end", [b"GET /livez HTTP/1.1\r\nHost: localhost\r\nX: "], ("408", "closed"), 45.0),
        Attack("a header a letter a second", drip, ("408", "closed"), 50.0),
        Attack("a body that does not come", [head + b"Content-Length: 100\r\n\r\n"], ("408", "closed"), 90.0),
        Attack("half a body", [head + b'Content-Length: 1000\r\n\r\n{"scans": ['], ("408", "closed"), 90.0),
        Attack(
            "chunks without an end", [head + b"Transfer-Encoding: chunked\r\n\r\n1\r\n{\r\n"], ("408", "closed"), 90.0
        ),
        Attack("a query's body that does not come", [query + b"Content-Length: 100\r\n\r\n"], ("408", "closed"), 90.0),
        Attack(
            "a body a letter every two seconds",
            [head + b"Content-Length: 400\r\n\r\n", *([b"[", 2.0] * 38)],
            ("408", "closed"),
            120.0,
        ),
        Attack(
            "goes before the answer", [message("GET", f"/v1/maps/{scene.sdf}/image?width=4096")], ("2",), leaves=True
        ),
        Attack(
            "goes in the middle of a job", [head + b'Content-Length: 9000\r\n\r\n{"scans": [', 0.2], ("4",), leaves=True
        ),
    ]
    for attack in found:
        attack.tags.add("slow")
    return found
