"""Contours before shapely and svgelements: valid geometry of RFC 7946, lines within their band, a band as wide as sigma says, and pictures that are
as large as was asked, whose raster is that of the PNG. Arguments: the folder, pixels of the pictures' width."""

import base64
import io
import json
import sys
from pathlib import Path

import numpy as np
import shapely
from PIL import Image
from shapely.geometry import shape
from svgelements import SVG, Path as Drawn, Point, SVGImage, Text

folder, wide = Path(sys.argv[1]), int(sys.argv[2])

contours = json.loads((folder / "contours.geojson").read_text())
assert contours["type"] == "FeatureCollection"
by_role = {feature["properties"]["role"]: shape(feature["geometry"]) for feature in contours["features"]}
level, band = by_role["level"], by_role["band"]
assert level.geom_type == "MultiLineString" and band.geom_type == "MultiPolygon"
assert not level.is_empty and level.is_valid and np.isfinite(shapely.get_coordinates([level, band])).all()
for polygon in band.geoms:
    assert polygon.exterior.is_ccw and not any(hole.is_ccw for hole in polygon.interiors)
    assert polygon.is_valid or polygon.buffer(0).area >= 0.99 * polygon.area, shapely.is_valid_reason(polygon)
# Of a vector map strips of neighbouring walls lie over each other at corners.
around = shapely.union_all([shapely.make_valid(polygon) for polygon in band.geoms])
inside = level.intersection(around.buffer(2e-3)).length / level.length
assert inside > 0.97, f"{inside:.3f} of the level lies in its band"

# Its width where the level runs, against two standard deviations to either side.
asked = json.loads((folder / "sigma.json").read_text())
sigma = np.array(asked["sigma"], dtype=float)
width = around.area / level.length
assert 0.5 < width / (4 * np.nanmedian(sigma)) < 2.0, (
    f"the band is {width:.4f} m wide, sigma {np.nanmedian(sigma):.4f} m"
)


def drawing(name):
    """A picture's elements, and its size in pixels."""
    drawn = SVG.parse(folder / name)
    assert round(float(drawn.width)) == wide, (name, drawn.width)
    return list(drawn.elements()), (round(float(drawn.width)), round(float(drawn.height)))


elements, _ = drawing("contours.svg")
pieces = max(len(list(one.as_subpaths())) for one in elements if isinstance(one, Drawn))
assert pieces >= len(level.geoms), f"{pieces} lines are drawn of {len(level.geoms)}"
assert any(isinstance(one, Text) and "contour" in (one.text or "") for one in elements)

elements, size = drawing("image.svg")
picture = Image.open(folder / "image.png")
assert picture.size == size
raster = next(one for one in elements if isinstance(one, SVGImage))
pixels = Image.open(io.BytesIO(base64.b64decode(raster.url.split(",", 1)[1]))).convert("RGB")
first, last = (Point(x, y) * raster.transform for x, y in ((0, 0), (float(raster.width), float(raster.height))))
left, top, right, bottom = (round(at) for at in (first.x, first.y, last.x, last.y))
assert (right - left, bottom - top) == pixels.size, "a pixel of the raster is one of the picture"
shown = np.asarray(picture.convert("RGB").crop((left, top, right, bottom)), dtype=int)
same = (np.abs(shown - np.asarray(pixels, dtype=int)).max(axis=2) <= 2).mean()
assert same > 0.97, f"{same:.3f} of the raster is in the PNG as it is in the SVG"
