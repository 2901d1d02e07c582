"""When and at which temperature readings were taken, as far as their files say it for certain."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta, timezone
from typing import Final, Literal

from jointstiff.schemas.importing import DecimalMark
from jointstiff.service.importing.errors import Fault, shown
from jointstiff.service.importing.numbers import read_number

_YEARS: Final = range(1980, 2201)
_STAMP: Final = re.compile(
    r"(?P<first>\d{1,4})(?P<mark>[-./])(?P<second>\d{1,2})(?P=mark)(?P<third>\d{1,4})[ T,]+"
    r"(?P<hours>\d{1,2}):(?P<minutes>\d{2})(?::(?P<seconds>\d{2}(?:[.,]\d+)?))?"
    r"(?: ?(?P<half>[AP])\.?M\.?)?(?: ?(?P<zone>Z|(?P<sign>[+-])(?P<east>\d{2}):?(?P<more>\d{2})))?",
    re.IGNORECASE,
)
"""A date and a time of day."""


@dataclass
class Surroundings:
    """Times and temperatures of all points of all files."""

    times: list[datetime] = field(default_factory=list)
    temperatures: dict[str, list[float]] = field(default_factory=dict)  # by unit as it is written
    # texts that are no times or temperatures for certain
    unclear: dict[Literal["times", "temperatures"], list[str]] = field(default_factory=dict)
    rounded: int = 0  # expanded uncertainties of 0

    def add_times(self, rows: Sequence[Sequence[str]]) -> None:
        """Note the times of one file: a cell of each row, or one for the date and one for the time.

        `5/11/2026` is the day of the month that the other rows tell, or none.
        """
        texts = [text for row in rows if (text := _joined(row))]
        matches = [_STAMP.fullmatch(text) for text in texts]
        day_first = {match["mark"]: True for match in matches if match and match["mark"] == "."}
        for match in matches:
            if match and match["mark"] != "." and len(match["first"]) < 3:
                late = int(match["first"]) > 12, int(match["second"]) > 12
                if late[0] != late[1] and day_first.setdefault(match["mark"], late[0]) != late[0]:
                    day_first[match["mark"]] = True  # days and months are mixed: one of them is refused
        for text, match in zip(texts, matches, strict=True):
            time = None if match is None else _time_of(match, day_first.get(match["mark"]))
            if time is None:
                self.unclear.setdefault("times", []).append(text)
            else:
                self.times.append(time)

    def add_temperature(self, text: str, unit: str, mark: DecimalMark) -> None:
        """Note a temperature."""
        try:
            self.temperatures.setdefault(unit, []).append(read_number(text, mark))
        except Fault:
            if any(map(str.isdigit, text)):
                self.unclear.setdefault("temperatures", []).append(text)

    @property
    def measured_at(self) -> datetime | None:
        """Time of the first reading, without a zone as UTC; None if one of the times is not clear."""
        return None if "times" in self.unclear else min(self.times, default=None)

    @property
    def conditions(self) -> str | None:
        """Range of the temperature in each unit, in words."""
        ranges = []
        for unit, values in self.temperatures.items():
            if values:
                low, high = min(values), max(values)
                ranges.append(f"{low:g}{f' to {high:g}' if high > low else ''} {unit}".strip())
        return f"temperature {', '.join(ranges)}" if ranges else None

    @property
    def notes(self) -> list[str]:
        """Account of what was taken from the files, in words."""
        notes = []
        if self.measured_at is not None:
            time = self.measured_at.isoformat(" ", "seconds")
            notes.append(f"time of the measurement, of the first reading, UTC if it names no zone: {time}")
        if self.conditions is not None:
            notes.append(f"conditions of the measurement: {self.conditions}")
        for kind, texts in self.unclear.items():
            field_ = {"times": "measured_at", "temperatures": "conditions"}[kind]
            notes.append(
                f"{kind} were not understood and not used, such as {shown(texts[0])} ({len(texts)} rows): "
                f"give them with `{field_}`"
            )
        if self.rounded:
            notes.append(f"U(95) of 0 is rounded to 1 µm, and was read as 0.5 µm ({self.rounded} cells)")
        return notes


def _joined(cells: Sequence[str]) -> str:
    """Return the first of some cells that has a date and a time, else all of them with the date first."""
    texts = [text for cell in cells if any(map(str.isdigit, text := cell.strip("' ")))]
    whole = (text for text in texts if _STAMP.fullmatch(text))
    return next(whole, " ".join(sorted(texts, key=lambda text: ":" in text)))


def _time_of(match: re.Match[str], day_first: bool | None) -> datetime | None:
    """Return the time; None if there is no such time, or if day and month may be exchanged."""
    year, month, day = int(match["first"]), int(match["second"]), int(match["third"])
    if len(match["first"]) < 3:
        year, day = day, year
        if day_first is None and day != month:
            return None
        if day_first is False:
            day, month = month, day
    hours, seconds = int(match["hours"]), float((match["seconds"] or "0").replace(",", "."))
    if match["half"]:
        if not 1 <= hours <= 12:
            return None
        hours = hours % 12 + 12 * (match["half"].upper() == "P")
    east = timedelta(hours=int(match["east"] or 0), minutes=int(match["more"] or 0))
    try:
        zone = timezone(-east if match["sign"] == "-" else east)
        time = datetime(year, month, day, hours, int(match["minutes"]), tzinfo=zone)
    except ValueError:
        return None
    return time + timedelta(seconds=round(seconds, 6)) if year in _YEARS and seconds < 60.0 else None
