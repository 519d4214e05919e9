"""Questions to a map: points at the end of f64, and npy files that are none."""

import json
import struct

from service.zstd_frames import frame

from .attack import Attack, Scene, post

NPY = "application/x-npy"
HEADER = "{'descr': '%s', 'fortran_order': %s, 'shape': %s, }\n"


def npy(header: str, data: bytes = b"", version: int = 2) -> bytes:
    """An npy file whose header says whatever it likes."""
    text = header.encode()
    return b"\x93NUMPY" + bytes([version, 0]) + struct.pack("<I" if version > 1 else "<H", len(text)) + text + data


def attacks(scene: Scene) -> list[Attack]:
    return [*points(scene), *files(scene), *nests(scene)]


def points(scene: Scene) -> list[Attack]:
    edge = [[1e308, -1e308], [1.7e308, 1.7e308], [5e-324, -5e-324], [-0.0, 0.0], [1e16, 1], [4e6, 4e6]]
    found = []
    for name, map_id in (("sdf", scene.sdf), ("vdf", scene.vdf)):
        own = f"/v1/maps/{map_id}/query"
        found.append(post(f"{name} points at the end of f64", own, {"points": edge}, "200"))
        found.append(
            post(
                f"{name} the same, posterior, as npz", f"{own}?format=npz", {"points": edge, "kind": "posterior"}, "200"
            )
        )
        for wrong in (
            [[1e308]],
            [[1, 2, 3]],
            [1, 2],
            [[None, 1]],
            [["1", 2]],
            "x",
            None,
            {},
            [[[1, 2]]],
            [[True, False]],
            [{}],
        ):
            found.append(post(f"{name} points {json.dumps(wrong)}", own, {"points": wrong}, "422"))
    own = f"/v1/maps/{scene.sdf}/query"
    found.append(post("no points", own, {"points": []}, "200"))
    found.append(post("250,000 points", own, {"points": [[1, 1]] * 250_000}, "200", within=60.0))
    found.append(post("250,001 points", own, {"points": [[1, 1]] * 250_001}, "4", within=60.0))
    found.append(post("fields of every kind", own, {"points": [[1, 1]], "fields": ["distance", 1, None, {}]}, "422"))
    found.append(
        post("a field a hundred thousand times", own, {"points": [[1, 1]], "fields": ["sigma"] * 100_000}, "200", "4")
    )
    found.append(post("a point of 1e400", own, b'{"points":[[1e400,0]]}', "400"))
    found.append(post("a point that is NaN", own, b'{"points":[[NaN,0]]}', "400"))
    found.append(
        post("a body of blanks, 64 MiB in zstd", own, frame(b"", b" ", 64 << 20), "400", Content_Encoding="zstd")
    )
    return found


def files(scene: Scene) -> list[Attack]:
    one = struct.pack("<2d", 1, 1)
    good = HEADER % ("<f8", "False", "(1, 2)")
    cases = {
        "a point": (npy(good, one), ("200",)),
        "a point of NaN": (npy(good, struct.pack("<2d", float("nan"), 1)), ("422",)),
        "a point at infinity": (npy(good, struct.pack("<2d", float("inf"), 1)), ("422",)),
        "a point at 1e308": (npy(good, struct.pack("<2d", 1e308, -1e308)), ("200",)),
        "by columns": (npy(HEADER % ("<f8", "True", "(1, 2)"), one), ("200",)),
        "big-endian": (npy(HEADER % (">f8", "False", "(1, 2)"), one), ("200", "422")),
        "float32": (npy(HEADER % ("<f4", "False", "(1, 2)"), one), ("422",)),
        "objects": (npy(HEADER % ("|O", "False", "(1, 2)"), one), ("422",)),
        "one dimension": (npy(HEADER % ("<f8", "False", "(2,)"), one), ("422",)),
        "no rows": (npy(HEADER % ("<f8", "False", "(0, 2)")), ("200",)),
        "2^64 rows": (npy(HEADER % ("<f8", "False", "(18446744073709551615, 2)"), one), ("422",)),
        "minus one row": (npy(HEADER % ("<f8", "False", "(-1, 2)"), one), ("422",)),
        "250,000 rows and no data": (npy(HEADER % ("<f8", "False", "(250000, 2)")), ("422",)),
        "more data than rows": (npy(good, one * 100_000), ("200", "422")),
        "a header of 4 GiB": (b"\x93NUMPY\x02\x00\xff\xff\xff\xff{", ("422",)),
        "version 9": (npy(good, one, version=9), ("422",)),
        "no header": (b"\x93NUMPY", ("422",)),
        "nothing": (b"", ("4",)),
        "noise": (bytes(range(256)) * 99, ("422",)),
        "a shape of many dimensions": (npy(HEADER % ("<f8", "False", "(" + "1," * 10_000 + ")")), ("422",)),
        "a hundred thousand fields": (
            npy(HEADER.replace("'%s'", "%s", 1) % ("[" + "('a','<f8')," * 100_000 + "]", "False", "(1,2)")),
            ("422",),
        ),
    }
    own = f"/v1/maps/{scene.sdf}/query"
    return [post(f"npy: {name}", own, body, *expect, Content_Type=NPY) for name, (body, expect) in cases.items()]


def nests(scene: Scene) -> list[Attack]:
    """npy headers that cost their reader more than their length."""
    cases = {
        "a shape of 100,000 digits": "(" + "9" * 100_000 + ", 2)",
        "a shape of 2,000,000 digits": "(" + "9" * 2_000_000 + ", 2)",
        "20 lists in each other": "[" * 20 + "]" * 20,
        "40 lists in each other": "[" * 40 + "]" * 40,
        "100,000 lists in each other": "[" * 100_000 + "]" * 100_000,
        "40 tuples in each other": "(" * 40 + ",)" * 40,
        "40 dictionaries in each other": "{1:" * 40 + "1" + "}" * 40,
    }
    own = f"/v1/maps/{scene.sdf}/query"
    return [
        post(f"npy: {name}", own, npy(HEADER % ("<f8", "False", shape)), "422", within=5.0, Content_Type=NPY)
        for name, shape in cases.items()
    ]
