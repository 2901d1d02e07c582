"""Screening for what joints alone leave unexplained: load point, forgotten force, links (method.md §7).

Joints are fitted with K_c to the targets' rows, without bounds. One QR of all candidate columns
``[A, load point, constant force, diagonal compliances of the links, d]`` answers every F test. Mistakes come
first: beside columns of links the tests of mistakes accuse clean campaigns of elastic arms, and without
them a load point elsewhere looks like links.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy import special

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.inference.estimate import Estimate
from jointstiff.solver.observability.identifiability import Excitation
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.regression.regressor import RegressorBlock, link_motion, regressor_blocks, whitener
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.robot.rotations import skew

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
_RESOLUTION: Final = 1e-7
"""Residual [m] of a coordinate below which nothing is left to explain."""
_INDEPENDENT: Final = 1e-6
"""Least singular value of unit columns that counts for more than rounding."""
_TOLD_APART: Final = 1e-2
"""Least singular value of a load's unit columns beside the joints': below it is the load's own size."""
_KINDS: Final[tuple[LoadMistakeKind, ...]] = ("load_point", "constant_force")


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
    columns = _Columns.of(robot, block, compliance, estimate.observability.null)
    mistakes: list[LoadMistake] = []
    for kind in _KINDS:
        if columns.p_value(kind) < MISTAKE_LEVEL:
            with suppress(SolverError):  # it leads to loads that no arm balances
                mistakes.append(_followed(robot, part, columns, kind))
    best = min(mistakes, key=lambda each: each.ratio, default=None)
    return Screening(columns.links_p_value(), best)


def _followed(robot: Robot, part: Measurements, columns: _Columns, kind: LoadMistakeKind) -> LoadMistake:
    """Follow a mistake by Gauss-Newton.

    Raises:
        SolverError: the load that it leads to has no balance.
    """
    mistake = LoadMistake(kind, np.zeros(3), columns.p_value(kind), 1.0, np.zeros(robot.n), 1.0)
    as_stated = columns.left()
    for _ in range(_REFITS):
        found, step = columns.step(kind)
        compliance = np.maximum(found, 0.0)
        mistake = replace(mistake, correction=mistake.correction + step, compliance=compliance)
        block = next(regressor_blocks(robot, mistake.corrected(part), compliance))
        seen = Excitation(robot.joint_names)  # a load elsewhere may twist joints that it did not as stated
        seen.add(block)
        columns = _Columns.of(robot, block, compliance, seen.observability().null)
        if np.linalg.norm(step) <= _STEADY * np.linalg.norm(mistake.correction):
            break
    return replace(
        mistake, links_p_value=columns.links_p_value(kind), ratio=columns.left(kind) / max(as_stated, 1e-300)
    )


@dataclass(frozen=True, eq=False)
class _Columns:
    """Triangle of all candidate columns, each of unit length, and of the deflections."""

    triangle: FloatArray  # (K + 1, K + 1) triangle of [A, load point, constant force, links, d]
    length: FloatArray  # (K,) length of the columns before they were scaled; 1 where a column is zero
    joints: BoolArray  # (n,) joints whose columns take part
    rows: int  # coordinates that were read

    @classmethod
    def of(cls, robot: Robot, block: RegressorBlock, compliance: FloatArray, null: BoolArray) -> _Columns:
        part = block.measurements
        torque = np.concatenate(
            [
                # A point that is off by e adds the moment e × F, e along the flange's axes.
                block.configurations.angular_jacobian.transpose(0, 2, 1)
                @ -skew(part.force)
                @ block.configurations.flange_rotation,
                block.load_jacobian.transpose(0, 2, 1),
            ],
            axis=2,
        )
        load = block.jacobian @ (compliance[:, None] * torque)[:, None]
        # Deflections by the diagonal compliances of each joint's link
        moves, wrench, _ = link_motion(robot, block)
        links = np.concatenate(list(moves * wrench[:, :, None, None]), axis=-1)
        rows = np.concatenate([block.A, load, links, part.deflection[..., None]], axis=-1)
        rows = (whitener(part.covariance) @ rows)[part.present].reshape(-1, rows.shape[-1])
        length = np.linalg.norm(rows[:, :-1], axis=0)
        length[length == 0.0] = 1.0
        rows[:, :-1] /= length
        triangle = np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)
        return cls(triangle, length, ~null, int(part.coordinates.sum()))

    def p_value(self, kind: LoadMistakeKind) -> float:
        """Return the p-value of the F test of a mistake beside the joints."""
        return self._test(self._joint_columns, self._load_columns(kind), 3, _TOLD_APART)

    def links_p_value(self, beside: LoadMistakeKind | None = None) -> float:
        """Return the p-value of the F test of links beside the joints, and beside a mistake if given."""
        others = self._joint_columns
        if beside is not None:
            others = np.concatenate([others, self._load_columns(beside)], axis=1)
        n = len(self.joints)
        most = min(_LEADING, (self.rows - n) // 3)
        return self._test(others, self.triangle[:, n + 6 : -1], most, _INDEPENDENT)

    def step(self, kind: LoadMistakeKind) -> tuple[FloatArray, FloatArray]:
        """Fit joints and a mistake together: compliances (n,) [rad/(N·m)], and the mistake's (3,) step."""
        joints, load, d = self._joint_columns, self._load_columns(kind), self.triangle[:, -1]
        known = _basis(joints)
        U, s, Vt = np.linalg.svd(load - known @ (known.T @ load), full_matrices=False)
        distinct = s > _TOLD_APART
        step = Vt[distinct].T @ ((U[:, distinct].T @ d) / s[distinct])
        compliance = np.zeros(len(self.joints))
        compliance[self.joints] = np.linalg.lstsq(joints, d - load @ step, rcond=_INDEPENDENT)[0]
        at = len(compliance) + 3 * _KINDS.index(kind)
        return compliance / self.length[: len(compliance)], step / self.length[at : at + 3]

    def left(self, kind: LoadMistakeKind | None = None) -> float:
        """Return the residual sum of squares of joints, and of a mistake if given, together [m²]."""
        load = self.triangle[:, :0] if kind is None else self._load_columns(kind)
        both = _basis(np.concatenate([self._joint_columns, load], axis=1))
        d = self.triangle[:, -1]
        return float(d @ d - np.square(both.T @ d).sum())

    @property
    def _joint_columns(self) -> FloatArray:
        return self.triangle[:, : len(self.joints)][:, self.joints]

    def _load_columns(self, kind: LoadMistakeKind) -> FloatArray:
        at = len(self.joints) + 3 * _KINDS.index(kind)
        return self.triangle[:, at : at + 3]

    def _test(self, others: FloatArray, tested: FloatArray, most: int, least: float) -> float:
        """F test of at most so many leading combinations of columns beside others."""
        known = _basis(others)
        rest = tested - known @ (known.T @ tested)
        d = self.triangle[:, -1] - known @ (known.T @ self.triangle[:, -1])
        leading = _basis(rest, least)[:, :most]
        freedom = self.rows - known.shape[1] - leading.shape[1]
        if not leading.shape[1] or freedom < 1:
            return 1.0
        explained = float(np.square(leading.T @ d).sum())
        left = max(float(d @ d) - explained, 0.0) + freedom * _RESOLUTION**2
        return float(
            special.fdtrc(leading.shape[1], freedom, explained / leading.shape[1] / (left / freedom))
        )


def _basis(columns: FloatArray, least: float = _INDEPENDENT) -> FloatArray:
    """Orthonormal basis of what columns tell by more than the least singular value, largest first."""
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(U[:, s > least])
