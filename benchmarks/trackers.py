"""Side by side: vita's trackers and what a user would take from OpenCV, on the same sequences.

    python benchmarks/trackers.py [--quick]

Prints, per tracker, the share of frames within one pixel at several speeds and under occlusion, the
jitter on a still target, and the CPU time as a ratio to OpenCV's point tracker: absolute times
depend on the machine and on who else is using it, ratios measured in turn hardly do.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from sequences import Sequence, circle, swing  # noqa: E402  # type: ignore

from vita.vision import make_tracker  # noqa: E402

CLICK = np.array([163.3, 118.6])
SIDE = 61
Follow = Callable[[np.ndarray], np.ndarray]


def vita(frame: np.ndarray) -> Follow:
    tracker = make_tracker("auto", frame, CLICK, size_px=SIDE)

    def follow(new: np.ndarray) -> np.ndarray:
        feature = tracker.update(new)
        return feature.uv if feature.ok else np.full(2, np.nan)

    return follow


def klt(frame: np.ndarray) -> Follow:
    """calcOpticalFlowPyrLK of the clicked point, from frame to frame."""
    options = {"winSize": (31, 31), "maxLevel": 3}
    state = [cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), CLICK.astype(np.float32).reshape(1, 1, 2)]

    def follow(new: np.ndarray) -> np.ndarray:
        gray = cv2.cvtColor(new, cv2.COLOR_RGB2GRAY)
        point, seen, _ = cv2.calcOpticalFlowPyrLK(state[0], gray, state[1], None, **options)  # type: ignore
        state[:] = gray, point
        return point.ravel().astype(float) if seen[0, 0] else np.full(2, np.nan)

    return follow


def ecc(frame: np.ndarray) -> Follow:
    """findTransformECC with a homography, from the last pose, against the first patch."""
    corner = np.rint(CLICK - SIDE / 2)
    gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
    x, y = corner.astype(int)
    patch = gray[y : y + SIDE, x : x + SIDE].copy()
    state = [np.array([[1, 0, x], [0, 1, y], [0, 0, 1]], np.float32)]
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 1e-4)

    def follow(new: np.ndarray) -> np.ndarray:
        gray = cv2.cvtColor(new, cv2.COLOR_RGB2GRAY)
        try:
            start = state[0].copy()
            _, state[0] = cv2.findTransformECC(patch, gray, start, cv2.MOTION_HOMOGRAPHY, stop, None, 3)  # type: ignore
        except cv2.error:
            return np.full(2, np.nan)
        u, v, w = state[0] @ np.append(CLICK - corner, 1.0)
        return np.array([u / w, v / w])

    return follow


TRACKERS = {"vita auto": vita, "cv2 KLT point": klt, "cv2 ECC homography": ecc}


def covered(seed: int, frames: int, share: float) -> Sequence:
    """`share` of the patch goes behind something that moves along with it."""
    bare = Sequence(swing(3.0), frames, seed)

    def cover(k: int) -> tuple[float, float, float, float] | None:
        u, v = bare.truth(CLICK, k)
        rise = share * SIDE * min(1.0, max(0, k - 6) / 8)
        return (u - 60, v + SIDE / 2 - rise, u + 60, v + 70) if k > 6 else None

    return Sequence(swing(3.0), frames, seed, light=0.2, cover=cover)


def cases(quick: bool) -> dict[str, list[Sequence]]:
    seeds, frames = (range(2), 30) if quick else (range(8), 90)
    table = {
        f"{speed} px/frame": [Sequence(swing(speed, tilt=0.001), frames, s, light=0.3) for s in seeds]
        for speed in (1, 3, 6, 12)
    }
    for share in (0.25, 0.4):
        table[f"{share:.0%} covered"] = [covered(s, frames, share) for s in seeds]
    table["still"] = [Sequence(circle(0.0), frames, s) for s in seeds]
    return table


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--quick", action="store_true", help="fewer and shorter sequences")
    table = cases(parser.parse_args().quick)
    print(f"{'':16}" + "".join(f"{name:>34}" for name in TRACKERS))
    print(f"{'':16}" + f"{'<1 px  median px  x KLT time':>34}" * len(TRACKERS))
    for case, sequences in table.items():
        errors: dict[str, list[float]] = {name: [] for name in TRACKERS}
        places: dict[str, list[np.ndarray]] = {name: [] for name in TRACKERS}
        seconds: dict[str, list[float]] = {name: [] for name in TRACKERS}
        for sequence in sequences:
            frames = list(sequence)
            follow = {name: make(frames[0]) for name, make in TRACKERS.items()}
            for k, frame in enumerate(frames[1:], 1):
                truth = sequence.truth(CLICK, k)
                for name in TRACKERS:
                    start = time.thread_time()
                    uv = follow[name](frame)
                    seconds[name].append(time.thread_time() - start)
                    errors[name].append(float(np.hypot(*(uv - truth))))
            if case == "still":
                for name in TRACKERS:
                    made = TRACKERS[name](frames[0])
                    places[name].append(np.std([made(f) for f in frames[1:]], axis=0))
        base = np.median(seconds["cv2 KLT point"])
        row = f"{case:16}"
        for name in TRACKERS:
            e = np.array(errors[name])
            good = float(np.mean(np.nan_to_num(e, nan=99.0) <= 1.0))
            row += f"{good:15.1%} {np.nanmedian(e):9.3f} {np.median(seconds[name]) / base:8.2f}"
        print(row)
        if case == "still":
            jitter = "".join(f"{np.mean(places[name]):30.4f} px " for name in TRACKERS)
            print(f"{'jitter':16}{jitter}")


if __name__ == "__main__":
    main()
