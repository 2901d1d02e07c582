"""Measured points in the report of a coordinate measuring machine, read as a list of points.

These are DMIS output (`FA(P1)=FEAT/POINT,CART,…`, ISO 22093), the text reports of PC-DMIS (`DIM … LOCATION OF
POINT …`), lines such as `P1 X 12.3 Y 4.5 Z 6.7`, and names above lines of X, Y and Z, as of Metrolog. Nominal
values are never read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

from jointstiff.service.importing.errors import ImportFileError, Place, quote

_LEAST_POINTS: Final = 3
_MAX_LINE: Final = 500
"""Characters of a line; a text with a longer line is no report, which bounds the time of the patterns."""
_COMMENT_MARKS: Final = ("#", "//", "%")
_AXES: Final = ("X", "Y", "Z")
_UNITS: Final[Mapping[str, str]] = MappingProxyType(
    {"MM": "mm", "M": "m", "INCH": "in", "IN": "in", "CM": "cm", "FEET": "ft"}
)
_FEATURE: Final = re.compile(
    r"\s*(FA?)\s*\(([^()]{1,64})\)\s*=\s*FEAT\s*/\s*(\w{1,16})\s*,(.{1,400})", re.IGNORECASE
)
_BROKEN_FEATURE: Final = re.compile(r"\s*FA\s*\(|[^$']{0,80}=\s*FEAT\s*/", re.IGNORECASE)
_PLACES: Final = frozenset(("POINT", "SPHERE", "CIRCLE"))
"""Features whose first coordinates are a place."""
_SIDES: Final = frozenset(("INNER", "OUTER"))
_DMIS_UNIT: Final = re.compile(r"\s*UNITS\s*/\s*(\w{1,8})", re.IGNORECASE)
_DIMENSION: Final = re.compile(
    r"\s*DIM\s+\S{1,64}\s*=\s*LOCATION\s+OF\s+(\w{1,16})[\s,]+(\S{1,64}).{0,80}?\bUNITS\s*=\s*(\w{1,8})",
    re.IGNORECASE,
)
_TRIPLE: Final = re.compile(
    r"\s*(\S{1,64}?)[\s,;:]+X\s*[=:]?\s*(\S{1,40}?)[\s,;]+Y\s*[=:]?\s*(\S{1,40}?)[\s,;]+Z\s*[=:]?\s*(\S{1,40}?)[\s,;]*",
    re.IGNORECASE,
)
_DIGIT: Final = re.compile(r"\d")
_AXIS_LINE: Final = re.compile(
    r"\s*([XYZ])[\s:=]+([-+\u2212]?\d[\d.,]{0,30})(?:\s*\[?(mm|cm|m|in|inch)\]?)?\s*", re.IGNORECASE
)
"""A line with the one coordinate of a point along an axis."""
_AXIS_START: Final = re.compile(r"\s*([XYZ])(?:[\s:=]+[-+\u2212.\d]|\s*$)", re.IGNORECASE)
"""A line that begins with an axis and a number."""
_STATED_UNIT: Final = re.compile(
    r"\b(?:units?|unités?|einheit(?:en)?|maßeinheit|unità|unidad(?:es)?)\s{0,9}[:=]?\s{0,9}\[?(mm|cm|m|in|inch)\b",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class ReportedPoint:
    """A measured point as it is written in a report."""

    line: int  #: line of the report, from 1
    name: str
    coordinates: tuple[str, ...]  #: x, y, z


@dataclass(frozen=True)
class PointReport:
    """Measured points of a report."""

    points: tuple[ReportedPoint, ...]  #: in their order
    unit: str | None  #: unit of length; None if the report states none


def read_point_report(file: str, text: str) -> PointReport | None:
    """Return the measured points of a report in their order; None of a text that is no report.

    Raises:
        ImportFileError: a point has no complete coordinates, units differ, or all points are nominal.
    """
    lines = re.split(r"\r\n|\n|\r", text)
    if max(map(len, lines)) > _MAX_LINE:
        return None
    if any(_FEATURE.match(line) for line in lines):
        return _read_dmis(file, lines)
    if any(_DIMENSION.match(line) for line in lines):
        return _read_dimensions(file, lines)
    return _read_triples(file, lines) or _read_named_lines(file, lines)


def _read_dmis(file: str, lines: Sequence[str]) -> PointReport:
    """Return the measured features of DMIS output that are a place."""
    points: list[ReportedPoint] = []
    units: list[str] = []
    for number, line in _join_continued(lines):
        if unit := _DMIS_UNIT.match(line):
            units.append(unit[1].upper())
        feature = _FEATURE.fullmatch(line)
        if feature is None:
            if _BROKEN_FEATURE.match(line):
                raise _unclear_line(file, number, line)
        elif feature[1].upper() == "FA" and feature[3].upper() in _PLACES:
            points.append(_read_feature(file, number, feature))
    if not points:
        reason = "the file has nominal features only (`F`), and no measured point (`FA`)"
        raise ImportFileError(Place(file), reason, "export the measured features")
    return PointReport(tuple(points), _choose_unit(file, units))


def _join_continued(lines: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Yield each statement of DMIS with its line; `$` at its end continues a line, `$$` begins a comment."""
    first, parts = 1, list[str]()
    for number, line in enumerate(lines, 1):
        if line.lstrip().startswith("$$"):
            continue
        if not parts:
            first = number
        text = line.rstrip()
        parts.append(text.removesuffix("$"))
        if not text.endswith("$"):
            yield first, "".join(parts)
            parts = []
    if parts:
        yield first, "".join(parts)


def _read_feature(file: str, line: int, feature: re.Match[str]) -> ReportedPoint:
    """Return the place of a measured feature.

    Raises:
        ImportFileError: the coordinates are not Cartesian, or fewer than three.
    """
    values = [each.strip() for each in feature[4].split(",")]
    if values[0].upper() in _SIDES:
        del values[0]
    if values[0].upper() != "CART" or len(values) <= len(_AXES):
        reason = f"feature {quote(feature[2])} has no Cartesian coordinates x, y, z"
        raise ImportFileError(Place(file, line), reason, "export the features with CART")
    return ReportedPoint(line, feature[2].strip(), tuple(values[1:4]))


def _read_dimensions(file: str, lines: Sequence[str]) -> PointReport:
    """Return the measured places of the dimensions of a PC-DMIS report."""
    points: list[ReportedPoint] = []
    units: list[str] = []
    starts = [(number, found) for number, line in enumerate(lines) if (found := _DIMENSION.match(line))]
    ends = [number for number, _ in starts[1:]] + [len(lines)]
    for (start, found), end in zip(starts, ends, strict=True):
        measured = _find_measured(lines[start + 1 : end])
        if set(measured) >= set(_AXES):
            units.append(found[3].upper())
            name = found[2].rstrip(",")
            points.append(ReportedPoint(start + 1, name, tuple(measured[axis] for axis in _AXES)))
        elif found[1].upper() == "POINT":
            reason = f"point {quote(found[2])} has no measured value (column MEAS) of X, Y and Z"
            raise ImportFileError(Place(file, start + 1), reason, "print X, Y and Z with MEAS")
    if not points:
        raise ImportFileError(Place(file), "no dimension has X, Y and Z", "print the locations of points")
    return PointReport(tuple(points), _choose_unit(file, units))


def _find_measured(lines: Sequence[str]) -> dict[str, str]:
    """Return axis → measured value of a dimension, whose line `AX …` names the columns."""
    measured: dict[str, str] = {}
    column: int | None = None
    for line in lines:
        cells = line.upper().split()
        if cells[:3] == ["END", "OF", "DIMENSION"]:
            break
        if cells[:1] == ["AX"]:
            column = cells.index("MEAS") if "MEAS" in cells else None
        elif column is not None and cells and cells[0] in _AXES and len(cells) > column:
            measured.setdefault(cells[0], cells[column])
    return measured


def _read_triples(file: str, lines: Sequence[str]) -> PointReport | None:
    """Return the points of lines that name X, Y and Z; None if fewer than three lines do.

    Raises:
        ImportFileError: a line among the points is no point.
    """
    found = {
        number: _TRIPLE.fullmatch(line)
        for number, line in enumerate(lines, 1)
        if line.strip() and not line.lstrip().startswith(_COMMENT_MARKS)
    }
    points = [
        ReportedPoint(number, match[1], (match[2], match[3], match[4]))
        for number, match in found.items()
        if match and all(map(_DIGIT.search, match.groups()[1:]))
    ]
    if len(points) < _LEAST_POINTS:
        return None
    between = range(points[0].line, points[-1].line)
    unclear = [number for number in between if number in found and found[number] is None]
    if unclear:
        raise _unclear_line(file, unclear[0], lines[unclear[0] - 1])
    return PointReport(tuple(points), None)


def _read_named_lines(file: str, lines: Sequence[str]) -> PointReport | None:
    """Return the points whose names are above lines of X, Y and Z; None if there are fewer than three.

    Raises:
        ImportFileError: a point lacks a coordinate, or units differ.
    """
    filled = [(number, line) for number, line in enumerate(lines, 1) if line.strip()]
    matches = [_AXIS_LINE.fullmatch(line) for _, line in filled]
    axes = ["" if match is None else match[1].upper() for match in matches]
    points: list[ReportedPoint] = []
    used = set[int]()  # lines of points
    for place in range(1, len(filled) - 2):
        end = place + len(_AXES)
        if axes[place - 1] or tuple(axes[place:end]) != _AXES:
            continue
        number, name = filled[place - 1]
        texts = tuple(match[2] for match in matches[place:end] if match is not None)
        points.append(ReportedPoint(number, name.strip().rstrip(":").strip(), texts))
        used.update(line for line, _ in filled[place - 1 : end])
    if len(points) < _LEAST_POINTS:
        return None
    others = [(number, line) for number, line in filled if number not in used]
    odd = next(((number, line) for number, line in others if _AXIS_START.match(line)), None)
    if odd is not None:
        reason = f"{quote(odd[1].strip())} belongs to no point with a name and one X, Y and Z"
        raise ImportFileError(Place(file, odd[0]), reason, "complete the point, or remove its lines")
    units = [found[1] for _, line in others if (found := _STATED_UNIT.search(line))]
    units += [match[3] for match in matches if match is not None and match[3]]
    return PointReport(_shorten_names(points), _choose_unit(file, [unit.upper() for unit in units]))


def _shorten_names(points: Sequence[ReportedPoint]) -> tuple[ReportedPoint, ...]:
    """Return the points without the first words of their names if all have them, such as `POINT`."""
    words = [point.name.split() for point in points]
    while all(len(each) > 1 for each in words) and len({each[0] for each in words}) == 1:
        words = [each[1:] for each in words]
    return tuple(replace(point, name=" ".join(each)) for point, each in zip(points, words, strict=True))


def _choose_unit(file: str, units: Sequence[str]) -> str | None:
    """Return the unit of a report; None if the report states none.

    Raises:
        ImportFileError: the report states two units, or an unknown one.
    """
    stated = sorted(set(units))
    if len(stated) > 1:
        reason = f"the points have several units: {', '.join(stated)}"
        raise ImportFileError(Place(file), reason, "export all points in one unit")
    if stated and stated[0] not in _UNITS:
        raise ImportFileError(Place(file), f"unknown unit {quote(stated[0])}", "export the points in mm")
    return _UNITS[stated[0]] if stated else None


def _unclear_line(file: str, line: int, text: str) -> ImportFileError:
    """Return the error that a line of a report is no point."""
    reason = f"{quote(text.strip())} is no point of the report"
    return ImportFileError(Place(file, line), reason, "correct or remove the line")
