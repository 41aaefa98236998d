"""Each virtual force against closed forms and finite differences."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from tests.impedance_arms import ARMS, READY
from vita.errors import BadInput
from vita.impedance.clearance import Obstacles, between_segments, to_surface
from vita.impedance.config import ImpedanceConfig
from vita.impedance.inverse import damped_inverse, ranges
from vita.impedance.mass import Aim, Mass, Pull, advance, aim_energy, kinetic, outwards, steer
from vita.impedance.repulsion import Wall, cap, check_balance, contact_push
from vita.impedance.singularity import ElbowReach
from vita.impedance.spring import pull_energy, pull_share
from vita.impedance.surroundings import Skeleton
from vita.impedance.turning import between, matrix_of, quaternion_of, times, turned
from vita.impedance.view import Surface
from vita.types import Array

CONFIG = ImpedanceConfig()
positive = st.floats(0.05, 50.0)


def wall(gain: float = 12.0, steepness: float = 20.0, onset: float = 0.2, top: float = 3.0) -> Wall:
    return Wall("people", onset, (1.0, 0, 0), gain, steepness, onset, 0.0, top, np.zeros(1))


def random_q(arm, rng: np.random.Generator) -> Array:
    lower, upper = ranges(arm)
    return rng.uniform(lower, upper)


@given(positive, positive, st.floats(0.01, 3.0))
def test_the_spring_is_the_slope_of_its_energy_and_never_pulls_harder_than_it_may(
    stiffness: float, most: float, length: float
) -> None:
    eps = 1e-6
    slope = (
        pull_energy(length + eps, stiffness, most) - pull_energy(length - eps, stiffness, most)
    ) / (2 * eps)
    force = pull_share(length, stiffness, most) * length
    assert force == pytest.approx(slope, rel=1e-5, abs=1e-5 * (stiffness + most))
    assert force <= most * (1 + 1e-12)


@given(positive, st.floats(1.0, 60.0), st.floats(0.02, 0.5), st.floats(0.5, 6.0), st.floats(-0.1, 0.6))
def test_a_wall_pushes_by_the_slope_of_its_energy(
    gain: float, steepness: float, onset: float, top: float, distance: float
) -> None:
    w, eps = wall(gain, steepness, onset, top), 1e-7
    push, stiffness = w.push(distance)
    slope = -(w.energy(distance + eps) - w.energy(distance - eps)) / (2 * eps)
    assert push == pytest.approx(slope, rel=1e-4, abs=1e-4 * gain)
    assume(abs(steepness * (onset - distance) - top) > 1e-3 and abs(distance - onset) > 1e-5)
    bend = -(w.push(distance + eps)[0] - w.push(distance - eps)[0]) / (2 * eps)
    assert stiffness == pytest.approx(bend, rel=1e-4, abs=1e-3 * gain)


def test_the_push_is_the_report_s_within_the_onset_and_nothing_beyond() -> None:
    w = wall(top=10.0)
    assert w.push(0.2)[0] == 0.0 and w.push(0.3) == (0.0, 0.0)
    assert w.push(0.05)[0] == pytest.approx(12.0 * (np.exp(20.0 * 0.15) - 1.0))


def test_a_push_does_not_grow_beyond_contact() -> None:
    top = cap(12.0, 20.0, 0.1, pull_n=10.0)
    w = wall(12.0, 20.0, 0.1, top)
    assert w.push(-0.05)[0] == pytest.approx(w.push(0.0)[0]) == pytest.approx(contact_push(12, 20, 0.1))
    held = wall(12.0, 20.0, 0.35, cap(12.0, 20.0, 0.35, pull_n=10.0))
    assert held.push(0.0)[0] == pytest.approx(600.0)


def test_settings_with_which_the_table_could_be_touched_are_refused() -> None:
    check_balance(CONFIG)
    for change, culprit in (
        ({"push_n": 5.0}, "impedance.table_m"),
        ({"pull_n": 40.0}, "impedance.table_m"),
        ({"base_m": 0.02}, "impedance.base_m"),
        ({"people_m": 0.05}, "impedance.people_m"),
        ({"singular_n": 0.1}, "impedance.singular_deg"),
    ):
        with pytest.raises(BadInput) as refusal:
            check_balance(dataclasses.replace(CONFIG, **change))
        assert refusal.value.path == culprit
    check_balance(dataclasses.replace(CONFIG, table_m=0.0))


@pytest.mark.parametrize("name", ARMS)
def test_the_elbow_s_angle_is_zero_where_the_arm_is_longest(name: str) -> None:
    arm = ARMS[name]
    reach = ElbowReach.of(arm)
    assert reach is not None
    rng = np.random.default_rng(1)

    def stretch(q: Array) -> float:
        frames = arm.frames(q)
        return float(np.linalg.norm(frames[reach.wrist, :3, 3] - frames[reach.shoulder, :3, 3]))

    q = random_q(arm, rng)
    q[reach.elbow] = reach.straight
    assert reach.angle(q) == pytest.approx(0.0, abs=1e-9)
    assert stretch(q) == pytest.approx(reach.longest)
    for off in (-0.3, -0.01, 0.01, 0.3):
        q[reach.elbow] = reach.straight + off
        assert stretch(q) < reach.longest and reach.angle(q) == pytest.approx(abs(off))


@pytest.mark.parametrize("name", ARMS)
def test_the_singularity_pushes_along_the_gradient_of_the_elbow_s_angle(name: str) -> None:
    arm, rng = ARMS[name], np.random.default_rng(2)
    reach = ElbowReach.of(arm)
    assert reach is not None
    for _ in range(20):
        q = random_q(arm, rng)
        q[reach.elbow] = reach.straight + rng.choice([-1, 1]) * rng.uniform(0.1, 1.0)
        frames, dq = arm.frames(q), rng.normal(size=arm.n)
        J, eps = arm.jacobian(frames), 1e-6
        if arm.n == 6 and np.linalg.svd(J)[1][-1] < 0.03:
            continue
        bending = reach.bending(frames, reach.angle(q), damped_inverse(J, 1e-3), J[3:])
        slope = bending @ J @ dq
        change = (reach.angle(q + eps * dq) - reach.angle(q - eps * dq)) / (2 * eps)
        assert slope == pytest.approx(change, rel=1e-5, abs=1e-6)
        towards = frames[reach.wrist, :3, 3] - frames[reach.shoulder, :3, 3]
        assert bending[:3] @ towards < 0


def test_the_push_of_the_singularity_at_the_onset_is_per_newton_of_its_gain() -> None:
    """One radian of bending there is `lever` metres of reach, so K times it is K newtons along the reach."""
    arm = ARMS["tx90"]
    reach = ElbowReach.of(arm)
    assert reach is not None
    onset = float(np.deg2rad(25.0))
    q = READY["tx90"].copy()
    q[reach.elbow] = reach.straight + onset
    frames = arm.frames(q)
    held = np.zeros((arm.n, 6))  # As if the shoulder stood on the base's axis.
    bending = reach.bending(frames, onset, held, arm.jacobian(frames)[3:])
    assert np.linalg.norm(bending[:3]) * reach.shortening(onset) == pytest.approx(1.0)


@settings(deadline=None, max_examples=20, derandomize=True)
@given(st.integers(0, 10**6), st.booleans(), st.booleans())
def test_segments_are_nearest_where_a_solver_finds_them(seed: int, point: bool, parallel: bool) -> None:
    rng = np.random.default_rng(seed)
    a0, a1, b0, b1 = rng.normal(size=(4, 3))
    if parallel:
        b1 = b0 + rng.normal() * (a1 - a0)
    if point:
        b1 = b0
    s, t = between_segments(a0[None], a1[None], b0[None], b1[None])
    ours = np.linalg.norm(a0 + s[0, 0] * (a1 - a0) - b0 - t[0, 0] * (b1 - b0))
    found = [
        minimize(
            lambda x: np.sum((a0 + x[0] * (a1 - a0) - b0 - x[1] * (b1 - b0)) ** 2), start,
            bounds=[(0, 1), (0, 1)], tol=1e-14,
        ).fun
        for start in ((0.5, 0.5), (0.0, 1.0))
    ]
    assert ours == pytest.approx(np.sqrt(min(found)), abs=1e-5)


@pytest.mark.parametrize("name", ARMS)
def test_every_wall_s_slope_is_the_gradient_of_its_distance(name: str) -> None:
    """d distance = slope . tool motion, for every joint motion of a six-joint arm; with spare joints for the
    shortest one that moves the tool so, and through `spare` for any."""
    arm, rng, eps = ARMS[name], np.random.default_rng(3), 1e-6
    turn, skeleton = arm.n >= 6, Skeleton(ARMS[name])
    config = dataclasses.replace(CONFIG, table_m=0.5, base_m=1.0, people_m=1.0)
    for _ in range(6):
        q = READY[name] + rng.uniform(-0.3, 0.3, arm.n)
        centre = arm.pose(q)[:3, 3] + rng.normal(size=3) * 0.2
        others = Obstacles(
            np.array([centre]), np.array([centre + rng.normal(size=3) * 0.1]), np.array([0.08]),
            np.zeros((1, 3)), np.zeros((1, 3)),
        )

        def walls(q: Array, others: Obstacles = others) -> tuple[Wall, ...]:
            frames = arm.frames(q)
            J = arm.jacobian(frames)
            inverse = damped_inverse(J if turn else J[:3], 0.01)
            return skeleton.look(frames, J, inverse, q, others, None, config).walls

        J = arm.jacobian(arm.frames(q))
        J = J if turn else J[:3]
        motions = rng.normal(size=(3, arm.n))
        for dq in (*motions, *(np.linalg.pinv(J) @ J @ motions.T).T):
            ahead, behind, here = walls(q + eps * dq), walls(q - eps * dq), walls(q)
            assert len(here) == len(ahead) == len(behind) >= 3
            for w, a, b in zip(here, ahead, behind, strict=True):
                change = (a.distance - b.distance) / (2 * eps)
                if w.kind != "singularity":
                    assert w.spare @ dq == pytest.approx(change, rel=1e-3, abs=1e-4)
                in_row_space = np.allclose(np.linalg.pinv(J) @ J @ dq, dq)
                if in_row_space:
                    assert np.dot(w.slope, J @ dq) == pytest.approx(change, rel=1e-3, abs=1e-4)


def test_an_approaching_obstacle_counts_as_nearer_and_a_leaving_one_does_not() -> None:
    arm, q = ARMS["tx90"], READY["tx90"]
    frames = arm.frames(q)
    J, centre = arm.jacobian(frames), frames[-1, :3, 3] + [0.0, 0.25, 0.0]

    def people(speed: float) -> float:
        velocity = np.array([[0.0, speed, 0.0]])
        others = Obstacles(centre[None], centre[None], np.array([0.1]), velocity, velocity)
        near = Skeleton(arm).look(frames, J, damped_inverse(J, 0.01), q, others, None, CONFIG)
        return near.distances["people"]

    assert people(-0.2) == pytest.approx(people(0.0) - 0.03)
    assert people(0.2) == people(0.0) == pytest.approx(0.10)


def test_a_seen_surface_pushes_along_its_normal() -> None:
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.uniform(-0.3, 0.3, (4000, 2)), np.zeros(4000)])
    tilted = np.tile([0.0, 0.0, 1.0], (4000, 1)) + rng.normal(0, 0.2, (4000, 3))
    surface = Surface(points, tilted / np.linalg.norm(tilted, axis=1)[:, None])
    starts, ends = np.array([[0.0, 0.0, 0.4]]), np.array([[0.05, 0.0, 0.15]])
    (gap,) = to_surface(starts, ends, np.array([0.05]), surface)
    assert gap.distance == pytest.approx(0.10, abs=0.002)
    assert np.degrees(np.arccos(gap.normal @ [0, 0, 1])) < 3.0
    assert gap.point == pytest.approx(ends[0], abs=0.01)
    assert to_surface(starts, ends, np.array([0.05]), Surface(np.zeros((0, 3)), np.zeros((0, 3)))) == []


def test_beside_a_seen_surface_the_straight_way_off_it_is_taken() -> None:
    surface = Surface(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))
    starts = np.array([[0.2, 0.0, -0.1]])
    (gap,) = to_surface(starts, starts + [0, 0, 0.1], np.array([0.05]), surface)
    assert gap.normal == pytest.approx([1.0, 0.0, 0.0])


@given(st.integers(0, 10**6))
def test_going_around_changes_the_direction_but_never_the_speed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    motion, aside = rng.normal(size=3).tolist(), rng.normal(size=3)
    aside /= np.linalg.norm(aside)
    before = np.array(motion)
    steer(motion, aside.tolist(), float(rng.uniform(0, 1e3)), 1.0, 0.001)
    assert np.linalg.norm(motion) == pytest.approx(np.linalg.norm(before), rel=1e-12)
    assert np.dot(motion, aside) >= before @ aside - 1e-12


@given(st.integers(0, 10**6), st.integers(1, 4), st.sampled_from([3, 6]))
def test_what_is_left_of_a_motion_leads_nearer_to_nothing_and_is_never_faster(
    seed: int, count: int, size: int
) -> None:
    rng = np.random.default_rng(seed)
    motion, slopes = rng.normal(size=size), rng.normal(size=(count, size))
    left = np.array(outwards(motion.tolist(), slopes.tolist(), 2.0))
    inertia = np.array([2.0] * 3 + [1.0] * (size - 3))
    assert (slopes @ left >= -1e-9).all()
    assert left @ (inertia * left) <= motion @ (inertia * motion) + 1e-12


@given(st.integers(0, 10**6), st.floats(1e-9, 3.1))
def test_turns_agree_with_scipy_s(seed: int, angle: float) -> None:
    rng = np.random.default_rng(seed)
    axis, other = rng.normal(size=(2, 3))
    vector = angle * axis / np.linalg.norm(axis)
    a, b = Rotation.from_rotvec(vector), Rotation.from_rotvec(other)
    qa, qb = turned(tuple(vector)), turned(tuple(other))
    assert matrix_of(times(qa, qb)) == pytest.approx((a * b).as_matrix(), abs=1e-12)
    assert np.array(between(times(qa, qb), qb)) == pytest.approx(vector, abs=1e-9)
    assert matrix_of(quaternion_of(a.as_matrix())) == pytest.approx(a.as_matrix(), abs=1e-12)


@settings(deadline=None, max_examples=60, derandomize=True)
@given(st.integers(0, 10**6), st.booleans())
def test_every_step_of_the_mass_loses_energy_at_any_gain(seed: int, turn: bool) -> None:
    """Semi-implicit steps are passive however stiff the walls and however weak the damper."""
    rng = np.random.default_rng(seed)

    def pick(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    pull = Pull(
        pick(0.1, 20), pick(5, 1000), pick(1, 400), pick(0.5, 100), pick(5, 1000), pick(1, 400), pick(1, 400),
        1e3, 1.0, turn,
    )
    size = 6 if turn else 3
    walls = []
    for _ in range(3):
        slope = rng.normal(size=size)
        slope /= np.linalg.norm(slope[:3])
        gain, steepness, onset = pick(1, 100), pick(5, 100), rng.uniform(0.05, 0.3)
        top = cap(gain, steepness, onset, pull.most)
        distance = rng.uniform(0.0, 1.2) * onset
        walls.append(
            Wall("people", distance, tuple(slope), gain, steepness, onset, -np.inf, top, np.zeros(1))
        )
    mass = Mass([0.0] * 3, (1.0, 0, 0, 0), (rng.normal(size=size) * 0.3).tolist(), [0.0] * size)
    still = [0.0, 0.0, 0.0]
    aim = Aim((rng.normal(size=3) * 0.1).tolist(), turned(tuple(rng.normal(size=3))), still, still)

    def energy() -> float:
        moved = np.array(mass.moved)
        stored = sum(w.energy(w.distance + float(np.dot(w.slope, moved))) for w in walls)
        return kinetic(mass, pull) + aim_energy(mass, aim, pull) + stored

    before = first = energy()
    for _ in range(60):
        advance(mass, aim, pull, walls, 0.001)
        after = energy()
        assert after <= before + 1e-9 * first
        before = after
