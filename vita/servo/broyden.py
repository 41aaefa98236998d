"""The thesis' estimator: a Jacobian from exploratory motions, kept fresh by Broyden updates."""

from __future__ import annotations

import numpy as np

from vita.types import Array


def broyden_update(jacobian: Array, dq: Array, de: Array, alpha: float) -> Array:
    """Thesis eq. 2.18: the smallest change of the (m, n) `jacobian` [px/rad] that explains a share
    `alpha` of the motion `de` (m,) [px] seen while the joints really moved by `dq` (n,) [rad].

    With alpha = 1 the secant equation J dq = de holds exactly; with 0 nothing changes.
    """
    return jacobian + alpha * np.outer(de - jacobian @ dq, dq) / (dq @ dq)


class BroydenEstimator:
    """Holds the Jacobian and decides when there is something to learn.

    A step inside the tracker noise says nothing, and dividing by its square destroys the estimate
    (norm 460 to 3e8 in one such step has been seen). Motion is therefore added up from the last
    update until the image has moved by `min_motion_px`, and the update uses that whole secant.
    """

    def __init__(self, jacobian: Array, *, min_motion_px: float = 2.0, min_motion_rad: float = 1e-3) -> None:
        self._jacobian = np.array(jacobian, float)
        self._min_px, self._min_rad = min_motion_px, min_motion_rad
        self._q: Array | None = None
        self._e: Array | None = None

    @property
    def jacobian(self) -> Array:
        """(m, n) d error / d joints [px/rad], a copy."""
        return self._jacobian.copy()

    def restart(self) -> None:
        """Forget where the last secant began (after a pause, a jump or a moved camera)."""
        self._q = self._e = None

    def observe(self, q: Array, e: Array, alpha: float) -> bool:
        """Learn from measured joints (n,) [rad] and errors (m,) [px], NaN where not
        seen; True when it did."""
        if self._q is None or self._e is None:
            self._q, self._e = q.copy(), e.copy()
            return False
        dq, de = q - self._q, e - self._e
        # A row that was not seen at both ends of the secant keeps what is known of it.
        seen = np.isfinite(de)
        if np.linalg.norm(de[seen]) < self._min_px or np.linalg.norm(dq) < self._min_rad:
            return False
        self._jacobian[seen] = broyden_update(self._jacobian[seen], dq, de[seen], alpha)
        self._q, self._e = q.copy(), e.copy()
        return True
