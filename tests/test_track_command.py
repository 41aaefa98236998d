"""`vita track`: real files in, a table out, and a clear word about everything that is odd."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from sequences import Sequence, swing
from track_files import (
    AT,
    COLUMNS,
    FRAMES,
    SCENE,
    corners,
    errors,
    pixel,
    read_video,
    rows_of,
    run,
    save,
    write_folder,
    write_video,
)

from vita.errors import BadInput, Untrackable
from vita.tracking.command import KINDS
from vita.tracking.folder import natural
from vita.tracking.sources import open_source
from vita.tracking.targets import read_targets


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_folder(tmp_path_factory.mktemp("track") / "images", FRAMES)


# The table ---------------------------------------------------------------------------------------


def test_a_folder_of_lossless_images_is_tracked_to_half_a_pixel(folder: Path) -> None:
    code, out, err = run(folder, "--at", "160,120")
    rows = rows_of(out)
    assert code == 0 and [int(row["frame"]) for row in rows] == list(range(len(FRAMES)))
    assert {row["status"] for row in rows} == {"ok"} and errors(rows).max() < 0.5
    assert f"{len(FRAMES)} frames of {folder}" in err and "frames/s" in err


def test_corners_are_top_left_first_and_clockwise_and_follow_the_region(folder: Path) -> None:
    rows = rows_of(run(folder, "--at", "150,118,40,60", "--tracker", "patch")[1])
    first = corners(rows[0])
    assert np.allclose(first - (150, 118), 25 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]))
    for row in rows:
        truth = [SCENE.truth(corner, int(row["frame"])) for corner in first]
        assert np.abs(corners(row) - truth).max() < 1.0


def test_a_video_gives_the_same_tracks_as_its_frames(tmp_path: Path) -> None:
    path = write_video(tmp_path / "clip.mp4", FRAMES)
    code, _, err = run(path, "--at", "160,120", "--out", tmp_path / "tracks.csv")
    rows = rows_of((tmp_path / "tracks.csv").read_text())
    assert code == 0 and len(rows) == len(FRAMES) and errors(rows).max() < 1.0
    assert str(tmp_path / "tracks.csv") in err


def test_several_places_keep_their_order_and_their_names(folder: Path) -> None:
    places = ["--at", "160,120", "--at", "tip=150,110", "--at", "170,130,41,41"]
    _, out, err = run(folder, *places, "--frames", 3)
    rows = rows_of(out)
    assert [row["tracker"] for row in rows] == ["T1", "tip", "T3"] * 3
    assert [row["frame"] for row in rows] == ["0"] * 3 + ["1"] * 3 + ["2"] * 3
    assert [pixel(row).tolist() for row in rows[:3]] == [[160, 120], [150, 110], [170, 130]]
    assert all(name in err for name in ("T1", "tip", "T3"))


def test_two_runs_and_both_places_of_output_agree_to_the_byte(folder: Path, tmp_path: Path) -> None:
    printed = run(folder, "--at", "160,120", "--at", "150,110")[1]
    run(folder, "--at", "160,120", "--at", "150,110", "--out", tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text() == printed
    run(folder, "--at", "160,120", "--frames", 2, "--out", tmp_path / "a.csv")
    assert len(rows_of((tmp_path / "a.csv").read_text())) == 2, "a file of that name is replaced"


def test_from_and_frames_take_a_part_that_keeps_its_numbers(folder: Path, tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.avi", FRAMES)
    for source in (folder, clip):
        at = SCENE.truth(np.array(AT), 7)
        rows = rows_of(run(source, "--at", f"{at[0]},{at[1]}", "--from", 7, "--frames", 5)[1])
        assert [row["frame"] for row in rows] == ["7", "8", "9", "10", "11"]
        assert errors(rows).max() < 1.0


def test_images_are_taken_in_natural_order() -> None:
    names = [f"img{n}.png" for n in range(120)] + ["img007.png", "IMG7.png", "b.png", "a2b10.png", "a2b9.png"]
    ordered = sorted(names, key=natural)
    plain = [name for name in ordered if name in names[:120]]
    assert plain == names[:120]
    assert ordered.index("a2b9.png") < ordered.index("a2b10.png") < ordered.index("b.png")


@given(st.lists(st.text("017aB._", max_size=5), max_size=6, unique=True))
@example(["1", "01"])
def test_natural_order_is_an_order_of_any_names(names: list[str]) -> None:
    assert sorted(names, key=natural) == sorted(reversed(names), key=natural)


def test_the_page_names_every_option_kind_and_column() -> None:
    page = (Path(__file__).parent.parent / "docs" / "track.md").read_text()
    options = re.findall(r"--[a-z]+", run("--help")[1])
    assert {"--at", "--from", "--show"} <= set(options)
    words = [*(f"`{option}" for option in options if option != "--help"), *(f"`{kind}`" for kind in KINDS)]
    assert [word for word in words if word not in page] == [] and COLUMNS in page


# Pictures of every kind ---------------------------------------------------------------------------


def twelve_bits(picture: np.ndarray) -> np.ndarray:
    return picture.astype(np.uint16) * 16


FORMATS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "grey": lambda p: p[:, :, 0],
    "with transparency": lambda p: np.dstack([p, np.full(p.shape[:2], 128, np.uint8)]),
    "16 bits": lambda p: p.astype(np.uint16) * 257,
    "12 of 16 bits, grey": lambda p: twelve_bits(p[:, :, 0]),
    "8 of 16 bits": lambda p: p.astype(np.uint16),
}


@pytest.mark.parametrize("kind", FORMATS)
def test_images_of_other_depths_and_channels_are_tracked_as_well(kind: str, tmp_path: Path) -> None:
    source = write_folder(tmp_path / "images", [FORMATS[kind](p) for p in FRAMES[:8]])
    code, out, _ = run(source, "--at", "160,120")
    rows = rows_of(out)
    assert code == 0 and len(rows) == 8 and errors(rows).max() < 0.5
    assert {row["status"] for row in rows} == {"ok"}


def test_images_of_16_bits_are_all_scaled_by_the_first_one(tmp_path: Path) -> None:
    bright, dark = twelve_bits(FRAMES[0]), twelve_bits(FRAMES[0]) // 8
    source = open_source(str(write_folder(tmp_path / "images", [bright, dark, bright * 16])))
    first, second, third = [source.read() for _ in range(3)]
    assert first and second and third and first.image is not None
    assert np.array_equal(first.image, FRAMES[0])
    assert second.image is not None and np.array_equal(second.image, FRAMES[0] // 8)
    assert third.image is not None
    assert np.array_equal(third.image, np.minimum(FRAMES[0].astype(int) * 16, 255)), "clipped, not wrapped"


def test_an_image_that_cannot_be_read_is_a_lost_row_and_is_named(tmp_path: Path) -> None:
    source = write_folder(tmp_path / "images", FRAMES[:10])
    whole = (source / "frame_4.png").read_bytes()
    (source / "frame_4.png").write_bytes(whole[: len(whole) // 2])
    (source / "frame_5.png").write_bytes(b"")
    (source / "notes.txt").write_text("not a frame")
    code, out, err = run(source, "--at", "160,120", "--show", tmp_path / "out.mp4")
    rows = rows_of(out)
    assert code == 0 and len(rows) == 10
    assert [k for k, row in enumerate(rows) if row["status"] == "lost"] == [4, 5]
    assert np.array_equal(pixel(rows[4]), pixel(rows[3])) and errors(rows[6:]).max() < 0.5
    assert "2 frames were" in err and "the first is 4" in err and "frame_4.png" in err
    shown = read_video(tmp_path / "out.mp4")
    assert len(shown) == 10 and shown[4].mean() < 0.6 * shown[3].mean(), "a missing picture must look so"


def test_an_image_of_another_size_is_a_lost_row_and_is_told(tmp_path: Path) -> None:
    odd = [*FRAMES[:3], FRAMES[3][:200], *FRAMES[4:8]]
    source = write_folder(tmp_path / "images", odd)
    code, out, err = run(source, "--at", "160,120", "--show", tmp_path / "o.mp4")
    assert code == 0 and [r["status"] for r in rows_of(out)] == ["ok"] * 3 + ["lost"] + ["ok"] * 4
    assert "frame 3 was" in err and "320 x 200" in err and "320 x 240" in err
    assert len(read_video(tmp_path / "o.mp4")) == 8


def test_frames_that_repeat_to_the_bit_are_counted_as_a_frozen_camera(tmp_path: Path) -> None:
    order = [0, 1, 2, 2, 3, 4, 4, 4, 4, 5]
    _, _, err = run(write_folder(tmp_path / "images", [FRAMES[k] for k in order]), "--at", "160,120")
    assert "4 frames are the same picture as the one before; 3 on end from frame 6" in err
    _, _, err = run(tmp_path / "images", "--at", "160,120", "--frames", 3)
    assert "same picture" not in err


def test_a_video_cut_short_is_tracked_as_far_as_it_goes(tmp_path: Path) -> None:
    whole = write_video(tmp_path / "clip.avi", FRAMES).read_bytes()
    (tmp_path / "cut.avi").write_bytes(whole[: len(whole) // 2])
    code, out, err = run(tmp_path / "cut.avi", "--at", "160,120")
    rows = rows_of(out)
    assert code == 0 and 8 <= len(rows) <= 14 and errors(rows).max() < 1.0
    assert f"promises {len(FRAMES)} frames" in err and f"but {len(rows)} can be read" in err


# The summary --------------------------------------------------------------------------------------


def test_the_summary_counts_what_the_table_says(tmp_path: Path) -> None:
    hidden = Sequence(swing(2.0), frames=24, cover=lambda k: (90, 50, 230, 190) if 9 <= k < 15 else None)
    code, out, err = run(write_folder(tmp_path / "images", list(hidden)), "--at", "160,120")
    rows = rows_of(out)
    lost = [k for k, row in enumerate(rows) if row["status"] == "lost"]
    good = [float(row["score"]) for row in rows if row["status"] == "ok"]
    stretches = itertools.groupby(row["status"] for row in rows)
    runs = [len(list(stretch)) for status, stretch in stretches if status == "lost"]
    line = next(line for line in err.splitlines() if line.startswith("T1"))
    words = re.split(r"\s\s+", line)
    assert code == 0 and lost and words[2:4] == [str(len(good)), str(len(lost))]
    assert words[1].startswith("patch") and abs(float(words[4]) - np.mean(good)) < 1e-3
    assert f"{max(runs)} frames from {lost[0]}" in words[5]


# Mistakes -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--at", "160"], "expected u,v"),
        (["--at", "160,120,30"], "expected u,v"),
        (["--at", "a,b"], "expected u,v"),
        (["--at", "160;120"], "expected u,v"),
        (["--at", "nan,120"], "expected u,v"),
        (["--at", ""], "expected u,v"),
        (["--at", "160,120,0,40"], "above 0"),
        (["--at", "160,120,5,5"], "size_px"),
        (["--at", "160,120,900,900"], "size_px"),
        (["--at", "=160,120"], "name"),
        (["--at", "a=160,120", "--at", "a=150,110"], "'a'"),
        (["--at", "160,120", "--at", "320,10"], "T2 at (320, 10): pixel (320, 10) is outside"),
        (["--at", "160,120", "--tracker", "pach"], "Did you mean 'patch'?"),
        (["--at", "160,120", "--tracker", "fixed"], "unknown tracker 'fixed'"),
        (["--at", "160,120", "--frames", "0"], "--frames"),
        (["--at", "160,120", "--frames", "-3"], "--frames"),
        (["--at", "160,120", "--from", "24"], "there are 24 frames"),
        (["--at", "160,120", "--from", "99"], "there are 24 frames"),
        (["--at", "160,120", "--show", "out.xyz"], ".mp4"),
        (["--at", "160,120", "--out", "no/such/folder.csv"], "No such file"),
        (["--at", "160,120", "--show", "no/such/folder.mp4"], "No such file"),
        (["--at", "160,120", "--show", "same.mp4", "--out", "same.mp4"], "same file"),
        ([], "--at"),
    ],
)
def test_a_mistake_exits_with_2_and_says_which(
    arguments: list[str], word: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run(folder, *arguments)
    assert code == 2 and word in err and len(out.splitlines()) <= 1


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda p: None, "no such file"),
        (lambda p: p.mkdir(), "no images"),
        (lambda p: p.write_bytes(b""), "not a video"),
        (lambda p: p.write_bytes(b"hello " * 1000), "not a video"),
        (lambda p: (p.mkdir(), (p / "a.png").write_bytes(b"x")), "a.png: damaged"),
        (lambda p: (p.mkdir(), save(p / "a.tiff", np.zeros((50, 50), np.float32))), "a.tiff: damaged"),
        (lambda p: (p.mkdir(), save(p / "a.tiff", np.zeros((50, 50, 3), np.float32))), "float32"),
    ],
)
def test_a_source_that_is_none_exits_with_2_and_is_named(
    make: Callable[[Path], object], word: str, tmp_path: Path
) -> None:
    make(tmp_path / "source")
    code, out, err = run(tmp_path / "source", "--at", "2,2")
    assert code == 2 and out == "" and word in err and str(tmp_path / "source") in err


def test_an_mp4_without_its_end_is_refused_and_a_single_image_too(folder: Path, tmp_path: Path) -> None:
    whole = write_video(tmp_path / "clip.mp4", FRAMES[:4]).read_bytes()
    (tmp_path / "cut.mp4").write_bytes(whole[: len(whole) // 2])
    code, _, err = run(tmp_path / "cut.mp4", "--at", "160,120")
    assert code == 2 and "cut short" in err
    code, _, err = run(folder / "frame_0.png", "--at", "160,120")
    assert code == 2 and "give the folder" in err


def test_a_place_without_texture_is_refused_with_a_better_one_that_works(tmp_path: Path) -> None:
    blank = [frame.copy() for frame in FRAMES[:3]]
    for frame in blank:
        frame[:, 200:] = 90
    source = write_folder(tmp_path / "images", blank)
    (tmp_path / "old.csv").write_text("the last run's work")
    code, _, err = run(source, "--at", "160,120", "--at", "wall=280,60", "--out", tmp_path / "old.csv")
    assert code == 2 and "wall at (280, 60): nothing to hold on to" in err
    assert (tmp_path / "old.csv").read_text() == "the last run's work"
    with pytest.raises(Untrackable, match="wall") as refusal:
        read_targets(["wall=280,60"], "auto")[0].start("auto", blank[0])
    assert refusal.value.suggestion is not None
    better = ",".join(f"{x:.0f}" for x in refusal.value.suggestion)
    assert f"({better.replace(',', ', ')})" in err
    code, out, _ = run(source, "--at", better)
    assert code == 0 and rows_of(out)[2]["status"] == "ok"


@pytest.mark.parametrize("option", ["--out", "--show"])
def test_the_source_is_never_overwritten(option: str, tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.mp4", FRAMES[:3])
    before = clip.read_bytes()
    code, _, err = run(clip, "--at", "160,120", option, tmp_path / "." / "clip.mp4")
    assert code == 2 and option in err and clip.read_bytes() == before


def test_a_line_takes_its_two_ends() -> None:
    line = read_targets(["10,20,110,25"], "line")[0]
    assert (line.uv, line.to, line.size_px) == ((10, 20), (110, 25), None)
    patch = read_targets(["10,20,110,50"], "auto")[0]
    assert (patch.uv, patch.to, patch.size_px) == ((10, 20), None, 80)
    with pytest.raises(BadInput, match="both its ends"):
        read_targets(["10,20"], "line")


def test_a_line_has_rows_for_its_middle_and_its_ends_and_no_corners(tmp_path: Path) -> None:
    """A bright half plane whose edge, from (40, 60) to (200, 90), sinks by one pixel a frame."""
    v, u = np.mgrid[0:180, 0:240]
    heights = [120 + 60 * (v - k - 60 - (u - 40) * 30 / 160) for k in range(6)]
    pictures = [np.repeat(np.clip(h, 60, 180).astype(np.uint8)[..., None], 3, axis=2) for h in heights]
    folder = write_folder(tmp_path / "edge", pictures)
    code, out, _ = run(folder, "--tracker", "line", "--at", "40,60,200,90")
    rows = rows_of(out)
    assert code == 0 and [row["tracker"] for row in rows[:3]] == ["T1", "T1.start", "T1.end"]
    assert len(rows) == 18 and all(row["x0"] == "" and row["status"] == "ok" for row in rows)
    for row in rows:
        u1, v1 = pixel(row)
        assert abs(v1 - (60 + int(row["frame"]) + (u1 - 40) * 30 / 160)) < 0.2
    middle, start, end = (pixel(row) for row in rows[-3:])
    np.testing.assert_allclose((start + end) / 2, middle, atol=1e-3)
