"""Rasters and array answers before numpy and rasterio: one corner, one order, the same numbers as a query's."""

import json
import sys
from pathlib import Path

import numpy as np
import rasterio

folder = Path(sys.argv[1])
arrays = np.load(folder / "grid.npz")
layers = ["distance", "sigma", "clearance"]
h = float(arrays["resolution"])
x0, y0 = arrays["origin"]
height, width = arrays["distance"].shape
assert all(arrays[name].dtype == np.float32 and arrays[name].shape == (height, width) for name in layers)

with rasterio.open(folder / "grid.tif") as tiff:
    assert (tiff.count, tiff.width, tiff.height) == (3, width, height) and set(tiff.dtypes) == {"float32"}
    assert np.allclose(tiff.bounds[:2], (x0, y0), atol=1e-9) and np.allclose(tiff.res, (h, h), rtol=1e-12)
    assert np.isnan(tiff.nodata)
    for band, name in enumerate(layers, 1):
        assert np.array_equal(tiff.read(band)[::-1], arrays[name], equal_nan=True), name
    # A point's value by its coordinates, as a GIS would look it up.
    row, column = tiff.index(2.1, 1.1)
    i, j = int((2.1 - x0) / h), int((1.1 - y0) / h)
    assert tiff.read(1)[row, column] == arrays["distance"][j, i]

centres = np.array([[x0 + (i + 0.5) * h, y0 + (j + 0.5) * h] for j in range(height) for i in range(width)])
np.save(folder / "centres.npy", centres)
answer = folder / "answer.npz"
if answer.exists():
    answer = np.load(answer)
    observed = answer["observed"]
    for name in layers:
        expected = np.where(observed, answer[name], np.nan).astype(np.float32).reshape(height, width)
        assert np.array_equal(expected, arrays[name], equal_nan=True), name
    surface = np.linalg.norm(centres - answer["nearest"], axis=1)
    assert np.all(answer["clearance"][observed] <= surface[observed] + 1e-9)
    same = json.loads((folder / "answer.json").read_text())
    assert np.allclose(answer["distance"][:50], np.array(same["distance"], dtype=float), equal_nan=True, rtol=0, atol=0)
    assert np.allclose(answer["gradient"][:50], np.array([g or [np.nan] * 2 for g in same["gradient"]]), equal_nan=True)
    print("numpy and rasterio agree")
