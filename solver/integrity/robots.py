"""Other robots that may have been measured."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Final

from jointstiff.schemas.finding import AdvisedAction, Finding
from jointstiff.solver.integrity.frames import measure_residual
from jointstiff.solver.integrity.places import (
    LARGEST_MODEL_ERROR,
    Places,
)
from jointstiff.solver.integrity.values import View
from jointstiff.solver.meaning.decision import USUAL_RESIDUAL
from jointstiff.solver.mechanics.robot import KnownRobot
from jointstiff.solver.text import length_text

LEAST_ROWS: Final = 4
"""Least number of rows that show a mistake of one state or one target, or another robot."""
_CLEARLY: Final = 0.1
"""Fraction of the rows that another robot must explain beyond those that the chosen robot explains."""
_ALIKE: Final = 1.5
"""Ratio of residuals up to which positions do not distinguish two robots."""


def inspect_other_robots(view: View, others: Iterable[KnownRobot]) -> Iterator[Finding]:
    """Report other robots that explain the positions better than the chosen robot, the best first.

    R0 is fitted, too: a wrong length or zero moves all places by millimetres, in a way that a small turn or
    shift of R0 mostly explains, whereas no such turn makes another arm fit.
    """
    given = view.measurements
    chosen = Places.of(view.robot, given)
    count = len(chosen.near)
    if count < LEAST_ROWS:
        return
    fits = []
    for known in chain(view.robot.list_misreadings(), others):
        if known.robot.joint_kinds == view.robot.joint_kinds:
            found = Places.of(known.robot, given)
            explained = int(found.near.sum())
            explains_more = explained > int(chosen.near.sum()) + _CLEARLY * count
            if found.unexplained <= LARGEST_MODEL_ERROR and explains_more:
                residual = round(measure_residual(known.robot, given, found), 6)
                if residual <= USUAL_RESIDUAL:
                    fits.append((-explained, residual, known, found))
    fits.sort(key=lambda fit: fit[:2])
    for explained, residual, known, found in fits:
        equals = [
            f"'{other.name}'"
            for _, each, other, _ in fits
            if other is not known and max(each, residual) <= _ALIKE * min(each, residual)
        ]
        tie = f"; {' and '.join(equals)} fit{'s' if len(equals) == 1 else ''} as well" if equals else ""
        remedy, action = known.remedy, None
        if not remedy:
            remedy = f"check which robot was measured; if '{known.name}' was measured, choose this robot"
            action = AdvisedAction.of("choose_robot", robot=known.name, robot_id=known.identifier)
        yield view.build_finding(
            "another_robot_fits",
            f"with the robot '{known.name}', the targets keep their places on the flange in {-explained} "
            f"of {count} "
            f"observations, within {length_text(float(found.distances[found.near].max()))}; with the "
            "chosen robot, in "
            f"only {chosen.near.sum()} of {count}, within {length_text(LARGEST_MODEL_ERROR)}{tie}",
            remedy,
            "do_not_use",
            action,
        )
