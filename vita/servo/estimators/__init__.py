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
from vita.servo.estimators.kalman import Kalman

__all__ = [
    "ESTIMATORS",
    "Estimate",
    "JacobianEstimator",
    "Kalman",
    "Samples",
    "Tuning",
    "estimator_of",
    "first_estimate",
    "register",
]
