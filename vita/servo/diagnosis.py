"""What the constraint doctor has found, in figures and in sentences for people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from vita.servo.estimators.base import RIGID_RANK
from vita.servo.insight import GOOD_CONDITION, POOR_CONDITION, Finding
from vita.types import Array


@dataclass(frozen=True)
class Diagnosis:
    """What the task does to the arm, to first order about the place where the Jacobian was learned."""

    held: int
    """How many directions of joint motion are held."""
    joints: int
    """How many joints are in use."""
    rows: int
    free: tuple[str, ...]
    """One joint motion for each direction that is left free, in words."""
    free_motions: Array
    """(joints - held, joints) the same as unit vectors."""
    needed: tuple[str, ...]
    """Constraints without which fewer directions would be held."""
    redundant: tuple[str, ...]
    """Constraints that can go, one at a time: as many directions stay held, nearly as firmly."""
    conflicting: tuple[str, ...]
    """Constraints that cannot all be met: the error has a part that no joint motion removes."""
    conflict_px: float
    """Length of that part [px]; 0 when there is no contradiction."""
    condition: float
    """Largest over smallest singular value of the held directions."""
    weakest: float
    """The smallest of them [px/rad]."""
    weakest_motion: str
    """The joint motion that belongs to it, in words."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The same in sentences for people."""
        found = (*_freedom(self), *_free(self), *_conflicts(self), *_firmness(self), *_spare(self))
        return tuple(found)


def _freedom(found: Diagnosis) -> list[Finding]:
    text = f"{found.rows} error rows hold {found.held} of {found.joints} joint motions"
    if found.held == 0:
        return [Finding("bad", "nothing_held", f"{text}: no joint moves the drawn features clearly.")]
    return [Finding("good" if found.held >= min(RIGID_RANK, found.joints) else "info", "held", f"{text}.")]


def _free(found: Diagnosis) -> list[Finding]:
    if not found.free or not found.held:
        return []
    if found.held == RIGID_RANK:
        text = f"The hand is held; the arm behind it may still swing: {'; '.join(found.free)}."
        return [Finding("info", "free_motion", text)]
    return [
        Finding(
            "info", "free_motion",
            f"Left free: {'; '.join(found.free)}. The smallest motion is taken. If the hand must not turn or "
            "slide, add a constraint on another of its points.",
        )
    ]  # fmt: skip


def _conflicts(found: Diagnosis) -> list[Finding]:
    if not found.conflicting:
        return []
    one = len(found.conflicting) == 1
    text = (
        f"{quoted(found.conflicting)} cannot {'be met with the others' if one else 'all be met'}: "
        f"{found.conflict_px:.0f} px of error would stay, whatever "
        " the joints do from here (to first order). Move one of their goals, or delete one."
    )
    return [Finding("warning", "conflict", text)]


def _firmness(found: Diagnosis) -> list[Finding]:
    if not found.held or found.condition <= GOOD_CONDITION:
        return []
    poor = found.condition > POOR_CONDITION
    text = (
        f"Condition number {found.condition:.0f}, {'poor' if poor else 'fair'}: the images show least of "
        f"{found.weakest_motion} ({found.weakest:.0f} px/rad)."
    )
    advice = " Put the points farther apart, or add a view from the side."
    return [Finding("warning" if poor else "info", "condition", text + (advice if poor else ""))]


def _spare(found: Diagnosis) -> list[Finding]:
    findings = []
    if found.redundant:
        one = len(found.redundant) == 1
        text = (
            f"{quoted(found.redundant)} {'adds' if one else 'each add'} little: without "
            f"{'it' if one else 'any one of them'} the same motions stay held nearly as firmly. "
            f"{'It is' if one else 'They are'} of use when another tracker is lost."
        )
        findings.append(Finding("info", "redundant", text))
    if found.needed and found.held:
        text = f"Needed: without {quoted(found.needed, 'or')} fewer motions would be held."
        findings.append(Finding("info", "needed", text))
    return findings


def quoted(names: Sequence[str], word: str = "and") -> str:
    """Names in quotes, as a list for people."""
    marked = [repr(name) for name in names]
    return marked[0] if len(marked) == 1 else f"{', '.join(marked[:-1])} {word} {marked[-1]}"
