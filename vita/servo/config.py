"""The servo's settings, defined once: they feed file validation, `--set`, the sliders and the docs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from vita.errors import BadInput, UnknownName
from vita.servo.estimators import ESTIMATORS
from vita.servo.freedom import FREE_MOTIONS
from vita.servo.policies import POLICIES
from vita.servo.secondary import SECONDARIES


def setting(
    default: Any, low: float, high: float, unit: str, label: str, doc: str, *, live: bool = True
) -> Any:
    """A dataclass field with its range, unit and words for people in the metadata."""
    return field(
        default=default,
        metadata={"low": low, "high": high, "unit": unit, "label": label, "doc": doc, "live": live},
    )


def choice(default: str, choices: Callable[[], Mapping[str, Any]], label: str, doc: str) -> Any:
    """A dataclass field that names one of the registered kinds that `choices()` returns. Each has a
    `title` and a `doc` for people."""
    return field(default=default, metadata={"choices": choices, "label": label, "doc": doc, "live": True})


def check_choices(config: Any, path: str) -> None:
    """Raise `UnknownName` for the first field of `config` that names no registered kind."""
    for f in fields(config):
        if "choices" in f.metadata:
            known, value = f.metadata["choices"](), getattr(config, f.name)
            if value not in known:
                raise UnknownName(f.metadata["label"].lower(), str(value), known, f"{path}.{f.name}")


def check_ranges(config: Any, path: str) -> None:
    """Raise `BadInput` naming the first numeric field of `config` outside its range."""
    for f in fields(config):
        meta = f.metadata
        if "low" not in meta:
            continue
        value = getattr(config, f.name)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise BadInput(f"expected a number, got {value!r}", f"{path}.{f.name}")
        if not meta["low"] <= value <= meta["high"]:  # NaN fails both comparisons
            unit = f" {meta['unit']}" if meta["unit"] else ""
            raise BadInput(f"{value} is outside {meta['low']} to {meta['high']}{unit}", f"{path}.{f.name}")


def range_of(config: type, name: str) -> float:
    """How far a setting can go, from its lowest to its highest value."""
    meta = next(f.metadata for f in fields(config) if f.name == name)
    return float(meta["high"] - meta["low"])


@dataclass(frozen=True)
class ServoConfig:
    """What a person may tune; the `[servo]` table of a scenario file. Angles are in degrees,
    as in the file."""

    estimator: str = choice(
        "kalman", lambda: ESTIMATORS, "Estimator", "How the image Jacobian is learned from motion."
    )
    policy: str = choice(
        "uncertainty", lambda: POLICIES, "Step policy", "How long a step is taken from what is known."
    )
    gain: float = setting(
        0.3, 0.01, 2.0, "", "Gain lambda", "Share of the error that one step tries to remove (eq. 2.15)."
    )
    alpha: float = setting(
        0.3, 0.0, 1.0, "", "Learning rate alpha", "How much of each Broyden update is taken (eq. 2.18)."
    )
    forgetting: float = setting(
        0.98, 0.5, 1.0, "", "Forgetting", "What recursive least squares keeps of the past at each update."
    )
    explore_deg: float = setting(
        0.0, 0.0, 15.0, "deg", "Exploration size",
        "Joint motion of each exploratory move (eq. 2.17); 0 chooses it by the trackers' noise.",
    )
    explore_px: float = setting(
        0.0, 0.0, 200.0, "px", "Exploration in the image",
        "How far each move should move the image instead; 0 goes by the joint motion.",
    )
    damping: float = setting(
        0.02, 0.0, 0.5, "", "Damping", "Damping of the inverse, relative to the largest singular value."
    )
    tolerance_px: float = setting(
        0.5, 0.01, 20.0, "px", "Done within", "Converged when every error component is below this."
    )
    timeout_s: float = setting(60.0, 0.5, 3600.0, "s", "Give up after", "Longest time from Start to done.")
    secondary: str = choice(
        "none", lambda: SECONDARIES, "Also", "What joint motion that the task leaves free is used for."
    )
    free_motions: str = choice(
        "allow", lambda: FREE_MOTIONS, "Motions left free",
        "What becomes of joint motion that no constraint holds.",
    )
    moving_goal: float = setting(
        0.0, 0.0, 1.0, "", "Moving goal",
        "1 learns how fast the goal moves by itself and goes along with it; 0 takes it to stand still.",
    )
    joints: tuple[int, ...] | None = None
    """Indices of the joints that the servo may use; None means all."""
    posture_deg: tuple[float, ...] | None = None
    """Joint positions that the secondary objective `posture` prefers; None is where the run started."""

    def __post_init__(self) -> None:
        check_ranges(self, "servo")
        check_choices(self, "servo")
        if self.joints is not None:
            joints = tuple(self.joints)
            if not joints:
                raise BadInput("name at least one joint, or leave it out to use all", "servo.joints")
            for j in joints:
                if isinstance(j, bool) or not isinstance(j, int) or j < 0:
                    raise BadInput(f"{j!r} is not a joint index (0, 1, ...)", "servo.joints")
            if len(set(joints)) != len(joints):
                raise BadInput(f"a joint is listed twice in {list(joints)}", "servo.joints")
            object.__setattr__(self, "joints", joints)


@dataclass(frozen=True)
class JointLimit:
    """Overrides of one joint's limits; None keeps the robot's own value."""

    joint: int
    lower_deg: float | None = None
    upper_deg: float | None = None
    speed_rad_s: float | None = None


@dataclass(frozen=True)
class Limits:
    """The `[limits]` table: what the gate enforces, never wider than the robot's own limits."""

    speed_rad_s: float = setting(
        0.6, 0.01, 3.0, "rad/s", "Top joint speed", "No joint moves faster than this."
    )
    explore_speed_rad_s: float = setting(
        0.3, 0.01, 3.0, "rad/s", "Exploring speed", "Top joint speed of exploratory moves."
    )
    acceleration_rad_s2: float = setting(
        8.0, 0.5, 50.0, "rad/s2", "Top acceleration", "Joint acceleration bound, braking included."
    )
    joint: tuple[JointLimit, ...] = ()

    def __post_init__(self) -> None:
        check_ranges(self, "limits")
        object.__setattr__(self, "joint", tuple(self.joint))
