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
# A signed map has one set of coefficients, a vector map stacks two; NaN where a control point is not in use.
names = [name for name in ("sdf", "vdf_x", "vdf_y") if name in coefficients]
assert names in (["sdf"], ["vdf_x", "vdf_y"]), names
assert all(coefficients[name].shape == (ny, nx) and coefficients[name].dtype == np.float64 for name in names)
values = np.concatenate([coefficients[name].ravel() for name in names])
used = np.isfinite(values)
assert used.all() if names == ["sdf"] else np.array_equal(used[:n], used[n:]) and not used.all()
size = len(values)
assert coefficients["origin"].shape == (2,) and coefficients["resolution"] == 0.5
listed = json.loads((folder / "coefficients.json").read_text())
assert all(np.array_equal(np.array(listed[name], float).reshape(ny, nx), coefficients[name], equal_nan=True) for name in names)

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
    diagonal = np.load(folder / f"{kind}-diagonal.npz")
    diagonal = np.concatenate([diagonal[name].ravel() for name in names])
    sparse = sp.load_npz(folder / f"{kind}-sparse.npz")
    full = np.load(folder / f"{kind}-full.npz")["matrix"]
    assert sparse.shape == full.shape == (size, size)
    assert np.array_equal(np.isfinite(diagonal), used) and np.array_equal(np.isfinite(full), np.outer(used, used))
    full = np.where(np.outer(used, used), full, 0.0)
    scale = np.sqrt(np.outer(full.diagonal(), full.diagonal()))
    assert np.allclose(full, full.T, rtol=0, atol=0)
    assert np.abs(diagonal - full.diagonal())[used].max() <= 1e-9 * full.diagonal().max()
    stored = sparse.tocoo()
    assert (np.abs(stored.data - full[stored.row, stored.col]) / scale[stored.row, stored.col]).max() < 1e-6
    # Every pair of control points that share a cell is stored, within a component and between components.
    assert all((sparse.indptr[k + 1] > sparse.indptr[k]) == used[k] for k in range(size))
    i, j = stored.row % n % nx, stored.row % n // nx
    k, m = stored.col % n % nx, stored.col % n // nx
    assert np.abs(i - k).max() == 3 and np.abs(j - m).max() == 3
    assert len({(a // n, b // n) for a, b in zip(stored.row, stored.col)}) == len(names) ** 2
    eigenvalues = np.linalg.eigvalsh(full)
    assert eigenvalues.min() > -1e-9 * eigenvalues.max(), eigenvalues.min()
    for number, p in enumerate(query["points"]):
        row = weights(*p)
        parts = [np.nan_to_num(values[c * n : (c + 1) * n]) @ row for c in range(len(names))]
        block = lambda a, b: row @ full[a * n : (a + 1) * n, b * n : (b + 1) * n] @ row
        answer = query[kind]
        if names == ["sdf"]:
            assert abs(parts[0] - answer["distance"][number]) < 1e-12
            assert abs(np.sqrt(block(0, 0)) - answer["sigma"][number]) < 1e-6 * answer["sigma"][number], p
            continue
        assert np.abs(np.array(parts) - answer["vector"][number]).max() < 1e-12, p
        # The distance is that to the surfaces; at the cut locus the vector, a spline, cannot follow it.
        if answer["observed"][number] and answer["distance"][number] < h:
            assert abs(np.hypot(*parts) - answer["distance"][number]) < 0.5 * h, p
        exact = np.array([block(0, 0), block(0, 1), block(1, 1)])
        assert np.abs(exact - answer["vector_covariance"][number]).max() < 1e-6 * exact.max(), p

# C = H^-1 B B^T H^-1 from the factors.
parts = np.load(folder / "factors.npz")
assemble = lambda name: sp.csc_matrix(
    (parts[f"{name}_data"], parts[f"{name}_indices"], parts[f"{name}_indptr"]), shape=tuple(parts[f"{name}_shape"])
)
hessian, inputs = assemble("hessian"), assemble("input")
assert hessian.shape == (size, size) and inputs.shape[0] == size
image = spl.splu(hessian).solve(inputs.toarray())[used]
propagated = np.load(folder / "propagated-full.npz")["matrix"][np.ix_(used, used)]
assert np.abs(image @ image.T - propagated).max() < 1e-7 * propagated.diagonal().max()
posterior = np.load(folder / "posterior-full.npz")["matrix"][np.ix_(used, used)]
inverse = np.linalg.inv(hessian.toarray())[np.ix_(used, used)]
assert np.abs(2 * inverse - posterior).max() < 1e-7 * posterior.diagonal().max()
print("numpy and scipy agree")
