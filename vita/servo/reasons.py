"""Every reason for which the servo stops or refuses, with the sentence that people read.

A sentence names the culprit and the next step. The codes are part of the file format
(`expect.reason`).
"""

from __future__ import annotations

from vita.types import State, Status

REASONS: dict[str, tuple[State, str]] = {
    "": ("idle", "Ready."),
    "converged": ("done", "Done: every error is below {tolerance:g} px."),
    "dead_band": (
        "done",
        "As close as this robot can: {error:.1f} px are left and the steps it would need are smaller "
        "than it carries out.",
    ),
    "stopped_by_user": ("hold", "Stopped. Press Start to go on."),
    "tracker_lost": (
        "hold",
        "Lost {culprit}; {why}. Drag the marker back onto its feature (or delete it), then press Start.",
    ),
    "trackers_swapped": (
        "hold",
        "Trackers {culprit} seem to have changed places. Drag each back onto its feature, then press Start.",
    ),
    "rows_lost": (
        "servoing",
        "Lost {culprit}; going on at half speed with the {left} of {rows} error rows that are seen.",
    ),
    "leaving_view": (
        "servoing",
        "{culprit}; going on at half speed. Move the camera so that it sees more of the way.",
    ),
    "rows_back": ("servoing", "Every tracker is back; full speed in a moment."),
    # What the cameras show.
    "camera_lost": (
        "hold",
        "Camera {culprit} sends no usable picture: {why}. It is asked again by itself; press Start when it "
        "is back.",
    ),
    "camera_skew": (
        "hold",
        "The cameras' pictures were taken {ms:.0f} ms apart, so they do not belong together. Press Start "
        "when they are in step again.",
    ),
    "camera_moved": (
        "fault",
        "The {culprit} camera was moved or turned: the picture no longer moves as was learned. Acknowledge, "
        "then Start learns again.",
    ),
    # What the task and the estimate allow.
    "under_constrained": (
        "hold",
        "The task fixes {held} of the {joints} motions that the joints in use can make. Add a constraint, "
        "or take joints out ({culprit}).",
    ),
    "ill_conditioned": (
        "hold",
        "One motion of the arm is hardly seen by the cameras: {culprit}. Move a camera, so that they look "
        "from directions at least 30 degrees apart, then press Start.",
    ),
    "joint_no_effect": (
        "hold",
        "{culprit} has no visible effect on any constraint. Leave it out of the joints in use, or draw a "
        "constraint that it moves.",
    ),
    "near_singular": (
        "hold",
        "The arm has come near a pose in which it cannot move every way that the task needs ({culprit}). "
        "Reset the arm or choose other joints, then press Start.",
    ),
    # What the motion shows.
    "opposite_motion": (
        "fault",
        "The image moves opposite to what was learned ({culprit}). Acknowledge, then Start learns again.",
    ),
    "overshooting": (
        "servoing",
        "The arm was overshooting its goal; the gain is halved and it goes on at half speed.",
    ),
    "weak_motion": (
        "servoing",
        "Going on at half speed: {culprit}, so the arm may be near a singular pose.",
    ),
    "oscillating": (
        "fault",
        "The arm keeps overshooting its goal, also with a lower gain. Acknowledge, lower the gain, and "
        "Start learns again.",
    ),
    # Who drives, and what stands behind the arm.
    "driver_left": (
        "hold",
        "The page that drove the arm is gone, so the arm was stopped. Press Start to go on.",
    ),
    "app_silent": (
        "hold",
        "vita itself stood still for a second (is the machine asleep or very busy?), so the arm was stopped. "
        "Press Start to go on.",
    ),
    "closing": ("hold", "vita is ending, so the arm was stopped."),
    "controller_stopped": (
        "fault",
        "The controller gave no sign of life for {ms:.0f} ms ({culprit}), so the arm was stopped. Restart "
        "builds it anew.",
    ),
    "too_close": (
        "fault",
        "{culprit}; the arm was stopped. Only motion away from it is possible: Acknowledge, then move the "
        "obstacle or reset the arm.",
    ),
    "estop": (
        "estop",
        "Emergency stop ({culprit}). When it is safe, press Reset and confirm; Start is a second act.",
    ),
    "state_corrupt": (
        "estop",
        "The simulation reported joint positions that are not numbers, and was rebuilt at the last good "
        "pose. Press Reset and confirm, then Start.",
    ),
    "stalled": (
        "hold",
        "No more progress at {error:.1f} px; the worst is {culprit}. The constraints may contradict one "
        "another, or the goal is out of reach.",
    ),
    "joint_limit": (
        "hold",
        "{culprit} is at its limit and the goal lies beyond. Widen the limit, or choose other joints or "
        "another goal.",
    ),
    "timeout": ("hold", "Not done after {timeout:g} s; {error:.1f} px are left. Press Start to go on."),
    "no_effect": (
        "hold",
        "The exploratory motions did not move any constraint. Put a moving tracker on the arm, or use "
        "other joints.",
    ),
    "joint_stuck": (
        "hold",
        "{culprit} did not carry out its exploratory motion. Check its limits, or leave it out.",
    ),
    "diverged": (
        "fault",
        "The error was growing ({error:.0f} px, best {best:.0f} px), so the arm was stopped. Acknowledge, "
        "lower the gain, and Start learns again.",
    ),
    "numerical": (
        "fault",
        "Numerical failure in the servo: {culprit}. Acknowledge, then Start learns again.",
    ),
    "gate_fault": ("fault", "The gate stopped the arm: {culprit}."),
    "bad_measurement": ("fault", "The robot reported an impossible joint position. The arm was stopped."),
    "internal_error": ("fault", "Internal error: {culprit}. The arm was stopped; Acknowledge to go on."),
    "images_late": (
        "hold",
        "The images of {late} are late ({ms:.0f} ms), so the arm was stopped. Press Start when they come in "
        "time again.",
    ),
    "rig_offline": ("offline", "The simulation does not answer: {culprit}. Restart it."),
    "frozen_feed": ("hold", "Camera {culprit} stopped sending new images. Press Start when it is back."),
    # The stereo-impedance mode.
    "arrived": ("done", "Done: the tool rests {error:.1f} mm from its goal ({tolerance:g} mm were asked)."),
    "timeout_mm": ("hold", "Not there after {timeout:g} s; {error:.0f} mm are left. Press Start to go on."),
    "cameras_moved": (
        "learning",
        "The cameras were moved. When they stand still, a small motion learns anew where they are.",
    ),
    "target_waiting": (
        "servoing",
        "Waiting, because {culprit}. Clear the view or move the tripod; it goes on by itself.",
    ),
    "target_unseen": (
        "hold",
        "Stopped after waiting {timeout:g} s, because {culprit}. Bring it into view, then press Start.",
    ),
    "depth_blind": (
        "hold",
        "The depth camera {culprit} measures too little of its picture to see people by (is it covered or "
        "dark?). Clear it, then press Start.",
    ),
    "tool_unseen": (
        "hold",
        "Cannot learn where the cameras stand: {culprit}. Move them, then press Start.",
    ),
    "not_calibrated": (
        "hold",
        "The calibration motion did not tell where the cameras stand; {culprit}. Give the arm more room or a "
        "larger calibration motion, then press Start.",
    ),
}


class _Blank(dict[str, object]):
    """Facts that a sentence asks for but nobody gave read as a dash or NaN, never as a crash."""

    _UNSAID = {"culprit": "?", "why": "?", "late": "every camera"}

    def __missing__(self, key: str) -> object:
        return self._UNSAID.get(key, float("nan"))


def status_for(reason: str, **facts: object) -> Status:
    """The state that a reason leads to and its sentence. Raises `KeyError` on an unknown reason."""
    state, sentence = REASONS[reason]
    return Status(state, reason, sentence.format_map(_Blank(facts)))


def outcome_of(status: Status) -> str:
    """The verdict of a run in the words of the scenario file: `converged`, `limited`, `held`,
    `fault` or `timeout`."""
    if status.reason in ("timeout", "timeout_mm"):
        return "timeout"
    if status.state == "done":
        return "limited" if status.reason == "dead_band" else "converged"
    return "fault" if status.state in ("fault", "offline", "estop") else "held"
