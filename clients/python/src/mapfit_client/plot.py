"""A map on matplotlib axes: a layer, the surfaces, axes in metres, a colour bar with its unit.

Layers are evaluated here, at the centres of cells; what nobody observed is left blank. Colours run from the 2nd to
the 98th percentile, and the bar has an arrow where values lie beyond.
"""

from typing import TYPE_CHECKING

import numpy as np

from .evaluation import Evaluation
from .records import Kind
from .spline.lattice import Floats, Marks

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .fitted import FittedMap

LAYERS = {
    "distance": "distance to the nearest surface, m",
    "sigma": "standard deviation of the distance, m",
    "clearance": "clearance, m",
}
_COLOURS = {"distance": "YlGnBu", "sigma": "YlOrRd", "clearance": "YlGnBu"}
Span = tuple[float, float]

_LONGER_SIDE = 400
_BLANK = "0.93"
_INK = "0.1"


def draw(
    fitted: "FittedMap", layer: str, ax: "Axes | None", kind: Kind, resolution: float | None, surfaces: bool
) -> "Axes":
    """Draws a layer; see `FittedMap.plot`."""
    try:
        from matplotlib import pyplot as plt  # noqa: PLC0415 - an extra
        from matplotlib.collections import LineCollection  # noqa: PLC0415
    except ImportError as error:
        raise ImportError("plotting needs matplotlib: pip install 'mapfit-client[plot]'") from error
    if layer not in LAYERS:
        raise ValueError(f"layer is one of {', '.join(LAYERS)}, not {layer!r}")
    x, y, far_x, far_y = fitted.lattice.bounds
    evaluation = fitted.evaluate(_centres(fitted, resolution), kind)
    window = _window(fitted, evaluation)
    if ax is None:
        _, ax = plt.subplots(figsize=_size(*window), layout="compressed")
    values: Floats = np.where(evaluation.observed, getattr(evaluation, layer), np.nan)
    signed = layer == "distance" and fitted.distance == "sdf"
    low, high, extend = _limits(values, from_zero=layer != "sigma" and not signed)
    ax.set_facecolor(_BLANK)
    image = ax.imshow(
        values,
        origin="lower",
        extent=(x, far_x, y, far_y),
        cmap=_COLOURS[layer] + ("_r" if signed else ""),
        vmin=low,
        vmax=high,
        aspect="equal",
    )
    if surfaces:
        ax.add_collection(LineCollection(list(fitted.facets.ends), colors=_INK, linewidths=0.8), autolim=False)
    ax.set(xlabel="x, m", ylabel="y, m", title=fitted.name or "", xlim=window[0], ylim=window[1])
    label = LAYERS[layer] + (", negative in free space" if signed else "")
    # A bar as tall as the map.
    ax.figure.colorbar(image, cax=ax.inset_axes((1.02, 0.0, 0.03, 1.0)), label=label, extend=extend)
    return ax


def _centres(fitted: "FittedMap", resolution: float | None) -> Floats:
    """The centres of cells over the lattice, (rows, columns, 2)."""
    x, y, far_x, far_y = fitted.lattice.bounds
    side = resolution or max(far_x - x, far_y - y) / _LONGER_SIDE
    columns, rows = (max(1, round(length / side)) for length in (far_x - x, far_y - y))
    along_x = x + (np.arange(columns) + 0.5) * (far_x - x) / columns
    along_y = y + (np.arange(rows) + 0.5) * (far_y - y) / rows
    return np.stack(np.meshgrid(along_x, along_y), axis=-1)


def _limits(values: Floats, from_zero: bool) -> tuple[float, float, str]:
    """From where to where colours run, and at which ends of the bar values lie beyond."""
    known = values[np.isfinite(values)]
    if not known.size:
        return 0.0, 1.0, "neither"
    low, high = np.percentile(known, [2, 98])
    low = 0.0 if from_zero else low
    beyond = bool(known.min() < low), bool(known.max() > high)
    extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get(beyond, "neither")
    return float(low), float(high), extend


def _window(fitted: "FittedMap", evaluation: Evaluation) -> tuple[Span, Span]:
    """The axes' limits: what was observed, and a cell more."""
    x, y, far_x, far_y = fitted.lattice.bounds
    margin = fitted.lattice.resolution

    def limits(seen: Marks, start: float, end: float) -> Span:
        at = np.flatnonzero(seen)
        if not len(at):
            return start, end
        step = (end - start) / len(seen)
        return start + float(at[0]) * step - margin, start + float(at[-1] + 1) * step + margin

    columns, rows = (np.logical_or.reduce(evaluation.observed, axis=axis) for axis in (0, 1))
    return limits(columns, x, far_x), limits(rows, y, far_y)


def _size(along_x: Span, along_y: Span) -> tuple[float, float]:
    """A figure that its map and bar fill, inches."""
    tall = (along_y[1] - along_y[0]) / (along_x[1] - along_x[0])
    width = 7.0 if tall <= 1 else max(7.0 / tall, 3.0)
    return width + 1.2, width * tall + 0.8
