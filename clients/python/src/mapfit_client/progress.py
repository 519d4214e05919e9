"""A bar that shows how far a job is."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from tqdm import tqdm

from .records import JobRecord
from .routes.jobs import Show

Progress = bool | Callable[[JobRecord], None]
"""Whether to draw a bar, or who is told of the job instead."""


@contextmanager
def looking_on(progress: Progress, job: JobRecord) -> Iterator[Show | None]:
    """Who is told of the job while it runs; nobody where nobody cares."""
    if isinstance(progress, bool):
        if not progress:
            yield None
            return
        with tqdm(total=100.0, bar_format="{l_bar}{bar}| {elapsed}{postfix}") as bar:
            yield lambda record: _show(bar, record)
        return
    progress(job)
    yield progress


def _show(bar: "tqdm[Any]", job: JobRecord) -> None:
    progress = job["progress"]
    bar.set_description_str(job["name"] or f"job {job['id'][:8]}", refresh=False)
    steps = f", step {progress['iteration']}" if progress["iteration"] else ""
    bar.set_postfix_str(f"{progress['stage']}{steps}", refresh=False)
    bar.n = max(progress["percent"], bar.n)
    bar.refresh()
