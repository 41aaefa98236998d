"""The memory that the live rig's two processes share: a ring of frames, one command, the stop flag.

Nobody ever waits here. The child writes frames round and round the ring; the parent copies the
newest and looks whether it was overwritten meanwhile (it would have to be three frames late). The
latest command wins. Each block has a sequence number that is odd while it is being written.
"""

from __future__ import annotations

import mmap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from vita.errors import BadInput
from vita.scenario.schema import CameraSpec
from vita.types import DEPTH_STEP_PX, Array, Image, JointStep, frozen

SLOTS = 4
MAX_JOINTS = 32
MAX_BODIES = 256

_CONTROL = 192
"""Bytes of the control block: integers, each written by one process only."""
_NEWEST, _STOPS, _RELEASES, _COMMAND_SEQ, _ASKED, _TICK, _RELEASE_COUNT = range(7)
_BEAT, _AT_REST, _CYCLES, _RESTED = range(7, 11)
CAUSES = ("stop", "emergency", "silent", "corrupt")
"""Why the child may stop the arm by itself: a signal, an emergency's signal, a parent that fell silent, a
simulation that had to be rebuilt."""
_LATCHED, _LIFTED = slice(12, 12 + len(CAUSES)), slice(18, 18 + len(CAUSES))
_COMMAND = 8 * (3 + 2 * MAX_JOINTS)
_NUMBERS = 16
"""Numbers of a frame before its joints and poses."""
_META = 8 * (1 + _NUMBERS + MAX_JOINTS + 16 * MAX_BODIES)
WORDS = 4096
"""Bytes of text that go with a frame."""

NUMBERS = (
    "stamp", "number", "frozen_mask", "released", "rebuilt", "physics", "render", "hand_over",
    "real_time_factor",
)  # fmt: skip
"""What goes with each frame, besides joints and poses."""


@dataclass(frozen=True)
class SharedFrame:
    """One frame as the parent copies it out of the ring."""

    numbers: Mapping[str, float]
    q: Array
    poses: Mapping[str, Array]
    frames: Mapping[str, Image]
    depths: Mapping[str, NDArray[np.float32]]
    words: str = ""


def _aligned(size: int) -> int:
    return (size + 63) // 64 * 64


class _Said:
    """What the child says of itself, for whoever looks."""

    _control: NDArray[np.int64]

    def latched(self) -> dict[str, int]:
        """How often the child has stopped the arm by itself, for each cause."""
        return dict(zip(CAUSES, self._control[_LATCHED].tolist(), strict=True))

    @property
    def beats(self) -> int:
        return int(self._control[_BEAT])

    @property
    def cycles(self) -> int:
        """How many cycles of the gate there have been."""
        return int(self._control[_CYCLES])

    @property
    def rested(self) -> int:
        """The cycle in which the arm last came to rest."""
        return int(self._control[_RESTED])

    @property
    def at_rest(self) -> bool:
        """Whether the arm rests, as of the last cycle."""
        return bool(self._control[_AT_REST])


class Flags(_Said):
    """A look at a live rig's flags from a process that is neither of the two. Raises `OSError` when the rig
    is gone."""

    def __init__(self, name: str) -> None:
        self._memory, buffer = _look_into(name)
        self._control = np.frombuffer(buffer, np.int64, _CONTROL // 8)

    def close(self) -> None:
        """Let go of the memory. The rig keeps it."""
        del self._control
        self._memory.close()


def _look_into(name: str) -> tuple[mmap.mmap | SharedMemory, mmap.mmap | memoryview]:
    """Shared memory that stays somebody else's, and what is in it."""
    file = Path("/dev/shm", name)
    if file.is_file():
        with file.open("rb") as opened:
            memory = mmap.mmap(opened.fileno(), _CONTROL, access=mmap.ACCESS_READ)
        return memory, memory
    memory = SharedMemory(name)
    # Looking is not owning: without this, python would free the memory when this process ends.
    resource_tracker.unregister(f"/{name}", "shared_memory")
    assert memory.buf is not None
    return memory, memory.buf


class SharedFrames(_Said):
    """Both processes make one of these over the same memory; `name` is None in the one that owns it."""

    def __init__(
        self,
        cameras: Sequence[tuple[str, tuple[int, int]]],
        name: str | None = None,
        depths: Sequence[str] = (),
    ) -> None:
        """cameras: names with (width, height); depths: the names of those that measure depth as well."""
        sizes = [_aligned(width * height * 3) for _, (width, height) in cameras]
        step = DEPTH_STEP_PX
        grids = {camera: (-(-h // step), -(-w // step)) for camera, (w, h) in cameras if camera in depths}
        slot = _aligned(_META) + WORDS + sum(sizes) + sum(_aligned(4 * h * w) for h, w in grids.values())
        start = _CONTROL + _aligned(_COMMAND)
        self._memory = SharedMemory(name, create=name is None, size=start + SLOTS * slot)
        self._owner = name is None
        self.name = self._memory.name
        self._control = self._view((_CONTROL // 8,), np.int64, 0)
        self._command = self._view((4 + 2 * MAX_JOINTS,), np.float64, _CONTROL)
        self._sequence, self._meta, self._words, self._images, self._depths = [], [], [], [], []
        for i in range(SLOTS):
            base = start + i * slot
            self._sequence.append(self._view((1,), np.int64, base))
            self._meta.append(self._view((_META // 8 - 1,), np.float64, base + 8))
            base += _aligned(_META)
            self._words.append(self._view((WORDS,), np.uint8, base))
            base += WORDS
            images = {}
            for (camera, (width, height)), size in zip(cameras, sizes, strict=True):
                images[camera] = self._view((height, width, 3), np.uint8, base)
                base += size
            self._images.append(images)
            self._depths.append({})
            for camera, (height, width) in grids.items():
                self._depths[i][camera] = self._view((height, width), np.float32, base)
                base += _aligned(4 * height * width)
        if self._owner:
            self._control[_NEWEST] = -1
        self._seen_command = 0

    @classmethod
    def of(cls, cameras: Sequence[CameraSpec], name: str | None = None) -> SharedFrames:
        """The memory for a scenario's cameras."""
        return cls([(c.name, c.size) for c in cameras], name, [c.name for c in cameras if c.depth])

    def _view(self, shape: tuple[int, ...], dtype: type, offset: int) -> np.ndarray:
        return np.ndarray(shape, dtype, buffer=self._memory.buf, offset=offset)

    # ---- frames: written by the child, read by the parent -----------------------------------------

    def publish(
        self,
        numbers: Mapping[str, float],
        q: Array,
        poses: Mapping[str, Array],
        frames: Mapping[str, Image],
        depths: Mapping[str, NDArray[np.float32]] = MappingProxyType({}),
        words: str = "",
    ) -> None:
        """Write a frame into the next slot and make it the newest."""
        if len(q) > MAX_JOINTS or len(poses) > MAX_BODIES:
            raise BadInput(f"the live rig takes up to {MAX_JOINTS} joints and {MAX_BODIES} bodies")
        text = words.encode()
        if len(text) >= WORDS:
            raise BadInput(f"a frame takes up to {WORDS - 1} bytes of text, got {len(text)}")
        number = int(numbers["number"])
        i = number % SLOTS
        meta = self._meta[i]
        self._sequence[i][0] += 1
        self._words[i][: len(text)] = np.frombuffer(text, np.uint8)
        self._words[i][len(text)] = 0
        meta[: len(NUMBERS)] = [numbers[name] for name in NUMBERS]
        meta[_NUMBERS : _NUMBERS + len(q)] = q
        start = _NUMBERS + MAX_JOINTS
        meta[start : start + 16 * len(poses)] = np.concatenate([T.ravel() for T in poses.values()])
        for camera, image in frames.items():
            self._images[i][camera][...] = image
        for camera, depth in depths.items():
            self._depths[i][camera][...] = depth
        self._sequence[i][0] += 1
        self._control[_NEWEST] = number

    @property
    def newest(self) -> int:
        """Number of the newest frame, -1 before the first."""
        return int(self._control[_NEWEST])

    def read(self, joints: int, bodies: Sequence[str]) -> SharedFrame | None:
        """A copy of the newest frame; None when there is none or it was overwritten meanwhile."""
        number = self.newest
        if number < 0:
            return None
        i = number % SLOTS
        before = int(self._sequence[i][0])
        meta, words = self._meta[i].copy(), self._words[i].tobytes()
        frames = {camera: frozen(image, np.uint8) for camera, image in self._images[i].items()}
        depths = {camera: frozen(depth, np.float32) for camera, depth in self._depths[i].items()}
        if before % 2 or int(self._sequence[i][0]) != before:
            return None
        start = _NUMBERS + MAX_JOINTS
        poses = meta[start : start + 16 * len(bodies)].reshape(-1, 4, 4)
        return SharedFrame(
            dict(zip(NUMBERS, meta.tolist(), strict=False)),
            frozen(meta[_NUMBERS : _NUMBERS + joints]),
            dict(zip(bodies, poses, strict=True)),
            frames,
            depths,
            words.partition(b"\0")[0].decode(),
        )

    def tick(self, number: int) -> None:
        """Note that frame period `number` has begun, whether or not a picture is drawn of it."""
        self._control[_TICK] = number

    @property
    def fresh(self) -> bool:
        """Whether the newest picture is of this period or, while this one is drawn, of the last."""
        return self.newest >= 0 and int(self._control[_TICK]) - self.newest <= 1

    # ---- commands: written by the parent, read by the child ---------------------------------------

    def put_command(self, step: JointStep | None, joints: int) -> None:
        """Replace the command. A malformed step goes over as NaN, which the gate drops and brakes on."""
        block = np.zeros_like(self._command)
        if step is not None:
            block[0] = 1.0
            try:
                block[1:4] = step.stamp, step.speed_scale, step.arrive_s
                for value, start in ((step.dq, 4), (step.q_from, 4 + MAX_JOINTS)):
                    array = np.asarray(value, dtype=float)
                    block[start : start + joints] = array if array.shape == (joints,) else np.nan
            except (TypeError, ValueError):
                block[1:] = np.nan
        self._control[_COMMAND_SEQ] += 1
        self._command[:] = block
        self._control[_COMMAND_SEQ] += 1

    def take_command(self, joints: int) -> tuple[bool, JointStep | None]:
        """Whether there is a new command, and which."""
        sequence = int(self._control[_COMMAND_SEQ])
        if sequence == self._seen_command or sequence % 2:
            return False, None
        block = self._command.copy()
        if int(self._control[_COMMAND_SEQ]) != sequence:
            return False, None
        self._seen_command = sequence
        if not block[0]:
            return True, None
        dq, q_from = block[4 : 4 + joints], block[4 + MAX_JOINTS : 4 + MAX_JOINTS + joints]
        return True, JointStep(dq, q_from, *(float(number) for number in block[1:4]))

    # ---- flags: counters, so that no event is missed however short ---------------------------------

    def ask(self) -> None:
        """The parent wants a frame."""
        self._control[_ASKED] += 1

    @property
    def asked(self) -> int:
        return int(self._control[_ASKED])

    def stop(self) -> None:
        """Brake; safe from any thread and from signal handlers."""
        self._control[_STOPS] += 1

    def release(self) -> None:
        """Lift every stop so far, and a fault of the gate with it."""
        self._control[_RELEASES] = self._control[_STOPS]
        self._control[_RELEASE_COUNT] += 1

    @property
    def stops(self) -> int:
        """How often `stop` was called."""
        return int(self._control[_STOPS])

    @property
    def releases(self) -> int:
        """How often `release` was called."""
        return int(self._control[_RELEASE_COUNT])

    @property
    def held(self) -> bool:
        """Whether a stop is in force, the parent's or one of the child's own."""
        control = self._control
        own = (control[_LATCHED] != control[_LIFTED]).any()
        return bool(control[_STOPS] != control[_RELEASES]) or bool(own)

    def latch(self, cause: str) -> None:
        """The child stops the arm by itself, until the parent has heard of it and lifts it."""
        self._control[_LATCHED.start + CAUSES.index(cause)] += 1

    def lift(self, heard: Mapping[str, int]) -> None:
        """Lift the child's own stops as far as they were `heard` of (counts as in `latched`)."""
        self._control[_LIFTED] = [heard[cause] for cause in CAUSES]

    # ---- signs of life: written by the child -------------------------------------------------------

    def beat(self) -> None:
        """The child lives; said in every cycle and before every picture."""
        self._control[_BEAT] += 1

    def cycle(self) -> None:
        """A cycle of the gate begins."""
        self._control[_CYCLES] += 1
        self.beat()

    def rests(self, resting: bool) -> None:
        """Whether the arm rests, said in every cycle."""
        if resting and not self._control[_AT_REST]:
            self._control[_RESTED] = self._control[_CYCLES] - 1
        self._control[_AT_REST] = resting

    def close(self) -> None:
        """Let go of the memory; the owner frees it as well. Harmless when done twice."""
        if not self._sequence:
            return
        # numpy's views keep the memory mapped, so that they have to go first.
        del self._control, self._command
        self._sequence, self._meta, self._words, self._images, self._depths = [], [], [], [], []
        try:
            self._memory.close()
        except BufferError:
            pass  # Another thread is still copying a frame; the mapping goes when it is done.
        if self._owner:
            self._memory.unlink()
