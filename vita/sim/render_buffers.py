"""What the OpenGL renderer keeps on the graphics side: meshes, and the framebuffers of each camera."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np

from vita.sim.render_cache import StillBodies
from vita.types import Image, Visual


class Part:
    """The triangles of one body that share a texture, on the graphics side."""

    def __init__(
        self,
        ctx: moderngl.Context,
        group: Sequence[Visual],
        programs: Sequence[moderngl.Program],
    ) -> None:
        """`programs` are those for plain and printed surfaces and the one for distances."""
        plain, printed, metric = programs
        self.body = group[0].body
        picture = group[0].texture
        self._texture = None if picture is None else _texture(ctx, picture)
        self.program = plain if picture is None else printed
        rows, faces, start = [], [], 0
        for visual in group:
            count = len(visual.vertices)
            uv = visual.uv if visual.uv is not None else np.zeros((count, 2))
            color = np.broadcast_to(visual.color, (count, 3))
            rows.append(np.hstack([visual.vertices, visual.normals, color, uv]))
            faces.append(np.asarray(visual.faces) + start)
            start += count
        vertices = ctx.buffer(np.vstack(rows).astype("f4").tobytes())
        indices = ctx.buffer(np.vstack(faces).astype("i4").tobytes())
        layout = ("3f 3f 3f 8x", "position", "normal", "color")
        if picture is not None:
            layout = ("3f 3f 3f 2f", "position", "normal", "color", "uv")
        self._shaded = ctx.vertex_array(self.program, [(vertices, *layout)], indices)
        self._metric = ctx.vertex_array(metric, [(vertices, "3f 32x", "position")], indices)

    def draw(self, metric: bool) -> None:
        if metric:
            self._metric.render()
            return
        if self._texture is not None:
            self._texture.use(0)
        self._shaded.render()


class Ranges:
    """The framebuffers of one camera that hold distances instead of colours."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        def target() -> moderngl.Framebuffer:
            return ctx.framebuffer([ctx.renderbuffer(size, 1, dtype="f4")], ctx.depth_renderbuffer(size))

        self.size = size
        self.live, self.background = target(), target()
        self.key: tuple | None = None
        """What the background shows, and from where."""


class View:
    """The framebuffers and the cached background of one camera."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], scale: int) -> None:
        def target(scale: int) -> moderngl.Framebuffer:
            drawn = (scale * size[0], scale * size[1])
            return ctx.framebuffer([ctx.renderbuffer(drawn, 4)], ctx.depth_renderbuffer(drawn))

        self.size = size
        self.live, self.background = target(scale), target(scale)
        self.quick = self.live if scale == 1 else target(1)
        """For pictures with one sample a pixel."""
        self._ranges: dict[int, Ranges] = {}
        self.still = StillBodies()
        self.picture = np.zeros((size[1], size[0], 3), np.uint8)

    def ranges(self, ctx: moderngl.Context, step: int = 1) -> Ranges:
        """The framebuffers for the distances in every step-th row and column, made at the first use."""
        if step not in self._ranges:
            self._ranges[step] = Ranges(ctx, reduced(self.size, step))
        return self._ranges[step]

    def release(self) -> None:
        more = [target for ranges in self._ranges.values() for target in (ranges.live, ranges.background)]
        for target in {self.live, self.background, self.quick, *more}:
            for part in (*target.color_attachments, target.depth_attachment):
                if part is not None:
                    part.release()
            target.release()


def reduced(size: tuple[int, int], step: int) -> tuple[int, int]:
    """(width, height) of every step-th column and row, from the first on [px]."""
    return -(-size[0] // step), -(-size[1] // step)


def same_texture(visuals: Sequence[Visual]) -> list[list[Visual]]:
    """Visuals that can be drawn in one call: same body, same texture."""
    groups: dict[tuple, list[Visual]] = {}
    for visual in visuals:
        groups.setdefault((visual.body, id(visual.texture)), []).append(visual)
    return list(groups.values())


def _texture(ctx: moderngl.Context, picture: Image) -> moderngl.Texture:
    height, width, _ = picture.shape
    texture = ctx.texture((width, height), 3, np.ascontiguousarray(picture).tobytes(), alignment=1)
    texture.build_mipmaps()
    texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    texture.repeat_x = texture.repeat_y = False
    return texture
