"""Files for the tests of `vita track`, made from frames with exact ground truth."""

from __future__ import annotations

import contextlib
import csv
import io
import sys
from pathlib import Path

import cv2
import numpy as np
from sequences import Sequence, swing

from vita import cli
from vita.tracking.show import CODECS

COLUMNS = "frame,tracker,status,u,v,x0,y0,x1,y1,x2,y2,x3,y3,score"
SCENE = Sequence(swing(2.0), frames=24, noise=1.0)
FRAMES = list(SCENE)
AT = (160.0, 120.0)
VITA = [sys.executable, "-m", "vita", "track"]
Row = dict[str, str]


def run(*arguments: object) -> tuple[int, str, str]:
    """Exit code, output and complaints of `vita track` with these arguments."""
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = cli.main(["track", *map(str, arguments)])
    return code, out.getvalue(), err.getvalue()


def rows_of(text: str) -> list[Row]:
    assert text.splitlines()[0] == COLUMNS
    return list(csv.DictReader(io.StringIO(text)))


def pixel(row: Row) -> np.ndarray:
    return np.array([float(row["u"]), float(row["v"])])


def corners(row: Row) -> np.ndarray:
    return np.array([[float(row[f"x{k}"]), float(row[f"y{k}"])] for k in range(4)])


def errors(rows: list[Row]) -> np.ndarray:
    """(n,) distance of each row's pixel to the truth [px]."""
    at = pixel(rows[0]) if rows[0]["frame"] == "0" else np.array(AT)
    return np.array([np.hypot(*(pixel(row) - SCENE.truth(at, int(row["frame"])))) for row in rows])


def save(path: Path, picture: np.ndarray) -> None:
    bgr = picture[:, :, ::-1] if picture.ndim == 3 and picture.shape[2] == 3 else picture
    assert cv2.imwrite(str(path), bgr)


def write_folder(folder: Path, pictures: list[np.ndarray], name: str = "frame_{}.png") -> Path:
    folder.mkdir()
    for k, picture in enumerate(pictures):
        save(folder / name.format(k), picture)
    return folder


def write_video(path: Path, pictures: list[np.ndarray]) -> Path:
    height, width = pictures[0].shape[:2]
    out = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*CODECS[path.suffix]), 25.0, (width, height))
    for picture in pictures:
        out.write(np.ascontiguousarray(picture[:, :, ::-1]))
    out.release()
    return path


def read_video(path: Path) -> list[np.ndarray]:
    source, frames = cv2.VideoCapture(str(path)), []
    while (got := source.read())[0]:
        frames.append(np.asarray(got[1])[:, :, ::-1].astype(int))
    return frames
