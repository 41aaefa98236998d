"""Was it the camera that moved? A jolt moves every feature of one view at once, where one tracker that
leaps, or two that change places, leave the others where they should be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]

LEAST = 2
"""A single feature that jumps is a tracker that lost it."""


def jolted(views: Sequence[str], alive: Mask, odd: Mask, jumped: Mask) -> Mask:
    """(T,) the features of the views that were jolted.

    `views` names each feature's camera; `alive` are those that tell (seen, believed, and not the same to
    the bit as before, as a constant pixel is); `odd` are off their predicted places, and `jumped` so far
    that their trackers would be doubted.
    """
    cameras = np.array(views)
    found = np.zeros(len(cameras), bool)
    for camera in dict.fromkeys(views):
        members = alive & (cameras == camera)
        if members.sum() >= LEAST and odd[members].all() and jumped[members].any():
            found |= members
    return found
