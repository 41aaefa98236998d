"""The servo's self-knowledge as small gauges: a bar, a figure and a word each. Pure, without viser.

A longer bar is always better, so that the block can be read at a glance. The bounds between good, fair
and bad are those of the sentences (`vita.servo.insight.words`), so that the two never disagree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from vita.servo.estimators.base import RIGID_RANK
from vita.servo.insight import (
    GOOD_AGREEMENT,
    GOOD_CONDITION,
    KNOWN_BADLY,
    KNOWN_WELL,
    POOR_AGREEMENT,
    POOR_CONDITION,
    Insight,
    Level,
)
from vita.ui.words import AMBER, GREEN, GREY, RED, Rgb, hexed, safe

LEVEL_COLOR: dict[Level, Rgb] = {"good": GREEN, "info": GREY, "warning": AMBER, "bad": RED}

WORST_CONDITION = 1000.0
STRONG_PX_RAD, WEAK_PX_RAD = 60.0, 15.0
LEAST_PX_RAD, MOST_PX_RAD = 3.0, 300.0
"""At 15 px/rad a milliradian, a usual arm's accuracy, moves the images no more than tracker noise does."""
LEAST_BAR = 0.04
"""A bar is never quite empty: that would look as if there were none."""


@dataclass(frozen=True)
class Gauge:
    name: str
    value: str
    """The figure with its unit."""
    share: float
    """Length of the bar, 0 to 1."""
    level: Level
    word: str
    """What to think of it."""
    hint: str
    """What the figure means, for people who have never met it."""


def gauges(insight: Insight) -> tuple[Gauge, ...]:
    return (_held(insight), _condition(insight), _weakest(insight), _known(insight), _agreement(insight))


def _held(insight: Insight) -> Gauge:
    held, joints = insight.held, insight.joints
    # A rigid hand has six degrees of freedom: of seven joints no task can hold more than six.
    most = min(joints, RIGID_RANK)
    level: Level = "bad" if held == 0 else "good" if held >= most else "info"
    word = "nothing" if held == 0 else "all" if held >= joints else f"{joints - held} free"
    if most <= held < joints:
        word = "whole pose"
    hint = (
        "Directions of joint motion that the task holds. A free one is not wrong, but nothing decides it. "
        "Six hold the whole pose of the hand, so that seven joints have one to spare."
    )
    return Gauge("Held motions", f"{held} of {joints}", held / max(most, 1), level, word, hint)


def _condition(insight: Insight) -> Gauge:
    value, hint = insight.condition, (
        "Condition number: how much more the image shows of the best seen motion than of the worst. "
        "1 is ideal; other camera places or a further constraint lower it."
    )
    if not math.isfinite(value) or insight.held == 0:
        return Gauge("Condition", "–", 0.0, "bad" if insight.held else "info", "singular", hint)
    share = 1.0 - _between(math.log(max(value, 1.0)), 0.0, math.log(WORST_CONDITION))
    level, word = _judge(-value, -GOOD_CONDITION, -POOR_CONDITION, ("good", "fair", "poor"))
    return Gauge("Condition", _figure(value), share, level, word, hint)


def _weakest(insight: Insight) -> Gauge:
    value = insight.weakest
    hint = "How far the images move per radian of the motion that they show worst (smallest singular value)."
    if insight.weak_joint:
        hint += f" It is mostly a motion of {insight.weak_joint}."
    if not math.isfinite(value) or value <= 0.0 or insight.held == 0:
        return Gauge("Weakest", "–", 0.0, "bad" if insight.held else "info", "not seen", hint)
    share = _between(math.log(value), math.log(LEAST_PX_RAD), math.log(MOST_PX_RAD))
    level, word = _judge(value, STRONG_PX_RAD, WEAK_PX_RAD, ("clear", "faint", "hardly seen"))
    return Gauge("Weakest", f"{_figure(value)} px/rad", share, level, word, hint)


def _known(insight: Insight) -> Gauge:
    value = insight.uncertainty
    hint = "Standard deviation of the estimated Jacobian, relative to its size: how far off it may be."
    if not math.isfinite(value):
        return Gauge("Uncertainty", "–", 0.0, "info", "not known", hint)
    level, word = _judge(-value, -KNOWN_WELL, -KNOWN_BADLY, ("sure", "rough", "a guess"))
    percent = f"{100 * value:.1f} %" if value < 0.0995 else f"{100 * min(value, 9.99):.0f} %"
    return Gauge("Uncertainty", f"±{percent}", 1.0 - min(max(value, 0.0), 1.0), level, word, hint)


def _agreement(insight: Insight) -> Gauge:
    value, hint = insight.agreement, (
        "How well the last motion did what the Jacobian predicted; 100 % is exactly. "
        "Near the goal the motions are so small that noise decides."
    )
    if insight.weak_constraint:
        hint += f" {insight.weak_constraint} agrees least."
    if not math.isfinite(value):
        return Gauge("Prediction", "–", 0.0, "info", "no motion yet", hint)
    level, word = _judge(value, GOOD_AGREEMENT, POOR_AGREEMENT, ("as predicted", "partly", "off"))
    if insight.near and level != "good":
        level, word = "info", "only noise"
    return Gauge("Prediction", f"{100 * value:.0f} %", value, level, word, hint)


def _judge(value: float, good: float, bad: float, words: tuple[str, str, str]) -> tuple[Level, str]:
    """The level and the word for a figure of which more is better."""
    if value >= good:
        return "good", words[0]
    return ("warning", words[1]) if value >= bad else ("bad", words[2])


def _figure(value: float) -> str:
    """Three digits, or all in front of the point; what is beyond all sense is cut short."""
    if value < 999.5:
        return f"{value:.3g}" if value >= 0.1 else "<0.1"
    return f"{value:.0f}" if value < 99999.5 else ">99999"


def _between(value: float, low: float, high: float) -> float:
    return min(max((value - low) / (high - low), 0.0), 1.0)


def bars(shown: tuple[Gauge, ...]) -> str:
    """The gauges as HTML, one row each; all words are escaped."""
    rows = []
    for gauge in shown:
        color, share = hexed(LEVEL_COLOR[gauge.level]), max(min(gauge.share, 1.0), LEAST_BAR)
        # A word beside every colour: not everybody tells green from amber.
        rows.append(
            f'<div class="gauge" title="{safe(gauge.hint)}"><span>{safe(gauge.name)}</span>'
            f'<span class="track"><i style="width:{100 * share:.0f}%;background:{color}"></i></span>'
            f'<b class="num">{safe(gauge.value)}</b>'
            f'<span class="word" style="color:{color}">{safe(gauge.word)}</span></div>'
        )
    return f'<div class="gauges">{"".join(rows)}</div>'
