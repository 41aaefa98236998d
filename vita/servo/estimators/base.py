"""What a Jacobian estimator is, and what every one of them shares.

All arrays may have leading axes: a servo runs one estimate, (m, n); an experiment runs thousands of
them at once, (runs, m, n), with the same code. Below, `...` stands for those axes, m is the number
of error rows and n that of the joints.

A step inside the tracker noise says nothing about the Jacobian, and dividing by its square destroys
the estimate (a norm from 460 to 3e8 in one such step has been seen). Motion is therefore added up
from the last update until the image has moved clearly, and that whole secant is what is learned.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from vita.errors import UnknownName
from vita.servo.small import all_of, some, whitening
from vita.types import Array

CURVATURE = 0.5
"""kappa: how fast a Jacobian changes, relative to its size [1/rad]. Of a revolute arm that is about
one over the arm's own scale; a guess that is off by two costs some steps, not the convergence."""
MIN_MOTION_RAD = 1e-5
"""Less joint motion than this is rounding [rad]."""
STANDS_OUT = 1.5
"""A direction of motion is held by the task when its strength is so many times that of noise alone."""
LATER = 3.0
"""The same for directions that come to stand out on the way: the noise of one measurement is in two
secants, and many small steps make the covariance look better than it is."""
RIGID_RANK = 6
"""A rigid hand has six degrees of freedom, so its Jacobian has no more: further singular values
are noise, and inverting them throws the arm about."""
GATE_SIGMAS = 3.5
"""An image motion must stand out of the noise of all its rows by so many of its deviations before it is
learned from: noise alone does so once in 2,000 periods, whatever the number of rows."""
UNBELIEVABLE = 5.0
"""A surprise of all rows together of more deviations is no effect of the joints: the goal has moved, or
a camera was touched. It is believed the less the larger it is."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Estimate:
    """What is known of the image Jacobian, and how well."""

    jacobian: Array
    """(..., m, n) d error / d joints [px/rad]."""
    covariance: Array
    """(..., n, n) covariance P of each row, one for all rows [px^2/rad^2]."""
    sigma: float
    """Standard deviation of one error row's noise [px]."""
    scale2: Array
    """(...,) mean squared entry of the first Jacobian, which gives curvature its size [px^2/rad^2]."""
    rank: NDArray[np.int_]
    """(...,) how many directions of joint motion the rows are known to hold."""

    def spread2(self, dq: Array) -> Array:
        """(...,) variance [px^2] of what the rows will do under a step `dq` (..., n) [rad]: what is not
        known of J, and what J changes on the way."""
        known = np.vecdot(dq, np.matvec(self.covariance, dq))
        length2 = np.vecdot(dq, dq)
        return known + 0.25 * CURVATURE**2 * self.scale2 * (length2 * length2)


@dataclass(frozen=True)
class Samples:
    """Measurements in the order in which they were made."""

    q: Array
    """(..., t, n) joints [rad]."""
    e: Array
    """(..., t, m) error [px]."""


@dataclass(frozen=True)
class Tuning:
    """The settings that estimators may read, changed live."""

    alpha: float = 0.3
    """Learning rate of Broyden's update (thesis eq. 2.18)."""
    forgetting: float = 0.98
    """Weight that recursive least squares leaves the past at each update."""


def first_estimate(jacobian: Array, delta: Array | float, sigma: float) -> Estimate:
    """The estimate after exploratory motions of size `delta` [rad] (thesis eq. 2.17): one for all joints,
    (...,), or one for each, (..., n).

    A finite difference over delta is wrong by the noise of two measurements, 2 sigma^2 / delta^2, and
    by half of what the Jacobian changes on the way, (kappa delta / 2)^2 of its square.
    """
    n, runs = jacobian.shape[-1], jacobian.shape[:-2]
    scale2 = np.maximum(np.mean(jacobian**2, axis=(-2, -1)), 1e-12)
    delta = np.asarray(delta, float)
    delta2 = np.broadcast_to(delta if delta.ndim > len(runs) else delta[..., None], (*runs, n)) ** 2
    variance = 2.0 * sigma**2 / delta2 + 0.25 * CURVATURE**2 * scale2[..., None] * delta2
    covariance = variance[..., None] * np.eye(n)
    return Estimate(np.array(jacobian, float), covariance, float(sigma), scale2, held(jacobian, covariance))


def held(jacobian: Array, covariance: Array, least: float = STANDS_OUT) -> NDArray[np.int_]:
    """(...,) number of directions of joint motion in which `jacobian` (..., m, n) stands out of its
    own uncertainty, `covariance` (..., n, n) of each row, by `least`. At most six: a rigid hand has no
    more."""
    strength = np.linalg.eigvalsh(whitened(jacobian, covariance))
    count = np.count_nonzero(strength > least * jacobian.shape[-2], axis=-1)
    return np.minimum(count, RIGID_RANK)


def whitened(jacobian: Array, covariance: Array) -> Array:
    """(..., n, n) J'J in coordinates in which every entry of J has noise of variance one; noise alone
    then gives each direction of motion a strength of m."""
    turned = jacobian @ whitening(covariance).mT
    return turned.mT @ turned


class JacobianEstimator(ABC):
    """Keeps the Jacobian up to date from measured motion. A subclass says how it learns one secant."""

    kind: ClassVar[str]
    title: ClassVar[str]
    """Name for people."""
    doc: ClassVar[str]
    """One sentence for the page and the docs: what it does and when to choose it."""

    def __init__(self, start: Estimate, history: Samples | None = None, tuning: Tuning | None = None) -> None:
        self._estimate = start
        self.tuning = tuning or Tuning()
        self._q: Array | None = None
        self._e: Array | None = None
        del history  # Only estimators that keep all samples need those of the exploration.

    @property
    def estimate(self) -> Estimate:
        return self._estimate

    @property
    def jacobian(self) -> Array:
        """(..., m, n) d error / d joints [px/rad], a copy."""
        return self._estimate.jacobian.copy()

    def believed(self, e: Array) -> Array:
        """(..., m) the error `e` that was observed last, without what is not believed of it [px]."""
        return e

    def restart(self) -> None:
        """Forget where the last secant began (after a pause, a jump or a moved camera)."""
        self._q = self._e = None

    def observe(self, q: Array, e: Array) -> Mask:
        """Take measured joints (..., n) [rad] and errors (..., m) [px], NaN in rows that are not seen.

        Returns (...,) whether each run learned something.
        """
        if self._q is None or self._e is None:
            self._q, self._e = q.copy(), e.copy()
            return np.zeros(q.shape[:-1], bool)
        dq, de = q - self._q, e - self._e
        # A row that was not seen at both ends of the secant keeps what is known of it.
        seen = np.isfinite(de)
        known = de if all_of(seen) else np.where(seen, de, 0.0)
        moved2 = np.vecdot(known, known)
        gate = self._estimate.sigma * (np.sqrt(2.0 * de.shape[-1]) + GATE_SIGMAS)
        learn = (moved2 > gate * gate) & (np.maximum.reduce(np.abs(dq), axis=-1) > MIN_MOTION_RAD)
        if some(learn):
            self._estimate = self._with_rank(self._learned(dq, de, seen, learn))
            if all_of(learn):
                self._q, self._e = q.copy(), e.copy()
            else:
                self._q = np.where(learn[..., None], q, self._q)
                self._e = np.where(learn[..., None], e, self._e)
        return learn

    def _with_rank(self, estimate: Estimate) -> Estimate:
        """A direction that has come to stand out counts from then on. None is given up again: on the
        way the covariance grows, and a direction that were no longer used could never be learned."""
        most = min(*estimate.jacobian.shape[-2:], RIGID_RANK)
        if all_of(estimate.rank >= most):
            return estimate
        now = held(estimate.jacobian, estimate.covariance, LATER)
        return replace(estimate, rank=np.maximum(estimate.rank, now))

    @abstractmethod
    def _learned(self, dq: Array, de: Array, seen: Mask, learn: Mask) -> Estimate:
        """The estimate after the secant `dq` (..., n) [rad], `de` (..., m) [px].

        Rows (..., m) that are not `seen` have NaN in `de` and keep their Jacobian; runs (...,) that
        shall not `learn` keep everything.
        """

    def _put(self, jacobian: Array, covariance: Array, seen: Mask, learn: Mask) -> Estimate:
        """The new estimate, with the old values in rows and runs that learn nothing."""
        old = self._estimate
        if all_of(seen) and all_of(learn):
            return replace(old, jacobian=jacobian, covariance=covariance)
        rows = (seen & learn[..., None])[..., None]
        return replace(
            old,
            jacobian=np.where(rows, jacobian, old.jacobian),
            covariance=np.where(learn[..., None, None], covariance, old.covariance),
        )


E = TypeVar("E", bound=JacobianEstimator)
ESTIMATORS: dict[str, type[JacobianEstimator]] = {}
"""Kind to estimator."""


def register(estimator: type[E]) -> type[E]:
    """Add a kind. Raises `ValueError` on a name that is taken."""
    if estimator.kind in ESTIMATORS:
        raise ValueError(f"estimator {estimator.kind!r} is registered twice")
    ESTIMATORS[estimator.kind] = estimator
    return estimator


def estimator_of(kind: str, path: str = "") -> type[JacobianEstimator]:
    """The estimator of a kind; raises `UnknownName` with the choices."""
    try:
        return ESTIMATORS[kind]
    except KeyError:
        raise UnknownName("estimator", kind, ESTIMATORS, path) from None
