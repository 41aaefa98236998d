"""The cases of the tracker benchmark: what moves how, what is in the way, and what each is scored for."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import tracker_motion as motion
from tracker_photos import OVERSAMPLING, Photo, scene, textured_piece
from tracker_render import SIZE, Box, PhotoSequence

SIDES = (30, 60, 100)
"""Sides of the tracked region [px]."""
Build = Callable[["Draft"], PhotoSequence]


@dataclass(frozen=True)
class Case:
    """One row of the tables."""

    name: str
    build: Build
    about: Literal["success", "jitter", "loss"] = "success"
    """`loss`: the target goes away and comes back; `jitter`: nothing moves."""
    title: str = ""


@dataclass(frozen=True)
class Draft:
    """What a case is made from: a bare sequence to be given its motion, and its random numbers."""

    rng: np.random.Generator
    bare: PhotoSequence
    """Card and scene, without motion."""
    click: np.ndarray
    """(2,) where the target is clicked, relative to the card's centre in frame 0 [px]."""
    side: int
    frames: int


@dataclass(frozen=True)
class Shot:
    """One sequence with the place that is clicked in its first frame."""

    case: str
    side: int
    number: int
    photo: str
    sequence: PhotoSequence
    click: np.ndarray


def shoot(case: Case, side: int, number: int, photos: list[Photo], seed: int, frames: int) -> Shot:
    """The `number`-th sequence of a case; the same arguments give the same pictures to the bit."""
    rng = np.random.default_rng([seed, zlib.crc32(case.name.encode()), side, number])
    # The card must hold the region whichever way it is turned.
    card_side = int(2.1 * side) * OVERSAMPLING
    name, card = textured_piece(photos, rng, card_side, core=0.5)
    others = [p for p in photos if p.name != name]
    backdrop, thing = (others[i] for i in rng.permutation(len(others))[:2])
    fine = SIZE[0] * OVERSAMPLING, SIZE[1] * OVERSAMPLING
    _, cover = textured_piece([thing], rng, int(2.4 * side) * OVERSAMPLING, core=1.0)
    bare = PhotoSequence(
        card=card, backdrop=scene(backdrop, fine), pose=lambda k: np.eye(3), frames=frames,
        seed=int(rng.integers(2**31)), thing=cover, name=f"{case.name}-{side}-{number}",
    )  # fmt: skip
    offset = rng.uniform(-2, 2, 2)
    draft = Draft(rng, bare, offset, side, frames)
    sequence = case.build(draft)
    return Shot(case.name, side, number, name, sequence, _click(draft, sequence))


def _mild_light(rng: np.random.Generator) -> Callable[[int], tuple[float, float]]:
    """Brightness that drifts by a tenth, as it does in any room."""
    a, b = rng.uniform(0, 2 * np.pi, 2)
    return lambda k: (1 + 0.1 * np.sin(a + k / 13), 6 * np.sin(b + k / 19))


def moving(speed: float) -> Build:
    def build(d: Draft) -> PhotoSequence:
        pose = motion.swinging(d.rng, motion.ring(d.rng, speed), motion.period_of(speed))
        return replace(d.bare, pose=pose, light=_mild_light(d.rng))

    return build


def unsteady(d: Draft) -> PhotoSequence:
    path = motion.zigzag(d.rng, 6.0, d.frames)
    pose = motion.swinging(d.rng, path, motion.period_of(6.0))
    return replace(d.bare, pose=pose, light=_mild_light(d.rng))


def smeared(d: Draft) -> PhotoSequence:
    """8 px a frame with the shutter open for 60 % of the time: streaks of 5 px."""
    return replace(moving(8.0)(d), exposure=0.6)


def defocused(d: Draft) -> PhotoSequence:
    """The focus hunts: blur that comes and goes, up to sigma 2 px."""
    phase = d.rng.uniform(-0.5, 0.5)
    return replace(moving(3.0)(d), focus=lambda k: 2.0 * np.sin(k / 12 + phase * min(k, 12) / 12) ** 2)


def lit(d: Draft) -> PhotoSequence:
    """Gain of 0.7 to 1.3 and a bias: gliding in every other sequence, switched at once in the rest."""
    glides, period, start = d.rng.random() < 0.5, d.rng.uniform(30, 50), d.rng.uniform(0, 2 * np.pi)
    switch = int(d.rng.integers(6, 14))

    def light(k: int) -> tuple[float, float]:
        wave = np.sin(2 * np.pi * k / period)
        if not glides:
            wave = (0.0, 1.0, 0.0, -1.0)[k // switch % 4]
        return 1 + 0.3 * wave, 10 * np.sin(start + k / 17)

    return replace(moving(3.0)(d), light=light)


def noisy(d: Draft) -> PhotoSequence:
    return replace(moving(3.0)(d), noise=5.0)


def still(d: Draft) -> PhotoSequence:
    return replace(d.bare, pose=motion.resting(d.rng))


def partly_covered(share: float) -> Build:
    """A textured thing slides in from one side, then rides along with the card and slips to and fro."""

    def build(d: Draft) -> PhotoSequence:
        sequence = moving(3.0)(d)
        edge = int(d.rng.integers(4))

        def cover(k: int) -> Box | None:
            entering = np.clip((k - 4) / 8, 0, 1)
            now = share * (entering if k < 12 else 0.9 + 0.1 * np.cos((k - 12) / 5))
            return _from_edge(_click(d, sequence), d.side, edge, float(now)) if k > 4 else None

        return replace(sequence, cover=cover)

    return build


def wholly_covered(d: Draft) -> PhotoSequence:
    """The thing slides over the whole region, stays while the card moves on, and slides off."""
    sequence = moving(3.0)(d)
    enter, leave = int(d.rng.integers(8, 12)), int(d.rng.integers(30, 36))
    edge = int(d.rng.integers(4))

    def cover(k: int) -> Box | None:
        depth = min(1.15, 1.15 * (k - enter) / 5, 1.15 * (leave + 5 - k) / 5)
        return _from_edge(_click(d, sequence), d.side, edge, depth) if depth > 0 else None

    return replace(sequence, cover=cover, frames=leave + 5 + 16)


def leaving(d: Draft) -> PhotoSequence:
    """The target goes out of view at 5 px a frame, stays away and comes back somewhat elsewhere."""
    path, frames = motion.excursion(d.rng, 5.0, d.side, SIZE)
    pose = motion.swinging(d.rng, path, 120.0, amount=0.5)
    return replace(d.bare, pose=pose, frames=frames, light=_mild_light(d.rng))


def _click(d: Draft, sequence: PhotoSequence) -> np.ndarray:
    start = sequence.pose(0.0)
    return start[:2, 2] / start[2, 2] + d.click


def _from_edge(click: np.ndarray, side: float, edge: int, share: float) -> Box:
    """A box that covers `share` of the region about `click`, reaching in from one of its four edges."""
    half, beyond = side / 2, 0.1 * side
    reach = share * side
    long, back = half + 0.15 * side, half + beyond
    boxes = (
        (-back, -long, -half + reach, long),
        (half - reach, -long, back, long),
        (-long, -back, long, -half + reach),
        (-long, half - reach, long, back),
    )
    u0, v0, u1, v1 = boxes[edge]
    return click[0] + u0, click[1] + v0, click[0] + u1, click[1] + v1


CASES = (
    *(Case(f"move{s}", moving(s), title=f"{s} px a frame, affine and perspective") for s in (1, 3, 6, 12)),
    Case("unsteady", unsteady, title="6 px a frame, sudden turns"),
    Case("smear", smeared, title="motion blur, 8 px a frame, shutter open 60 %"),
    Case("defocus", defocused, title="defocus up to sigma 2 px"),
    Case("light", lit, title="light plus and minus 30 %"),
    Case("noise", noisy, title="noise of 5 grey levels"),
    Case("cover25", partly_covered(0.25), title="a quarter covered"),
    Case("cover40", partly_covered(0.4), title="two fifths covered"),
    Case("still", still, "jitter", "nothing moves, noise of 2 grey levels"),
    Case("hidden", wholly_covered, "loss", "wholly covered, then free again"),
    Case("away", leaving, "loss", "out of the view and back"),
)
