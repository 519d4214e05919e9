"""CARMEN logs become the jobs that `mapfit submit` makes of them."""

import subprocess
from pathlib import Path

import pytest

from mapfit_client import Client, log_to_job


def line(far: float) -> str:
    """A scan of 180 beams, every third without a return."""
    ranges = " ".join(f"{81.83 if k % 3 == 0 else far + 0.01 * k:.2f}" for k in range(180))
    return f"FLASER 180 {ranges} 1.5 -2.0 7.0 1.4 -2.0 7.0 12.5 host 12.6"


def test_scans_are_read_and_other_lines_passed_over(tmp_path: Path) -> None:
    """No return, whatever the scanner writes for it, is null."""
    file = tmp_path / "drive.log"
    file.write_text(f"# a comment\nPARAM x 1\nODOM 1 2 3\n{line(1.0)}\n{line(2.0)}\n")
    job = log_to_job(file, resolution=0.5, noise={"sigma_range": 0.03}, start=1)
    (scan,) = job["scans"]
    assert job["name"] == "drive" and job["map"] == {"distance": "vdf", "resolution": 0.5}
    assert job["noise"] == {"sigma_x": 0.02, "sigma_y": 0.02, "sigma_theta": 0.005, "sigma_range": 0.03}
    assert scan["pose"] == {"x": 1.5, "y": -2.0, "theta": 0.716814692820}
    assert scan["ranges"][:3] == [None, 2.01, 2.02] and scan["range_max"] == 3.79


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ODOM 1 2 3\n", "no FLASER line"),
        (f"ODOM\n{line(1.0)[:300]}", "line 2: 180 ranges and a pose"),
        (line(1.0).replace("1.01", "x", 1), "line 1: .*'x'"),
        (line(1.0).replace("180", "90", 1), "line 1: .*181"),
    ],
)
def test_what_is_wrong_with_a_log_is_said(tmp_path: Path, text: str, said: str) -> None:
    """With its file and line."""
    file = tmp_path / "torn.log"
    file.write_text(text)
    with pytest.raises(ValueError, match=said) as refused:
        log_to_job(file)
    assert str(file) in str(refused.value)
    file.write_text(line(1.0))
    with pytest.raises(ValueError, match="leave no scan"):
        log_to_job(file, start=5)


@pytest.mark.parametrize("log", ["intel", "seattle"])
def test_a_real_log_is_what_the_command_line_makes_of_it(
    client: Client, binary: str, url: str, recordings: Path, log: str
) -> None:
    """To the last bit."""
    file = recordings / f"{log}.flaser.log.gz"
    every = 12
    command = [binary, "submit", str(file), "--url", url, "--every", str(every), "--resolution", "0.5"]
    subprocess.run(command, check=True, capture_output=True)
    theirs = next(client.jobs())
    ours = client.submit(log_to_job(file, every=every, resolution=0.5))
    assert ours.id != theirs.id and ours.request() == theirs.request()
    ours.cancel()
    theirs.cancel()
