"""Random valid scenarios, for the laws that every task file must obey."""

from __future__ import annotations

import contextlib
import math
import string
from typing import Any

from hypothesis import strategies as st

from vita.errors import BadInput
from vita.scenario import names
from vita.scenario.actions import ACTIONS, PATHS
from vita.scenario.lengths import check_lengths
from vita.scenario.schema import (
    AttachSpec,
    CameraSpec,
    ConstraintSpec,
    DistanceSpec,
    ExpectSpec,
    NoiseSpec,
    ObjectSpec,
    Scenario,
    SceneSpec,
    ScriptSpec,
    TrackerSpec,
)
from vita.servo.config import JointLimit, Limits, ServoConfig

NAMES = st.text(string.ascii_letters + string.digits + " _.-", min_size=1, max_size=64)
WORDS = st.text(st.characters(exclude_categories=("Cs",)).filter(str.isprintable), max_size=200)


def number(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high) | st.integers(math.ceil(low), math.floor(high)).map(float)


def vector(size: float, n: int = 3) -> st.SearchStrategy[tuple]:
    return st.tuples(*[number(-size, size)] * n)


POINT, ANGLES = vector(100.0), vector(3600.0)
ALIEN = st.recursive(
    st.booleans() | st.integers(-(2**63) + 1, 2**63 - 1) | number(-1e300, 1e300) | WORDS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=5,
)
"""What another program may have put into a file."""


def unique(draw: Any, spec: Any, most: int, taken: tuple[str, ...] = (), least: int = 0) -> list[str]:
    return draw(
        st.lists(spec.filter(lambda name: name not in taken), unique=True, min_size=least, max_size=most)
    )


@st.composite
def cameras(draw: Any, name: str, links: tuple[str, ...]) -> CameraSpec:
    size = draw(st.tuples(st.integers(16, 4096), st.integers(16, 4096)))
    fov = draw(number(1.0, 170.0))
    if draw(st.booleans()):
        link = draw(st.sampled_from(links))
        return CameraSpec(name, mount=link, xyz=draw(POINT), rpy_deg=draw(ANGLES), fov_deg=fov, size=size)
    stand, target = draw(st.tuples(POINT, POINT).filter(lambda pair: pair[0] != pair[1]))
    return CameraSpec(name, look_from=stand, look_at=target, fov_deg=fov, size=size)


@st.composite
def noises(draw: Any) -> NoiseSpec:
    kind = draw(st.sampled_from(names.noise_kinds()))
    span = st.tuples(number(0, 1e5), number(0, 1e5)).filter(lambda pair: pair[0] != pair[1])
    jump, every = draw(st.just((0.0, 0.0)) | st.tuples(number(1e-6, 1e4), number(1e-6, 1e5)))
    return NoiseSpec(
        kind=kind,
        sigma_px=draw(number(0.0, 100.0)) if kind in ("gaussian", "distance") else 0.0,
        at_m=draw(number(0.01, 100.0)) if kind == "distance" else 1.0,
        drift_px_s=draw(number(0.0, 1e4)),
        occluded=tuple((min(a, b), max(a, b)) for a, b in draw(st.lists(span, max_size=3))),
        jump_px=jump,
        jump_every_s=every,
    )


@st.composite
def trackers(draw: Any, name: str, views: list[CameraSpec], bodies: tuple[str, ...]) -> TrackerSpec:
    camera = draw(st.sampled_from(views))
    kind = draw(st.sampled_from(names.tracker_kinds()))
    size = draw(st.none() | number(4.0, 2000.0))
    attach = AttachSpec(draw(st.sampled_from(bodies)), draw(POINT))
    if kind == "projected":
        noise = draw(st.none() | noises())
        return TrackerSpec(name, camera.name, kind, attach=attach, noise=noise, size_px=size)
    places = st.builds(AttachSpec, st.sampled_from(bodies), POINT).filter(lambda place: place != attach)
    other = draw(places) if kind == "line" else None
    if draw(st.booleans()):
        return TrackerSpec(name, camera.name, kind, attach=attach, attach_to=other, size_px=size)
    pixel = st.tuples(number(0.0, camera.size[0] - 1), number(0.0, camera.size[1] - 1))
    at = draw(pixel)
    to = draw(pixel.filter(lambda end: math.dist(at, end) >= 3)) if kind == "line" else None
    return TrackerSpec(name, camera.name, kind, at=at, to=to, size_px=size)


@st.composite
def settings_of_servo(draw: Any, n: int) -> ServoConfig:
    joints = draw(st.none() | st.lists(st.integers(0, n - 1), min_size=1, unique=True).map(tuple))
    return ServoConfig(
        gain=draw(number(0.01, 2.0)),
        alpha=draw(number(0.0, 1.0)),
        tolerance_px=draw(number(0.01, 20.0)),
        joints=joints,
    )


@st.composite
def scripts(draw: Any, scenario: Scenario, n: int) -> ScriptSpec:
    named = {"camera": scenario.camera, "tracker": scenario.tracker, "object": scenario.scene.objects}
    possible = [
        name
        for name, action in ACTIONS.items()
        if all(named[key] for key in action.arguments if key in named)
    ]
    do = draw(st.sampled_from(possible))
    values: dict[str, Any] = {
        "look_from": POINT, "look_at": POINT, "xyz": POINT, "rpy_deg": ANGLES, "at": vector(1e5, 2),
        "turn_deg": number(-360, 360), "for_s": number(0, 1e3), "over_s": number(0, 1e3),
        "size_px": number(1, 4096), "dq_deg": st.lists(number(-90, 90), min_size=1, max_size=n).map(tuple),
        "field": st.just("servo.gain"), "value": number(0.01, 2.0), "path": st.sampled_from(PATHS),
        "radius_m": number(0, 100), "length_m": number(0, 100), "speed_m_s": number(0, 10),
        "turn_deg_s": number(0, 360), "joint": st.integers(0, n - 1),
    }  # fmt: skip
    for key, specs in named.items():
        values[key] = st.sampled_from([spec.name for spec in specs]) if specs else st.nothing()
    action = ACTIONS[do]
    keys = set(action.required) | set(action.one_of)
    keys |= {key for key in action.arguments if draw(st.booleans())}
    return ScriptSpec(draw(number(0, 1e3)), do, {key: draw(values[key]) for key in sorted(keys)})


@st.composite
def scenarios(draw: Any) -> Scenario:
    """Any valid scenario."""
    robot_name = draw(st.sampled_from(["wam4", "wam7"]))
    robot = names.robot(robot_name)
    n = len(robot.joints)
    kinds = st.sampled_from(names.object_kinds())
    mounts = st.none() | st.sampled_from(robot.links)
    objects = tuple(
        ObjectSpec(name, draw(kinds), draw(POINT), draw(ANGLES), draw(mounts))
        for name in unique(draw, NAMES, 3, ("world", *robot.links))
    )
    bodies = ("world", *robot.links, *(spec.name for spec in objects))
    views = [draw(cameras(name, bodies[1:])) for name in unique(draw, NAMES, 4)]
    marks = [draw(trackers(name, views, bodies)) for name in (unique(draw, NAMES, 8) if views else [])]
    constraints = []
    for name in unique(draw, NAMES, 4):
        kind = draw(st.sampled_from(sorted(names.constraint_kinds())))
        camera = draw(st.sampled_from(views)).name if views else ""
        here = draw(st.permutations([mark for mark in marks if mark.camera == camera]))
        widths = [2 if mark.kind == "line" else 1 for mark in here]
        count = next((n for n in range(1, 5) if names.constraint_fits(kind, widths[:n])), None)
        if count is not None:
            points = tuple(mark.name for mark in here[:count])
            spec = ConstraintSpec(name, kind, points, draw(number(1e-9, 1e3)))
            with contextlib.suppress(BadInput):
                check_lengths(Scenario(tracker=tuple(marks), constraint=(spec,)))
                constraints.append(spec)
    q0 = tuple(draw(number(math.degrees(j.lower), math.degrees(j.upper))) for j in robot.joints)
    scenario = Scenario(
        title=draw(WORDS),
        description=draw(WORDS),
        seed=draw(st.integers(0, 2**63 - 1)),
        scene=SceneSpec(
            robot=robot_name,
            q0_deg=draw(st.none() | st.just(q0)),
            tool=draw(st.sampled_from(names.tools())),
            objects=objects,
            table=draw(st.booleans()),
            dead_band_deg=draw(number(0, 45)),
            image_noise=draw(number(0, 255)),
        ),
        camera=tuple(views),
        tracker=tuple(marks),
        constraint=tuple(constraints),
        servo=draw(settings_of_servo(n)),
        limits=Limits(speed_rad_s=draw(number(0.01, 3)), joint=draw(joint_limits(n))),
        extra=draw(st.dictionaries(WORDS.map("x-{}".format), ALIEN, max_size=2)),
    )
    script = tuple(draw(st.lists(scripts(scenario, n), max_size=3)))
    expect = draw(st.none() | expectations((*bodies, *(f"camera:{view.name}" for view in views))))
    return Scenario(**(vars(scenario) | {"script": script, "expect": expect}))


@st.composite
def joint_limits(draw: Any, n: int) -> tuple[JointLimit, ...]:
    chosen = draw(st.lists(st.integers(0, n - 1), max_size=2, unique=True))
    upper = st.none() | number(400, 1000)
    return tuple(JointLimit(j, draw(number(-1000, -400)), draw(upper), draw(number(0.01, 3))) for j in chosen)


@st.composite
def expectations(draw: Any, bodies: tuple[str, ...]) -> ExpectSpec:
    some = st.none() | number(0, 1e3)
    body = st.sampled_from(bodies)
    return ExpectSpec(
        outcome=draw(st.none() | st.sampled_from(names.OUTCOMES)),
        reason=draw(st.none() | st.sampled_from(["tracker_lost", "diverged"])),
        within_s=draw(some),
        final_error_px=draw(some),
        final_distance_mm=draw(st.none() | st.builds(DistanceSpec, body, body, number(0, 1e3), POINT, POINT)),
        max_joint_motion_after_deg=draw(some),
    )
