"""Uncalibrated visual servoing: learn the image Jacobian, drive the error to zero."""

from vita.servo.config import JointLimit, Limits, ServoConfig
from vita.servo.controller import Controller, Decision
from vita.servo.error_feed import ErrorFeed
from vita.servo.estimators import ESTIMATORS, Estimate, JacobianEstimator
from vita.servo.explore import explore
from vita.servo.goal_motion import GoalMotion
from vita.servo.insight import Finding, Insight
from vita.servo.policies import POLICIES, StepPolicy
from vita.servo.reasons import REASONS, outcome_of, status_for
from vita.servo.visual_servo import Result, Robot, ServoState, VelocityRobot, VisualServo
from vita.types import Joint

__all__ = [
    "ESTIMATORS",
    "POLICIES",
    "REASONS",
    "Controller",
    "Decision",
    "ErrorFeed",
    "Estimate",
    "Finding",
    "GoalMotion",
    "Insight",
    "JacobianEstimator",
    "Joint",
    "JointLimit",
    "Limits",
    "Result",
    "Robot",
    "ServoConfig",
    "ServoState",
    "StepPolicy",
    "VelocityRobot",
    "VisualServo",
    "explore",
    "outcome_of",
    "status_for",
]
