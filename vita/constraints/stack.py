"""Stacks the rows of several constraints into one labelled error vector (thesis eq. 3.5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vita.constraints.base import constraint_of
from vita.types import NO_ERROR, ErrorVector, Feature, RowLabel, frozen


@dataclass(frozen=True)
class Term:
    """One constraint of a task: its kind and the names of the trackers that it ties."""

    name: str
    kind: str
    points: tuple[str, ...]
    camera: str
    weight: float = 1.0
    priority: int = 1


def stack(terms: Sequence[Term], features: Mapping[str, Feature]) -> ErrorVector:
    """The error vector of `terms`; rows that need a lost tracker are NaN.

    Raises `UnknownName` on a kind or a tracker that does not exist.
    """
    if not terms:
        return NO_ERROR
    values, labels, weights = [], [], []
    for term in terms:
        constraint = constraint_of(term.kind)
        points = np.concatenate([_pixels(features[name]) for name in term.points])
        values.append(constraint.residual(points))
        labels += [RowLabel(term.name, term.camera, part, term.priority) for part in constraint.components]
        weights += [term.weight] * len(constraint.components)
    return ErrorVector(frozen(np.concatenate(values)), tuple(labels), frozen(weights))


def _pixels(feature: Feature) -> np.ndarray:
    """A lost tracker still remembers a pixel for drawing; it must not steer the arm."""
    return feature.points if feature.ok else np.full_like(feature.points, np.nan)
