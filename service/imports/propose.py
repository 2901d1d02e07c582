"""The robot proposes the mapping: which columns are joints and targets, in which units, frame and state.

Words never decide. Columns with few words give ways to group the rows (`structure`); for each, the
kinematics of the robot finds joints and positions (`solver.meaning`), and the work of the force finds which
positions are under load (`loads`). The grouping that explains most positions is proposed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.schemas.imports import MAX_COLUMNS, Mapping
from jointstiff.service.imports.layout import Layout
from jointstiff.service.imports.structure import list_structures, stack_forms
from jointstiff.service.imports.tables import Table, transpose
from jointstiff.service.imports.writing import Finding, write_mapping
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning import proposal as meaning
from jointstiff.solver.meaning.budget import Budget, BudgetExceeded
from jointstiff.solver.meaning.table import find_rounding
from jointstiff.solver.mechanics.robot import KnownRobot

MOST_FITS: Final = 300_000
"""Interpretations that are fitted, by all groupings of the rows together: five times what files need."""
MOST_SECONDS: Final = 10.0
"""Processor time of a proposal."""
_FINEST: Final = 1e-6
_COARSE: Final = 50.0
"""Ratio of rounding steps from which positions come from another source than the finest ones."""
_REPEAT: Final = 5e-5
"""Median distance [m] up to which two readings of a target are repeats of one state."""
_GOOD_ENOUGH: Final = 0.98
"""Fraction of the positions that fit from which no further grouping is tried."""
_NO_PROPOSAL: Final = "no proposal within its limit of time: too many columns may be joints or positions"


@dataclass(frozen=True)
class Draft:
    """Mapping that the robot proposes."""

    mapping: Mapping
    sentence: str = ""  #: what the robot says of the positions
    reason: str = ""  #: why there is no proposal, if there is none


def propose(tables: Sequence[Table], robot: KnownRobot, stated: Mapping) -> Draft:
    """Propose the mapping of tables.

    Args:
        tables: tables of files.
        robot: robot that was measured.
        stated: what a person stated: encoders, load point, force.
    """
    budget = Budget(MOST_FITS, MOST_SECONDS)
    search = _Search(robot, budget)
    try:
        best = search.run(tables)
        if best is not None:
            return _write(best, stated, is_turned=False)
        turned = [transpose(table) for table in tables if table.row_count < MAX_COLUMNS]
        best = search.run(turned) if turned else None
    except BudgetExceeded:
        return Draft(stated, reason=_NO_PROPOSAL)
    return Draft(stated, reason=search.reason) if best is None else _write(best, stated, is_turned=True)


def _write(found: Finding, stated: Mapping, *, is_turned: bool) -> Draft:
    """Return the draft of a meaning; `is_turned` tells whether columns of the tables are postures."""
    mapping = write_mapping(found, stated)
    if is_turned:
        parts = [part.model_copy(update={"transpose": True}) for part in mapping.tables]
        mapping = mapping.model_copy(update={"tables": parts})
    return Draft(mapping, found.sentence)


@dataclass
class _Search:
    """Search of the grouping of rows by which the robot explains most positions."""

    robot: KnownRobot
    budget: Budget
    reason: str = "the tables have no rows of postures"  #: why the last grouping had no meaning

    def run(self, tables: Sequence[Table]) -> Finding | None:
        """Return the best meaning of tables; None if no grouping has a meaning.

        Raises:
            BudgetExceeded: nothing was found within the budget.
        """
        best: Finding | None = None
        for structures in list_structures(stack_forms(tables), self.budget):
            layout = Layout.of([structure.pivot() for structure in structures])
            try:
                found = self._judge(layout)
            except BudgetExceeded:
                if best is None:
                    raise
                return best
            if found is not None and (best is None or _rank(found) > _rank(best)):
                best = found
            if best is not None and _is_sound(best) and best.share >= _GOOD_ENOUGH:
                break
        return best

    def _judge(self, layout: Layout) -> Finding | None:
        """Return what the robot makes of tables whose rows are grouped in one way; None without a meaning."""
        if not layout.tables:
            self.reason = "the tables have no columns of numbers"
            return None
        result = meaning.propose(layout.tables, self.robot.robot, self.budget)
        if result.best is None:
            self.reason = result.reason
            return None
        fitting = frozenset(
            (each.points.table, column) for each in result.best.readings for column in each.points.columns
        )
        readings = _leave_out_coarse(result.best.readings, layout)
        proposal = replace(result.best, readings=tuple(_number_states(readings)))
        found = Finding(self.robot, proposal, layout, fitting)
        if not _is_consistent(found):
            self.reason = "rows without names belong to the postures"
            return None
        return found


def _leave_out_coarse(
    readings: Sequence[meaning.TargetReading], layout: Layout
) -> list[meaning.TargetReading]:
    """Return the readings without positions that are rounded coarser than others: nominal ones were typed."""
    steps = []
    for reading in readings:
        numbers = layout.get(reading.points.table).numbers[:, list(reading.points.columns)]
        steps.append(find_rounding(numbers) or _FINEST)
    finest = min(steps)
    return [each for each, step in zip(readings, steps, strict=True) if step < _COARSE * finest]


def _number_states(readings: Sequence[meaning.TargetReading]) -> Iterator[meaning.TargetReading]:
    """Yield readings with the number of their state: repeats of a target are one state."""
    states_of: dict[int, list[FloatArray]] = {}
    for reading in readings:
        states = states_of.setdefault(reading.target, [])
        gaps = [np.nanmedian(np.linalg.norm(reading.positions - earlier, axis=1)) for earlier in states]
        if min(gaps, default=np.inf) > _REPEAT:
            gaps.append(0.0)
            states.append(reading.positions)
        yield replace(reading, state=int(np.argmin(gaps)))


def _is_consistent(found: Finding) -> bool:
    """Return whether rows are grouped either by words or by their order, and triples are of one row.

    Coordinates of a table with a row for each of them are of three rows.
    """
    joints = found.proposal.joints
    for reading in found.proposal.readings:
        sources = found.layout.find_sources(reading.points)
        structure = found.layout.find_pivot(reading).structure
        by_words = bool(structure.keys or structure.label)
        by_order = reading.points.groups.count > 1 or joints.groups.count > 1
        is_one_row = len({source.combo for source in sources}) == 1 or structure.axis is not None
        if (by_order and by_words) or not is_one_row:
            return False
    return True


def _is_sound(found: Finding) -> bool:
    """Return whether each target has equally many states, in two states at least."""
    counts: dict[int, int] = {}
    for reading in found.proposal.readings:
        counts[reading.target] = counts.get(reading.target, 0) + 1
    return len(set(counts.values())) == 1 and min(counts.values()) > 1


def _rank(found: Finding) -> tuple[bool, int, bool]:
    """Return the order of meanings: complete ones first, then those that explain most positions."""
    return _is_sound(found), found.proposal.fitting, not found.proposal.doubt
