"""Stages of a method: least-squares problems solved one after the other, and put together (method.md §4)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.convex.constraints import Constraints
from jointstiff.solver.convex.problem import IdentificationProblem
from jointstiff.solver.convex.solution import Solution, solve
from jointstiff.solver.fitting.fit import Fit, Likelihood, rows_of
from jointstiff.solver.fitting.prior import PriorRows
from jointstiff.solver.observability.combination import Combination
from jointstiff.solver.observability.identifiability import Identifiability, Spectrum, analyse
from jointstiff.solver.regression.regressor import RegressorBlock
from jointstiff.solver.regression.stage_rows import Stage, encoder_readings


@dataclass(frozen=True, eq=False)
class StageFit:
    """One stage solved."""

    joints: IndexArray  #: (p,) joints of its columns
    spectrum: Spectrum  #: spectrum of its rows, with those of the prior
    analysis: Identifiability  #: analysis of its rows, the readings' alone
    undetermined: tuple[Combination, ...]  #: what neither readings nor prior tell apart
    parameters: float  #: how many the readings were asked for
    prior: FloatArray  #: (k,) right-hand side of the prior's rows, which come last
    rhs: FloatArray  #: (m,) right-hand side of the readings' rows
    solution: Solution  #: under the constraints
    tied: BoolArray  #: (p,) whether an order holds it

    @property
    def unconstrained(self) -> FloatArray:
        """(p,) the estimate without constraints; where it is not unique, one of them."""
        return self.unconstrained_given(self.rhs)

    def unconstrained_given(self, rhs: FloatArray) -> FloatArray:
        """(p,) the estimate without constraints had the readings been others (m,)."""
        if not self.solution.constrained and np.array_equal(rhs, self.rhs):
            return self.solution.compliance
        estimate: FloatArray = self.spectrum.inverse @ np.concatenate([rhs, self.prior])
        return estimate


def fit_stage(
    R: FloatArray,
    z: FloatArray,
    joints: IndexArray,
    constraints: Constraints,
    prior: PriorRows | None,
    n: int,
) -> StageFit | None:
    """Solve for the given joints, on which the constraints are; None if there are none."""
    if not len(joints):
        return None
    readings = spectrum = Spectrum(R)
    analysis = analyse(readings, joints, n)
    undetermined, parameters, known = analysis.combinations, float(readings.rank), np.zeros(0)
    if prior is not None:
        rows, known = prior.select(joints)
        spectrum = Spectrum(np.vstack([R, rows]))
        undetermined = analyse(spectrum, joints, n).combinations
        parameters = float(np.sum(spectrum.inverse[:, : len(R)].T * R))
    solution = solve(
        IdentificationProblem(
            spectrum.determined,
            np.concatenate([z, known]),
            constraints.bounds,
            constraints.inequalities,
        )
    )
    tied = np.zeros(len(joints), dtype=np.bool_)
    if solution.tight is not None:
        level = constraints.level(solution.compliance, solution.tight)
        solution = replace(solution, compliance=level)
        tied[np.array(constraints.order)[solution.tight].ravel()] = True
    return StageFit(joints, spectrum, analysis, undetermined, parameters, known, z, solution, tied)


def combined(
    n: int,
    stages: list[StageFit],
    centre: FloatArray,
    covariance: FloatArray,
    rows: FloatArray | None = None,
) -> Fit:
    """The fit of all n joints.

    Args:
        n: number of joints.
        stages: of the method.
        centre: (n,) the unconstrained estimate.
        covariance: (n, n) its covariance.
        rows: (k, p) of the likelihood over all joints of the stages, where the stage's own are.
    """
    compliance, active, tied = np.zeros(n), np.zeros(n, dtype=np.int8), np.zeros(n, dtype=np.bool_)
    for stage in stages:
        tied[stage.joints] = stage.tied
        compliance[stage.joints] = stage.solution.compliance
        active[stage.joints] = stage.solution.active
    joints = np.concatenate([stage.joints for stage in stages]) if stages else np.zeros(0, dtype=np.intp)
    part = covariance[np.ix_(joints, joints)]
    undetermined = tuple(group for stage in stages for group in stage.undetermined)
    if rows is None and undetermined:
        rows = _determined_rows(stages, part)
    return Fit(
        compliance,
        active,
        tied,
        covariance,
        Likelihood(joints, centre[joints], part, rows),
        sum(stage.parameters for stage in stages),
        undetermined,
        tuple(stage.analysis for stage in stages),
        tuple(stage.solution.certificate for stage in stages),
    )


def _determined_rows(stages: list[StageFit], covariance: FloatArray) -> FloatArray:
    """Rows (r, p) of the likelihood where the stages determine r combinations of p compliances only."""
    blocks = [stage.spectrum.seen for stage in stages]
    seen = np.zeros((sum(len(block) for block in blocks), covariance.shape[0]))
    row = column = 0
    for block in blocks:
        seen[row : row + len(block), column : column + block.shape[1]] = block
        row, column = row + len(block), column + block.shape[1]
    return rows_of(seen @ covariance @ seen.T) @ seen


def single_stage_fit(rows: Stage, null: BoolArray, constraints: Constraints, prior: PriorRows | None) -> Fit:
    """The fit of a method of one stage; see `jointstiff.solver.fitting.methods.MethodAccumulator.fit`."""
    n, joints = len(null), np.flatnonzero(~null)
    stage = fit_stage(
        rows.rows.matrix[:, joints], rows.rows.rhs, joints, constraints.select(joints), prior, n
    )
    covariance, centre = np.zeros((n, n)), np.zeros(n)
    if stage is None:
        return combined(n, [], centre, covariance)
    covariance[np.ix_(joints, joints)] = rows.covariance(joints, stage.spectrum.inverse)
    centre[joints] = stage.unconstrained
    own = stage.spectrum.determined if rows.by_covariance else None
    return combined(n, [stage], centre, covariance, own)


def solved(
    stage: Stage,
    moment: FloatArray,
    columns: IndexArray,
    joints: IndexArray,
    prior: PriorRows | None,
) -> FloatArray:
    """(p, k) a stage's estimates of some joints in its columns, the others being known.

    Args:
        stage: with its readings.
        moment: (n, k) AᵀΩ y over all columns, of k sets of other readings y.
        columns: (p,) of the stage.
        joints: (p,) in these columns.
        prior: as in the fit; the other readings change nothing in what it says.
    """
    if not len(columns):
        return np.zeros((0, moment.shape[1]))
    rows = stage.rows.matrix[:, columns]
    inverse = Spectrum(rows if prior is None else np.vstack([rows, prior.select(joints)[0]])).inverse
    solved: FloatArray = inverse @ (inverse.T @ moment[columns])
    return solved


def encoder_moment(stage: Stage, block: RegressorBlock, joints: IndexArray) -> FloatArray:
    """Return the moments of the encoders of the first joints, which are the stage's parameters."""
    readings = encoder_readings(block, joints)
    return stage.moment(None if readings is None else readings.select(joints))
