"""What the views of a scenario cannot tell: how far off a point may be when every view says done.

Two views that look from nearly the same place agree on a point that is far away from its goal along
their line of sight (thesis figure 3.2). Their angle decides how much of that one pixel hides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vita.constraints import constraint_of
from vita.servo.insight import Finding
from vita.sim.twin import Mark, Twin
from vita.types import Array

AMBIGUOUS_MM = 5.0
"""Views that hide so much behind one pixel cannot decide whether the task is done [mm/px]."""
SAME_POINT_M = 0.01
"""Marks of two views that are nearer on their body are taken for views of one point."""
FAINT = 1e-6
"""Directions of the exact Jacobian that are weaker than the strongest by so much are not held at all."""
SLIDE = 1e-4
"""A point that a free motion moves by more is not held [m/rad]."""


@dataclass(frozen=True)
class PointView:
    """How well one point of the hand is placed when all views say done."""

    constraint: str
    cameras: tuple[str, ...]
    worst_mm: float
    """What an error of one pixel (one deviation, in every row) hides in the worst direction [mm]; infinite
    when the point can slide."""
    best_mm: float
    along: str
    """The camera whose line of sight is nearest to the worst direction."""
    angle_deg: float
    """Largest angle between two lines of sight to the point; 0 for one view."""


def point_views(twin: Twin, q: Array) -> tuple[PointView, ...]:
    """Every moving point that is tied to a point, with the arm at `q` (n,) [rad]."""
    used = twin.scenario.servo.joints
    columns = list(range(q.size) if used is None else used)
    jacobian = twin.joint_jacobian(q)[:, columns]
    _, values, axes = np.linalg.svd(jacobian)
    held = int(np.count_nonzero(values > FAINT * values[0])) if values.size and values[0] > 0 else 0
    # Covariance of the joints, for errors of one pixel in every row, in the directions that are held.
    spread = axes[:held].T @ np.diag(values[:held] ** -2.0) @ axes[:held]
    return tuple(_view(twin, q, group, spread, axes[held:], columns) for group in _groups(twin))


def _groups(twin: Twin) -> list[list[tuple[str, Mark]]]:
    """Constraint and mark of the moving points, those of one point of the hand together."""
    groups: list[list[tuple[str, Mark]]] = []
    for term in twin.terms:
        mark = twin.marks[term.points[0]]
        if constraint_of(term.kind).kind != "point_to_point" or not mark.body:
            continue
        for group in groups:
            other = group[0][1]
            if other.body == mark.body and np.linalg.norm(other.points[0] - mark.points[0]) < SAME_POINT_M:
                group.append((term.name, mark))
                break
        else:
            groups.append([(term.name, mark)])
    return groups


def _view(
    twin: Twin, q: Array, group: list[tuple[str, Mark]], spread: Array, free: Array, columns: list[int]
) -> PointView:
    mark = group[0][1]
    bodies = twin.bodies(q)
    # With a camera on the hand it is the hand that comes to rest somewhere.
    body = mark.body if twin.on_hand(mark.body) else "tool"
    local = mark.points[0] if twin.on_hand(mark.body) else np.zeros(3)
    step = 1e-6 * np.eye(q.size)[columns]
    moves = (_place(twin.bodies(q + step), body, local) - _place(twin.bodies(q - step), body, local)).T / 2e-6
    cameras = tuple(dict.fromkeys(m.camera for _, m in group))
    target = twin.world_points(mark.tracker, bodies)[0]
    sights = {c: _unit(target - bodies[f"camera:{c}"][:3, 3]) for c in cameras}
    slide = np.linalg.svd(moves @ free.T) if free.size else None
    if slide is not None and slide[1].size and slide[1][0] > SLIDE:
        direction, worst, best = slide[0][:, 0], float("inf"), float("inf")
    else:
        sizes, turned = np.linalg.eigh(moves @ spread @ moves.T)
        direction = turned[:, -1]
        worst, best = 1e3 * float(np.sqrt(max(sizes[-1], 0.0))), 1e3 * float(np.sqrt(max(sizes[0], 0.0)))
    along = max(cameras, key=lambda c: abs(float(sights[c] @ direction)))
    lines = list(sights.values())
    cosines = [float(a @ b) for i, a in enumerate(lines) for b in lines[:i]]
    angle = float(np.degrees(np.arccos(np.clip(min(cosines), -1.0, 1.0)))) if cosines else 0.0
    return PointView(group[0][0], cameras, worst, best, along, min(angle, 180.0 - angle))


def _place(bodies: dict[str, Array], body: str, local: Array) -> Array:
    """(..., 3) a body's point in the world [m]."""
    return bodies[body][..., :3, :3] @ local + bodies[body][..., :3, 3]


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)


def view_findings(views: tuple[PointView, ...]) -> tuple[Finding, ...]:
    """One sentence for the point that is seen worst."""
    if not views:
        return ()
    view = max(views, key=lambda v: v.worst_mm)
    names = " and ".join(repr(camera) for camera in view.cameras)
    say = "says" if len(view.cameras) == 1 else "say"
    if np.isinf(view.worst_mm):
        text = (
            f"The point of {view.constraint!r} can slide along the line of sight of {view.along!r} while "
            f"{names} {say} done. "
            "Draw it in a view at a right angle to that."
        )
        return (Finding("warning", "ambiguous", text),)
    if view.worst_mm >= AMBIGUOUS_MM:
        under = f", which see it under {view.angle_deg:.0f} degrees," if len(view.cameras) > 1 else ""
        text = (
            f"Not decidable to better than {view.worst_mm:.0f} mm: so far may the point of "
            f"{view.constraint!r} be off along the line of sight of {view.along!r} when {names}{under} "
            f"{say} done to a pixel. Add a view at a right angle."
        )
        return (Finding("warning", "ambiguous", text),)
    text = f"An error of 1 px is up to {view.worst_mm:.1f} mm at the point of {view.constraint!r}."
    return (Finding("good", "accuracy", text),)
