"""What is computed here is what the service answers, to 1e-9."""

import os
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from mapfit_client import Client, Evaluation, Map, log_to_job
from mapfit_client.chart import Chart
from mapfit_client.evaluation import FIELDS, VECTOR_FIELDS
from mapfit_client.records import KINDS, Kind
from mapfit_client.spline.lattice import Floats, Lattice
from mapfit_client.surfaces.evidence import Evidence
from mapfit_client.surfaces.facets import Facets

from .world import rooms

# Its fit takes a minute, on a machine that does nothing else.
NIGHTLY = pytest.mark.skipif("MAPFIT_NIGHTLY" not in os.environ, reason="MAPFIT_NIGHTLY is not set")


def places(fitted: Map) -> Floats:
    """All over the lattice and around it; on surfaces, their ends, and the corners of cells; between two walls."""
    random = np.random.default_rng(3)
    x, y, far_x, far_y = fitted.lattice.bounds
    everywhere = random.uniform((x - 0.5, y - 0.5), (far_x + 0.5, far_y + 0.5), (4000, 2))
    ends = fitted.facets.ends[random.integers(len(fitted.facets), size=500)]
    knots = np.array([x, y]) + fitted.lattice.resolution * random.integers(0, fitted.lattice.cells, (300, 2))
    corners = np.array([[x, y], [far_x, far_y], [far_x, y], [far_x + 1e-6, y], [1e6, 1e6]])
    middle = np.stack([random.uniform(0.2, 5.8, 500), np.full(500, 2.0)], axis=-1) + random.normal(0, 1e-3, (500, 2))
    return np.concatenate([everywhere, ends[:, 0], ends.mean(axis=1), knots, corners, middle])


def assert_same(here: Evaluation, there: Evaluation, names: tuple[str, ...]) -> None:
    """Holds every array of one evaluation against another's."""
    for name in names:
        ours, theirs = getattr(here, name), getattr(there, name)
        assert ours.shape == theirs.shape
        if name == "observed":
            assert np.array_equal(ours, theirs)
            continue
        assert np.array_equal(np.isnan(ours), np.isnan(theirs)), name
        assert np.nanmax(np.abs(ours - theirs)) <= 1e-9, name


@pytest.mark.parametrize("kind", ["propagated", "posterior"])
def test_the_service_says_the_same(fitted: Map, kind: Kind) -> None:
    """At thousands of points, each array, both kinds."""
    points = places(fitted)
    names = FIELDS if fitted.distance == "sdf" else FIELDS + VECTOR_FIELDS
    here = fitted.evaluate(points, kind)
    assert_same(here, fitted.query(points, kind), names)
    assert here.kind == kind and len(here) == len(points)
    # The points are worth asking about: some off the map, some unobserved, some of each kind.
    assert 0.02 < np.isnan(here.distance).mean() < 0.6
    assert 0.1 < here.observed.mean() < 0.9
    assert (here.clearance[here.observed] < np.abs(here.distance[here.observed]) - 0.01).any()


def test_where_control_points_are_not_in_use(client: Client) -> None:
    """A signed map may have them near evidence alone; beyond, there is no distance."""
    banded = client.submit(rooms("sdf") | {"fit": {"band": 0.25}}).wait(progress=False)
    assert np.isnan(banded.coefficients["sdf"]).any()
    points = places(banded)
    here = banded.evaluate(points)
    assert_same(here, banded.query(points), FIELDS)
    assert (np.isnan(here.distance) & ~np.isnan(here.clearance)).any()


@pytest.mark.parametrize("components", [1, 2])
def test_a_map_without_a_surface(components: int) -> None:
    """Of a signed one the spline answers, of a vector one nothing; clearance is to the unobserved."""
    lattice = Lattice((0.0, 0.0), 1.0, (4, 4))
    facets = Facets(np.empty((0, 2, 2)), np.empty((0, 2)), np.empty((0, 2), bool), 1.0)
    chart = Chart(lattice, [np.full((7, 7), -2.0)] * components, facets, Evidence(lattice, np.ones((16, 16), bool)))
    covariance = chart.stencils(sp.csc_array(np.eye(49 * components)))
    found = chart.evaluate([[1.5, 2.5], [9.0, 9.0]], "propagated", covariance)
    assert np.array_equal(found.clearance, [1.5, np.nan], equal_nan=True)
    assert np.isnan(found.nearest).all()
    assert np.isclose(found.distance[0], -2.0, equal_nan=True) == (components == 1)
    assert np.isnan(found.distance[1]) and (found.vector is None or np.isnan(found.vector).all())


@pytest.mark.parametrize(("every", "resolution"), [(20, 0.3), pytest.param(1, 0.25, marks=NIGHTLY)])
def test_a_building_at_100_000_points(client: Client, recordings: Path, every: int, resolution: float) -> None:
    """The Intel Research Lab: a twentieth of its scans, and all of them."""
    log = recordings / "intel.flaser.log.gz"
    building = client.submit(log_to_job(log, every=every, resolution=resolution)).wait(progress=False)
    x, y, far_x, far_y = building.lattice.bounds
    points = np.random.default_rng(7).uniform((x, y), (far_x, far_y), (100_000, 2))
    for kind in KINDS:
        assert_same(building.evaluate(points, kind), building.query(points, kind), FIELDS + VECTOR_FIELDS)


def test_the_walls_are_where_they_are(fitted: Map) -> None:
    """Not only the same as the service, but right: on true walls within four sigma of nothing."""
    along = np.linspace(0.8, 2.4, 9)
    walls = np.concatenate([np.stack([along, np.zeros(9)], -1), np.stack([along, np.full(9, 4.0)], -1)])
    found = fitted.evaluate(walls)
    assert (np.abs(found.distance) < 4 * np.hypot(found.sigma, 0.005)).all()
    assert found.observed.all()
    inside = fitted.evaluate([1.0, 1.0])
    assert abs(abs(float(inside.distance)) - 1.0) < 0.05
    assert (float(inside.distance) < 0) == (fitted.distance == "sdf")


def test_points_keep_their_shape(fitted: Map) -> None:
    """One point, none, and a raster of them."""
    raster = np.stack(np.meshgrid(np.linspace(0, 6, 7), np.linspace(0, 4, 5)), axis=-1)
    found = fitted.evaluate(raster)
    assert found.distance.shape == (5, 7)
    assert found.gradient.shape == (5, 7, 2)
    assert fitted.query(raster).nearest.shape == (5, 7, 2)
    assert fitted.evaluate([1.0, 1.0]).distance.shape == ()
    assert len(fitted.evaluate([])) == 0
    assert len(fitted.query(np.empty((0, 2)))) == 0
    assert (found.vector is None) == (found.vector_covariance is None) == (fitted.distance == "sdf")


def test_what_is_no_point_is_said(fitted: Map) -> None:
    """The shape is named; what is not finite is nowhere."""
    with pytest.raises(ValueError, match=r"the shape is \(2, 3\)"):
        fitted.evaluate(np.zeros((2, 3)))
    with pytest.raises(ValueError, match="kind is one of"):
        fitted.evaluate([0, 0], kind="exact")  # type: ignore[arg-type]
    nowhere = fitted.evaluate([[np.nan, 1.0], [np.inf, 1.0]])
    assert np.isnan(nowhere.distance).all() and np.isnan(nowhere.clearance).all() and not nowhere.observed.any()


def test_a_batch_is_split_and_joined(fitted: Map, monkeypatch: pytest.MonkeyPatch) -> None:
    """More points than a request may have, and more than are taken at a time here."""
    points = np.random.default_rng(5).uniform((0, 0), (6, 4), (50, 2))
    whole = fitted.query(points), fitted.evaluate(points)
    monkeypatch.setattr("mapfit_client.routes.maps._POINTS_AT_ONCE", 7)
    monkeypatch.setattr("mapfit_client.chart._POINTS_AT_ONCE", 7)
    monkeypatch.setattr("mapfit_client.surfaces.nearest._PAIRS_AT_ONCE", 1)
    monkeypatch.setattr("mapfit_client.surfaces.nearest._FIRST_SEEDS", 1)
    for before, after in zip(whole, (fitted.query(points), fitted.evaluate(points)), strict=True):
        assert_same(after, before, FIELDS)


def test_the_arrays_are_those_of_the_contract(fitted: Map) -> None:
    """Shapes, names, order: a variance by hand from the matrix is the evaluation's."""
    nx, ny = fitted.lattice.cells
    n = fitted.lattice.control_points
    names = ["sdf"] if fitted.distance == "sdf" else ["vdf_x", "vdf_y"]
    assert list(fitted.coefficients) == names
    assert all(c.shape == (ny + 3, nx + 3) for c in fitted.coefficients.values())
    assert set(fitted.covariance) == {"propagated", "posterior"} and len(fitted.covariance) == 2
    row = np.zeros(n * len(names))
    basis = np.array([1, 4, 1]) / 6
    # At the lower left corner of cell (12, 9) three basis functions of each axis do not vanish.
    i, j = 12, 9
    for b in range(3):
        for a in range(3):
            row[i + a + (j + b) * (nx + 3)] = basis[a] * basis[b]
    point = np.array(fitted.lattice.origin) + fitted.lattice.resolution * np.array([i, j])
    for kind in fitted.covariance:
        matrix = fitted.covariance[kind]
        assert matrix.shape == (n * len(names), n * len(names))
        variance = float(row @ np.asarray(matrix @ row))
        found = fitted.evaluate(point, kind)
        forms = found.vector_covariance
        assert np.isclose(variance, found.sigma**2 if forms is None else forms[0], rtol=1e-9)
    with pytest.raises(KeyError):
        fitted.covariance["exact"]  # type: ignore[index]
