"""What is asked about a map: contours, grids, occupancy; and what a file of it can do."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from mapfit_client import Map, MapfitError

from .test_evaluate import assert_same, places


def test_a_saved_map_is_the_same_map(fitted: Map, tmp_path: Path) -> None:
    """Record, arrays and answers; without the service."""
    file = tmp_path / "map.npz"
    fitted.save(file)
    loaded = Map.load(file)
    assert loaded.record == fitted.record
    points = places(fitted)
    names = ("distance", "sigma", "gradient", "nearest", "clearance", "observed")
    for kind in fitted.covariance:
        assert_same(loaded.evaluate(points, kind), fitted.evaluate(points, kind), names)
        assert abs(loaded.covariance[kind] - fitted.covariance[kind]).max() == 0
    with pytest.raises(RuntimeError, match="loaded from a file"):
        loaded.query(points)
    loaded.save(tmp_path / "again.npz")
    assert Map.load(tmp_path / "again.npz").record == fitted.record


def test_other_files_are_no_maps(tmp_path: Path) -> None:
    """An npz of something else, a later format, and pickles, which are never opened."""
    file = tmp_path / "other.npz"
    np.savez(file, a=np.zeros(3))
    with pytest.raises(ValueError, match=r"not a map that Map\.save wrote"):
        Map.load(file)
    np.savez(file, format=np.array(9), record=np.zeros(3, np.uint8))
    with pytest.raises(ValueError, match="format 9"):
        Map.load(file)
    with zipfile.ZipFile(file, "w") as archive:
        body = io.BytesIO()
        np.lib.format.write_array(body, np.array([{}], dtype=object))
        archive.writestr("format.npy", body.getvalue())
        archive.writestr("record.npy", body.getvalue())
    with pytest.raises(ValueError, match="allow_pickle"):
        Map.load(file)


def test_contours_lie_on_the_level(fitted: Map) -> None:
    """GeoJSON in metres, with the band where one is asked for."""
    found = fitted.contours(sigma_band=2.0)
    assert [feature["properties"]["role"] for feature in found["features"]] == ["level", "band"]
    assert found["frame"]["units"] == "m"
    level = -0.5 if fitted.distance == "sdf" else 0.5
    lines = fitted.contours(level)["features"][0]["geometry"]["coordinates"]
    points = np.concatenate([np.array(line) for line in lines])
    assert len(points) > 100
    assert np.nanmedian(np.abs(fitted.evaluate(points).distance - level)) < 1e-3


def test_rasters_agree_with_points(fitted: Map) -> None:
    """Occupancy where walls are, free where they are not; layers are the evaluation's."""
    occupancy = fitted.ogm(0.1)
    assert occupancy.frame_id == "map" and occupancy.resolution == 0.1 and occupancy.origin == fitted.lattice.origin
    assert set(np.unique(occupancy.data)) <= set(range(-1, 101))
    column, row = ((np.array([[1.0, 1.0], [2.0, 0.0]]) - occupancy.origin) / 0.1).astype(int).T
    assert occupancy.data[row[0], column[0]] == 0 and occupancy.data[row[1] - 1 : row[1] + 2, column[1]].max() > 50
    grid = fitted.grid(["distance", "clearance"], resolution=0.1)
    assert set(grid) == {"distance", "clearance", "origin", "resolution"}
    rows, columns = grid["distance"].shape
    x, y = (grid["origin"][k] + (np.arange(n) + 0.5) * 0.1 for k, n in ((0, columns), (1, rows)))
    found = fitted.evaluate(np.stack(np.meshgrid(x, y), axis=-1))
    seen = np.isfinite(grid["distance"])
    assert np.abs(grid["distance"] - found.distance)[seen].max() < 1e-5
    assert (seen == found.observed).mean() > 0.98


def test_what_cannot_be_asked_is_refused(fitted: Map) -> None:
    """By the service, by the parameter's name."""
    with pytest.raises(MapfitError) as refused:
        fitted.ogm(1e-5)
    assert refused.value.problem["errors"][0].get("parameter") == "resolution"
