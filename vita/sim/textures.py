"""Pictures to print on things, drawn at build time from fixed seeds.

Printed faces must hold a tracker at any zoom: `poster` covers them with shapes of three sizes, no two
places alike, each drawn in an ink that stands out from what is beneath it. All pictures are (h, w, 3) RGB
bytes.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vita.types import Image

Ink = tuple[int, int, int]
PALETTES: dict[str, tuple[Ink, ...]] = {
    "harbour": (
        (245, 240, 226),
        (20, 33, 61),
        (214, 64, 50),
        (243, 176, 47),
        (35, 122, 133),
        (255, 255, 255),
    ),
    "garden": ((240, 243, 232), (24, 48, 40), (220, 92, 58), (120, 176, 75), (246, 204, 92), (255, 255, 255)),
    "berry": ((247, 238, 236), (43, 22, 58), (196, 44, 96), (90, 110, 190), (250, 180, 120), (255, 255, 255)),
    "night": ((24, 28, 44), (240, 236, 220), (232, 106, 62), (92, 190, 190), (250, 214, 110), (10, 12, 22)),
    "clay": ((236, 222, 203), (58, 36, 28), (178, 76, 46), (60, 100, 128), (226, 158, 70), (252, 248, 240)),
    "ice": ((232, 240, 246), (16, 40, 78), (40, 130, 200), (232, 80, 70), (140, 200, 210), (255, 255, 255)),
}
LETTERS = "ABCDEFGHJKMNPRSTUVWXYZ23456789&?#"


def poster(size: tuple[int, int], palette: str, seed: int, margin: float = 0.0, bold: float = 1.0) -> Image:
    """A poster of `size` (w, h) px; `margin` is a plain border, as a share of the shorter side.

    `bold` scales the shapes: small things are seen from afar and need few and large ones.
    """
    width, height = size
    rng = np.random.default_rng(seed)
    inks = PALETTES[palette]
    paper = np.empty((height, width, 3), np.float32)
    paper[:] = inks[0]
    paper += cloud((width, height), 4, rng)[:, :, None] * 10
    canvas = np.ascontiguousarray(np.clip(paper, 0, 255).astype(np.uint8))
    border = int(margin * min(size))
    inner = canvas[border : height - border, border : width - border]
    small = min(inner.shape[:2])
    for share, chance in ((0.36, 0.95), (0.17, 0.75), (0.075, 0.6 / bold**2)):
        _scatter(inner, bold * share * small, chance, inks, rng)
    return canvas


def _scatter(
    canvas: Image, cell: float, chance: float, inks: Sequence[Ink], rng: np.random.Generator
) -> None:
    """Draw one shape into most cells of a shaken grid, so that they spread evenly but never line up."""
    height, width = canvas.shape[:2]
    for row in range(int(np.ceil(height / cell))):
        for column in range(int(np.ceil(width / cell))):
            if rng.random() > chance:
                continue
            x, y = (np.array([column, row]) + 0.5 + rng.uniform(-0.35, 0.35, 2)) * cell
            x, y = float(np.clip(x, 0, width - 1)), float(np.clip(y, 0, height - 1))
            ink = _contrast(canvas[int(y), int(x)], inks, rng)
            _shape(canvas, x, y, cell * rng.uniform(0.28, 0.5), ink, rng)


def _contrast(below: NDArray, inks: Sequence[Ink], rng: np.random.Generator) -> Ink:
    """One of the inks whose grey level differs well from what is already there."""
    grey = np.array([0.3, 0.59, 0.11])
    gaps = np.abs(np.array(inks) @ grey - below @ grey)
    good = np.argsort(gaps)[-3:]
    return inks[int(rng.choice(good))]


def _shape(canvas: Image, x: float, y: float, r: float, ink: Ink, rng: np.random.Generator) -> None:
    """One random shape of about radius `r` px around (x, y), drawn to a sixteenth of a pixel."""
    turn = rng.uniform(0, 2 * np.pi)

    def polygon(*points: tuple[float, float]) -> None:
        c, s = np.cos(turn), np.sin(turn)
        corners = np.array([(x + r * (c * u - s * v), y + r * (s * u + c * v)) for u, v in points])
        cv2.fillPoly(canvas, [np.round(corners * 16).astype(np.int32)], ink, cv2.LINE_AA, 4)

    centre, kind = (round(x * 16), round(y * 16)), rng.integers(0, 9)
    if kind == 0:
        cv2.circle(canvas, centre, round(r * 14), ink, -1, cv2.LINE_AA, 4)
    elif kind == 1:
        cv2.circle(canvas, centre, round(r * 12), ink, max(1, round(r * 0.35)), cv2.LINE_AA, 4)
    elif kind == 2:
        tall = rng.uniform(0.35, 1.0)
        polygon((-1, -tall), (1, -tall), (1, tall), (-1, tall))
    elif kind == 3:
        polygon((1.1, 0), (-0.7, 0.95), (-0.7, -0.95))
    elif kind == 4:
        for k, wide in enumerate(rng.uniform(0.12, 0.3, 3)):
            at = (k - 1) * 0.7
            polygon(
                (-1, at - wide),
                (rng.uniform(0.5, 1.1), at - wide),
                (rng.uniform(0.5, 1.1), at + wide),
                (-1, at + wide),
            )
    elif kind == 5:
        arc = np.linspace(0, np.pi * rng.uniform(0.5, 1.2), 14)
        polygon((0, 0), *[(1.1 * np.cos(t), 1.1 * np.sin(t)) for t in arc])
    elif kind == 6:
        tips = int(rng.integers(4, 7))
        arc = np.arange(2 * tips) * np.pi / tips
        polygon(
            *[
                ((1.1 if k % 2 else 0.45) * np.cos(t), (1.1 if k % 2 else 0.45) * np.sin(t))
                for k, t in enumerate(arc)
            ]
        )
    elif kind == 7:
        polygon((-1, -0.3), (-0.3, -0.3), (-0.3, -1), (0.3, -1), (0.3, -0.3), (1, -0.3),
                (1, 0.3), (0.3, 0.3), (0.3, 1), (-0.3, 1), (-0.3, 0.3), (-1, 0.3))  # fmt: skip
    else:
        letter, size = LETTERS[int(rng.integers(len(LETTERS)))], r / 11.0
        thick = max(1, round(r * 0.3))
        (w, h), _ = cv2.getTextSize(letter, cv2.FONT_HERSHEY_DUPLEX, size, thick)
        cv2.putText(
            canvas,
            letter,
            (round(x - w / 2), round(y + h / 2)),
            cv2.FONT_HERSHEY_DUPLEX,
            size,
            ink,
            thick,
            cv2.LINE_AA,
        )


def cloud(
    size: tuple[int, int], cells: int | tuple[int, int], rng: np.random.Generator, octaves: int = 3
) -> NDArray[np.float32]:
    """(h, w) smooth noise of about -1 to 1, `cells` lumps across (and down) and finer ones over them."""
    width, height = size
    across, down = cells if isinstance(cells, tuple) else (cells, cells)
    total = np.zeros((height, width), np.float32)
    for octave in range(octaves):
        grid = rng.standard_normal((down * 2**octave + 1, across * 2**octave + 1)).astype(np.float32)
        total += cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC) * 0.5 ** (octave + 1)
    return total


def marker(number: int, px: int = 32, quiet: float = 0.6) -> Image:
    """The ArUco code `number` of the 6 x 6 dictionary, in a black frame and a white rim of `quiet` cells.

    Cells are `px` texels wide.
    """
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_50)
    cells = cv2.aruco.generateImageMarker(dictionary, number, 8) // 255
    code = np.kron(cells, np.ones((px, px), np.uint8)) * 235 + 12
    rim = round(quiet * px)
    code = np.pad(code, rim, constant_values=250)
    return np.repeat(code[:, :, None], 3, axis=2)


def ruler(size: tuple[int, int], seed: int) -> Image:
    """A scale: light paper, ticks of uneven length, numbers, and coloured fields between them."""
    width, height = size
    rng = np.random.default_rng(seed)
    picture = np.full((height, width, 3), (244, 239, 224), np.uint8)
    inks = PALETTES["harbour"][1:5]
    step = width / 40
    for k in range(41):
        x = round(k * step)
        tall = (0.62 if k % 5 == 0 else 0.36) * height * rng.uniform(0.75, 1.2)
        wide = 3 if k % 5 == 0 else 2
        cv2.rectangle(picture, (x - wide // 2, 0), (x - wide // 2 + wide - 1, round(tall)), (20, 24, 34), -1)
        if k % 5 == 0 and k < 40:
            number, at = str(10 * (k // 5) + seed % 10), (x + 6, height - 8)
            font = cv2.FONT_HERSHEY_DUPLEX
            cv2.putText(picture, number, at, font, height / 90, (20, 24, 34), 2, cv2.LINE_AA)
        if rng.random() < 0.55:
            ink = inks[int(rng.integers(len(inks)))]
            x0, y0 = x + rng.uniform(0.2, 0.5) * step, height * rng.uniform(0.35, 0.7)
            _shape(picture, float(x0), float(y0), float(height * rng.uniform(0.12, 0.22)), ink, rng)
    return picture
