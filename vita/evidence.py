"""What the last ten seconds saw and did, and the file that every fault leaves of it.

Nothing is copied while it is collected, and no picture is kept: a tick costs one small object. The arrays
are made when a fault asks for them, and written by a thread that ends with its work.
"""

from __future__ import annotations

import logging
import re
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vita.errors import VitaError
from vita.scenario.record import RunRecord
from vita.scenario.schema import Scenario
from vita.servo.reasons import outcome_of
from vita.snapshot import Snapshot
from vita.types import Array, ErrorVector, Feature, Joint, JointStep, Observation, Status, frozen

log = logging.getLogger("vita.evidence")
TICKS = 300
"""Ten seconds at 30 frames a second."""
EVENTS = 600
"""A flood of clicks may push out older events, never ticks."""
FILES = 50
"""Recordings kept; the oldest goes first."""
PENDING = 8
"""Recordings that may wait to be written; in a storm of faults the others are left out."""
_OURS = re.compile(r"(\d{6})-[a-z_]+\.(npz|json|png)")


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """One control period, by reference."""

    index: int
    """How many were noted before it."""
    number: int
    """Of the frame."""
    stamp: float
    q: Array
    error: ErrorVector
    status: Status
    step: JointStep | None
    gate: Mapping[str, object] | None
    """What the gate said while the arm was permitted to move."""
    features: Mapping[str, Feature]
    scenario: Scenario
    joints: tuple[Joint, ...]


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened between two ticks."""

    index: int
    """How many ticks were noted before it."""
    stamp: float
    """Of the last observation before it [s]."""
    kind: str
    """`state`, `command`, `refused` or `notice`."""
    text: str
    reason: str = ""
    message: str = ""


class Ring:
    """The last `TICKS` periods and the events between them."""

    def __init__(self) -> None:
        self._ticks: deque[Tick] = deque(maxlen=TICKS)
        self._events: deque[Event] = deque(maxlen=EVENTS)
        self._count = 0

    def note(
        self,
        seen: Observation,
        snapshot: Snapshot,
        step: JointStep | None,
        gate: Mapping[str, object] | None,
    ) -> None:
        """Take down one period."""
        self._ticks.append(
            Tick(
                self._count, seen.number, seen.stamp, seen.q, snapshot.error, snapshot.status, step, gate,
                snapshot.features, snapshot.scenario, snapshot.joints,
            )
        )  # fmt: skip
        self._count += 1

    def say(self, stamp: float, kind: str, text: str, reason: str = "", message: str = "") -> None:
        """Take down an event after the observation of `stamp` [s]."""
        self._events.append(Event(self._count, stamp, kind, text, reason, message))

    def take(self) -> tuple[tuple[Tick, ...], tuple[Event, ...]]:
        """What is there now; it does not change any more."""
        return tuple(self._ticks), tuple(self._events)


def recorded(ticks: Sequence[Tick], events: Sequence[Event], status: Status, name: str) -> RunRecord | None:
    """The recording of a piece of the past that ended in `status`; None without a single tick."""
    if not ticks:
        return None
    last = ticks[-1]
    # A new rig begins its own time, and may have other joints: only the ticks of the last one fit together.
    anew = [i for i in range(1, len(ticks)) if ticks[i].stamp <= ticks[i - 1].stamp]
    ticks = ticks[anew[-1] if anew else 0 :]
    count, n = len(ticks), last.q.size
    trackers, labels = tuple(last.features), last.error.labels
    uv, seen = np.full((count, len(trackers), 2), np.nan), np.zeros((count, len(trackers)), bool)
    error = np.full((count, len(labels)), np.nan)
    for i, tick in enumerate(ticks):
        rows = dict(zip(tick.error.labels, tick.error.values, strict=True))
        error[i] = [rows.get(label, np.nan) for label in labels]
        for k, tracker in enumerate(trackers):
            feature = tick.features.get(tracker)
            if feature is not None:
                uv[i, k], seen[i, k] = feature.uv, feature.ok
    begin = ticks[0].stamp
    return RunRecord(
        scenario=last.scenario,
        outcome=outcome_of(status),
        reason=status.reason,
        message=status.message,
        ticks=count,
        sim_time_s=last.stamp - begin,
        final_error_px=last.error.largest,
        expect={},
        passed=False,
        stamp=np.array([tick.stamp for tick in ticks]),
        q=np.array([tick.q for tick in ticks]),
        error=error,
        labels=labels,
        weights=last.error.weights,
        command=np.array([np.zeros(n) if tick.step is None else tick.step.dq for tick in ticks]),
        state=tuple(tick.status.state for tick in ticks),
        trackers=trackers,
        uv=uv,
        seen=seen,
        series={
            "frame": frozen([tick.number for tick in ticks]),
            "gate_stopped": _gate_series(ticks, "stopped"),
            "gate_dropped": _gate_series(ticks, "dropped"),
            "gate_at_rest": _gate_series(ticks, "at_rest"),
        },
        events=told([event for event in events if event.index >= ticks[0].index]),
        joints=last.joints,
        name=name,
    )


def told(events: Sequence[Event]) -> tuple[Mapping[str, object], ...]:
    """Events as a recording keeps them."""
    return tuple(
        {"stamp": e.stamp, "kind": e.kind, "text": e.text, "reason": e.reason, "message": e.message}
        for e in events
    )


def _gate_series(ticks: Sequence[Tick], key: str) -> Array:
    """(t,) a number of the gate's, NaN where it was not asked."""
    return frozen([np.nan if t.gate is None else float(t.gate.get(key, np.nan)) for t in ticks])  # type: ignore[arg-type]


class EvidenceFiles:
    """Writes recordings into a folder, off the caller's thread, and keeps the newest `FILES`.

    Files are numbered, not dated: the clock on the wall may be set back.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._lock = threading.Lock()
        self._jobs: deque[Callable[[], None]] = deque()
        self._busy = False
        self._number: int | None = None

    def write(self, ring: Ring, status: Status, written: Callable[[str], None]) -> None:
        """Keep what `ring` holds now; `written` is told the file once it is there. Never waits or raises."""
        ticks, events = ring.take()
        with self._lock:
            if len(self._jobs) >= PENDING:
                return
            self._jobs.append(lambda: self._save(ticks, events, status, written))
            if self._busy:
                return
            self._busy = True
        threading.Thread(target=self._run, name="vita-evidence", daemon=True).start()

    def _run(self) -> None:
        while True:
            with self._lock:
                if not self._jobs:
                    self._busy = False
                    return
                job = self._jobs.popleft()
            try:
                job()
            except (OSError, VitaError) as failure:
                log.warning("the evidence of a fault was not written: %s", failure)
            except Exception:
                log.exception("the evidence of a fault was not written")

    def _save(
        self, ticks: Sequence[Tick], events: Sequence[Event], status: Status, written: Callable[[str], None]
    ) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        stem = f"{self._next():06d}-{status.reason or status.state}"
        record = recorded(ticks, events, status, stem)
        if record is None:
            return
        record.save(self.folder, stem, plot=False)  # Drawing takes seconds and the interpreter's lock.
        written(str(self.folder / f"{stem}.npz"))
        self._tidy()

    def _next(self) -> int:
        newest = max((number for number, _ in self._files()), default=0)
        self._number = max(newest, self._number or 0) + 1
        return self._number

    def _files(self) -> list[tuple[int, Path]]:
        found = ((_OURS.fullmatch(path.name), path) for path in self.folder.iterdir())
        return sorted((int(match[1]), path) for match, path in found if match)

    def _tidy(self) -> None:
        files = self._files()
        kept = set(sorted({number for number, _ in files})[-FILES:])
        for number, path in files:
            if number not in kept:
                path.unlink(missing_ok=True)
