"""Corrections of the data, tried from simple to rich: one score judges which change makes them agree.

A score is what is left unexplained: how far targets are from their places on the flange (`places`), or the
share of the deflections that no springs explain (`response`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final, Protocol, TypeVar

from jointstiff.schemas.finding import AdvisedAction, FindingCode, Unit
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot

BETTER: Final = 0.5
"""Ratio of what is unexplained after a correction to that before, below which it is an explanation."""
LEAST_ROWS_OF_MANY: Final = 5
"""Least number of rows that show one of many mistakes: an order, or another counting of the joints."""
ALIKE: Final = 1.3
"""Ratio of what two corrections leave unexplained up to which the simpler one counts."""


@dataclass(frozen=True, eq=False)
class Correction:
    """Measurements after the correction of an assumed mistake, and the mistake in words."""

    code: FindingCode
    corrected: Measurements
    cause: str  # the mistake; empty if the change says it
    change: str  # what was tried, after "with"
    remedy: str
    action: AdvisedAction | None = None
    limit: float = BETTER
    may_reverse: bool = True  # whether loads of the opposite sign may be a further mistake
    robot: Robot | None = None  # robot that was measured instead
    units: tuple[Unit, ...] = ()  # true units of the numbers, which a set can declare


class Score(Protocol):
    """Score of a set after a correction."""

    @property
    def unexplained(self) -> float:
        """Error that is left unexplained; infinite if the correction makes no sense."""


S = TypeVar("S", bound=Score)


def explain(
    given: S,
    groups: Iterable[Iterable[Correction]],
    score: Callable[[Correction], S],
    plausible: float,
    rounding: float,
) -> tuple[Correction, S] | None:
    """Return the simplest correction that leaves about as little unexplained as the best; None without one.

    Args:
        given: score of the set as given.
        groups: corrections, the simplest first; a group is tried only if none before has an explanation.
        score: judges the set after a correction.
        plausible: greatest unexplained error of a right set.
        rounding: difference of unexplained errors that tells nothing.
    """
    for group in groups:
        tried = [(each, score(each)) for each in group]
        least = min((found.unexplained for _, found in tried), default=0.0)
        alike = max(ALIKE * least, least + rounding)
        for each, found in tried:
            most = min(each.limit * given.unexplained, plausible, alike)
            if found.unexplained <= most and found.unexplained < given.unexplained:
                return each, found
    return None
