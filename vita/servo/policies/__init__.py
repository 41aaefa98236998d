"""Step policies, one file each, behind one base class."""

from vita.servo.policies.base import POLICIES, Proposal, Situation, StepPolicy, policy_of, register
from vita.servo.policies.uncertainty import UncertaintyDamped

__all__ = [
    "POLICIES",
    "Proposal",
    "Situation",
    "StepPolicy",
    "UncertaintyDamped",
    "policy_of",
    "register",
]
