"""Geometric constraints: from the pixels of point features to a labelled error vector."""

from vita.constraints.base import (
    CONSTRAINTS,
    MIN_LINE_PX,
    Constraint,
    constraint_of,
    register,
    signed_distance,
)
from vita.constraints.lines import LineToLine, ParallelLines
from vita.constraints.points import PointToLine, PointToPoint
from vita.constraints.stack import Term, stack

__all__ = [
    "CONSTRAINTS",
    "MIN_LINE_PX",
    "Constraint",
    "LineToLine",
    "ParallelLines",
    "PointToLine",
    "PointToPoint",
    "Term",
    "constraint_of",
    "register",
    "signed_distance",
    "stack",
]
