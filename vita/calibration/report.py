"""The report of `vita calibrate`: figures, a map of where corners were seen, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vita.calibration.pair import PairFit
from vita.calibration.solve import NAMES, CameraFit
from vita.calibration.verdict import Finding, coverage

_MAP = 24
"""Columns of the map."""
_MARKS = ".-+#"
"""None, one or two, up to nine, more corners in a cell."""


def camera_lines(fit: CameraFit, name: str) -> list[str]:
    """One camera's figures with their standard deviations, and its map."""
    width, height = fit.size
    pixels = "  ".join(
        f"{what} {value:.2f} ± {sd:.2f}"
        for what, value, sd in zip(NAMES[:4], fit.values, fit.sd, strict=False)
    )
    terms = "  ".join(
        f"{n} {fit.values[i]:+.4f} ± {fit.sd[i]:.4f}" for i, n in enumerate(NAMES) if n in fit.terms
    )
    return [
        f"{name}: {len(fit.errors)} views of {width} x {height}, rms {fit.rms_px:.3f} px",
        f"  {pixels} px",
        f"  distortion: {terms or 'none that the views show'}",
        *_map(fit),
    ]


def _map(fit: CameraFit) -> list[str]:
    # Letters are twice as high as wide.
    rows = max(3, round(_MAP * fit.size[1] / fit.size[0] / 2))
    counts = coverage(list(fit.sights.values()), fit.size, (_MAP, rows))
    levels = np.searchsorted([1, 3, 10], counts, side="right")
    return ["  corners seen:", *("    " + "".join(_MARKS[level] for level in row) for row in levels)]


def pair_lines(fit: PairFit) -> list[str]:
    """How the cameras stand to one another."""
    T = fit.rig.T_right_left
    cosine = np.clip((np.trace(T[:3, :3]) - 1) / 2, -1.0, 1.0)
    turn = f"turned by {np.degrees(np.arccos(cosine)):.2f} ± {fit.rotation_sd_deg:.2f} degrees"
    base = f"baseline {1e3 * fit.rig.baseline:.2f} ± {1e3 * fit.baseline_sd:.2f} mm"
    return [f"stereo: {len(fit.pairs)} pairs, rms {fit.rms_px:.3f} px", f"  {base}, {turn}"]


def verdict_lines(findings: Sequence[Finding]) -> list[str]:
    """What is weak, and the verdict."""
    marks = {"poor": "!", "note": "-"}
    poor = sum(finding.level == "poor" for finding in findings)
    lines = [f"{marks[finding.level]} {finding.text}" for finding in findings]
    return [*lines, f"poor: {poor} thing{'s' if poor > 1 else ''} to put right (!)" if poor else "good"]


def dropped_lines(said: Sequence[str], most: int = 8) -> list[str]:
    """Pictures that were not used, the first few by name."""
    lines = [f"not used: {text}" for text in said[:most]]
    return lines + [f"not used: {len(said) - most} more"] if len(said) > most else lines
