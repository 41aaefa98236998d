"""A stand-in for `vita.runner.Runner`: it applies edits to a scenario and publishes synthetic frames.

Nothing moves by physics. Trackers stay where they are put; after Start the error simply decays, so
that the page's states, plots and overlays can be tested without a simulation.
"""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import numpy as np

from vita import commands as c
from vita.errors import Untrackable
from vita.scenario.schema import CameraSpec, ConstraintSpec, Scenario, TrackerSpec
from vita.servo import status_for
from vita.servo.insight import Finding, Insight
from vita.snapshot import Snapshot
from vita.types import ErrorVector, Feature, Joint, Notice, RowLabel, Status, Timing, Visual, frozen

JOINTS = tuple(Joint(f"joint{i + 1}", -2.6, 2.6, 2.0) for i in range(4))
BETTER = (320.0, 60.0)
"""Where trackers may be placed instead of at the upper edge of a picture, which is refused."""


def two_cameras() -> Scenario:
    """The scenario that tests start from: two cameras and nothing to do yet."""
    return Scenario(
        title="Synthetic views",
        camera=(
            CameraSpec("left", look_from=(1.5, -0.9, 0.9), look_at=(0.4, 0, 0.3)),
            CameraSpec("right", look_from=(1.5, 0.9, 0.9), look_at=(0.4, 0, 0.3)),
        ),
    )


def textured(size: tuple[int, int], seed: int) -> np.ndarray:
    """A (h, w, 3) picture with blocks, so that JPEG encoding costs about what real frames cost."""
    w, h = size
    rng = np.random.default_rng(seed)
    blocks = rng.integers(70, 190, (h // 40 + 1, w // 40 + 1, 3)).repeat(40, 0).repeat(40, 1)[:h, :w]
    shade = np.linspace(0.7, 1.15, h)[:, None, None]
    return np.clip(blocks * shade + rng.normal(0, 4, (h, w, 3)), 0, 255).astype(np.uint8)


class FakeRunner:
    """Publishes at 30 Hz; every command is applied at the next tick and kept in `log`."""

    def __init__(
        self,
        scenario: Scenario | None = None,
        hz: float = 30.0,
        pictures: dict[str, np.ndarray] | None = None,
    ) -> None:
        self.scenario = scenario or two_cameras()
        self.rig_revision = 1
        self.log: list[object] = []
        self.stops = 0
        self.reasons: list[str] = []
        """Why it was stopped, each time."""
        self.injected: set[str] = set()
        """Rows of the fault catalogue; nothing comes of them here."""
        self.evidence = ""
        self.slowness_s = 1.0
        """In which time the error falls to a third [s]."""
        self.lost: set[str] = set()
        """Names of trackers that are reported lost."""
        self.insight: Insight | None = None
        self.findings: tuple[Finding, ...] = ()
        self.ghost: dict[str, np.ndarray] = {}
        self.ghost_poses: dict[str, np.ndarray] = {}
        """What the servo knows and expects: published as they are."""
        self._queue: list[object] = []
        self._undo: list[Scenario] = []
        self._redo: list[Scenario] = []
        self._notices: list[Notice] = []
        self._status = Status()
        self._start = 0.0
        self._hz = hz
        self._tick = 0
        self._news = threading.Condition()
        self._closing = False
        self._textures = pictures or {
            cam.name: textured(cam.size, i) for i, cam in enumerate(self.scenario.camera)
        }
        self._snapshot = self._make()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    # The interface that the page uses.

    def submit(self, command: object) -> None:
        with self._news:
            self._queue.append(command)

    def stop(self, reason: str = "stopped_by_user") -> None:
        self.stops += 1
        self.reasons.append(reason)
        if self._status.state in ("learning", "servoing"):
            self._status = status_for(reason)

    def estop(self, culprit: str = "") -> None:
        self.stop()
        self._status = status_for("estop", culprit=culprit)

    def lose(self, message: str) -> None:
        """As when the simulation has died; `ResetArm` brings it back."""
        self._status = Status("offline", "rig_offline", message)

    def snapshot(self) -> Snapshot:
        return self._snapshot

    def wait_newer(self, tick: int, timeout: float) -> Snapshot | None:
        with self._news:
            if self._news.wait_for(lambda: self._snapshot.tick > tick or self._closing, timeout):
                return self._snapshot if self._snapshot.tick > tick else None
            return None

    def close(self) -> None:
        self._closing = True
        self._thread.join(2)

    def visuals(self) -> list[Visual]:
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
        faces = np.array(
            [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
             [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]], np.int32
        )
        sizes = {"base": (0.12, 0.12, 0.1), "link1": (0.07, 0.07, 0.25), "tool": (0.03, 0.03, 0.1)}
        return [
            Visual(name, corners * size, faces, corners / np.sqrt(3), (0.85, 0.86, 0.88))
            for name, size in sizes.items()
        ]

    # What stands in for the engine.

    def _run(self) -> None:
        while not self._closing:
            time.sleep(1 / self._hz)
            with self._news:
                queue, self._queue = self._queue, []
            for command in queue:
                self.log.append(command)
                try:
                    self._apply(command)
                except Untrackable as refusal:
                    self._say("warning", str(refusal), replace(command, uv=refusal.suggestion))  # type: ignore
                except Exception as problem:
                    self._say("error", str(problem))
            with self._news:
                self._tick += 1
                self._snapshot = self._make()
                self._news.notify_all()
        with self._news:
            self._news.notify_all()

    def _say(self, level: str, text: str, instead: object = None) -> None:
        number = self._notices[-1].id + 1 if self._notices else 1
        self._notices = [*self._notices, Notice(number, level, text, instead)][-20:]  # type: ignore

    def _edit(self, **changes: object) -> None:
        self._undo.append(self.scenario)
        self._redo.clear()
        self.scenario = replace(self.scenario, **changes)  # type: ignore

    def _apply(self, cmd: object) -> None:
        s = self.scenario
        if isinstance(cmd, c.AddTracker):
            if cmd.kind == "auto" and cmd.uv[1] < 20:
                raise Untrackable("nothing to hold on to here", f"tracker {cmd.name!r}", BETTER)
            name = cmd.name or f"T{len(s.tracker) + 1}"
            self._edit(tracker=(*s.tracker, TrackerSpec(name, cmd.camera, cmd.kind, cmd.uv, cmd.to)))
        elif isinstance(cmd, c.MoveTracker):
            self._edit(tracker=tuple(_moved(t, cmd) if t.name == cmd.name else t for t in s.tracker))
        elif isinstance(cmd, c.RenameTracker):
            new = tuple(replace(t, name=cmd.new) if t.name == cmd.name else t for t in s.tracker)
            cons = tuple(
                replace(k, points=tuple(cmd.new if p == cmd.name else p for p in k.points))
                for k in s.constraint
            )
            self._edit(tracker=new, constraint=cons)
        elif isinstance(cmd, c.DeleteTracker):
            self._edit(
                tracker=tuple(t for t in s.tracker if t.name != cmd.name),
                constraint=tuple(k for k in s.constraint if cmd.name not in k.points),
            )
        elif isinstance(cmd, c.AddConstraint):
            missing = set(cmd.points) - {t.name for t in s.tracker}
            if missing:
                raise ValueError(f"unknown tracker {sorted(missing)[0]!r}")
            name = cmd.name or f"c{len(s.constraint) + 1}"
            self._edit(constraint=(*s.constraint, ConstraintSpec(name, cmd.kind, cmd.points, cmd.weight)))
        elif isinstance(cmd, c.DeleteConstraint):
            self._edit(constraint=tuple(k for k in s.constraint if k.name != cmd.name))
        elif isinstance(cmd, (c.SetWeight, c.SetPriority)):
            what = {"weight": cmd.weight} if isinstance(cmd, c.SetWeight) else {"priority": cmd.priority}
            self._edit(
                constraint=tuple(replace(k, **what) if k.name == cmd.name else k for k in s.constraint)
            )
        elif isinstance(cmd, c.ClearTask):
            self._edit(tracker=(), constraint=())
        elif isinstance(cmd, c.Undo) and self._undo:
            self._redo.append(self.scenario)
            self.scenario = self._undo.pop()
        elif isinstance(cmd, c.Redo) and self._redo:
            self._undo.append(self.scenario)
            self.scenario = self._redo.pop()
        elif isinstance(cmd, c.SetServo):
            self._edit(servo=replace(s.servo, **{cmd.field: cmd.value}))
        elif isinstance(cmd, c.SetLimits):
            self._edit(limits=replace(s.limits, **{cmd.field: cmd.value}))
        elif isinstance(cmd, c.LoadTask):
            self._edit(**{f: getattr(cmd.scenario, f) for f in ("title", "tracker", "constraint", "servo")})
        elif isinstance(cmd, c.Start):
            if not s.constraint:
                raise ValueError("The task is empty: add a constraint first.")
            self._status, self._start = Status("servoing"), time.monotonic()
        elif isinstance(cmd, c.Inject):
            self.injected.add(cmd.fault)
        elif isinstance(cmd, c.Mend):
            self.injected.clear()
        elif isinstance(cmd, (c.Halt, c.ResetArm, c.Acknowledge)) or (
            isinstance(cmd, c.Reset) and cmd.confirm
        ):
            self._status = Status()

    def _make(self) -> Snapshot:
        s = self.scenario
        now = time.monotonic()
        moving = self._status.state == "servoing"
        decay = np.exp(-(now - self._start) / self.slowness_s) if moving else 1.0
        features = {
            t.name: _feature(t) if t.name not in self.lost
            else replace(_feature(t), status="lost", score=0.1, detail="covered, or changed too much")
            for t in s.tracker
        }
        values, labels, weights = [], [], []
        for k in s.constraint:
            camera = next(t.camera for t in s.tracker if t.name == k.points[0])
            points = [point for p in k.points for point in features[p].points]
            for axis, name in enumerate(("u", "v")):
                values.append(float(points[0][axis] - points[-1][axis]) * decay)
                labels.append(RowLabel(k.name, camera, name))
                weights.append(k.weight)
        error = ErrorVector(frozen(values), tuple(labels), frozen(weights))
        if moving and decay < 0.003:
            self._status = Status("done", "converged", "Done: every residual is below 0.5 px.")
        frames = {}
        for name, picture in self._textures.items():
            frames[name] = np.roll(picture, 2 * self._tick, axis=1) if moving else picture
        q = 0.3 * np.sin(now + np.arange(len(JOINTS))) if moving else np.zeros(len(JOINTS))
        poses = {"base": np.eye(4), "link1": _at(0, 0, 0.4), "tool": _at(0.4, 0, 0.5 + 0.1 * q[0])}
        return Snapshot(
            tick=self._tick, stamp=now, status=self._status, q=frozen(q), joints=JOINTS, frames=frames,
            features=features, scenario=s, error=error, can_undo=bool(self._undo),
            can_redo=bool(self._redo), notices=tuple(self._notices),
            timing=Timing(self._hz, {"track": 4.0, "servo": 0.3}), poses=poses,
            insight=self.insight, findings=self.findings, ghost=dict(self.ghost),
            ghost_poses=dict(self.ghost_poses), injected=tuple(sorted(self.injected)),
            evidence=self.evidence,
        )


def _feature(tracker: TrackerSpec) -> Feature:
    """What a perfect tracker would report: it stays where it was put."""
    at = tracker.at or (0.0, 0.0)
    if tracker.to is not None:
        segment = frozen([at, tracker.to])
        return Feature(frozen(segment.mean(axis=0)), score=0.9, segment=segment, detail="edge 60 px")
    return Feature(frozen(at), corners=_square(tracker), detail="template")


def _moved(tracker: TrackerSpec, cmd: c.MoveTracker) -> TrackerSpec:
    """As the engine does: a line that is moved by its middle keeps its direction and length."""
    if tracker.to is None or tracker.at is None or cmd.to is not None:
        return replace(tracker, at=cmd.uv, to=cmd.to)
    half = (np.array(tracker.to) - tracker.at) / 2
    at, to = (tuple(float(x) for x in np.array(cmd.uv) + sign * half) for sign in (-1, 1))
    return replace(tracker, at=at, to=to)  # type: ignore[arg-type]


def _square(tracker: TrackerSpec) -> np.ndarray | None:
    if tracker.kind == "fixed" or tracker.at is None:
        return None
    return np.array(tracker.at) + 20.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


def _at(x: float, y: float, z: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T
