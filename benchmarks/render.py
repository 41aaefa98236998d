"""How long two views of a moving arm take: OpenGL with and without cached background, TinyRenderer.

All in one run, turn by turn, so that whatever else the machine does hits all alike: trust the ratios.
Run `python benchmarks/render.py [frames]`.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from vita.sim.camera import PinholeCamera, look_at, pose_matrix
from vita.sim.environment import build_environment
from vita.sim.meshes import cylinder_visual, sphere_visual
from vita.sim.objects import OBJECT_KINDS, build_object
from vita.sim.render_gl import GlRenderer
from vita.sim.render_tiny import TinyRenderer
from vita.sim.tools import build_tool
from vita.types import Array, Visual

CAMERAS = [
    (PinholeCamera("left", (640, 480), 40), look_at((1.25, -0.75, 0.75), (0.5, 0, 0.25))),
    (PinholeCamera("right", (640, 480), 40), look_at((1.25, 0.75, 0.75), (0.5, 0, 0.25))),
]


def arm() -> list[Visual]:
    """About 20,000 triangles in seven links."""
    visuals = []
    for k in range(1, 8):
        shade = (0.9, 0.9, 0.9) if k % 2 else (0.15, 0.15, 0.17)
        visuals.append(cylinder_visual(f"link{k}", 0.05 - 0.003 * k, 0, 0.13, shade, segments=48))
        visuals.append(sphere_visual(f"link{k}", 0.055 - 0.003 * k, (0.3, 0.3, 0.33), segments=52))
    return visuals


def arm_poses(t: float) -> dict[str, Array]:
    T, poses = pose_matrix((0, 0, 0.3)), {}
    for k in range(1, 8):
        T = T @ pose_matrix((0, 0, 0.13 if k > 1 else 0), (8 * np.sin(t + k), 19 + 3 * np.sin(1.3 * t), 0))
        poses[f"link{k}"] = T
    poses["tool"] = T @ pose_matrix((0, 0, 0.13))
    return poses


def main(frames: int) -> None:
    still = {
        f"{kind}": pose_matrix((0.3 + 0.1 * k, 0.3 * (-1) ** k, 0.1)) for k, kind in enumerate(OBJECT_KINDS)
    }
    objects = [visual for kind in still for visual in build_object(kind, kind)]
    visuals = [*build_environment(True), *objects, *arm(), *build_tool("card_tool")]
    renderers = {
        "gl, cached, antialiased": GlRenderer(visuals, 4),
        "gl, cached": GlRenderer(visuals, 0),
        "gl, uncached, antialiased": GlRenderer(visuals, 4, cache=False),
        "gl, uncached": GlRenderer(visuals, 0, cache=False),
        "tiny": TinyRenderer(visuals),
    }
    times: dict[str, list[float]] = {name: [] for name in renderers}
    for frame in range(frames + 2):
        for name, renderer in renderers.items():
            if name == "tiny" and frame > 5:
                continue
            poses = {**still, **arm_poses(0.04 * frame)}
            start = time.perf_counter()
            for camera, T in CAMERAS:
                renderer.render(camera, T, poses)
            if frame >= 2:  # The first frames compile the shaders and make the background.
                times[name].append(1000 * (time.perf_counter() - start))
    base = float(np.median(times["gl, cached, antialiased"]))
    print(f"{sum(len(v.faces) for v in visuals)} triangles, two 640x480 views, {frames} frames")
    print(f"{'renderer':28}{'two views [ms]':>16}{'one view [ms]':>16}{'ratio':>8}")
    for name, values in times.items():
        median = float(np.median(values))
        print(f"{name:28}{median:16.1f}{median / 2:16.1f}{median / base:8.2f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 30)
