"""Laws of the marker's pose: exact without noise, as good as predicted with it, and the right one of two."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import vita.vision.marker_pose
from vita.errors import BadInput
from vita.stereo.base import Lens, MarkerCorners, StereoRig, marker_square
from vita.stereo.projection import project
from vita.stereo.triangulate import triangulate
from vita.vision.marker_pose import marker_pose

SIZE = 0.06
FACING = Rotation.from_euler("x", 180, degrees=True)
"""A marker upright and square to the camera: its z looks back at the camera, its y is up."""


def rig_of() -> StereoRig:
    """Baseline 0.2 m, the right camera turned a little towards the left."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("y", 8, degrees=True).as_matrix()
    T[:3, 3] = -T[:3, :3] @ (0.2, 0.0, 0.0)
    return StereoRig(Lens(800, 800, 319.5, 239.5), Lens(780, 790, 325.0, 236.0), T)


RIG = rig_of()


def pose(xyz=(0.1, 0.0, 1.0), tilt_deg=(0.0, 0.0, 0.0)) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = (Rotation.from_rotvec(np.radians(tilt_deg)) * FACING).as_matrix()
    T[:3, 3] = xyz
    return T


def corners_of(T: np.ndarray, noise=0.0, rng=None, sides="lr", sigma=None) -> MarkerCorners:
    points = marker_square(SIZE) @ T[:3, :3].T + T[:3, 3]
    right = points @ RIG.T_right_left[:3, :3].T + RIG.T_right_left[:3, 3]
    pixels = [project(RIG.left, points), project(RIG.right, right)]
    if rng is not None:
        pixels = [p + rng.normal(0, noise, p.shape) for p in pixels]
    return MarkerCorners(
        pixels[0] if "l" in sides else None, pixels[1] if "r" in sides else None, sigma or noise or 0.2
    )


def apart(T: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(6,) translation [m] and small rotation about the left camera's axes [rad] from `truth` to `T`."""
    turn = Rotation.from_matrix(T[:3, :3] @ truth[:3, :3].T).as_rotvec()
    return np.concatenate([T[:3, 3] - truth[:3, 3], turn])


@given(
    tilt=st.tuples(st.floats(-55, 55), st.floats(-40, 40), st.floats(-180, 180)),
    at=st.tuples(st.floats(-0.2, 0.3), st.floats(-0.2, 0.2), st.floats(0.5, 1.6)),
    sides=st.sampled_from(["lr", "l", "r"]),
)
@settings(max_examples=120, deadline=None)
def test_without_noise_the_pose_comes_back_from_both_pictures_or_one(tilt, at, sides):
    """The last known pose is near, as in any sequence; a picture alone cannot tell the mirrored pose."""
    T = np.eye(4)
    T[:3, 3] = at
    turn = Rotation.from_euler("xy", tilt[:2], degrees=True) * FACING
    T[:3, :3] = (turn * Rotation.from_euler("z", tilt[2], degrees=True)).as_matrix()
    sight = marker_pose(RIG, corners_of(T, sides=sides), SIZE, near=T)
    assert np.abs(apart(sight.T_left_marker, T)).max() < 1e-6 and sight.rms_px < 1e-6


@pytest.mark.parametrize("sides", ["lr", "l", "r"])
def test_the_covariance_is_that_of_many_trials(sides):
    """Each predicted standard deviation within 15 % (of a variance within 30 %), and chi-square of 6."""
    rng, T, count = np.random.default_rng(1), pose(tilt_deg=(30, -25, 10)), 300
    off, predicted, whitened = [], [], []
    for _ in range(count):
        sight = marker_pose(RIG, corners_of(T, 0.1, rng, sides), SIZE, near=T)
        error = apart(sight.T_left_marker, T)
        off.append(error)
        predicted.append(np.diag(sight.covariance))
        whitened.append(error @ np.linalg.solve(sight.covariance, error))
    measured, told = np.square(off).mean(axis=0), np.mean(predicted, axis=0)
    assert np.abs(measured / told - 1).max() < 0.3
    assert np.mean(whitened) == pytest.approx(6.0, abs=5 * np.sqrt(12 / count))


def test_the_covariance_scales_with_the_noise_it_is_told():
    T = pose(tilt_deg=(20, 10, 0))
    small, large = (marker_pose(RIG, corners_of(T, sigma=s), SIZE).covariance for s in (0.1, 0.3))
    assert np.allclose(large, 9 * small)
    assert np.allclose(small, small.T) and np.linalg.eigvalsh(small).min() > 0


def test_it_is_better_than_fitting_the_square_to_four_triangulated_corners():
    """All eight pixels know the square's shape: depth as good, and the tilt at least twice as good."""
    rng, fitted, fused = np.random.default_rng(2), [], []
    for _ in range(120):
        T = pose(tilt_deg=rng.normal(0, 20, 3))
        corners = corners_of(T, 0.1, rng)
        fused.append(apart(marker_pose(RIG, corners, SIZE).T_left_marker, T))
        assert corners.left is not None and corners.right is not None
        points = triangulate(RIG, corners.left, corners.right)
        other = np.eye(4)
        other[:3, :3] = Rotation.align_vectors(points - points.mean(axis=0), marker_square(SIZE))[
            0
        ].as_matrix()
        other[:3, 3] = points.mean(axis=0)
        fitted.append(apart(other, T))
    fused, fitted = (np.sqrt(np.square(e).mean(axis=0)) for e in (fused, fitted))
    assert fused[2] < 1.02 * fitted[2]
    assert (2 * fused[3:5] < fitted[3:5]).all() and fused[5] < fitted[5]


def test_two_pictures_tell_the_mirrored_pose_apart_where_one_cannot():
    """A small marker far away under noise: alone each picture is often wrong, together they never are."""
    rng, wrong = np.random.default_rng(3), {"l": 0, "r": 0, "lr": 0}
    for _ in range(60):
        T = pose((0.1, 0.0, 1.5), rng.normal(0, 12, 3))
        for sides in wrong:
            sight = marker_pose(RIG, corners_of(T, 0.15, rng, sides), SIZE)
            tilt = np.degrees(np.linalg.norm(apart(sight.T_left_marker, T)[3:]))
            wrong[sides] += tilt > 20
    assert wrong["lr"] == 0 and wrong["l"] + wrong["r"] > 5


def test_the_last_pose_decides_where_the_picture_cannot():
    rng, wrong = np.random.default_rng(4), 0
    for _ in range(60):
        T = pose((0.1, 0.0, 1.5), rng.normal(0, 12, 3))
        near = pose(T[:3, 3])
        near[:3, :3] = Rotation.from_rotvec(rng.normal(0, 0.03, 3)).as_matrix() @ T[:3, :3]
        sight = marker_pose(RIG, corners_of(T, 0.15, rng, "l"), SIZE, near=near)
        wrong += np.degrees(np.linalg.norm(apart(sight.T_left_marker, T)[3:])) > 20
    assert wrong == 0


def test_the_last_pose_does_not_overrule_what_is_clearly_seen():
    """Told that it is the mirrored pose, a large tilted marker is still seen as it is."""
    T = pose((0.0, 0.0, 0.6), (40, 0, 0))
    mirrored = pose((0.0, 0.0, 0.6), (-40, 0, 0))
    sight = marker_pose(RIG, corners_of(T, sides="l", sigma=0.1), SIZE, near=mirrored)
    assert np.abs(apart(sight.T_left_marker, T)).max() < 1e-6


@pytest.mark.parametrize("sides", ["lr", "l"])
def test_a_last_pose_that_fits_saves_the_search_and_changes_nothing(sides, monkeypatch):
    """From a last pose 1 cm and 4 degrees away the same comes out as from the pictures alone."""
    rng, cases = np.random.default_rng(5), []
    for _ in range(30):
        T = pose((0.1, 0.0, 0.9), (30, *rng.normal(0, 15, 2)))
        near = pose(T[:3, 3] + rng.normal(0, 0.006, 3))
        near[:3, :3] = Rotation.from_rotvec(rng.normal(0, 0.04, 3)).as_matrix() @ T[:3, :3]
        corners = corners_of(T, 0.05, rng, sides, sigma=0.1)
        cases.append((corners, near, marker_pose(RIG, corners, SIZE)))
    monkeypatch.setattr(vita.vision.marker_pose, "_start", lambda *_: pytest.fail("searched"))
    for corners, near, alone in cases:
        sight = marker_pose(RIG, corners, SIZE, near=near)
        sd = np.sqrt(np.diag(alone.covariance))
        assert (np.abs(apart(sight.T_left_marker, alone.T_left_marker)) < 0.002 * sd).all()
        assert np.allclose(np.sqrt(np.diag(sight.covariance)), sd, rtol=1e-3)


def test_a_fit_that_is_turned_far_from_the_last_pose_is_compared_with_the_others(monkeypatch):
    searches, start = [], vita.vision.marker_pose._start
    monkeypatch.setattr(vita.vision.marker_pose, "_start", lambda *a: searches.append(a) or start(*a))
    for tilt, count in (((30, -20, 0), 0), ((30, -20, 20), 1)):
        marker_pose(RIG, corners_of(pose(tilt_deg=tilt)), SIZE, near=pose(tilt_deg=(30, -20, 0)))
        assert len(searches) == count


def test_a_last_pose_that_is_nonsense_is_not_followed():
    """Behind the camera, the other way round or no number at all: what is seen is what comes out."""
    T = pose(tilt_deg=(30, -20, 0))
    behind, backwards = pose((0.1, 0.0, -1.0)), T @ np.diag([1.0, -1, -1, 1])
    for near in (behind, backwards, np.full((4, 4), np.nan)):
        sight = marker_pose(RIG, corners_of(T), SIZE, near=near)
        assert np.abs(apart(sight.T_left_marker, T)).max() < 1e-6


def test_corners_that_belong_to_no_square_show_in_what_is_left():
    """The consumer's gate: another marker in the right picture, 10 px off, cannot look like a good fit."""
    corners = corners_of(pose())
    assert corners.right is not None
    off = MarkerCorners(corners.left, corners.right + (0.0, 10.0), 0.1)
    assert marker_pose(RIG, corners, SIZE).rms_px < 1e-6
    assert marker_pose(RIG, off, SIZE).rms_px > 2.0


@pytest.mark.parametrize(
    ("corners", "size", "why"),
    [
        (MarkerCorners(None, None), SIZE, "neither camera sees"),
        (corners_of(pose()), 0.0, "above 0 m"),
        (corners_of(pose(), sigma=-1.0), SIZE, "above 0 px"),
        (MarkerCorners(np.full((4, 2), np.nan), None), SIZE, "finite"),
        (MarkerCorners(np.zeros((3, 2)), None), SIZE, "four"),
        (MarkerCorners(np.array([[0.0, 0], [10, 0], [20, 0], [5, 0]]), None), SIZE, "edge on"),
    ],
)
def test_what_is_no_marker_is_refused(corners, size, why):
    with pytest.raises(BadInput, match=why):
        marker_pose(RIG, corners, size)


def test_what_is_handed_out_cannot_be_changed():
    sight = marker_pose(RIG, corners_of(pose()), SIZE)
    for array in (sight.T_left_marker, sight.covariance):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 5.0
