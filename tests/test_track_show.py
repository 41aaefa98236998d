"""What `vita track` shows: the annotated video and the progress line."""

from __future__ import annotations

import io
import itertools
import os
import pty
import subprocess
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sequences import Sequence, swing
from track_files import FRAMES, VITA, corners, read_video, rows_of, run, write_folder, write_video

from vita.tracking import draw
from vita.tracking.label import Label
from vita.tracking.progress import Progress
from vita.types import Feature


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_folder(tmp_path_factory.mktemp("track") / "images", FRAMES)


# The annotated video ------------------------------------------------------------------------------


def near(frame: np.ndarray, uv: np.ndarray, bgr: tuple[int, ...], radius: int = 3) -> float:
    """Smallest colour distance to `bgr` around a pixel."""
    u, v = np.rint(uv).astype(int)
    part = frame[max(v - radius, 0) : v + radius + 1, max(u - radius, 0) : u + radius + 1]
    return float(np.abs(part - np.array(bgr[::-1])).sum(axis=2).min())


@pytest.mark.parametrize("suffix", [".mp4", ".avi", ".webm"])
def test_the_video_shows_the_region_where_the_table_says(suffix: str, tmp_path: Path) -> None:
    hidden = Sequence(swing(2.0), frames=12, cover=lambda k: (60, 20, 260, 220) if k >= 6 else None)
    source = write_folder(tmp_path / "images", list(hidden))
    code, out, err = run(source, "--at", "160,120", "--show", tmp_path / f"out{suffix}")
    rows, shown = rows_of(out), read_video(tmp_path / f"out{suffix}")
    assert code == 0 and len(shown) == 12 and shown[0].shape == (240, 320, 3) and "out" in err
    assert rows[11]["status"] == "lost"
    for k, row in enumerate(rows):
        color, other = draw.COLORS[0], draw.RED
        if row["status"] == "lost":
            color, other = other, color
        assert near(shown[k], corners(row)[2], color) < near(shown[k], corners(row)[2], other)
    # The lossy colour of a thin line is blurred; what is left of it is still far from the grey scene.
    corner = corners(rows[3])[2]
    u, v = np.rint(corner).astype(int)
    part = shown[3][v - 2 : v + 3, u - 2 : u + 3]
    assert (part.max(axis=2) - part.min(axis=2)).max() > 60


def test_a_video_has_the_rate_of_its_source(tmp_path: Path) -> None:
    run(write_video(tmp_path / "clip.mp4", FRAMES[:5]), "--at", "160,120", "--show", tmp_path / "out.mp4")
    assert cv2.VideoCapture(str(tmp_path / "out.mp4")).get(cv2.CAP_PROP_FPS) == pytest.approx(25.0)


def test_the_video_has_the_colours_of_its_source(tmp_path: Path) -> None:
    tint = np.array([1.0, 0.6, 0.2])
    colored = [(frame * tint).astype(np.uint8) for frame in FRAMES[:3]]
    sources = [write_folder(tmp_path / "images", colored), write_video(tmp_path / "clip.avi", colored)]
    for source in sources:
        run(source, "--at", "160,120", "--show", tmp_path / "out.avi")
        mean = read_video(tmp_path / "out.avi")[2].reshape(-1, 3).mean(axis=0)
        assert np.abs(mean - colored[2].reshape(-1, 3).mean(axis=0)).max() < 6


spot = st.floats(-1e12, 1e12)


@settings(max_examples=40, deadline=None)
@given(
    size=st.tuples(st.integers(9, 300), st.integers(9, 300)),
    points=st.lists(st.tuples(spot, spot), min_size=8, max_size=8),
    status=st.sampled_from(["ok", "lost"]),
    parts=st.sets(st.sampled_from(["corners", "outline", "segment"])),
)
def test_anything_can_be_drawn_anywhere(size, points, status, parts) -> None:
    array = np.array(points)
    shapes = {"corners": array[:4], "outline": array[:7], "segment": array[:2]}
    shown: dict[str, Any] = {part: shapes[part] for part in parts}
    feature = Feature(array[7], status, 0.5, **shown)
    canvas = np.full((*size, 3), 100, np.uint8)
    trail = [None, *array[:5], None, array[5], array[6], None, array[7]]
    trails = {"a": trail, "ß": [array[0]], "c": [None], "d": []}
    draw.annotate(canvas, dict.fromkeys(trails, feature), trails, "frame 1")
    assert (canvas != 100).any()


def test_names_of_neighbours_do_not_cover_each_other() -> None:
    label = Label(np.zeros((240, 320, 3), np.uint8), 14)
    for k in range(4):
        label.put(f"T{k} 0.97", (150 + 3 * k, 110, 190 + 3 * k, 150), (255, 255, 255))
    for a, b in itertools.combinations(label.taken, 2):
        assert a[0] >= b[2] or b[0] >= a[2] or a[1] >= b[3] or b[1] >= a[3], (a, b)


# Progress -----------------------------------------------------------------------------------------


class Terminal(io.StringIO):
    encoding = "utf-8"


def test_the_progress_line_tells_share_rate_and_who_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = itertools.count(0.0, 0.5)
    monkeypatch.setattr("vita.tracking.progress.time.monotonic", lambda: next(clock))
    terminal = Terminal()
    progress = Progress(terminal, 40, shown=True)
    ok, lost = Feature(np.zeros(2)), Feature(np.zeros(2), "lost")
    progress.update(10, {"T1": ok, "T2": lost})
    line = terminal.getvalue()
    assert line.startswith("\r") and "25 %" in line and "10 of 40 frames" in line and "20 frames/s" in line
    assert "1 ok, 1 lost (T2)" in line and "\n" not in line
    progress.close()
    assert terminal.getvalue().endswith("\r\x1b[K")


def test_a_progress_line_without_a_known_end_or_special_letters_still_counts() -> None:
    terminal = Terminal()
    Progress(terminal, None, shown=True).update(7, {})
    assert "7 frames" in terminal.getvalue() and "%" not in terminal.getvalue()

    class Plain(io.StringIO):
        encoding = "ascii"

    plain = Plain()
    Progress(plain, 10, shown=True).update(5, {})
    assert plain.getvalue().isascii() and "50 %" in plain.getvalue()


def test_progress_is_for_terminals_only(folder: Path, tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    command = [*VITA, str(folder), "--at", "160,120", "--out", str(tmp_path / "t.csv")]
    process = subprocess.Popen(command, stderr=theirs)
    os.close(theirs)
    seen = b""
    while True:
        try:
            chunk = os.read(ours, 4096)
        except OSError:  # Linux says so when the other end is closed.
            break
        if not chunk:
            break
        seen += chunk
    os.close(ours)
    assert process.wait(60) == 0 and b"\r" in seen and b"of 24 frames" in seen and b"longest loss" in seen
    piped = subprocess.run(command, capture_output=True)
    assert b"\x1b" not in piped.stderr and b"\r" not in piped.stderr and b"longest loss" in piped.stderr
