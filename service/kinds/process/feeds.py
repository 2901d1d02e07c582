"""Feeds of a program: stated by the request, by the table of loads, by the program's text, or by the cut."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from jointstiff.schemas.process import ProcessRequest
from jointstiff.service.conversion.units import LENGTH
from jointstiff.service.kinds.program.path import Visits
from jointstiff.solver.arrays import BoolArray, FloatArray
from robotprograms import Program

APPROACH: Final = 2.0
"""Ratio to the least feed of a program beyond which a move is an approach or a retract."""
_ROUNDING: Final = 1.01
"""Ratio to the feed of the request beyond which a move is an approach or a retract."""
_NUMBER: Final = r"(\d+(?:\.\d*)?|\.\d+)"
_KRL: Final = re.compile(
    rf"(?:\$VEL\.CP\s*=\s*|\bBAS\s*\(\s*#(?:VEL_CP|CP_PARAMS)\s*,\s*){_NUMBER}?", re.IGNORECASE
)
_SPEED_DATA: Final = re.compile(rf"\bspeeddata\s+(\w+)\s*:=\s*\[\s*{_NUMBER}", re.IGNORECASE)
_RAPID_MOVE: Final = re.compile(r",\s*([A-Za-z]\w*)\s*(?:\\V\s*:=\s*([\d.]+)\s*)?(?=[,\\])")
_RAPID_NAME: Final = re.compile(r"v(\d{1,5})", re.IGNORECASE)
_FANUC: Final = re.compile(rf"{_NUMBER}\s*(mm/sec|cm/min|inch/min)", re.IGNORECASE)
_FANUC_UNITS: Final = {"mm/sec": 1e-3, "cm/min": 1e-2 / 60.0, "inch/min": 0.0254 / 60.0}
_UR: Final = re.compile(rf"\bv\s*=\s*{_NUMBER}\s*[,)]")


def find_feeds(program: Program, request: ProcessRequest, visits: Visits) -> FloatArray:
    """Return the feed (v,) with which the tool comes to each visit of a target [m/s]; NaN if unknown.

    The table of loads comes first, then the request, the program and the cut. Moves that the program states
    faster than the request keep the program's feed.
    """
    stated = read_feeds(program)[program.moves.move_of_visit]
    feed = stated.copy()
    if request.feed is not None:
        wanted = LENGTH[request.units.length] * request.feed
        feed = np.where(stated > _ROUNDING * wanted, stated, wanted)
    elif request.cut is not None:
        feed = np.where(np.isnan(stated), request.cut.feed, stated)
    of_table = visits.loads.feed
    if of_table is not None:
        of_visit = of_table[visits.loads.of_visit]
        feed = np.where(np.isnan(of_visit), feed, of_visit)
    return np.where(program.moves.is_visit_of_joint_move, np.nan, feed)


def unload_approaches(program: Program, request: ProcessRequest, visits: Visits) -> tuple[Visits, BoolArray]:
    """Return the visits with approaches and retracts unloaded, and a mask (v,) of these visits.

    Only a load of all moves concerns them: loads by lines, by label, point or length are as stated. An
    approach is a move of the joints, or a line that the program states faster than the feed of the request,
    or than twice its least feed. A target that a cut visits, too, keeps its load.
    """
    load = request.load or request.cut
    is_stated = load is None or load.first_line is not None or load.last_line is not None
    of_joints = program.moves.is_visit_of_joint_move
    none = np.zeros(len(visits.targets), dtype=np.bool_)
    if is_stated or of_joints.all():
        return visits, none
    stated = read_feeds(program)[program.moves.move_of_visit]
    known = stated[~of_joints & (stated > 0.0)]
    most = APPROACH * known.min() if len(known) else np.inf
    if request.feed is not None:
        most = _ROUNDING * LENGTH[request.units.length] * request.feed
    cuts = ~of_joints & ~(stated > most)
    if not cuts.any():
        return visits, none
    is_cut = np.zeros(len(visits.order), dtype=np.bool_)
    is_cut[visits.number[cuts]] = True
    loads = replace(visits.loads, of_visit=np.where(is_cut[visits.number], visits.loads.of_visit, 0))
    loaded = visits.loaded[is_cut[visits.loaded] | request.absolute]
    return replace(visits, loads=loads, loaded=loaded), ~is_cut[visits.number]


def read_feeds(program: Program) -> FloatArray:
    """Return the feed (k,) that a program's text states for each move [m/s]; NaN where it states none."""
    read = _READERS.get(program.format)
    lines = re.split(r"\r\n|\n|\r", program.sources[0].text)
    feeds = dict[int, float]()
    if read is not None:
        feeds = dict(read(lines))
    found = [feeds.get(line, np.nan) for line in program.moves.line.tolist()]
    return np.array([each if each > 0.0 else np.nan for each in found], dtype=np.float64)


def _read_krl(lines: list[str]) -> Iterator[tuple[int, float]]:
    """Yield the feed of each line [m/s]: what `$VEL.CP` or `BAS` set last; NaN for what is no number."""
    feed = np.nan
    for number, line in enumerate(lines, 1):
        for match in _KRL.finditer(line.partition(";")[0]):
            feed = float(match[1]) if match[1] else np.nan
        yield number, feed


def _read_rapid(lines: list[str]) -> Iterator[tuple[int, float]]:
    """Yield the feed of each line that names a speed [m/s]: `v50`, data of the file, or the argument V."""
    data = {name.lower(): float(value) for line in lines for name, value in _SPEED_DATA.findall(line)}
    for number, line in enumerate(lines, 1):
        for name, value in _RAPID_MOVE.findall(line.partition("!")[0]):
            known = _RAPID_NAME.fullmatch(name)
            speed = data.get(name.lower(), float(known[1]) if known else np.nan)
            if value or not np.isnan(speed):
                yield number, 1e-3 * (float(value) if value else speed)
                break


def _read_fanuc(lines: list[str]) -> Iterator[tuple[int, float]]:
    """Yield the feed of each line that states one in units of length [m/s]."""
    for number, line in enumerate(lines, 1):
        if match := _FANUC.search(line):
            yield number, float(match[1]) * _FANUC_UNITS[match[2].lower()]


def _read_ur(lines: list[str]) -> Iterator[tuple[int, float]]:
    """Yield the feed of each line with `v=` [m/s]."""
    for number, line in enumerate(lines, 1):
        if match := _UR.search(line.partition("#")[0]):
            yield number, float(match[1])


_READERS: Final[Mapping[str, Callable[[list[str]], Iterator[tuple[int, float]]]]] = {
    "krl": _read_krl,
    "rapid": _read_rapid,
    "fanuc": _read_fanuc,
    "ur": _read_ur,
}
