"""The calibration file of a stereo rig: what `vita calibrate` writes and the stereo mode reads (TOML).

[left]
fx, fy, cx, cy [px], distortion = [k1, k2, p1, p2, k3], size = [width, height]
[right]
the same
[stereo]
T_right_left = 4 x 4 nested list (maps left-camera coordinates into the right camera's) [m], rms_px
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vita.errors import BadInput, UnknownName
from vita.stereo.base import Lens, StereoRig
from vita.types import Array

MAX_BYTES = 100_000
LENS_KEYS = ("fx", "fy", "cx", "cy", "distortion", "size")
STEREO_KEYS = ("T_right_left", "rms_px")
Size = tuple[int, int]


def save_rig(path: str | os.PathLike[str], rig: StereoRig, sizes: tuple[Size, Size], rms_px: float) -> None:
    """Write a calibration. `sizes` are (width, height) of the left and the right pictures [px]."""
    lines = ["# Calibration of a stereo rig. Pixels: origin at the centre of the top-left one. Metres."]
    for name, lens, size in (("left", rig.left, sizes[0]), ("right", rig.right, sizes[1])):
        lines += ["", f"[{name}]"]
        lines += [f"{key} = {_number(getattr(lens, key))}" for key in ("fx", "fy", "cx", "cy")]
        lines += [f"distortion = [{', '.join(_number(k) for k in lens.distortion)}]"]
        lines += [f"size = [{int(size[0])}, {int(size[1])}]"]
    lines += ["", "[stereo]", f"rms_px = {_number(rms_px)}", "T_right_left = ["]
    lines += [f"  [{', '.join(_number(x) for x in row)}]," for row in rig.T_right_left.tolist()]
    Path(path).write_text("\n".join([*lines, "]", ""]), encoding="utf-8")


def load_rig(path: str | os.PathLike[str]) -> StereoRig:
    """The rig of a calibration file. `BadInput` names the file and the key that is wrong."""
    file = Path(path)
    try:
        if file.stat().st_size > MAX_BYTES:
            raise BadInput(f"larger than any calibration ({MAX_BYTES} bytes)")
        table = tomllib.loads(file.read_text(encoding="utf-8"))
        return _rig(table)
    except OSError as error:
        raise BadInput(f"cannot be read: {error.strerror or error}", str(path)) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BadInput(f"is no TOML file: {error}", str(path)) from None
    except BadInput as error:
        error.args = (f"{path}: {error}",)
        raise


def _rig(table: Mapping[str, Any]) -> StereoRig:
    _known(table, ("left", "right", "stereo"), "")
    stereo = _table(table, "stereo", STEREO_KEYS)
    T = _numbers(stereo, "T_right_left", "stereo", (4, 4))
    R = T[:3, :3]
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-3 or np.linalg.det(R) < 0 or np.abs(T[3] - (0, 0, 0, 1)).max():
        raise BadInput("its rows are no rotation, translation and (0, 0, 0, 1)", "stereo.T_right_left")
    # A file with few digits holds a rotation that is almost one: the nearest that is.
    U, _, V = np.linalg.svd(R)
    T[:3, :3] = U @ V
    return StereoRig(_lens(table, "left"), _lens(table, "right"), T)


def _lens(table: Mapping[str, Any], name: str) -> Lens:
    own = _table(table, name, LENS_KEYS)
    fx, fy, cx, cy = (float(_numbers(own, key, name, ())) for key in ("fx", "fy", "cx", "cy"))
    distortion = _numbers(own, "distortion", name, None) if "distortion" in own else np.zeros(0)
    if distortion.size not in (0, 4, 5):
        raise BadInput("expected none, or k1, k2, p1, p2 and maybe k3", f"{name}.distortion")
    size = _numbers(own, "size", name, (2,))
    if (size < 1).any():
        raise BadInput(f"expected a width and a height [px], got {size.tolist()}", f"{name}.size")
    try:
        return Lens(fx, fy, cx, cy, tuple(distortion.tolist()))
    except BadInput as error:
        raise BadInput(str(error), name) from None


def _table(table: Mapping[str, Any], name: str, keys: tuple[str, ...]) -> Mapping[str, Any]:
    own = table.get(name)
    if not isinstance(own, Mapping):
        raise BadInput("this table is missing", name)
    _known(own, keys, name)
    return own


def _known(table: Mapping[str, Any], keys: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in keys:
            raise UnknownName("key", key, keys, where)


def _numbers(table: Mapping[str, Any], key: str, where: str, shape: tuple[int, ...] | None) -> Array:
    """The finite numbers of one key; `shape` None is a list of any length."""
    where = f"{where}.{key}"
    if key not in table:
        raise BadInput("is missing", where)
    try:
        values = np.array(table[key], dtype=float)
    except (TypeError, ValueError):
        raise BadInput(f"expected numbers, got {table[key]!r}", where) from None
    if (values.ndim != 1) if shape is None else (values.shape != shape):
        wanted = "a list" if shape is None else "a number" if shape == () else f"shape {shape}"
        raise BadInput(f"expected {wanted}, got {table[key]!r}", where)
    if not np.isfinite(values).all():
        raise BadInput("all numbers must be finite", where)
    return values


def _number(value: float) -> str:
    """A TOML float that reads back to the bit."""
    text = repr(float(value))
    return text if any(c in text for c in ".en") else text + ".0"
