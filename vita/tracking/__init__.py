"""`vita track`: the trackers on the user's own video, folder of images or camera."""

from vita.tracking.command import Request as Request
from vita.tracking.command import track as track
from vita.tracking.sources import open_source as open_source
from vita.tracking.targets import Target as Target

__all__ = ["Request", "Target", "open_source", "track"]
