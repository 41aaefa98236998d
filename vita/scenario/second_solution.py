"""Searches a scenario for other poses of the hand at which the task would count as done.

A rank test cannot find them: the wrench of thesis eq. 3.5 has rank 6 at the intended pose and at the
one that is turned by 180 degrees. The search therefore lets the hand start from many orientations in
a kinematic twin of the scene and solves the task from each. It is simulation-only advice; the servo
never hears of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from vita.scenario.schema import Scenario
from vita.sim.many_fits import fit, jacobian
from vita.sim.twin import Twin
from vita.types import Array, frozen

LENGTH = 0.1
"""A turn of one radian is compared with a shift of this length [m]."""
SEEDS = 96
"""Orientations to start from, spread over all rotations."""
ARM_SEEDS = 48
"""Joint positions from which the arm is asked to reach a pose."""
APART_DEG, APART_MM = 5.0, 5.0
"""Poses that differ by less are one and the same solution."""
CONDITION = 1e5
"""Directions of the exact Jacobian that are weaker than the strongest by more are not held."""
MOST_RESIDUAL_PX = 5.0
"""A task whose best fit is worse than this cannot be met, and other solutions do not matter."""


@dataclass(frozen=True)
class Solution:
    """A pose of the hand at which the task counts as done."""

    T_world_tool: Array
    """(4, 4)."""
    residual_px: float
    """Largest error component there [px]."""
    rank: int
    """How many of the hand's (or, for a small arm, the joints') motions the task holds there."""
    q: Array | None
    """(n,) joints that bring the hand there [rad]; None when the arm cannot reach it."""
    angle_deg: float = 0.0
    """How far it is turned from the first solution [deg]."""
    axis: Array = field(default_factory=lambda: frozen(np.zeros(3)))
    """(3,) unit axis of that turn in the tool's frame."""
    shift_mm: float = 0.0
    """How far the middle of the task's features is from where the first solution has it [mm]."""
    unseen: tuple[str, ...] = ()
    """Trackers whose feature would be hidden, or outside the image, there."""

    @property
    def reachable(self) -> bool:
        return self.q is not None


@dataclass(frozen=True)
class Search:
    """What the search has found."""

    first: Solution | None
    """The one that is nearest to the start; None when there is nothing to solve."""
    others: tuple[Solution, ...] = ()
    skipped: str = ""
    """Why no others were looked for, in words; empty when they were."""
    farthest: str = ""
    """The tracker that is seen farthest apart in the first two solutions."""
    farthest_px: float = 0.0


def find_second_solutions(scenario: Scenario | Twin, *, seeds: int = SEEDS, seed: int = 0) -> Search:
    """The pose at which the task is met from the start, and all others that the search comes upon."""
    twin = scenario if isinstance(scenario, Twin) else Twin(scenario)
    if not twin.terms:
        return Search(None, skipped="there are no constraints")
    random = np.random.default_rng(seed)
    problem: _Problem = _HandProblem(twin) if _hand_is_enough(twin) else _JointProblem(twin)
    states, values = problem.solve(problem.starts(seeds, random))
    worst = np.abs(values).max(axis=-1)
    start = 0 if worst[0] <= MOST_RESIDUAL_PX else int(np.argmin(worst))
    first = problem.solution(states[start], float(worst[start]), random)
    if worst[start] > MOST_RESIDUAL_PX:
        return Search(first, skipped=f"the task cannot be met: {worst[start]:.1f} px would be left at best")
    if first.rank < problem.size:
        left = problem.size - first.rank
        what = f"{left} motion{'s' if left > 1 else ''} of the {problem.what}"
        return Search(first, skipped=f"the task leaves {what} free, so that its end depends on the start")
    allowed = max(twin.scenario.servo.tolerance_px, 1.5 * float(worst[start]))
    others: list[Solution] = []
    for i in np.argsort(worst, kind="stable"):
        if worst[i] > allowed:
            break
        pose = problem.tool(states[i])
        known = [first.T_world_tool, *(other.T_world_tool for other in others)]
        if all(_apart(twin, problem.middle, pose, other) for other in known):
            others.append(problem.solution(states[i], float(worst[i]), random, first))
    others.sort(key=lambda s: (not s.reachable, len(s.unseen), s.angle_deg))
    if not others:
        return Search(first)
    name, px = _farthest(twin, problem, first, others[0])
    return Search(first, tuple(others), farthest=name, farthest_px=px)


def _hand_is_enough(twin: Twin) -> bool:
    """Whether the pose of the hand alone decides what is seen, and the arm can take six motions."""
    bodies = {mark.body for mark in twin.marks.values() if mark.body}
    bodies |= {f"camera:{mark.camera}" for mark in twin.marks.values()}
    used = twin.scenario.servo.joints
    count = len(twin.joints) if used is None else len(used)
    return count >= 6 and not any(twin.on_arm(body) for body in bodies)


class _Problem:
    """The task over some set of poses: of the hand alone, or of the arm."""

    what: str
    size: int

    def __init__(self, twin: Twin) -> None:
        self.twin = twin
        used = twin.scenario.servo.joints
        self.used = list(range(len(twin.joints)) if used is None else used)
        self.lower = np.array([joint.lower for joint in twin.joints])
        self.upper = np.array([joint.upper for joint in twin.joints])
        self.middle = self._middle()

    def _middle(self) -> Array:
        """(3,) middle of the features that move against their camera, in the tool's frame [m]; for a
        camera on the hand that is where it looks."""
        bodies = self.twin.bodies(self.twin.q0)
        T = bodies["tool"]
        points = [
            self.twin.world_points(mark.tracker, bodies)
            for mark in self.twin.marks.values()
            if mark.body and self.twin.on_hand(mark.body) != self.twin.on_hand(f"camera:{mark.camera}")
        ]
        if not points:
            return np.zeros(3)
        return (np.concatenate(points).mean(axis=0) - T[:3, 3]) @ T[:3, :3]

    def starts(self, count: int, random: np.random.Generator) -> Array:
        raise NotImplementedError

    def bodies(self, state: Array) -> dict[str, Array]:
        raise NotImplementedError

    def retract(self, state: Array, step: Array) -> Array:
        raise NotImplementedError

    def tool(self, state: Array) -> Array:
        return self.bodies(state)["tool"]

    def joints(self, state: Array, random: np.random.Generator) -> Array | None:
        raise NotImplementedError

    def error(self, state: Array) -> Array:
        return self.twin.error(self.bodies(state)) * self.twin.weights

    def solve(self, starts: Array) -> tuple[Array, Array]:
        """The states at the end and their errors without weights (runs, m) [px]."""
        states, _ = fit(self.error, self.retract, starts, self.size)
        return states, self.twin.error(self.bodies(states))

    def rank(self, state: Array) -> int:
        J = jacobian(self.error, self.retract, state[None], self.size)[0]
        values = np.linalg.svd(J, compute_uv=False)
        return int(np.count_nonzero(values > values[0] / CONDITION)) if values.size and values[0] > 0 else 0

    def solution(
        self, state: Array, residual: float, random: np.random.Generator, first: Solution | None = None
    ) -> Solution:
        T, q = self.tool(state), self.joints(state, random)
        bodies = self.bodies(state) if q is None else self.twin.bodies(q)
        angle, axis, shift = 0.0, np.zeros(3), 0.0
        if first is not None:
            angle, axis, shift = difference(first.T_world_tool, T, self.middle)
        return Solution(
            T_world_tool=frozen(T),
            residual_px=residual,
            rank=self.rank(state),
            q=None if q is None else frozen(q),
            angle_deg=angle,
            axis=frozen(axis),
            shift_mm=shift,
            unseen=unseen(self.twin, bodies),
        )

    def reach(self, target: Array, random: np.random.Generator) -> Array | None:
        """(n,) joints inside the limits that bring the tool to `target` (4, 4), the nearest to the start
        that are found; None for none."""
        twin, span = self.twin, self.upper - self.lower
        starts = np.tile(twin.q0, (ARM_SEEDS, 1))
        rolled = self.lower + span * random.random(starts.shape)
        starts[1:, self.used] = rolled[1:, self.used]

        def apart(q: Array) -> Array:
            """(..., 6) millimetres, and turns on an arm of LENGTH."""
            T = twin.bodies(q)["tool"]
            turn = np.swapaxes(T[..., :3, :3], -1, -2) @ target[:3, :3]
            vector = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec().reshape(*T.shape[:-2], 3)
            return 1e3 * np.concatenate([T[..., :3, 3] - target[:3, 3], LENGTH * vector], axis=-1)

        found, left = fit(apart, self._turned, starts, len(self.used))
        good = found[np.abs(left).max(axis=-1) < 0.1]
        if not len(good):
            return None
        return good[int(np.argmin(np.abs(good - twin.q0).max(axis=-1)))]

    def _turned(self, q: Array, step: Array) -> Array:
        q = np.broadcast_to(q, np.broadcast_shapes(q.shape, (*step.shape[:-1], q.shape[-1]))).copy()
        q[..., self.used] += step
        return np.clip(q, self.lower, self.upper)


class _HandProblem(_Problem):
    """The hand alone, torn off the arm: six motions about the middle of the features."""

    what, size = "hand", 6

    def starts(self, count: int, random: np.random.Generator) -> Array:
        """The hand as it starts, then turned on the spot in every way."""
        T = self.twin.bodies(self.twin.q0)["tool"]
        turns = Rotation.from_matrix(spread_rotations(count, random)).as_rotvec()
        steps = np.concatenate([turns, np.zeros_like(turns)], axis=-1)
        return np.concatenate([T[None], self.retract(np.broadcast_to(T, (count, 4, 4)), steps)])

    def bodies(self, state: Array) -> dict[str, Array]:
        return self.twin.bodies_of_hand(state)

    def retract(self, state: Array, step: Array) -> Array:
        """Turned by the vector step[:3] [rad] about the features' middle, in the tool's frame, and shifted
        by step[3:] in units of LENGTH."""
        lead = np.broadcast_shapes(state.shape[:-2], step.shape[:-1])
        turn = Rotation.from_rotvec(step[..., :3].reshape(-1, 3)).as_matrix().reshape(*step.shape[:-1], 3, 3)
        motion = np.broadcast_to(np.eye(4), (*lead, 4, 4)).copy()
        motion[..., :3, :3] = turn
        motion[..., :3, 3] = self.middle - turn @ self.middle + LENGTH * step[..., 3:]
        return state @ motion

    def joints(self, state: Array, random: np.random.Generator) -> Array | None:
        return self.reach(state, random)


class _JointProblem(_Problem):
    """The arm's joints in use, inside their limits: for arms with fewer than six, and for features or
    cameras on its links."""

    what = "joints"

    def __init__(self, twin: Twin) -> None:
        super().__init__(twin)
        self.size = len(self.used)

    def starts(self, count: int, random: np.random.Generator) -> Array:
        q = np.tile(self.twin.q0, (count + 1, 1))
        rolled = self.lower + (self.upper - self.lower) * random.random(q.shape)
        q[1:, self.used] = rolled[1:, self.used]
        return q

    def bodies(self, state: Array) -> dict[str, Array]:
        return self.twin.bodies(state)

    def retract(self, state: Array, step: Array) -> Array:
        return self._turned(state, step)

    def joints(self, state: Array, random: np.random.Generator) -> Array | None:
        del random
        return state


def spread_rotations(count: int, random: np.random.Generator) -> Array:
    """(count, 3, 3) rotations, spread more evenly than at random: of many drawn, each next one is the
    one that is farthest from those that were chosen."""
    pool = Rotation.random(20 * count, rng=random).as_quat()
    chosen = [np.array([0.0, 0.0, 0.0, 1.0])]
    nearest = np.abs(pool @ chosen[0])
    for _ in range(count):
        chosen.append(pool[int(np.argmin(nearest))])
        nearest = np.maximum(nearest, np.abs(pool @ chosen[-1]))
    return Rotation.from_quat(np.array(chosen[1:])).as_matrix()


def difference(first: Array, second: Array, middle: Array) -> tuple[float, Array, float]:
    """Angle [deg] and axis (3,) in the tool's frame of the turn between two poses (4, 4), and the distance
    between where they put `middle` (3,) of the tool's frame [mm]."""
    turn = Rotation.from_matrix(first[:3, :3].T @ second[:3, :3]).as_rotvec()
    angle = float(np.linalg.norm(turn))
    axis = turn / angle if angle > 1e-9 else np.zeros(3)
    if axis.size and axis[int(np.argmax(np.abs(axis)))] < 0 and np.pi - angle < 1e-3:
        axis = -axis  # Half a turn either way is the same.
    gap = (second - first)[:3, :3] @ middle + (second - first)[:3, 3]
    return float(np.degrees(angle)), axis, 1e3 * float(np.linalg.norm(gap))


def _apart(twin: Twin, middle: Array, a: Array, b: Array) -> bool:
    del twin
    angle, _, shift = difference(a, b, middle)
    return angle > APART_DEG or shift > APART_MM


def unseen(twin: Twin, bodies: dict[str, Array]) -> tuple[str, ...]:
    """The image trackers whose feature is hidden behind something, or outside the image."""
    kinds = {spec.name: spec.kind for spec in twin.scenario.tracker}
    names, pixels = [], twin.pixels(bodies)
    for name, mark in twin.marks.items():
        if not mark.body or kinds[name] == "projected":
            continue
        width, height = twin.lenses[mark.camera].size
        inside = (pixels[name] >= 0) & (pixels[name] <= (width - 1, height - 1))
        eye = bodies[f"camera:{mark.camera}"][:3, 3]
        places = twin.world_points(name, bodies)
        if not inside.all() or any(_hidden(twin, bodies, eye, point) for point in places):
            names.append(name)
    return tuple(names)


def _hidden(twin: Twin, bodies: dict[str, Array], eye: Array, point: Array, slack_m: float = 0.003) -> bool:
    """Whether something stands before `point` (3,), more than `slack_m` nearer to `eye`."""
    distance = float(np.linalg.norm(point - eye))
    met = twin.surface.first(eye, point - eye, bodies)
    return met is not None and met[1] * distance < distance - slack_m


def _farthest(twin: Twin, problem: _Problem, first: Solution, other: Solution) -> tuple[str, float]:
    """The tracker that two solutions show farthest apart, and how far [px]."""
    places = []
    for solution in (first, other):
        if isinstance(problem, _HandProblem) or solution.q is None:
            places.append(twin.pixels(twin.bodies_of_hand(solution.T_world_tool)))
        else:
            places.append(twin.pixels(twin.bodies(solution.q)))
    used = {name for term in twin.terms for name in term.points}
    gaps = {
        name: float(np.linalg.norm(places[0][name] - places[1][name], axis=-1).max())
        for name, mark in twin.marks.items()
        if name in used and mark.body
    }
    name = max(gaps, key=lambda key: np.nan_to_num(gaps[key]))
    return name, gaps[name]
