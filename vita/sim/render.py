"""Camera images of a scene: the seam, and the choice between OpenGL and the fallback.

`make_renderer` takes the meshes of a scene once; `Renderer.render` then draws them from any camera at
any poses. The OpenGL renderer is the one to use; TinyRenderer (slow, coarse) takes over, and says so,
where no OpenGL context can be made. A renderer belongs to the thread that made it.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from vita.errors import MissingDependency, UnknownName
from vita.sim.camera import PinholeCamera
from vita.types import Array, Image, Visual

BACKENDS = ("auto", "gl", "tiny")
NEAR_M, FAR_M = 0.02, 30.0
"""Nothing nearer or farther than this is drawn [m]."""
STILL_AFTER = 3
"""A camera that moved gets plain pictures until it has stood still for this many, so that one which
moves by fits and starts does not pay for the better ones each time."""


class Renderer(Protocol):
    """Draws one fixed set of meshes."""

    name: str
    """`gl` or `tiny`."""

    def render(self, camera: PinholeCamera, T_world_camera: Array, poses: Mapping[str, Array]) -> Image:
        """(height, width, 3) RGB picture, read-only. `poses` maps each body to its (4, 4) T_world_body."""
        ...

    def depth(
        self, camera: PinholeCamera, T_world_camera: Array, poses: Mapping[str, Array], step: int = 1
    ) -> NDArray[np.float32]:
        """(height, width) distance along the optical axis at the pixel centres [m]; inf where nothing is.

        With a `step`, only every step-th row and column, from the first on: cheaper by as much.
        """
        ...

    def close(self) -> None: ...


def make_renderer(
    visuals: Sequence[Visual], backend: Literal["auto", "gl", "tiny"] = "auto", samples: int = 4
) -> Renderer:
    """A renderer of `visuals`; `samples` (0 or 4) is the antialiasing of the OpenGL one.

    `auto` takes OpenGL and falls back to TinyRenderer with a warning that names the reason; `gl`
    raises `MissingDependency` instead.
    """
    if backend not in BACKENDS:
        raise UnknownName("renderer", backend, BACKENDS)
    if backend != "tiny":
        try:
            from vita.sim.render_gl import GlRenderer

            return GlRenderer(visuals, samples)
        except Exception as error:  # A missing module, driver or extension: each raises its own kind.
            reason = f"{type(error).__name__}: {error}"
            if backend == "gl":
                raise MissingDependency(
                    f"no OpenGL context ({reason}). Install Mesa's EGL, e.g. "
                    "apt install libegl1 libegl-mesa0 libgl1-mesa-dri, and the package moderngl."
                ) from error
        warnings.warn(
            f"No OpenGL context ({reason}): camera images come from pybullet's TinyRenderer, which is "
            "about ten times slower and coarser. Install libegl1, libegl-mesa0 and libgl1-mesa-dri.",
            RuntimeWarning,
            stacklevel=2,
        )
    from vita.sim.render_tiny import TinyRenderer

    return TinyRenderer(visuals)


def body_poses(bodies: Sequence[str], poses: Mapping[str, Array]) -> dict[str, Array]:
    """The pose of each body that is drawn; `world` is the identity unless it is given."""
    found = {}
    for body in bodies:
        if body in poses:
            found[body] = np.asarray(poses[body], dtype=float)
        elif body == "world":
            found[body] = np.eye(4)
        else:
            raise UnknownName("body of a visual without a pose", body, poses)
    return found
