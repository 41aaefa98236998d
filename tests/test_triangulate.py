"""Laws of triangulation: exact without noise, as good as predicted with it, and refused with a reason."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from vita.errors import BadInput, UnknownName
from vita.scenario.schema import CameraSpec
from vita.stereo.base import Lens, StereoRig
from vita.stereo.projection import pixel_slope, project
from vita.stereo.rig_file import load_rig, save_rig
from vita.stereo.triangulate import triangulate, triangulation_covariance
from vita.vision.stereo_rig import stereo_rig_of


def rig_of(
    baseline=(0.2, 0.0, 0.0), turn_deg=(0.0, 0.0, 0.0), left=(800, 800), right=(800, 800)
) -> StereoRig:
    """The right camera stands at `baseline` [m] in left-camera coordinates, turned by a rotation vector."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(np.radians(turn_deg)).as_matrix().T
    T[:3, 3] = -T[:3, :3] @ baseline
    return StereoRig(Lens(left[0], left[1], 319.5, 239.5), Lens(right[0], right[1], 310.0, 250.0), T)


def seen(rig: StereoRig, points) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of (..., 3) points in both pictures, by the projection matrices of eq. 1 and 7."""
    homogeneous = np.concatenate([points, np.ones((*np.shape(points)[:-1], 1))], axis=-1)
    pixels = [homogeneous @ P.T for P in rig.projections]
    return pixels[0][..., :2] / pixels[0][..., 2:], pixels[1][..., :2] / pixels[1][..., 2:]


RIGS = {
    "parallel": rig_of(),
    "converging": rig_of((0.2, 0.01, 0.03), (1.0, -9.0, 2.0), left=(515, 520), right=(800, 790)),
    "one above the other": rig_of((0.02, -0.3, 0.0), (15.0, 0.0, 40.0)),
}


@given(
    name=st.sampled_from(sorted(RIGS)),
    x=st.floats(-0.4, 0.4), y=st.floats(-0.4, 0.4), z=st.floats(0.4, 5.0),
)  # fmt: skip
@settings(max_examples=150, deadline=None)
def test_without_noise_the_point_comes_back(name, x, y, z):
    point = np.array([x * z, y * z, z])
    rig = RIGS[name]
    if (rig.T_right_left @ (*point, 1.0))[2] > 0.1:
        assert np.abs(triangulate(rig, *seen(rig, point)) - point).max() < 1e-9


def test_many_points_at_once_give_what_each_gives_alone():
    rng, rig = np.random.default_rng(0), RIGS["converging"]
    left, right = seen(rig, rng.uniform([-0.3, -0.3, 0.5], [0.3, 0.3, 2.0], (2, 3, 3)))
    left += rng.normal(0, 0.3, left.shape)
    together = triangulate(rig, left, right)
    assert together.shape == (2, 3, 3)
    for i, j in np.ndindex(2, 3):
        assert np.abs(triangulate(rig, left[i, j], right[i, j]) - together[i, j]).max() < 1e-12


def test_with_noise_it_is_the_point_whose_pixels_are_nearest():
    """The least reprojection error: no small move makes it less, which eq. 6 alone does not reach."""
    rng, rig = np.random.default_rng(1), RIGS["converging"]
    left, right = seen(rig, np.array([0.1, -0.2, 1.0]))
    left, right = left + rng.normal(0, 2.0, 2), right + rng.normal(0, 2.0, 2)

    def miss(point):
        return sum(np.square(a - b).sum() for a, b in zip(seen(rig, point), (left, right), strict=True))

    found = triangulate(rig, left, right)
    for move in np.vstack([np.eye(3), -np.eye(3)]) * 1e-4:
        assert miss(found) < miss(found + move)


@pytest.mark.parametrize("name", sorted(RIGS))
def test_noise_scatters_the_point_as_predicted(name):
    """0.2 px at 1 m: the squared errors in units of the covariance are chi-square of 3 degrees of freedom."""
    rng, rig, point, count = np.random.default_rng(2), RIGS[name], np.array([0.1, -0.05, 1.0]), 4000
    left, right = (p + rng.normal(0, 0.2, (count, 2)) for p in seen(rig, point))
    off = triangulate(rig, left, right) - point
    predicted = triangulation_covariance(rig, point, 0.2)
    whitened = np.einsum("ni,ij,nj->n", off, np.linalg.inv(predicted), off)
    assert whitened.mean() == pytest.approx(3.0, abs=4 * np.sqrt(6 / count))
    assert np.mean(whitened < 7.815) == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / count))
    scale = np.sqrt(np.diag(predicted))
    assert np.abs((np.cov(off.T) - predicted) / np.outer(scale, scale)).max() < 0.1


def test_the_depth_of_a_parallel_rig_scatters_as_the_textbook_says():
    """sd(z) = z^2 / (f b) sqrt(2) sigma; sd(x) = z / f sigma / sqrt(2) half way between the lenses."""
    rig = rig_of()
    predicted = np.sqrt(np.diag(triangulation_covariance(rig, np.array([0.1, 0.0, 1.0]), 0.2)))
    assert predicted[2] == pytest.approx(1.0 / (800 * 0.2) * np.sqrt(2) * 0.2, rel=0.01)
    assert predicted[0] == pytest.approx(1.0 / 800 * 0.2 / np.sqrt(2), rel=0.01)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda left, right: (left, np.array([np.nan, 1.0])), "not finite"),
        (lambda left, right: (np.array([np.inf, 1.0]), right), "not finite"),
        (lambda left, right: (left, left + (310.0 - 319.5, 250.0 - 239.5)), "parallel"),
        (lambda left, right: (left, left + (310.0 - 319.5 - 0.5, 10.5)), "parallel"),
        (lambda left, right: (left, left + (310.0 - 319.5 + 60.0, 10.5)), "behind the left camera"),
        (lambda left, right: (left[:1], right), "pixels"),
        (lambda left, right: (np.stack([left, left]), right), "one pixel for each"),
    ],
)
def test_what_has_no_point_is_refused_with_the_reason(change, why):
    rig = rig_of()
    with pytest.raises(BadInput, match=why):
        triangulate(rig, *change(*seen(rig, np.array([0.05, 0.02, 1.0]))))


def test_of_many_the_bad_one_is_named():
    rig = rig_of()
    left, right = seen(rig, np.array([[0.0, 0.0, 1.0], [0.1, 0.0, 2.0], [0.0, 0.1, 1.5]]))
    right[1] = left[1] + (310.0 - 319.5 + 60.0, 10.5)
    with pytest.raises(BadInput, match="point 1 lies behind"):
        triangulate(rig, left, right)


def test_a_point_behind_only_the_right_camera_is_refused():
    rig = rig_of((0.6, 0.0, 0.6), (0.0, -60.0, 0.0))
    point = np.array([-0.3, 0.02, 0.3])
    assert point[2] > 0 and (rig.T_right_left @ (*point, 1.0))[2] > 0
    triangulate(rig, *seen(rig, point))
    turned = rig_of((0.6, 0.0, 0.6), (0.0, 60.0, 0.0))
    assert (turned.T_right_left @ (*point, 1.0))[2] < 0
    with pytest.raises(BadInput, match="behind the right camera"):
        triangulate(turned, *seen(turned, point))


def test_how_far_is_too_far_depends_on_the_noise():
    """At 30 m the rays of a 0.2 m rig meet at 0.4 degrees: clear at 0.2 px, nothing at 5 px."""
    rig, point = rig_of(), np.array([0.5, 0.2, 30.0])
    assert np.abs(triangulate(rig, *seen(rig, point), sigma_px=0.2) - point).max() < 1e-9
    for refused in (triangulate, None):
        with pytest.raises(BadInput, match="parallel"):
            if refused:
                refused(rig, *seen(rig, point), sigma_px=5.0)
            else:
                triangulation_covariance(rig, point, 5.0)


def test_no_baseline_no_depth():
    rig = rig_of((0.0, 0.0, 0.0), (0.0, 5.0, 0.0))
    with pytest.raises(BadInput, match="baseline"):
        triangulate(rig, *seen(rig, np.array([0.0, 0.0, 1.0])))
    with pytest.raises(BadInput, match="baseline"):
        triangulation_covariance(rig, np.array([0.0, 0.0, 1.0]), 0.2)


@pytest.mark.parametrize(
    ("point", "sigma", "why"),
    [((0, 0, -1), 0.2, "behind"), ((0, 0, np.nan), 0.2, "finite"), ((0, 0, 1), 0.0, "above 0"),
     ((0, 0, 1), np.nan, "above 0")],
)  # fmt: skip
def test_a_covariance_without_meaning_is_refused(point, sigma, why):
    with pytest.raises(BadInput, match=why):
        triangulation_covariance(rig_of(), np.array(point, float), sigma)


def test_projection_is_that_of_the_matrices_and_nothing_is_seen_behind():
    rng, lens = np.random.default_rng(3), Lens(515, 640, 300.0, 250.0)
    points = rng.uniform([-1, -1, 0.2], [1, 1, 3], (5, 2, 3))
    homogeneous = points @ lens.matrix.T
    assert np.allclose(project(lens, points), homogeneous[..., :2] / homogeneous[..., 2:], atol=1e-12, rtol=0)
    assert np.isnan(project(lens, np.array([[0.1, 0.2, -1.0], [0.1, 0.2, 0.0]]))).all()


def test_the_slope_of_the_projection_agrees_with_finite_differences():
    rng, lens, h = np.random.default_rng(4), Lens(515, 640, 300.0, 250.0), 1e-6
    points = rng.uniform([-1, -1, 0.5], [1, 1, 3], (6, 3))
    for k, step in enumerate(np.eye(3) * h):
        difference = (project(lens, points + step) - project(lens, points - step)) / (2 * h)
        assert np.abs(pixel_slope(lens, points)[..., k] - difference).max() < 1e-4


# The rig of two of a scenario's cameras.


def test_two_cameras_that_stand_form_a_rig():
    """A world point projected through the rig is where each camera by itself sees it."""
    from vita.sim.camera import PinholeCamera, camera_pose

    specs = (
        CameraSpec("left", (1.2, -0.1, 0.7), (0.4, 0.0, 0.2), size=(640, 480)),
        CameraSpec("right", (1.2, 0.1, 0.75), (0.4, 0.0, 0.2), fov_deg=40, size=(800, 600)),
    )
    rig, world = stereo_rig_of(*specs), np.array([0.5, 0.05, 0.3])
    T_world_left = camera_pose(specs[0], {})
    local = np.linalg.inv(T_world_left) @ (*world, 1.0)
    pixels = [PinholeCamera(s.name, s.size, s.fov_deg).project(camera_pose(s, {}), world)[0] for s in specs]
    assert np.allclose(seen(rig, local[:3]), pixels, atol=1e-9, rtol=0)
    assert np.allclose(triangulate(rig, *pixels), local[:3], atol=1e-9)
    assert rig.baseline == pytest.approx(np.hypot(0.2, 0.05))
    assert rig.left.fx == pytest.approx(240 / np.tan(np.radians(25))) and rig.right.cx == 399.5


def test_two_cameras_on_one_tripod_form_the_same_rig_wherever_it_stands():
    left = CameraSpec("left", mount="tripod", xyz=(-0.1, 0, 0), rpy_deg=(0, 5, 0))
    right = CameraSpec("right", mount="tripod", xyz=(0.1, 0, 0))
    rig = stereo_rig_of(left, right)
    # A point straight ahead of the left lens, at 1 m: the left camera is turned by 5 degrees about y (down).
    s, c = np.sin(np.radians(5)), np.cos(np.radians(5))
    assert np.allclose(rig.T_right_left @ (0, 0, 1, 1), (-0.2 + s, 0, c, 1), atol=1e-12)


@pytest.mark.parametrize(
    "other",
    [CameraSpec("b", mount="tool"), CameraSpec("b", (1, 0, 1), (0, 0, 0))],
)
def test_cameras_that_move_apart_are_no_rig(other):
    with pytest.raises(BadInput, match="'a' is carried by 'tripod'.*'b'"):
        stereo_rig_of(CameraSpec("a", mount="tripod"), other)


def test_a_calibration_file_reads_back_to_the_bit(tmp_path):
    T = RIGS["converging"].T_right_left
    lenses = Lens(515.25, 516.1, 319.75, 240.0, (-0.1, 0.02, 1e-5, -2e-4, 0.003)), Lens(800, 801, 320, 239.5)
    save_rig(tmp_path / "rig.toml", StereoRig(*lenses, T), ((640, 480), (800, 600)), 0.21)
    rig = load_rig(tmp_path / "rig.toml")
    assert (rig.left, rig.right) == lenses and np.abs(rig.T_right_left - T).max() < 1e-15


GOOD = """
[left]
fx = 500.0
fy = 500
cx = 319.5
cy = 239.5
distortion = []
size = [640, 480]
[right]
fx = 500.0
fy = 500.0
cx = 319.5
cy = 239.5
size = [640, 480]
[stereo]
T_right_left = [[1, 0, 0, -0.2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
rms_px = 0.2
"""


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[left]", "[lift]", "lift"),
        ("fx = 500.0", "fx = -1.0", "left: .*focal"),
        ("fx = 500.0", "fx = nan", r"left\.fx"),
        ("fx = 500.0", "", r"left\.fx: is missing"),
        ("fy = 500\n", "fy = 'a'\n", r"left\.fy"),
        ("fy = 500\n", "fz = 500\n", "fz"),
        ("distortion = []", "distortion = [1, 2]", r"left\.distortion"),
        ("size = [640, 480]", "size = [640]", r"left\.size"),
        ("size = [640, 480]", "size = [0, 480]", r"left\.size"),
        ("[[1, 0, 0, -0.2]", "[[2, 0, 0, -0.2]", "T_right_left"),
        ("[[1, 0, 0, -0.2], ", "[", "T_right_left"),
        ("[stereo]", "[stereo", "no TOML"),
    ],
)  # fmt: skip
def test_a_wrong_calibration_file_is_refused_with_its_name_and_the_key(tmp_path, old, new, says):
    assert old in GOOD
    (tmp_path / "rig.toml").write_text(GOOD)
    assert load_rig(tmp_path / "rig.toml").baseline == pytest.approx(0.2)
    (tmp_path / "rig.toml").write_text(GOOD.replace(old, new, 1))
    with pytest.raises(BadInput, match=f"rig.toml: .*{says}|rig.toml.*{says}"):
        load_rig(tmp_path / "rig.toml")


def test_a_calibration_file_that_is_not_there_is_bad_input(tmp_path):
    with pytest.raises(BadInput, match="nowhere.toml"):
        load_rig(tmp_path / "nowhere.toml")
    (tmp_path / "rig.toml").write_text(GOOD + "\n[extra]\n")
    with pytest.raises(UnknownName):
        load_rig(tmp_path / "rig.toml")
