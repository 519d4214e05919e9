"""A running service, and maps of a small simulated world on it."""

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from mapfit_client import Client, Map

from .world import rooms

Folder = pytest.TempPathFactory


@pytest.fixture(scope="session")
def binary() -> str:
    """The service's program."""
    found = os.environ.get("MAPFIT_BINARY")
    assert found, "MAPFIT_BINARY must name the mapfit program: these tests ask a running service"
    return found


@pytest.fixture(scope="session")
def url(binary: str, tmp_path_factory: Folder) -> Iterator[str]:
    """The address of a service on a free port, with nothing in it."""
    data = tmp_path_factory.mktemp("data")
    command = [binary, "serve", "--listen", "127.0.0.1:0", "--data", str(data), "--workers", "2", "--log", "warn"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as service:
        assert service.stdout is not None
        line = service.stdout.readline().strip()
        assert line.startswith("serving on "), line
        yield line.removeprefix("serving on ")
        service.terminate()
        assert service.wait(timeout=30) == 0


@pytest.fixture(scope="session")
def client(url: str) -> Iterator[Client]:
    """A client of the service."""
    with Client(url) as client:
        yield client


@pytest.fixture(scope="session")
def signed(client: Client) -> Map:
    """A signed map of a room."""
    return client.submit(rooms("sdf")).wait(progress=False)


@pytest.fixture(scope="session")
def vector(client: Client) -> Map:
    """A vector map of two rooms with a thin wall between them."""
    return client.submit(rooms("vdf")).wait(progress=False)


@pytest.fixture(params=["signed", "vector"])
def fitted(request: pytest.FixtureRequest) -> Map:
    """Each of the two."""
    found: Map = request.getfixturevalue(request.param)
    return found


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of real logs; without it what needs them is skipped, under CI it fails."""
    folder = Path(os.environ.get("MAPFIT_RECORDINGS", ""))
    # The root of the project is where the variable is said to start from.
    found = next(
        (f for f in (folder, Path(__file__).parents[3] / folder) if (f / "intel.flaser.log.gz").is_file()), None
    )
    if found is None:
        assert "CI" not in os.environ, "MAPFIT_RECORDINGS names no folder of logs"
        pytest.skip("MAPFIT_RECORDINGS names no folder of logs")
    return found.resolve()
