"""A memory limit around a process: a cgroup of version 1 or 2 where one can be made, else a watchdog.

A cgroup's kernel kills what outgrows it. The watchdog only looks at resident memory twenty times a second, so it says
what it is in the report.
"""

import os
import threading
import time
from pathlib import Path

from .process import Process

V1, V2 = Path("/sys/fs/cgroup/memory"), Path("/sys/fs/cgroup")


class MemoryLimit:
    """So many bytes for a process and its children. Use `enter` as what a process does before it becomes a server."""

    def __init__(self, limit: int, name: str):
        self.limit = limit
        self.kind = "watchdog"
        self.folder: Path | None = None
        self.exceeded = False
        for root, kind, file in ((V1, "cgroup v1", "memory.limit_in_bytes"), (V2, "cgroup v2", "memory.max")):
            try:
                folder = root / f"{name}-{os.getpid()}"
                folder.mkdir()
                (folder / file).write_text(str(limit))
                self.kind, self.folder = kind, folder
                return
            except OSError:
                if folder.is_dir():
                    folder.rmdir()

    def enter(self) -> None:
        if self.folder:
            (self.folder / "cgroup.procs").write_text(str(os.getpid()))

    def watch(self, process: Process) -> None:
        """Where there is no cgroup: kills the process once it holds too much."""
        if self.folder:
            return

        def look() -> None:
            while process.alive():
                if process.memory() > self.limit:
                    self.exceeded = True
                    process.kill()
                time.sleep(0.05)

        threading.Thread(target=look, daemon=True).start()

    def killed(self) -> bool:
        """Whether anything was killed for its memory."""
        if not self.folder:
            return self.exceeded
        file = "memory.oom_control" if self.kind == "cgroup v1" else "memory.events"
        counts = dict(line.split() for line in (self.folder / file).read_text().splitlines())
        return int(counts.get("oom_kill", 0)) > 0

    def remove(self) -> None:
        if self.folder:
            self.folder.rmdir()
