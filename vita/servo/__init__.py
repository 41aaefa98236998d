"""Uncalibrated visual servoing: learn the image Jacobian, drive the error to zero."""

from vita.servo.broyden import BroydenEstimator, broyden_update
from vita.servo.config import JointLimit, Limits, ServoConfig
from vita.servo.controller import Controller, Decision
from vita.servo.explore import explore
from vita.servo.law import control_step, damped_inverse
from vita.servo.reasons import REASONS, outcome_of, status_for
from vita.servo.visual_servo import Result, Robot, ServoState, VisualServo
from vita.types import Joint

__all__ = [
    "REASONS",
    "BroydenEstimator",
    "Controller",
    "Decision",
    "Joint",
    "JointLimit",
    "Limits",
    "Result",
    "Robot",
    "ServoConfig",
    "ServoState",
    "VisualServo",
    "broyden_update",
    "control_step",
    "damped_inverse",
    "explore",
    "outcome_of",
    "status_for",
]
