"""zstd frames made by hand (RFC 8878): raw blocks, and blocks that repeat one byte, are all that a bomb needs.

Python's library learns zstd in 3.14; until then this spares a dependency, and it can make frames no encoder would.
"""

LARGEST_BLOCK = 128 << 10
MAGIC = (0xFD2FB528).to_bytes(4, "little")
# No checksum, no content size, no dictionary; a window of 1 MiB, or of so much as an exponent says.
WINDOW = 0x50


def _block(kind: int, size: int, last: bool) -> bytes:
    return (size << 3 | kind << 1 | last).to_bytes(3, "little")


def frame(head: bytes, repeated: bytes = b" ", times: int = 0, tail: bytes = b"", window: int = WINDOW) -> bytes:
    """A frame that unpacks to `head`, then one byte so many times, then `tail`."""
    blocks = []
    for text, run in ((head, None), (repeated, times), (tail, None)):
        left = len(text) if run is None else run
        while left > 0:
            size = min(left, LARGEST_BLOCK)
            if run is None:
                begin = len(text) - left
                blocks.append((0, size, text[begin : begin + size]))
            else:
                blocks.append((1, size, text))
            left -= size
    blocks = blocks or [(0, 0, b"")]
    body = b"".join(
        _block(kind, size, number == len(blocks) - 1) + data for number, (kind, size, data) in enumerate(blocks)
    )
    return MAGIC + bytes([0, window]) + body
