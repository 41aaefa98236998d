"""Frames to browsers, each at the pace that it can take.

When pictures come faster than a browser decodes them it cancels each decode for the next one and shows
almost nothing. So each client has a thread that sends one snapshot, asks for a round trip, and waits at
least twice the median round trip before the next. Nothing is encoded while nobody looks.
"""

from __future__ import annotations

import statistics
import threading
import time
from collections import deque
from collections.abc import Callable

import viser
from viser._image_encoding import cv2_imencode_with_fallback

from vita.snapshot import Snapshot
from vita.types import Image
from vita.ui.safe import log

ROUND_TRIP_TIMEOUT_S = 2.0


class Encoder:
    """JPEGs of the newest snapshot, made once however many browsers look."""

    def __init__(self) -> None:
        self.quality = 80
        self._lock = threading.Lock()
        self._key: tuple[int, int] = (-1, -1)
        self._made: dict[str, bytes] = {}

    def encode(self, snapshot: Snapshot) -> dict[str, bytes]:
        with self._lock:
            key = (snapshot.tick, self.quality)
            if key != self._key:
                self._made = {name: self._jpeg(frame) for name, frame in snapshot.frames.items()}
                self._key = key
            return self._made

    def _jpeg(self, frame: Image) -> bytes:
        return cv2_imencode_with_fallback("jpeg", frame, self.quality, channel_ordering="rgb")


class Stream:
    """Sends snapshots to one client until it leaves."""

    def __init__(
        self,
        client: viser.ClientHandle,
        wait_newer: Callable[[int, float], Snapshot | None],
        show: Callable[[Snapshot], None],
        fps: Callable[[], float],
        told: Callable[[str | None], None],
        key: str,
    ) -> None:
        """`told` is handed what the browser keeps under `key` of its storage, once per picture."""
        self._client, self._wait_newer, self._show, self._fps = client, wait_newer, show, fps
        self._told, self._key = told, key
        self._stopped = threading.Event()
        self._trips: deque[float] = deque([0.02], maxlen=9)
        self._sent: deque[float] = deque(maxlen=30)
        self._thread = threading.Thread(target=self._run, name=f"vita-stream-{client.client_id}", daemon=True)
        self._thread.start()

    @property
    def rate_hz(self) -> float:
        """Snapshots per second shown lately."""
        sent = list(self._sent)
        if len(sent) < 2 or time.monotonic() - sent[-1] > 2.0:
            return 0.0
        return (len(sent) - 1) / max(sent[-1] - sent[0], 1e-6)

    def stop(self) -> None:
        self._stopped.set()

    def _run(self) -> None:
        tick = -1
        while not self._stopped.is_set():
            started = time.monotonic()
            snapshot = self._wait_newer(tick, 0.5)
            if snapshot is None:
                continue
            tick = snapshot.tick
            try:
                with self._client.atomic():
                    self._show(snapshot)
                if self._stopped.is_set():
                    return
                asked = time.monotonic()
                answer = self._client.local_storage.get_item(self._key, timeout=ROUND_TRIP_TIMEOUT_S)
                self._trips.append(time.monotonic() - asked)
                self._told(answer)
            except TimeoutError:
                self._trips.append(ROUND_TRIP_TIMEOUT_S)
            except RuntimeError:
                if self._stopped.wait(0.05):  # the client left, or its storage is blocked
                    return
                self._trips.append(0.03)
            except Exception:
                log.exception("drawing for client %s failed", self._client.client_id)
                self._stopped.wait(1.0)
            self._sent.append(time.monotonic())
            period = max(1.0 / max(self._fps(), 0.5), 2.0 * statistics.median(self._trips))
            self._stopped.wait(max(0.0, period - (time.monotonic() - started)))
