"""The meaning of tables by the robot: 30 layouts, and tables in which nothing is right."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Iterator
from functools import cache

import numpy as np

from benchmarks.report import Figure, Part, Section
from benchmarks.studies.layouts import LAYOUTS, NOTHING_RIGHT, Layout, Tables, simulate
from jointstiff.service.resources.known_robots import catalogue_robots
from jointstiff.solver.meaning.proposal import Proposal, Proposals, propose
from jointstiff.solver.meaning.table import Table
from jointstiff.solver.mechanics.robot import KnownRobot

__all__ = ["run"]

_SEEDS = 3
_DAMAGED = 200
_FIRST_SEED, _DAMAGED_SEED = 214_000, 224_000
"""No seed was used while a rule was written or mended: another one each time the study is recorded."""
_WHOLE = Part()
_REPORTED = 20
"""Cases between two lines of progress."""
_MIRRORED = frozenset(("exchanged_axes", "kuka_signs"))
"""Layouts that a mirrored arm fits as well."""


def run(*, quick: bool = False, part: Part = _WHOLE) -> Iterator[Section]:
    """Count right, requested, refused and wrong proposals; yield each section once it is measured."""
    robots = _robots()[:2] if quick else _robots()
    seeds = 1 if quick else _SEEDS
    damaged = len(NOTHING_RIGHT) * (1 if quick else _DAMAGED)
    yield _measure_width()
    yield _judge_layouts(robots, seeds, part)
    yield _judge_damaged(robots, damaged, part)


def _report_case(outcome: str, case: str) -> None:
    """Write a case to standard error, so that it can be run again alone."""
    print(f"{outcome}: {case}", file=sys.stderr, flush=True)


def _count(name: str, numbers: range, counts: Counter[str]) -> Iterator[int]:
    """Yield numbers of cases; write counts to standard error, which a run that is cut short leaves."""
    for done, number in enumerate(numbers, 1):
        yield number
        if done % _REPORTED == 0 or done == len(numbers):
            so_far = ", ".join(f"{outcome} {count}" for outcome, count in sorted(counts.items()))
            print(f"{name} {done}/{len(numbers)}: {so_far or 'nothing'}", file=sys.stderr, flush=True)


@cache
def _robots() -> list[KnownRobot]:
    return list(catalogue_robots())


def _tables(tables: Tables) -> list[Table]:
    return [Table(name, numbers) for name, numbers in tables.items()]


def _judge_layouts(robots: list[KnownRobot], seeds: int, part: Part) -> Section:
    cases = [
        (robot, _FIRST_SEED + seed, make) for seed in range(seeds) for robot in robots for make in LAYOUTS
    ]
    counts: Counter[str] = Counter()
    by_layout: dict[str, Counter[str]] = {}
    for number in _count("layouts", part.of(len(cases)), counts):
        known, seed, make = cases[number]
        layout = make(simulate(known.name, seed))
        outcome = judge(layout, propose(_tables(layout.tables), known.robot), known)
        if outcome in ("wrong", "refused"):
            _report_case(outcome, f"{make.__name__}, {known.name}, seed {seed}")
        counts[outcome] += 1
        by_layout.setdefault(make.__name__, Counter())[outcome] += 1
    judged = sum(counts.values())
    plain = [each for name, each in by_layout.items() if name not in _MIRRORED]
    accepted = 100 * sum(each["right"] for each in plain) / max(sum(each.total() for each in plain), 1)
    first = 100 * (counts["right"] + counts["asks"]) / max(judged, 1)
    rows = tuple((name, str(dict(each))) for name, each in by_layout.items())
    figures = (
        Figure.none("wrong meanings of layouts accepted", counts["wrong"]),
        Figure("accepted with Enter, of layouts without a mirror image [%]", accepted, "at least", 90),
        Figure("right one first, of all layouts [%]", first, "at least", 99),
    )
    return Section(f"{judged} files in {len(LAYOUTS)} layouts", ("layout", "outcomes"), rows, figures)


def judge(layout: Layout, proposals: Proposals, known: KnownRobot) -> str:
    """Return whether a proposal is right, asks, is wrong, or is none."""
    proposal = proposals.best
    if proposal is None:
        return "refused"
    twin = layout.twin
    is_right = _is_right(layout, proposal, known)
    is_twin = twin is not None and bool(proposal.doubt) and _is_right(twin, proposal, known)
    if not is_right and not is_twin:
        return "wrong"
    return "asks" if proposal.doubt else "right"


def _is_right(layout: Layout, proposal: Proposal, known: KnownRobot) -> bool:
    joints, own = proposal.joints, known.robot.joint_map.matrix
    counting = own if layout.counting is None else own @ layout.counting
    has_joints = joints.table == next(iter(layout.tables)) and joints.columns == layout.columns
    has_units = joints.unit == layout.unit and proposal.unit == layout.length
    has_points = all(
        reading.points.columns in layout.points.get(reading.points.table, ()) for reading in proposal.readings
    )
    groups = {(reading.points.groups.order, reading.points.groups.count) for reading in proposal.readings}
    has_groups = groups == {(layout.order, layout.count)}
    return (
        has_joints
        and has_units
        and has_points
        and has_groups
        and np.allclose(joints.counting.matrix, counting)
    )


def _judge_damaged(robots: list[KnownRobot], count: int, part: Part) -> Section:
    accepted: Counter[str] = Counter()
    kinds = list(NOTHING_RIGHT)
    for number in _count("tables in which nothing is right, accepted", part.of(count), accepted):
        known, kind = robots[number % len(robots)], kinds[number % len(kinds)]
        tables = NOTHING_RIGHT[kind](simulate(known.name, _DAMAGED_SEED + number))
        if propose(_tables(tables), known.robot).best is not None:
            accepted[kind] += 1
            _report_case("accepted", f"{kind}, {known.name}, seed {_DAMAGED_SEED + number}")
    rows = tuple((kind, str(accepted[kind])) for kind in NOTHING_RIGHT)
    figure = Figure.none("tables without a right meaning accepted", accepted.total())
    return Section(
        f"{len(part.of(count))} tables in which nothing is right", ("kind", "accepted"), rows, (figure,)
    )


def _measure_width() -> Section:
    known = _robots()[4]
    campaign = simulate(known.name, 1, postures=60)
    others = campaign.generator.uniform(-300, 300, (60, 15))
    wide = np.hstack([others, campaign.joints, 1e3 * campaign.unloaded.reshape(60, -1)])
    start = time.process_time()
    propose([Table("a", wide)], known.robot)
    spent = time.process_time() - start
    figure = Figure("60 rows of 30 columns", spent, "at most", 1, "s of processor")
    return Section("width", (), (), (figure,))
