"""Marks on a frame: everything has a dark rim, so that it can be seen on any picture. Colours are BGR."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vita.tracking.label import Label, write
from vita.types import Array, Feature

Canvas = NDArray[np.uint8]
Bgr = tuple[int, int, int]
COLORS: tuple[Bgr, ...] = (
    (255, 150, 30), (60, 190, 40), (220, 70, 230), (10, 190, 255),
    (200, 200, 30), (245, 90, 140), (70, 140, 215), (170, 235, 190),
)  # fmt: skip
"""One per tracker, in turn; none is red, which means lost."""
RED: Bgr = (60, 50, 240)
RIM: Bgr = (25, 20, 18)
WHITE: Bgr = (255, 255, 255)
_SHADES = 8
"""Steps in which a trail fades."""
_BITS = 4
"""Positions are drawn to 1/16 pixel."""


def annotate(
    canvas: Canvas,
    features: Mapping[str, Feature],
    trails: Mapping[str, Sequence[Array | None]],
    caption: str,
) -> None:
    """Draw on a (h, w, 3) BGR picture. Trails are the last positions, None where there was none."""
    px = int(np.clip(6 + canvas.shape[0] / 60, 10, 48))
    width = max(1, round(canvas.shape[0] / 260))
    own = {name: COLORS[i % len(COLORS)] for i, name in enumerate(features)}
    for name, trail in trails.items():
        _trail(canvas, list(trail), own[name], width)
    for name, feature in features.items():
        _mark(canvas, feature, own[name], width)
    label = Label(canvas, px)
    for name, feature in features.items():
        text = f"{name}  {feature.score:.2f}" if feature.ok else f"{name}  lost"
        label.put(text, extent(feature), own[name] if feature.ok else RED)
    write(canvas, caption, (px // 2, canvas.shape[0] - px // 2 - 1), WHITE, px, rim=RIM)


def extent(feature: Feature) -> tuple[float, float, float, float]:
    """(u0, v0, u1, v1) around everything that is drawn of a feature [px]."""
    parts = [p for p in (feature.corners, feature.outline, feature.segment) if p is not None]
    points = np.concatenate(parts) if parts else feature.uv + np.array([[-8.0, -8.0], [8.0, 8.0]])
    low, high = points.min(axis=0), points.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _mark(canvas: Canvas, feature: Feature, own: Bgr, width: int) -> None:
    """The region and the point: a cross in the tracker's colour, or dashed and red when it is lost."""
    color = own if feature.ok else RED
    lines: list[Array] = []
    for outline in (feature.corners, feature.outline):
        if outline is not None:
            lines.append(np.concatenate([outline, outline[:1]]))
    if feature.segment is not None:
        lines.append(feature.segment)
    pieces = lines if feature.ok else [piece for line in lines for piece in _dashes(line, 7.0 * width)]
    arm = 4.0 + 2 * width
    along, across = np.array([arm, 0.0]), np.array([0.0, arm])
    if not feature.ok:
        along, across = np.array([arm, arm]), np.array([arm, -arm])
    pieces += [feature.uv + np.stack([-arms, arms]) for arms in (along, across)]
    fixed = [_fixed(piece) for piece in pieces]
    # All rims before all colours: a rim must not cut through a line that crosses it.
    cv2.polylines(canvas, fixed, False, RIM, width + 2, cv2.LINE_AA, _BITS)
    cv2.polylines(canvas, fixed, False, color, width, cv2.LINE_AA, _BITS)


def _dashes(line: Array, length: float) -> list[Array]:
    """Every second piece of a polyline, of about `length` [px]."""
    pieces = []
    for a, b in zip(line[:-1], line[1:], strict=True):
        n = 2 * int(np.clip(np.hypot(*(b - a)) / (2 * length), 1, 200)) + 1
        steps = np.linspace(0.0, 1.0, n + 1)[:, None]
        points = a + steps * (b - a)
        pieces += [points[k : k + 2] for k in range(0, n, 2)]
    return pieces


def _trail(canvas: Canvas, points: list[Array | None], color: Bgr, width: int) -> None:
    """A line that fades: blended with the picture, the older the fainter."""
    seen = np.array([p is not None for p in points])
    if seen.sum() < 2:
        return
    path = np.array([(0.0, 0.0) if p is None else p for p in points])
    height, columns = canvas.shape[:2]
    low = np.clip(np.floor(path[seen].min(axis=0)) - 4, 0, [columns - 1, height - 1]).astype(int)
    high = np.clip(np.ceil(path[seen].max(axis=0)) + 5, low + 1, [columns, height]).astype(int)
    part = canvas[low[1] : high[1], low[0] : high[0]]
    strength = np.zeros(part.shape[:2], np.uint8)
    fixed = _fixed(path - low)
    joined = seen[:-1] & seen[1:]
    for age in range(_SHADES):
        # From the oldest to the newest, so that a path that crosses itself is as bright as its latest part.
        span = range(age * len(joined) // _SHADES, (age + 1) * len(joined) // _SHADES)
        pieces = [fixed[k : k + 2] for k in span if joined[k]]
        if pieces:
            level = 30 + 200 * (age + 1) // _SHADES
            cv2.polylines(strength, pieces, False, level, width + 1, cv2.LINE_AA, _BITS)
    share = strength.astype(np.float32) / 255
    tint = np.full_like(part, color)
    part[:] = cv2.blendLinear(tint, part, share, 1 - share)


def _fixed(points: Array) -> NDArray[np.int32]:
    """(k, 2) pixels in OpenCV's fixed-point numbers; what is far outside is clipped, or it would overflow."""
    return np.rint(np.clip(points, -20000, 20000) * 2**_BITS).astype(np.int32)
