"""The servo as a state machine: one call per control period, no clock, no thread, no robot.

`VisualServo` drives it with any robot and any measurement; the engine drives it with trackers.
Both therefore run the same law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vita.servo.blame import unseen, worst_row
from vita.servo.broyden import BroydenEstimator
from vita.servo.config import ServoConfig
from vita.servo.dropout import HALF_SPEED, RowWatch
from vita.servo.explore import Exploration, Exploring, JointStuck, Sample, explore
from vita.servo.law import Inverse, control_step
from vita.servo.monitors import Convergence, DeadBand, Divergence, Stall
from vita.servo.reasons import status_for
from vita.types import MOVING_STATES, Array, ErrorVector, Joint, RowLabel, Status, frozen

MIN_EFFECT_PX = 0.3
"""An exploratory motion that moves the image by less than this has told nothing."""
AT_LIMIT_RAD = np.radians(0.1)


@dataclass(frozen=True)
class Decision:
    """What the controller wants for the next control period."""

    dq: Array
    """(n,) joint motion from the measured position [rad]."""
    exploring: bool = False
    speed_scale: float = 1.0
    """Share of the speed limits that may be used."""


class Controller:
    """Learns the image Jacobian, then drives the error to zero."""

    def __init__(self, joints: Sequence[Joint], config: ServoConfig | None = None) -> None:
        self.joints = tuple(joints)
        self.config = config or ServoConfig()
        self.status = Status()
        self.progress = ""
        self.singular_values: Array = frozen([])
        self._labels: tuple[RowLabel, ...] = ()
        self._estimator: BroydenEstimator | None = None
        self._exploration: Exploration | None = None
        self._request: Exploring | None = None
        self._started_s: float | None = None
        self._even_if_met = False
        self._fresh_run()

    def _fresh_run(self) -> None:
        self._converged, self._diverged = Convergence(), Divergence()
        self._stalled, self._dead_band = Stall(), DeadBand()
        self._rows = RowWatch()
        self._gain_boost = 1.0

    # ---- what people can ask -------------------------------------------------------------------

    @property
    def moving(self) -> bool:
        return self.status.state in MOVING_STATES

    @property
    def jacobian(self) -> Array:
        """(m, n) estimate [px/rad], read-only; (0, n) before it is learned."""
        if self._estimator is None:
            return frozen(np.zeros((0, len(self.joints))))
        return frozen(self._estimator.jacobian)

    @property
    def used(self) -> tuple[int, ...]:
        """Indices of the joints in use."""
        n = len(self.joints)
        return tuple(j for j in (self.config.joints or range(n)) if j < n)

    def start(self, *, relearn: bool = True, even_if_met: bool = False) -> None:
        """Go to learning, or straight to servoing when the Jacobian may be kept and is known.

        A task that is already met is done without any motion, unless `even_if_met`.
        """
        self._fresh_run()
        self._even_if_met = even_if_met
        self._exploration = self._request = None
        self._started_s = None
        if relearn or self._estimator is None:
            self._estimator = None
            self.status = Status("learning", "", "Learning how each joint moves the image.")
        else:
            self._estimator.restart()
            self.status = Status("servoing", "", "Moving to the goal.")

    def halt(self, reason: str, **facts: object) -> None:
        """Leave motion for the state that `reason` leads to; a fault is not overwritten."""
        if self.status.state != "fault":
            self.status = status_for(reason, **facts)
        self.progress = ""
        self._exploration = self._request = None

    def acknowledge(self) -> None:
        """Leave a fault, a hold or done for idle. Never moves the arm."""
        if not self.moving:
            self.status = Status()

    def forget(self) -> None:
        """Drop the Jacobian: the task or the cameras have changed."""
        self._estimator, self._labels = None, ()

    # ---- one control period --------------------------------------------------------------------

    def tick(self, stamp: float, q: Array, error: ErrorVector, lost: str = "") -> Decision | None:
        """Take the measurement of time `stamp` [s] and answer with the next motion; None is rest.

        `lost` names what cannot be seen, for people; without it the constraints are named.
        """
        if not self.moving:
            return None
        if not np.isfinite(q).all():
            self.halt("bad_measurement")
            return None
        if self._started_s is None:
            self._started_s = stamp
        if self._estimator is not None and self._labels != error.labels:
            self.start(relearn=True)  # An edit between two runs makes the old Jacobian useless.
            self._started_s = stamp
        if not self._enough(error, lost):
            return None
        if stamp - self._started_s > self.config.timeout_s:
            self.halt("timeout", timeout=self.config.timeout_s, error=error.largest)
            return None
        try:
            if self.status.state == "learning":
                return self._learn(q, error)
            return self._servo(q, error)
        except (np.linalg.LinAlgError, FloatingPointError) as failure:
            self.halt("numerical", culprit=str(failure))
            return None

    def _enough(self, error: ErrorVector, lost: str) -> bool:
        """Whether the rows that are seen hold the arm; says so when some are missing."""
        known = self._estimator is not None
        jacobian = error.weights[:, None] * self.jacobian[:, list(self.used)] if known else None
        why = self._rows.update(error, jacobian)
        if why:
            self.halt("tracker_lost", culprit=lost or unseen(error), why=why)
            return False
        if self._rows.changed:
            # The norm of other rows is another quantity: neither progress nor divergence.
            self._diverged, self._stalled = Divergence(), Stall()
        if self._rows.degraded:
            self.status = self._rows.status(lost or unseen(error))
        elif self.status.degraded:
            self.status = Status("servoing", "", "Moving to the goal.")
        return True

    # ---- learning ------------------------------------------------------------------------------

    def _learn(self, q: Array, error: ErrorVector) -> Decision | None:
        sample = Sample(q.copy(), error.values.copy())
        if self._already_there(error):
            return None
        try:
            if self._exploration is None:
                self._labels = error.labels
                delta = np.radians(self.config.explore_deg)
                self._exploration = explore(sample, self.joints, self.used, delta)
                self._request = next(self._exploration)
            else:
                self._request = self._exploration.send(sample)
        except StopIteration as finished:
            return self._learned(q, error, finished.value)
        except JointStuck as stuck:
            self.halt("joint_stuck", culprit=f"Joint {self.joints[stuck.joint].name}")
            return None
        request = self._request
        self.progress = (
            f"learning joint {self.joints[request.joint].name} ({request.number + 1} of {request.total})"
        )
        return Decision(request.target - q, exploring=True)

    def _already_there(self, error: ErrorVector) -> bool:
        """A task that is met before the first motion is done without any."""
        met = error.largest <= self.config.tolerance_px
        if self._exploration is None and met and not self._even_if_met:
            self.halt("converged", tolerance=self.config.tolerance_px)
            return True
        return False

    def _learned(self, q: Array, error: ErrorVector, jacobian: Array) -> Decision | None:
        self._exploration = self._request = None
        effect_px = np.abs(jacobian).max(initial=0.0) * np.radians(self.config.explore_deg)
        if effect_px < MIN_EFFECT_PX:
            self.halt("no_effect")
            return None
        self._estimator = BroydenEstimator(jacobian)
        self.status = Status("servoing", "", "Moving to the goal.")
        return self._servo(q, error)

    # ---- servoing ------------------------------------------------------------------------------

    def _servo(self, q: Array, error: ErrorVector) -> Decision | None:
        estimator = self._estimator
        assert estimator is not None  # The state machine enters servoing with an estimator only.
        estimator.observe(q, error.values, self.config.alpha)
        if self._over(q, error):
            return None
        dq = self._step(q, error, estimator.jacobian)
        if self._dead_band.update(q, dq) and self._at_dead_band(error):
            return None
        self.progress = f"error {error.largest:.1f} px"
        return Decision(dq, speed_scale=HALF_SPEED if self._rows.degraded else 1.0)

    def _over(self, q: Array, error: ErrorVector) -> bool:
        config, left = self.config, error.largest
        if self._converged.update(left, config.tolerance_px):
            self.halt("converged", tolerance=config.tolerance_px)
            if not np.isfinite(error.values).all():
                said = f"{self.status.message} Not seen at the end: {unseen(error)}."
                self.status = replace(self.status, message=said)
        elif self._diverged.update(error.norm):
            self.halt("diverged", error=error.norm, best=self._diverged.best)
        elif self._stalled.update(error.norm, q):
            blocked = self._blocked(q, error)
            if blocked:
                self.halt("joint_limit", culprit=f"Joint {self.joints[blocked[0]].name}")
            else:
                self.halt("stalled", error=left, culprit=worst_row(error))
        return not self.moving

    def _step(self, q: Array, error: ErrorVector, jacobian: Array) -> Array:
        """The control law over the joints that are free: used, and not pushed out of their limits."""
        free = np.zeros(len(self.joints), bool)
        free[list(self.used)] = True
        gain = min(1.0, self.config.gain * self._gain_boost) if self._gain_boost > 1 else self.config.gain
        dq = np.zeros(len(self.joints))
        while free.any():
            dq, inverse = self._law(jacobian, error, gain, free)
            self.singular_values = frozen(inverse.singular_values)
            outward = free & self._pushes_out(q, dq)
            if not outward.any():
                return dq
            free &= ~outward
        return np.zeros_like(dq)

    def _law(
        self, jacobian: Array, error: ErrorVector, gain: float, free: NDArray[np.bool_]
    ) -> tuple[Array, Inverse]:
        """The control law on the rows that are seen."""
        seen = np.isfinite(error.values)
        return control_step(
            jacobian[seen], error.values[seen], error.weights[seen], gain, self.config.damping, free
        )

    def _pushes_out(self, q: Array, dq: Array) -> NDArray[np.bool_]:
        lower = np.array([j.lower for j in self.joints])
        upper = np.array([j.upper for j in self.joints])
        return ((q >= upper - AT_LIMIT_RAD) & (dq > 0)) | ((q <= lower + AT_LIMIT_RAD) & (dq < 0))

    def _blocked(self, q: Array, error: ErrorVector) -> list[int]:
        """The used joints that a limit keeps from helping."""
        assert self._estimator is not None
        free = np.zeros(len(self.joints), bool)
        free[list(self.used)] = True
        dq, _ = self._law(self._estimator.jacobian, error, 1.0, free)
        return [int(j) for j in np.flatnonzero(free & self._pushes_out(q, dq))]

    def _at_dead_band(self, error: ErrorVector) -> bool:
        """Asked to move, the arm does not: raise the gain first, since the residual is TOL / lambda
        (thesis 5.1.3); with the gain at 1 this is as close as the robot can."""
        if self.config.gain * self._gain_boost < 1.0:
            self._gain_boost *= 1.5
            self._dead_band.restart()
            return False
        self.halt("dead_band", error=error.largest)
        return True
