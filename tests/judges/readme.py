"""The README's numpy lines, as they stand there, against the service. Arguments: the README, a folder with sdf.npz,
covariance.npz and query.json (points with what the service says of them). Of a vector map the arrays have two components,
"each by the same sum": the lines are given one at a time."""

import json
import os
import sys
from pathlib import Path

import numpy as np

text = Path(sys.argv[1]).read_text()
[code] = [part.split("```")[0] for part in text.split("```python\n")[1:] if "scipy.sparse.load_npz" in part]
os.chdir(sys.argv[2])
known = {}
exec(compile(code, "README.md", "exec"), known)
query = json.loads(Path("query.json").read_text())


def hold(where, expected, sigma):
    """What the lines give at points is what the service says."""
    ours = np.array([known["distance"](*point) for point in where])
    assert len(ours) > 20
    assert np.allclose(ours[:, 0], expected, rtol=0, atol=1e-12), np.abs(ours[:, 0] - expected).max()
    assert np.allclose(ours[:, 1], sigma, rtol=1e-9, atol=0), ours[:, 1] / sigma


arrays, covariance = known["sdf"], known["covariance"]
if "sdf" in arrays:
    hold(query["points"], query["distance"], query["sigma"])
    print("the README's numpy lines give a signed map's distance and sigma")
else:
    # Where no control point is in use the service says nothing.
    said = [k for k, vector in enumerate(query["vector"]) if vector is not None]
    points = [query["points"][k] for k in said]
    vector, forms = (np.array([query[name][k] for k in said]) for name in ("vector", "vector_covariance"))
    n = arrays["vdf_x"].size
    for axis, (name, variance) in enumerate((("vdf_x", forms[:, 0]), ("vdf_y", forms[:, 2]))):
        # The x set stands before the y set.
        known["covariance"] = covariance[axis * n : (axis + 1) * n, axis * n : (axis + 1) * n]
        known["sdf"] = {"origin": arrays["origin"], "resolution": arrays["resolution"], "sdf": arrays[name]}
        hold(points, vector[:, axis], np.sqrt(variance))
    print("the README's numpy lines give a vector map's components and their sigmas")
