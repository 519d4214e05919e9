"""Names that are not this machine's (DNS rebinding, pages of others), and methods where they do not belong."""

from .attack import Attack, Scene, get, message


def attacks(scene: Scene) -> list[Attack]:
    return [*names(), *methods(scene)]


def names() -> list[Attack]:
    """Host and Origin: DNS rebinding, and pages of others."""
    foreign = {
        "evil.example": "403",
        "127.0.0.1.evil.example": "403",
        "localhost.evil.example:80": "403",
        "0.0.0.0": "403",
        "127.1": "403",
        "2130706433": "403",
        "[::]": "403",
        "[::ffff:127.0.0.1]": "403",
        "localhost@evil.example": "40",
        "user:x@localhost": "",
        "localhost:99999": "",
        "": "4",
        "local host": "40",
        "%6cocalhost": "40",
    }
    found = [
        get(f"host {host!r}", "/v1/jobs", *([status] if status else ["2", "4"]), Host=host)
        for host, status in foreign.items()
    ]
    for origin in (
        "https://evil.example",
        "null",
        "http://localhost.evil.example",
        "http://127.0.0.1@evil.example",
        "localhost",
        "file://",
    ):
        found.append(get(f"origin {origin!r}", "/v1/jobs", "403", Origin=origin))
    found.append(
        Attack(
            "two hosts", [message("GET", "/v1/jobs", [("Host", "localhost"), ("Host", "evil.example")])], ("400", "403")
        )
    )
    found.append(Attack("another host in the target", [message("GET", "http://evil.example/v1/jobs")], ("400", "403")))
    found.append(Attack("no host", [message("GET", "/v1/jobs", [("Connection", "close")])], ("400", "403")))
    found.append(Attack("a rebound delete", [message("DELETE", "/v1/jobs/x", {"Host": "evil.example"})], ("403",)))
    found.append(Attack("a tunnel", [message("CONNECT", "evil.example:443")], ("4", "closed")))
    return found


def methods(scene: Scene) -> list[Attack]:
    """Methods where they do not belong, and ones nobody knows."""
    wrong = [
        ("PUT", "/v1/jobs"),
        ("DELETE", "/v1/jobs"),
        ("POST", f"/v1/jobs/{scene.job}"),
        ("POST", "/v1/maps"),
        ("PATCH", f"/v1/maps/{scene.sdf}/query"),
        ("GET", f"/v1/maps/{scene.sdf}/query"),
        ("TRACE", "/livez"),
        ("PROPFIND", "/v1/maps"),
        ("DELETE", "/"),
        ("POST", "/openapi.json"),
        ("get", "/livez"),
        ("M" * 2000, "/livez"),
    ]
    found = [
        Attack(f"{method[:9]} {target[:12]}", [message(method, target)], ("405", "4", "closed"))
        for method, target in wrong
    ]
    for target in (
        "/livez",
        "/v1/jobs",
        f"/v1/maps/{scene.sdf}/coefficients",
        f"/v1/maps/{scene.sdf}/image",
        "/nowhere",
    ):
        found.append(Attack(f"HEAD {target[:8]}..{target[-12:]}", [message("HEAD", target)], ("200", "404"), 20.0))
    return found
