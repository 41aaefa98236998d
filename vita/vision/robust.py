"""Robust statistics of a template's pixels: the light, the weights and the correlation.

Everything works on flat float32 arrays of one value a pixel. A pixel's `trust`, 0 to 1, says how far
it belongs to the target at all; its weight also depends on how well it fits just now.
"""

from __future__ import annotations

import math

import numpy as np

from vita.vision.images import Gray

TUKEY = 4.685
"""Residuals beyond this many standard deviations do not count (Tukey's biweight)."""


def light(values: Gray, template: Gray, trust: Gray) -> tuple[float, float]:
    """Gain and bias with which `values` show `template`, by reweighted least squares."""
    weights = trust
    gain = bias = 0.0
    for k in range(3):
        if k:
            weights = tukey(np.abs(values - gain * template - bias), trust, 1e-3)
        total = float(weights.sum()) + 1e-6
        t, v = float(weights @ template) / total, float(weights @ values) / total
        dt = template - t
        wt = weights * dt
        gain = float(wt @ (values - v)) / (float(wt @ dt) + 1e-6)
        bias = v - gain * t
    return gain, bias


def tukey(residual: Gray, trust: Gray, floor: float) -> Gray:
    """Weights that fall to zero for absolute residuals that the bulk of the trusted pixels does not have."""
    trusted = residual[trust > 0.5]
    scale = max(1.4826 * median(trusted if len(trusted) > 16 else residual), floor)
    return trust * np.square(np.maximum(0.0, 1.0 - np.square(residual * (1 / (TUKEY * scale)))))


def correlation(values: Gray, template: Gray, weights: Gray) -> float:
    """Correlation over the weighted pixels, -1 to 1."""
    total = float(weights.sum()) + 1e-6
    dt = template - float(weights @ template) / total
    dv = values - float(weights @ values) / total
    wt, wv = weights * dt, weights * dv
    return float(wt @ dv) / (math.sqrt(float(wt @ dt) * float(wv @ dv)) + 1e-6)


def median(values: Gray) -> float:
    """The upper median; numpy's own spends five times as long on its checks."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])
