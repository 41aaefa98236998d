"""Damped least squares: the farther the goal, the more cautious the inverse."""

from __future__ import annotations

import numpy as np

from vita.servo.estimators.base import CURVATURE
from vita.servo.policies.base import Proposal, Situation, StepPolicy, register
from vita.servo.policies.modes import modes_of, near


@register
class Damped(StepPolicy):
    """dq = -lambda (J'J + mu^2 I)^-1 J'e, the damping mu^2 growing with the error.

    Gauss-Newton leaves the term sum_i e_i H_i out of the second derivative of |e|^2 / 2. A Jacobian
    that changes by kappa of itself per radian has Hessians H_i of size kappa |J_i|, so that what is
    left out is about kappa |e| times the size of a row of J; just that is put in its place,

        mu^2 = kappa sqrt(n mean(J0^2)) |e| + (damping s_1)^2,

    n the number of free joints.

    Damping in proportion to the residual's norm converges as fast as Newton's method at the end, even
    when J is singular (Fan and Yuan, Computing 74, 2005; its square: Sugihara, IEEE Trans. Robotics
    27, 2011, for inverse kinematics, with a small constant added as here).
    """

    kind = "damped"
    title = "Damped least squares"
    doc = "Fixed gain with a damping that grows with the error: calm far away and near singular poses."

    def _choose(self, now: Situation) -> Proposal:
        modes = modes_of(now, known=True)
        row = np.sqrt(np.count_nonzero(now.free, axis=-1) * now.estimate.scale2)
        floor = (now.damping * modes.largest) ** 2
        mu2 = CURVATURE * row * np.linalg.norm(now.e, axis=-1) + floor
        dq = np.asarray(now.gain, float)[..., None] * modes.step(mu2)
        rank = np.count_nonzero(modes.used, axis=-1)
        return Proposal(np.where(now.free, dq, 0.0), rank, near(now, modes.step(floor)))
