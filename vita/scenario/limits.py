"""Bounds on everything that a scenario file can hold: counts, lengths of text, sizes of numbers.

The bounds are far outside every sensible task. They exist so that a slip of the keyboard, or a
hostile file, ends in a sentence rather than in gigabytes of image or an arm at 1e300 metres.
The ranges of `[servo]` and `[limits]` stand beside their fields in `vita.servo.config`.
"""

from __future__ import annotations

import re

from vita.errors import BadInput
from vita.scenario.schema import NoiseSpec, Scenario
from vita.scenario.typed import join, number, shown, text

NAME = re.compile(r"[A-Za-z0-9 _.-]{1,64}")
COUNTS = {"camera": 4, "tracker": 64, "constraint": 64, "script": 256}
LONGEST_TEXT = 4000
"""Of the description, and of every text under an `x-` key [characters]."""
_METRES, _DEGREES, _PIXELS, _SECONDS = (-100.0, 100.0), (-3600.0, 3600.0), (-1e5, 1e5), (0.0, 1e5)
_SIZE_PX, _SPEED = (4.0, 2000.0), (0.01, 3.0)


def check_numbers(scenario: Scenario) -> None:
    """Raise `BadInput` on the first value out of bounds."""
    for key, most in COUNTS.items():
        if len(getattr(scenario, key)) > most:
            raise BadInput(f"at most {most} are possible, got {len(getattr(scenario, key))}", key)
    if len(scenario.scene.objects) > 64:
        raise BadInput(f"at most 64 are possible, got {len(scenario.scene.objects)}", "scene.objects")
    _words(scenario.title, 200, "title")
    _words(scenario.description, LONGEST_TEXT, "description", "\n\t")
    _between(scenario.seed, (0, 2**63 - 1), "seed")
    _scene(scenario)
    _trackers(scenario)
    _script(scenario)
    _expect(scenario)
    _extra(scenario)


def _between(value: object, bounds: tuple[float, float], path: str) -> None:
    """Check a number, or each of a vector; None is left alone."""
    if value is None:
        return
    if isinstance(value, tuple):
        for i, item in enumerate(value):
            _between(item, bounds, f"{path}[{i}]")
        return
    assert isinstance(value, (int, float))
    if not bounds[0] <= value <= bounds[1]:  # NaN fails both comparisons
        raise BadInput(f"{shown(value)} is outside {bounds[0]:g} to {bounds[1]:g}", path)


def _short(value: str, path: str, longest: int = LONGEST_TEXT) -> None:
    if len(value) > longest:
        raise BadInput(f"at most {longest} characters are possible, got {len(value)}", path)


def _words(value: str, longest: int, path: str, allowed: str = "") -> None:
    _short(value, path, longest)
    for c in value:
        if not c.isprintable() and c not in allowed:
            raise BadInput(f"holds the control character {c!r}", path)


def _name(value: str, path: str) -> None:
    if not NAME.fullmatch(value):
        raise BadInput(
            f"{shown(value)} is not a name: use 1 to 64 letters, digits, spaces and _ . - only", path
        )


def _scene(scenario: Scenario) -> None:
    scene = scenario.scene
    _words(scene.robot, 1000, "scene.robot")
    _between(scene.q0_deg, _DEGREES, "scene.q0_deg")
    _between(scene.dead_band_deg, (0.0, 45.0), "scene.dead_band_deg")
    _between(scene.image_noise, (0.0, 255.0), "scene.image_noise")
    _between(scene.depth_noise_mm, (0.0, 100.0), "scene.depth_noise_mm")
    for i, spec in enumerate(scene.objects):
        path = f"scene.objects[{i}]"
        _name(spec.name, f"{path}.name")
        _between(spec.xyz, _METRES, f"{path}.xyz")
        _between(spec.rpy_deg, _DEGREES, f"{path}.rpy_deg")
    for i, camera in enumerate(scenario.camera):
        path = f"camera[{i}]"
        _name(camera.name, f"{path}.name")
        for key in ("look_from", "look_at", "xyz"):
            _between(getattr(camera, key), _METRES, f"{path}.{key}")
        _between(camera.rpy_deg, _DEGREES, f"{path}.rpy_deg")
        _between(camera.fov_deg, (1.0, 170.0), f"{path}.fov_deg")
        _between(camera.size, (16, 4096), f"{path}.size")
    for i, limit in enumerate(scenario.limits.joint):
        path = f"limits.joint[{i}]"
        _between(limit.lower_deg, _DEGREES, f"{path}.lower_deg")
        _between(limit.upper_deg, _DEGREES, f"{path}.upper_deg")
        _between(limit.speed_rad_s, _SPEED, f"{path}.speed_rad_s")


def _trackers(scenario: Scenario) -> None:
    for i, tracker in enumerate(scenario.tracker):
        path = f"tracker[{i}]"
        _name(tracker.name, f"{path}.name")
        _between(tracker.at, _PIXELS, f"{path}.at")
        _between(tracker.to, _PIXELS, f"{path}.to")
        _between(tracker.size_px, _SIZE_PX, f"{path}.size_px")
        if tracker.attach is not None:
            _between(tracker.attach.point, _METRES, f"{path}.attach.point")
        if tracker.attach_to is not None:
            _between(tracker.attach_to.point, _METRES, f"{path}.attach_to.point")
        if tracker.noise is not None:
            _noise(tracker.noise, f"{path}.noise")
    for i, constraint in enumerate(scenario.constraint):
        _name(constraint.name, f"constraint[{i}].name")
        _between(constraint.weight, (0.0, 1e3), f"constraint[{i}].weight")
        if constraint.weight == 0:
            raise BadInput("must be above 0; delete the constraint instead", f"constraint[{i}].weight")
        _between(constraint.priority, (1, 9), f"constraint[{i}].priority")


def _noise(noise: NoiseSpec, path: str) -> None:
    _between(noise.sigma_px, (0.0, 100.0), f"{path}.sigma_px")
    _between(noise.at_m, (0.01, 100.0), f"{path}.at_m")
    _between(noise.drift_px_s, (0.0, 1e4), f"{path}.drift_px_s")
    _between(noise.jump_px, (0.0, 1e4), f"{path}.jump_px")
    _between(noise.jump_every_s, _SECONDS, f"{path}.jump_every_s")
    if len(noise.occluded) > 256:
        raise BadInput(f"at most 256 are possible, got {len(noise.occluded)}", f"{path}.occluded")
    _between(noise.occluded, _SECONDS, f"{path}.occluded")


_ARGUMENTS = {
    "look_from": _METRES, "look_at": _METRES, "xyz": _METRES, "rpy_deg": _DEGREES, "turn_deg": _DEGREES,
    "dq_deg": _DEGREES, "at": _PIXELS, "size_px": (1.0, 4096.0), "for_s": _SECONDS, "over_s": _SECONDS,
    "radius_m": (0.0, 100.0), "length_m": (0.0, 100.0), "speed_m_s": (0.0, 10.0), "turn_deg_s": (0.0, 360.0),
}  # fmt: skip


def _script(scenario: Scenario) -> None:
    for i, entry in enumerate(scenario.script):
        _between(entry.at_s, _SECONDS, f"script[{i}].at_s")
        for key, value in entry.arguments.items():
            if key in _ARGUMENTS and isinstance(value, (tuple, int, float)):
                _between(value, _ARGUMENTS[key], f"script[{i}].{key}")


def _expect(scenario: Scenario) -> None:
    expect = scenario.expect
    if expect is None:
        return
    for i, follow in enumerate(expect.follow):
        for key in ("from_s", "until_s", "rms_mm", "rms_deg", "mean_mm"):
            _between(getattr(follow, key), _SECONDS, f"expect.follow[{i}].{key}")
    for i, clearance in enumerate(expect.clearance):
        _between(clearance.min, (-1e5, 1e5), f"expect.clearance[{i}].min")
    for key in ("within_s", "final_error_px", "max_joint_motion_after_deg", "recovered_mm"):
        _between(getattr(expect, key), _SECONDS, f"expect.{key}")
    if expect.final_distance_mm is not None:
        path = "expect.final_distance_mm"
        _between(expect.final_distance_mm.max, (0.0, 1e5), f"{path}.max")
        _between(expect.final_distance_mm.point, _METRES, f"{path}.point")
        _between(expect.final_distance_mm.at, _METRES, f"{path}.at")
        if expect.final_distance_mm.along is not None:
            _between(expect.final_distance_mm.along, (-1.0, 1.0), f"{path}.along")
            if not any(expect.final_distance_mm.along):
                raise BadInput("a direction cannot be zero", f"{path}.along")


MOST_EXTRA, DEEPEST_EXTRA = 2000, 8
"""How many values the `x-` keys may hold altogether, and how deep they may lie."""


def _extra(scenario: Scenario) -> None:
    """What other programs put into the file must be what every TOML writer can write back the same."""
    left = MOST_EXTRA
    todo: list[tuple[object, str, int]] = [(scenario.extra, "", 0)]
    while todo:
        value, path, depth = todo.pop()
        left -= 1
        if left < 0 or depth > DEEPEST_EXTRA:
            most = f"{MOST_EXTRA} values, {DEEPEST_EXTRA} deep"
            raise BadInput(f"at most {most}, are possible under x- keys", path)
        if isinstance(value, dict):
            for key in value:
                _short(text(key, path), path, 200)
            todo += [(v, join(path, k), depth + 1) for k, v in value.items()]
        elif isinstance(value, list):
            todo += [(v, f"{path}[{i}]", depth + 1) for i, v in enumerate(value)]
        elif isinstance(value, str):
            _short(text(value, path), path)
        elif not isinstance(value, bool):
            if not isinstance(value, (int, float)):
                wanted = "text, numbers, true or false, lists and tables"
                raise BadInput(f"expected {wanted}, got {shown(value)}", path)
            number(value, path)
