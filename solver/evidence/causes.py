"""Causes of what joints alone leave unexplained: load point, forgotten force, links (method.md §7).

Joints are fitted with K_c to the targets' rows, without bounds. One triangle of all terms in question answers
every F test. Mistakes come first: beside columns of links the tests of mistakes accuse clean campaigns of
elastic arms, and without them a load point elsewhere looks like links. A tracker or base that moved between
the unloaded and the loaded readings looks like a constant force: the Bayesian information criterion compares
the two.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.evidence.estimate import Estimate
from jointstiff.solver.fitting.observability import Excitation
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.block import RegressorBlock, regressor_blocks
from jointstiff.solver.terms.joints import JOINTS
from jointstiff.solver.terms.links import DIAGONAL_LINKS
from jointstiff.solver.terms.load import CONSTANT_FORCE, LOAD_POINT
from jointstiff.solver.terms.places import MOVEMENT
from jointstiff.solver.terms.term import whitened_rows
from jointstiff.solver.triangle import INDEPENDENT, Triangle

LoadMistakeKind = Literal["load_point", "constant_force"]

MISTAKE_LEVEL: Final = 1e-5
"""p-value below which a load point elsewhere, or a constant force beside the load, is a mistake."""
LINKS_LEVEL: Final = 3e-3
"""p-value below which links are worth a cross-validation."""
CLEAR_GAIN: Final = 2.0
"""Gain in paired standard errors above which joints alone do not fit."""
_REFITS: Final = 4
"""Largest number of Gauss-Newton steps towards a load point or a force."""
_STEADY: Final = 1e-3
"""Relative step at which they end."""
_LEADING: Final = 12
"""Number of combinations of link compliances that are tested: those that deflect most."""
_OBSERVATIONS: Final = 500
"""Number of observations that suffice for the tests."""
_AS_WELL: Final = 6.0
"""Difference of the information criterion below which neither of two causes is preferred."""
_KINDS: Final[tuple[LoadMistakeKind, ...]] = ("load_point", "constant_force")
_TERMS: Final = (JOINTS, LOAD_POINT, CONSTANT_FORCE, DIAGONAL_LINKS, MOVEMENT)


@dataclass(frozen=True, eq=False)
class LoadMistake:
    """A load that explains the readings far better than the load as stated."""

    kind: LoadMistakeKind  #: kind of mistake
    #: (3,) correction: of every load point, flange frame [m]; or to every force, axes of R0 [N]
    correction: FloatArray
    p_value: float  #: p value of its F test
    links_p_value: float  #: p-value of the F test of links beside it
    compliance: FloatArray  #: (n,) compliance of the joints once it is corrected [rad/(N·m)]
    ratio: float  #: sum of squared residuals once it is corrected, over that of the load as stated
    #: whether one movement of all loaded readings would explain the readings as well as this constant force
    movement_as_well: bool = False

    @property
    def proved(self) -> bool:
        """Return True if nothing is left for links to explain once it is corrected."""
        return self.links_p_value >= LINKS_LEVEL

    def corrected(self, measurements: Measurements) -> Measurements:
        """Return the measurements with the load that the readings show."""
        if self.kind == "load_point":
            return replace(measurements, load_point=measurements.load_point + self.correction)
        return replace(measurements, force=measurements.force + self.correction)


@dataclass(frozen=True)
class HeldOutGain:
    """Verdict of cross-validation on the best model beside joints alone, on held-out postures."""

    model: str  #: model of least error
    error: float  #: mean norm of its residuals [m]
    error_of_joints: float  #: the same of joints alone [m]
    standard_error: float  #: standard error of the difference, paired by posture [m]

    @property
    def significant(self) -> bool:
        """Return True if the difference exceeds two of its standard errors."""
        return self.error_of_joints - self.error > CLEAR_GAIN * self.standard_error


@dataclass(frozen=True, eq=False)
class Screening:
    """Outcome of the tests."""

    links_p_value: float  #: of the test of links, the load as stated; 1 where the readings cannot tell
    mistake: LoadMistake | None  #: the mistake in the load that explains most; None where none is significant
    gain: HeldOutGain | None = None  #: gain of the cross-validation; None where none was run
    comparable: bool = True  #: whether the options allow for comparing joints alone with elastic links

    @property
    def lack_of_fit(self) -> bool:
        """Return True if links explain the readings better: on held-out postures, if these were compared."""
        if self.gain is None:
            return self.links_speak and self.links_p_value < MISTAKE_LEVEL
        return self.links_speak and self.gain.significant

    @property
    def links_speak(self) -> bool:
        """Return True if links are worth a cross-validation: no proved mistake in the load explains them."""
        if self.mistake is not None and self.mistake.proved:
            return False
        return self.links_p_value < LINKS_LEVEL


def screen_estimate(robot: Robot, measurements: Measurements, estimate: Estimate) -> Screening:
    """Test what an identification of joints alone leaves unexplained; encoders take no part.

    Without a balance under the load, or without residual freedom, no test is significant.
    """
    part, compliance = measurements.evenly(_OBSERVATIONS), np.maximum(estimate.compliance, 0.0)
    try:
        block = next(regressor_blocks(robot, part, compliance))
    except SolverError:  # no balance: other reasons say so
        return Screening(1.0, None)
    triangle = _triangle(block, compliance, estimate.observability.null)
    mistakes: list[LoadMistake] = []
    for kind in _KINDS:
        if triangle.p_value(kind) < MISTAKE_LEVEL:
            with suppress(SolverError):  # it leads to loads that no arm balances
                mistakes.append(_followed(robot, part, triangle, kind))
    best = min(mistakes, key=lambda each: each.ratio, default=None)
    if best is not None and best.kind == "constant_force":
        # A movement of all loaded readings, with three unknowns more, may explain them as well.
        left = max(triangle.residual_squares([JOINTS.name, MOVEMENT.name]), 1e-300)
        left_by_force = max(best.ratio * triangle.residual_squares([JOINTS.name]), 1e-300)
        difference = triangle.rows * np.log(left / left_by_force) + 3 * np.log(triangle.rows)
        best = replace(best, movement_as_well=bool(difference < _AS_WELL))
    return Screening(_links_p_value(triangle, robot.n), best)


def _triangle(block: RegressorBlock, compliance: FloatArray, null: BoolArray) -> Triangle:
    """Return the triangle of the targets' rows of all terms in question, without joints that are not seen."""
    rows = whitened_rows(block, _TERMS, compliance)
    triangle = Triangle(**rows.widths)
    triangle.add(rows.targets, count=int(block.measurements.coordinates.sum()))
    triangle.span[JOINTS.name] = np.flatnonzero(~null)
    return triangle


def _links_p_value(triangle: Triangle, n: int, beside: tuple[str, ...] = ()) -> float:
    """Return the p-value of the F test of links beside the joints, and beside other terms."""
    most = max(0, min(_LEADING, (triangle.rows - n) // 3))
    return triangle.p_value(DIAGONAL_LINKS.name, (JOINTS.name, *beside), most=most, least=INDEPENDENT)


def _followed(robot: Robot, part: Measurements, triangle: Triangle, kind: LoadMistakeKind) -> LoadMistake:
    """Follow a mistake by Gauss-Newton.

    Raises:
        SolverError: the load that it leads to has no balance.
    """
    mistake = LoadMistake(kind, np.zeros(3), triangle.p_value(kind), 1.0, np.zeros(robot.n), 1.0)
    as_stated = triangle.residual_squares([JOINTS.name])
    for _ in range(_REFITS):
        compliance = np.zeros(robot.n)
        compliance[triangle.span[JOINTS.name]], step = triangle.fit_beside_joints(kind)
        compliance = np.maximum(compliance, 0.0)
        mistake = replace(mistake, correction=mistake.correction + step, compliance=compliance)
        block = next(regressor_blocks(robot, mistake.corrected(part), compliance))
        seen = Excitation(robot.joint_names)  # a load elsewhere may twist joints that it did not as stated
        seen.add(block)
        triangle = _triangle(block, compliance, seen.observability().null)
        if np.linalg.norm(step) <= _STEADY * np.linalg.norm(mistake.correction):
            break
    left = triangle.residual_squares([JOINTS.name, kind])
    return replace(
        mistake,
        links_p_value=_links_p_value(triangle, robot.n, (kind,)),
        ratio=left / max(as_stated, 1e-300),
    )
