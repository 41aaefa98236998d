"""Estimators of the image Jacobian, one file each, behind one base class."""

from vita.servo.estimators.base import (
    ESTIMATORS,
    Estimate,
    JacobianEstimator,
    Samples,
    Tuning,
    estimator_of,
    first_estimate,
    register,
)
from vita.servo.estimators.broyden import Broyden, Thesis, broyden_update
from vita.servo.estimators.history import History
from vita.servo.estimators.kalman import Kalman
from vita.servo.estimators.rls import RecursiveLeastSquares
from vita.servo.estimators.robust import Robust

__all__ = [
    "ESTIMATORS",
    "Broyden",
    "Estimate",
    "History",
    "JacobianEstimator",
    "Kalman",
    "RecursiveLeastSquares",
    "Robust",
    "Samples",
    "Thesis",
    "Tuning",
    "broyden_update",
    "estimator_of",
    "first_estimate",
    "register",
]
