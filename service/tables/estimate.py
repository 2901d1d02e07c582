"""Estimates as people read them: one form for a number and its interval, for all tables, reports and lines.

A number has its interval behind it, such as `3.07 (2.97 … 3.18)`, or in the next column. If the readings
give only a limit, the limit takes the place of the number: `> 3.1`. A number that must not be used is dimmed,
as is its interval. Where a half-width belongs to several numbers, or to a number that is not known yet, it is
written `± 15 %`. Intervals and half-widths have the level of confidence of their table, by default 95 %; a
standard uncertainty is for files and messages, and has no place in a table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from statistics import NormalDist
from typing import Final

from jointstiff.schemas.finding import Verdict
from jointstiff.schemas.robot import Estimate
from jointstiff.service.tables.table import (
    NO_NUMBER,
    Column,
    Line,
    NumberParts,
    Style,
    format_rounded,
)
from jointstiff.solver.text import figure

Ends = tuple[float | None, float | None]
"""Lower and upper end of an interval; None for an end without a limit."""

NO_INTERVAL: Final = "no interval"
"""Text in place of the interval of a number whose uncertainty is unknown."""
NO_LIMIT: Final = "no limit"
"""Text in place of an end of an interval that has none."""
ONE_SIDED: Final = "one-sided"
"""Text in the column of intervals for a number that is a limit."""
NORMAL_95: Final = NormalDist().inv_cdf(0.975)
"""Half-width of a 95 % interval of a normal distribution, in standard uncertainties."""
_AT_AN_END: Final = 0.01
"""Ratio of the distances to both ends below which a number is at an end of its interval."""


@dataclass(frozen=True)
class ShownEstimate:
    """A number with its interval as texts; all cells, lines and reports are made of these."""

    value: str  # number, or a dash
    interval: str = ""  # such as `2.97 … 3.18`, or why there is none; empty without a number
    limit: str = ""  # such as `> 3.1`, if the readings give a limit instead of a number
    unit: str = ""  # unit behind the number; empty if the column states it
    style: Style = ""  # "dim" for a number that must not be used
    relative: float | None = None  # half of the interval relative to the number; None without both ends

    @property
    def value_cell(self) -> Line:
        """Cell of the number, or of the limit in place of the number."""
        return Line(self._with_unit(self.limit or self.value), self.style, self._parts(""))

    @property
    def interval_cell(self) -> Line:
        """Cell of the interval."""
        interval = ONE_SIDED if self.limit else self.interval
        numbers = () if self.limit or not interval else (NumberParts(interval=interval),)
        return Line(interval or NO_NUMBER, self.style, numbers)

    @property
    def cell(self) -> Line:
        """Cell of the number and its interval together, such as `3.07 (2.97 … 3.18)`."""
        if self.limit or not self.interval:
            return self.value_cell
        return Line(
            self._with_unit(f"{self.value} ({self.interval})"), self.style, self._parts(self.interval)
        )

    def _parts(self, interval: str) -> tuple[NumberParts, ...]:
        """Return the number in its parts, with the interval if the cell has it; none without a number."""
        if self.value == NO_NUMBER and not self.limit:
            return ()
        return (NumberParts(self.value, interval, self.limit, self.unit, self.relative),)

    def _with_unit(self, text: str) -> str:
        """Return a text with the unit behind it, if the number has a unit of its own."""
        return f"{text} {self.unit}" if self.unit else text


def show_estimate(
    value: float | None,
    interval: Ends | None,
    scale: float = 1.0,
    *,
    bare: str = ".4g",
    style: Style = "",
    least: float = 0.0,
) -> ShownEstimate:
    """Format a number with its interval, both times a scale, with the digits that the interval supports.

    Args:
        value: the number; None for none.
        interval: its lower and upper end; None if its uncertainty is unknown.
        scale: factor to the unit that is shown.
        bare: format of a number whose interval does not decide the digits.
        style: style of number and interval.
        least: least uncertainty that decides the digits, such as a thousandth of the greatest component.
    """
    if value is None:
        return ShownEstimate(NO_NUMBER, style="dim")
    if interval is None:
        return ShownEstimate(figure(scale * value, bare), NO_INTERVAL, style=style)
    spread = scale * max(_find_spread(value, interval), least)
    ends = [NO_LIMIT if end is None else format_rounded(scale * end, spread, bare) for end in interval]
    shown = format_rounded(scale * value, spread, bare)
    return ShownEstimate(shown, " … ".join(ends), style=style, relative=_find_relative_width(value, interval))


def _find_relative_width(value: float, interval: Ends) -> float | None:
    """Return half of an interval relative to its number; None if an end is open or the number is zero."""
    low, high = interval
    if low is None or high is None or not isfinite(high - low) or not value or not isfinite(value):
        return None
    return abs((high - low) / 2 / value)


def _find_spread(value: float, interval: Ends) -> float:
    """Return the uncertainty that decides the digits: half of the distance to the nearer end; 0 if unknown.

    A number at an end of its interval, such as at a bound, has the digits of the other end.
    """
    ends = [end for end in interval if end is not None and isfinite(end)]
    if not ends or not isfinite(value):
        return 0.0
    near, far = sorted([abs(end - value) for end in (ends[0], ends[-1])])
    return (far if near < _AT_AN_END * far else near) / 2


def model_error_text(is_known: bool) -> str:
    """Return in words whether an interval includes the model error, which may be unknown."""
    return "included" if is_known else "unknown"


def style_for(verdict: Verdict | None) -> Style:
    """Return the style of a result's numbers: dimmed if the result must not be used."""
    return "dim" if verdict == "do_not_use" else ""


def percent_text(number: Estimate) -> str:
    """Format a relative number in %, with its 95 % interval: `-12 % (-14 … -10 %)`."""
    uncertainty = number.standard_uncertainty
    if uncertainty is None:
        return f"{figure(100 * number.value, '.2g')} %"
    half = NORMAL_95 * uncertainty
    shown = show_estimate(number.value, (number.value - half, number.value + half), 100.0)
    return f"{shown.value} % ({shown.interval} %)"


def normal_quantile(confidence: float) -> float:
    """Return the half-width of the interval of a normal distribution, in standard uncertainties."""
    return NormalDist().inv_cdf(0.5 * (1.0 + confidence))


def half_width(uncertainty: float | None, scale: float = 1.0, form: str = ".2g") -> str | None:
    """Format the half-width of the 95 % interval that belongs to a standard uncertainty: `± 15`."""
    return None if uncertainty is None else f"± {figure(NORMAL_95 * scale * uncertainty, form)}"


def width_cell(text: str, relative: float | None = None) -> Line:
    """Return the cell of a half-width, such as `± 15 %`, of a number that is not known yet."""
    return Line(text, numbers=(NumberParts(text, relative=relative),))


def estimate_columns(
    name: str, estimates: Sequence[ShownEstimate], confidence: float, unit: str = ""
) -> list[Column]:
    """Return the column of numbers and the column of their intervals, at a level of confidence."""
    return [
        Column(name, estimates, _show_value, unit),
        Column(f"{100 * confidence:g} % interval", estimates, _show_interval),
    ]


def _show_value(estimate: ShownEstimate) -> Line:
    """Return the cell of a number."""
    return estimate.value_cell


def _show_interval(estimate: ShownEstimate) -> Line:
    """Return the cell of an interval."""
    return estimate.interval_cell


def show_cell(estimate: ShownEstimate) -> Line:
    """Return the cell of a number and its interval together."""
    return estimate.cell
