"""Laws of the simulated world, seen through the lockstep rig."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vita.errors import BadInput, UnknownName, VitaError
from vita.rig import SimulatedRig
from vita.scenario.schema import CameraSpec, ObjectSpec, Scenario, SceneSpec
from vita.servo.config import JointLimit, Limits
from vita.sim.lockstep import LockstepRig
from vita.types import Joint, JointStep

SIZE = (160, 120)
SCENARIO = Scenario(
    seed=3,
    scene=SceneSpec(
        image_noise=2.0,
        objects=(
            ObjectSpec("card", "card", (0.55, 0.1, 0.02), (0.0, 0.0, 20.0)),
            ObjectSpec("held", "card", (0.0, 0.0, 0.1), mount="tool"),
        ),
    ),
    camera=(
        CameraSpec("left", look_from=(1.2, -0.9, 0.7), look_at=(0.45, 0.0, 0.25), size=SIZE),
        CameraSpec("hand", mount="flange", xyz=(0.1, 0.0, 0.0), size=SIZE),
    ),
)


@pytest.fixture(scope="module")
def one_rig():
    with LockstepRig(SCENARIO) as rig:
        start = rig.observe().q
        yield rig, start


@pytest.fixture
def rig(one_rig):
    """The same rig for every test, put back to the start: building one takes a second."""
    rig, start = one_rig
    rig.command(None)
    rig.release()
    rig.hard_reset(start)
    return rig


def ask(rig, seen, dq, **changes):
    rig.command(JointStep(np.asarray(dq, dtype=float), seen.q, seen.stamp, **changes))


def run(rig, ticks, dq=None):
    """Observe `ticks` times, asking for the same dq from each observation; returns the observations."""
    seen = []
    for _ in range(ticks):
        seen.append(rig.observe())
        if dq is not None:
            ask(rig, seen[-1], dq)
    return seen


def settled(rig, ticks=40):
    rig.command(None)
    return run(rig, ticks)[-1]


def one_joint(rig, joint, amount):
    dq = np.zeros(len(rig.joints))
    dq[joint] = amount
    return dq


def test_it_is_a_simulated_rig(rig):
    assert isinstance(rig, SimulatedRig)


def test_first_observation_is_the_start():
    """The first observation is at time 0; the frame rate is 30 Hz; numbers grow by one."""
    with LockstepRig(SCENARIO) as rig:
        seen = run(rig, 4)
    assert [o.number for o in seen] == [0, 1, 2, 3]
    assert [o.stamp for o in seen] == pytest.approx([0, 1 / 30, 2 / 30, 3 / 30])
    assert seen[0].frames["left"].std() > 10
    for name in ("left", "hand"):
        frame = seen[0].frames[name]
        assert frame.shape == (SIZE[1], SIZE[0], 3) and frame.dtype == np.uint8
        assert not frame.flags.writeable


def test_two_rigs_agree_to_the_bit():
    """Same scenario, same commands: joints, pictures (with noise) and poses are identical."""

    def history():
        with LockstepRig(SCENARIO) as rig:
            seen = run(rig, 10, one_joint(rig, 1, 0.02))
            rig.perform("drag_target", object="card", xyz=(0.5, 0.0, 0.1), over_s=0.2)
            rig.perform("cover", camera="left", at=(80, 60), size_px=30, for_s=0.1)
            seen += run(rig, 10, one_joint(rig, 3, -0.02))
            return seen, dict(rig.poses())

    (a, poses_a), (b, poses_b) = history(), history()
    for x, y in zip(a, b, strict=True):
        assert np.array_equal(x.q, y.q)
        assert all(np.array_equal(x.frames[c], y.frames[c]) for c in x.frames)
    assert all(np.array_equal(poses_a[body], poses_b[body]) for body in poses_a)


def test_seed_changes_the_noise_only():
    with LockstepRig(SCENARIO, seed=1) as one, LockstepRig(SCENARIO, seed=2) as two:
        a, b = one.observe(), two.observe()
    assert np.array_equal(a.q, b.q)
    change = a.frames["left"].astype(int) - b.frames["left"]
    assert change.any() and 2.0 < change.std() < 3.5


def test_step_is_carried_out(rig):
    """A step moves the arm by dq, and then nothing more."""
    first = rig.observe()
    dq = np.full(len(first.q), 0.05)
    for _ in range(20):
        now = rig.observe()
        rig.command(JointStep(dq, first.q, now.stamp))
    end = settled(rig)
    assert end.q == pytest.approx(first.q + dq, abs=1e-4)
    assert np.array_equal(end.q, rig.observe().q), "the arm twitches at rest"


def test_no_command_means_no_motion(rig):
    first, last = rig.observe(), run(rig, 30)[-1]
    assert last.q == pytest.approx(first.q, abs=1e-9)


def test_lease_ends_in_rest(rig):
    """A servo that falls silent: at rest 100 ms plus 18 cycles later."""
    ask(rig, rig.observe(), np.full(7, 1.0))
    run(rig, 7)
    assert rig.gate_state()["at_rest"]
    assert rig.observe().q == pytest.approx(rig.observe().q, abs=1e-6)


def test_stop_holds_until_release(rig):
    ask(rig, rig.observe(), np.full(7, 1.0))
    run(rig, 3)
    rig.stop_now()
    run(rig, 4, np.full(7, 0.1))
    held = rig.observe()
    ask(rig, held, np.full(7, 0.1))
    assert rig.observe().q == pytest.approx(held.q, abs=1e-6)
    rig.release()
    assert rig.observe().q == pytest.approx(held.q, abs=1e-6), "release alone moved the arm"
    ask(rig, rig.observe(), np.full(7, 0.1))
    assert (rig.observe().q > held.q + 1e-3).all()


def test_speed_limit_holds_for_the_arm():
    """The measured arm, not only the set points, keeps the speed limit."""
    with LockstepRig(replace(SCENARIO, limits=Limits(speed_rad_s=0.3))) as rig:
        qs = np.array([o.q for o in run(rig, 30, np.full(7, 0.5))])
    speeds = np.abs(np.diff(qs, axis=0)) * 30
    assert speeds.max() == pytest.approx(0.3, rel=1e-3)
    assert speeds.max() <= 0.3 * (1 + 1e-3)


def test_constant_push_into_a_limit(rig):
    """C6: the arm never passes limit minus margin, and the joint is named."""
    joint = 0  # The elbow would come near the upper arm first, which is another rule's affair.
    for seen in run(rig, 150, one_joint(rig, joint, 0.2)):
        assert seen.q[joint] <= rig.joints[joint].upper - 0.02 + 1e-4
    assert rig.gate_state()["saturated"] == [joint]


def test_limits_are_never_wider_than_the_robots_own():
    wide = Limits(speed_rad_s=3.0, joint=(JointLimit(0, -500.0, 500.0), JointLimit(1, -10.0, 20.0)))
    with LockstepRig(replace(SCENARIO, limits=wide)) as rig:
        own, now = rig.robot_joints, rig.joints
        assert (now[0].lower, now[0].upper) == (own[0].lower, own[0].upper)
        assert (now[1].lower, now[1].upper) == pytest.approx(np.radians([-10, 20]))
        rig.set_limits([Joint(j.name, -99, 99, 99) for j in own])
        assert rig.joints == own
        with pytest.raises(BadInput):
            rig.set_limits([Joint(j.name, 50, 60, 1) for j in own])
        assert rig.joints == own
    with pytest.raises(BadInput, match="joint"):
        LockstepRig(replace(SCENARIO, limits=Limits(joint=(JointLimit(9),))))


def test_dead_band_swallows_small_motions():
    scene = replace(SCENARIO.scene, dead_band_deg=1.0)
    with LockstepRig(replace(SCENARIO, scene=scene)) as rig:
        first = rig.observe()
        small, large = np.radians(0.9), np.radians(1.1)
        for _ in range(10):
            now = rig.observe()
            rig.command(JointStep(np.array([small, large, 0, 0, 0, 0, 0]), first.q, now.stamp))
        end = settled(rig)
    assert end.q - first.q == pytest.approx([0, large, 0, 0, 0, 0, 0], abs=1e-5)


def test_malformed_steps_do_not_reach_the_arm(rig):
    """C5, in the whole rig: NaN and wrong shapes leave the arm alone and are counted."""
    first, dropped = rig.observe(), rig.gate_state()["dropped"]
    ask(rig, first, np.full(7, np.nan))
    rig.observe()
    ask(rig, first, np.zeros(3))
    assert rig.observe().q == pytest.approx(first.q, abs=1e-9)
    assert rig.gate_state()["dropped"] == dropped + 2


def test_projection_agrees_with_the_picture():
    """A point of an object is drawn where `project` says: covering it there changes that pixel only."""
    scenario = replace(SCENARIO, scene=replace(SCENARIO.scene, image_noise=0.0))
    with LockstepRig(scenario) as rig:
        before = rig.observe().frames["left"].astype(int)
        uv = rig.project("left", "card", (0, 0, 0))
        assert rig.locate("card", (0, 0, 0)) == pytest.approx([0.55, 0.1, 0.02])
        rig.perform("drag_target", object="card", xyz=(0.0, -3.0, -3.0))
        after = rig.observe().frames["left"].astype(int)
    rows, columns = np.nonzero(np.abs(after - before).sum(axis=2) > 30)
    assert rows.size > 20, "the card is not in the picture"
    assert np.abs([columns.mean(), rows.mean()] - uv).max() < 4


def test_objects_ride_on_their_mount(rig):
    """An object with a mount keeps its place on the link while the arm moves."""
    run(rig, 15, np.full(7, 0.05))
    poses = rig.poses()
    held = np.linalg.inv(poses["tool"]) @ poses["held"]
    assert held[:3, 3] == pytest.approx([0, 0, 0.1])
    hand = np.linalg.inv(poses["flange"]) @ poses["camera:hand"]
    assert hand[:3, 3] == pytest.approx([0.1, 0, 0])


# ---- actions -----------------------------------------------------------------------------------


def test_frozen_camera_repeats_its_bytes(rig):
    """V5: the same picture again, although the arm moves; ideal trackers see the past too."""
    seen = run(rig, 5, np.full(7, 0.05))[-1]
    pixel = rig.project("left", "tool", (0, 0, 0))
    rig.perform("freeze_camera", camera="left", for_s=0.2)
    for now in run(rig, 5, np.full(7, 0.05)):
        assert np.array_equal(now.frames["left"], seen.frames["left"])
        assert not np.array_equal(now.frames["hand"], seen.frames["hand"])
        assert np.array_equal(rig.project("left", "tool", (0, 0, 0)), pixel)
    run(rig, 3)
    assert not np.array_equal(rig.observe().frames["left"], seen.frames["left"])
    assert not np.array_equal(rig.project("left", "tool", (0, 0, 0)), pixel)


def test_unfreeze(rig):
    rig.perform("freeze_camera", camera="left")
    a, b = run(rig, 2)
    assert np.array_equal(a.frames["left"], b.frames["left"])
    rig.perform("unfreeze_camera", camera="left")
    assert not np.array_equal(rig.observe().frames["left"], b.frames["left"])


def test_cover_paints_a_grey_square(rig):
    clear = rig.observe().frames["left"].astype(int)
    rig.perform("cover", camera="left", at=(40.0, 30.0), size_px=20, for_s=0.1)
    covered = rig.observe().frames["left"].astype(int)
    square = covered[20:40, 30:50]
    assert np.abs(square - square.mean(axis=2, keepdims=True)).std() < 3, "not grey"
    assert abs(square.mean() - 128) < 8 and square.std() > 4
    outside = np.ones(clear.shape[:2], dtype=bool)
    outside[19:42, 29:52] = False
    assert np.abs(covered - clear)[outside].max() < 20
    gone = run(rig, 4)[-1].frames["left"].astype(int)
    assert np.abs(gone - clear).max() < 20


def test_cover_outside_the_picture_is_harmless(rig):
    clear = rig.observe().frames["left"].astype(int)
    for at in ((-500.0, 10.0), (1e5, 1e5), (0.0, 0.0)):
        rig.perform("cover", camera="left", at=at, size_px=30)
    covered = rig.observe().frames["left"].astype(int)
    assert np.abs(covered - clear)[20:, 20:].max() < 20, "only the corner at (0, 0) may be covered"
    rig.perform("uncover", camera="left")
    assert np.abs(rig.observe().frames["left"].astype(int) - clear).max() < 20


def test_black_camera(rig):
    rig.perform("black_camera", camera="left")
    assert not rig.observe().frames["left"].any()
    rig.perform("uncover", camera="left")
    assert rig.observe().frames["left"].any()


def test_moved_camera_sees_from_there(rig):
    rig.perform("move_camera", camera="left", look_from=(1.0, 1.0, 1.0))
    rig.observe()
    assert rig.poses()["camera:left"][:3, 3] == pytest.approx([1, 1, 1])
    before = rig.project("left", "card", (0, 0, 0)) - (79.5, 59.5)
    rig.perform("move_camera", camera="left", turn_deg=90)
    rig.observe()
    after = rig.project("left", "card", (0, 0, 0)) - (79.5, 59.5)
    assert after == pytest.approx([before[1], -before[0]]), "a roll turns the picture about its centre"
    with pytest.raises(BadInput, match="rides on"):
        rig.perform("move_camera", camera="hand", look_from=(1.0, 1.0, 1.0))


def test_push_moves_the_arm_and_it_stays_there(rig):
    first = rig.observe()
    rig.perform("push_robot", dq_deg=[5, -3])
    pushed = rig.observe()
    assert pushed.q - first.q == pytest.approx(np.radians([5, -3, 0, 0, 0, 0, 0]), abs=1e-6)
    assert settled(rig).q == pytest.approx(pushed.q, abs=1e-6)
    rig.perform("push_robot", dq_deg=[1e6])
    assert rig.observe().q[0] <= rig.joints[0].upper + 1e-9


def test_target_is_dragged_smoothly(rig):
    """The object leaves and arrives at rest, on a straight line, in the time given."""
    rig.observe()
    rig.perform("drag_target", object="card", xyz=(0.35, -0.1, 0.12), rpy_deg=(0, 0, 110), over_s=1.0)
    places = [rig.locate("card", (0, 0, 0))]
    for _ in range(33):
        rig.observe()
        places.append(rig.locate("card", (0, 0, 0)))
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert places[-1] == pytest.approx([0.35, -0.1, 0.12])
    assert steps[0] < 1e-3 and steps[29] < 1e-3 and not steps[31:].any()
    assert steps.sum() == pytest.approx(np.linalg.norm(places[-1] - places[0])), "not straight"


def test_hard_reset_restores_arm_and_scene(rig):
    first = rig.observe()
    run(rig, 10, np.full(7, 0.05))
    rig.perform("drag_target", object="card", xyz=(0.0, 0.0, 0.5))
    rig.perform("move_camera", camera="left", look_from=(1.0, 1.0, 1.0))
    rig.perform("freeze_camera", camera="left")
    rig.hard_reset(first.q)
    again = rig.observe()
    assert again.q == pytest.approx(first.q, abs=1e-9)
    assert again.stamp > first.stamp and again.number > first.number
    assert np.abs(again.frames["left"].astype(int) - first.frames["left"]).max() < 20
    with pytest.raises(BadInput):
        rig.hard_reset(np.full(7, np.nan))


@pytest.mark.parametrize(
    ("action", "arguments"),
    [
        ("explode", {}),
        ("cover", {"camera": "left"}),
        ("cover", {"camera": "left", "at": (1, 2, 3)}),
        ("cover", {"camera": "left", "at": (np.nan, 2)}),
        ("cover", {"camera": "left", "at": (1, 2), "colour": "red"}),
        ("freeze_camera", {"camera": "middle"}),
        ("freeze_camera", {"camera": 3}),
        ("freeze_camera", {"camera": "left", "for_s": -1.0}),
        ("move_camera", {"camera": "left", "look_from": "here"}),
        ("move_camera", {"camera": "left", "look_from": (0.45, 0.0, 0.25)}),
        ("push_robot", {"dq_deg": [1] * 8}),
        ("push_robot", {"dq_deg": [np.inf]}),
        ("drag_target", {"object": "cart", "xyz": (0, 0, 0)}),
    ],
)
def test_bad_actions_are_refused(rig, action, arguments):
    """Every wrong name or value raises `BadInput` and changes nothing."""
    rig.observe()
    before = dict(rig.poses())
    with pytest.raises(BadInput):
        rig.perform(action, **arguments)
    rig.observe()
    assert all(np.array_equal(rig.poses()[body], before[body]) for body in before)


def test_unknown_names_list_the_choices(rig):
    with pytest.raises(UnknownName, match="left, hand"):
        rig.project("middle", "tool", (0, 0, 0))
    with pytest.raises(UnknownName, match="Did you mean 'card'"):
        rig.locate("cart", (0, 0, 0))
    with pytest.raises(VitaError):
        rig.locate("card", (0, 0))


def test_close_is_idempotent():
    rig = LockstepRig(SCENARIO)
    rig.close()
    rig.close()
    with pytest.raises(VitaError, match="closed"):
        rig.observe()
