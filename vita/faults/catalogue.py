"""The faults and bad inputs that vita is held against: what must happen, and what people are told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Verdict = Literal["refused", "degraded", "hold", "fault", "estop", "offline", "harmless"]


@dataclass(frozen=True)
class Row:
    """One row of the catalogue."""

    id: str
    title: str
    """The fault in a few words, as its button says it."""
    verdict: Verdict
    """What becomes of a moving arm: `refused` (nothing changes), `degraded` (half speed), `hold`, `fault`,
    `estop`, `offline`, or `harmless`."""
    bound: str
    """Within which time."""
    recover: str
    """How to go on afterwards."""



AGAIN, FIX, RELEARN, RESTART, NOTHING = (
    "press Start", "change it and try again", "Acknowledge, then Start learns again", "press Restart",
    "nothing to do",
)  # fmt: skip
"""How people usually go on."""

_ROWS = (
    # What the cameras and trackers do.
    Row("V1", "One tracker is lost", "degraded", "same period", "drag it back; full speed by itself"),
    Row("V2", "All trackers of a camera are lost", "hold", "1 period", "drag them back, press Start"),
    Row("V3", "A tracker reports what is no pixel", "degraded", "same period", "drag it back"),
    Row("V4", "One tracker stands still", "degraded", "3 periods", "drag it back"),
    Row("V5", "A camera repeats its last picture", "hold", "3 periods", AGAIN),
    Row("V6", "Pictures come late", "hold", "100 ms", AGAIN),
    Row("V7", "A tracker jumps", "degraded", "2 periods", "drag it back"),
    Row("V8", "Two trackers change places", "hold", "2 periods", "drag each back, press Start"),
    Row("V9", "A tracker drifts away", "hold", "15 periods", "drag it back, press Start"),
    Row("V10", "A feature leaves the picture", "degraded", "same period", "move the camera"),
    Row("V11", "A camera is turned", "fault", "3 periods", RELEARN),
    Row("V12", "A camera is unplugged", "hold", "1 period", AGAIN),
    Row("V13", "A tracker's code fails", "degraded", "same period", "drag it back"),
    # What the task asks.
    Row("T1", "Start without a constraint", "refused", "at once", "draw a constraint"),
    Row("T2", "Fewer constraints than joints", "hold", "after learning", "draw more or use fewer joints"),
    Row("T3", "More constraints than joints", "harmless", "", NOTHING),
    Row("T4", "Two goals for one point", "hold", "when stalled", FIX),
    Row("T5", "A line without length", "refused", "at once", FIX),
    Row("T6", "A task that is met already", "harmless", "no motion", NOTHING),
    Row("T7", "Numbers that are none in a file", "refused", "at once", FIX),
    Row("T8", "Unknown names in a file", "refused", "at once", FIX),
    Row("T9", "Too much of everything in a file", "refused", "at once", FIX),
    Row("T10", "Both cameras at one place", "hold", "after learning", "move a camera, press Start"),
    Row("T11", "An edit while the arm moves", "refused", "at once", "stop first"),
    # What the servo does.
    Row("C1", "The error grows", "fault", "3 periods", RELEARN),
    Row("C2", "Two joints turn the wrong way", "fault", "6 periods", RELEARN),
    Row("C3", "The gain is far too high", "degraded", "3 swings", "by itself; the second time a fault"),
    Row("C4", "The mathematics fails", "fault", "1 period", RELEARN),
    Row("C5", "A command that is not a number", "harmless", "1 gate cycle", NOTHING),
    Row("C6", "A push into a joint limit", "hold", "15 periods", "jog back or change the task"),
    Row("C7", "A hundred times too fast", "harmless", "at once", NOTHING),
    Row("C8", "The arm starts outside a limit", "harmless", "at once", "only inward motion passes"),
    Row("C9", "Near a singular pose", "hold", "1 period", "reset the arm, press Start"),
    Row("C10", "No more progress", "hold", "60 periods", FIX),
    Row("C11", "Steps too small for the robot", "harmless", "10 periods", NOTHING),
    Row("C12", "A joint without effect", "hold", "after learning", "leave the joint out"),
    Row("C13", "Updates from hardly any motion", "harmless", "at once", NOTHING),
    Row("C14", "The controller hangs", "fault", "0.1 s; told in 0.5 s", RESTART),
    Row("C15", "The clock on the wall is set back", "harmless", "", NOTHING),
    # What the robot and its process do.
    Row("R1", "The simulation is killed", "offline", "100 ms", RESTART),
    Row("R2", "The simulation freezes", "hold", "offline after 1 s", AGAIN),
    Row("R3", "The simulation is slow", "harmless", "", NOTHING),
    Row("R4", "The simulation fails inside", "offline", "at once", RESTART),
    Row("R5", "Joint positions that are not numbers", "estop", "1 gate cycle", "Reset, confirm, then Start"),
    Row("R6", "An obstacle at the arm", "fault", "1 gate cycle", "Acknowledge, move it away"),
    Row("R7", "A joint is locked", "fault", "5 gate cycles", "Acknowledge, then Start"),
    Row("R8", "Old and doubled commands", "harmless", "at once", NOTHING),
    # What happens at the page.
    Row("U1", "The driver's page is closed", "hold", "0.2 s", "drive from another page"),
    Row("U2", "The driver's page hangs", "hold", "2.5 s", "reload"),
    Row("U3", "The driver reloads the page", "hold", "0.2 s", AGAIN),
    Row("U4", "Another page wants to drive", "refused", "at once", "take over when the arm rests"),
    Row("U5", "Two pages edit at once", "refused", "at once", FIX),
    Row("U6", "A flood of clicks", "harmless", "at once", NOTHING),
    Row("U7", "Stop behind callbacks that block", "harmless", "20 ms", NOTHING),
    Row("U8", "Malformed frames", "harmless", "at once", "reload"),
    Row("U9", "Values that no widget has", "refused", "at once", NOTHING),
    Row("U10", "Uploads that are too big", "refused", "at once", FIX),
    Row("U11", "A hostile task file", "refused", "50 ms", FIX),
    Row("U12", "A page from another site", "refused", "at once", NOTHING),
    Row("U13", "A request for a public address", "refused", "at once", NOTHING),
    Row("U14", "The port is taken", "refused", "1 s", "choose another port"),
    Row("U15", "A page that never reads", "harmless", "5 s", "reload"),
    Row("U16", "Our own callback fails", "harmless", "at once", NOTHING),
    Row("U17", "Start twice, Stop from everywhere", "harmless", "at once", NOTHING),
    Row("U18", "A click from before a Stop", "refused", "at once", AGAIN),
    Row("U19", "A slider pulled in motion", "harmless", "10 % a period", NOTHING),
    Row("U20", "Too many pages", "refused", "at once", "close one"),
    Row("U21", "The program is ended in motion", "hold", "2 s", "start it again"),
    # What happens to files.
    Row("P1", "Killed while saving", "harmless", "", NOTHING),
    Row("P2", "The disk is full", "refused", "at once", "save elsewhere"),
    Row("P3", "Names that lead out of the folder", "refused", "at once", "choose another name"),
    Row("P4", "A file of a newer version", "refused", "at once", "install a newer vita"),
    Row("P5", "A file of an older version", "harmless", "", NOTHING),
    Row("P6", "Unknown keys in a file", "refused", "at once", FIX),
    Row("P7", "A damaged file", "refused", "at once", FIX),
    Row("P8", "Two pages save one name", "refused", "at once", "save under another name"),
    # What happens in the long run.
    Row("Q1", "Days of use", "harmless", "", NOTHING),
    Row("Q2", "A storm of faults", "harmless", "1 line a second", NOTHING),
    Row("Q3", "Starts and stops by the hundred", "harmless", "", NOTHING),
    Row("Q4", "Nobody there", "harmless", "", NOTHING),
)
CATALOGUE: dict[str, Row] = {row.id: row for row in _ROWS}
