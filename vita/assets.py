"""Finds the files that ship with vita, in a source checkout and in an installed wheel alike."""

from __future__ import annotations

from pathlib import Path

from vita.errors import MissingDependency

PACKAGE = Path(__file__).resolve().parent


def asset(*parts: str) -> Path:
    """The path of a file or folder in the assets, e.g. `asset("robots", "wam", "wam7.urdf")`.

    A wheel carries the assets inside the package (`vita/_assets`); a source checkout has them
    beside it (`assets/`). Raises `MissingDependency` when neither has what is asked for.
    """
    # The checkout comes second, so that an unrelated folder called `assets` beside an installed
    # package is never taken for ours.
    roots = (PACKAGE / "_assets", PACKAGE.parent / "assets")
    for root in roots:
        path = root.joinpath(*parts)
        if path.exists():
            return path
    wanted = "/".join(parts) or "the folder itself"
    raise MissingDependency(
        f"vita's assets are incomplete: {wanted} was not found in "
        f"{' or '.join(str(root) for root in roots)}. Install vita again, or run it from a full checkout."
    )
