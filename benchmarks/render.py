"""How long two views of a moving WAM take: OpenGL with and without cached background, TinyRenderer.

All in one run, turn by turn, so that whatever else the machine does hits all alike: trust the ratios.
Run `python benchmarks/render.py [frames]`.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from vita.poses import look_at, pose_matrix
from vita.sim.camera import PinholeCamera
from vita.sim.environment import build_environment
from vita.sim.objects import OBJECT_KINDS, build_object
from vita.sim.render_gl import GlRenderer
from vita.sim.render_tiny import TinyRenderer
from vita.sim.robots import load_robot
from vita.sim.tools import build_tool
from vita.types import DEPTH_STEP_PX, Array

LEFT, RIGHT = PinholeCamera("left", (640, 480), 36), PinholeCamera("right", (640, 480), 36)
FIXED = (
    (LEFT, look_at((1.2, -0.5, 0.6), (0.56, 0.02, 0.25))),
    (RIGHT, look_at((1.2, 0.5, 0.6), (0.56, 0.02, 0.25))),
)
HAND = PinholeCamera("hand", (640, 480), 60)
ON_HAND = pose_matrix((-0.07, 0.0, 0.0), (0, 0, 90))


def main(frames: int) -> None:
    model = load_robot("wam7")
    still = {kind: pose_matrix((0.3 + 0.1 * k, 0.3 * (-1) ** k, 0.1)) for k, kind in enumerate(OBJECT_KINDS)}
    objects = [visual for kind in still for visual in build_object(kind, kind)]
    visuals = [*build_environment(True), *objects, *model.visuals(), *build_tool("card_tool")]
    cached, plain = GlRenderer(visuals, 4), GlRenderer(visuals, 0)
    full, rough = GlRenderer(visuals, 4, cache=False), GlRenderer(visuals, 0, cache=False)
    cases = {
        "gl, cached, antialiased": (cached, False),
        "gl, cached": (plain, False),
        "gl, uncached, antialiased": (full, False),
        "gl, uncached": (rough, False),
        "gl, camera on the hand": (cached, True),
        "gl, cached, depth alone": (cached, False),
        "tiny": (TinyRenderer(visuals), False),
    }
    times: dict[str, list[float]] = {name: [] for name in cases}
    for frame in range(frames + 2):
        sway = 0.25 * np.sin(0.065 * frame) * np.array([1, 0.5, 1, 0.7, 1, 1, 1])
        poses = {**still, **model.poses(model.q_ready + sway)}
        for name, (renderer, on_hand) in cases.items():
            if name == "tiny" and frame > 5:
                continue
            views: tuple[tuple[PinholeCamera, Array], ...] = FIXED
            if on_hand:
                views = ((HAND, poses["tool"] @ ON_HAND),)
            start = time.perf_counter()
            for camera, T in views:
                if "depth" in name:
                    renderer.depth(camera, T, poses, DEPTH_STEP_PX)
                else:
                    renderer.render(camera, T, poses)
            if frame >= 2:  # The first frames compile the shaders and make the background.
                times[name].append(1000 * (time.perf_counter() - start) / len(views))
    base = float(np.median(times["gl, cached, antialiased"]))
    arm = sum(len(v.faces) for v in model.visuals())
    print(f"{sum(len(v.faces) for v in visuals)} triangles ({arm} of the arm), 640x480, {frames} frames")
    print(f"{'renderer':28}{'a view, median [ms]':>20}{'quickest':>10}{'ratio':>8}")
    for name, values in times.items():
        median = float(np.median(values))
        print(f"{name:28}{median:20.1f}{min(values):10.1f}{median / base:8.2f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 30)
