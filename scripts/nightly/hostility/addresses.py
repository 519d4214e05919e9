"""Paths, lists and jobs: traversal, cursors, labels, numbers that are none."""

import base64

from .attack import Attack, Scene, get, message

UUID = "01900000-0000-7000-8000-000000000000"


def attacks(scene: Scene) -> list[Attack]:
    return [*paths(), *lists(), *jobs(scene)]


def paths() -> list[Attack]:
    """Ways out of the folder, and ids that are none."""
    found = []
    for path in (
        "/../../etc/passwd",
        "/v1/../../etc/passwd",
        "/v1/maps/..%2f..%2f..%2fetc%2fpasswd",
        "//etc/passwd",
        "/docs/../../../etc/passwd",
        "/docs/..%2f..%2fetc%2fpasswd",
        "/v1/maps/%2e%2e",
        "/v1/maps/x%00y",
        "/v1/jobs/%ff%fe",
        "/v1/jobs/%",
        "/v1/jobs/%zz",
        "/v1/jobs/' OR 1=1 --".replace(" ", "%20"),
        "/v1/jobs/" + "a" * 5000,
        f"/v1/jobs/{UUID}/",
        "/v1//jobs",
        "/V1/jobs",
        f"/v1/maps/{UUID};x=1",
        f"/v1/maps/{UUID}/image/",
        "/v1/jobs/" + "%25" * 500,
    ):
        found.append(get(f"path {path[:16]}..{path[-16:]} ({len(path)})", path, "4"))
    found.append(get("an id in capitals", f"/v1/jobs/{UUID.upper()}", "404"))
    found.append(get("an id in braces", f"/v1/jobs/%7B{UUID}%7D", "404"))
    return found


def _cursor(text: str) -> str:
    return base64.urlsafe_b64encode(text.encode()).decode().rstrip("=")


def lists() -> list[Attack]:
    """Lists: bad cursors, limits, labels and boxes."""
    bad = [
        "limit=0",
        "limit=-1",
        "limit=1001",
        "limit=1e3",
        "limit=99999999999999999999",
        "limit=",
        "limit=NaN",
        "limit=1.5",
        "cursor=%00",
        "cursor=AAAA",
        "cursor=",
        f"cursor={'A' * 5000}",
        "cursor=" + _cursor("before:"),
        "cursor=" + _cursor("before:~"),
        "cursor=" + _cursor("before:' OR 1=1 --"),
        "label=x",
        "label=:x",
        "label=",
        "&".join(["label=a:b"] * 2000),
        "status=done",
        "status=ACCEPTED",
        "stat=running",
        "offset=3",
        "%00=1",
        "%ff=1",
        "a" * 3000 + "=1",
        "&".join(f"p{k}=1" for k in range(3000)),
    ]
    found = [get(f"jobs?{query[:40]}", f"/v1/jobs?{query}", "422", "414") for query in bad]
    boxes = ["1,2,3", "a,b,c,d", "NaN,0,1,1", "0,0,inf,inf", "1,1,0,0", "1e999,0,1e999,1", ",,,", "0,0,1,1,1"]
    found += [get(f"maps?bbox={box}", f"/v1/maps?bbox={box}", "422") for box in boxes]
    good = [
        "limit=1000",
        "limit=+5",
        "label=a:b:c",
        "label=a:",
        "label=%00:%00",
        "label=a:b&label=a:b",
        "status=running&status=failed",
        "cursor=" + _cursor(f"before:{UUID}"),
        "&".join(f"label=k{k}:v" for k in range(16)),
        "label=%F0%9F%98%80:x",
        "&&&",
        "limit=1&limit=2",
    ]
    found += [get(f"jobs?{query[:40]}", f"/v1/jobs?{query}", "200", "422") for query in good]
    found.append(get("maps?bbox as large as can be", "/v1/maps?bbox=-1.7e308,-1.7e308,1.7e308,1.7e308", "200"))
    return found


def jobs(scene: Scene) -> list[Attack]:
    """One job: waiting, following, cancelling."""
    one = f"/v1/jobs/{scene.job}"
    found = [
        get(f"wait={wait}", f"{one}?wait={wait}", "422")
        for wait in ("61", "-1", "NaN", "inf", "1e400", "x", "60.0000001")
    ]
    found += [get(f"wait={wait}", f"{one}?wait={wait}", "200", "422") for wait in ("1e-320", "0x10", "+1", "")]
    for last in ("-1", "9223372036854775807", "99999999999999999999", "x", "1e3", "9" * 5000):
        found.append(
            get(f"last event {last[:20]} ({len(last)})", f"{one}/events", "200", "204", "4", Last_Event_ID=last)
        )
    found.append(Attack("delete an ended job", [message("DELETE", one)], ("409",)))
    found.append(Attack("purge a job that has a map", [message("DELETE", f"{one}?purge=true")], ("409",)))
    found.append(Attack("purge perhaps", [message("DELETE", f"{one}?purge=perhaps")], ("422",)))
    return found
