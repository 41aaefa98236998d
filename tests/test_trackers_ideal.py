"""Laws of the trackers that do not look at pixels: `fixed` and `projected`."""

import numpy as np
import pytest

from vita.errors import BadInput, UnknownName
from vita.scenario.schema import NoiseSpec
from vita.vision import ProjectedTracker, make_tracker, tracker_seed

FRAME = np.zeros((480, 640, 3), np.uint8)
SIZE = (640, 480)


def readings(kind, sigma=0.0, seed=0, count=4000, place=(100.25, 200.75)) -> np.ndarray:
    tracker = ProjectedTracker(lambda: np.array(place), NoiseSpec(kind, sigma), seed, SIZE)
    return np.array([tracker.update(FRAME).uv for _ in range(count)]).reshape(-1, 2)


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


def test_wrong_settings_are_refused():
    with pytest.raises(UnknownName, match="gaussian"):
        ProjectedTracker(lambda: np.zeros(2), NoiseSpec("gauss"), 0, SIZE)
    with pytest.raises(BadInput):
        ProjectedTracker(lambda: np.zeros(2), NoiseSpec("gaussian", -1.0), 0, SIZE)
