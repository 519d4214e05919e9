"""What the README and the notebook say is done, as they say it."""

import asyncio
import json
import re
from pathlib import Path

import jupytext  # type: ignore[import-untyped]
import matplotlib as mpl
import nbclient
import pytest

import mapfit_client
from mapfit_client.recordings.jobs import as_job

from .world import tiny

ROOT = Path(__file__).parents[1]


def test_the_readme(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every block of Python, one after the other, where `job.json` lies."""
    mpl.use("Agg")
    monkeypatch.chdir(tmp_path)
    Path("job.json").write_text(json.dumps(as_job(tiny())))
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert len(blocks) == 7
    names: dict[str, object] = {}
    for block in blocks:
        exec(re.sub(r"Client\(\)", f"Client({url!r})", block), names)
    assert Path("map.png").stat().st_size > 10_000
    client = names["client"]
    assert isinstance(client, mapfit_client.Client)
    client.close()


@pytest.mark.filterwarnings("ignore::Warning:zmq", "ignore::Warning:jupyter_client", "ignore::Warning:nbclient")
def test_the_notebook(url: str, recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From log to map to plot, on a kernel of its own."""
    monkeypatch.setenv("MAPFIT_URL", url)
    monkeypatch.setenv("MAPFIT_RECORDINGS", str(recordings))
    notebook = jupytext.read(ROOT / "notebooks" / "log_to_map.py")
    runner = nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}})
    asyncio.run(runner.async_execute())
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    pictures = [output for output in outputs if "image/png" in output.get("data", {})]
    assert len(pictures) == 4
    said = "".join(output.get("text", "") for output in outputs)
    assert "converged in" in said and "of the area was observed" in said
    assert "scans are located" in said and "from nowhere" in said
