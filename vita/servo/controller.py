"""The servo as a state machine: one call per control period, no clock, no thread, no robot.

`VisualServo` drives it with any robot and any measurement; the engine drives it with trackers.
Both therefore run the same law.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vita.servo.agreement import Agreement
from vita.servo.blame import unseen, worst_rows
from vita.servo.conditioning import Conditioning
from vita.servo.config import Limits, ServoConfig, range_of
from vita.servo.dropout import HALF_SPEED, RowWatch
from vita.servo.estimators import Estimate
from vita.servo.explore import Exploring, JointStuck, Sample
from vita.servo.freedom import one_viewpoint, under_constrained
from vita.servo.insight import Insight
from vita.servo.learning import Learned, Learning, Resting, learn
from vita.servo.monitors import (
    CONVERGED_PERIODS,
    FOLLOWED_PERIODS,
    Convergence,
    DeadBand,
    Divergence,
    Oscillation,
    Stall,
)
from vita.servo.obedience import Obedience
from vita.servo.ramp import Ramp
from vita.servo.reasons import status_for
from vita.servo.steering import Steering
from vita.types import MOVING_STATES, Array, ErrorVector, Joint, RowLabel, Status, frozen

LOWERED = 0.5
"""What is left of the gain for the rest of a run that overshot."""
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
        self._conditioning: Conditioning | None = None
        self._learning: Learning | None = None
        self._gain, self._speed = Ramp(range_of(ServoConfig, "gain")), Ramp(range_of(Limits, "speed_rad_s"))
        self._started_s: float | None = None
        self._even_if_met = False
        self._fresh_run()

    def _fresh_run(self) -> None:
        self._converged, self._diverged = Convergence(), Divergence()
        self._stalled, self._dead_band = Stall(), DeadBand()
        self._rows = RowWatch()
        self._agreement, self._obedience = Agreement(), Obedience()
        self._swings, self._overshot = Oscillation(), False
        self._gain_boost = 1.0
        self._gain.restart()
        self._speed.restart()

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
            self._steering = self._conditioning = None
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
        self._steering = self._conditioning = None
        self._labels = ()

    def mistake(self, change: Callable[[Array], Array]) -> None:
        """Let the servo believe `change` of its Jacobian (m, n): a fault to be tried."""
        if self._steering is not None:
            self._steering.mistake(change)

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
        wrong = self._obedience.update(q)
        if wrong:
            names = ", ".join(self.joints[j].name for j in wrong)
            self.halt("opposite_motion", culprit=f"joint {names} turns the wrong way")
            return None
        try:
            work = self._learn if self.status.state == "learning" else self._servo
            decision = work(stamp, q, error)
        except (np.linalg.LinAlgError, FloatingPointError) as failure:
            self._broken(str(failure))
            return None
        if decision is None:
            return None
        if not np.isfinite(decision.dq).all():
            self._broken("the step is not a number")
            return None
        self._obedience.asked(decision.dq)
        return replace(decision, speed_scale=decision.speed_scale * self._speed_share())

    def _broken(self, why: str) -> None:
        """Stop, and forget what led here: nobody is to look at numbers that are none."""
        self.halt("numerical", culprit=why)
        self.forget()

    def _speed_share(self) -> float:
        """Below 1 for a few periods after the speed limit was raised: the arm is not to leap."""
        top = max(joint.max_speed for joint in self.joints)
        return min(1.0, self._speed.follow(top) / top)

    def _enough(self, error: ErrorVector, lost: str) -> bool:
        """Whether the rows that are seen hold the arm; says so when some are missing."""
        known = self._steering is not None
        jacobian = self._weighted(error) if known else None
        why = self._rows.update(error, jacobian)
        if why:
            self.halt("tracker_lost", culprit=lost or unseen(error), why=why)
            return False
        if self._rows.changed:
            # The norm of other rows is another quantity: neither progress nor divergence.
            self._diverged, self._stalled = Divergence(), Stall()
        if self.status.state == "learning":
            return True
        if self._rows.degraded:
            self.status = self._rows.status(lost or unseen(error))
        elif self._weaker:
            assert self._conditioning is not None
            self.status = _slowed("weak_motion", culprit=self._conditioning.culprit(self._names))
        elif self._overshot:
            self.status = _slowed("overshooting")
        elif self.status.degraded:
            self.status = Status("servoing", "", "Moving to the goal.")
        return True

    @property
    def _weaker(self) -> bool:
        return self._conditioning is not None and self._conditioning.weaker

    @property
    def _names(self) -> list[str]:
        """The joints in use by name."""
        return [self.joints[j].name for j in self.used]

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
        estimate, samples = learned.estimate, learned.samples
        effect = float(np.abs(samples.e - samples.e[0]).max(initial=0.0))
        if effect < MIN_EFFECT_SIGMAS * estimate.sigma:
            self.halt("no_effect")
            return None
        self._steering = Steering(estimate, samples, self.joints, self.used, self.config)
        if self._left_open(error, learned.idle):
            return None
        self._conditioning = Conditioning(self._weighted(error), int(estimate.rank), q)
        self.status = Status("servoing", "", "Moving to the goal.")
        return self._servo(stamp, q, error)

    def _left_open(self, error: ErrorVector, idle: Sequence[int]) -> bool:
        """Whether the task leaves too much to chance for the arm to set out."""
        assert self._steering is not None
        names, columns = self._names, list(self.used)
        known = self._steering.weighted(error)
        covariance = known.covariance[np.ix_(columns, columns)]
        known = replace(known, jacobian=known.jacobian[:, columns], covariance=covariance)
        counted = _counted(error)
        hidden = one_viewpoint(known, counted.labels, names)
        strict = self.config.free_motions == "hold"
        if hidden:
            self.halt("ill_conditioned", culprit=hidden)
        elif strict and idle:
            self.halt("joint_no_effect", culprit=f"Joint {', '.join(self.joints[j].name for j in idle)}")
        elif strict and (found := under_constrained(known, counted, names)) is not None:
            self.halt("under_constrained", held=found[0], joints=found[1], culprit=found[2])
        return not self.moving

    def _weighted(self, error: ErrorVector) -> Array:
        """(m, k) the Jacobian of all rows, times their weights, over the joints in use [px/rad]."""
        return error.weights[:, None] * self.jacobian[:, list(self.used)]

    # ---- servoing ------------------------------------------------------------------------------

    def _servo(self, stamp: float, q: Array, error: ErrorVector) -> Decision | None:
        steering = self._steering
        assert steering is not None  # The state machine enters servoing with a Jacobian only.
        steering.joints = self.joints
        steering.configure(self.config)
        believed = steering.estimate
        steering.hear(stamp, q, error)
        if self._over(q, error, steering) or self._unsafe(q, error, steering, believed):
            return None
        gain = self._gain.follow(self.config.gain)
        if self._gain_boost > 1.0:
            gain = min(1.0, gain * self._gain_boost)
        if self._overshot:
            gain *= LOWERED
        dq = steering.step(q, error, gain).dq
        if self._dead_band.update(q, dq) and self._at_dead_band(error):
            return None
        self.progress = f"error {error.largest:.1f} px"
        slow = self._rows.degraded or self._weaker or self._overshot
        return Decision(dq, speed_scale=HALF_SPEED if slow else 1.0)

    def _unsafe(self, q: Array, error: ErrorVector, steering: Steering, believed: Estimate) -> bool:
        """Whether the image contradicts what is `believed` of it, or the motion has to end for its sake.

        Not while a goal is followed wherever it goes: what its own motion does looks just like that.
        """
        if self._even_if_met:
            return False
        off = self._agreement.update(q, error, believed) if self.config.moving_goal == 0.0 else None
        swings = self._swings.update(error.values, steering.estimate.sigma)
        if self._conditioning is not None:
            self._conditioning.update(self._weighted(error), q, error.largest / self.config.tolerance_px)
        if off is not None and off.jolted:
            self.halt("camera_moved", culprit=", ".join(off.cameras))
        elif off is not None:
            where = f" in camera {', '.join(off.cameras)}" if any(off.cameras) else ""
            self.halt("opposite_motion", culprit=f"seen{where}")
        elif swings and self._overshot:
            self.halt("oscillating")
        elif swings:
            self._overshot, self._swings = True, Oscillation()
        elif self._conditioning is not None and self._conditioning.gone:
            self.halt("near_singular", culprit=self._conditioning.culprit(self._names))
        return not self.moving

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
                self.halt("stalled", error=left, culprit=worst_rows(error))
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


def _slowed(reason: str, **facts: object) -> Status:
    return replace(status_for(reason, **facts), degraded=True)


def _counted(error: ErrorVector) -> ErrorVector:
    """The rows that are seen and have weight."""
    rows = np.flatnonzero(np.isfinite(error.values) & (error.weights > 0.0)).tolist()
    return ErrorVector(error.values[rows], tuple(error.labels[i] for i in rows), error.weights[rows])
