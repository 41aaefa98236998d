"""The calibrated baselines: interaction matrices against finite differences, and the closed loops of
thesis 2.3.1 and 2.3.2 (rows E2, E3, E4)."""

from __future__ import annotations

import numpy as np
import pytest

from vita.experiments.analytic import (
    HandWorld,
    Ibvs,
    Law,
    Pbvs,
    miscalibrated,
    run_law,
    tool_jacobian,
)
from vita.experiments.arms import ARMS
from vita.experiments.cameras import Cameras, Reading, look_at
from vita.experiments.interaction import (
    adjoint,
    inverse,
    moved,
    point_interaction,
    rotation_interaction,
    skew,
    theta_u_of,
    turned,
)
from vita.experiments.trial import World
from vita.types import Array

HOME = np.radians([0.0, -35.0, 0.0, 110.0, 0.0, 15.0, 0.0])
WAM = ARMS["wam7"]
H = 1e-6


def poses(seed: int, count: int) -> Array:
    """(count, 4, 4) rigid poses."""
    return moved(np.random.default_rng(seed).uniform(-1.5, 1.5, (count, 6)))


# ---- matrices ----------------------------------------------------------------------------------


def test_the_point_interaction_matrix_is_the_derivative_of_the_projection() -> None:
    """E4. The camera moves by a small twist; the point stays. Also shows that the last entry is -x."""
    random = np.random.default_rng(1)
    points = np.concatenate([random.uniform(-1, 1, (200, 2)), random.uniform(0.5, 3, (200, 1))], -1)

    def seen(twist: Array) -> Array:
        pose = inverse(moved(twist))
        local = points @ pose[:3, :3].T + pose[:3, 3]
        return local[:, :2] / local[:, 2:]

    columns = [(seen(H * unit) - seen(-H * unit)) / (2 * H) for unit in np.eye(6)]
    difference = np.stack(columns, -1)
    analytic = point_interaction(seen(np.zeros(6)), points[:, 2])
    relative = np.abs(difference - analytic).max((1, 2)) / np.abs(analytic).max((1, 2))
    assert relative.max() < 1e-6


def test_the_rotation_interaction_matrix_is_the_derivative_of_theta_u() -> None:
    """Thesis eq. 2.7 with the sign that goes with R from the goal's to the camera's axes."""
    random = np.random.default_rng(2)
    axis = random.standard_normal((300, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    for angles in (random.uniform(0.0, 3.0, (300, 1)), random.uniform(0.0, 3e-4, (300, 1))):
        rotation = turned(angles * axis)
        columns = [
            (theta_u_of(rotation @ turned(H * unit)) - theta_u_of(rotation @ turned(-H * unit))) / (2 * H)
            for unit in np.eye(3)
        ]
        analytic = rotation_interaction(angles * axis)
        assert np.abs(np.stack(columns, -1) - analytic).max() < 1e-6 * np.abs(analytic).max()


def test_turning_along_theta_u_shortens_it_alone() -> None:
    """L theta u = theta u, which makes eq. 2.8 the inverse of eq. 2.7."""
    theta_u = np.random.default_rng(3).uniform(-1.5, 1.5, (50, 3))
    assert np.allclose((rotation_interaction(theta_u) @ theta_u[..., None])[..., 0], theta_u, atol=1e-12)


def test_rotations_and_their_vectors_are_inverse_to_each_other() -> None:
    random = np.random.default_rng(4)
    theta_u = random.standard_normal((200, 3))
    theta_u *= random.uniform(0.0, 3.1, (200, 1)) / np.linalg.norm(theta_u, axis=1, keepdims=True)
    rotation = turned(theta_u)
    assert np.allclose(rotation @ rotation.swapaxes(-1, -2), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(rotation), 1.0)
    assert np.allclose(theta_u_of(rotation), theta_u, atol=1e-9)
    assert np.allclose(theta_u_of(turned(1e-9 * theta_u)), 1e-9 * theta_u, rtol=1e-6, atol=0)


def test_skew_is_the_cross_product() -> None:
    a, b = np.random.default_rng(5).standard_normal((2, 20, 3))
    assert np.allclose((skew(a) @ b[..., None])[..., 0], np.cross(a, b))


def test_a_constant_twist_is_many_small_ones() -> None:
    twist = np.random.default_rng(6).uniform(-1, 1, (20, 6))
    steps = np.linalg.matrix_power(moved(twist / 1024), 1024)
    assert np.allclose(moved(twist), steps, atol=1e-10)


def test_the_adjoint_takes_twists_from_one_frame_of_a_body_to_another() -> None:
    """Frame b is fixed to frame a; moving b by its twist moves a by the adjoint's."""
    a_b, twist = poses(7, 30), 1e-6 * np.random.default_rng(7).standard_normal((30, 6))
    in_a = (adjoint(a_b) @ twist[..., None])[..., 0]
    assert np.allclose(a_b @ moved(twist) @ inverse(a_b), moved(in_a), atol=1e-11)


@pytest.mark.parametrize("name", sorted(ARMS))
def test_the_tool_jacobian_is_the_derivative_of_the_pose(name: str) -> None:
    arm = ARMS[name]
    q = np.random.default_rng(8).uniform(-1.5, 1.5, (20, arm.n))
    columns = []
    for unit in np.eye(arm.n):
        step = inverse(arm.pose(q - H * unit)) @ arm.pose(q + H * unit)
        columns.append(np.concatenate([step[..., :3, 3], theta_u_of(step[..., :3, :3])], -1) / (2 * H))
    assert np.abs(np.stack(columns, -1) - tool_jacobian(arm, q)).max() < 1e-5


# ---- worlds ------------------------------------------------------------------------------------

LOCAL = np.array([[0.05, 0.0, 0.02], [-0.04, 0.05, 0.0], [-0.03, -0.05, 0.03], [0.02, 0.03, -0.05]])
"""(4, 3) points, not in one plane [m]."""


def eye_to_hand(runs: int, spread: float, seed: int, noise_px: float = 0.0) -> World:
    """The WAM before two cameras at right angles, 1 m away; starts up to `spread` [rad] off."""
    random = np.random.default_rng(seed)
    goal = np.tile(HOME, (runs, 1))
    target = WAM.pose(HOME)[:3, 3]
    cameras = Cameras(look_at(target + np.array([[1.0, 0.0, 0.2], [0.0, 1.0, 0.2]]), target), 1000.0)
    reading = Reading("gaussian", noise_px) if noise_px else Reading()
    return World(WAM, cameras, LOCAL, goal + random.uniform(-spread, spread, (runs, 7)), goal, reading)


def eye_in_hand(runs: int, spread: float, seed: int) -> HandWorld:
    """Two cameras on the tool, 10 cm apart, over points 0.4 m ahead."""
    random = np.random.default_rng(seed)
    goal, pose = np.tile(HOME, (runs, 1)), WAM.pose(HOME)
    mounted = np.tile(np.eye(4), (2, 1, 1))
    mounted[:, 0, 3] = 0.05, -0.05
    points = (LOCAL + np.array([0.0, 0.0, 0.4])) @ pose[:3, :3].T + pose[:3, 3]
    return HandWorld(
        WAM, Cameras(mounted, 800.0), points, goal + random.uniform(-spread, spread, (runs, 7)), goal
    )


WORLDS = {"to hand": eye_to_hand, "in hand": eye_in_hand}
both_worlds = pytest.mark.parametrize("world", sorted(WORLDS))


@both_worlds
def test_calibrated_image_jacobian_is_the_true_one(world: str) -> None:
    scene = WORLDS[world](20, 0.2, 9)
    law = Ibvs(scene.cameras)
    analytic, true = law.jacobian(scene.q0, scene.features(scene.q0), scene), scene.true_jacobian(scene.q0)
    assert np.abs(analytic - true).max() < 1e-6 * np.abs(true).max()


@both_worlds
def test_with_the_true_interaction_matrix_each_step_leaves_nine_tenths_of_the_error(world: str) -> None:
    """E2: lambda = 0.1, ratio 0.90 +- 0.02 of the error's norm in every step."""
    scene = WORLDS[world](30, 0.1, 10)
    law, q, sizes = Ibvs(scene.cameras, 0.1), scene.q0, []
    for _ in range(25):
        e = scene.features(q) - scene.features(scene.goal)
        sizes.append(np.linalg.norm(e, axis=-1))
        q = q + law(q, e, scene)
    ratio = np.array(sizes[1:]) / np.array(sizes[:-1])
    assert np.abs(ratio - 0.90).max() < 0.02


@both_worlds
def test_position_based_servoing_goes_straight_and_turns_steadily(world: str) -> None:
    """E3: the moving frame (the first camera, or the watched tool) stays within 1 mm of the straight
    line to its goal, and its rotation angle only falls."""
    scene = WORLDS[world](6, 0.3, 11)
    law, q = Pbvs(scene.cameras, 0.02), scene.q0
    mount = inverse(scene.cameras.T_camera_world[0]) if world == "in hand" else np.eye(4)
    goal = WAM.pose(scene.goal) @ mount
    path, angles = [], []
    for _ in range(150):
        frame = WAM.pose(q) @ mount
        path.append(frame[..., :3, 3])
        turn = goal[..., :3, :3].swapaxes(-1, -2) @ frame[..., :3, :3]
        angles.append(np.linalg.norm(theta_u_of(turn), axis=-1))
        q = q + law(q, scene.features(q) - scene.features(scene.goal), scene)
    path, end = np.array(path), goal[..., :3, 3]
    line = end - path[0]
    length = np.linalg.norm(line, axis=-1)
    along = np.sum((path - path[0]) * line, -1) / length**2
    beside = np.linalg.norm(path - path[0] - along[..., None] * line, axis=-1)
    assert length.min() > 0.05 and length.max() > 0.15
    assert beside.max() < 1e-3
    assert (np.diff(angles, axis=0) < 0.0).all()
    assert np.linalg.norm(path[-1] - end, axis=-1).max() < 0.06 * length.max()


@both_worlds
@pytest.mark.parametrize("kind", [Ibvs, Pbvs])
def test_both_baselines_converge_when_calibrated_and_when_nearly_so(kind: type, world: str) -> None:
    scene = WORLDS[world](6, 0.3, 12)
    near = miscalibrated(scene.cameras, np.random.default_rng(12), focal_share=0.1, turn_deg=5.0)
    for cameras, left in ((scene.cameras, 1e-4), (near, 0.02)):
        runs = run_law(scene, kind(cameras, 0.25), steps=45, seed=1)
        assert not runs.diverged.any()
        assert (runs.error[:, -1] < left * runs.error[:, 0]).all()


def test_calibration_that_is_far_off_costs_image_based_runs() -> None:
    """Measured before: hand-eye poses 30 degrees off leave fewer than half of the runs."""
    scene = eye_to_hand(40, 0.35, 13, noise_px=0.2)
    off = miscalibrated(scene.cameras, np.random.default_rng(13), turn_deg=30.0)

    def good(law: Law) -> int:
        runs = run_law(scene, law, steps=60, seed=2)
        return int(np.count_nonzero(runs.error[:, -1] < 16 * 0.6))

    assert good(Ibvs(scene.cameras)) == 40
    assert good(Ibvs(off)) < 30


def test_miscalibration_is_as_large_as_it_says() -> None:
    cameras = eye_to_hand(1, 0.1, 14).cameras
    off = miscalibrated(cameras, np.random.default_rng(14), focal_share=-0.2, turn_deg=7.0)
    assert off.focal_px == pytest.approx(0.8 * cameras.focal_px)
    between = off.T_camera_world @ inverse(cameras.T_camera_world)
    angle = np.degrees(np.linalg.norm(theta_u_of(between[..., :3, :3]), axis=-1))
    assert np.allclose(angle, 7.0)
    centre = inverse(off.T_camera_world)[..., :3, 3]
    assert np.allclose(centre, inverse(cameras.T_camera_world)[..., :3, 3])


@both_worlds
def test_poses_are_fitted_to_pixels_exactly(world: str) -> None:
    scene = WORLDS[world](20, 0.2, 15)
    law = Pbvs(scene.cameras)
    # The fit begins at the arm's pose, here a wrong one.
    begin = scene.q0 + np.random.default_rng(15).uniform(-0.1, 0.1, scene.q0.shape)
    fitted = law.relative(begin, scene.features(scene.q0), scene)
    true = WAM.pose(scene.q0)
    assert np.abs(fitted - (inverse(true) if world == "in hand" else true)).max() < 1e-8
