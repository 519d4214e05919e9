"""Pictures: that they are drawn, and of what."""

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.collections import LineCollection

from mapfit_client import Map
from mapfit_client.plot import LAYERS

mpl.use("Agg")


@pytest.mark.parametrize("layer", LAYERS)
def test_a_layer_is_drawn(fitted: Map, layer: str) -> None:
    """In metres, blank where nobody looked, with its unit on the bar."""
    ax = fitted.plot(layer=layer, resolution=0.1)
    (image,) = ax.images
    shown = image.get_array()
    assert shown is not None and 0.05 < np.isnan(np.ma.filled(shown, np.nan)).mean() < 0.95
    x, y, far_x, far_y = fitted.lattice.bounds
    assert tuple(image.get_extent()) == (x, far_x, y, far_y)
    assert ax.get_title() == fitted.name and ax.get_xlabel() == "x, m"
    assert LAYERS[layer] in str(image.colorbar and image.colorbar.ax.get_ylabel())
    assert any(isinstance(part, LineCollection) for part in ax.collections)
    plt.close("all")


def test_on_axes_of_ones_own(fitted: Map) -> None:
    """Which are given back."""
    _, ax = plt.subplots()
    assert fitted.plot("sigma", ax=ax, kind="posterior", resolution=0.1, surfaces=False) is ax and not ax.collections
    with pytest.raises(ValueError, match="layer is one of distance, sigma, clearance"):
        fitted.plot("height")
    plt.close("all")
