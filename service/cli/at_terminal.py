"""The person at the terminal at the robot: words, questions and answers of `jointstiff measure`."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

import typer

from jointstiff.service.cli import options as cli
from jointstiff.service.library.measure import Person

if TYPE_CHECKING:
    from jointstiff.schemas.live import LiveReading, LiveState
    from jointstiff.schemas.plan import PlannedReading
    from jointstiff.service.library.measure import LiveMeasurement


class AtTerminal(Person):
    """Dialogue with the person at the terminal; all questions and messages go to the standard error."""

    def __init__(self, campaign: LiveMeasurement, *, asks: bool, confirmed: bool) -> None:
        """Begin with a live measurement.

        Args:
            campaign: live measurement of the robot.
            asks: True to ask questions; False to use the default answers of the class `Person`.
            confirmed: True if the user has confirmed beforehand that the lines of the source are read
                correctly; then this is not asked.
        """
        self._campaign, self._asks, self._confirmed = campaign, asks, confirmed
        self._by_itself = bool(getattr(campaign.source, "by_itself", False))

    def confirms(self, profile: str) -> bool:
        """Print how the lines of the source are read; return whether the person says that this is correct."""
        cli.warn(profile)
        if self._confirmed:
            return True
        answer = _choose_answer("did the program read the lines correctly? y or n", {"y", "n"}, at_end="")
        if not answer:  # the standard input has ended
            raise cli.print_failure(
                "nobody confirmed that the lines of the source are read correctly",
                "answer y if the lines are read correctly, or use --yes",
            )
        return answer == "y"

    def on_reading(self, state: LiveState, reading: LiveReading) -> None:
        """Print a reading in one line, why the measurement continues, and why the reading is doubtful."""
        cli.warn(format_reading(state, reading))
        if state.state == "measuring" and state.share is not None and state.share <= 1.0:
            cli.warn(f"  the measurement continues: {state.message}")
        if reading.doubtful:
            cli.warn(f"  {reading.message}")
            for cause in reading.causes:
                cli.warn(f"  {cause}")

    def ready(self, following: PlannedReading, *, loaded: bool) -> Literal["read", "skip", "stop"]:
        """Print posture and force, wait for the person, and return whether to read, skip or stop."""
        if not self._asks or self._by_itself:
            return "read"
        if loaded:
            cli.warn(f"  hang the load: {format_force(following)}")
        else:
            cli.warn(f"\n{following.label}: {format_posture(self._campaign, following)}")
            cli.warn(f"  {format_force(following)}; {following.reason}")
        state = "with the load" if loaded else "without load"
        answer = _choose_answer(
            f"  Enter: read {state}; s: skip this posture; q: end", {"", "s", "q"}, at_end="q"
        )
        decisions: dict[str, Literal["read", "skip", "stop"]] = {"": "read", "s": "skip", "q": "stop"}
        return decisions[answer]

    def doubts(self, reading: LiveReading, *, again: bool) -> Literal["again", "keep"]:
        """Ask whether to read a doubtful reading again or to keep it."""
        if not self._asks:
            return super().doubts(reading, again=again)
        answer = _choose_answer("  r: read this posture again; k: keep the reading", {"r", "k"}, at_end="k")
        return "again" if answer == "r" else "keep"

    def doubts_earlier(self, reading: LiveReading, *, again: bool) -> Literal["withdraw", "keep"]:
        """Ask whether to withdraw or keep an earlier reading that later readings show to be a mistake."""
        if not self._asks:
            return super().doubts_earlier(reading, again=again)
        answer = _choose_answer("  w: withdraw this reading; k: keep this reading", {"w", "k"}, at_end="k")
        return "withdraw" if answer == "w" else "keep"

    def missed(self, error: Exception, *, again: bool) -> Literal["again", "skip", "stop"]:
        """Print why the source gave no reading, and ask whether to try again, skip the posture or stop."""
        cli.warn(f"the source gave no reading: {getattr(error, 'reason', error)}")
        remedy = getattr(error, "remedy", None)
        if remedy:
            cli.warn(f"  remedy: {remedy}")
        if not self._asks:
            return super().missed(error, again=again)
        answer = _choose_answer("  r: try again; s: skip this posture; q: end", {"r", "s", "q"}, at_end="q")
        decisions: dict[str, Literal["again", "skip", "stop"]] = {"r": "again", "s": "skip", "q": "stop"}
        return decisions[answer]


def format_reading(state: LiveState, reading: LiveReading) -> str:
    """Return a line about a reading and about the campaign after this reading.

    The line has the share of the goal, the joint with the greatest relative uncertainty, the p-value of the
    reading, and the number of readings that are still needed.
    """
    parts = [f"{reading.label}:"]
    if state.share is not None:
        parts.append(f"uncertainty {state.share:.2f} times that of the goal,")
    parts += _format_least_certain(state)
    parts += _format_agreement(reading)
    parts.append(_format_needed_readings(state.still_needed))
    return " ".join(parts)


def _format_least_certain(state: LiveState) -> Iterator[str]:
    """Yield the joint with the greatest relative uncertainty, "joint_2 ± 14 %,"; nothing if none is known."""
    relative = {joint.name: joint.relative for joint in state.joints if joint.relative is not None}
    if relative:
        name = max(relative, key=lambda each: relative[each])
        yield f"{name} ± {100.0 * relative[name]:.0f} %,"


def _format_agreement(reading: LiveReading) -> Iterator[str]:
    """Yield how well a reading agrees with its prediction from the earlier readings."""
    if reading.doubtful:
        yield "doubtful,"
    elif reading.p_value is not None:
        yield f"agrees with its prediction (p {reading.p_value:.2g}),"
    if reading.ball_ratio is not None:
        is_near = reading.ball_ratio <= 1.0
        comparison = "as near to its prediction as" if is_near else "further from its prediction than"
        yield f"held-out reading: {comparison} 90 % of good readings,"


def _format_needed_readings(number: int | None) -> str:
    """Return a phrase on how many readings the goal still needs; None for an unknown number."""
    if number is None:
        return "the number of readings still needed is not known"
    return f"about {number} more reading{'s' * (number > 1)}" if number else "goal reached"


def _choose_answer(prompt: str, answers: set[str], at_end: str) -> str:
    """Ask until the typed line is one of `answers`; return the line in lower case, without blanks.

    If the standard input has ended, return `at_end`.
    """
    while True:
        typer.echo(f"{prompt}: ", nl=False, err=True)
        line = sys.stdin.readline()
        answer = line.strip().lower()
        if not line or answer in answers:
            return answer if line else at_end


def format_posture(campaign: LiveMeasurement, planned: PlannedReading) -> str:
    """Return the joint values of a planned reading as text, in degrees and millimetres."""
    parts = []
    for name, kind, value in zip(campaign.joint_names, campaign.joint_kinds, planned.joints, strict=True):
        shown = f"{1e3 * value:.1f} mm" if kind == "prismatic" else f"{math.degrees(value):.2f}°"
        parts.append(f"{name} {shown}")
    return ", ".join(parts)


def format_force(planned: PlannedReading) -> str:
    """Return the force of a planned reading as text: magnitude in N, direction, and number of the anchor."""
    magnitude = math.hypot(*planned.force)
    if not magnitude:
        return "no load"
    anchor = "" if planned.anchor is None else f" to anchor {planned.anchor + 1}"
    direction = ", ".join(
        f"{axis} {part / magnitude:+.2f}" for axis, part in zip("xyz", planned.force, strict=True)
    )
    # Within 0.8 degrees of straight down, the word is easier to read than three components.
    is_down = planned.force[2] < -0.9999 * magnitude
    return f"{magnitude:.0f} N {'down' if is_down else direction}{anchor}"
