"""Files of readings in thirteen habits, as they are and mutated: read to the same numbers, or refused.

A mutation changes delimiters, units, columns, rows, decimal marks or encodings of a file with known content.
So the right reading is known: the same numbers, of fewer observations where rows were removed. Any other
number is a misreading.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.mutations import MUTATIONS, mutated
from benchmarks.report import Figure, Section
from benchmarks.spreadsheets import FACTORS, HABITS, Campaign, Upload, campaign_of
from jointstiff.schemas.imports import ImportOptions
from jointstiff.service.importing.grammar import Kind
from jointstiff.service.importing.reading import SourceFile, Understood, understand_files

__all__ = ["Tally", "outcome", "run", "tallies"]

FILES = 30_000
REAL = Path(__file__).parents[3] / "shared/data/ur10_poses/measurements_iso_cubes.csv"
_TOLERANCE = 1e-9
"""Relative to the largest number of a vector, of conversions between units."""


@dataclass
class Tally:
    """Outcomes of files of one kind."""

    counts: Counter[str] = field(default_factory=Counter)
    misread: list[str] = field(default_factory=list)

    def add(self, outcome: str, name: str) -> None:
        """Count a file."""
        self.counts[outcome] += 1
        if outcome == "misread":
            self.misread.append(name)


def outcome(campaign: Campaign, upload: Upload) -> str:
    """Return `read`, `refused` or `misread` for an upload of a campaign."""
    understood = understand_files(
        [SourceFile(name, content) for name, content in upload.files()],
        ImportOptions.model_validate(upload.options),
    )
    if understood.faults:
        return "refused"
    return "read" if _as_written(campaign, understood) else "misread"


def _as_written(campaign: Campaign, understood: Understood) -> bool:
    units: Mapping[Any, str] = understood.units
    known: dict[Kind, Mapping[str, tuple[float, ...]]] = {"joint": campaign.joints, "force": campaign.force}
    for one in understood.observations:
        for kind, vector in ((kind, one.vector(kind) or ()) for kind in known):
            unit = units["angle" if kind == "joint" else "force"]
            expected = known[kind].get(one.label)
            if kind == "joint" and expected is not None and len(vector) < len(expected):
                expected = expected[: len(vector)]  # the last column was removed: too few for the robot
            if not _same(vector, expected, unit):
                return False
        for target, states in one.points.items():
            # A file without a column of targets has the one that its name tells.
            known_as = campaign.targets[0] if len(campaign.targets) == 1 else target
            for state, point in states.items():
                expected = campaign.points.get((one.label, known_as, state))
                if point.vector is None or not _same(point.vector, expected, units["length"]):
                    return False
    return True


def _same(found: Sequence[float], expected: Sequence[float] | None, unit: str) -> bool:
    if expected is None or len(found) != len(expected):
        return False
    scale = FACTORS.get(unit)
    if scale is None:
        return False
    most = max(map(abs, expected)) or 1.0
    return all(
        abs(one / scale - other) <= _TOLERANCE * most for one, other in zip(found, expected, strict=True)
    )


def tallies(files: int, seed: int = 18) -> tuple[dict[str, Tally], dict[str, Tally]]:
    """Mutate so many uploads, and count outcomes by habit and by kind of the first mutation."""
    generator = random.Random(seed)  # noqa: S311
    by_habit = {name: Tally() for name in HABITS}
    by_kind = {name: Tally() for name in MUTATIONS}
    for index in range(files):
        habit = list(HABITS)[index % len(HABITS)]
        campaign = campaign_of(generator)
        upload, kind, names = mutated(generator, HABITS[habit](campaign))
        found = outcome(campaign, upload)
        by_habit[habit].add(found, f"{index}: {names}")
        by_kind[kind].add(found, f"{index}: {habit}: {names}")
    return by_habit, by_kind


def run(*, quick: bool) -> list[Section]:
    """Read thirteen habits as they are, a real file, and thousands of mutated ones."""
    return [_habits_section(3 if quick else 100), _mutations_section(100 if quick else FILES)]


def _habits_section(campaigns: int) -> Section:
    generator = random.Random(1)  # noqa: S311
    rows, other = [], 0
    for name, habit in HABITS.items():
        counts: Counter[str] = Counter()
        for _ in range(campaigns):
            campaign = campaign_of(generator)
            counts[outcome(campaign, habit(campaign))] += 1
        rows.append((name, *(str(counts[found]) for found in ("read", "refused", "misread"))))
        other += campaigns - counts["read"]
    rows += _real()
    return Section(
        "files of thirteen habits as they are",
        ("habit", "read", "refused", "misread"),
        tuple(rows),
        (Figure("files of thirteen habits that are not read", float(other), "at most", 0.0),),
    )


def _real() -> list[tuple[str, ...]]:
    """Return the outcome of a real file of poses, without options."""
    if not REAL.is_file():
        return []
    faults = understand_files([SourceFile(REAL.name, REAL.read_bytes())]).faults
    reasons = "; ".join(fault.reason for fault in faults)
    return [(f"UR10 poses without options: {len(faults)} faults: {reasons}", "0", "1", "0")]


def _mutations_section(files: int) -> Section:
    by_habit, by_kind = tallies(files)
    rows = [
        (name, *(str(tally.counts[found]) for found in ("read", "refused", "misread")))
        for group in (by_habit, by_kind)
        for name, tally in group.items()
    ]
    misread = [name for tally in by_habit.values() for name in tally.misread]
    return Section(
        f"{files:,} mutated files, by habit and by the first mutation",
        ("", "read", "refused", "misread"),
        tuple(rows),
        (Figure("mutated files misread", float(len(misread)), "at most", 0.0),),
        notes=tuple(misread[:20]),
    )
