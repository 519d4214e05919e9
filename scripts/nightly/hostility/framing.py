"""Where a request ends: lengths, chunks, pipelines, and what is smuggled between them."""

import json

from .attack import Attack, Scene, raw

H = "Host: localhost\r\n"


def attacks(scene: Scene) -> list[Attack]:
    """Where a body ends."""
    job = json.dumps(scene.document)
    posted = f"POST /v1/jobs HTTP/1.1\r\n{H}Content-Type: application/json\r\n"
    chunks = f"{len(job):x}\r\n{job}\r\n0\r\n\r\n"
    hidden = "GET /v1/hidden HTTP/1.1\r\nHost: localhost\r\n\r\n"
    nine = "9" * 30
    return [
        raw(
            "two lengths that differ",
            f"{posted}Content-Length: 3\r\nContent-Length: 9\r\n\r\n{{}}       ",
            "400",
            "closed",
        ),
        raw("two lengths that agree", f"{posted}Content-Length: 2\r\nContent-Length: 2\r\n\r\n{{}}", "400", "422"),
        raw("a list of lengths", f"{posted}Content-Length: 2, 2\r\n\r\n{{}}", "400", "422", "closed"),
        raw(
            "length and chunks",
            f"{posted}Content-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n{hidden}",
            "400",
            "404",
            answers=1,
        ),
        raw(
            "chunks twice",
            f"{posted}Transfer-Encoding: chunked\r\nTransfer-Encoding: chunked\r\n\r\n{chunks}",
            "400",
            "202",
            "closed",
        ),
        raw(
            "identity and chunks",
            f"{posted}Transfer-Encoding: identity, chunked\r\n\r\n{chunks}",
            "400",
            "202",
            "closed",
            "501",
        ),
        raw("chunked not last", f"{posted}Transfer-Encoding: chunked, identity\r\n\r\n{chunks}", "400", "closed"),
        raw("chunked with a tab", f"{posted}Transfer-Encoding:\tchunked\r\n\r\n{chunks}", "400", "202", "closed"),
        raw("chunked misspelt", f"{posted}Transfer-Encoding: xchunked\r\n\r\n{chunks}", "400", "closed"),
        raw("a space before the colon", f"{posted}Content-Length : 2\r\n\r\n{{}}", "400", "closed"),
        raw("a folded header", f"{posted}X-Long: a\r\n b\r\nContent-Length: 2\r\n\r\n{{}}", "400", "422", "closed"),
        raw("a negative length", f"{posted}Content-Length: -1\r\n\r\n", "400", "closed"),
        raw("a length with a sign", f"{posted}Content-Length: +2\r\n\r\n{{}}", "400", "closed"),
        raw("a length in hex", f"{posted}Content-Length: 0x2\r\n\r\n{{}}", "400", "closed"),
        raw("a length beyond u64", f"{posted}Content-Length: {nine}\r\n\r\n", "400", "413", "closed"),
        raw("a length of ten gigabytes", f"{posted}Content-Length: 10000000000\r\n\r\n{{", "413", within=3.0),
        raw("a length just over the limit", f"{posted}Content-Length: {(64 << 20) + 1}\r\n\r\n{{", "413", within=3.0),
        raw(
            "ten gigabytes of another type",
            f"POST /v1/jobs HTTP/1.1\r\n{H}Content-Type: text/csv\r\nContent-Length: 9999\r\n\r\n",
            "415",
            within=3.0,
        ),
        raw(
            "a wrong chunk size", f"{posted}Transfer-Encoding: chunked\r\n\r\nzz\r\n{{}}\r\n0\r\n\r\n", "400", "closed"
        ),
        raw(
            "a chunk size beyond u64",
            f"{posted}Transfer-Encoding: chunked\r\n\r\nfffffffffffffffff\r\n{{}}",
            "400",
            "413",
            "closed",
        ),
        raw(
            "a chunk size of everything",
            f"{posted}Transfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\n{{}}",
            "400",
            "413",
            "408",
            "closed",
            within=90.0,
        ),
        raw(
            "a chunk longer than it says",
            f"{posted}Transfer-Encoding: chunked\r\n\r\n1\r\n{{}}\r\n0\r\n\r\n",
            "400",
            "closed",
        ),
        raw(
            "a chunk extension of a megabyte",
            f"{posted}Transfer-Encoding: chunked\r\n\r\n2;{'x' * (1 << 20)}\r\n{{}}\r\n0\r\n\r\n",
            "400",
            "422",
            "closed",
        ),
        raw(
            "a trailer of a megabyte",
            f"{posted}Transfer-Encoding: chunked\r\n\r\n2\r\n{{}}\r\n0\r\nX-T: {'x' * (1 << 20)}\r\n\r\n",
            "400",
            "422",
            "431",
            "closed",
        ),
        raw(
            "a thousand trailers",
            f"{posted}Transfer-Encoding: chunked\r\n\r\n2\r\n{{}}\r\n0\r\n" + "X-T: 1\r\n" * 1000 + "\r\n",
            "400",
            "422",
            "431",
            "closed",
        ),
        raw(
            "a hundred thousand tiny chunks",
            f"{posted}Transfer-Encoding: chunked\r\n\r\n" + "1\r\n \r\n" * 100_000 + "2\r\n{}\r\n0\r\n\r\n",
            "422",
            within=30.0,
        ),
        raw(
            "a body where none belongs",
            f"GET /v1/jobs HTTP/1.1\r\n{H}Content-Length: 5\r\nConnection: close\r\n\r\nhello",
            "200",
        ),
        raw(
            "smuggled behind a GET",
            f"GET /livez HTTP/1.1\r\n{H}Content-Length: {len(hidden)}\r\nConnection: close\r\n\r\n{hidden}",
            "200",
        ),
        raw("twenty in a pipeline", (f"GET /livez HTTP/1.1\r\n{H}\r\n" * 20), "200", answers=20),
        raw(
            "a pipeline behind a job",
            f"{posted}Content-Length: {len(job)}\r\n\r\n{job}GET /livez HTTP/1.1\r\n{H}\r\n",
            "202",
            "200",
            answers=2,
        ),
        raw(
            "a pipeline behind an error",
            f"{posted}Content-Length: 2\r\n\r\n{{}}GET /livez HTTP/1.1\r\n{H}\r\n",
            "422",
            "200",
            answers=2,
        ),
        raw(
            "expects to be told to go on",
            f"{posted}Expect: 100-continue\r\nContent-Length: {len(job)}\r\n\r\n{job}",
            "202",
        ),
        raw(
            "expects the impossible", f"{posted}Expect: 200-ok\r\nContent-Length: {len(job)}\r\n\r\n{job}", "202", "417"
        ),
        raw(
            "asks to go on with ten gigabytes",
            f"{posted}Expect: 100-continue\r\nContent-Length: 10000000000\r\n\r\n",
            "413",
            "417",
            within=3.0,
        ),
    ]
