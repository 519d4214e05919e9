"""The least of two uncertain distances (Clark 1961).

Where surfaces in other directions are nearly as near as the nearest one, the distance is the least of several uncertain
ones. With a = hypot(s1, s2) and g = (d2 - d1) / a its moments about d1, so that nothing large cancels, are
    mean   = (d2 - d1) (1 - Phi(g)) - a phi(g)
    second = s1^2 Phi(g) + ((d2 - d1)^2 + s2^2) (1 - Phi(g)) - (d2 - d1) a phi(g)
and its variance second - mean^2.
"""

import numpy as np

from ..spline.lattice import Floats

RIVAL = 0.5
"""Surfaces whose directions have a cosine below this are different ones."""
REACH = 3.0
"""Standard deviations within which another surface is a rival."""


def least_sigma(near: tuple[Floats, Floats], far: tuple[Floats, Floats]) -> Floats:
    """The standard deviation of the least of two independent (distance, sigma), the nearer one first."""
    (near_distance, near_sigma), (far_distance, far_sigma) = near, far
    spread = np.hypot(near_sigma, far_sigma)
    farther = far_distance - near_distance
    gap = farther / spread
    density = np.exp(-0.5 * gap * gap) / np.sqrt(2 * np.pi)
    below = normal_cdf(gap)
    mean = farther * (1 - below) - spread * density
    second = near_sigma**2 * below + (farther**2 + far_sigma**2) * (1 - below) - farther * spread * density
    sigma: Floats = np.sqrt(second - mean * mean)
    return sigma


def normal_cdf(z: Floats) -> Floats:
    """The normal distribution function as the service has it (Abramowitz and Stegun 7.1.26), to 1.5e-7."""
    x = np.abs(z) / np.sqrt(2)
    t = 1 / (1 + 0.3275911 * x)
    series = ((((1.061405429 * t - 1.453152027) * t) + 1.421413741) * t - 0.284496736) * t + 0.254829592
    erf = 1 - series * t * np.exp(-x * x)
    below: Floats = 0.5 * (1 + np.copysign(erf, z))
    return below
