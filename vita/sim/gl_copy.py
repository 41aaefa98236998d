"""Copying a rectangle between framebuffers as plain memory, colour and depth alike.

moderngl only has the blit, which Mesa's software driver carries out by drawing a textured rectangle as
soon as it is limited to a part: thirty times slower than the copy that OpenGL 4.3 offers.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import moderngl

RENDERBUFFER = 0x8D41

Box = tuple[int, int, int, int]
"""(x, y, width, height) [px]."""
Copy = Callable[[moderngl.Framebuffer, moderngl.Framebuffer, Box], None]
"""Copies a rectangle from the first framebuffer to the second, which has the same size and formats."""


def rectangle_copy(ctx: moderngl.Context) -> Copy:
    """The quickest way that this driver has; the framebuffers must be made of renderbuffers.

    Where the direct copy is missing, all is copied: for the software driver that is memory, too.
    """
    function = _function("glCopyImageSubData") if ctx.version_code >= 430 else None

    def all_of_it(source: moderngl.Framebuffer, target: moderngl.Framebuffer, box: Box) -> None:
        target.scissor = None  # pyright: ignore[reportAttributeAccessIssue]
        target.use()
        ctx.copy_framebuffer(target, source)

    if function is None:
        return all_of_it

    def rectangle(source: moderngl.Framebuffer, target: moderngl.Framebuffer, box: Box) -> None:
        x, y, width, height = box
        corner, size = (0, x, y, 0), (width, height, 1)
        pairs = [(source.color_attachments[0], target.color_attachments[0])]
        pairs.append((source.depth_attachment, target.depth_attachment))
        for here, there in pairs:
            function(here.glo, RENDERBUFFER, *corner, there.glo, RENDERBUFFER, *corner, *size)

    return rectangle


def _function(name: str) -> Callable[..., None] | None:
    """An OpenGL function that moderngl does not wrap; None where there is none."""
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return None
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    address = egl.eglGetProcAddress(name.encode())
    number, signed = ctypes.c_uint, ctypes.c_int
    place = [number, number, signed, signed, signed, signed]
    return ctypes.CFUNCTYPE(None, *place, *place, signed, signed, signed)(address) if address else None
