"""The calibration file: of one camera here, of a rig by `vita.stereo.rig_file`."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from vita.calibration.pair import PairFit
from vita.calibration.solve import CameraFit
from vita.errors import BadInput
from vita.stereo.rig_file import save_rig


def check_out(out: Path | None, sources: Sequence[str]) -> None:
    """Before any work is done: whether the file can be written, and is none of the sources."""
    if out is None:
        return
    if out.is_dir() or not out.resolve().parent.is_dir():
        raise BadInput("is a folder" if out.is_dir() else "there is no such folder to write into", str(out))
    if any(out.resolve() == Path(source).resolve() for source in sources):
        raise BadInput("--out would overwrite the source", str(out))


def camera_text(fit: CameraFit) -> str:
    """The file of one camera: that of a rig with `[camera]` only."""
    lens = fit.lens
    lines = ["# Calibration of a camera. Pixels: origin at the centre of the top-left one.", "", "[camera]"]
    lines += [f"{name} = {getattr(lens, name)!r}" for name in ("fx", "fy", "cx", "cy")]
    lines += [
        f"distortion = [{', '.join(map(repr, lens.distortion))}]",
        f"size = [{fit.size[0]}, {fit.size[1]}]",
    ]
    return "\n".join([*lines, f"rms_px = {fit.rms_px!r}", ""])


def write_camera(out: Path | None, text: str) -> None:
    """To the file, or to stdout."""
    if out is None:
        print(text, end="")
        return
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"cannot be written: {error.strerror or error}", str(out)) from None


def write_pair(out: Path | None, fit: PairFit) -> None:
    """To the file, or to stdout."""
    sizes = fit.cameras[0].size, fit.cameras[1].size
    if out is None:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "rig.toml"
            save_rig(file, fit.rig, sizes, fit.rms_px)
            print(file.read_text(encoding="utf-8"), end="")
        return
    try:
        save_rig(out, fit.rig, sizes, fit.rms_px)
    except OSError as error:
        raise BadInput(f"cannot be written: {error.strerror or error}", str(out)) from None
