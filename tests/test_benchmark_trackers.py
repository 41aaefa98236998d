"""The tracker benchmark is judged before it judges: its truth, its scores and its verdict."""

import csv
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from sequences import texture

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
import tracker_follow  # noqa: E402  # pyright: ignore[reportMissingImports]
import tracker_motion as motion  # noqa: E402  # pyright: ignore[reportMissingImports]
import tracker_photos  # noqa: E402  # pyright: ignore[reportMissingImports]
import tracker_score as score  # noqa: E402  # pyright: ignore[reportMissingImports]
import trackers as command  # noqa: E402  # pyright: ignore[reportMissingImports]
from tracker_cases import CASES, SIDES, shoot  # noqa: E402  # pyright: ignore[reportMissingImports]
from tracker_photos import Photo  # noqa: E402  # pyright: ignore[reportMissingImports]
from tracker_render import SIZE, PhotoSequence  # noqa: E402  # pyright: ignore[reportMissingImports]
from tracker_rivals import makers  # noqa: E402  # pyright: ignore[reportMissingImports]
from tracker_speed import Load, all_loads  # noqa: E402  # pyright: ignore[reportMissingImports]
from tracker_verdict import verdict  # noqa: E402  # pyright: ignore[reportMissingImports]

from vita.errors import Untrackable  # noqa: E402
from vita.types import Feature, frozen  # noqa: E402

BY_NAME = {c.name: c for c in CASES}


@pytest.fixture(scope="module")
def photos():
    """Three stand-ins for photographs, so that only the command itself needs the real ones."""
    return [Photo(f"made-{i}", cv2.merge([texture(50 + i, 420, 45.0)] * 3)) for i in range(3)]


def shot_of(name, photos, side=60, number=0, seed=0, frames=30):
    return shoot(BY_NAME[name], side, number, photos, seed, frames)


# The truth.


def waves(points):
    """Grey levels of a smooth endless pattern at card pixels (..., 2)."""
    x, y = np.moveaxis(np.asarray(points), -1, 0)
    return 128 + 28 * (np.sin(x / 2.1) + np.sin(y / 1.8 + 1) + np.sin((x + y) / 3.1))


def waved(pose, **options) -> PhotoSequence:
    """A card with that pattern, 120 px wide."""
    n = 240
    at = (np.arange(n) + 0.5) / 2 - n / 4
    card = cv2.merge([waves(np.stack(np.meshgrid(at, at), axis=-1)).astype(np.float32)] * 3)
    plain = np.full((2 * SIZE[1], 2 * SIZE[0], 3), 128, np.float32)
    return PhotoSequence(card, plain, pose, 9, 1, noise=0.0, **options)


def shift_seen(frame, backs, place) -> np.ndarray:
    """(2,) by how much the pattern in `frame` is off from where it should be, about pixel `place` (2,) [px].

    The pattern is computed at 31 x 31 pixels, not drawn: `backs` (n, 3, 3) carry pixels to the card, and
    their patterns are averaged. The shift is fitted by least squares together with gain and bias, so
    that symmetric blur costs none.
    """
    u, v = np.rint(place).astype(int)
    pixels = np.stack(np.meshgrid(np.arange(u - 15, u + 16), np.arange(v - 15, v + 16)), -1).reshape(-1, 2)
    ideal, ahead, below = (
        np.mean([waves(apply(back, pixels + d)) for back in backs], axis=0)
        for d in ([0, 0], [1e-3, 0], [0, 1e-3])
    )
    slopes = np.column_stack([ideal - ahead, ideal - below]) / 1e-3
    system = np.column_stack([slopes, ideal, np.ones(len(ideal))])
    values = frame[pixels[:, 1], pixels[:, 0], 0].astype(float)
    return np.linalg.lstsq(system, values, rcond=None)[0][:2]


def apply(matrix, points):
    h = np.column_stack([points, np.ones(len(points))]) @ np.asarray(matrix).T
    return h[:, :2] / h[:, 2:]


PLACES = 22.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, 0]])
"""Near the corners and at the middle of a 60 px region, on the card [px]."""


@pytest.mark.parametrize("speed", [1.0, 12.0])
@pytest.mark.parametrize(
    "options",
    [{}, {"focus": lambda k: 1.5}, {"light": lambda k: (0.8, 9.0)}],
    ids=["sharp", "defocused", "darker"],
)
def test_the_truth_is_right_to_a_hundredth_of_a_pixel(speed, options):
    """What is drawn is where the truth of four points says, in eight bits and at any fraction of a pixel."""
    square = 30.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32)
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        pose = motion.swinging(rng, motion.ring(rng, speed), motion.period_of(speed))
        sequence = waved(pose, **options)
        for k, frame in enumerate(sequence):
            seen = sequence.truth(apply(pose(0.0), square), k).astype(np.float32)
            back = cv2.getPerspectiveTransform(seen, square)
            for place in apply(np.linalg.inv(back), PLACES):
                assert np.abs(shift_seen(frame, [back], place)).max() < 0.01


def test_a_streak_is_that_of_a_shutter_open_all_the_time_and_the_truth_its_middle():
    """Sub-frames stand for a continuous exposure, of which 60 instants are close enough to the limit."""
    rng = np.random.default_rng(3)
    pose = motion.swinging(rng, motion.ring(rng, 8.0), motion.period_of(8.0))
    sequence = waved(pose, exposure=0.6)
    for k, frame in enumerate(sequence):
        if k not in (0, 1, 5):
            continue
        instants = k + 0.6 * ((np.arange(60) + 0.5) / 60 - 0.5) if k else np.zeros(1)
        places = np.array([apply(pose(t), PLACES) for t in instants])
        truth = sequence.truth(apply(pose(0.0), PLACES), k)
        assert np.abs(truth - places.mean(axis=0)).max() < 0.003
        for place in truth:
            backs = [np.linalg.inv(pose(t)) for t in instants]
            assert np.abs(shift_seen(frame, backs, place)).max() < 0.01


@pytest.mark.parametrize("side", SIDES)
def test_the_region_stays_in_view_and_moves_at_the_speed_that_the_case_says(photos, side):
    """In the cases about success nothing hides the region but the thing that is meant to."""
    wanted = {"move1": 1.0, "move3": 3.0, "move6": 6.0, "move12": 12.0, "unsteady": 6.0, "still": 0.0}
    for case in (c for c in CASES if c.about != "loss"):
        for number in range(2):
            shot = shot_of(case.name, photos, side, number, frames=80)
            hidden = {"cover25": 0.25, "cover40": 0.4}.get(case.name, 0.0)
            shares = [shot.sequence.visible(shot.click, side, k) for k in range(0, 80, 4)]
            assert min(shares) == pytest.approx(1 - hidden, abs=0.04), case.name
            if case.name in wanted:
                path = [apply(shot.sequence.pose(k), np.zeros((1, 2)))[0] for k in range(80)]
                steps = np.hypot(*np.diff(path, axis=0).T)
                assert np.median(steps) == pytest.approx(wanted[case.name], rel=0.02)
                assert steps.max() <= wanted[case.name] + 1e-9


@pytest.mark.parametrize("name", ["cover40", "hidden"])
@pytest.mark.parametrize("number", range(3))
def test_as_much_is_covered_in_the_picture_as_the_truth_says(photos, name, number):
    """Counted in pixels, with a white card and a black thing in front."""
    shot = shot_of(name, photos, 60, number, frames=34)
    white = np.full((252, 252, 3), 255, np.float32)
    grey = np.full_like(shot.sequence.backdrop, 255)
    assert shot.sequence.thing is not None
    sequence = replace(
        shot.sequence, card=white, thing=0 * shot.sequence.thing, backdrop=grey, noise=0.0, light=None
    )
    region = shot.click + 30.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    for k, frame in enumerate(sequence):
        corners = sequence.truth(region, k).astype(np.float32)
        upright = np.array([[-0.5, -0.5], [119.5, -0.5], [119.5, 119.5], [-0.5, 119.5]], np.float32)
        seen = cv2.warpPerspective(frame, cv2.getPerspectiveTransform(corners, upright), (120, 120))
        assert seen.mean() / 255 == pytest.approx(shot.sequence.visible(shot.click, 60, k), abs=0.04)


def test_light_and_noise_are_as_strong_as_they_say(photos):
    shot = shot_of("still", photos)
    for sigma in (2.0, 5.0):
        frames = np.array([f[:, :, 1] for f in replace(shot.sequence, noise=sigma, frames=40)], float)
        middle = (frames.mean(axis=0) > 30) & (frames.mean(axis=0) < 225)
        assert frames.std(axis=0, ddof=1)[middle].mean() == pytest.approx(sigma, rel=0.03)
    lit = [shot_of("light", photos, number=n, frames=60).sequence for n in range(6)]
    gains = np.array([[s.light(k)[0] for k in range(60)] for s in lit])
    assert gains[:, 0] == pytest.approx(1.0)
    assert gains.min(axis=1) == pytest.approx(0.7, abs=0.02)
    assert gains.max(axis=1) == pytest.approx(1.3, abs=0.02)
    steps = np.abs(np.diff(gains, axis=1)).max(axis=1)
    assert (steps > 0.29).any() and (steps < 0.1).any()


def test_in_cases_about_loss_the_target_goes_and_comes_back(photos):
    for name in ("hidden", "away"):
        for side in SIDES:
            for number in range(4):
                shot = shot_of(name, photos, side, number)
                frames = range(shot.sequence.frames)
                shares = np.array([shot.sequence.visible(shot.click, side, k) for k in frames])
                assert (shares[:6] >= score.THERE).all()
                assert 10 <= (shares < score.GONE).sum() <= 40
                assert (shares[-score.REFIND - 2 :] >= score.THERE).all()


def test_the_same_seed_gives_the_same_pictures_and_another_seed_others(photos):
    first, again, other = (list(shot_of("light", photos, 30, seed=s, frames=3).sequence) for s in (5, 5, 6))
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[0], other[0])


def test_what_is_to_be_tracked_has_texture():
    """A plain photograph is passed over for one with texture; a lone edge is not texture."""
    plain = Photo("plain", np.full((300, 300, 3), 90, np.float32))
    edge = Photo("edge", np.full((300, 300, 3), 40, np.float32))
    edge.pixels[:, 150:] = 200
    good = Photo("good", cv2.merge([texture(3, 300, 45.0)] * 3))
    for seed in range(5):
        rng = np.random.default_rng(seed)
        assert tracker_photos.textured_piece([plain, edge, good], rng, 120, 0.5)[0] == "good"


# The scores.


class Made:
    """A made-up tracker that knows the truth and spoils it in a known way."""

    kind = "made"

    def __init__(self, shot, spoil):
        self._shot, self._spoil, self._k = shot, spoil, -1
        self._corners = shot.click + shot.side / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])

    def update(self, frame):
        self._k += 1
        points = np.vstack([self._shot.click, self._corners])
        seen = self._shot.sequence.truth(points, self._k)
        visible = self._shot.sequence.visible(self._shot.click, self._shot.side, self._k)
        return self._spoil(self._k, seen[0], seen[1:], visible)


def report(uv, corners, ok=True, value=1.0):
    return Feature(frozen(uv), "ok" if ok else "lost", value, None if corners is None else frozen(corners))


def follow(shot, spoil, frames=None):
    """The track of a made-up tracker; it needs no pictures."""
    frames = [np.zeros((1, 1, 3), np.uint8)] * shot.sequence.frames if frames is None else frames
    return tracker_follow.follow_all({"made": lambda *_: Made(shot, spoil)}, shot, frames)[0]


def test_a_perfect_tracker_is_perfect(photos):
    for name in ("move12", "smear", "cover40"):
        track = follow(shot_of(name, photos), lambda k, uv, c, v: report(uv, c))
        assert track.error.max() < 1e-9
        assert score.success([track], 1.0) == score.success([track], 0.001) == 1.0


@pytest.mark.parametrize("with_corners", [True, False])
def test_a_tracker_that_is_off_by_one_and_a_half_pixels_is_so(photos, with_corners):
    def off(k, uv, corners, visible):
        shift = np.array([0.9, -1.2]) * (k > 0)
        return report(uv + shift, corners + shift if with_corners else None)

    track = follow(shot_of("move6", photos), off)
    assert track.error == pytest.approx(1.5)
    assert (score.success([track], 1.0), score.success([track], 2.0)) == (0.0, 1.0)
    assert score.median_error([track]) == pytest.approx(1.5)


def test_corners_count_and_not_only_the_point(photos):
    """A region that turns in place by 0.1 rad is 4.2 px off at the corners of a 60 px region."""

    def turned(k, uv, corners, visible):
        c, s = np.cos(0.1 * (k > 0)), np.sin(0.1 * (k > 0))
        return report(uv, uv + (corners - uv) @ np.array([[c, -s], [s, c]]))

    track = follow(shot_of("still", photos), turned)
    assert track.error == pytest.approx(np.hypot(30, 30) * 0.1, rel=0.1)


def test_a_frozen_tracker_is_bad_and_never_flags(photos):
    first = {}

    def frozen_in(k, uv, corners, visible):
        first.setdefault("at", (uv, corners))
        return report(*first["at"])

    moving = follow(shot_of("move12", photos), frozen_in)
    assert score.success([moving], 2.0) == 0.0
    first.clear()
    gone = follow(shot_of("away", photos), frozen_in)
    figures = score.loss_figures([gone], [moving])
    assert (figures.flagged, figures.latencies, figures.refound) == (0.0, (-1,), 0.0)


def test_frames_that_are_flagged_lost_are_no_success(photos):
    track = follow(shot_of("move1", photos), lambda k, uv, c, v: report(uv, c, ok=k % 4 != 0))
    assert score.success([track], 1.0) == pytest.approx(22 / 29)
    figures = score.loss_figures([], [track])
    assert figures.false_per_1000 == pytest.approx(1000 * 7 / 29)


def test_a_report_of_nonsense_is_no_success(photos):
    track = follow(shot_of("move1", photos), lambda k, uv, c, v: report(uv * np.nan, c * np.nan if k else c))
    assert np.isinf(track.error).all()
    assert score.success([track], 10.0) == 0.0


def test_a_refused_click_counts_as_failure(photos):
    def refuse(*_):
        raise Untrackable("nothing here")

    shot = shot_of("move1", photos)
    (track,) = tracker_follow.follow_all({"made": refuse}, shot, [np.zeros((1, 1, 3), np.uint8)] * 30)
    assert (score.success([track], 2.0), track.refused) == (0.0, "nothing here")


@pytest.mark.parametrize(("late", "flagged"), [(0, 1.0), (2, 1.0), (3, None)])
@pytest.mark.parametrize("name", ["hidden", "away"])
def test_a_flag_is_in_time_up_to_the_third_frame(photos, name, late, flagged):
    since = [0]

    def flag(k, uv, corners, visible):
        since[0] = since[0] + 1 if visible < score.GONE else 0
        return report(uv, corners, ok=since[0] <= late, value=float(since[0] <= late))

    tracks = []
    for number in range(3):
        since[0] = 0
        tracks.append(follow(shot_of(name, photos, number=number), flag))
    figures = score.loss_figures(tracks, [])
    assert figures.latencies == (late,) * 3
    assert (figures.returns, figures.refound, figures.false_per_1000) == (3, 1.0, 0.0)
    assert figures.flagged == flagged or (flagged is None and figures.flagged == 1 - 3 / figures.bad)


@pytest.mark.parametrize(("delay", "found"), [(5, 1.0), (6, 0.0)])
def test_found_again_counts_within_five_frames(photos, delay, found):
    state = {"back": 0}

    def slow(k, uv, corners, visible):
        if visible < score.GONE:
            state["back"] = -1
        elif state["back"] and visible >= score.THERE:
            state["back"] = max(state["back"], 0) + 1
        return report(uv, corners, ok=state["back"] == 0 or state["back"] > delay)

    figures = score.loss_figures([follow(shot_of("hidden", photos), slow)], [])
    assert (figures.refound, figures.flagged) == (found, 1.0)


def test_found_again_in_the_wrong_place_is_not_found(photos):
    def elsewhere(k, uv, corners, visible):
        far = 40.0 * (k > 20)
        return report(uv + far, corners + far, ok=visible > 0.5)

    assert score.loss_figures([follow(shot_of("hidden", photos), elsewhere)], []).refound == 0.0


def test_the_area_of_a_random_score_is_a_half_and_of_a_telling_one_is_one(photos):
    rng = np.random.default_rng(0)
    shots = [shot_of("away", photos, 30, n) for n in range(8)]
    guessed = [follow(s, lambda k, uv, c, v: report(uv, c, value=float(rng.random()))) for s in shots]
    known = [follow(s, lambda k, uv, c, v: report(uv, c, value=float(v))) for s in shots]
    wrong = [follow(s, lambda k, uv, c, v: report(uv, c, value=1 - float(v))) for s in shots]
    areas = [score.roc(*score.judged(tracks))[2] for tracks in (guessed, known, wrong)]
    assert areas[0] == pytest.approx(0.5, abs=0.1)
    assert areas[1:] == pytest.approx([1.0, 0.0])


def test_the_area_is_the_chance_that_a_good_frame_scores_higher():
    """The definition of Mann and Whitney, ties counting half, over scores with many ties."""
    rng = np.random.default_rng(1)
    good = rng.random(300) < 0.7
    scores = np.round(rng.random(300) + 0.4 * good, 1)
    pairs = scores[good][:, None] - scores[~good][None]
    assert score.roc(scores, good)[2] == pytest.approx(np.mean(pairs > 0) + 0.5 * np.mean(pairs == 0))


def test_jitter_is_the_standard_deviation_that_was_put_in(photos):
    rng = np.random.default_rng(2)
    shot = shot_of("still", photos, frames=1200)
    track = follow(shot, lambda k, uv, c, v: report(uv + rng.normal(0, 0.03, 2), None))
    assert score.jitter([track]) == pytest.approx(0.03, rel=0.05)
    lost = follow(shot, lambda k, uv, c, v: report(uv, None, ok=k != 9))
    assert score.jitter([lost]) == np.inf


def test_the_limit_of_jitter_is_that_of_the_least_squares_shift(photos):
    """Measured with the best estimator there is for a shift alone, on the pictures themselves."""
    shot = shot_of("still", photos, side=30, frames=100)
    frames = np.array([cv2.cvtColor(f, cv2.COLOR_RGB2GRAY) for f in shot.sequence], float)
    u, v = np.rint(shot.click - 15).astype(int)
    gy, gx = np.gradient(frames.mean(axis=0))
    part = slice(v, v + 30), slice(u, u + 30)
    slopes = np.column_stack([gx[part].ravel(), gy[part].ravel()])
    change = (frames - frames.mean(axis=0))[:, v : v + 30, u : u + 30].reshape(len(frames), -1)
    shifts = np.linalg.lstsq(slopes, change.T, rcond=None)[0]
    assert tracker_follow.shift_limit(shot) == pytest.approx(np.sqrt(shifts.var(axis=1).mean()), rel=0.15)


# The verdict and the command.


def test_the_verdict_names_what_is_missed(photos):
    shots = [shot_of(case.name, photos, side, frames=14) for case in CASES for side in (30, 60)]

    def tracks(name, spoil):
        return [replace(follow(shot, spoil), tracker=name) for shot in shots]

    def honest(k, uv, corners, visible):
        return report(uv, corners, ok=visible > 0.5)

    def bad(k, uv, corners, visible):
        # It wanders, never says so, and cannot keep still.
        return report(uv + 0.7 * k + k % 2, None)

    quick = [Load("made", s, 16, 5.0, 1.0) for s in (3.0, 12.0)]
    rival = tracks("cv-klt", lambda k, uv, c, v: report(uv + 1.2 * (k % 2), None))
    lines = verdict(tracks("made", honest) + rival, quick, "made")
    assert all(line.reached and line.measured for line in lines), [x.what for x in lines if not x.reached]
    slow = [Load("made", s, 16, 50.0, 1.0) for s in (3.0, 12.0)]
    lines = verdict(tracks("made", bad) + rival, slow, "made")
    missed = {x.what for x in lines if not x.reached}
    assert {x.what for x in lines} - missed == {"false losses in 1000 good frames"}


def test_what_was_not_measured_is_neither_reached_nor_missed():
    assert {line.word for line in verdict([], [], "auto")} == {"not measured"}


@pytest.mark.parametrize("name", sorted(set(makers()) - {"cv-mil"}))
def test_every_tracker_can_be_named_and_follows_or_refuses(photos, name):
    """Kinds for other targets (a line, a marker) may refuse a textured card, but not fail."""
    shot = shot_of("move1", photos, 60, frames=4)
    (track,) = tracker_follow.follow_all({name: makers()[name]}, shot, shot.sequence)
    assert len(track.ok) == 3 and (track.cpu >= 0).all()


def test_the_load_counts_trackers_and_their_success(photos):
    named = {"cv-klt": makers()["cv-klt"]}
    loads = all_loads(named, photos, 0, 4, 1, lambda: None)
    assert [(x.speed, x.count) for x in loads] == [(s, n) for s in (3.0, 12.0) for n in (1, 8, 16)]
    assert all(x.mean_ms > 0 and x.success > 0.9 for x in loads)


def run(capsys, *words):
    code = command.main(words)
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_the_command_writes_tables_and_files_and_two_workers_agree_with_one(capsys, tmp_path):
    pytest.importorskip("skimage")
    words = ("--quick", "--only", "move1", "move3", "--trackers", "auto", "cv-klt", "--seed", "4")
    tables = []
    for workers in ("1", "2"):
        code, out, _ = run(capsys, *words, "--workers", workers, "--out", str(tmp_path / workers))
        assert code == 0
        tables.append(out.split("\nSeed")[0])
    assert tables[0] == tables[1] and "Verdict on auto" in tables[0]
    for name in ("report.md", "sequences.csv", "trackers.png", "frames/move3.csv", "frames/move1.csv"):
        assert (tmp_path / "1" / name).stat().st_size > 100
    rows = list(csv.DictReader((tmp_path / "1/frames/move3.csv").open()))
    assert len(rows) == 2 * 3 * 21
    assert {row["status"] for row in rows} <= {"ok", "lost"}


def test_check_makes_a_missed_figure_the_exit_code(capsys, monkeypatch):
    """A fixed pixel is no tracker: it misses every figure that is about following."""
    pytest.importorskip("skimage")
    words = ("--quick", "--only", "move12", "--trackers", "fixed")
    code, out, _ = run(capsys, *words, "--check")
    assert code == 1 and "| NO |" in out
    assert run(capsys, *words)[0] == 0


@pytest.mark.parametrize(
    ("words", "culprit"),
    [
        (["--only", "mov3"], "move3"),
        (["--trackers", "cv-kltt"], "cv-klt"),
        (["--sequences", "0"], "--sequences"),
        (["--workers", "0"], "--workers"),
        (["--photos", "nowhere"], "nowhere"),
    ],
)
def test_bad_usage_is_exit_code_2_and_names_the_culprit(capsys, words, culprit):
    code, _, err = run(capsys, *words)
    assert code == 2 and culprit in err


def test_missing_photographs_are_exit_code_3_with_what_to_do(capsys, monkeypatch):
    monkeypatch.setattr(tracker_photos, "find_spec", lambda name: None)
    code, _, err = run(capsys, "--only", "still")
    assert code == 3 and "scikit-image" in err and "--photos" in err


def test_own_pictures_are_used(capsys, tmp_path):
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"mine-{i}.png"), texture(i, 320, 45.0))
        words = ["--quick", "--only", "move1", "--trackers", "cv-klt", "--photos", str(tmp_path)]
        code, out, err = run(capsys, *words)
        assert (code == 0 and "3 photographs" in out) if i == 2 else (code == 2 and "three are needed" in err)
