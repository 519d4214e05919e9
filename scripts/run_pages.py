"""Does what the documentation's pages say, in order, against a live service: every block of `sh` and of `python`.

A page's blocks share one folder, one shell and one Python, so that what one leaves the next one finds. A block of
`text` is what the block before it prints, where `...` stands for anything. Comments say what is otherwise:

    <!-- not run: why not -->           before a block, which stays as it is
    <!-- with: drive.mcap, FILE -->     what the reader has in the folder, of our recordings

Pages say localhost:8080 and :9000; here these are free ports. Arguments: the Python with the client installed, then
pages (all of docs/SUMMARY.md and the README without any). MAPFIT_BINARY is the program, MAPFIT_RECORDINGS the folder of
real logs."""

import os
import re
import selectors
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "judges"))
import recorded  # noqa: E402  (the judges' recordings)

BLOCK = re.compile(r"(?:^<!-- (?P<note>[^\n]*) -->\n)?^```(?P<language>\w+)\n(?P<code>.*?)^```$", re.M | re.S)
WITH = re.compile(r"^<!-- with: (?P<files>.*) -->$", re.M)
END = "--- the block has ended ---"
PYTHON_LOOP = f"""
import sys
names = {{"__name__": "__main__"}}
for line in sys.stdin:
    path = line.strip()
    exec(compile(open(path).read(), path, "exec"), names)
    print({END!r}, flush=True)
"""
SECONDS = 180
"""What a block may take."""


class Failed(Exception):
    """A block did not do what the page says."""


class Session:
    """A shell or a Python that blocks are done in, one after the other."""

    def __init__(self, command: list[str], folder: Path, environment: dict[str, str], log) -> None:
        self.process = subprocess.Popen(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            start_new_session=True,
        )
        self.said = b""

    def do(self, line: str) -> str:
        """Sends a line, and gives what is printed until its end."""
        self.process.stdin.write(line.encode() + b"\n")
        self.process.stdin.flush()
        until = time.monotonic() + SECONDS
        with selectors.DefaultSelector() as selector:
            selector.register(self.process.stdout, selectors.EVENT_READ)
            while (END + "\n").encode() not in self.said:
                # What it started may hold the pipe open when it has ended, so the pipe's end does not tell.
                part = os.read(self.process.stdout.fileno(), 65536) if selector.select(0.5) else None
                if part == b"" or (part is None and self.process.poll() is not None):
                    raise Failed(f"it failed; printed was\n{self.said.decode(errors='replace')}")
                if time.monotonic() > until:
                    raise Failed(f"no end after {SECONDS} s; printed was\n{self.said.decode(errors='replace')}")
                self.said += part or b""
        printed, self.said = self.said.split((END + "\n").encode(), 1)
        return printed.decode()

    def end(self) -> None:
        """Ends it and all that it started."""
        try:
            os.killpg(self.process.pid, signal.SIGTERM)
            time.sleep(0.1)
            os.killpg(self.process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        self.process.wait()


def free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


def lay_out(files: str, folder: Path, recordings: Path, binary: Path) -> None:
    """What the reader has: logs as they are, a ROS 2 drive through the same corridor, the demo's job."""
    for name in (name.strip() for name in files.split(",")):
        if name.endswith(".mcap"):
            _, lines = recorded.log_lines(recordings / "seattle.flaser.log.gz", 241)
            (folder / name).write_bytes(recorded.recording(lines[::5]))
        elif name == "mapfit-demo/job.json":
            command = [binary, "demo", "--once", "--listen", "127.0.0.1:0"]
            subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        elif name == "job.json":
            shutil.copy(folder / "mapfit-demo" / name, folder)
        else:
            shutil.copy(recordings / name, folder / name)


def expected(text: str) -> re.Pattern[str]:
    """A block of `text` as a pattern."""
    parts = [re.escape(part) for part in text.strip().split("...")]
    return re.compile(".*?".join(parts), re.S)


def wait_ready(port: int) -> None:
    until = time.monotonic() + 20
    while True:
        try:
            urllib.request.urlopen(f"http://127.0.0.1:{port}/readyz", timeout=5)
            return
        except OSError:
            if time.monotonic() > until:
                raise Failed("the service does not get ready") from None
            time.sleep(0.1)


def do_page(page: Path, python: str, binary: Path, recordings: Path) -> tuple[int, int]:
    """How many blocks were run, and how many say why they are not."""
    text = page.read_text()
    blocks = [found for found in BLOCK.finditer(text) if found["language"] in ("sh", "python", "text")]
    port, hook = free_port(), free_port()
    replaced = {
        "localhost:8080": f"127.0.0.1:{port}",
        "127.0.0.1:8080": f"127.0.0.1:{port}",
        "localhost:9000": f"127.0.0.1:{hook}",
        "127.0.0.1:9000": f"127.0.0.1:{hook}",
        "Client()": f'Client("http://127.0.0.1:{port}")',
        '("", 9000)': f'("127.0.0.1", {hook})',
    }
    run = skipped = 0
    with tempfile.TemporaryDirectory(prefix="mapfit-page-") as name:
        programs, folder = Path(name) / "bin", Path(name) / "work"
        programs.mkdir()
        folder.mkdir()
        (programs / "mapfit").symlink_to(binary)
        for found in WITH.finditer(text):
            lay_out(found["files"], folder, recordings, binary)
        environment = {key: value for key, value in os.environ.items() if not key.startswith("MAPFIT_")} | {
            "PATH": f"{programs}:{Path(python).parent}:{os.environ['PATH']}",
            "MAPFIT_LISTEN": f"127.0.0.1:{port}",
            "MAPFIT_URL": f"http://127.0.0.1:{port}",
            "MAPFIT_LOG": "warn",
            "MPLBACKEND": "Agg",
        }
        log_file = Path(name) / "stderr"
        with log_file.open("wb") as log:
            shell = Session(["bash", "--norc", "-s"], folder, environment, log)
            interpreter = Session([python, "-c", PYTHON_LOOP], folder, environment, log)
            printed = None
            try:
                shell.do(f"set -euo pipefail; echo '{END}'")
                for k, block in enumerate(blocks):
                    code, language, note = block["code"], block["language"], block["note"] or ""
                    line = text.count("\n", 0, block.start()) + 1
                    try:
                        if note.startswith("not run: "):
                            skipped += 1
                            printed = None
                            continue
                        for old, new in replaced.items():
                            code = code.replace(old, new)
                        if language == "text":
                            if printed is None:
                                raise Failed("there is nothing before it that prints")
                            if not expected(code).fullmatch(printed.strip()):
                                raise Failed(f"printed was\n{printed}")
                            continue
                        file = Path(name) / f"block-{k}.{language}"
                        file.write_text(code)
                        if language == "sh":
                            printed = shell.do(f". {file} </dev/null; echo '{END}'")
                        else:
                            printed = interpreter.do(str(file))
                        if "mapfit serve" in code:
                            wait_ready(port)
                            shell.do(f"echo '{END}'")  # what it said of itself is nobody's answer
                        run += 1
                    except Failed as failed:
                        raise Failed(
                            f"{page}:{line}\n{block['code']}\n{failed}\n{log_file.read_text()[-3000:]}"
                        ) from None
            finally:
                interpreter.end()
                shell.end()
    return run, skipped


def chapters() -> list[Path]:
    """Every page of the site, and the README."""
    found = re.findall(r"\]\(([\w/.-]+\.md)\)", (ROOT / "docs" / "SUMMARY.md").read_text())
    return [ROOT / "README.md", *(ROOT / "docs" / name for name in found)]


def main(python: str, *names: str) -> int:
    binary, recordings = (
        Path(os.environ["MAPFIT_BINARY"]).resolve(),
        Path(os.environ.get("MAPFIT_RECORDINGS", "")).resolve(),
    )
    pages = [Path(name).resolve() for name in names] or chapters()
    if not (recordings / "seattle.flaser.log.gz").is_file():
        print("skipped: MAPFIT_RECORDINGS names no folder of logs, and the pages are about them")
        return 1 if "CI" in os.environ else 0
    failures = total = unrun = 0
    for page in pages:
        begun = time.monotonic()
        try:
            run, skipped = do_page(page, python, binary, recordings)
            total, unrun = total + run, unrun + skipped
            if run or skipped:
                print(
                    f"{page.relative_to(ROOT)}: {run} blocks run, {skipped} not, {time.monotonic() - begun:.1f} s",
                    flush=True,
                )
        except Failed as failed:
            failures += 1
            print(f"FAILED {failed}", flush=True)
    print(f"{total} blocks of the pages run; {unrun} say why they are not; {failures} pages failed")
    return 1 if failures or not total else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
