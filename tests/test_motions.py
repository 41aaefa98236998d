"""Things that are dragged and carried about: where they are when, how fast, and that nothing jumps."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vita.poses import pose_matrix
from vita.scenario.schema import ObjectSpec
from vita.sim.motions import TURN_DEG, Carry, Motion
from vita.sim.props import Props

FACING = (90.0, 0.0, 90.0)
"""Of a plate that looks along the world's x, upright."""


def carried(path, **way):
    settings = {"radius_m": 0.1, "length_m": 0.3, "speed_m_s": 0.1, "turn_deg_s": 0.0, "for_s": np.inf}
    return Carry(pose_matrix((0.6, 0.1, 0.2), FACING), path, begin_s=2.0, **(settings | way))


def angle_between(a, b):
    """Of the orientations of two poses [deg]."""
    return np.degrees(Rotation.from_matrix(a[:3, :3].T @ b[:3, :3]).magnitude())


def speeds(carry, times, h=1e-4):
    """Speed [m/s] and turning speed [deg/s] by central differences."""
    found = []
    for t in times:
        a, b = carry.at(t - h), carry.at(t + h)
        moved, turned = np.linalg.norm(b[:3, 3] - a[:3, 3]), angle_between(a, b)
        found.append((moved / 2 / h, turned / 2 / h))
    return np.array(found).T


@pytest.mark.parametrize("path", ["circle", "line", "wave"])
def test_what_is_carried_starts_softly_and_keeps_its_speed(path):
    """At rest at first, never faster than asked in place or turn, and as fast as that at times; in the plane
    of the plate, without jumps in speed."""
    carry = carried(path, turn_deg_s=20.0)
    times = np.arange(2.0, 17.0, 0.08)
    speed, turn = speeds(carry, times)
    assert speed[0] < 1e-3 and turn[0] < 0.2
    assert np.isclose(speed.max(), 0.1, rtol=2e-3) and np.isclose(turn.max(), 20.0, rtol=2e-3)
    assert np.abs(np.diff(speed)).max() < 0.04, "no jump: under 0.5 m/s2"
    poses = [carry.at(t) for t in times]
    assert np.allclose([T[0, 3] for T in poses], 0.6), "the plate's plane is x = 0.6"
    assert np.isclose(max(angle_between(carry.start, T) for T in poses), TURN_DEG, rtol=1e-2)


def test_a_circle_is_about_the_start_and_at_constant_speed():
    carry = carried("circle")
    times = np.arange(8.0, 20.0, 0.05)
    away = np.array([carry.at(t)[:3, 3] for t in times]) - (0.6, 0.1, 0.2)
    assert np.allclose(np.linalg.norm(away, axis=1), 0.1)
    assert np.allclose(speeds(carry, times)[0], 0.1, rtol=1e-3)
    assert np.abs(away.mean(axis=0)).max() < 0.02, "all the way around"


def test_line_and_wave_have_their_sizes():
    for path, tall in (("line", 0.0), ("wave", 0.1)):
        away = np.array([carried(path).at(t)[:3, 3] for t in np.arange(2, 40, 0.02)]) - (0.6, 0.1, 0.2)
        assert np.allclose(np.abs(away).max(axis=0), (0, 0.15, tall), atol=1e-3)


def test_carrying_ends_at_rest_and_a_drag_takes_over_without_a_jump():
    carry = carried("circle", for_s=7.0, turn_deg_s=15.0)
    assert max(speeds(carry, [8.999])[0]) < 1e-3 and np.array_equal(carry.at(9.0), carry.at(50.0))
    assert np.linalg.norm((carry.at(9.0) - carry.start)[:3, 3]) > 0.05, "it stays where it ended"
    short = carried("line", for_s=0.5)
    assert speeds(short, np.arange(2, 2.5, 0.01))[0].max() <= 0.1

    props = Props((ObjectSpec("target", "target", (0.6, 0.1, 0.2), FACING),))
    way = {"radius_m": 0.1, "length_m": 0.3, "speed_m_s": 0.1, "turn_deg_s": 20.0, "for_s": np.inf}
    props.carry("target", 0.0, path="wave", **way)
    there = props.poses({}, 7.3)["target"]
    props.move("target", (0.5, 0.0, 0.2), FACING, 1.0, 7.3)
    assert np.allclose(props.poses({}, 7.3)["target"], there, atol=1e-9)
    assert np.allclose(props.poses({}, 9.0)["target"], pose_matrix((0.5, 0.0, 0.2), FACING))
    props.carry("target", 10.0, path="line", **way)
    props.restore()
    assert np.allclose(props.poses({}, 11.0)["target"], pose_matrix((0.6, 0.1, 0.2), FACING))


def test_a_thing_that_is_dragged_turns_the_short_way_round_about_one_axis():
    """From rest to rest, also across the +-180 degrees of its angles and at pitch 90, where they tumble."""
    rng = np.random.default_rng(3)
    for start, end in [
        ((0, 0, 175), (0, 0, -175)),
        ((0, 90, 40), (20, 85, 0)),
        *(rng.uniform(-180, 180, (2, 3)) for _ in range(10)),
    ]:
        a, b = pose_matrix((0.1, 0.2, 0.3), start), pose_matrix((0.3, 0.2, 0.1), end)
        motion = Motion(a, b, 1.0, 2.0)
        whole = angle_between(a, b)
        assert whole <= 180
        for now in (0.5, 1.0, 1.4, 2.0, 2.7, 3.0, 9.0):
            T = motion.at(now)
            there, rest = angle_between(a, T), angle_between(T, b)
            assert np.isclose(there + rest, whole, atol=1e-4), "never farther than the direct way"
            if whole > 1:
                share = np.linalg.norm((T - a)[:3, 3]) / np.linalg.norm((b - a)[:3, 3])
                assert np.isclose(there / whole, share, atol=1e-6), "place and turn keep pace"
        assert np.allclose(motion.at(2.0)[:3, 3], (0.2, 0.2, 0.2)), "half of it in half the time"
        assert np.array_equal(motion.at(3.0), b) and max(speeds(motion, [1.0, 3.0])[0]) < 1e-3
