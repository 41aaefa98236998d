"""`vita calibrate`: the truth comes back from pictures, weak data are called weak, errors name culprits."""

from __future__ import annotations

import contextlib
import io
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_pictures import LEFT, RIGHT, SIZE, picture, poses, project, rig, sight, sights, write
from PIL import Image as Pictures

from vita import cli
from vita.calibration import command
from vita.calibration.board import parse_board
from vita.calibration.detect import Finder
from vita.calibration.draw import draw_board, draw_page
from vita.calibration.gather import gather
from vita.calibration.pair import solve_pair
from vita.calibration.solve import NAMES, solve_camera
from vita.calibration.verdict import Finding, judge_camera, judge_pair
from vita.calibration.views import View, spread, without_blurred
from vita.errors import BadInput, UnknownName
from vita.stereo.base import Lens
from vita.stereo.rig_file import load_rig
from vita.tracking.sources import Picture, open_source
from vita.types import Array, Image

CHARUCO = parse_board("charuco:7x5:30:22")
CHECKER = parse_board("checker:8x5:25")
TRUTH = np.array([LEFT.fx, LEFT.fy, LEFT.cx, LEFT.cy, *LEFT.distortion])


def run(*arguments: object) -> tuple[int, str, str]:
    """Exit code, stdout, stderr."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = cli.main(["calibrate", *map(str, arguments)])
    return code, out.getvalue(), err.getvalue()


def poor(findings: Sequence[Finding]) -> str:
    return " ".join(finding.text for finding in findings if finding.level == "poor")


@pytest.fixture(scope="module")
def pair_folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """12 pairs of ChArUco pictures with noise and blur."""
    folder, T = tmp_path_factory.mktemp("pair"), rig().T_right_left
    places = poses(CHARUCO, 12, seed=3)
    left = write(folder / "left", [picture(CHARUCO, LEFT, place) for place in places])
    return left, write(folder / "right", [picture(CHARUCO, RIGHT, T @ place) for place in places])


# The truth comes back ------------------------------------------------------------------------------


def test_a_rig_comes_back_from_its_pictures(pair_folders: tuple[Path, Path], tmp_path: Path) -> None:
    code, out, err = run(*pair_folders, "--board", CHARUCO.text, "--out", tmp_path / "rig.toml")
    assert (code, out) == (0, "") and err.rstrip().endswith(f"-> {tmp_path / 'rig.toml'}"), err
    found, true = load_rig(tmp_path / "rig.toml"), rig()
    for own, lens in ((found.left, LEFT), (found.right, RIGHT)):
        assert abs(own.fx / lens.fx - 1) < 0.003 and abs(own.fy / lens.fy - 1) < 0.003
        assert abs(own.cx - lens.cx) < 2 and abs(own.cy - lens.cy) < 2
    assert abs(found.baseline - true.baseline) < 0.5e-3
    assert np.linalg.norm(found.T_right_left[:3, 3] - true.T_right_left[:3, 3]) < 0.5e-3
    off = cv2.Rodrigues(found.T_right_left[:3, :3] @ true.T_right_left[:3, :3].T)[0]
    assert np.degrees(np.linalg.norm(off)) < 0.05


def test_a_checkerboard_gives_one_camera_and_its_distortion(tmp_path: Path) -> None:
    folder = write(tmp_path / "in", [picture(CHECKER, LEFT, T) for T in poses(CHECKER, 11, 1, aside=0.25)])
    code, out, err = run(folder, "--board", CHECKER.text)
    table = tomllib.loads(out)
    assert list(table) == ["camera"] and code == 0, err
    camera = table["camera"]
    assert abs(camera["fx"] / LEFT.fx - 1) < 0.003 and abs(camera["cx"] - LEFT.cx) < 2
    assert camera["size"] == list(SIZE) and camera["rms_px"] < 0.15
    fx, fy, cx, cy = (camera[name] for name in NAMES[:4])
    own = Lens(fx, fy, cx, cy, tuple(camera["distortion"]))
    # Where parameters trade for one another, what counts is where a direction is seen.
    grid = np.stack(np.meshgrid(np.linspace(-0.35, 0.35, 9), np.linspace(-0.25, 0.25, 9), [1.0]), -1).reshape(
        -1, 3
    )
    none, zero = np.zeros(3), np.zeros(1)
    seen = [
        cv2.projectPoints(grid, none, none, lens.matrix, np.append(lens.distortion, zero))[0].reshape(-1, 2)
        for lens in (own, LEFT)
    ]
    assert np.abs(seen[0] - seen[1] - (seen[0] - seen[1]).mean(axis=0)).max() < 0.5


@pytest.mark.parametrize("board", [CHARUCO, CHECKER], ids=["charuco", "checker"])
def test_corners_are_found_without_bias_from_the_centre_of_the_first_pixel(board) -> None:
    finder, off = Finder(board), []
    for T in poses(board, 5, 7, aside=0.1):
        found = finder.find(picture(board, LEFT, T))
        assert found is not None
        off.append(found.uv - project(board, LEFT, T)[found.ids])
    off = np.concatenate(off)
    # A convention that is off by half a pixel would be a mean of 0.5.
    assert np.abs(off.mean(axis=0)).max() < 0.02 and off.std() < 0.04


def test_a_board_that_leaves_the_picture_counts_by_its_visible_corners() -> None:
    T = poses(CHARUCO, 1, 0, tilt=0.1, aside=0.0)[0].copy()
    T[0, 3] += 0.22
    found = Finder(CHARUCO).find(picture(CHARUCO, LEFT, T))
    assert found is not None and 8 <= len(found.ids) < len(CHARUCO.corners)
    assert np.abs(found.uv - project(CHARUCO, LEFT, T)[found.ids]).max() < 0.3


def test_a_checkerboard_is_counted_from_the_same_corner_however_the_camera_is_turned() -> None:
    finder, image = Finder(CHECKER), picture(CHECKER, LEFT, poses(CHECKER, 1, 2, aside=0.05)[0])
    upright, turned = finder.find(image), finder.find(np.ascontiguousarray(image[::-1, ::-1]))
    assert upright is not None and turned is not None
    assert np.abs(upright.uv - (np.array(SIZE) - 1 - turned.uv)).max() < 0.1


def test_views_that_only_one_camera_sees_are_used_as_well() -> None:
    places = poses(CHARUCO, 14, 5)
    seen = sights(CHARUCO, LEFT, places), sights(CHARUCO, RIGHT, [rig().T_right_left @ T for T in places], 1)
    for camera, gone in ((0, ("0", "3")), (1, ("5", "6"))):
        for name in gone:
            seen[camera].pop(name, None)
    left, right = (solve_camera(CHARUCO, s, SIZE)[0] for s in seen)
    fit, said = solve_pair(CHARUCO, (left, right))
    assert said == [] and not {"0", "3", "5", "6"} & set(fit.pairs)
    assert {"5", "6"} <= set(fit.cameras[0].errors) and {"0", "3"} <= set(fit.cameras[1].errors)
    assert abs(fit.rig.baseline - rig().baseline) < 0.5e-3 and fit.rms_px == pytest.approx(0.14, abs=0.02)


# The predicted standard deviations -----------------------------------------------------------------


def test_predicted_deviations_are_those_of_many_repetitions() -> None:
    places = poses(CHARUCO, 12, 5)
    errors = []
    for seed in range(10):
        fit, _ = solve_camera(CHARUCO, sights(CHARUCO, LEFT, places, seed), SIZE)
        assert fit.terms == ("k1", "k2", "p1", "p2") and fit.rms_px == pytest.approx(0.14, abs=0.02)
        errors.append((fit.values - TRUTH) / fit.sd)
    # Each column: 10 numbers of unit deviation about 0.
    assert np.all(np.abs(np.mean(errors, axis=0)) < 1.2)
    assert 0.75 < np.sqrt(np.mean(np.square(errors))) < 1.3


def test_predicted_deviations_of_the_rig_are_those_of_many_repetitions() -> None:
    places, true = poses(CHARUCO, 10, 5), rig()
    length, turn, spread_deg = [], [], 0.0
    for seed in range(4):
        fit = _pair(places, seed)
        length.append((fit.rig.baseline - true.baseline) / fit.baseline_sd)
        turn.append(
            np.linalg.norm(cv2.Rodrigues(fit.rig.T_right_left[:3, :3] @ true.T_right_left[:3, :3].T)[0])
        )
        spread_deg = fit.rotation_sd_deg
    assert 0.4 < np.sqrt(np.mean(np.square(length))) < 2.0
    assert 0.4 < np.degrees(np.sqrt(np.mean(np.square(turn)))) / spread_deg < 2.0


def _pair(places: Sequence[Array], seed: int = 0):
    right = [rig().T_right_left @ T for T in places]
    seen = sights(CHARUCO, LEFT, places, seed), sights(CHARUCO, RIGHT, right, 100 + seed)
    left, right = (solve_camera(CHARUCO, s, SIZE)[0] for s in seen)
    return solve_pair(CHARUCO, (left, right))[0]


def test_coefficients_that_the_views_do_not_bear_are_left_out() -> None:
    plain = replace(LEFT, distortion=())
    terms = []
    for far, aside in ((0.5, 0.3), (3.0, 0.05), (12.0, 0.05)):
        places = poses(CHARUCO, 10, 5, aside=aside, near=0.9 * far, far=far)
        terms.append(solve_camera(CHARUCO, sights(CHARUCO, plain, places, 1), SIZE)[0].terms)
    # The smaller the board in the picture, the less it shows of the lens.
    assert terms[0] == ("k1", "k2", "p1", "p2") and terms[-1] == () and len(terms[1]) < 4


# Weak data are called weak -------------------------------------------------------------------------


def _judged(places: Sequence[Array]) -> str:
    fit, _ = solve_camera(CHARUCO, sights(CHARUCO, LEFT, places), SIZE)
    return poor(judge_camera(fit, "camera"))


def test_good_data_are_called_good() -> None:
    assert _judged(poses(CHARUCO, 15, 3)) == ""
    assert poor(judge_pair(_pair(poses(CHARUCO, 12, 5)))) == ""


@pytest.mark.parametrize("turned", [0.0, 0.5])
def test_parallel_views_do_not_determine_the_focal_length_and_that_is_said(turned: float) -> None:
    places = poses(CHARUCO, 12, 3, tilt=0.02)
    for T in places:
        middle = T[:3, :3] @ (3.5 * 0.03, 2.5 * 0.03, 0) + T[:3, 3]
        T[:3, :3] = cv2.Rodrigues(np.array([0, turned, 0]))[0] @ T[:3, :3]
        T[:3, 3] = middle - T[:3, :3] @ (3.5 * 0.03, 2.5 * 0.03, 0)
    said = _judged(places)
    assert "views are parallel" in said and "focal length is not determined" in said and "tilted" in said


def test_three_views_are_too_few() -> None:
    assert "only 3 views; take 15 or more" in _judged(poses(CHARUCO, 3, 3))


def test_two_views_are_refused_with_their_number() -> None:
    with pytest.raises(BadInput, match="only 2 views show a ChArUco board of 7 x 5"):
        solve_camera(CHARUCO, sights(CHARUCO, LEFT, poses(CHARUCO, 2, 3)), SIZE)


def test_corners_only_in_the_middle_are_said_so() -> None:
    said = _judged(poses(CHARUCO, 12, 3, aside=0.02, near=1.0, far=1.1))
    assert "all corners are in the middle of the picture" in said and "near each side" in said


def test_the_empty_side_of_the_picture_is_named() -> None:
    places = poses(CHARUCO, 15, 3)
    for T in places:
        T[0, 3] -= 0.15
    fit, _ = solve_camera(CHARUCO, sights(CHARUCO, LEFT, places), SIZE)
    said = " ".join(finding.text for finding in judge_camera(fit, "camera"))
    assert "no corners in the top right, the right and the bottom right of the picture" in said


def test_corners_that_no_camera_explains_are_said_so() -> None:
    fit, _ = solve_camera(CHARUCO, sights(CHARUCO, LEFT, poses(CHARUCO, 12, 3), sigma=1.5), SIZE)
    assert "off the best camera" in poor(judge_camera(fit, "camera"))


def test_few_pairs_and_an_unknown_baseline_are_said_so() -> None:
    far = poses(CHARUCO, 4, 3, tilt=0.3, aside=0.05, near=1.6, far=1.8)
    said = poor(judge_pair(_pair(far)))
    assert "only 4 pairs" in said and "baseline" in said and "rotation known to" in said


def test_poor_is_exit_code_1_and_the_file_is_written_all_the_same(tmp_path: Path) -> None:
    folder = write(tmp_path / "in", [picture(CHARUCO, LEFT, T) for T in poses(CHARUCO, 3, 3)])
    code, _, err = run(folder, "--board", CHARUCO.text, "--out", tmp_path / "camera.toml")
    assert code == 1 and "! camera: only 3 views" in err and "to put right" in err
    assert tomllib.loads((tmp_path / "camera.toml").read_text())["camera"]["fx"] > 0


# What does not agree is left out -------------------------------------------------------------------


def test_a_view_that_disagrees_is_dropped_by_name_and_does_no_harm() -> None:
    seen = sights(CHARUCO, LEFT, poses(CHARUCO, 14, 3))
    bad = seen["4"]
    ripple = 4 * np.sin(np.arange(bad.uv.size)).reshape(-1, 2)
    seen["4"] = replace(bad, uv=bad.uv + ripple)
    fit, said = solve_camera(CHARUCO, seen, SIZE)
    assert len(said) == 1 and said[0].startswith("4: ") and "4" not in fit.errors
    assert np.all(np.abs(fit.values - TRUTH) < 4 * fit.sd)


def test_a_stray_corner_is_dropped_and_its_view_kept() -> None:
    seen = sights(CHARUCO, LEFT, poses(CHARUCO, 12, 3))
    uv = seen["4"].uv.copy()
    uv[7] += (1.5, -1.5)
    stray = int(seen["4"].ids[7])
    seen["4"] = replace(seen["4"], uv=uv)
    fit, said = solve_camera(CHARUCO, seen, SIZE)
    assert said == [] and "4" in fit.errors and stray not in fit.sights["4"].ids


def test_a_pair_that_was_not_taken_at_once_is_dropped_by_name() -> None:
    places = poses(CHARUCO, 12, 3)
    right = [rig().T_right_left @ T for T in places]
    right[5] = right[5].copy()
    right[5][0, 3] += 0.01
    seen = sights(CHARUCO, LEFT, places), sights(CHARUCO, RIGHT, right)
    left_fit, right_fit = (solve_camera(CHARUCO, s, SIZE)[0] for s in seen)
    fit, said = solve_pair(CHARUCO, (left_fit, right_fit))
    assert len(said) == 1 and said[0].startswith("5: the two pictures disagree")
    assert "5" not in fit.pairs and abs(fit.rig.baseline - rig().baseline) < 0.5e-3


def test_blurred_and_repeated_views_are_left_out() -> None:
    places = poses(CHARUCO, 6, 3)
    rng = np.random.default_rng(0)
    views = [View(str(i), (sight(CHARUCO, LEFT, T, rng),)) for i, T in enumerate([*places, *places[:3]])]
    blurred = replace(views[1], sights=(replace(views[1].sights[0], blur=9.0),))  # type: ignore[type-var]
    kept, said = without_blurred([views[0], blurred, *views[2:]])
    assert [v.name for v in kept] == ["0", "2", "3", "4", "5", "6", "7", "8"]
    assert said == ["1: blurred (edges 9.0 px wide)"]
    assert sorted(int(v.name) % 6 for v in spread(CHARUCO, views, [SIZE])) == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize("motion", [False, True])
def test_the_blur_of_a_picture_is_measured_in_pixels(motion: bool) -> None:
    T = poses(CHECKER, 1, 2, tilt=0.1, aside=0.0)[0]
    sharp = picture(CHECKER, LEFT, T)
    soft = np.asarray(cv2.blur(sharp, (7, 1)), np.uint8) if motion else picture(CHECKER, LEFT, T, blur=2.4)
    widths = [found.blur for image in (sharp, soft) if (found := Finder(CHECKER).find(image)) is not None]
    assert len(widths) == 2 and 1.0 < widths[0] < 3.0 and widths[1] > 4.5


# Videos and cameras --------------------------------------------------------------------------------


def test_a_video_gives_views_that_differ(tmp_path: Path) -> None:
    images = [picture(CHARUCO, LEFT, T) for T in poses(CHARUCO, 4, 3)]
    path = tmp_path / "clip.avi"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30, SIZE)
    for image in images:
        for _ in range(5):
            video.write(image)
    video.release()
    source = open_source(str(path))
    gathered = gather(CHARUCO, [source], keep=False)
    source.close()
    assert len(gathered.views) == 20 and len(spread(CHARUCO, gathered.views, gathered.sizes)) == 4


class FakeCamera:
    """A camera in front of which somebody moves the board, holding it still for two frames at each place."""

    fps, total, live = 30.0, None, True

    def __init__(self, name: str, images: Sequence[Image]) -> None:
        self.name = name
        self._frames = [image for image in images for _ in range(2)]
        self._next = -1

    def skip(self) -> bool:
        self._next += 1
        return self._next < len(self._frames)

    def read(self) -> Picture | None:
        return Picture(self._frames[self._next])

    def close(self) -> None:
        pass


def test_two_cameras_take_pairs_by_themselves_while_the_board_is_still(
    pair_folders: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    images = []
    for folder in pair_folders:
        source = open_source(str(folder))
        images.append([p.image for _ in range(10) if (p := source.read()) is not None])
    cameras = {"0": FakeCamera("camera 0", images[0]), "1": FakeCamera("camera 1", images[1])}
    monkeypatch.setattr(command, "open_source", lambda given: cameras[given])
    code, _, err = run("0", "1", "--board", CHARUCO.text, "--out", tmp_path / "rig.toml")
    assert code == 0, err
    taken = err.count(" of 25 taken; now ")
    assert 8 <= taken <= 10 and f"{taken} of 25 taken" in err
    assert abs(load_rig(tmp_path / "rig.toml").baseline - rig().baseline) < 1e-3


# The printed board ---------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["charuco:7x5:30:22", "charuco:8x6:20:15:5X5_100", "checker:9x6:25"])
@pytest.mark.parametrize("dpi", [96, 254])
def test_the_printed_board_has_its_true_size(text: str, dpi: int, tmp_path: Path) -> None:
    board = parse_board(text)
    assert run("--board", text, "--print", tmp_path / "b.png", "--dpi", dpi)[0] == 0
    page = Pictures.open(tmp_path / "b.png")
    assert page.info["dpi"] == pytest.approx((dpi, dpi), abs=0.1)
    dark = np.asarray(page) < 128
    cols = np.flatnonzero(dark[dark.shape[0] // 4 : dark.shape[0] // 2].any(axis=0))
    per_mm = dpi / 25.4
    # The first and the last column of squares both hold black ones.
    assert np.ptp(cols) + 1 == pytest.approx(board.cols * board.square * 1e3 * per_mm, abs=1.01)
    found = Finder(board).find(np.asarray(page))
    assert found is not None and len(found.ids) == len(board.corners)
    size = board.corners[:, :2] * 1e3 * per_mm
    assert np.abs((found.uv - found.uv[0]) - (size - size[0])).max() < 1.0


def test_the_board_is_opencvs_own() -> None:
    board = parse_board("charuco:6x5:40:30")
    theirs = board.charuco().generateImage((6 * 80, 5 * 80))
    assert np.mean(np.abs(draw_board(board, 80).astype(int) - theirs) > 128) < 0.02


def test_a_pdf_has_the_size_of_its_page(tmp_path: Path) -> None:
    code, _, err = run("--board", CHARUCO.text, "--print", tmp_path / "b.pdf", "--dpi", 150)
    page = draw_page(CHARUCO, 150)
    box = (tmp_path / "b.pdf").read_bytes().split(b"/MediaBox")[1].split(b"]")[0].strip(b" [")
    width = float(box.split()[2])
    assert code == 0 and width == pytest.approx(page.shape[1] / 150 * 72, abs=0.1) and "print at 100 %" in err


# Errors name the culprit ---------------------------------------------------------------------------


def test_no_board_says_which_board_was_sought(tmp_path: Path) -> None:
    folder = write(tmp_path / "in", [np.full((120, 160, 3), 127, np.uint8)] * 2)
    code, out, err = run(folder, "--board", "checker:9x6:25")
    assert (code, out) == (2, "") and str(folder) in err
    assert "no board found in 2 pictures" in err
    assert "a checkerboard of 9 x 6 squares of 25 mm (8 x 5 inner corners)" in err


@pytest.mark.parametrize("wrong", ["checker:7x4:25", "checker:9x6:25"])
def test_a_miscounted_board_is_told_its_right_count(wrong: str, tmp_path: Path) -> None:
    folder = write(tmp_path / "in", [picture(CHECKER, LEFT, T) for T in poses(CHECKER, 1, 3, aside=0.05)])
    code, _, err = run(folder, "--board", wrong)
    assert code == 2 and "a checkerboard of 8 x 5 squares" in err


def test_another_set_of_markers_is_recognised(tmp_path: Path) -> None:
    other = parse_board("charuco:7x5:30:22:6X6_250")
    folder = write(tmp_path / "in", [picture(other, LEFT, T) for T in poses(other, 1, 3, aside=0.05)])
    code, _, err = run(folder, "--board", CHARUCO.text)
    assert code == 2 and "They show a ChArUco board of 7 x 5 squares" in err and "6X6" in err


def test_different_numbers_of_pictures_are_refused(pair_folders: tuple[Path, Path], tmp_path: Path) -> None:
    fewer = write(tmp_path / "fewer", [np.zeros((48, 64, 3), np.uint8)] * 3)
    code, _, err = run(pair_folders[0], fewer, "--board", CHARUCO.text)
    assert code == 2 and f"{fewer} has 3 pictures" in err and "has 12 pictures" in err


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    images = [picture(CHARUCO, LEFT, T) for T in poses(CHARUCO, 4, 3)]
    folder = write(tmp_path / "in", images)
    (folder / "1.png").write_bytes(b"no picture")
    cv2.imwrite(str(folder / "2.png"), images[2][:400])
    code, _, err = run(folder, "--board", CHARUCO.text)
    assert code == 2 and "only 2 views" in err
    (folder / "4.png").write_bytes(b"")
    cv2.imwrite(str(folder / "5.png"), picture(CHARUCO, LEFT, poses(CHARUCO, 1, 8)[0]))
    code, _, err = run(folder, "--board", CHARUCO.text)
    assert code == 1 and "not used: 1.png: damaged" in err and "not used: 4.png" in err
    assert "2.png: 640 x 400 pixels, the first one has 640 x 480" in err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere", "--board", CHARUCO.text], "nowhere: there is no such file or folder"),
        (["--board", CHARUCO.text], "give a SOURCE"),
        ([".", ".", "--board", CHARUCO.text], "both sources are the same"),
        ([".", "tests", "x", "--board", CHARUCO.text], "3 sources"),
        (
            [".", "--board", CHARUCO.text, "--out", "nowhere/rig.toml"],
            "nowhere/rig.toml: there is no such folder",
        ),
        (
            ["--board", CHARUCO.text, "--print", "board.jpg"],
            "board.jpg: cannot write '.jpg'; take .png, .pdf",
        ),
        (["999", "--board", CHARUCO.text], "there is no camera 999"),
    ],
)
def test_wrong_arguments_are_named(arguments: list[str], said: str, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run(*arguments)
    assert out == "" and said in err and code == (3 if "camera" in said else 2)
    assert err.count("\n") == 1 and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("chess:9x6:25", "unknown board 'chess'"),
        ("checker:9x6", "expected checker:COLSxROWS:SQUARE_MM"),
        ("checker:9x6:25:18", "expected checker"),
        ("charuco:7x5:30", "expected checker"),
        ("checker:9by6:25", "'9by6' is not COLSxROWS"),
        ("checker:3x9:25", "each side needs 4 to 60"),
        ("checker:9x6:nan", "'nan' is not a length"),
        ("charuco:7x5:30:31", "smaller than its square"),
        ("charuco:7x5:30:22:9X9_50", "unknown set of markers '9X9_50'"),
        ("charuco:30x20:30:22:4X4_50", "fewer markers than the 300"),
    ],
)
def test_a_wrong_board_is_named(text: str, said: str) -> None:
    with pytest.raises((BadInput, UnknownName)) as error:
        parse_board(text)
    assert said in str(error.value) and text in str(error.value)


@pytest.mark.parametrize("text", ["checker:9x6:25", "charuco:7x5:30:22", "charuco:7x5:30.5:22:5X5_100"])
def test_a_board_is_written_as_it_is_read(text: str) -> None:
    assert parse_board(text).text == text
