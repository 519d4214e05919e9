"""Bodies of jobs: bombs, numbers without end, nests, doubled names, counts beyond everything."""

import copy
import gzip
import json
import zlib

from service.zstd_frames import MAGIC, frame

from .attack import Attack, Scene, post

LIMIT = 64 << 20


def attacks(scene: Scene) -> list[Attack]:
    return [*bombs(scene), *documents(scene), *values(scene)]


def _packed(name: str, body: bytes, coding: str, *expect: str, within: float = 30.0) -> Attack:
    return post(name, "/v1/jobs", body, *expect, within=within, Content_Encoding=coding)


def bombs(scene: Scene) -> list[Attack]:
    """Bodies that unpack to more than they are, or to nothing."""
    job = json.dumps(scene.document).encode()
    layer = gzip.compress(bytes(200 << 20), 9)
    return [
        _packed("zstd: 64 MiB of blanks behind a job", frame(job, b" ", LIMIT - len(job) - 1), "zstd", "202"),
        _packed("zstd: a byte too many", frame(job, b" ", LIMIT - len(job) + 1), "zstd", "413"),
        _packed("zstd: 16 GiB", frame(b"", b" ", 16 << 30), "zstd", "413"),
        _packed("zstd: many frames", frame(b"", b" ", 1 << 20) * 100, "zstd", "413"),
        _packed("zstd: a window of 2 TiB", MAGIC + b"\x00\xff" + bytes(20), "zstd", "400"),
        _packed("zstd: a window of 1 GiB", frame(job, window=0xA0), "zstd", "400", "202"),
        _packed(
            "zstd: says its size is 2^63",
            MAGIC + b"\xe0" + (1 << 63).to_bytes(8, "little") + frame(job)[6:],
            "zstd",
            "4",
        ),
        _packed("zstd: cut short", frame(job)[:-40], "zstd", "400"),
        _packed("zstd: wants a dictionary", MAGIC + b"\x03\x50\x01\x02\x03\x04" + frame(job)[6:], "zstd", "400"),
        _packed("zstd: an empty frame", frame(b""), "zstd", "400"),
        _packed(
            "zstd: frames to skip and nothing else", (b"\x50\x2a\x4d\x18\x04\x00\x00\x00abcd" * 10000), "zstd", "400"
        ),
        _packed("gzip: 200 MiB of NULs", layer, "gzip", "413"),
        _packed("gzip: packed twice", gzip.compress(gzip.compress(job)), "gzip", "400"),
        _packed("gzip: ten thousand empty members", gzip.compress(b"") * 10_000, "gzip", "400"),
        _packed("gzip: a wrong checksum", gzip.compress(job)[:-8] + bytes(8), "gzip", "400"),
        _packed("gzip: cut short", gzip.compress(job)[:-30], "gzip", "400"),
        _packed("gzip that is zlib", zlib.compress(job), "gzip", "400"),
        _packed("gzip: noise", b"\x1f\x8b" + bytes(range(256)) * 20, "gzip", "400"),
        _packed("two codings", gzip.compress(job), "gzip, zstd", "415"),
        _packed("a coding nobody has", job, "br", "415"),
        post("64 MiB of blanks, plain", "/v1/jobs", b" " * (LIMIT - 1), "400", within=30.0),
        post("80 MiB, plain", "/v1/jobs", b" " * (80 << 20), "413", within=30.0),
    ]


def documents(scene: Scene) -> list[Attack]:
    """JSON that costs more to hold than to send, and JSON that is none."""
    job = json.dumps(scene.document)
    numbers = b'{"scans":[' + b"1," * 31_000_000 + b"1]}"
    texts = {
        "not JSON": b"nonsense",
        "a NUL": b"\0",
        "a byte order mark": b"\xef\xbb\xbf{}",
        "UTF-16": job.encode("utf-16"),
        "half a surrogate": b'{"name":"\\ud800"}',
        "bytes that are no UTF-8": b'{"name":"\xff"}',
        "NaN": b'{"a":NaN}',
        "Infinity": b'{"a":-Infinity}',
        "1e400": b'{"a":1e400}',
        "-1e400": b'{"a":[-1e400]}',
        "a leading zero": b"[01]",
        "a trailing comma": b"[1,]",
        "a comment": b"/**/{}",
        "single quotes": b"{'a':1}",
        "nothing": b"",
        "a hundred thousand brackets": b"[" * 100_000,
        "a nest of 127": b"[" * 127 + b"]" * 127,
        "a nest of 10,000 objects": b'{"a":' * 10_000 + b"1" + b"}" * 10_000,
    }
    found = [post(f"JSON: {name}", "/v1/jobs", body, "400", "422") for name, body in texts.items()]
    long = {
        "64 MiB of digits": b'{"a":' + b"9" * (LIMIT - 20) + b"}",
        "64 MiB of decimals": b'{"a":0.' + b"1" * (LIMIT - 20) + b"}",
        "an exponent of 64 MiB": b'{"a":1e-' + b"9" * (LIMIT - 20) + b"}",
        "a name of 64 MiB": b'{"name":"' + b"n" * (LIMIT - 20) + b'"}',
        "a key of 64 MiB": b'{"' + b"k" * (LIMIT - 20) + b'":1}',
        "31 million numbers for scans": numbers,
        "8 million members": b"{" + b",".join([b'"":null'] * 7_999_000) + b"}",
        "8 million members in a label": b'{"labels":{' + b",".join([b'"":1'] * 7_900_000) + b"}}",
        "9 million lists": b'{"scans":[' + b"[]," * 9_000_000 + b"[]]}",
        "a million scans that are null": b'{"scans":[""' + b",null" * 1_000_000 + b"]}",
        "escapes without end": b'{"name":"' + b"\\u0041" * 10_000_000 + b'"}',
        "a pointer of a megabyte": b'{"' + b"~/" * 500_000 + b'":1}',
    }
    found += [post(f"JSON: {name}", "/v1/jobs", body, "400", "413", "422", within=60.0) for name, body in long.items()]
    found.append(post("JSON: every name twice", "/v1/jobs", (job[:-1] + "," + job[1:]).encode(), "202", "4"))
    return found


def values(scene: Scene) -> list[Attack]:
    """A valid job with one thing out of all measure."""
    found = []

    def changed(what: str, /, *expect: str, within: float = 30.0, **members) -> None:
        found.append(post(f"job: {what}", "/v1/jobs", copy.deepcopy(scene.document) | members, *expect, within=within))

    scan = scene.document["scans"][0]
    noise = scene.document["noise"]
    changed("an Idempotency-Key is free text in the body", "422", idempotency_key="x")
    changed("20,001 scans", "422", "413", scans=[scan | {"ranges": [1.0]}] * 20_001)
    changed("100,001 beams", "422", scans=[scan | {"angle_increment": 1e-9, "ranges": [1.0] * 100_001}])
    changed("65 labels", "422", labels={f"k{k}": "v" for k in range(65)})
    changed("a hundred thousand labels", "422", labels={f"k{k}": "v" for k in range(100_000)})
    changed("a label with a NUL in its name", "202", "422", labels={"a\0b": "v"})
    changed("labels of the greatest length", "202", labels={"k" * 250 + str(k): "v" * 256 for k in range(64)})
    changed("a name of controls and emoji", "202", "422", name="\u0001\u001b[2J\u202e😀\uffff</svg><script>")
    changed("a label for SQL", "202", labels={"'); DROP TABLE jobs; --": "\"$.x'"})
    changed("a priority beyond i64", "422", priority=1e300)
    changed("a priority of a half", "422", priority=0.5)
    changed("variances beyond all", "422", scans=[scan | {"pose_covariance": [1e300, 0, 0, 0, 1e300, 0, 0, 0, 1e300]}])
    changed("a covariance of all nulls", "422", scans=[scan | {"pose_covariance": [None] * 9}])
    changed("poses at 1e308", "422", scans=[scan | {"pose": {"x": 1e308, "y": -1e308, "theta": 1e308}}])
    changed("ranges at 1e308", "202", "422", scans=[scan | {"ranges": [1e308] * 61}, *scene.document["scans"]])
    changed("sigmas at 5e-324", "422", noise=dict.fromkeys(noise, 5e-324))
    changed("tolerance zero", "422", fit={"tolerance": 0})
    changed("a tiling of another version", "202", "422", map=scene.document["map"] | {"tiling": "none"})
    found.append(post("an Idempotency-Key of 256", "/v1/jobs", scene.document, "4", Idempotency_Key="k" * 256))
    found.append(post("an Idempotency-Key of nothing", "/v1/jobs", scene.document, "4", Idempotency_Key=""))
    found.append(
        post("an Idempotency-Key that is no ASCII", "/v1/jobs", scene.document, "4", Idempotency_Key="\xff\xfe")
    )
    for media in (
        "text/plain",
        "",
        "application/json/x",
        "multipart/form-data; boundary=x",
        "application/xml",
        "application/x-npy",
    ):
        found.append(post(f"job as {media}", "/v1/jobs", scene.document, "415", "4", Content_Type=media))
    found.append(
        post(
            "job as +json with a charset",
            "/v1/jobs",
            scene.document,
            "202",
            Content_Type="application/vnd.x+json; charset=latin-1",
        )
    )
    return found
