"""A mapfit process that can be killed, stopped and started again on the same data.

Each start writes to the same log, so that a panic is found whichever process had it.
"""

import os
import re
import signal
import socket
import subprocess
import time
from pathlib import Path

from .connection import Connection


def free_port() -> int:
    """A port nobody listens on just now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Process:
    """One `mapfit serve` or `mapfit worker`, over all its lives."""

    def __init__(self, command: list[str], log: Path, enter=None):
        self.command = [str(part) for part in command]
        self.log = log
        self.enter = enter
        self.child: subprocess.Popen | None = None
        self.lives = 0
        self._peak = 0

    def start(self) -> None:
        environment = {**os.environ, "RUST_BACKTRACE": "1", "NO_COLOR": "1"}
        with self.log.open("ab") as log:
            self.child = subprocess.Popen(self.command, stdout=log, stderr=log, env=environment, preexec_fn=self.enter)
        self.lives += 1

    def kill(self) -> None:
        """kill -9, and wait until it is gone: nothing of it runs beside its successor."""
        if self.child is not None:
            self.peak_memory()
            self.child.kill()
            self.child.wait()

    def terminate(self, within: float = 30.0) -> bool:
        """SIGTERM; whether it ended by itself in time. It is gone either way."""
        self.peak_memory()
        self.child.terminate()
        try:
            self.child.wait(within)
            return True
        except subprocess.TimeoutExpired:
            self.kill()
            return False

    def freeze(self) -> None:
        self.child.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        if self.child.poll() is None:
            self.child.send_signal(signal.SIGCONT)

    def alive(self) -> bool:
        return self.child is not None and self.child.poll() is None

    def peak_memory(self) -> int:
        """The most resident memory it had in any of its lives, bytes."""
        self._peak = max(self._peak, self._memory("VmHWM"))
        return self._peak

    def memory(self) -> int:
        """Its resident memory now, bytes."""
        return self._memory("VmRSS")

    def cpu_seconds(self) -> float:
        """What it has spent so far, in this life; nothing where it is gone."""
        try:
            fields = Path(f"/proc/{self.child.pid}/stat").read_text().rsplit(")", 1)[1].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def _memory(self, name: str) -> int:
        try:
            status = Path(f"/proc/{self.child.pid}/status").read_text()
        except OSError:
            return 0
        found = re.search(rf"^{name}:\s+(\d+) kB", status, re.MULTILINE)
        return int(found[1]) * 1024 if found else 0

    def panics(self) -> list[str]:
        """The log's lines that tell of a panic, each with the line after it, which says why."""
        lines = self.log.read_text(errors="replace").splitlines() if self.log.exists() else []
        wanted = re.compile(r"panicked at|has overflowed its stack|memory allocation of .* failed|SIGABRT")
        return [" ".join(lines[k : k + 2]) for k, line in enumerate(lines) if wanted.search(line)]


class Server(Process):
    """`mapfit serve` on a port of its own."""

    def __init__(self, binary: str, data: Path, workers: int, more: list[str] = (), enter=None):
        self.port = free_port()
        self.data = data
        listen = f"127.0.0.1:{self.port}"
        command = [binary, "serve", "--listen", listen, "--data", data, "--workers", workers, "--log", "warn", *more]
        super().__init__(command, data.parent / f"{data.name}.log", enter)

    def connection(self, timeout: float = 30.0) -> Connection:
        return Connection(self.port, timeout)

    def until_ready(self, within: float = 60.0) -> float:
        """Waits for `/readyz` to be 200; how long that took."""
        began = time.monotonic()
        while time.monotonic() - began < within:
            if not self.alive():
                raise RuntimeError(f"the server ended with {self.child.returncode}; see {self.log}")
            try:
                if self.connection(5.0).ask("GET", "/readyz").status == 200:
                    return time.monotonic() - began
            except OSError:
                pass
            time.sleep(0.01)
        raise RuntimeError(f"the server is not ready after {within} s; see {self.log}")


def options_of(binary: str, command: str) -> str:
    """What a command's help says, to find out which options this binary has."""
    return subprocess.run([binary, command, "--help"], capture_output=True, text=True, check=True).stdout
