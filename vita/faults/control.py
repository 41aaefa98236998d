"""Faults of what the servo does (rows C)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from threading import Event

import numpy as np

from vita.errors import BadInput
from vita.faults.registry import injector
from vita.faults.site import Site
from vita.tuning import put_limits
from vita.types import Array, Joint, JointStep, frozen

BACK_S = 3600.0
OVERSHOOTS = 2.3
"""So many times the whole error is removed in each step (C3): the arm should go to and fro for ever."""
GIVES_UP_S = 30.0
"""A controller that hangs comes back after so long, if nothing else ends it [s]."""


@injector("C14")
def hanging_controller(site: Site) -> None:
    """The servo does not come back from its next step."""
    if site.later is None:
        raise BadInput("this fault needs a controller in a thread of its own, as in the app")
    free = Event()

    def hang(step: JointStep) -> JointStep:
        free.wait(GIVES_UP_S)
        return step

    site.tap.step["C14"] = hang
    site.tap.undo["C14"] = free.set


@injector("C15")
def clock_set_back(site: Site) -> None:
    """The clock on the wall goes back by an hour, for this program."""
    real = time.time
    time.time = lambda: real() - BACK_S

    def put_right() -> None:
        time.time = real

    site.tap.undo["C15"] = put_right


EVERY = 10
"""Every so many commands is not a number (C5)."""
FACTOR, TIMES = 100.0, 5
"""So many commands ask for so many times the motion (C7)."""
AHEAD_RAD = 0.04
"""How far away the limit is put into which the arm is pushed (C6), or beyond which it stands (C8) [rad]."""
PUSH_RAD = 0.3
"""How far beyond its limit each command wants a joint (C6) [rad]."""


@injector("C5")
def no_number(site: Site) -> None:
    """Every tenth command has a joint position that is not a number."""
    number = count()

    def spoil(step: JointStep) -> JointStep:
        if next(number) % EVERY:
            return step
        dq = np.array(step.dq)
        dq[busiest_joint(site)] = np.nan
        return replace(step, dq=dq)

    site.tap.step["C5"] = spoil


@injector("C6")
def into_a_limit(site: Site) -> None:
    """A limit is put right ahead of a joint, and every command pushes into it."""
    joint = busiest_joint(site)
    up = _way(site, joint) > 0
    _move_limit(site, "C6", joint, AHEAD_RAD if up else -AHEAD_RAD, upper=up)

    def push(step: JointStep) -> JointStep:
        dq = np.array(step.dq)
        dq[joint] = PUSH_RAD if up else -PUSH_RAD
        return replace(step, dq=dq)

    site.tap.step["C6"] = push


@injector("C7")
def hundredfold(site: Site) -> None:
    """The next commands ask for a hundred times the motion."""
    number = count()

    def grow(step: JointStep) -> JointStep:
        return replace(step, dq=FACTOR * np.asarray(step.dq)) if next(number) < TIMES else step

    site.tap.step["C7"] = grow


@injector("C8")
def outside_a_limit(site: Site) -> None:
    """A limit is moved past a joint, which is then out of its range; inwards is where it was going."""
    joint = busiest_joint(site)
    up = _way(site, joint) > 0
    _move_limit(site, "C8", joint, AHEAD_RAD if up else -AHEAD_RAD, upper=not up)


def busiest_joint(site: Site) -> int:
    """The joint in use that was last asked to move most; the first one in use when none was."""
    engine = site.engine
    used = engine.controller.used if engine.following is None else range(len(engine.rig.joints))
    if not used:
        raise BadInput("no joint is in use")
    step = engine.last_step
    return used[0] if step is None else max(used, key=lambda joint: abs(float(step.dq[joint])))


def _way(site: Site, joint: int) -> float:
    """Which way a joint goes: as it was last asked to, or to where it has more room."""
    step, q, limits = site.engine.last_step, site.engine.observation.q[joint], site.engine.rig.joints[joint]
    asked = 0.0 if step is None else float(step.dq[joint])
    return asked or limits.upper + limits.lower - 2.0 * float(q)


def _move_limit(site: Site, row: str, joint: int, by_rad: float, upper: bool) -> None:
    """Put one limit of a joint `by_rad` from where the joint is, until people mend it."""
    engine = site.engine
    joints: list[Joint] = list(engine.rig.joints)
    old, at = joints[joint], float(engine.observation.q[joint]) + by_rad
    joints[joint] = replace(old, upper=at) if upper else replace(old, lower=at)
    if not joints[joint].lower < joints[joint].upper:
        raise BadInput(f"joint {old.name} is too near its other limit", row)
    engine.rig.set_limits(joints)
    site.tap.undo[row] = lambda: put_limits(engine, engine.limits)


# ---- what the servo itself watches -------------------------------------------------------------------


def _bend(site: Site, row: str, change: Callable[[Array], Array]) -> None:
    """Change every motion that the servo asks for from now on."""
    if site.engine.following is not None:
        raise BadInput("this fault needs the servo of drawn constraints; choose that mode first", row)
    site.tap.step[row] = lambda step: replace(step, dq=frozen(change(step.dq)))


@injector("C1")
def away_from_the_goal(site: Site) -> None:
    """What the servo knows is turned over: the arm drives away from its goal."""
    _mistaken(site, "C1", lambda jacobian: -jacobian)


@injector("C2")
def two_joints_turned_round(site: Site) -> None:
    """Two of the joints in use turn the other way than they are told."""
    used = site.engine.controller.used
    if len(used) < 2:
        raise BadInput("this fault needs two joints in use; choose more joints first", "C2")
    signs = np.ones(len(site.engine.rig.joints))
    signs[list(used[:2])] = -1.0
    _bend(site, "C2", lambda dq: signs * dq)


@injector("C3")
def far_too_high_a_gain(site: Site) -> None:
    """The arm does much more than it is asked for: with the gain of now, 2.3 times the whole error."""
    times = OVERSHOOTS / site.engine.controller.config.gain
    _bend(site, "C3", lambda dq: times * dq)


@injector("C4")
def broken_numbers(site: Site) -> None:
    """What the servo knows is no number any more."""
    _mistaken(site, "C4", lambda jacobian: jacobian * np.nan)


def _mistaken(site: Site, row: str, change: Callable[[Array], Array]) -> None:
    controller = site.engine.controller
    if not controller.jacobian.size:
        raise BadInput("the servo has learned nothing yet; press Start first", row)
    controller.mistake(change)
    site.tap.undo[row] = controller.forget
