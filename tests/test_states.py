"""Laws of the states: the whole table on the real engine, and the rules over sequences of everything."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np
import pytest
from sim_rig import KinematicRig, scenario

from vita import commands as cmd
from vita import states
from vita.engine import HELD_MEANWHILE, Engine
from vita.errors import NotNow, RigOffline
from vita.fuzz.events import Mob
from vita.fuzz.stick_rig import StickRig, stick_task
from vita.orders import ORDERS
from vita.types import MOVING_STATES, Status


def engine() -> Engine:
    return Engine(KinematicRig(), scenario())  # type: ignore[arg-type]


def rig_of(e: Engine) -> KinematicRig:
    return cast(KinematicRig, e.rig)


def until(e: Engine, state: str) -> Engine:
    for _ in range(600):
        if e.tick().status.state == state:
            return e
    raise AssertionError(f"{state} was not reached: {e.status}")


def in_state(state: str) -> Engine:
    """An engine that has come into a state as engines do."""
    e = engine()
    e.tick()
    if state in ("learning", "servoing", "hold", "done"):
        e.apply(cmd.Start())
        until(e, {"hold": "learning"}.get(state, state))
    if state == "hold":
        e.stop()
    elif state == "fault":
        e.fail("internal_error", "made by the test")
    elif state == "estop":
        e.estop()
    elif state == "offline":
        e.lose("made by the test")
    return e


def rebuilt(e: Engine) -> Engine:
    """What the runner does when a rig is to be built anew."""
    fresh = engine()
    fresh.resume(e)
    return fresh


def do(e: Engine, event: str) -> Engine:
    """Make an event happen; the engine that goes on from there."""
    commands: dict[str, cmd.Command] = {
        "start": cmd.Start(),
        "acknowledge": cmd.Acknowledge(),
        "reset": cmd.Reset(confirm=True),
        "reset unconfirmed": cmd.Reset(),
        "edit": cmd.SetWeight("meet left", 2.0),
        "load": cmd.LoadTask(scenario()),
        "reset_arm": cmd.ResetArm(),
        "mode": cmd.SetMode("uvs"),
        "setting": cmd.SetServo("gain", 0.2),
        "limits": cmd.SetLimits("speed_rad_s", 0.4),
        "perform": cmd.Perform("wave", {}),
        "inject": cmd.Inject("C15"),
        "mend": cmd.Mend(),
    }
    happens: dict[str, Callable[[], object]] = {
        "stop": e.stop,
        "estop": e.estop,
        "driver_left": lambda: e.stop("driver_left"),
        "robot_lost": lambda: e.lose("made by the test"),
        "robot_back": e.tick,
        "failed": lambda: e.fail("internal_error", "made by the test"),
        "held": lambda: e.hold("stalled"),
        "reached": lambda: e.hold("converged", tolerance=0.5),
        "learned": lambda: until(e, "servoing") if e.status.state == "learning" else e.tick(),
        "unlearned": lambda: (setattr(e.controller, "_labels", ()), e.tick()),
    }
    if event in ("load", "reset_arm") and e.status.state == "offline":
        e.check(commands[event])
        return rebuilt(e)
    if event in happens:
        happens[event]()
    else:
        assert states.event_of(commands[event]) == event
        e.apply(commands[event])
    return e


@pytest.mark.parametrize("state", states.STATES)
@pytest.mark.parametrize("event", states.EVENTS)
def test_every_event_in_every_state_leads_where_the_table_says(event: str, state: str) -> None:
    if (event, state) in (("learned", "offline"), ("unlearned", "offline")):
        return  # Without a robot there is no period in which it could be noticed.
    e = in_state(state)
    assert e.status.state == state
    q, cell = rig_of(e).q.copy(), states.TABLE[event][e.status.state]
    try:
        if isinstance(cell, str):
            before, status = e.editor.task, e.status
            with pytest.raises(NotNow) as refusal:
                do(e, event)
            assert str(refusal.value) == cell, "the refusal is the table's sentence"
            assert e.status is status and e.editor.task is before
        else:
            after = do(e, event)
            assert after.status.state == cell[0] and after.moving == (cell[0] in MOVING_STATES)
            if state not in MOVING_STATES and cell[0] not in MOVING_STATES:
                if event not in ("load", "reset_arm"):
                    np.testing.assert_array_equal(rig_of(after).q, q)
                after.tick()
                assert rig_of(after).commands[-1] is None, "nothing moves outside of the moving states"
    finally:
        e.tap.mend()


def test_the_table_is_whole_and_names_every_command() -> None:
    assert all(set(row) == set(states.STATES) for row in states.TABLE.values())
    assert {states.event_of(command()) for command in (cmd.Start, cmd.Halt, cmd.Reset)} <= set(states.EVENTS)
    assert set(ORDERS) == {*states._EVENT_OF, cmd.Reset}
    for row in states.TABLE.values():
        for cell in row.values():
            assert isinstance(cell, str) or set(cell) <= set(states.STATES)


def test_only_start_and_learning_lead_into_motion() -> None:
    into = {
        event
        for event, row in states.TABLE.items()
        for state, cell in row.items()
        if state not in MOVING_STATES and not isinstance(cell, str) and set(cell) & set(MOVING_STATES)
    }
    assert into == {"start"}


def test_stop_and_estop_and_a_lost_robot_end_motion_from_every_state_and_are_idempotent() -> None:
    for event in ("stop", "estop", "robot_lost"):
        for state, cell in states.TABLE[event].items():
            assert not isinstance(cell, str) and not set(cell) & set(MOVING_STATES)
            assert states.TABLE[event][cell[0]] == cell or state == cell[0]


def test_a_fault_and_an_emergency_stop_have_one_way_out_each() -> None:
    def leave(state: str) -> set[str]:
        rows = states.TABLE.items()
        return {event for event, row in rows if not isinstance(row[state], str) and row[state] != (state,)}  # type: ignore[index]

    assert leave("fault") == {"acknowledge", "estop", "robot_lost"} and leave("estop") == {"reset"}


def test_an_emergency_stop_outlives_a_lost_robot_a_new_rig_and_everything_else() -> None:
    e = in_state("estop")
    e.lose("gone")
    assert e.status.state == "estop"
    e = rebuilt(e)
    assert e.status.state == "estop" and rig_of(e).stopped, "the new gate is latched as well"
    e.fail("internal_error", "x")
    e.tick()
    assert e.status.state == "estop"
    e.apply(cmd.Reset(confirm=True))
    assert e.status.state == "idle"


def test_an_emergency_stop_is_latched_though_the_rig_cannot_be_told() -> None:
    e = in_state("servoing")

    def gone(*_: object) -> None:
        raise RigOffline("the process has ended")

    rig_of(e).command = gone  # type: ignore[method-assign]
    rig_of(e).stop_now = gone  # type: ignore[method-assign]
    e.estop()
    assert e.status.state == "estop" and not e.moving
    e.apply(cmd.Reset(confirm=True))
    assert e.status.state == "offline", "and what is beneath shows when it is reset"


def test_a_fault_is_still_there_when_the_robot_is_back() -> None:
    e = in_state("fault")
    e.lose("gone")
    assert e.status.state == "offline"
    e.tick()
    assert e.status.state == "fault"
    with pytest.raises(NotNow, match="acknowledge"):
        e.apply(cmd.Start())


def test_a_robot_that_comes_back_does_not_move_by_itself() -> None:
    e = in_state("servoing")
    e.lose("gone", silent_s=1.2)
    q = rig_of(e).q.copy()
    for _ in range(10):
        snapshot = e.tick()
    assert snapshot.status.state == "hold" and "1200 ms" in snapshot.status.message
    np.testing.assert_array_equal(rig_of(e).q, q)
    assert rig_of(e).stopped, "whatever was asked for before is void"


def test_clicks_from_before_a_change_of_state_are_refused_and_values_are_not() -> None:
    for state in ("idle", "hold", "done"):
        e = in_state(state)
        seen = e.tick().revision
        e.stop()  # Also where nothing moves: whoever clicked before has not seen it.
        task = e.editor.task
        load = cmd.LoadTask(scenario())
        for click in (cmd.Start(), cmd.Acknowledge(), cmd.ClearTask(), load, cmd.ResetArm()):
            with pytest.raises(NotNow, match="held meanwhile"):
                e.apply(click, seen)
        assert e.status.state == state and e.editor.task is task
        e.apply(cmd.SetServo("gain", 0.11), seen)
        e.apply(cmd.SetLimits("speed_rad_s", 0.3), seen)
        assert e.present().servo.gain == 0.11 and e.present().limits.speed_rad_s == 0.3
        e.apply(cmd.Start(), e.tick().revision)
        assert e.moving


def test_a_stale_reset_does_not_lift_an_emergency_stop() -> None:
    e = in_state("estop")
    seen = e.tick().revision
    e.estop(culprit="pressed again")
    with pytest.raises(NotNow, match="held meanwhile"):
        e.apply(cmd.Reset(confirm=True), seen)
    assert e.status.state == "estop" and "pressed at the page" in e.status.message, "the first reason stays"


def test_several_edits_of_one_click_are_taken_though_the_first_makes_it_idle() -> None:
    e = in_state("done")
    seen = e.tick().revision
    e.apply(cmd.SetWeight("meet left", 2.0), seen)
    assert e.status.state == "idle"
    e.apply(cmd.SetWeight("meet right", 2.0), seen)
    e.apply(cmd.Start(), seen)
    assert e.moving


def test_the_second_of_two_starts_on_one_revision_is_no_second_start() -> None:
    e = in_state("idle")
    seen = e.tick().revision
    e.apply(cmd.Start(), seen)
    for _ in range(3):
        e.tick()
    progress = e.active.progress
    e.apply(cmd.Start(), seen)
    assert e.status.state == "learning" and e.active.progress == progress != ""


def test_choosing_a_mode_does_not_bring_back_what_its_controller_last_said() -> None:
    e = in_state("done")
    e.apply(cmd.SetMode("uvs"))
    assert e.status == Status()


def test_an_unknown_state_of_the_table_cannot_be_asked_for() -> None:
    with pytest.raises(NotNow, match="press Reset and confirm"):
        states.following("start", "estop")
    assert states.permits_motion("servoing") and not states.permits_motion("hold")
    assert HELD_MEANWHILE.startswith("held meanwhile")


@pytest.mark.parametrize("hundred", range(10))
def test_a_thousand_sequences_from_three_clients_keep_the_rules(hundred: int) -> None:
    """Each of up to 60 events; the rules are checked after every one of them (`vita.fuzz.events`)."""
    moved = 0
    for seed in range(100 * hundred, 100 * hundred + 100):
        mob = Mob(StickRig, stick_task(), seed)
        for _ in range(int(mob.rng.integers(1, 61))):
            mob.event()
        assert mob.violations == [], f"seed {seed}: {mob.violations}; {mob.story[-8:]}"
        moved += mob.figures["started"]
    assert moved > 50, "sequences in which the arm never moves would prove nothing"


@pytest.mark.parametrize(
    "broken", ["stop does nothing", "acknowledge starts", "anyone starts", "acknowledge resets"]
)
def test_the_rules_would_notice_an_engine_that_breaks_them(broken: str, monkeypatch) -> None:
    if broken == "stop does nothing":
        monkeypatch.setattr(Engine, "stop", lambda self, *a, **k: None)
    elif broken == "acknowledge starts":
        monkeypatch.setitem(ORDERS, cmd.Acknowledge, ORDERS[cmd.Start])
    elif broken == "anyone starts":
        monkeypatch.setattr(Mob, "may_start", lambda self, client: True)
    elif broken == "acknowledge resets":
        row = {**states.TABLE["acknowledge"], "estop": ("idle",)}
        monkeypatch.setitem(states.TABLE, "acknowledge", row)  # type: ignore[arg-type]
        monkeypatch.setitem(ORDERS, cmd.Acknowledge, lambda e, _: e.lift_estop())
    for seed in range(200):
        mob = Mob(StickRig, stick_task(), seed)
        for _ in range(60):
            mob.event()
        if mob.violations:
            return
    raise AssertionError("200 sequences did not notice it")
