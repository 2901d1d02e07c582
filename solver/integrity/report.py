"""The findings of all checks: each with a severity, a figure and a remedy, and none mended silently."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import islice
from typing import Final

from jointstiff.solver.finding import Finding
from jointstiff.solver.integrity.drift import inspect_drift
from jointstiff.solver.integrity.places import inspect_places
from jointstiff.solver.integrity.repeats import inspect_repeats
from jointstiff.solver.integrity.response import inspect_response
from jointstiff.solver.integrity.rigidity import inspect_rigidity
from jointstiff.solver.integrity.values import inspect_values
from jointstiff.solver.integrity.view import View
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot

MAX_FINDINGS_PER_CODE: Final = 10
"""Further findings of a kind are counted in its last message."""


def inspect(robot: Robot, measurements: Measurements, *, degrees: bool) -> list[Finding]:
    """Look for the usual mistakes of a day of measurements.

    What a check finds wrong with the whole set ends the search for what follows from it: positions that no
    posture explains say nothing of drift, and angles that are not the robot's nothing of its springs.

    Args:
        robot: n joints.
        measurements: N observations of T targets.
        degrees: whether the angles were posted in degrees.

    Returns:
        The findings, at most `MAX_FINDINGS_PER_CODE` of each kind.
    """
    view = View.of(robot, measurements, degrees=degrees)
    return [finding for check in _checks(view) for finding in _shortened(check)]


def _checks(view: View) -> Iterator[Iterable[Finding]]:
    values = [_shortened(check) for check in inspect_values(view)]
    yield from values
    places = inspect_places(view)
    yield places.findings
    yield inspect_repeats(view)
    if not places.sound:
        return
    yield inspect_rigidity(view, places.good)
    yield inspect_drift(view, places.good)
    if not any(finding.code in _NO_RESPONSE for check in values for finding in check):
        yield inspect_response(view, places.good)


_NO_RESPONSE: Final = frozenset(
    {"angle_unit_suspect", "length_unit_suspect", "deflection_implausibly_large", "sigma_suspect"}
)
"""With these the deflections are not what the springs would make of the load."""


def _shortened(findings: Iterable[Finding]) -> list[Finding]:
    rest = iter(findings)
    shown = list(islice(rest, MAX_FINDINGS_PER_CODE))
    more = sum(1 for _ in rest)
    if more:
        shown[-1] = replace(shown[-1], message=f"{shown[-1].message} (and {more} more of this kind)")
    return shown
