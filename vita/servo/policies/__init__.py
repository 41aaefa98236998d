"""Step policies, one file each, behind one base class."""

from vita.servo.policies.adaptive import Adaptive
from vita.servo.policies.base import POLICIES, Proposal, Situation, StepPolicy, policy_of, register
from vita.servo.policies.damped import Damped
from vita.servo.policies.fixed import Fixed
from vita.servo.policies.trust_region import TrustRegion
from vita.servo.policies.uncertainty import UncertaintyDamped

__all__ = [
    "POLICIES",
    "Adaptive",
    "Damped",
    "Fixed",
    "Proposal",
    "Situation",
    "StepPolicy",
    "TrustRegion",
    "UncertaintyDamped",
    "policy_of",
    "register",
]
