"""A marker whose name is being typed stays selected, however the typing is cut into renames."""

from __future__ import annotations

from dataclasses import replace

from fake_runner import two_cameras
from hypothesis import given, settings
from hypothesis import strategies as st

from vita import commands as c
from vita.scenario.schema import TrackerSpec
from vita.snapshot import Snapshot
from vita.types import Status, frozen
from vita.ui.compose import Composer
from vita.ui.renames import FORGET_S, Renames


class Bench:
    """A composer whose commands wait until `work` does some of them; unknown and taken names are refused."""

    def __init__(self) -> None:
        self.names = ["G1", "T1"]
        self.now = 0.0
        self.waiting: list[c.RenameTracker] = []
        self.composer = Composer(self.submit, clock=lambda: self.now)
        self.composer.renames = Renames(lambda: self.now)
        self.composer.selected = "G1"

    def submit(self, command: object) -> None:
        assert isinstance(command, c.RenameTracker)
        self.waiting.append(command)

    def work(self, count: int) -> None:
        for command in self.waiting[:count]:
            if command.name in self.names and command.new not in self.names and "!" not in command.new:
                self.names[self.names.index(command.name)] = command.new
        del self.waiting[:count]
        self.composer.reconcile(self.snapshot())

    def snapshot(self) -> Snapshot:
        trackers = tuple(TrackerSpec(name, "left", "fixed", (9.0, 9.0)) for name in self.names)
        scenario = replace(two_cameras(), tracker=trackers)
        return Snapshot(1, self.now, Status(), frozen(()), (), {}, {}, scenario)


@settings(deadline=None)
@given(st.lists(st.tuples(st.sampled_from("abc "), st.integers(0, 3)), min_size=1, max_size=12))
def test_the_marker_stays_selected_whatever_the_pauses(keys: list[tuple[str, int]]) -> None:
    """Keys come one by one, and the engine does none, some or all of the renames in between."""
    bench, text = Bench(), ""
    for key, done in keys:
        text += key
        if text.strip():
            bench.composer.rename(text.strip())
        bench.work(done)
        assert bench.composer.selected in bench.names and bench.composer.selected != "T1"
    bench.work(len(bench.waiting))
    wanted = text.strip() or "G1"
    assert bench.names == [wanted, "T1"] and bench.composer.selected == wanted


def test_a_refused_name_is_forgotten_and_the_next_one_counts() -> None:
    bench = Bench()
    bench.composer.rename("bad!")
    bench.work(1)
    assert bench.composer.selected == "G1"
    bench.now += 2 * FORGET_S
    bench.composer.rename("good")
    bench.work(1)
    assert bench.names[0] == "good" and bench.composer.selected == "good"


def test_a_marker_that_is_deleted_is_no_longer_selected() -> None:
    bench = Bench()
    bench.names.remove("G1")
    bench.work(0)
    assert bench.composer.selected is None


def test_the_field_is_not_overwritten_with_what_was_typed_into_it() -> None:
    bench = Bench()
    assert not bench.composer.renames.typed("G1")
    bench.composer.rename("tip")
    assert bench.composer.renames.typed("tip") and not bench.composer.renames.typed("G1")
    assert not bench.composer.renames.typed(None)
