"""Uniform cubic B-spline surfaces, as the contract defines them."""
