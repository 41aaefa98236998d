"""The OpenGL renderer: a few draw calls per body, and a background that is drawn once.

Most of a servoing scene stands still, and on software OpenGL every pixel costs. So each camera keeps
the samples (colour and depth) of everything that stands still, and a frame copies them and draws only
what moves, inside the rectangle that the moving bodies cover. Copying samples loses nothing: the
picture equals a full drawing to the bit. A camera that moves itself has nothing to copy; it gets one
sample a pixel instead of four until it stands still.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import cast

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from vita.errors import BadInput
from vita.sim.camera import PinholeCamera
from vita.sim.gl_copy import Box, rectangle_copy
from vita.sim.render import FAR_M, NEAR_M, body_poses
from vita.sim.render_buffers import Part, View, reduced, same_texture
from vita.sim.shaders import BACKDROP, METRIC, PLAIN, PRINTED
from vita.types import Array, Image, Visual

MOST_VIEWS = 16
"""Cameras whose buffers are kept; the oldest gives way."""
MARGIN_PX = 2
"""Widens the rectangle of the moving bodies, for antialiased edges [px]."""


class GlRenderer:
    """Draws with moderngl on a context without a window (EGL; Mesa's software driver will do)."""

    name = "gl"

    def __init__(self, visuals: Sequence[Visual], samples: int = 4, cache: bool = True) -> None:
        """`cache=False` draws everything anew each time (for tests and benchmarks)."""
        self._thread = threading.get_ident()
        with _one_core():
            self._ctx = moderngl.create_context(standalone=True, backend="egl")  # pyright: ignore[reportArgumentType]
        with self._ctx:
            # Drawing at twice the size costs less than multisampling here, as Mesa's software driver is
            # slow at small multisampled triangles, and it smooths what is printed on things as well.
            self._scale = 2 if samples else 1
            programs = [self._ctx.program(*source) for source in (PLAIN, PRINTED, METRIC)]
            self._plain, self._printed, self._metric = programs
            self._backdrop = self._ctx.program(*BACKDROP)
            self._backdrop_array = self._ctx.vertex_array(self._backdrop, [])
            self._copy = rectangle_copy(self._ctx)
            self._parts = [Part(self._ctx, group, programs) for group in same_texture(visuals)]
            # The surroundings come last: what they would draw behind the others is then left out early.
            self._parts.sort(key=lambda part: part.body == "world")
            self._views: dict[tuple, View] = {}
        self._bodies = tuple(dict.fromkeys(part.body for part in self._parts))
        self._corners = {body: _corners(visuals, body) for body in self._bodies}
        self._cache = cache

    def render(self, camera: PinholeCamera, T_world_camera: Array, poses: Mapping[str, Array]) -> Image:
        """(height, width, 3) RGB picture, read-only."""
        placed, T = self._checked(poses), np.asarray(T_world_camera, dtype=float)
        whole = (0, 0, *camera.size)
        with self._ctx:
            view = self._view(camera)
            view.still.see(camera.fov_deg, T, placed)
            if view.still.camera_moved:
                # Nothing can be kept from such a picture, so that it must be cheap to draw: one sample a
                # pixel, until the camera stands still again.
                self._draw_all(view.quick, 1, camera, T, placed, self._bodies)
                return _frozen(self._read(view.quick, 1, whole))
            if not self._cache:
                self._draw_all(view.live, self._scale, camera, T, placed, self._bodies)
                return _frozen(self._read(view.live, self._scale, whole))
            if view.still.stale:
                view.still.renew()
                self._draw_all(view.background, self._scale, camera, T, placed, view.still.bodies)
                view.picture = _frozen(self._read(view.background, self._scale, whole))
            moving = [body for body in self._bodies if body not in view.still.bodies]
            box = self._box(camera, T, placed, moving) if moving else None
            if box is None:
                return view.picture
            x, y, width, height = (self._scale * edge for edge in box)
            # What lies outside the box is stale and is never read.
            self._copy(view.background, view.live, (x, y, width, height))
            _use(view.live, (x, y, width, height))
            self._draw_bodies(camera, T, placed, moving)
            _use(view.live, None)
            picture = view.picture.copy()
            x, y, width, height = box
            picture[y : y + height, x : x + width] = self._read(view.live, self._scale, box)
            return _frozen(picture)

    def depth(
        self, camera: PinholeCamera, T_world_camera: Array, poses: Mapping[str, Array], step: int = 1
    ) -> NDArray[np.float32]:
        """(height, width) distance along the optical axis [m]; inf where nothing is drawn. With a `step`,
        only every step-th row and column."""
        placed, T = self._checked(poses), np.asarray(T_world_camera, dtype=float)
        with self._ctx:
            view = self._view(camera)
            ranges = view.ranges(self._ctx, step)
            # What stood still in the pictures is kept here as well, for as long as it is where it was.
            still = [body for body in self._bodies if self._cache and body in view.still.bodies]
            key = (camera.fov_deg, T.tobytes(), *((body, placed[body].tobytes()) for body in still))
            if ranges.key != key:
                ranges.key = key
                ranges.background.use()
                ranges.background.clear(red=np.inf, depth=1.0)
                self._draw_bodies(camera, T, placed, still, metric=True, step=step)
            width, height = ranges.size
            self._copy(ranges.background, ranges.live, (0, 0, width, height))
            ranges.live.use()
            moving = [body for body in self._bodies if body not in still]
            self._draw_bodies(camera, T, placed, moving, metric=True, step=step)
            values = np.frombuffer(ranges.live.read(components=1, dtype="f4"), np.float32)
        return values.reshape(height, width)

    def close(self) -> None:
        """Give the context and all that it holds back."""
        if self._views is not None:
            self._ctx.release()
            self._views = {}

    def _checked(self, poses: Mapping[str, Array]) -> dict[str, Array]:
        if threading.get_ident() != self._thread:
            raise BadInput("a renderer draws only in the thread that made it")
        return body_poses(self._bodies, poses)

    def _view(self, camera: PinholeCamera) -> View:
        key = (camera.name, camera.size)
        if key not in self._views:
            if len(self._views) >= MOST_VIEWS:
                self._views.pop(next(iter(self._views))).release()
            self._views[key] = View(self._ctx, camera.size, self._scale)
        return self._views[key]

    def _draw_all(self, target, scale: int, camera: PinholeCamera, T: Array, placed, bodies) -> None:
        """Draw `bodies` and, where they leave it free, the backdrop into `target` from scratch."""
        _put(self._printed, "sharpen", np.array(-0.5 if scale == 1 else 0.0))
        target.use()
        target.clear(depth=1.0)
        self._draw_bodies(camera, T, placed, bodies)
        f, (width, height) = camera.focal_px, camera.size
        ray = T[:3, :3] @ np.diag([0.5 * width / f, 0.5 * height / f, 1.0])
        _put(self._backdrop, "world_from_ndc", ray.T)
        self._ctx.enable_only(moderngl.DEPTH_TEST)
        self._ctx.depth_func = "<="
        self._backdrop_array.render(moderngl.TRIANGLES, vertices=3)

    def _draw_bodies(
        self, camera: PinholeCamera, T: Array, placed, bodies, metric: bool = False, step: int = 1
    ) -> None:
        """Draw `bodies`, or their distances, over what the bound framebuffer holds."""
        ctx = self._ctx
        ctx.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        # Row 0 of the framebuffer is the top row of the picture, so that front faces turn the other way.
        ctx.front_face = "cw"
        ctx.depth_func = "<"
        camera_from_world = _inverse(T)
        clip_from_camera = clip_matrix(camera, step)
        for part in self._parts:
            if part.body not in bodies:
                continue
            # Things lying flush on the table or floor win over it.
            ctx.polygon_offset = (1.0, 2.0) if part.body == "world" else (0.0, 0.0)
            pose = placed[part.body]
            camera_from_body = camera_from_world @ pose
            program = self._metric if metric else part.program
            _put(program, "clip_from_body", (clip_from_camera @ camera_from_body).T)
            if metric:
                _put(program, "distance_from_body", camera_from_body[2])
            else:
                _put(program, "world_from_body", pose.T)
                if program is self._plain:  # Printed paper has no highlight.
                    _put(program, "eye", T[:3, 3])
            part.draw(metric)

    def _read(self, source: moderngl.Framebuffer, scale: int, box: Box) -> Image:
        """The part of the picture in `box`, shrunk from a drawing `scale` times its size."""
        x, y, width, height = box
        drawn = np.empty((scale * height, scale * width, 4), np.uint8)
        # Four components: three make the driver convert every pixel, which costs more than all else.
        place = (scale * x, scale * y, scale * width, scale * height)
        source.read_into(drawn, viewport=place, components=4)
        if scale > 1:  # Each pixel is the mean of 2 x 2 drawn ones.
            drawn = cv2.resize(drawn, (width, height), interpolation=cv2.INTER_AREA)
        return np.asarray(cv2.cvtColor(drawn, cv2.COLOR_RGBA2RGB), np.uint8)

    def _box(self, camera: PinholeCamera, T: Array, placed: Mapping[str, Array], bodies) -> Box | None:
        """The pixels that `bodies` can touch; None when there are none."""
        poses = np.array([placed[body] for body in bodies])
        corners = np.array([self._corners[body] for body in bodies])
        points = (corners @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]).reshape(-1, 3)
        if ((points - T[:3, 3]) @ T[:3, 2]).min() < NEAR_M:
            return (0, 0, *camera.size)
        uv = np.clip(camera.project(T, points), -1e6, 1e6)
        x0, y0 = np.maximum(np.floor(uv.min(axis=0)).astype(int) - MARGIN_PX, 0).tolist()
        x1, y1 = np.minimum(np.ceil(uv.max(axis=0)).astype(int) + MARGIN_PX + 1, camera.size).tolist()
        return (x0, y0, x1 - x0, y1 - y0) if x1 > x0 and y1 > y0 else None


@contextmanager
def _one_core() -> Iterator[None]:
    """Keep Mesa's software driver from starting threads of its own, unless the user has set how many.

    It waits for all of them at the end of each picture. On an idle machine they save little, on a busy
    one they make the slowest pictures take twice as long, and the other cores are for the trackers.
    """
    name = "LP_NUM_THREADS"
    chosen = os.environ.get(name)
    os.environ[name] = chosen or "0"
    try:
        yield
    finally:
        # The driver has read it by now, and other programs may be started from this one.
        if chosen is None:
            del os.environ[name]
        else:
            os.environ[name] = chosen


def _inverse(T: Array) -> Array:
    """The inverse of a rigid pose."""
    inverse = np.eye(4)
    inverse[:3, :3] = T[:3, :3].T
    inverse[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return inverse


def clip_matrix(camera: PinholeCamera, step: int = 1) -> Array:
    """(4, 4) OpenGL clip coordinates from camera coordinates, with the picture's rows downwards.

    For a picture of every `step`-th row and column: its pixel j has the centre of the camera's pixel
    step * j, so that the first pixels of both share their centres.
    """
    (width, height), f = camera.size, camera.focal_px / step
    span = FAR_M - NEAR_M
    wide, high = reduced(camera.size, step)
    # Where the optical axis goes through the picture, beyond its middle [its own pixels].
    right = 0.5 * (width - 1) / step - 0.5 * (wide - 1)
    down = 0.5 * (height - 1) / step - 0.5 * (high - 1)
    return np.array(
        [
            [2 * f / wide, 0, 2 * right / wide, 0],
            [0, 2 * f / high, 2 * down / high, 0],
            [0, 0, (FAR_M + NEAR_M) / span, -2 * FAR_M * NEAR_M / span],
            [0, 0, 1, 0],
        ]
    )


def _corners(visuals: Sequence[Visual], body: str) -> Array:
    """(8, 3) corners of the box around a body, in its own frame [m]."""
    points = np.vstack([visual.vertices for visual in visuals if visual.body == body])
    low, high = points.min(axis=0), points.max(axis=0)
    return np.array(
        [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    )


def _frozen(picture: NDArray[np.uint8]) -> Image:
    picture.setflags(write=False)
    return picture


def _put(program: moderngl.Program, name: str, values: Array) -> None:
    """Set a uniform; matrices go in column by column."""
    cast(moderngl.Uniform, program[name]).write(np.asarray(values, np.float32).tobytes())


def _use(target: moderngl.Framebuffer, box: Sequence[int] | None) -> None:
    """Draw into `target` from now on, only within `box` (x, y, width, height) if given."""
    target.scissor = None if box is None else tuple(box)  # pyright: ignore[reportAttributeAccessIssue]
    target.use()
