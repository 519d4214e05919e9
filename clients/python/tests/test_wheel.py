"""The built wheel in an environment that has nothing else: what it says it needs is all it needs."""

import subprocess
import venv
from pathlib import Path

import numpy as np

from mapfit_client import Map

from .test_evaluate import places

ROOT = Path(__file__).parents[1]
ASK = """
import sys, numpy, mapfit_client
from importlib.util import find_spec
assert find_spec("matplotlib") is None and find_spec("pytest") is None, "the environment is not clean"
assert mapfit_client.__file__.startswith(sys.prefix)
fitted = mapfit_client.Map.load("map.npz")
numpy.save("sigma.npy", fitted.evaluate(numpy.load("points.npy")).sigma)
"""


def test_in_a_clean_environment(vector: Map, tmp_path: Path) -> None:
    """`pip install` of the wheel, then a saved map answers as it does here."""
    [wheel] = (ROOT / "dist").glob("*.whl")
    venv.create(tmp_path / "env", with_pip=True)
    python = str(tmp_path / "env" / "bin" / "python")
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*install, "-c", str(ROOT / "requirements-test.txt"), str(wheel)], check=True)
    vector.save(tmp_path / "map.npz")
    points = places(vector)
    np.save(tmp_path / "points.npy", points)
    subprocess.run([python, "-c", ASK], cwd=tmp_path, check=True)
    assert np.array_equal(np.load(tmp_path / "sigma.npy"), vector.evaluate(points).sigma, equal_nan=True)
    listed = subprocess.run([python, "-m", "pip", "check"], check=True, capture_output=True, text=True).stdout
    assert "No broken requirements" in listed
