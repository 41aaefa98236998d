"""The servo as a state machine: one call per control period, no clock, no thread, no robot.

`VisualServo` drives it with any robot and any measurement; the engine drives it with trackers.
Both therefore run the same law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vita.servo.blame import unseen, worst_row
from vita.servo.config import ServoConfig
from vita.servo.dropout import HALF_SPEED, RowWatch
from vita.servo.explore import Exploring, JointStuck, Sample
from vita.servo.insight import Insight
from vita.servo.learning import Learned, Learning, Resting, learn
from vita.servo.monitors import (
    CONVERGED_PERIODS,
    FOLLOWED_PERIODS,
    Convergence,
    DeadBand,
    Divergence,
    Stall,
)
from vita.servo.reasons import status_for
from vita.servo.steering import Steering
from vita.types import MOVING_STATES, Array, ErrorVector, Joint, RowLabel, Status, frozen

MIN_EFFECT_SIGMAS = 5.0
"""Exploratory motions that move no error row by more than so many times the noise have told nothing."""


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
        self._labels: tuple[RowLabel, ...] = ()
        self._steering: Steering | None = None
        self._learning: Learning | None = None
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
        if self._steering is None:
            return frozen(np.zeros((0, len(self.joints))))
        return frozen(self._steering.estimate.jacobian)

    @property
    def insight(self) -> Insight | None:
        """What the servo knows of its Jacobian; None before it has been learned and used."""
        return None if self._steering is None else self._steering.insight()

    @property
    def sigma_px(self) -> float:
        """Noise of an error row as measured at rest [px]; NaN before that."""
        return float("nan") if self._steering is None else self._steering.estimate.sigma

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
        self._learning = None
        self._started_s = None
        if relearn or self._steering is None:
            self._steering = None
            self.status = Status("learning", "", "Learning how each joint moves the image.")
        else:
            self._steering.restart()
            self.status = Status("servoing", "", "Moving to the goal.")

    def halt(self, reason: str, **facts: object) -> None:
        """Leave motion for the state that `reason` leads to; a fault is not overwritten."""
        if self.status.state != "fault":
            self.status = status_for(reason, **facts)
        self.progress = ""
        self._learning = None

    def acknowledge(self) -> None:
        """Leave a fault, a hold or done for idle. Never moves the arm."""
        if not self.moving:
            self.status = Status()

    def forget(self) -> None:
        """Drop the Jacobian: the task or the cameras have changed."""
        self._steering, self._labels = None, ()

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
        if self._steering is not None and self._labels != error.labels:
            self.start(relearn=True)  # An edit between two runs makes the old Jacobian useless.
            self._started_s = stamp
        if not self._enough(error, lost):
            return None
        if stamp - self._started_s > self.config.timeout_s:
            self.halt("timeout", timeout=self.config.timeout_s, error=error.largest)
            return None
        try:
            if self.status.state == "learning":
                return self._learn(stamp, q, error)
            return self._servo(stamp, q, error)
        except (np.linalg.LinAlgError, FloatingPointError) as failure:
            self.halt("numerical", culprit=str(failure))
            return None

    def _enough(self, error: ErrorVector, lost: str) -> bool:
        """Whether the rows that are seen hold the arm; says so when some are missing."""
        known = self._steering is not None
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

    def _learn(self, stamp: float, q: Array, error: ErrorVector) -> Decision | None:
        sample = Sample(q.copy(), error.values.copy())
        if self._already_there(error):
            return None
        try:
            if self._learning is None:
                self._labels = error.labels
                self._learning = learn(sample, self.joints, self.used, self.config)
                request = next(self._learning)
            else:
                request = self._learning.send(sample)
        except StopIteration as finished:
            return self._learned(stamp, q, error, finished.value)
        except JointStuck as stuck:
            self.halt("joint_stuck", culprit=f"Joint {self.joints[stuck.joint].name}")
            return None
        self.progress = self._doing(request)
        return Decision(request.target - q, exploring=True)

    def _doing(self, request: Exploring | Resting) -> str:
        if isinstance(request, Resting):
            return "at rest: measuring the trackers' noise"
        joint = self.joints[request.joint].name
        return f"learning joint {joint} ({request.number + 1} of {request.total})"

    def _already_there(self, error: ErrorVector) -> bool:
        """A task that is met before the first motion is done without any."""
        met = error.largest <= self.config.tolerance_px
        if self._learning is None and met and not self._even_if_met:
            self.halt("converged", tolerance=self.config.tolerance_px)
            return True
        return False

    def _learned(self, stamp: float, q: Array, error: ErrorVector, learned: Learned) -> Decision | None:
        self._learning = None
        estimate, samples = learned
        effect = float(np.abs(samples.e - samples.e[0]).max(initial=0.0))
        if effect < MIN_EFFECT_SIGMAS * estimate.sigma:
            self.halt("no_effect")
            return None
        self._steering = Steering(estimate, samples, self.joints, self.used, self.config)
        self.status = Status("servoing", "", "Moving to the goal.")
        return self._servo(stamp, q, error)

    # ---- servoing ------------------------------------------------------------------------------

    def _servo(self, stamp: float, q: Array, error: ErrorVector) -> Decision | None:
        steering = self._steering
        assert steering is not None  # The state machine enters servoing with a Jacobian only.
        steering.joints = self.joints
        steering.configure(self.config)
        steering.hear(stamp, q, error)
        if self._over(q, error, steering):
            return None
        gain = self.config.gain
        if self._gain_boost > 1.0:
            gain = min(1.0, gain * self._gain_boost)
        dq = steering.step(q, error, gain).dq
        if self._dead_band.update(q, dq) and self._at_dead_band(error):
            return None
        self.progress = f"error {error.largest:.1f} px"
        return Decision(dq, speed_scale=HALF_SPEED if self._rows.degraded else 1.0)

    def _over(self, q: Array, error: ErrorVector, steering: Steering) -> bool:
        config, left = self.config, error.largest
        periods = FOLLOWED_PERIODS if config.moving_goal > 0.0 else CONVERGED_PERIODS
        if self._converged.update(left, config.tolerance_px, periods):
            self.halt("converged", tolerance=config.tolerance_px)
            if not np.isfinite(error.values).all():
                said = f"{self.status.message} Not seen at the end: {unseen(error)}."
                self.status = replace(self.status, message=said)
        elif self._diverged.update(error.norm):
            self.halt("diverged", error=error.norm, best=self._diverged.best)
        elif self._stalled.update(error.norm, q) and left > config.tolerance_px:
            blocked = steering.blocked(q, error)
            if blocked:
                self.halt("joint_limit", culprit=f"Joint {self.joints[blocked[0]].name}")
            else:
                self.halt("stalled", error=left, culprit=worst_row(error))
        return not self.moving

    def _at_dead_band(self, error: ErrorVector) -> bool:
        """Asked to move, the arm does not: raise the gain first, since the residual is TOL / lambda
        (thesis 5.1.3); with the gain at 1 this is as close as the robot can."""
        if self.config.gain * self._gain_boost < 1.0:
            self._gain_boost *= 1.5
            self._dead_band.restart()
            return False
        self.halt("dead_band", error=error.largest)
        return True
