"""CPU time of many trackers at once: 1, 8 and 16 of them, 8 in each of two views."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
import tracker_motion as motion
from tracker_photos import OVERSAMPLING, Photo, scene, textured_piece
from tracker_render import SIZE, PhotoSequence
from tracker_rivals import SLOW, TEAMS, Maker

from vita.errors import BadInput
from vita.types import Feature, frozen
from vita.vision import Tracker

Update = Callable[[np.ndarray], list[Feature]]
COUNTS, SPEEDS = (1, 8, 16), (3.0, 12.0)
SIDE = 60
CARD = 440
"""The card nearly fills the view and holds the eight targets [px]."""


@dataclass(frozen=True)
class View:
    """A sequence with eight places to click, its frames made beforehand."""

    sequence: PhotoSequence
    clicks: np.ndarray
    """(8, 2) [px]."""
    frames: list[np.ndarray]


@dataclass(frozen=True)
class Load:
    """CPU time of one number of trackers at one speed."""

    tracker: str
    speed: float
    count: int
    mean_ms: float
    """Mean CPU time per frame (of all the views together) [ms]."""
    success: float
    """Share of the trackers' frames within 1 px, so that nobody is quick by giving up."""


def make_views(photos: list[Photo], seed: int, speed: float, frames: int) -> list[View]:
    """Two views at the same speed."""
    generators = [np.random.default_rng([seed, view, int(speed)]) for view in (0, 1)]
    return [_make_view(photos, rng, speed, frames) for rng in generators]


def _make_view(photos: list[Photo], rng: np.random.Generator, speed: float, frames: int) -> View:
    name, card = textured_piece(photos, rng, CARD * OVERSAMPLING, core=0.9)
    other = [p for p in photos if p.name != name][int(rng.integers(len(photos) - 1))]
    middle, phase = np.array([320.0, 240.0]) + rng.uniform(-5, 5, 2), rng.uniform(0, 2 * np.pi)

    def path(k: float) -> np.ndarray:
        angle = phase + speed * k / 30
        return middle + 30 * np.array([np.cos(angle), np.sin(angle)])

    pose = motion.swinging(rng, path, 160.0, amount=0.3)
    sequence = PhotoSequence(
        card, scene(other, (SIZE[0] * OVERSAMPLING, SIZE[1] * OVERSAMPLING)),
        pose, frames, int(rng.integers(2**31)),
    )  # fmt: skip
    pictures = list(sequence)
    return View(sequence, _places(pictures[0], pose(0.0)), pictures)


def _places(frame: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(8, 2) the eight best textured regions of the card that do not overlap."""
    gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
    weak = cv2.boxFilter(cv2.cornerMinEigenVal(gray, 3), -1, (SIDE, SIDE))
    mask = np.zeros_like(weak)
    half = CARD / 2 - SIDE
    square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    h = np.column_stack([square, np.ones(4)]) @ start.T
    cv2.fillConvexPoly(mask, np.rint(h[:, :2] / h[:, 2:]).astype(np.int32), 1.0)
    # The whole region must stay in the view wherever the path goes.
    border = 30 + 30 + SIDE
    mask[:border], mask[-border:], mask[:, :border], mask[:, -border:] = 0, 0, 0, 0
    worth, places = weak * mask, []
    for _ in range(8):
        v, u = (int(i) for i in np.unravel_index(int(np.argmax(worth)), worth.shape))
        places.append((u, v))
        worth[max(v - SIDE, 0) : v + SIDE, max(u - SIDE, 0) : u + SIDE] = 0
    return np.array(places, float)


def measure(name: str, make: Maker, views: list[View], speed: float, count: int, repeats: int) -> Load:
    """Mean CPU time a frame of `count` trackers, 16 of them spread over the two views.

    The run is repeated, and of each frame the quickest time is taken: trackers do the same work each
    time, what differs is who else is using the machine.
    """
    used = views if count > 8 else views[:1]
    runs = [_run(name, make, used, count // len(used)) for _ in range(repeats)]
    spent = np.min([times for times, _ in runs], axis=0)
    return Load(name, speed, count, 1e3 * float(spent.mean()), runs[0][1])


def _run(name: str, make: Maker, views: list[View], count: int) -> tuple[np.ndarray, float]:
    """CPU time of each frame [s], and the share of the trackers' frames within 1 px."""
    teams = [_team(name, make, view, count) for view in views]
    spent, hits = np.zeros(len(views[0].frames) - 1), []
    for k in range(1, len(views[0].frames)):
        for view, (clicks, update) in zip(views, teams, strict=True):
            began = time.thread_time()
            features = update(view.frames[k])
            spent[k - 1] += time.thread_time() - began
            truth = view.sequence.truth(clicks, k)
            hits += [f.ok and bool(np.hypot(*(f.uv - t)) <= 1) for f, t in zip(features, truth, strict=True)]
    return spent, float(np.mean(hits))


def _team(name: str, make: Maker, view: View, count: int) -> tuple[np.ndarray, Update]:
    """The clicks (count, 2) of a view and what follows all of them."""
    clicks, first = view.clicks[:count], view.frames[0]
    if name in TEAMS:
        return clicks, TEAMS[name](first, clicks).update
    trackers = [_started(make, first, click) for click in clicks]
    return clicks, lambda frame: [tracker.update(frame) for tracker in trackers]


class _Refused:
    """In place of a tracker that would not take the click, which counts as a failure."""

    kind = "refused"

    def update(self, frame: np.ndarray) -> Feature:
        return Feature(frozen([0, 0]), "lost", 0.0)


def _started(make: Maker, frame: np.ndarray, click: np.ndarray) -> Tracker:
    try:
        return make(frame, click, float(SIDE))
    except BadInput:
        return _Refused()


def all_loads(
    named: dict[str, Maker],
    photos: list[Photo],
    seed: int,
    frames: int,
    repeats: int,
    tick: Callable[[], None],
) -> list[Load]:
    """Every tracker at every speed and number, in turn, on the same frames.

    Slow ones get a few frames once: theirs is another order of magnitude anyway.
    """
    loads = []
    for speed in SPEEDS:
        views = make_views(photos, seed, speed, frames)
        few = [replace(view, frames=view.frames[:6]) for view in views]
        for count in COUNTS:
            for name, make in named.items():
                chosen, times = (few, 1) if name in SLOW else (views, repeats)
                loads.append(measure(name, make, chosen, speed, count, times))
                tick()
    return loads
