"""Request lines and header blocks, bent."""

from .attack import Attack, Scene, raw

H = "Host: localhost\r\n"


def attacks(_: Scene) -> list[Attack]:
    """Request lines and header blocks."""
    end = f"{H}Connection: close\r\n\r\n"
    many = "".join(f"X-{k}: 1\r\n" for k in range(1000))
    return [
        raw("HTTP/1.0", f"GET /livez HTTP/1.0\r\n{H}\r\n", "200"),
        raw("HTTP/1.0 without Host", "GET /livez HTTP/1.0\r\n\r\n", "200", "4"),
        raw("HTTP/0.9", "GET /livez\r\n\r\n", "400", "closed"),
        raw("HTTP/2.0 by name", f"GET /livez HTTP/2.0\r\n{end}", "400", "505", "closed"),
        raw("HTTP/2 with prior knowledge", b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes(9), "400", "505", "closed"),
        raw("HTTP/9.9", f"GET /livez HTTP/9.9\r\n{end}", "400", "505", "closed"),
        raw("TLS to a plain port", bytes.fromhex("16030100c8010000c40303") + bytes(200), "400", "closed"),
        raw("nothing but newlines", "\r\n\r\n\r\n\r\n" + f"GET /livez HTTP/1.1\r\n{end}", "200", "400"),
        raw("bare line feeds", "GET /livez HTTP/1.1\nHost: localhost\nConnection: close\n\n", "200", "400", "closed"),
        raw("a NUL in the target", b"GET /livez\0 HTTP/1.1\r\nHost: localhost\r\n\r\n", "400", "closed"),
        raw("a NUL in a header", b"GET /livez HTTP/1.1\r\nHost: localhost\r\nX: a\0b\r\n\r\n", "400", "closed"),
        raw(
            "bytes above 127 in the target",
            b"GET /v1/jobs/\xff\xfe HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n",
            "4",
            "closed",
        ),
        raw(
            "bytes above 127 in a header",
            b"GET /livez HTTP/1.1\r\nHost: localhost\r\nX-Request-Id: \xff\xfe\r\nConnection: close\r\n\r\n",
            "200",
        ),
        raw("a header without a colon", f"GET /livez HTTP/1.1\r\nnonsense\r\n{end}", "400", "closed"),
        raw("a header without a name", f"GET /livez HTTP/1.1\r\n: x\r\n{end}", "400", "closed"),
        raw("a thousand headers", f"GET /livez HTTP/1.1\r\n{many}{end}", "200", "431", "400", "closed"),
        raw(
            "a header of a megabyte",
            f"GET /livez HTTP/1.1\r\nX: {'x' * (1 << 20)}\r\n{end}",
            "200",
            "431",
            "400",
            "closed",
        ),
        raw("a request id of a kilobyte", f"GET /livez HTTP/1.1\r\nX-Request-Id: {'x' * 1024}\r\n{end}", "200"),
        raw(
            "a request id that would split the answer",
            f"GET /livez HTTP/1.1\r\nX-Request-Id: a%0d%0aSet-Cookie: b\r\n{end}",
            "200",
        ),
        raw("a target of 60 kB", f"GET /{'a' * 60_000} HTTP/1.1\r\n{end}", "404", "414", "closed"),
        raw(
            "a target of a megabyte", f"GET /{'a' * (1 << 20)} HTTP/1.1\r\n{end}", "404", "414", "431", "400", "closed"
        ),
        raw("a target with a fragment", f"GET /livez#x HTTP/1.1\r\n{end}", "200", "400", "404", "closed"),
        raw("an asterisk", f"OPTIONS * HTTP/1.1\r\n{end}", "4", "200", "204"),
        raw(
            "an upgrade to websocket",
            "GET /livez HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\n",
            "200",
            "4",
        ),
        raw(
            "an upgrade to h2c",
            "GET /livez HTTP/1.1\r\nHost: localhost\r\nUpgrade: h2c\r\nHTTP2-Settings: AAMAAABkAAQAAP__\r\n"
            "Connection: Upgrade, HTTP2-Settings\r\n\r\n",
            "200",
            "4",
        ),
    ]
