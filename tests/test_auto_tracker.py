"""What `auto` chooses, and that it says so."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import shapes
from sequences import Sequence, circle

from vita.errors import BadInput, Untrackable
from vita.vision import TRACKER_KINDS, make_tracker

MIDDLE = np.array([160.3, 120.6])
TEXTURED = next(iter(Sequence(circle(0.0), frames=1)))


def kind_of(frame: np.ndarray, uv: object, **options: object) -> str:
    tracker = make_tracker("auto", frame, uv, **options)  # type: ignore[arg-type]
    word = tracker.update(frame).detail
    assert tracker.kind in ("patch", "point", "line", "ellipse", "blob", "marker")
    assert word.split()[0] in (tracker.kind, "edge") or tracker.kind in word, word
    return tracker.kind


def disc(radius: float, inside: float = 200.0, outside: float | np.ndarray = 80.0) -> np.ndarray:
    picture = shapes.ellipse(MIDDLE, (radius, 0.9 * radius), 0.4, inside, outside)
    return shapes.frame(picture, np.random.default_rng(1))


@pytest.mark.parametrize("radius", [8, 15, 40, 70])
def test_a_plain_disc_whose_middle_is_clicked_is_tracked_by_its_rim(radius: float) -> None:
    assert kind_of(disc(radius), (161.0, 119.0)) == "ellipse"


def test_a_plain_disc_on_texture_is_tracked_by_its_rim() -> None:
    """A square around it would be half background, which need not move with it."""
    scene = TEXTURED[..., 0].astype(float) * 0.5
    assert kind_of(disc(20, 250.0, scene), (161.0, 119.0)) == "ellipse"


def test_a_click_beside_the_middle_means_the_place_and_not_the_disc() -> None:
    assert kind_of(disc(40), (188.0, 120.0)) != "ellipse"


def test_texture_is_a_patch_also_inside_a_disc() -> None:
    assert kind_of(TEXTURED, (163.3, 118.6)) == "patch"
    scene = np.full((240, 320), 60.0)
    round_ = shapes.ellipse(MIDDLE, (45, 45), 0.0, 1.0, 0.0)
    picture = scene + round_ * (TEXTURED[..., 0].astype(float) - scene)
    assert kind_of(shapes.frame(picture, np.random.default_rng(2)), (160.0, 120.0)) == "patch"


def test_a_marker_is_known_by_its_number() -> None:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    picture = np.full((240, 320), 220.0)
    picture[80:152, 120:192] = cv2.aruco.generateImageMarker(dictionary, 7, 72)
    frame = shapes.frame(cv2.GaussianBlur(picture, (0, 0), 0.8), np.random.default_rng(3))
    assert kind_of(frame, (155.0, 115.0)) == "marker"
    assert "marker 7" in make_tracker("auto", frame, (155.0, 115.0)).update(frame).detail


def test_two_pixels_are_a_line() -> None:
    frame = shapes.frame(shapes.edge((160.0, 120.0), 0.3), np.random.default_rng(4))
    ends = [np.array([160.0, 120.0]) + r * shapes.along(0.3) for r in (-50, 50)]
    assert kind_of(frame, ends[0], to=ends[1]) == "line"


def test_whoever_asks_for_a_size_asks_for_a_patch() -> None:
    assert kind_of(disc(15), (161.0, 119.0), size_px=61.0) == "patch"


@pytest.mark.parametrize(
    "picture",
    [np.full((240, 320), 90.0), shapes.edge((160.0, 120.0), 0.3)],
    ids=["blank wall", "straight edge"],
)
def test_what_nothing_holds_on_to_is_refused(picture: np.ndarray) -> None:
    with pytest.raises(Untrackable):
        make_tracker("auto", shapes.frame(picture, np.random.default_rng(5)), (160.0, 120.0))


def test_only_lines_have_two_ends() -> None:
    for kind in TRACKER_KINDS:
        if kind not in ("auto", "line"):
            with pytest.raises(BadInput, match="line"):
                make_tracker(kind, TEXTURED, (160.0, 120.0), to=(200.0, 120.0))
    with pytest.raises(BadInput, match="other end"):
        make_tracker("line", TEXTURED, (160.0, 120.0))
