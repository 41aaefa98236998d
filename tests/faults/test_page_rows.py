"""Rows of who drives: a real engine on the bench, and two pages in front of it.

Connections come and go by calls here; that a browser's closing is such a call within the bound is measured
in `test_page_safety_browser.py`.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from bench import Bench, row

from vita import commands as cmd
from vita.errors import NotNow
from vita.snapshot import Snapshot
from vita.types import MOVING_STATES
from vita.ui.ownership import AWAY_S, Lease
from vita.ui.permits import Commands

ANN, BEN = 0, 1
TOKEN = {ANN: "a" * 32, BEN: "b" * 32}


class Desk:
    """A bench with two pages before it. Commands are applied at once, as between two ticks."""

    def __init__(self, bench: Bench) -> None:
        self.bench, self.now = bench, 0.0
        self.lease = Lease(lambda: self.now)
        self.shown = self.bench.engine.snapshot()
        self.pages = Commands(self, self.lease, lambda client: self.shown.tick)
        for page in (ANN, BEN):
            self.lease.opened(page)
            self.lease.showed(page, TOKEN[page])

    # What the door needs of a runner.

    def submit(self, command: cmd.Command) -> None:
        self.bench.engine.apply(command)

    def stop(self, reason: str = "stopped_by_user") -> None:
        self.bench.engine.stop(reason)

    def estop(self, culprit: str = "") -> None:
        self.bench.engine.estop(culprit=culprit)

    def snapshot(self) -> Snapshot:
        return self.bench.engine.snapshot()

    # What the tests do.

    @property
    def state(self) -> str:
        return self.bench.engine.status.state

    def tick(self, count: int = 3) -> Snapshot:
        """Control periods, all of which every page is shown."""
        self.shown = self.bench.tick(count)
        return self.shown

    def moving(self, page: int) -> None:
        """`page` presses Start, and the arm is under way: it moves already to learn."""
        rest = self.tick(1).q
        self.pages.submit(page, cmd.Start())
        self.bench.until(lambda s: not np.allclose(s.q, rest, atol=5e-3))
        self.tick(1)

    def goes_on(self, page: int, to: str = "learning") -> None:
        """`page` presses Start, and the arm goes on."""
        self.tick()
        self.pages.submit(page, cmd.Start())
        self.bench.until(to)


@pytest.fixture(scope="module")
def shared() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture
def desk(shared: Bench) -> Desk:
    shared.engine.stop()
    shared.engine.apply(cmd.ResetArm())
    return Desk(shared)


@row("U1")
def test_the_arm_is_held_when_the_drivers_page_closes_and_another_page_may_go_on(desk: Desk) -> None:
    desk.moving(ANN)
    assert desk.pages.left(ANN)
    assert desk.state == "hold", "not one more period"
    assert desk.bench.engine.status.reason == "driver_left"
    assert "page that drove" in desk.bench.engine.status.message
    desk.bench.rests_after()
    with pytest.raises(NotNow, match="Page 1 drove and may come back"):
        desk.pages.submit(BEN, cmd.Start())
    desk.now += AWAY_S
    desk.goes_on(BEN)
    assert not desk.pages.left(ANN), "who only watches may leave"
    desk.bench.until("done")


@row("U3")
def test_a_reload_holds_the_arm_and_the_same_browser_drives_on(desk: Desk) -> None:
    desk.moving(ANN)
    desk.pages.left(ANN)
    desk.bench.rests_after()
    desk.now += AWAY_S - 1.0
    again = 7  # a reload is a new connection
    desk.lease.opened(again)
    assert desk.lease.showed(again, TOKEN[ANN])
    assert desk.state == "hold", "coming back moves nothing"
    with pytest.raises(NotNow, match="Page 1 drives"):
        desk.pages.submit(BEN, cmd.Start())
    desk.goes_on(again)


@row("U4")
def test_another_page_can_stop_and_nothing_else_until_it_takes_over_the_resting_arm(desk: Desk) -> None:
    desk.moving(ANN)
    before = desk.snapshot()
    for command in (
        cmd.Start(), cmd.DeleteTracker("tip0_left"), cmd.SetServo("gain", 1.0),
        cmd.LoadTask(before.scenario), cmd.Inject("V5"),
    ):  # fmt: skip
        with pytest.raises(NotNow, match="Page 1 drives. Take over when the arm rests."):
            desk.pages.submit(BEN, command)
    with pytest.raises(NotNow, match="arm moves"):
        desk.pages.take_over(BEN)
    after = desk.tick(1)
    assert after.status.state in MOVING_STATES
    assert after.scenario.servo == before.scenario.servo and not after.injected
    assert [t.name for t in after.scenario.tracker] == [t.name for t in before.scenario.tracker]
    desk.pages.stop(BEN)
    assert desk.state == "hold"
    desk.bench.rests_after()
    desk.pages.take_over(BEN)
    with pytest.raises(NotNow, match="Page 2 drives"):
        desk.pages.submit(ANN, cmd.Start())
    desk.goes_on(BEN)


@row("U4")
def test_an_emergency_stop_is_everybodys_and_then_anybody_may_take_over(desk: Desk) -> None:
    desk.moving(ANN)
    desk.pages.estop(BEN)
    desk.pages.take_over(BEN)
    assert desk.state == "estop" and "page 2" in desk.bench.engine.status.message
    desk.tick()
    with pytest.raises(NotNow):
        desk.pages.submit(BEN, cmd.Start())
    desk.pages.submit(BEN, cmd.Reset(confirm=True))
    assert desk.state == "idle", "Reset never moves the arm"
    desk.goes_on(BEN)


@row("U5")
def test_the_second_of_two_edits_of_one_and_the_same_task_is_refused(desk: Desk) -> None:
    desk.tick()
    desk.pages.submit(ANN, cmd.DeleteConstraint("meet 0 left"))
    desk.pages.take_over(BEN)  # before the change could be seen
    with pytest.raises(NotNow, match="changed meanwhile from another page. Look, then do it again"):
        desk.pages.submit(BEN, cmd.DeleteConstraint("meet 1 left"))
    left = [k.name for k in desk.snapshot().scenario.constraint]
    assert "meet 0 left" not in left and "meet 1 left" in left
    desk.tick()  # the page is refreshed by the next pictures
    desk.pages.submit(BEN, cmd.Undo())
    assert "meet 0 left" in [k.name for k in desk.snapshot().scenario.constraint]
