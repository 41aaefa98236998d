"""The photographs of the tracker benchmark: where they come from and how pieces are cut out of them.

A piece to be tracked must have texture. Which pieces do is decided here, by a rule that knows
nothing of any tracker: both eigenvalues of the mean structure tensor must be large enough
(Shi and Tomasi, Good features to track, CVPR 1994).
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np

from vita.errors import BadInput, MissingDependency

BUNDLED = (
    "astronaut.png",
    "camera.png",
    "chelsea.png",
    "coffee.png",
    "brick.png",
    "grass.png",
    "gravel.png",
    "rocket.jpg",
    "coins.png",
    "motorcycle_left.png",
    "hubble_deep_field.jpg",
    "ihc.png",
)
"""Photographs that come inside the package scikit-image."""
SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
OVERSAMPLING = 2
"""Texels per pixel of frame, along each side."""
MIN_EIGENVALUE, MIN_DEVIATION = 25.0, 20.0
"""What a piece must have: squared grey levels per pixel along its weakest direction, and contrast."""
LEAST_SIDE = 200
"""Photographs that are smaller than this say nothing [px]."""


@dataclass(frozen=True)
class Photo:
    """A photograph by its name."""

    name: str
    pixels: np.ndarray
    """(h, w, 3) float32 RGB."""


def load_photos(folder: Path | None = None) -> list[Photo]:
    """The photographs of `folder`, or those that scikit-image brings along.

    `MissingDependency` when the package or its photographs are not there, `BadInput` when a folder
    holds fewer than the three that a sequence needs (card, scene and the thing in front).
    """
    if folder is not None:
        if not folder.is_dir():
            raise BadInput(f"{str(folder)!r} is no folder", "--photos")
        paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES)
        photos = [photo for photo in map(_read, paths) if photo is not None]
        if len(photos) < 3:
            raise BadInput(
                f"{str(folder)!r} holds {len(photos)} usable pictures ({', '.join(SUFFIXES)}, at least "
                f"{LEAST_SIDE} x {LEAST_SIDE} pixels); three are needed",
                "--photos",
            )
        return photos
    package = find_spec("skimage")
    places = list(package.submodule_search_locations or []) if package else []
    found = [_read(Path(place) / "data" / name) for place in places for name in BUNDLED]
    photos = [photo for photo in found if photo is not None]
    if len(photos) < 3:
        raise MissingDependency(
            "the benchmark's photographs come with scikit-image, which is not installed: "
            "install it (pip install scikit-image) or give a folder of pictures with --photos DIR"
        )
    return photos


def _read(path: Path) -> Photo | None:
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR) if path.is_file() else None
    if picture is None or min(picture.shape[:2]) < LEAST_SIDE:
        return None
    rgb = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB).astype(np.float32)
    # Less contrast than the file has, so that more light does not saturate everything at once.
    return Photo(path.stem, 128 + 0.75 * (rgb - 128))


def piece(photo: Photo, rng: np.random.Generator, side: int) -> np.ndarray:
    """(side, side, 3) float32: a square somewhere in the photograph, 1 to 2 of its pixels a frame pixel."""
    return _cut(photo, rng, (side, side))


def scene(photo: Photo, size: tuple[int, int]) -> np.ndarray:
    """(h, w, 3) float32: the middle of the photograph, filling (width, height) `size` [texels]."""
    h, w = photo.pixels.shape[:2]
    scale = min(w / size[0], h / size[1])
    cut_w, cut_h = int(size[0] * scale), int(size[1] * scale)
    x, y = (w - cut_w) // 2, (h - cut_h) // 2
    return _resized(photo.pixels[y : y + cut_h, x : x + cut_w], size)


def textured_piece(photos: list[Photo], rng: np.random.Generator, side: int, core: float) -> tuple:
    """(name, (side, side, 3) float32) of a piece whose middle is textured enough to be followed.

    `core` is the share of the side that the middle takes. Photographs are tried in random order,
    several places in each; the best of all is taken if none passes.
    """
    best: tuple[float, str, np.ndarray] | None = None
    for index in rng.permutation(len(photos)):
        for _ in range(8):
            cut = _cut(photos[index], rng, (side, side))
            margin = round(side * (1 - core) / 2)
            eigenvalue, deviation = texture_of(cut[margin : side - margin, margin : side - margin])
            worth = min(eigenvalue / MIN_EIGENVALUE, deviation / MIN_DEVIATION)
            if worth >= 1:
                return photos[index].name, cut
            if best is None or worth > best[0]:
                best = worth, photos[index].name, cut
    assert best is not None
    return best[1:]


def texture_of(cut: np.ndarray) -> tuple[float, float]:
    """Smaller eigenvalue of the mean structure tensor [grey levels^2 / px^2] and standard deviation.

    `cut` (h, w, 3) has `OVERSAMPLING` texels a pixel.
    """
    gray = cv2.cvtColor(cut, cv2.COLOR_RGB2GRAY)
    gray = cv2.resize(gray, None, fx=1 / OVERSAMPLING, fy=1 / OVERSAMPLING, interpolation=cv2.INTER_AREA)
    gx, gy = (cv2.Sobel(gray, cv2.CV_32F, dx, 1 - dx, scale=1 / 8) for dx in (1, 0))
    tensor = [[np.mean(gx * gx), np.mean(gx * gy)], [np.mean(gx * gy), np.mean(gy * gy)]]
    return float(np.linalg.eigvalsh(tensor)[0]), float(gray.std())


def _cut(photo: Photo, rng: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
    """A random square of the photograph resized to `size` [texels]."""
    h, w = photo.pixels.shape[:2]
    wanted = size[0] / OVERSAMPLING * rng.uniform(1.0, 2.0)
    side = int(min(wanted, h, w))
    x, y = int(rng.integers(0, w - side + 1)), int(rng.integers(0, h - side + 1))
    return _resized(photo.pixels[y : y + side, x : x + side], size)


def _resized(pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    smaller = pixels.shape[1] > size[0]
    return cv2.resize(pixels, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_CUBIC)
