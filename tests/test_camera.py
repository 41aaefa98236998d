"""Pinhole cameras: projection and poses against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from vita.errors import BadInput, UnknownName
from vita.poses import look_at, pose_matrix, rpy_matrix
from vita.scenario.schema import CameraSpec
from vita.sim.camera import PinholeCamera, camera_pose, mounted

degrees = st.floats(-180, 180)
metres = st.floats(-2, 2)


def test_the_optical_axis_meets_the_image_centre():
    camera = PinholeCamera("c", (640, 480), 50)
    assert np.allclose(camera.project(np.eye(4), np.array([[0, 0, 1.0]])), [[319.5, 239.5]])


def test_the_field_of_view_spans_the_image_from_edge_to_edge():
    """The top edge lies half a pixel above the centre of the first row."""
    camera = PinholeCamera("c", (640, 480), 50)
    edge = np.tan(np.radians(25))
    uv = camera.project(np.eye(4), np.array([[0, -edge, 1], [0, edge, 1]]))
    assert np.allclose(uv[:, 1], [-0.5, 479.5])


@given(st.tuples(metres, metres, metres), st.tuples(degrees, degrees, degrees), st.floats(5, 120))
@settings(max_examples=50, deadline=None)
def test_projection_equals_the_intrinsics_times_the_camera_coordinates(xyz, rpy, fov):
    camera, T = PinholeCamera("c", (320, 200), fov), pose_matrix(xyz, rpy)
    local = np.array([[0.1, -0.2, 0.7], [-0.4, 0.3, 2.0]])
    world = local @ T[:3, :3].T + T[:3, 3]
    homogeneous = local @ camera.intrinsics.T
    assert np.allclose(camera.project(T, world), homogeneous[:, :2] / homogeneous[:, 2:], atol=1e-6)


def test_points_behind_the_camera_have_no_pixel():
    uv = PinholeCamera("c").project(np.eye(4), np.array([[0.1, 0, -1.0], [0, 0, 0], [0, 0, 1]]))
    assert np.isnan(uv[:2]).all() and np.isfinite(uv[2]).all()


@given(st.tuples(degrees, degrees, degrees))
@settings(max_examples=50, deadline=None)
def test_roll_pitch_yaw_are_turned_about_the_fixed_axes_in_that_order(rpy):
    assert np.allclose(rpy_matrix(rpy), Rotation.from_euler("xyz", rpy, degrees=True).as_matrix())


@given(st.tuples(metres, metres, metres), st.tuples(metres, metres, metres))
@settings(max_examples=50, deadline=None)
def test_a_camera_sees_what_it_looks_at_in_its_centre_and_up_is_up(eye, target):
    if np.linalg.norm(np.subtract(eye, target)) < 1e-3:
        return
    T, camera = look_at(eye, target), PinholeCamera("c")
    assert np.allclose(T[:3, :3].T @ T[:3, :3], np.eye(3)) and np.isclose(np.linalg.det(T[:3, :3]), 1)
    assert np.allclose(camera.project(T, np.array([target])), [[319.5, 239.5]], atol=1e-6)
    assert T[2, 1] <= 1e-9, "image down must not point upwards in the world"
    assert abs(T[2, 0]) < 1e-9, "image rows are level"


@pytest.mark.parametrize("z", [1.0, -1.0])
def test_looking_straight_up_or_down_is_defined(z):
    T = look_at((0, 0, 0), (0, 0, z))
    assert np.allclose(T[:3, 2], [0, 0, z]) and np.isclose(np.linalg.det(T[:3, :3]), 1)


def test_looking_at_the_own_position_is_refused():
    with pytest.raises(BadInput):
        look_at((1, 2, 3), (1, 2, 3))


@pytest.mark.parametrize("size, fov", [((0, 480), 50), ((640, 480), 0), ((640, 480), 180), ((99999, 1), 50)])
def test_impossible_lenses_and_sensors_are_refused(size, fov):
    with pytest.raises(BadInput):
        PinholeCamera("c", size, fov)


def test_a_mounted_camera_moves_with_its_mount():
    spec = CameraSpec("hand", mount="tool", xyz=(0, 0.1, 0.02), rpy_deg=(10, 20, 30))
    T = pose_matrix((0.4, 0.1, 0.5), (180, 0, 40))
    assert np.allclose(camera_pose(spec, {"tool": T}), T @ pose_matrix(spec.xyz, spec.rpy_deg))
    assert np.allclose(camera_pose(spec, {"tool": T}), mounted(T, spec.xyz, spec.rpy_deg))


def test_a_standing_camera_needs_no_bodies():
    spec = CameraSpec("left", look_from=(1, 0, 1), look_at=(0, 0, 0))
    assert np.allclose(camera_pose(spec, {}), look_at((1, 0, 1), (0, 0, 0)))


def test_an_unknown_mount_lists_the_choices():
    with pytest.raises(UnknownName, match="tool") as caught:
        camera_pose(CameraSpec("hand", mount="tol"), {"tool": np.eye(4), "flange": np.eye(4)})
    assert caught.value.choices == ("tool", "flange")


def test_a_camera_without_any_place_is_refused():
    with pytest.raises(BadInput, match="look_from"):
        camera_pose(CameraSpec("lost"), {})
