"""Who drives: the laws of the lease, and of the one door through which commands pass."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from fake_runner import two_cameras
from hypothesis import given, settings
from hypothesis import strategies as st

from vita import commands as c
from vita.errors import NotNow
from vita.servo import status_for
from vita.snapshot import Snapshot
from vita.types import Status, frozen
from vita.ui.ownership import AWAY_S, Lease
from vita.ui.permits import ACTING, Commands, as_the_page

TOKENS = {0: "a" * 32, 1: "b" * 32, 2: "c" * 32}


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class Behind:
    """Stands where the runner stands: keeps what comes through."""

    def __init__(self) -> None:
        self.log: list[object] = []
        self.stops: list[str] = []
        self.tick, self.status = 10, Status()

    def submit(self, command: object) -> None:
        self.log.append(command)

    def stop(self, reason: str = "stopped_by_user") -> None:
        self.stops.append(reason)
        if self.status.state == "servoing":
            self.status = status_for(reason)

    def estop(self, culprit: str = "") -> None:
        self.stops.append(culprit)
        self.status = status_for("estop", culprit=culprit)

    def snapshot(self) -> Snapshot:
        return Snapshot(self.tick, 0.0, self.status, frozen(()), (), {}, {}, two_cameras())


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def lease(clock: Clock) -> Lease:
    lease = Lease(clock)
    for client in (0, 1, 2):
        lease.opened(client)
        assert not lease.showed(client, TOKENS[client])
    return lease


@pytest.fixture
def behind() -> Behind:
    return Behind()


@pytest.fixture
def doors(lease: Lease, behind: Behind) -> Commands:
    return Commands(behind, lease)


# The lease.


def test_the_first_page_that_does_something_drives(lease: Lease) -> None:
    assert lease.driver is None
    lease.claim(1)
    assert lease.driver == 1 and lease.drives(1) and not lease.drives(0)


def test_another_page_is_refused_by_the_name_of_the_one_that_drives(lease: Lease) -> None:
    lease.claim(1)
    with pytest.raises(NotNow, match="Page 2 drives. Take over when the arm rests."):
        lease.claim(0)
    assert lease.driver == 1


def test_take_over_only_while_the_arm_rests(lease: Lease) -> None:
    lease.claim(0)
    with pytest.raises(NotNow, match="arm moves"):
        lease.take_over(1, resting=False)
    assert lease.driver == 0
    lease.take_over(1, resting=True)
    assert lease.driver == 1


def test_a_reload_within_ten_seconds_drives_again_under_the_same_number(lease: Lease, clock: Clock) -> None:
    lease.claim(1)
    assert lease.closed(1) and lease.driver is None
    clock.now += AWAY_S - 0.1
    lease.opened(7)
    assert lease.showed(7, TOKENS[1])
    assert lease.driver == 7 and lease.number(7) == 2


def test_the_number_of_a_driver_who_is_away_is_given_to_nobody_else(lease: Lease, clock: Clock) -> None:
    lease.claim(0)
    lease.closed(0)
    lease.opened(7)
    assert lease.number(7) == 4
    lease.opened(8)
    assert lease.showed(8, TOKENS[0]) and lease.number(8) == 1


def test_after_ten_seconds_anybody_drives(lease: Lease, clock: Clock) -> None:
    lease.claim(1)
    lease.closed(1)
    clock.now += AWAY_S - 0.1
    with pytest.raises(NotNow, match="Page 2 drove and may come back"):
        lease.claim(0)
    clock.now += 0.1
    lease.claim(0)
    lease.opened(7)
    assert not lease.showed(7, TOKENS[1]) and lease.driver == 0


def test_a_page_that_was_taken_over_from_does_not_get_it_back_by_a_reload(lease: Lease) -> None:
    lease.claim(0)
    lease.take_over(1, resting=True)
    assert not lease.closed(0)
    lease.opened(7)
    assert not lease.showed(7, TOKENS[0]) and lease.driver == 1


def test_another_window_of_the_drivers_browser_only_watches(lease: Lease) -> None:
    lease.claim(0)
    lease.opened(7)
    assert not lease.showed(7, TOKENS[0])  # the same browser keeps the same token
    with pytest.raises(NotNow):
        lease.claim(7)


def test_a_reload_that_is_faster_than_the_loss_of_the_old_connection_drives_again(
    lease: Lease, clock: Clock
) -> None:
    lease.claim(0)
    lease.opened(7)
    lease.showed(7, TOKENS[0])
    clock.now += 2.5  # only now is the old connection known to be dead
    assert lease.closed(0), "the arm has to stop all the same"
    assert lease.driver == 7


def test_a_window_that_has_long_watched_does_not_inherit(lease: Lease, clock: Clock) -> None:
    lease.claim(0)
    lease.opened(7)
    lease.showed(7, TOKENS[0])
    clock.now += AWAY_S
    lease.closed(0)
    assert lease.driver is None


def test_a_guessed_token_is_worth_nothing(lease: Lease) -> None:
    lease.claim(0)
    lease.closed(0)
    lease.opened(7)
    assert not lease.showed(7, "d" * 32) and lease.driver is None
    with pytest.raises(NotNow):
        lease.claim(7)


def test_a_driver_without_a_token_cannot_be_reclaimed_by_another_without_one(clock: Clock) -> None:
    lease = Lease(clock)
    lease.opened(0)
    lease.claim(0)
    lease.closed(0)
    lease.opened(1)
    assert lease.driver is None
    with pytest.raises(NotNow):
        lease.claim(1)


def test_a_connection_that_is_gone_cannot_claim(lease: Lease) -> None:
    lease.closed(2)
    with pytest.raises(NotNow, match="not open"):
        lease.claim(2)


events = st.tuples(
    st.sampled_from(["open", "show", "close", "claim", "take", "wait"]), st.integers(0, 3), st.booleans()
)


@settings(max_examples=300, deadline=None)
@given(st.lists(events, max_size=60))
def test_there_is_one_driver_and_only_a_claim_a_take_over_or_its_own_token_makes_one(
    steps: list[tuple[str, int, bool]],
) -> None:
    """The oracle is what each step may change: everything else leaves the driver as it is."""
    clock = Clock()
    lease, shown, open_ = Lease(clock), {}, set()
    last_token: str | None = None
    for what, client, flag in steps:
        before = lease.driver
        if what == "open":
            lease.opened(client)
            open_.add(client)
            assert lease.driver == before
        elif what == "show" and client in open_:
            back = lease.showed(client, TOKENS[client % 2])
            shown[client] = TOKENS[client % 2]
            assert lease.driver == (client if back else before)
            if back:
                assert before is None and last_token == TOKENS[client % 2]
        elif what == "close":
            assert lease.closed(client) == (before == client)
            open_.discard(client)
            heir = lease.driver
            if before != client:
                assert heir == before
            elif heir is not None:
                assert shown.get(heir) is not None and shown[heir] == shown.get(client)
            shown.pop(client, None)
        elif what in ("claim", "take"):
            try:
                lease.claim(client) if what == "claim" else lease.take_over(client, flag)
                assert lease.driver == client and client in open_
                assert what == "take" or before in (None, client)
                assert what == "claim" or flag or before == client
            except NotNow:
                assert lease.driver == before
        else:
            clock.now += 4.0 if flag else 12.0
            assert lease.driver == before
        now = lease.driver
        if now is not None:
            assert now in open_
            last_token = shown.get(now)
        numbers = [lease.number(page) for page in lease.pages]
        assert len(set(numbers)) == len(numbers) and set(lease.pages) == open_


# The door.

ALL = (
    c.Start(), c.Acknowledge(), c.Reset(True), c.Inject("V5"), c.Mend(), c.ClearTask(), c.Undo(),
    c.SetServo("gain", 0.5), c.SetLimits("speed_rad_s", 0.3), c.SetMode("impedance"), c.ResetArm(),
    c.LoadTask(two_cameras()), c.Perform("move_camera", {}), c.DeleteTracker("T1"),
)  # fmt: skip


@pytest.mark.parametrize("command", ALL, ids=lambda command: type(command).__name__)
def test_only_the_page_that_drives_commands(doors: Commands, behind: Behind, command: object) -> None:
    doors.submit(0, c.SetServo("gain", 0.4))
    with pytest.raises(NotNow, match="Page 1 drives"):
        doors.submit(1, command)
    assert behind.log == [c.SetServo("gain", 0.4)]
    doors.submit(0, command)
    assert behind.log[-1] is command


def test_everybody_may_stop_and_nobody_becomes_the_driver_by_it(doors: Commands, behind: Behind) -> None:
    doors.stop(2)
    doors.estop(1)
    assert behind.stops == ["stopped_by_user", "pressed at page 2"] and doors.lease.driver is None


def test_whoever_leaves_while_the_arm_moves_stops_it_if_and_only_if_it_drove(
    doors: Commands, behind: Behind
) -> None:
    doors.submit(0, c.Start())
    behind.status = Status("servoing")
    assert not doors.left(1) and not behind.stops
    assert doors.left(0)
    assert behind.stops == ["driver_left"] and behind.status.reason == "driver_left"


def test_a_start_that_is_still_on_its_way_is_stopped_too(doors: Commands, behind: Behind) -> None:
    doors.submit(0, c.Start())
    assert not doors.left(0), "nothing moved that people would have to be told of"
    assert behind.stops == ["driver_left"]


def test_unattended_means_that_the_arm_goes_on(lease: Lease, behind: Behind) -> None:
    doors = Commands(behind, lease, allow_unattended=True)
    doors.submit(0, c.Start())
    behind.status = Status("servoing")
    assert not doors.left(0) and not behind.stops


@pytest.mark.parametrize("state", ["learning", "servoing"])
def test_nobody_takes_over_a_moving_arm_except_after_an_emergency_stop(
    doors: Commands, behind: Behind, state: Any
) -> None:
    doors.submit(0, c.Start())
    behind.status = Status(state)
    with pytest.raises(NotNow, match="Stop it, then take over"):
        doors.take_over(1)
    doors.estop(1)
    doors.take_over(1)
    assert doors.lease.driver == 1


def test_an_edit_of_what_another_page_has_changed_meanwhile_is_refused(lease: Lease, behind: Behind) -> None:
    seen = {0: 10, 1: 10}
    doors = Commands(behind, lease, seen.get)
    doors.submit(0, c.DeleteTracker("T1"))
    doors.take_over(1)
    for tick in (10, 11):  # the edit shows in picture 12 at the latest
        seen[1] = tick
        with pytest.raises(NotNow, match="changed meanwhile"):
            doors.submit(1, c.DeleteTracker("T1"))
        with pytest.raises(NotNow, match="changed meanwhile"):
            doors.submit(1, c.Start())
    seen[1] = 12
    doors.submit(1, c.DeleteTracker("T2"))
    assert behind.log == [c.DeleteTracker("T1"), c.DeleteTracker("T2")]


def test_ones_own_edits_may_follow_one_another_faster_than_the_pictures(
    lease: Lease, behind: Behind
) -> None:
    doors = Commands(behind, lease, lambda client: 10)
    for _ in range(5):
        doors.submit(0, c.MoveTracker("T1", (1.0, 2.0)))
        behind.tick += 3
    doors.submit(0, c.Start())
    assert len(behind.log) == 6


def test_a_start_from_before_another_pages_stop_is_refused(lease: Lease, behind: Behind) -> None:
    seen = {0: 10}
    doors = Commands(behind, lease, seen.get)
    doors.stop(1)
    with pytest.raises(NotNow, match="Stopped meanwhile"):
        doors.submit(0, c.Start())
    doors.stop(0)  # one's own is known
    doors.submit(0, c.Start())
    assert behind.log == [c.Start()]


def event(client: int) -> Any:
    return SimpleNamespace(client_id=client)


def plainly(function: Any) -> Any:
    return function


def test_callbacks_speak_in_the_name_of_their_page(doors: Commands) -> None:
    heard: list[int | None] = []
    doors.anyone(plainly)(lambda event: heard.append(ACTING.get()))(event(2))
    doors.driving(plainly)(lambda event: heard.append(ACTING.get()))(event(1))
    with as_the_page():
        heard.append(ACTING.get())
    assert heard == [2, 1, None] and ACTING.get() is None and doors.lease.driver == 1


def test_a_callback_of_a_page_that_only_watches_does_not_run(doors: Commands) -> None:
    ran: list[str] = []
    drive = doors.driving(plainly)(lambda event: ran.append("drive"))
    look = doors.anyone(plainly)(lambda event: ran.append("look"))
    drive(event(0))
    look(event(1))
    with pytest.raises(NotNow):
        drive(event(1))
    assert ran == ["drive", "look"]


def test_a_callback_that_fails_leaves_no_name_behind(doors: Commands) -> None:
    def fails(event: Any) -> None:
        raise NotNow("no")

    with pytest.raises(NotNow):
        doors.anyone(plainly)(fails)(event(1))
    assert ACTING.get() is None


def test_what_the_page_itself_completes_is_the_drivers(doors: Commands, behind: Behind) -> None:
    doors.submit(0, c.AddTracker("left", (1.0, 1.0)))
    behind.tick += 5
    doors.submit(None, c.AddConstraint("point_to_point", ("T1", "G1")))
    doors.take_over(1)
    with pytest.raises(NotNow, match="changed meanwhile"):
        doors.submit(1, c.Undo(), revision=behind.tick)
    assert len(behind.log) == 2
