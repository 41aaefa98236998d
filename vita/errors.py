"""Errors that callers can act on. Each names the culprit and lists the choices."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence


class VitaError(Exception):
    """Root of every error that vita raises on purpose."""

    exit_code = 2


class BadInput(VitaError, ValueError):
    """A file, command or value is wrong. `path` says where, e.g. `constraint[1].kind`."""

    def __init__(self, message: str, path: str = "") -> None:
        super().__init__(f"{path}: {message}" if path else message)
        self.path = path


class UnknownName(BadInput):
    """A name that is not among the choices."""

    def __init__(self, what: str, name: object, choices: Iterable[str], path: str = "") -> None:
        self.name, self.choices = name, tuple(choices)
        close = difflib.get_close_matches(str(name), self.choices, n=1)
        hint = f" Did you mean {close[0]!r}?" if close else ""
        listed = ", ".join(self.choices) or "none"
        super().__init__(f"unknown {what} {name!r}.{hint} Choices: {listed}.", path)


class Untrackable(BadInput):
    """The clicked place has nothing that a tracker could hold on to.

    `suggestion` is the nearest pixel (column, row) that would do, or None.
    """

    def __init__(self, message: str, path: str = "", suggestion: Sequence[float] | None = None) -> None:
        super().__init__(message, path)
        self.suggestion = suggestion


class NotNow(VitaError):
    """The request is fine but the arm is moving, or the robot is offline."""


class MissingDependency(VitaError):
    """The environment lacks something (OpenGL, a package, a browser)."""

    exit_code = 3


class RigOffline(VitaError):
    """The robot or the simulation does not answer."""


class RigLate(RigOffline):
    """The robot or the simulation lives but has sent no picture for a while; it may come back."""
