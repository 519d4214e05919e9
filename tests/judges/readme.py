"""The README's numpy lines, as they stand there, against the service. Arguments: the README, a folder with sdf.npz,
covariance.npz and query.json (points with the service's distance and sigma)."""

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
ours = np.array([known["distance"](*point) for point in query["points"]])
assert len(ours) > 20
assert np.allclose(ours[:, 0], query["distance"], rtol=0, atol=1e-12), np.abs(ours[:, 0] - query["distance"]).max()
assert np.allclose(ours[:, 1], query["sigma"], rtol=1e-9, atol=0), ours[:, 1] / query["sigma"]
print("the README's numpy lines give what the service does")
