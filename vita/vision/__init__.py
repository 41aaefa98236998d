"""Trackers: from pixels to features."""

from vita.vision.base import Tracker as Tracker
from vita.vision.fixed import FixedTracker as FixedTracker
from vita.vision.make import TRACKER_KINDS as TRACKER_KINDS
from vita.vision.make import make_tracker as make_tracker
from vita.vision.patch import PatchTracker as PatchTracker
from vita.vision.projected import NOISE_KINDS as NOISE_KINDS
from vita.vision.projected import ProjectedTracker as ProjectedTracker
from vita.vision.projected import tracker_seed as tracker_seed

__all__ = [
    "NOISE_KINDS",
    "TRACKER_KINDS",
    "FixedTracker",
    "PatchTracker",
    "ProjectedTracker",
    "Tracker",
    "make_tracker",
    "tracker_seed",
]
