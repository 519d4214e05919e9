"""Reads an exported map by the rules of Nav2's map_server, with PyYAML and Pillow. Arguments: folder.

The rules are those of nav2_map_server's map_io.cpp: as it was up to Jazzy, pixel by pixel in double, and as it is since, on
the whole image in float. What they disagree about is whether a value that equals a threshold is beyond it.
"""

import io
import json
import sys
import zipfile
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

folder = Path(sys.argv[1])
grid = json.loads((folder / "ogm.json").read_text())
width, height = grid["info"]["width"], grid["info"]["height"]
data = np.array(grid["data"]).reshape(height, width)
position = grid["info"]["origin"]["position"]


def opened(mode):
    """A zip's metadata and the image that it names."""
    archive = zipfile.ZipFile(folder / f"{mode}.zip")
    meta = yaml.safe_load(archive.read("map.yaml"))
    assert sorted(archive.namelist()) == sorted(["map.yaml", meta["image"]])
    assert meta["mode"] == mode and meta["negate"] == 0
    assert meta["resolution"] == grid["info"]["resolution"]
    assert meta["origin"] == [position["x"], position["y"], 0.0]
    image = Image.open(io.BytesIO(archive.read(meta["image"])))
    assert image.size == (width, height)
    return meta, image


def older(meta, image):
    pixels = np.array(image.convert("RGBA")).astype(float)
    shade, alpha = pixels[..., :3].mean(axis=2) / 255, pixels[..., 3]
    if meta["mode"] == "raw":
        value = np.round(shade * 255)
        return np.where(value <= 100, value, -1)
    occ = 1.0 - shade
    free, occupied = meta["free_thresh"], meta["occupied_thresh"]
    between = np.rint((occ - free) / (occupied - free) * 100) if meta["mode"] == "scale" else -1
    cell = np.where(occupied < occ, 100, np.where(occ < free, 0, between))
    return np.where(alpha < 255, -1, cell) if meta["mode"] == "scale" else cell


def newer(meta, image):
    pixels = np.array(image.convert("RGBA"))
    gray, alpha = pixels[..., 0], pixels[..., 3]
    if meta["mode"] == "raw":
        value = gray.astype(np.int8)
        return np.where((value < 0) | (value > 100), -1, value)
    occ = np.float32(1) - gray.astype(np.float32) / np.float32(255)
    free, occupied = np.float32(meta["free_thresh"]), np.float32(meta["occupied_thresh"])
    cell = np.where(occ >= occupied, 100, -1)
    cell = np.where(occ <= free, 0, cell)
    if meta["mode"] == "scale":
        between = np.round((occ - free) / (occupied - free) * np.float32(100))
        cell = np.where((occ > free) & (occ < occupied), between, cell)
    return np.where(alpha < 255, -1, cell)


meta, image = opened("trinary")
assert meta["image"] == "map.pgm" and image.mode == "L"
assert (meta["occupied_thresh"], meta["free_thresh"]) == (0.65, 0.196)
assert set(np.unique(np.array(image))) <= {0, 205, 254}
assert np.array_equal(np.array(image), np.array(Image.open(folder / "ogm.png")))
expected = {
    "trinary": np.where(data >= 65, 100, np.where((data >= 0) & (data <= 19), 0, -1)),
    "scale": data,
    "raw": data,
}
for mode, cells in expected.items():
    for rules in [older, newer]:
        # The image's first row has the highest y.
        read = rules(*opened(mode))[::-1]
        assert np.array_equal(read, cells), (mode, rules.__name__, np.argwhere(read != cells)[:5])
kinds = [int(cells.sum()) for cells in (data < 0, (data >= 0) & (data <= 19), (data > 19) & (data < 65), data >= 65)]
assert kinds[0] and kinds[1] and kinds[3], kinds
assert opened("raw")[1].mode == "L" and "A" in opened("scale")[1].mode
print("map_server's rules give the same grid in all three modes")
