"""Pictures of a printed board, through cameras of which everything is known."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from vita.calibration.board import Board
from vita.calibration.detect import Sighting
from vita.calibration.draw import draw_board
from vita.stereo.base import Lens, StereoRig
from vita.types import Array, Image, frozen

SIZE = (640, 480)
LEFT = Lens(600.0, 604.0, 322.3, 236.1, (-0.2, 0.08, 0.001, -0.0008))
RIGHT = Lens(612.0, 611.0, 316.2, 242.1, (-0.18, 0.05, -0.001, 0.0005))
_PER_SQUARE = 40
_FINER = 2
"""Every pixel is the mean of so many rays across and down."""


def rig() -> StereoRig:
    """The second camera 12 cm to the right, toed in by 9 degrees."""
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([0.02, 0.15, 0.03]))[0]
    T[:3, 3] = (-0.12, 0.004, 0.01)
    return StereoRig(LEFT, RIGHT, T)


def poses(
    board: Board,
    count: int,
    seed: int,
    tilt: float = 0.6,
    aside: float = 0.3,
    near: float = 0.4,
    far: float = 0.6,
) -> list[Array]:
    """(4, 4) T_left_board of boards all over the picture, `aside` a share of the distance."""
    rng = np.random.default_rng(seed)
    middle = np.array([board.cols, board.rows, 0]) * board.square / 2
    found = []
    for _ in range(count):
        T = np.eye(4)
        turn = np.array([rng.uniform(-tilt, tilt), rng.uniform(-tilt, tilt), rng.uniform(-0.3, 0.3)])
        T[:3, :3] = cv2.Rodrigues(turn)[0]
        depth = rng.uniform(near, far)
        x, y = rng.uniform(-aside, aside) * depth, 0.75 * rng.uniform(-aside, aside) * depth
        T[:3, 3] = np.array([x, y, depth]) - T[:3, :3] @ middle
        found.append(T)
    return found


@lru_cache
def _rays(lens: Lens, size: tuple[int, int]) -> np.ndarray:
    """(h, w, 3) directions of finer pixels, distortion taken off."""
    cols, rows = ((np.arange(n * _FINER) + 0.5) / _FINER - 0.5 for n in size)
    grid = np.stack(np.meshgrid(cols, rows), -1).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 8, 1e-6)
    flat = cv2.undistortPoints(grid, lens.matrix, np.append(lens.distortion, 0.0), criteria=stop).reshape(
        -1, 2
    )
    flat = np.asarray(flat, np.float32)
    rays = np.column_stack([flat, np.ones(len(flat), np.float32)])
    return rays.reshape(size[1] * _FINER, size[0] * _FINER, 3)


@lru_cache
def _paper(board: Board) -> Image:
    margin = _PER_SQUARE // 2
    return cv2.copyMakeBorder(  # type: ignore[return-value]
        draw_board(board, _PER_SQUARE), *[margin] * 4, cv2.BORDER_CONSTANT, value=255
    )


def picture(board: Board, lens: Lens, T: Array, noise: float = 2.0, blur: float = 0.6) -> Image:
    """(h, w, 3) RGB of the board at `T` (4, 4) T_camera_board: each pixel's rays meet its plane."""
    return _picture(board, lens, T.tobytes(), noise, blur)


@lru_cache
def _picture(board: Board, lens: Lens, place: bytes, noise: float, blur: float) -> Image:
    T, size = np.frombuffer(place).reshape(4, 4), SIZE
    to_plane = np.linalg.inv(np.column_stack([T[:3, 0], T[:3, 1], T[:3, 3]]))
    meet = _rays(lens, size) @ to_plane.T.astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = meet[..., :2] / meet[..., 2:] / board.square * _PER_SQUARE + _PER_SQUARE // 2 - 0.5
    at = at.astype(np.float32)
    fine = cv2.remap(_paper(board), at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=120.0)
    image = cv2.resize(fine, size, interpolation=cv2.INTER_AREA).astype(np.float32) * 0.8 + 20
    image = cv2.GaussianBlur(image, (0, 0), blur)
    grain = np.random.default_rng(int(1e6 * abs(T[0, 3]))).standard_normal(image.shape, np.float32)
    grey = np.clip(np.rint(image + noise * grain), 0, 255).astype(np.uint8)
    return frozen(np.repeat(grey[..., None], 3, axis=2), np.uint8)


def project(board: Board, lens: Lens, T: Array) -> Array:
    """(n, 2) pixels of all inner corners, also those outside of the picture."""
    rotation = cv2.Rodrigues(np.ascontiguousarray(T[:3, :3]))[0]
    distortion = np.append(np.resize(lens.distortion or 0.0, 4), 0.0)
    uv = cv2.projectPoints(board.corners, rotation, T[:3, 3], lens.matrix, distortion)[0]
    return np.asarray(uv, float).reshape(-1, 2)


def sight(board: Board, lens: Lens, T: Array, rng: np.random.Generator, sigma: float = 0.1) -> Sighting:
    """What a perfect finder would see, with noise; without a picture it costs nothing."""
    uv = project(board, lens, T) + rng.normal(0, sigma, (len(board.corners), 2))
    inside = ((uv > 1) & (uv < np.array(SIZE) - 2)).all(axis=1)
    return Sighting(np.flatnonzero(inside), frozen(uv[inside]), 2.0)


def sights(
    board: Board, lens: Lens, Ts: Sequence[Array], seed: int = 0, sigma: float = 0.1
) -> dict[str, Sighting]:
    """Of many views, by name; those with too few corners are left out."""
    rng = np.random.default_rng(seed)
    seen = {str(i): sight(board, lens, T, rng, sigma) for i, T in enumerate(Ts)}
    return {name: s for name, s in seen.items() if len(s.ids) >= 8}


def write(folder: Path, images: Sequence[Image]) -> Path:
    """A folder of PNG files."""
    folder.mkdir(parents=True)
    for number, image in enumerate(images):
        cv2.imwrite(str(folder / f"{number}.png"), image)
    return folder
