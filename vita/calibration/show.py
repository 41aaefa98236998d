"""The views with what was found drawn in: corners in green, and how far the fit is off, magnified, in red."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from vita.calibration.board import Board
from vita.calibration.detect import Sighting
from vita.calibration.solve import CameraFit
from vita.calibration.views import View
from vita.errors import BadInput
from vita.types import Array

MAGNIFIED = 50
"""Errors are drawn so many times as long as they are."""
_GREEN, _RED, _WHITE, _BLACK = (60, 200, 60), (40, 40, 230), (255, 255, 255), (0, 0, 0)


def show_views(
    folder: Path, board: Board, views: Sequence[View], fits: Sequence[CameraFit], names: Sequence[str]
) -> None:
    """Write `NAME_00.jpg`, ... for each camera; also those views that the fit dropped."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for camera, (fit, name) in enumerate(zip(fits, names, strict=True)):
            for number, view in enumerate(views):
                sight, packed = view.sights[camera], view.pictures[camera] if view.pictures else None
                if sight is not None and packed:
                    picture = _drawn(board, packed, sight, fit, view.name)
                    (folder / f"{name}_{number:02d}.jpg").write_bytes(
                        cv2.imencode(".jpg", picture)[1].tobytes()
                    )
    except OSError as error:
        raise BadInput(f"cannot be written: {error.strerror or error}", str(folder)) from None


def _drawn(board: Board, packed: bytes, sight: Sighting, fit: CameraFit, name: str) -> np.ndarray:
    picture = np.asarray(cv2.imdecode(np.frombuffer(packed, np.uint8), cv2.IMREAD_COLOR))
    thick = max(1, round(max(fit.size) / 1000))
    for uv in sight.uv:
        cv2.circle(picture, _whole(uv), 4 * thick, _GREEN, thick, cv2.LINE_AA)
    words = f"{name}: dropped"
    if name in fit.poses:
        pose = fit.poses[name]
        distortion = np.append(fit.values[4:], 0.0)
        projected = cv2.projectPoints(
            board.corners[sight.ids], pose[:3], pose[3:], fit.lens.matrix, distortion
        )[0]
        for uv, other in zip(sight.uv, np.reshape(projected, (-1, 2)), strict=True):
            cv2.line(picture, _whole(uv), _whole(uv + MAGNIFIED * (uv - other)), _RED, thick, cv2.LINE_AA)
        words = f"{name}: {fit.errors[name]:.2f} px, errors x {MAGNIFIED}"
    for colour, extra in ((_BLACK, 3), (_WHITE, 0)):
        at = (8 * thick, 20 * thick)
        cv2.putText(
            picture, words, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5 * thick, colour, thick + extra, cv2.LINE_AA
        )
    return picture


def _whole(uv: Array) -> tuple[int, int]:
    return int(np.clip(round(float(uv[0])), -9999, 99999)), int(np.clip(round(float(uv[1])), -9999, 99999))
