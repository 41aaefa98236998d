"""Laws of the trackers that do not look at pixels: `fixed` and `projected`."""

from dataclasses import replace

import numpy as np
import pytest
from sim_rig import GOAL, KinematicRig, scenario

from vita.editing import Editor
from vita.errors import BadInput, UnknownName
from vita.poses import look_at
from vita.scenario.schema import CameraSpec, NoiseSpec
from vita.scenario.toml_io import dumps, loads
from vita.sim.truth import GroundTruth
from vita.types import Feature
from vita.vision import ProjectedTracker, make_tracker, tracker_seed

FRAME = np.zeros((480, 640, 3), np.uint8)
SIZE = (640, 480)


PLACE = np.array([100.25, 200.75])


def features(noise: NoiseSpec, seed=0, count=4000, place: object = PLACE, away=1.0) -> list[Feature]:
    tracker = ProjectedTracker(lambda: np.array(place), noise, seed, SIZE, distance=lambda: away)
    return [tracker.update(FRAME) for _ in range(count)]


def readings(kind, sigma=0.0, seed=0, count=4000, place: object = PLACE, away=1.0, **more) -> np.ndarray:
    noise = NoiseSpec(kind, sigma, **more)
    return np.array([f.uv for f in features(noise, seed, count, place, away)]).reshape(-1, 2)


def test_fixed_never_moves():
    tracker = make_tracker("fixed", FRAME, [10.25, 20.5])
    rng = np.random.default_rng(0)
    for _ in range(5):
        feature = tracker.update(rng.integers(0, 255, FRAME.shape, dtype=np.uint8))
        assert feature.ok and feature.score == 1.0 and feature.corners is None
        assert feature.uv.tolist() == [10.25, 20.5]


def test_perfect_is_the_truth():
    assert (readings("perfect", count=3) == [100.25, 200.75]).all()


def test_integer_is_the_nearest_whole_pixel():
    assert (readings("integer", count=3) == [100, 201]).all()


@pytest.mark.parametrize("sigma", [0.2, 1.5])
def test_gaussian_noise_has_the_set_deviation_and_no_bias(sigma):
    noise = readings("gaussian", sigma) - [100.25, 200.75]
    assert np.abs(noise.std(axis=0) / sigma - 1).max() < 0.05
    assert np.abs(noise.mean(axis=0)).max() < 4 * sigma / np.sqrt(len(noise))
    assert abs(float(np.mean(noise[:, 0] * noise[:, 1]))) < 0.06 * sigma**2


def test_noise_belongs_to_the_tracker_and_not_to_its_company():
    alone = readings("gaussian", 1.0, seed=tracker_seed(7, "tip"), count=50)
    tracker = ProjectedTracker(
        lambda: np.array([100.25, 200.75]), NoiseSpec("gaussian", 1.0), tracker_seed(7, "tip"), SIZE
    )
    other = ProjectedTracker(
        lambda: np.array([100.25, 200.75]), NoiseSpec("gaussian", 1.0), tracker_seed(7, "goal"), SIZE
    )
    together = np.array([(other.update(FRAME).uv, tracker.update(FRAME).uv) for _ in range(50)])
    assert np.array_equal(together[:, 1], alone)
    assert abs(np.corrcoef(together[:, 0, 0], together[:, 1, 0])[0, 1]) < 0.5


def test_out_of_sight_is_lost_with_the_last_good_pixel_and_the_noise_stays_in_step():
    places = [(5.0, 5.0), (np.nan, 1.0), (640.0, 5.0), (3.0, -2.0), (6.0, 6.0)]
    features = []
    tracker = ProjectedTracker(lambda: np.array(places[len(features)]), NoiseSpec("gaussian", 0.1), 3, SIZE)
    for _ in places:
        features.append(tracker.update(FRAME))
    assert [f.ok for f in features] == [True, False, False, False, True]
    assert all(np.array_equal(f.uv, features[0].uv) for f in features[1:4])
    steady = readings("gaussian", 0.1, seed=3, count=5, place=(6.0, 6.0))
    assert np.allclose(features[4].uv, steady[4])


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize(
    ("kind", "sigma", "away", "wanted"),
    [("gaussian", 0.2, 3.0, 0.2), ("distance", 0.2, 0.8, 0.2), ("distance", 0.2, 2.0, 0.5)],
)
def test_the_deviation_is_within_5_percent_of_the_setting_per_axis(kind, sigma, away, wanted, seed):
    at_m = 0.8 if kind == "distance" else 1.0
    noise = readings(kind, sigma, seed, away=away, at_m=at_m) - PLACE
    assert np.abs(noise.std(axis=0) / wanted - 1).max() < 0.05


def test_noise_follows_the_distance_frame_by_frame():
    """The same draws, scaled by where the camera is in each frame."""
    away = iter([0.5, 1.0, 2.0, 4.0])
    tracker = ProjectedTracker(
        lambda: PLACE, NoiseSpec("distance", 0.3, at_m=0.5), 5, SIZE, distance=lambda: next(away)
    )
    noise = np.array([tracker.update(FRAME).uv for _ in range(4)]) - PLACE
    unit = readings("gaussian", 0.3, seed=5, count=4) - PLACE
    assert np.allclose(noise, unit * [[1], [2], [4], [8]])


@pytest.mark.parametrize("kind", ["perfect", "gaussian", "integer"])
def test_drift_walks_at_the_set_speed_in_one_direction(kind):
    """After 10 s at 3 px/s it is 30 px off, and half-way there after half of the time."""
    sigma = 0.2 if kind == "gaussian" else 0.0
    still = readings(kind, sigma, seed=4, count=301)
    off = readings(kind, sigma, seed=4, count=301, drift_px_s=3.0) - still
    slack = 1.5 if kind == "integer" else 1e-9
    assert abs(np.linalg.norm(off[300]) - 30) < slack and np.abs(off[150] - off[300] / 2).max() < slack
    assert (off[0] == 0).all()
    other = readings(kind, sigma, seed=9, count=301, drift_px_s=3.0) - readings(kind, sigma, 9, 301)
    assert np.linalg.norm(other[300] - off[300]) > 1, "each tracker drifts its own way"


def test_occluded_spans_are_lost_to_the_frame_and_change_nothing_else():
    spans = ((1.0, 1.5), (2.0, 2.1))
    seen = features(NoiseSpec("gaussian", 0.2, occluded=spans), 3, 90)
    lost = {k for k, f in enumerate(seen) if not f.ok}
    assert lost == set(range(30, 45)) | set(range(60, 63))
    assert all(f.score == 0 and np.array_equal(f.uv, seen[29].uv) for f in seen[30:45])
    free = features(NoiseSpec("gaussian", 0.2), 3, 90)
    assert all(np.array_equal(seen[k].uv, free[k].uv) for k in range(90) if k not in lost)


def test_jumps_are_single_frames_of_the_set_size_at_the_set_time():
    noise = NoiseSpec("gaussian", 0.2, jump_px=7.0, jump_every_s=0.5)
    uv = np.array([f.uv for f in features(noise, 3, 91)])
    off = np.linalg.norm(uv - readings("gaussian", 0.2, seed=3, count=91), axis=1)
    assert np.allclose(off[15::15], 7.0)
    assert np.count_nonzero(off) == 6
    ways = (uv - readings("gaussian", 0.2, seed=3, count=91))[15::15]
    assert np.ptp(np.arctan2(ways[:, 1], ways[:, 0])) > 0.5, "not always to the same side"


def test_two_runs_are_identical():
    noise = NoiseSpec("distance", 0.2, 0.5, 1.0, ((0.1, 0.2),), 5.0, 0.3)
    a, b = features(noise, 8, 60), features(noise, 8, 60)
    assert all(x.ok == y.ok and np.array_equal(x.uv, y.uv) for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize(
    ("noise", "path"),
    [
        (NoiseSpec(at_m=0.0), "noise.at_m"),
        (NoiseSpec(drift_px_s=-1.0), "noise.drift_px_s"),
        (NoiseSpec(jump_px=3.0), "noise.jump_px"),
        (NoiseSpec(jump_every_s=3.0), "noise.jump_px"),
        (NoiseSpec(occluded=((0.0, 1.0), (2.0, 2.0))), "noise.occluded[1]"),
    ],
)
def test_wrong_options_are_refused_by_name(noise, path):
    with pytest.raises(BadInput) as caught:
        ProjectedTracker(lambda: PLACE, noise, 0, SIZE)
    assert caught.value.path == path


def test_noise_with_distance_needs_one():
    with pytest.raises(BadInput, match="distance to the camera"):
        ProjectedTracker(lambda: PLACE, NoiseSpec("distance", 0.2), 0, SIZE)


def test_the_distance_is_that_to_the_camera_also_to_one_that_froze():
    truth = GroundTruth([CameraSpec("left")])
    poses = {"camera:left": look_at((1.0, 2.0, 2.0), (0.0, 0.0, 0.0)), "world": np.eye(4)}
    truth.update(poses)
    assert np.isclose(truth.distance("left", "world", (0.0, 0.0, 0.0)), 3.0)
    truth.update(poses | {"camera:left": look_at((9.0, 0.0, 0.0), (0.0, 0.0, 0.0))}, ["left"])
    assert np.isclose(truth.distance("left", "world", (0.0, 0.0, 0.0)), 3.0)
    with pytest.raises(UnknownName):
        truth.distance("top", "world", (0.0, 0.0, 0.0))


def test_a_task_gives_its_projected_trackers_the_distance():
    """The goal is 2.7 m from the left camera of this rig; its noise must be that of 2.7 m."""
    task = scenario()
    noisy = tuple(replace(t, noise=NoiseSpec("distance", 0.1, at_m=0.5)) for t in task.tracker)
    rig = KinematicRig()
    editor = Editor(rig, replace(task, tracker=noisy), rig.observe())
    seen, readings = rig.observe(), []
    for _ in range(3000):
        editor.track(seen)
        readings.append(editor.features["goal_left"].uv)
    wanted = 0.1 * rig.distance("left", "world", GOAL) / 0.5
    assert wanted > 0.5
    assert np.abs(np.std(readings, axis=0) / wanted - 1).max() < 0.06


FILE = """schema = 1
[scene]
robot = "wam7"
[[camera]]
name = "left"
look_from = [1, 0, 0]
look_at = [0, 0, 0]
[[tracker]]
name = "tip"
camera = "left"
kind = "projected"
attach = { body = "tool" }
noise = { NOISE }
"""


def test_a_file_may_hold_every_option():
    text = FILE.replace(
        "NOISE",
        'kind = "distance", sigma_px = 0.2, at_m = 0.55, drift_px_s = 1, occluded = [[1, 2.5], [4, 5]], '
        "jump_px = 9, jump_every_s = 2",
    )
    task = loads(text)
    wanted = NoiseSpec("distance", 0.2, 0.55, 1.0, ((1.0, 2.5), (4.0, 5.0)), 9.0, 2.0)
    assert task.tracker[0].noise == wanted
    assert loads(dumps(task)) == task


@pytest.mark.parametrize(
    ("noise", "path"),
    [
        ("sigma_px = 0.2", "sigma_px"),
        ('kind = "gaussian", at_m = 2.0', "at_m"),
        ('kind = "distance", at_m = 0.0', "at_m"),
        ("drift_px_s = -1.0", "drift_px_s"),
        ("occluded = [[2.0, 1.0]]", "occluded[0]"),
        ("occluded = [[1.0]]", "occluded[0]"),
        ("jump_px = 3.0", "jump_px"),
        ("jump_every_s = 3.0", "jump_every_s"),
    ],
)
def test_a_file_with_a_wrong_option_names_it(noise, path):
    with pytest.raises(BadInput) as caught:
        loads(FILE.replace("NOISE", noise))
    assert caught.value.path == f"tracker[0].noise.{path}"


def test_wrong_settings_are_refused():
    with pytest.raises(UnknownName, match="gaussian"):
        ProjectedTracker(lambda: np.zeros(2), NoiseSpec("gauss"), 0, SIZE)
    with pytest.raises(BadInput):
        ProjectedTracker(lambda: np.zeros(2), NoiseSpec("gaussian", -1.0), 0, SIZE)
