# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # From a log to a map
#
# A robot drove through the Intel Research Lab and wrote down what its laser scanner saw. From that log comes a map of
# distances that knows how uncertain it is. `MAPFIT_URL` names the service, `MAPFIT_RECORDINGS` the folder with the log.

# %%
import os
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from mapfit_client import Client, Map, log_to_job

client = Client(os.environ.get("MAPFIT_URL", "http://127.0.0.1:8080"))
log = Path(os.environ.get("MAPFIT_RECORDINGS", "../shared/data")) / "intel.flaser.log.gz"

# %% [markdown]
# ## The job
#
# Every fifteenth scan is enough for a first look. A building is a vector map (`vdf`): its thin walls have free space on
# both sides, so there is no inside to sign a distance by.

# %%
job = log_to_job(log, distance="vdf", resolution=0.3, every=15)
returns = sum(r is not None for scan in job["scans"] for r in scan["ranges"])
print(f"{len(job['scans'])} scans, {returns} returns, poses good to {job['noise']['sigma_x'] * 100:.0f} cm")

# %%
building = client.submit(job).wait()
print(building)
print(
    "converged" if building.fit["converged"] else building.fit.get("unconverged"), f"in {building.fit['seconds']:.1f} s"
)

# %% [markdown]
# ## The map
#
# What nobody observed is left blank. Colours run from 0 to the 98th percentile.

# %%
building.plot(layer="distance")
plt.show()

# %% [markdown]
# Where surfaces end and where several are equally near, the distance is less certain.

# %%
building.plot(layer="sigma")
plt.show()

# %% [markdown]
# ## Asking it
#
# A hundred thousand points are answered here, without the service.

# %%
x, y, far_x, far_y = building.lattice.bounds
points = np.random.default_rng(0).uniform((x, y), (far_x, far_y), (100_000, 2))
found = building.evaluate(points)
seen = found.observed
print(
    f"{seen.mean():.0%} of the area was observed, half of that within {np.median(found.distance[seen]):.2f} m of a wall"
)
print(f"sigma of the distance: {np.median(found.sigma[seen]) * 100:.1f} cm in the median")

# %% [markdown]
# The service says the same.

# %%
asked = building.query(points)
assert np.nanmax(np.abs(asked.distance - found.distance)) < 1e-9
assert np.nanmax(np.abs(asked.sigma - found.sigma)) < 1e-9

# %% [markdown]
# ## May a robot go there?
#
# A planner wants `clearance`: the distance to the nearest surface or to unobserved space. With two sigma kept back, a
# robot of 25 cm radius may be where this is true.

# %%
free = seen & (found.clearance - 2 * found.sigma > 0.25)
fig, ax = plt.subplots(figsize=(7, 7), layout="compressed")
building.plot(layer="clearance", ax=ax)
ax.plot(*points[free][::10].T, ".", color="tab:red", markersize=1.5)
plt.show()

# %% [markdown]
# ## Where was this?
#
# Scans that the map was not made of, each halfway between two that it was, located on it: from a pose that is half a
# metre off, and from nowhere. The answer's covariance holds the map's own uncertainty.

# %%
others = log_to_job(log, every=15, start=7)
noise = {**others["noise"], "sigma_x": 0.5, "sigma_y": 0.5, "sigma_theta": 0.1}
taken = others["scans"][::6]
told = np.array([[scan["pose"]["x"], scan["pose"]["y"]] for scan in taken])
rough = [{**scan, "pose": {**scan["pose"], "x": scan["pose"]["x"] + 0.5}} for scan in taken]
answers = building.localize(rough, noise=noise)
located = np.array([[a.pose["x"], a.pose["y"]] if a.pose else [np.nan, np.nan] for a in answers])
apart = np.linalg.norm(located - told, axis=1)
print(f"{np.isfinite(apart).sum()} of {len(taken)} scans are located,")
print(f"half of them within {np.nanmedian(apart) * 100:.0f} cm of the log's pose")

# %%
[lost] = building.localize([{**taken[0], "pose": None}], noise=noise, hypotheses=3)
for hypothesis in lost.hypotheses:
    x, y = hypothesis["pose"]["x"], hypothesis["pose"]["y"]
    print(f"from nowhere: {hypothesis['probability']:.0%} at ({x:.2f}, {y:.2f})")
print(f"the log says ({told[0][0]:.2f}, {told[0][1]:.2f})")

# %% [markdown]
# Orange crosses are where the scans were said to be, red points where the map finds them.

# %%
fig, ax = plt.subplots(figsize=(7, 7), layout="compressed")
building.plot(layer="distance", ax=ax)
ax.plot(told[:, 0] + 0.5, told[:, 1], "x", color="tab:orange", markeredgewidth=2, label="said to be")
ax.plot(*located.T, "o", color="tab:red", markersize=4, label="located")
ax.legend(loc="upper right")
plt.show()

# %% [markdown]
# ## Taking it along
#
# One file, which `Map.load` and numpy open.

# %%
file = Path("building.npz")
building.save(file)
again = Map.load(file)
assert np.array_equal(again.evaluate(points[:100]).distance, found.distance[:100], equal_nan=True)
print(f"{file.stat().st_size / 1e6:.1f} MB")
file.unlink()
