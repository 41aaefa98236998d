"""Trackers: from pixels to features."""

from vita.vision.base import Tracker as Tracker
from vita.vision.blob import BlobTracker as BlobTracker
from vita.vision.ellipse import EllipseTracker as EllipseTracker
from vita.vision.fixed import FixedTracker as FixedTracker
from vita.vision.line import LineTracker as LineTracker
from vita.vision.make import TRACKER_KINDS as TRACKER_KINDS
from vita.vision.make import make_tracker as make_tracker
from vita.vision.marker import MarkerTracker as MarkerTracker
from vita.vision.patch import PatchTracker as PatchTracker
from vita.vision.point import PointTracker as PointTracker
from vita.vision.projected import NOISE_KINDS as NOISE_KINDS
from vita.vision.projected import ProjectedTracker as ProjectedTracker
from vita.vision.projected import tracker_seed as tracker_seed
from vita.vision.redetect import RedetectTracker as RedetectTracker

__all__ = [
    "NOISE_KINDS",
    "TRACKER_KINDS",
    "BlobTracker",
    "EllipseTracker",
    "FixedTracker",
    "LineTracker",
    "MarkerTracker",
    "PatchTracker",
    "PointTracker",
    "ProjectedTracker",
    "RedetectTracker",
    "Tracker",
    "make_tracker",
    "tracker_seed",
]
