"""The lens tells a board that somebody has turned from a browser that is late with its reports."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
import viser.transforms as vtf

from vita.ui.layout import FOV, Rect
from vita.ui.lens import GRACE_S, PATIENCE_S, STRAIGHT, Lens

WORLD_FOV = float(np.radians(42.0))
TURNED = vtf.SO3.from_rpy_radians(0.6, 0.2, 0.4).wxyz


class Bench:
    """A lens on a stand-in for viser's camera, whose attributes are what the browser reported last."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        monkeypatch.setattr("vita.ui.lens.time", SimpleNamespace(monotonic=lambda: self.now))
        self.camera = SimpleNamespace(aspect=1.5, wxyz=STRAIGHT)
        client = SimpleNamespace(camera=self.camera, atomic=nullcontext)
        self.lens = Lens(client)  # type: ignore[arg-type]
        self.lens.show(Rect(0.0, 0.0, 1300.0, 960.0), 960.0)

    def reports(self, fov: float, wxyz: np.ndarray) -> None:
        self.camera.fov, self.camera.wxyz = fov, wxyz


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


def test_aiming_straight_asks_for_the_board_and_is_not_tilted(bench: Bench) -> None:
    assert bench.camera.fov == FOV and bench.camera.position[2] < 0
    assert bench.camera.position[:2] == bench.camera.look_at[:2] == (650.0, 480.0)
    bench.now += 10 * GRACE_S
    assert not bench.lens.tilted()


@pytest.mark.parametrize("later", [0.0, 0.5 * GRACE_S, 2 * GRACE_S, 0.9 * PATIENCE_S])
def test_a_late_report_of_the_3d_world_is_no_tilted_board(bench: Bench, later: float) -> None:
    bench.reports(WORLD_FOV, TURNED)
    bench.now += later
    assert not bench.lens.tilted()


@pytest.mark.parametrize(
    "report",
    [
        {"fov": WORLD_FOV, "wxyz": TURNED},
        {"fov": FOV, "wxyz": TURNED, "look_at": (350.0, 199700.0, 0.0)},
        {"fov": FOV, "wxyz": STRAIGHT, "position": (650.0, 201000.0, -9000.0)},
    ],
)
def test_a_browser_that_stays_away_is_asked_again_for_the_view_that_was_aimed(
    bench: Bench, report: dict[str, object]
) -> None:
    """Half of what it tells may be the board's and half the 3D world's: nothing of it is to be aimed at."""
    aimed = bench.camera.position, bench.camera.look_at
    for key, value in report.items():
        setattr(bench.camera, key, value)
    bench.now += 1.1 * PATIENCE_S
    assert bench.lens.tilted()
    bench.lens.straighten()
    assert (bench.camera.position, bench.camera.look_at, bench.camera.fov) == (*aimed, FOV)


def test_a_turned_view_of_the_board_is_tilted_and_said_once(bench: Bench) -> None:
    bench.reports(FOV, TURNED)
    assert not bench.lens.tilted()  # may still be on its way
    bench.now += 1.5 * GRACE_S
    assert bench.lens.tilted()
    assert not bench.lens.tilted()
    bench.now += 1.5 * GRACE_S
    assert bench.lens.tilted()


def test_a_quaternion_of_the_other_sign_is_the_same_view(bench: Bench) -> None:
    bench.reports(FOV, -STRAIGHT)
    bench.now += 10.0
    assert not bench.lens.tilted()


def test_straightening_keeps_the_place_and_the_distance(bench: Bench) -> None:
    eye, target = np.array([300.0, 200.0, -9000.0]), np.array([700.0, 500.0, 0.0])
    bench.camera.position, bench.camera.look_at = eye, target
    bench.lens.straighten()
    assert bench.camera.look_at == (700.0, 500.0, 0.0)
    distance = float(np.linalg.norm(target - eye))
    assert np.allclose(bench.camera.position, [700.0, 500.0, -distance])
