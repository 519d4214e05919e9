"""The rows of issue 12's table by name: each does its worst, and says afterwards what was not as it should be."""

from collections.abc import Callable

from . import burdens, squatters
from .stage import Stage

Row = Callable[[Stage], list[str]]

ROWS: dict[str, Row] = {
    "bombs": burdens.bombs,
    "blocks": burdens.blocks,
    "images": burdens.images,
    "poison": burdens.poison,
    "fits": burdens.fits,
    "slow-headers": squatters.slow_headers,
    "slow-readers": squatters.slow_readers,
    "unfinished": squatters.unfinished,
    "idle": squatters.idle,
}
# Found by reading the source; not rows of the table, so each runs alone.
BEYOND: dict[str, Row] = {
    "members": burdens.members,
    "npy-nests": burdens.npy_nests,
    "endless-evidence": burdens.endless_evidence,
    "cold-maps": burdens.cold_maps,
    "lost-scans": burdens.lost_scans,
}
