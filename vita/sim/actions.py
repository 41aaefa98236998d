"""What the script (or a person at the page) can do to a simulated scene, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from vita.errors import BadInput, UnknownName
from vita.scenario.actions import PATHS
from vita.sim.camera_view import Cover

if TYPE_CHECKING:
    from vita.sim.camera_view import CameraView
    from vita.sim.world import World


def carry_out(world: World, action: str, arguments: Mapping[str, object]) -> None:
    """Do it now. Raises `BadInput` or `UnknownName` before anything is changed."""
    if action not in ACTIONS:
        raise UnknownName("action", action, ACTIONS)
    run, known, required = ACTIONS[action]
    for name in arguments:
        if name not in known:
            raise UnknownName(f"argument of {action}", name, known)
    for name in required:
        if arguments.get(name) is None:
            raise BadInput(f"{action} needs {name!r}")
    checked = {n: known[n](v, f"{action}.{n}") for n, v in arguments.items() if v is not None}
    run(world, **checked)


# ---- arguments ---------------------------------------------------------------------------------


def _name(value: Any, path: str) -> str:
    if not isinstance(value, str):
        raise BadInput(f"expected a name, got {value!r}", path)
    return value


def _numbers(count: int | None) -> Callable[[Any, str], tuple[float, ...]]:
    def check(value: Any, path: str) -> tuple[float, ...]:
        try:
            array = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            array = np.array(np.nan)
        if array.ndim != 1 or (count and len(array) != count) or not np.isfinite(array).all():
            raise BadInput(f"expected {count or 'some'} finite numbers, got {value!r}", path)
        return tuple(array.tolist())

    return check


def _number(value: Any, path: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not np.isfinite(value):
        raise BadInput(f"expected a finite number, got {value!r}", path)
    return float(value)


def _at_least_0(value: Any, path: str) -> float:
    if _number(value, path) < 0:
        raise BadInput(f"must be 0 or more, got {value}", path)
    return float(value)


def _index(value: Any, path: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise BadInput(f"expected a whole number from 0 on, got {value!r}", path)
    return value


def _path(value: Any, path: str) -> str:
    if value not in PATHS:
        raise UnknownName("path", str(value)[:64], PATHS, path)
    return value


def _view(world: World, camera: str) -> CameraView:
    if camera not in world.views:
        raise UnknownName("camera", camera, world.views)
    return world.views[camera]


# ---- actions -----------------------------------------------------------------------------------


def _move_camera(world: World, camera: str, look_from=None, look_at=None, turn_deg: float = 0.0) -> None:
    """Put a camera elsewhere at once; `turn_deg` rolls it about its optical axis."""
    view = _view(world, camera)
    if view.spec.mount is not None and (look_from or look_at):
        raise BadInput(f"camera {camera!r} rides on {view.spec.mount!r}; it can only be turned (turn_deg)")
    if (look_from or view.spec.look_from) == (look_at or view.spec.look_at) and view.spec.mount is None:
        raise BadInput(f"camera {camera!r} cannot look at the point where it stands")
    view.move(look_from, look_at, turn_deg)


def _freeze_camera(world: World, camera: str, for_s: float = np.inf) -> None:
    """The feed repeats its last picture, byte by byte."""
    _view(world, camera).frozen_until = world.time + for_s


def _unfreeze_camera(world: World, camera: str) -> None:
    _view(world, camera).frozen_until = -np.inf


def _black_camera(world: World, camera: str, for_s: float = np.inf) -> None:
    """The feed goes black."""
    _view(world, camera).black_until = world.time + for_s


def _cover(world: World, camera: str, at, size_px: float = 80.0, for_s: float = np.inf) -> None:
    """Hold a grey card before the lens: a square of `size_px` centred `at` (column, row)."""
    _view(world, camera).covers.append(Cover(at, size_px, world.time + for_s))


def _uncover(world: World, camera: str) -> None:
    """Take away every cover and light a black feed again."""
    view = _view(world, camera)
    view.covers = []
    view.black_until = -np.inf


def _push_robot(world: World, dq_deg) -> None:
    """Displace the arm, joint by joint (the first ones suffice), within its limits."""
    n = world.model.n
    if len(dq_deg) > n:
        raise BadInput(f"{world.model.name} has {n} joints, got {len(dq_deg)}", "push_robot.dq_deg")
    world.push(np.radians([*dq_deg, *[0.0] * (n - len(dq_deg))]))


def _lock_joint(world: World, joint: int) -> None:
    """Hold a joint, counted from 0, where it is: it follows no command any more."""
    if joint >= world.model.n:
        raise BadInput(f"{world.model.name} has joints 0 to {world.model.n - 1}", "lock_joint.joint")
    world.arm.lock(joint)


def _unlock_joints(world: World) -> None:
    world.arm.unlock()


def _drag_target(world: World, object: str, xyz=None, rpy_deg=None, over_s: float = 0.0) -> None:
    """Move an object smoothly to a new place and orientation."""
    world.move_prop(object, xyz, rpy_deg, over_s)


def _carry(
    world: World, object: str, path: str, radius_m: float = 0.1, length_m: float = 0.3,
    speed_m_s: float = 0.1, turn_deg_s: float = 0.0, for_s: float = np.inf,
) -> None:  # fmt: skip
    """Carry an object on and on, until the time is up or somebody drags it elsewhere."""
    world.carry_prop(
        object, path=path, radius_m=radius_m, length_m=length_m, speed_m_s=speed_m_s,
        turn_deg_s=turn_deg_s, for_s=for_s,
    )  # fmt: skip


Checks = dict[str, Callable[[Any, str], Any]]
_CAMERA: Checks = {"camera": _name}
_WHILE: Checks = {"camera": _name, "for_s": _at_least_0}
ACTIONS: dict[str, tuple[Callable[..., None], Checks, tuple[str, ...]]] = {
    "move_camera": (
        _move_camera,
        {"camera": _name, "look_from": _numbers(3), "look_at": _numbers(3), "turn_deg": _number},
        ("camera",),
    ),
    "freeze_camera": (_freeze_camera, _WHILE, ("camera",)),
    "unfreeze_camera": (_unfreeze_camera, _CAMERA, ("camera",)),
    "black_camera": (_black_camera, _WHILE, ("camera",)),
    "cover": (_cover, _WHILE | {"at": _numbers(2), "size_px": _at_least_0}, ("camera", "at")),
    "uncover": (_uncover, _CAMERA, ("camera",)),
    "push_robot": (_push_robot, {"dq_deg": _numbers(None)}, ("dq_deg",)),
    "lock_joint": (_lock_joint, {"joint": _index}, ("joint",)),
    "unlock_joints": (_unlock_joints, {}, ()),
    "drag_target": (
        _drag_target,
        {"object": _name, "xyz": _numbers(3), "rpy_deg": _numbers(3), "over_s": _at_least_0},
        ("object",),
    ),
    "carry": (
        _carry,
        {"object": _name, "path": _path, "for_s": _at_least_0}
        | dict.fromkeys(("radius_m", "length_m", "speed_m_s", "turn_deg_s"), _at_least_0),
        ("object", "path"),
    ),
}
"""Name to function, checks of the arguments, and the arguments that must be there."""
