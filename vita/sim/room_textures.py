"""Calm pictures for the surroundings: wood, floor tiles, and a workshop wall. (h, w, 3) RGB bytes."""

from __future__ import annotations

import cv2
import numpy as np

from vita.sim.textures import PALETTES, cloud, poster
from vita.types import Image


def wood(size: tuple[int, int], planks: int, seed: int) -> Image:
    """A table top: planks along the picture's columns, each with its own hue, grain and joints."""
    width, height = size
    rng = np.random.default_rng(seed)
    edges = np.round(np.linspace(0, width, planks + 1) + np.r_[0, rng.uniform(-8, 8, planks - 1), 0]).astype(
        int
    )
    picture = np.empty((height, width, 3), np.float32)
    rows = np.linspace(0, 1, height, dtype=np.float32)[:, None]
    for left, right in zip(edges[:-1], edges[1:], strict=True):
        wide = right - left
        across = np.linspace(0, 1, wide, dtype=np.float32)[None, :]
        warp = cloud((wide, height), (2, 4), rng)
        rings = np.sin((across * rng.uniform(4, 8) + warp * 0.8 + rows * rng.uniform(-1, 1)) * 2 * np.pi)
        fibre = cloud((wide, height), (max(2, wide // 6), 6), rng, 2)
        shade = 0.5 + 0.09 * rings + 0.20 * fibre + rng.uniform(-0.22, 0.22)
        dark, light = np.array([142, 96, 58], np.float32), np.array([205, 160, 110], np.float32)
        plank = dark + (light - dark) * shade[:, :, None]
        plank[:, :2] *= 0.55
        joint = int(rng.uniform(0.15, 0.85) * height)
        plank[joint : joint + 2] *= 0.6
        plank[joint:] *= rng.uniform(0.9, 1.08)
        picture[:, left:right] = plank
    return np.clip(picture, 0, 255).astype(np.uint8)


def tiles(size: int, count: int, seed: int) -> Image:
    """A floor of `count` x `count` soft grey tiles, no two alike."""
    rng = np.random.default_rng(seed)
    base = 158 + 7 * cloud((size, size), 6, rng, 3) + 3 * cloud((size, size), size // 6, rng, 1)
    tone = cv2.resize(
        rng.uniform(-9, 9, (count, count)).astype(np.float32), (size, size), interpolation=cv2.INTER_NEAREST
    )
    picture = (base + tone)[:, :, None] * np.array([1.0, 0.985, 0.96], np.float32)
    for line in np.round(np.linspace(0, size, count + 1)).astype(int):
        picture[max(0, line - 1) : line + 1] *= 0.86
        picture[:, max(0, line - 1) : line + 1] *= 0.86
    return np.clip(picture, 0, 255).astype(np.uint8)


def wall(size: tuple[int, int], seed: int) -> Image:
    """A workshop wall: plaster over a painted band, pegboards with tools, shelves with boxes, a poster."""
    width, height = size
    rng = np.random.default_rng(seed)
    plaster = (226 + 4 * cloud(size, (8, 4), rng))[:, :, None] * np.array([1.0, 0.99, 0.965], np.float32)
    band = round(0.66 * height)
    plaster[band:] = plaster[band:] * np.array([0.52, 0.66, 0.68], np.float32)
    plaster[band - 3 : band] *= 0.75
    plaster[-round(0.035 * height) :] *= 0.6
    picture = np.ascontiguousarray(np.clip(plaster, 0, 255).astype(np.uint8))
    x = 0.03 * width
    while x < 0.9 * width:
        wide = rng.uniform(0.10, 0.17) * width
        x0, x1 = round(x), round(min(x + wide, 0.98 * width))
        y0, y1 = round(rng.uniform(0.16, 0.26) * height), round(rng.uniform(0.52, 0.6) * height)
        kind = rng.integers(0, 3)
        if kind == 0:
            _pegboard(picture[y0:y1, x0:x1], rng)
        elif kind == 1:
            _shelves(picture[y0:y1, x0:x1], rng)
        else:
            palette = sorted(PALETTES)[int(rng.integers(len(PALETTES)))]
            tall = min(y1 - y0, round(1.3 * (x1 - x0)))
            picture[y0 : y0 + tall, x0:x1] = poster(
                (x1 - x0, tall), palette, int(rng.integers(1 << 30)), 0.08
            )
            cv2.rectangle(picture, (x0, y0), (x1, y0 + tall), (60, 56, 52), 2)
        x += wide + rng.uniform(0.03, 0.08) * width
    return picture


def _pegboard(area: Image, rng: np.random.Generator) -> None:
    """A board with holes on which silhouettes of tools hang."""
    height, width = area.shape[:2]
    area[:] = (190, 162, 124)
    area[4::9, 4::9] = (120, 98, 72)
    slots = max(2, width // 26)
    for k in range(slots):
        x, long = round((k + 0.5) * width / slots), rng.uniform(0.45, 0.8) * height
        ink = [(48, 50, 56), (178, 54, 44), (40, 92, 130), (210, 150, 40)][int(rng.integers(4))]
        top = round(0.1 * height)
        cv2.line(area, (x, top), (x, round(top + long)), (70, 72, 78), 3, cv2.LINE_AA)
        cv2.line(area, (x, round(top + 0.55 * long)), (x, round(top + long)), ink, 7, cv2.LINE_AA)
        if rng.random() < 0.6:
            cv2.line(area, (x - 8, top + 3), (x + 8, top + 3), (60, 62, 68), 8, cv2.LINE_AA)
    cv2.rectangle(area, (0, 0), (width - 1, height - 1), (96, 74, 52), 3)


def _shelves(area: Image, rng: np.random.Generator) -> None:
    """Three shelves of coloured boxes and tins."""
    height, width = area.shape[:2]
    area[:] = (206, 203, 196)
    inks = [(196, 72, 54), (52, 98, 128), (224, 172, 70), (92, 124, 88), (236, 232, 222), (74, 70, 78)]
    for k in range(3):
        floor = round((k + 1) * height / 3) - 5
        x = 4.0
        while x < width - 12:
            wide, tall = rng.uniform(10, 26), rng.uniform(0.4, 0.85) * (height / 3 - 6)
            x1 = min(round(x + wide), width - 4)
            ink = inks[int(rng.integers(len(inks)))]
            cv2.rectangle(area, (round(x), round(floor - tall)), (x1, floor), ink, -1)
            cv2.rectangle(
                area,
                (round(x), round(floor - 0.6 * tall)),
                (x1, round(floor - 0.4 * tall)),
                (238, 234, 226),
                -1,
            )
            x = x1 + rng.uniform(1, 7)
        area[floor : floor + 5] = (128, 92, 60)
    cv2.rectangle(area, (0, 0), (width - 1, height - 1), (128, 92, 60), 4)
