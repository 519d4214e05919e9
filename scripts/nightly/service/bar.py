"""A progress bar on a terminal, and nothing elsewhere."""

import sys
import time

WIDTH = 30


class Bar:
    """How much of a whole is done; drawn ten times a second at most."""

    def __init__(self, what: str, whole: int):
        self.what, self.whole = what, max(whole, 1)
        self._shown = sys.stderr.isatty()
        self._drawn = 0.0

    def at(self, done: int, note: str = "") -> None:
        now = time.monotonic()
        if not self._shown or (now - self._drawn < 0.1 and done < self.whole):
            return
        self._drawn = now
        filled = WIDTH * min(done, self.whole) // self.whole
        line = f"{self.what} [{'#' * filled}{'.' * (WIDTH - filled)}] {done}/{self.whole} {note}"
        sys.stderr.write("\r" + line[:118].ljust(118))
        sys.stderr.flush()

    def end(self) -> None:
        """Leaves the line empty for what is printed next."""
        if self._shown:
            sys.stderr.write("\r" + " " * 118 + "\r")
            sys.stderr.flush()
