"""Reads a map's arrays as a researcher would: numpy and scipy are the judges. Arguments: folder, control points x, y."""

import json
import sys
from pathlib import Path

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spl

folder, nx, ny = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
n = nx * ny

coefficients = np.load(folder / "coefficients.npz")
sdf = coefficients["sdf"]
assert sdf.shape == (ny, nx) and sdf.dtype == np.float64, sdf.shape
assert coefficients["origin"].shape == (2,) and coefficients["resolution"] == 0.5
listed = json.loads((folder / "coefficients.json").read_text())
assert np.array_equal(np.array(listed["sdf"]).reshape(ny, nx), sdf)

# The basis of the contract, evaluated here on its own, against the service's answers.
query = json.loads((folder / "query.json").read_text())
origin, h = coefficients["origin"], float(coefficients["resolution"])


def basis(t):
    return np.array([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]) / 6


def weights(x, y):
    (i, t), (j, w) = (divmod((v - o) / h, 1.0) for v, o in zip((x, y), origin))
    row = np.zeros((ny, nx))
    row[int(j) : int(j) + 4, int(i) : int(i) + 4] = np.outer(basis(w), basis(t))
    return row.ravel()


for kind in ("propagated", "posterior"):
    diagonal = np.load(folder / f"{kind}-diagonal.npz")["sdf"]
    sparse = sp.load_npz(folder / f"{kind}-sparse.npz")
    full = np.load(folder / f"{kind}-full.npz")["matrix"]
    assert sparse.shape == full.shape == (n, n) and diagonal.shape == (ny, nx)
    scale = np.sqrt(np.outer(full.diagonal(), full.diagonal()))
    assert np.allclose(full, full.T, rtol=0, atol=0)
    assert np.abs(diagonal.ravel() - full.diagonal()).max() <= 1e-9 * full.diagonal().max()
    stored = sparse.tocoo()
    assert (np.abs(stored.data - full[stored.row, stored.col]) / scale[stored.row, stored.col]).max() < 1e-8
    # Every pair of control points that share a cell is stored.
    assert all(sparse.indptr[k + 1] > sparse.indptr[k] for k in range(n))
    i, j = stored.row % nx, stored.row // nx
    k, m = stored.col % nx, stored.col // nx
    assert np.abs(i - k).max() == 3 and np.abs(j - m).max() == 3
    eigenvalues = np.linalg.eigvalsh(full)
    assert eigenvalues.min() > -1e-9 * eigenvalues.max(), eigenvalues.min()
    for p, u, sigma in zip(query["points"], query["distance"], query[f"sigma_{kind}"]):
        row = weights(*p)
        assert abs(row @ sdf.ravel() - u) < 1e-12
        assert abs(np.sqrt(row @ full @ row) - sigma) < 1e-7 * sigma, (p, sigma)

# C = H^-1 B B^T H^-1 from the factors.
parts = np.load(folder / "factors.npz")
assemble = lambda name: sp.csc_matrix(
    (parts[f"{name}_data"], parts[f"{name}_indices"], parts[f"{name}_indptr"]), shape=tuple(parts[f"{name}_shape"])
)
hessian, inputs = assemble("hessian"), assemble("input")
assert hessian.shape == (n, n) and inputs.shape[0] == n
image = spl.splu(hessian).solve(inputs.toarray())
propagated = np.load(folder / "propagated-full.npz")["matrix"]
assert np.abs(image @ image.T - propagated).max() < 1e-7 * propagated.diagonal().max()
posterior = np.load(folder / "posterior-full.npz")["matrix"]
assert np.abs(2 * np.linalg.inv(hessian.toarray()) - posterior).max() < 1e-7 * posterior.diagonal().max()
print("numpy and scipy agree")
