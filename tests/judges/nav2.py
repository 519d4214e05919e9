"""Reads an exported map by the rules of Nav2's map_server, with PyYAML and Pillow. Arguments: folder."""

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

archive = zipfile.ZipFile(folder / "ogm.zip")
assert sorted(archive.namelist()) == ["map.pgm", "map.yaml"]
meta = yaml.safe_load(archive.read("map.yaml"))
assert meta["image"] == "map.pgm" and meta["mode"] == "trinary" and meta["negate"] == 0
assert (meta["occupied_thresh"], meta["free_thresh"]) == (0.65, 0.196)
assert meta["resolution"] == grid["info"]["resolution"]
position = grid["info"]["origin"]["position"]
assert meta["origin"] == [position["x"], position["y"], 0.0]

image = Image.open(io.BytesIO(archive.read(meta["image"])))
assert image.size == (width, height) and image.mode == "L"
pixels = np.array(image)
assert set(np.unique(pixels)) <= {0, 205, 254}
assert np.array_equal(pixels, np.array(Image.open(folder / "ogm.png")))

# map_server: p = (255 - v) / 255; over occupied_thresh 100, under free_thresh 0, else -1; the first row is the highest y.
p = (255 - pixels.astype(float)) / 255
read = np.where(p > meta["occupied_thresh"], 100, np.where(p < meta["free_thresh"], 0, -1))[::-1]
expected = np.where(data >= 65, 100, np.where((data >= 0) & (data <= 19), 0, -1))
assert np.array_equal(read, expected)
assert (read == 100).any() and (read == 0).any() and (read == -1).any()
print("map_server's rules give the same grid")
