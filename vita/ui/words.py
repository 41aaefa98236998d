"""The page's words and colours, in one place so that they stay consistent."""

from __future__ import annotations

import base64
import html
from dataclasses import dataclass

from vita.constraints import constraint_of
from vita.types import Status

Rgb = tuple[int, int, int]

GREEN: Rgb = (22, 163, 74)
ORANGE: Rgb = (234, 138, 0)
MAGENTA: Rgb = (217, 30, 190)
BLUE: Rgb = (37, 99, 235)
RED: Rgb = (220, 38, 38)
INK: Rgb = (24, 32, 44)
WHITE: Rgb = (255, 255, 255)
AMBER: Rgb = (217, 140, 0)
GREY: Rgb = (120, 130, 145)
TEAL: Rgb = (13, 118, 110)


@dataclass(frozen=True)
class Kind:
    """A constraint that people can compose by clicking."""

    key: str
    label: str
    color: Rgb
    roles: tuple[str, ...]
    """`moving` or `goal`, one per click, in the order of `ConstraintSpec.points`."""
    asks: tuple[str, ...]
    """What to click, one sentence per click."""
    meaning: str

    @property
    def lines(self) -> tuple[int, ...]:
        """The clicks with which a line begins, counted from 0."""
        return tuple(a for a, _ in constraint_of(self.key).lines()) if self.roles else ()


KINDS: tuple[Kind, ...] = (
    Kind(
        "point_to_point", "Point → Point", GREEN, ("moving", "goal"),
        ("Click the point that should move, for example on the tool.", "Click where it should go."),
        "Bring a point onto another point.",
    ),
    Kind(
        "point_to_line", "Point → Line", ORANGE, ("moving", "goal", "goal"),
        ("Click the point that should move, for example on the tool.",
         "Click one end of the line that it should reach.", "Click the other end of that line."),
        "Bring a point onto the line through two points.",
    ),
    Kind(
        "line_to_line", "Line → Line", MAGENTA, ("moving", "moving", "goal", "goal"),
        ("Click one end of the line that should move.", "Click its other end.",
         "Click one end of the line that it should lie on.", "Click the other end of that line."),
        "Lay a line onto another line.",
    ),
    Kind(
        "parallel_lines", "Parallel lines", BLUE, ("moving", "moving", "goal", "goal"),
        ("Click one end of the line that should turn.", "Click its other end.",
         "Click one end of the line to be parallel to.", "Click the other end of that line."),
        "Turn a line until it is parallel to another.",
    ),
)
KIND = {kind.key: kind for kind in KINDS}

PALETTE: tuple[Rgb, ...] = (
    (37, 99, 235), (22, 163, 74), (217, 30, 190), (234, 138, 0),
    (13, 148, 136), (147, 51, 234), (190, 80, 30), (90, 100, 115),
)

FOLLOW: dict[str, tuple[str, str]] = {
    "auto": ("Automatic", "Looks at the spot and picks what suits it; the tracker's card says what it was."),
    "patch": ("Patch", "A small flat piece of surface with some texture. The most exact."),
    "point": ("Point", "A corner or speck too small for a patch."),
    "line": ("Image edge", "A straight edge between two clicks; it sticks to the edge. Two clicks."),
    "ellipse": ("Ellipse", "The middle of a round hole, ring or disc."),
    "blob": ("Blob", "The middle of a spot of one colour."),
    "marker": ("Marker", "A printed ArUco or AprilTag marker, by its number: never mixed up with another."),
    "redetect": ("Finds again", "Learns many features of a thing and finds it again wherever it comes back."),
    "fixed": ("Fixed pixel", "Stays where it is in the picture, whatever moves there."),
}
"""Tracker kind to its label and a sentence about when to choose it."""

LINE_POINTS = "Two points"
LINE_EDGE = "Image edge"
LOST_ADVICE = "It looks for itself; or drag it onto its feature, or delete it."

GOAL_FIXED = "Fixed on the image"
GOAL_AUTO = "Follows what is there"

CHIP: dict[str, tuple[str, Rgb]] = {
    "offline": ("Offline", GREY),
    "idle": ("Ready", GREY),
    "learning": ("Learning", BLUE),
    "servoing": ("Moving", TEAL),
    "hold": ("Stopped", ORANGE),
    "done": ("Done", GREEN),
    "fault": ("Fault", RED),
    "estop": ("Emergency stop", RED),
}


DEGRADED = ("Moving at half speed", AMBER)
"""The chip while the arm goes on without a lost tracker."""


def follow_label(kind: str) -> str:
    """What a tracker kind is called; kinds that are new to the page go by their own name."""
    return FOLLOW[kind][0] if kind in FOLLOW else kind


def placing(kind: str, begun: bool) -> str:
    """What to click to place a tracker of a kind; `begun` once one end of a line has been clicked."""
    if kind == "line":
        return "Click the edge's other end." if begun else "Click one end of a straight edge."
    return f"Click in a view to place one. {FOLLOW[kind][1] if kind in FOLLOW else ''}".strip()


def quality(score: float) -> Rgb:
    """Green for a tracker that is sure of its target, over amber, to red."""
    share = 0.0 if score != score else min(max((score - 0.3) / 0.6, 0.0), 1.0)
    low, high, part = (RED, AMBER, 2 * share) if share < 0.5 else (AMBER, GREEN, 2 * share - 1)
    red, green, blue = (round(a + part * (b - a)) for a, b in zip(low, high, strict=True))
    return red, green, blue


def hexed(color: Rgb) -> str:
    return f"#{color[0]:02x}{color[1]:02x}{color[2]:02x}"


def safe(text: object) -> str:
    """Text for HTML and markdown: whatever comes from files and people is escaped."""
    return html.escape(str(text), quote=True)


def kind_of(key: str) -> Kind:
    """The composing kind, or a neutral stand-in for kinds that only files can name."""
    return KIND.get(key) or Kind(key, key.replace("_", " ").capitalize(), TEAL, (), (), "")


def pixels(value: float) -> str:
    """A residual in words: fine where it matters, short where it does not [px]."""
    if value != value:
        return "not seen"
    return f"{value:.2f} px" if abs(value) < 9.995 else f"{value:.0f} px"


def explain(status: Status, trackers: int, constraints: int, progress: str) -> str:
    """The sentence under the state chip: why, and what to do next."""
    if status.message:
        return status.message
    if status.state == "idle":
        if constraints:
            return "The task is complete. Press Start."
        if trackers:
            return "Trackers alone do not move the arm. Add a constraint, such as Point → Point."
        return "Nothing to do yet. Pick a constraint below."
    if status.state == "learning":
        return progress or "The arm makes small moves to learn how the images change."
    if status.state == "servoing":
        return progress or "The arm moves so that the error becomes zero."
    return {
        "hold": "The arm stands still. Press Start to go on.",
        "done": "The task is done.",
        "fault": "Something is wrong. Read the message, then acknowledge it.",
        "estop": "Reset before the next Start.",
        "offline": "The arm and its cameras do not answer.",
    }.get(status.state, "")


_LOGO = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 132 40" height="40">
<g fill="none" stroke="#0d766e" stroke-width="3.4" stroke-linecap="round">
<circle cx="20" cy="20" r="11.5"/><path d="M20 3v9M20 28v9M3 20h9M28 20h9"/></g>
<circle cx="20" cy="20" r="3.4" fill="#dc2626"/>
<text x="46" y="29" font-family="Inter,Segoe UI,Helvetica,Arial,sans-serif" font-size="27"
 font-weight="700" letter-spacing="-0.5" fill="#18202c">vita</text></svg>"""

LOGO = "data:image/svg+xml;base64," + base64.b64encode(_LOGO.encode()).decode()
