"""A mesh of the 3D view, encoded once for all browsers."""

from __future__ import annotations

from dataclasses import dataclass

from vita.types import Visual


@dataclass(frozen=True, eq=False)
class Mesh:
    """A visual as it is sent: plain, or as a GLB when it has a texture."""

    body: str
    visual: Visual
    glb: bytes | None
