"""What the page says and does about faults, stops and those who only watch, without a browser."""

from __future__ import annotations

import io
import re
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from browser import wait_for
from fake_following import a_snapshot, a_view, stereo_scene
from fake_runner import FakeRunner, two_cameras

from vita import commands as c
from vita.errors import BadInput, NotNow
from vita.faults import CATALOGUE, Site, Tap, inject, injectors
from vita.fuzz.client import Client
from vita.servo import status_for
from vita.snapshot import Snapshot
from vita.types import Status, frozen
from vita.ui import App, fault_words
from vita.ui.announcer import Announcer
from vita.ui.drill import Drill
from vita.ui.impedance_words import NO_MARKERS, explain
from vita.ui.panels.run import packed
from vita.ui.permits import ACTING
from vita.ui.tally import Tally
from vita.ui.visitors import TOKEN_KEY
from vita.verbs.fuzz import FUZZERS


@pytest.fixture(scope="module")
def app() -> Iterator[App]:
    runner = FakeRunner()
    runner.slowness_s = 1e3
    app = App(runner, port=0)
    yield app
    app.close()
    runner.close()


@pytest.fixture
def runner(app: App) -> FakeRunner:
    """At rest, with a task, and with page 0 at the wheel."""
    runner: Any = app.runner
    app.commands.lease.opened(0)
    app.commands.lease.opened(1)
    app.commands.lease.take_over(0, resting=True)
    runner._status = status_for("")
    now(app, "idle")
    runner.log.clear()
    runner.reasons.clear()
    app.run._stopped_at = app.run._cleared_at = app.run._asked_at = -60.0
    return runner


def now(app: App, state: str) -> None:
    wait_for(lambda: app.runner.snapshot().status.state == state, state)


def moves(app: App, runner: FakeRunner) -> None:
    runner._start, runner._status = time.monotonic(), Status("servoing")
    now(app, "servoing")


def later(runner: FakeRunner) -> None:
    """Whatever was asked for has been done by now."""
    tick = runner.snapshot().tick
    wait_for(lambda: runner.snapshot().tick > tick + 2, "some ticks")


def as_page(page: int, do: Callable[[], Any]) -> None:
    """Run what a callback of that page would run."""
    token = ACTING.set(page)
    try:
        do()
    finally:
        ACTING.reset(token)


def event(page: int) -> Any:
    return SimpleNamespace(client_id=page, client=SimpleNamespace(client_id=page))


def sent(runner: FakeRunner, kind: type) -> int:
    return sum(isinstance(command, kind) for command in runner.log)


# Start, Stop, Reset.


@pytest.mark.parametrize("reason, state", [("diverged", "fault"), ("rig_offline", "offline")])
def test_the_second_click_of_a_double_click_never_starts_the_arm(
    app: App, runner: FakeRunner, reason: str, state: str
) -> None:
    runner._status = status_for(reason)
    now(app, state)
    as_page(0, app.run.start)
    now(app, "idle")
    as_page(0, app.run.start)
    later(runner)
    assert not sent(runner, c.Start)
    app.run._cleared_at -= 1.0  # a second later it is meant
    as_page(0, app.run.start)
    wait_for(lambda: sent(runner, c.Start), "the start")


def test_an_emergency_stop_is_reset_by_a_second_click_only(app: App, runner: FakeRunner) -> None:
    as_page(1, app.run.estop)
    now(app, "estop")
    with pytest.raises(NotNow, match="press Reset first"):
        as_page(0, app.run.reset)
    as_page(0, app.run.start)
    assert runner.snapshot().status.state == "estop" and not runner.log
    as_page(0, app.run.reset)
    now(app, "idle")
    assert runner.log == [c.Reset(confirm=True)]
    as_page(0, app.run.start)
    later(runner)
    assert not sent(runner, c.Start)


def test_the_question_of_reset_does_not_stand_for_ever_nor_for_the_next_emergency(
    app: App, runner: FakeRunner
) -> None:
    as_page(0, app.run.estop)
    now(app, "estop")
    as_page(0, app.run.start)
    as_page(1, app.run.estop)
    with pytest.raises(NotNow):
        as_page(0, app.run.reset)
    app.run._cleared_at = -60.0
    as_page(0, app.run.start)
    app.run._asked_at -= 60.0
    with pytest.raises(NotNow):
        as_page(0, app.run.reset)


def test_space_and_escape_of_a_page_that_watches_stop_and_never_start(app: App, runner: FakeRunner) -> None:
    with pytest.raises(NotNow):
        app.actions.toggle(event(1))
    moves(app, runner)
    app.actions.toggle(event(1))
    assert runner.reasons == ["stopped_by_user"]
    moves(app, runner)
    app.composer.arm("tracker")
    app.actions.escape(event(1))
    assert len(runner.reasons) == 2 and app.composer.tool == "tracker", "the driver keeps the tool in hand"
    now(app, "hold")
    app.actions.escape(event(1))
    assert len(runner.reasons) == 3 and app.composer.tool == "tracker"
    app.actions.escape(event(0))
    assert len(runner.reasons) == 3 and app.composer.tool == "select"


def test_escape_stops_a_moving_arm_even_with_a_tool_in_hand(app: App, runner: FakeRunner) -> None:
    moves(app, runner)
    app.composer.arm("tracker")
    app.actions.escape(event(0))
    assert runner.reasons == ["stopped_by_user"]
    app.composer.put_away()


# Pages that come and go, over the port that browsers use.


@pytest.fixture
def free(app: App, runner: FakeRunner) -> FakeRunner:
    """Nobody drives."""
    app.commands.lease._driver = None
    for page in (0, 1):
        app.commands.lease.closed(page)
    return runner


def page(app: App, storage: dict[str, str]) -> Client:
    """A page that has been asked for its token, or has been given one."""
    known = set(app.commands.lease.pages)
    page = Client(app.door.own_address, storage=storage)
    wait_for(lambda: storage.get(TOKEN_KEY) and set(app.commands.lease.pages) - known, "the token")
    return page


def test_a_drivers_line_that_ends_stops_the_arm_and_the_same_browser_drives_on(
    app: App, free: FakeRunner
) -> None:
    ann_keeps: dict[str, str] = {}
    with page(app, {}) as ben:
        ann = page(app, ann_keeps)
        ann.command("Select")
        wait_for(lambda: app.commands.lease.driver is not None, "a driver")
        moves(app, free)
        ann.close()
        wait_for(lambda: free.reasons, "the stop")
        assert free.reasons == ["driver_left"]
        ben.wait(lambda: "drove and is gone" in ben.told(), "the news")
        ben.command("Undo")
        ben.wait(lambda: "may come back within" in ben.told(), "the refusal")
        with page(app, ann_keeps) as again:
            again.wait(lambda: "Welcome back" in again.told(), "the welcome")
            assert app.commands.lease.number(app.commands.lease.driver) == 2
            again.command("Undo")
            wait_for(lambda: sent(free, c.Undo), "what the driver asks")
    assert sent(free, c.Undo) == 1


@pytest.mark.parametrize("row_, told", [("U3", ""), ("U4", 'read: "Page 1 drives. Take over when')])
def test_faults_of_who_drives_are_tried_on_the_page_that_runs(
    app: App, free: FakeRunner, row_: str, told: str
) -> None:
    site = Site(None, Tap(), page=Drill(app.door))  # type: ignore[arg-type]
    with pytest.raises(BadInput, match="nobody drives"):
        inject(row_, site)
    with page(app, {}) as ann:
        ann.command("Select")
        wait_for(lambda: app.commands.lease.driver is not None, "a driver")
        moves(app, free)
        inject(row_, site)
        if told:
            ann.wait(lambda: told in ann.told(), "what came of it")
            assert not free.reasons and not sent(free, c.Undo)
        else:
            wait_for(lambda: free.reasons == ["driver_left"], "the stop")


# Messages.


def test_what_is_refused_thirty_times_a_second_is_said_once() -> None:
    said: list[str] = []
    client = SimpleNamespace(client_id=3, add_notification=lambda title, text, **more: said.append(text))
    announcer = Announcer(SimpleNamespace(), a_snapshot())  # type: ignore[arg-type]
    for _ in range(30):
        announcer.tell(client, "warning", "Page 1 drives.")
    announcer.tell(client, "warning", "Something else.")
    assert said == ["Page 1 drives.", "Something else."]


def test_the_evidence_is_handed_out_whole_and_nothing_beside_it(tmp_path: Path) -> None:
    for name in ("000007-diverged.npz", "000007-diverged.json", "000008-estop.npz", "secret.txt"):
        (tmp_path / name).write_text(name)
    stem, content = packed(tmp_path / "000007-diverged.npz")
    with zipfile.ZipFile(io.BytesIO(content)) as pack:
        assert stem == "000007-diverged" and pack.testzip() is None
        assert pack.namelist() == ["000007-diverged.json", "000007-diverged.npz"]
    with pytest.raises(BadInput, match="not there any more"):
        packed(tmp_path / "000001-gone.npz")


def entering(*reasons: str) -> list[Snapshot]:
    return [
        Snapshot(tick, 0.0, status_for(reason), frozen(()), (), {}, {}, two_cameras())
        for tick, reason in enumerate(reasons)
    ]


def test_each_entry_into_a_state_is_counted_once() -> None:
    first, *others = entering(
        "", "stopped_by_user", "stopped_by_user", "", "diverged", "estop", "images_late", "driver_left", ""
    )
    tally = Tally(first)
    for snapshot in others:
        tally.note(snapshot)
    assert dict(tally.counts) == {"hold": 3, "fault": 1, "estop": 1, "late": 1, "left": 1}
    words = re.sub("<[^>]*>", "", tally.html(2, 5))
    assert "3 held" in words and "5 dropped steps" in words and "2 open pages" in words


# The fault page.


def test_every_row_belongs_to_a_group_and_says_what_happens_and_how_to_go_on() -> None:
    for row in CATALOGUE.values():
        said = fault_words.expected(row)
        assert fault_words.group_of(row.id) and row.verdict in fault_words.VERDICTS
        assert row.recover in said or row.recover == "nothing to do", row.id
        assert row.bound in said, row.id


def test_a_row_without_a_button_names_a_command_that_is_there() -> None:
    for row in CATALOGUE.values():
        command = fault_words.proof(row)
        own = f"pytest tests/faults --row {row.id}"
        assert command == own or command in ("vita soak", *(f"vita fuzz {name}" for name in FUZZERS))
    root = Path(__file__).parent.parent
    asked = (sys.executable, "-m", "pytest", "tests/faults/test_page_rows.py", "--row", "U5", "--co", "-q")
    said = subprocess.run(asked, cwd=root, capture_output=True, text=True, timeout=60).stdout
    assert said.strip() == "tests/faults/test_page_rows.py: 1", said


def test_buttons_try_what_can_be_tried_and_refuse_the_rest(app: App, runner: FakeRunner) -> None:
    panel = next(panel for panel in app.panels if type(panel).__name__ == "FaultsPanel")
    panel: Any
    tried = sorted(injectors())[0]
    as_page(0, lambda: panel._try(tried))
    wait_for(lambda: c.Inject(tried) in runner.log, "the fault")
    without = next((name for name in CATALOGUE if name not in injectors()), None)
    if without is not None:
        with pytest.raises(BadInput, match="Proven by"):
            as_page(0, lambda: panel._try(without))


# The stereo-impedance mode.


def without(*hidden: tuple[str, str]) -> dict[tuple[str, str], Any]:
    return {key: corners for key, corners in a_view().corners.items() if key not in hidden}


LEFT_TOOL, RIGHT_TOOL = ("left", "tool"), ("right", "tool")
LEFT_TARGET, RIGHT_TARGET = ("left", "target"), ("right", "target")


@pytest.mark.parametrize(
    "hidden, said",
    [
        ((LEFT_TARGET,), "the target is not seen by the left camera"),
        ((LEFT_TOOL, RIGHT_TOOL), "the tool is not seen by the cameras left and right"),
        ((LEFT_TOOL, RIGHT_TOOL, LEFT_TARGET), "the tool is not seen by the cameras left and right, nor"),
        ((LEFT_TOOL, RIGHT_TOOL, LEFT_TARGET, RIGHT_TARGET), "neither the target nor the tool is seen"),
        ((LEFT_TOOL,), "the target is hard to see"),
    ],
)
def test_waiting_names_what_is_hidden(hidden: tuple[tuple[str, str], ...], said: str) -> None:
    view = a_view(phase="waiting", corners=without(*hidden))
    told = explain(a_snapshot(view, Status("servoing")))
    assert told.startswith("Waiting: ") and said in told


def test_a_scene_that_was_not_made_for_this_mode_leads_to_the_example() -> None:
    bare = replace(stereo_scene(), scene=replace(stereo_scene().scene, objects=()))
    blind = a_snapshot(a_view(phase="idle", corners={}), Status(), scenario=bare)
    assert explain(blind) == NO_MARKERS and "Follow target" in NO_MARKERS
    seen = a_snapshot(a_view(phase="idle", corners=without(LEFT_TOOL)), Status(), scenario=bare)
    told = explain(seen)
    assert "Marker 7 on the tool is not seen by the left camera" in told
    assert "Move the cameras" in told and "tripod" not in told
    on_tripod = a_snapshot(a_view(phase="idle", corners=without(LEFT_TOOL)), Status())
    assert "Move the tripod" in explain(on_tripod)
