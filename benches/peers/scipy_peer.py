"""The problem of examples/side_by_side in SciPy: least_squares (trf, x_scale='jac', LSMR) or a plain Levenberg-Marquardt
on splu. Prints seconds and cost an evaluation as CSV.

    scipy_peer.py DIR trf|splu SECONDS
"""

import sys
import time

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import splu


def basis(t):
    s = 1 - t
    b = np.stack([s**3 / 6, (3 * t**3 - 6 * t**2 + 4) / 6, (-3 * t**3 + 3 * t**2 + 3 * t + 1) / 6, t**3 / 6])
    d = np.stack([-(s**2) / 2, (3 * t**2 - 4 * t) / 2, (-3 * t**2 + 2 * t + 1) / 2, t**2 / 2])
    return b, d


def rows(cells, along, across, nx):
    """Basis rows (value, d/dt, d/dw) at local places of cells, as index and weight arrays of shape (n, 16)."""
    b, db = basis(along)
    c, dc = basis(across)
    k = np.arange(16)
    first = cells % nx + (cells // nx) * (nx + 3)
    index = first[:, None] + (k % 4)[None] + (k // 4)[None] * (nx + 3)
    shape = lambda p, q: (p[k % 4] * q[k // 4]).T
    return index, shape(b, c), shape(db, c), shape(b, dc)


class Problem:
    def __init__(self, folder):
        nx, ny, h, rho, n = open(f"{folder}/meta.txt").read().split()
        nx, ny, h, rho = int(nx), int(ny), float(h), float(rho)
        cells = np.fromfile(f"{folder}/cells.i64", dtype="<i8")
        seen = np.fromfile(f"{folder}/returns.f64", dtype="<f8").reshape(-1, 3)
        self.start = np.fromfile(f"{folder}/start.f64", dtype="<f8")
        gauss = np.array([0.2113248654051871, 0.7886751345948129])
        every = np.repeat(np.arange(nx * ny), 4)
        q = np.tile(np.arange(4), nx * ny)
        index, _, dx, dy = rows(every, gauss[q % 2], gauss[q // 2], nx)
        size = (len(every), len(self.start))
        pointer = np.arange(0, 16 * len(every) + 1, 16)
        self.dx = csr_matrix((dx.ravel() / h, index.ravel(), pointer), size)
        self.dy = csr_matrix((dy.ravel() / h, index.ravel(), pointer), size)
        at, value, _, _ = rows(cells, seen[:, 0], seen[:, 1], nx)
        weighed = value * np.sqrt(2 * seen[:, 2])[:, None]
        self.seen = csr_matrix((weighed.ravel(), at.ravel(), np.arange(0, 16 * len(cells) + 1, 16)), (len(cells), size[1]))
        self.scale = np.sqrt(2 * rho * h * h / 4)
        self.index, self.pointer = index, pointer

    def residuals(self, x):
        gx, gy = self.dx @ x, self.dy @ x
        return np.concatenate([self.scale * (gx * gx + gy * gy - 1), self.seen @ x])

    def jacobian(self, x):
        gx, gy = self.dx @ x, self.dy @ x
        data = 2 * self.scale * (np.repeat(gx, 16) * self.dx.data + np.repeat(gy, 16) * self.dy.data)
        eikonal = csr_matrix((data, self.dx.indices, self.pointer), self.dx.shape)
        from scipy.sparse import vstack

        return vstack([eikonal, self.seen], format="csr")


class OutOfTime(Exception):
    pass


def main():
    folder, method, seconds = sys.argv[1], sys.argv[2], float(sys.argv[3])
    problem = Problem(folder)
    print("seconds,cost,gradient")
    lowest = [np.inf, problem.start]
    begun = time.perf_counter()

    def residuals(x):
        r = problem.residuals(x)
        now, cost = time.perf_counter() - begun, 0.5 * r @ r
        print(f"{now:.6f},{cost:.9f},nan", flush=True)
        if cost < lowest[0]:
            lowest[:] = [cost, x.copy()]
        if now > seconds:
            raise OutOfTime
        return r

    try:
        if method == "trf":
            least_squares(residuals, problem.start, problem.jacobian, method="trf", x_scale="jac", tr_solver="lsmr",
                          max_nfev=200, ftol=1e-15, xtol=1e-15, gtol=1e-15)
        else:
            levenberg_marquardt(problem, residuals)
    except OutOfTime:
        pass
    gradient = lambda x: np.abs(problem.jacobian(x).T @ problem.residuals(x)).max()
    print(f"# relative gradient {gradient(lowest[1]) / gradient(problem.start):.3e}")


def levenberg_marquardt(problem, residuals):
    x, mu = problem.start.copy(), 1e-3
    r = residuals(x)
    for _ in range(200):
        j = problem.jacobian(x)
        normal, gradient = (j.T @ j).tocsc(), j.T @ r
        while True:
            damped = normal + mu * diags(normal.diagonal() + 1e-9)
            step = splu(damped.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(-gradient)
            trial = residuals(x + step)
            if trial @ trial < r @ r:
                x, r, mu = x + step, trial, max(mu / 3, 1e-12)
                break
            mu *= 4
            if mu > 1e12:
                return


main()
