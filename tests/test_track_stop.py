"""`vita track` interrupted, killed, without its camera, its codec or its disk: what was done is kept."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from track_files import COLUMNS, FRAMES, VITA, errors, read_video, rows_of, run, write_folder

from vita.tracking import video
from vita.tracking.show import CODECS


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_folder(tmp_path_factory.mktemp("track") / "images", FRAMES)


# Cameras and codecs -------------------------------------------------------------------------------


def test_a_camera_that_is_not_there_exits_with_3(monkeypatch: pytest.MonkeyPatch) -> None:
    code, out, err = run("997", "--at", "160,120")
    assert code == 3 and out == "" and "camera 997" in err


class FakeCamera:
    """Plays the frames as a camera would; after the last one it is silent."""

    def __init__(self, number: int) -> None:
        frames = [] if number else [frame[:, :, ::-1].copy() for frame in FRAMES]
        self._frames: Iterator[np.ndarray] = iter(frames)

    def isOpened(self) -> bool:
        return True

    def get(self, _: int) -> float:
        return 0.0

    def read(self) -> tuple[bool, np.ndarray | None]:
        frame = next(self._frames, None)
        return frame is not None, frame

    def grab(self) -> bool:
        return self.read()[0]

    def release(self) -> None:
        pass


@pytest.fixture
def camera(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> type[FakeCamera]:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(video.cv2, "VideoCapture", FakeCamera)
    return FakeCamera


def test_a_camera_goes_on_until_frames_or_its_silence(camera: type[FakeCamera]) -> None:
    code, out, err = run("0", "--at", "160,120", "--frames", 5)
    assert code == 0 and len(rows_of(out)) == 5 and "camera 0" in err and "stopped" not in err
    code, out, err = run("0", "--at", "160,120")
    assert code == 0 and len(rows_of(out)) == len(FRAMES) and "camera 0 stopped sending" in err
    code, out, err = run("1", "--at", "160,120")
    assert code == 3 and "camera 1 sends no pictures" in err


def test_a_camera_is_ended_by_ctrl_c_which_is_no_failure(
    camera: type[FakeCamera], monkeypatch: pytest.MonkeyPatch
) -> None:
    read = FakeCamera.read
    seen = itertools.count()

    def interrupted(self: FakeCamera) -> tuple[bool, np.ndarray | None]:
        if next(seen) == 4:
            os.kill(os.getpid(), signal.SIGINT)
        return read(self)

    monkeypatch.setattr(FakeCamera, "read", interrupted)
    before = signal.getsignal(signal.SIGINT)
    code, out, err = run("0", "--at", "160,120")
    assert code == 0 and len(rows_of(out)) == 5 and "what was done is kept" in err
    assert signal.getsignal(signal.SIGINT) is before


def test_a_codec_that_is_missing_exits_with_3(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(CODECS, ".mp4", "QQQQ")
    code, _, err = run(folder, "--at", "160,120", "--show", tmp_path / "out.mp4")
    assert code == 3 and "cannot write .mp4" in err and not (tmp_path / "out.mp4").exists()


# Interruptions: a named pipe in place of one image makes the moment certain ------------------------------

STOP_AT = 12


@pytest.fixture
def waiting(tmp_path: Path) -> Path:
    """A folder in which the reading of frame STOP_AT waits until somebody delivers it."""
    source = write_folder(tmp_path / "images", FRAMES[:20])
    (source / f"frame_{STOP_AT}.png").rename(tmp_path / "late.png")
    os.mkfifo(source / f"frame_{STOP_AT}.png")
    return source


def reached(source: Path) -> int:
    """Waits until the program reads the pipe; returns its other end."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        try:
            return os.open(source / f"frame_{STOP_AT}.png", os.O_WRONLY | os.O_NONBLOCK)
        except OSError:  # Nobody reads it yet.
            time.sleep(0.02)
    raise AssertionError("the program never came to the frame that waits")


def deliver(pipe: int, tmp_path: Path) -> None:
    os.set_blocking(pipe, True)
    with os.fdopen(pipe, "wb") as stream:
        stream.write((tmp_path / "late.png").read_bytes())


@pytest.mark.parametrize(("number", "verdict"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_ctrl_c_keeps_what_was_done(number: int, verdict: int, waiting: Path, tmp_path: Path) -> None:
    outputs = ["--out", str(tmp_path / "t.csv"), "--show", str(tmp_path / "t.mp4")]
    process = subprocess.Popen([*VITA, str(waiting), "--at", "160,120", *outputs], stderr=subprocess.PIPE)
    pipe = reached(waiting)
    process.send_signal(number)
    deliver(pipe, tmp_path)
    _, err = process.communicate(timeout=60)
    assert process.returncode == verdict
    rows = rows_of((tmp_path / "t.csv").read_text())
    assert len(rows) == STOP_AT + 1 and errors(rows).max() < 0.5, "this frame is finished, no other begun"
    assert len(read_video(tmp_path / "t.mp4")) == STOP_AT + 1
    assert b"stopped before the end" in err and f"{STOP_AT + 1} frames of".encode() in err


def test_a_kill_loses_no_frame_of_the_table_that_was_done(waiting: Path, tmp_path: Path) -> None:
    process = subprocess.Popen([*VITA, str(waiting), "--at", "160,120", "--out", str(tmp_path / "t.csv")])
    os.close(reached(waiting))
    process.kill()
    process.wait(60)
    assert len(rows_of((tmp_path / "t.csv").read_text())) >= STOP_AT


def test_a_reader_that_leaves_is_no_mistake_and_the_video_is_finished(waiting: Path, tmp_path: Path) -> None:
    process = subprocess.Popen(
        [*VITA, str(waiting), "--at", "160,120", "--show", str(tmp_path / "t.mp4")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None and process.stdout.readline().decode().strip() == COLUMNS
    pipe = reached(waiting)
    process.stdout.close()
    deliver(pipe, tmp_path)
    assert process.wait(60) == 0 and process.stderr is not None and b"Traceback" not in process.stderr.read()
    assert len(read_video(tmp_path / "t.mp4")) >= STOP_AT


def test_a_full_disk_is_told(folder: Path, tmp_path: Path) -> None:
    import resource

    def small() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))

    def started(*outputs: object) -> tuple[int, str]:
        command = [*VITA, str(folder), "--at", "160,120", *map(str, outputs)]
        done = subprocess.run(command, preexec_fn=small, capture_output=True, text=True)
        assert "Traceback" not in done.stderr
        return done.returncode, done.stderr

    code, err = started("--out", tmp_path / "t.csv")
    assert code == 2 and f"{tmp_path / 't.csv'}: cannot be written" in err
    code, err = started("--show", tmp_path / "t.mp4")
    assert code == 2 and f"{tmp_path / 't.mp4'}: only" in err and "disk" in err
