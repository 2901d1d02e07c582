"""Weighted rows and Gram matrices of each configuration, computed once for all resamples.

A method's least-squares problem on some of the configurations is a sum over them (method.md §5, §6):
with the weighted rows M_i = [A_i d_i] of configuration i and its weight w_i (how often it was drawn),
``Σ w_i M_iᵀ M_i`` holds G = AᵀA, h = Aᵀd and all else that the fit takes from the readings.

Sums over configurations and joints are written without BLAS, which groups them by the size of the matrix
and the number of threads: a resample's numbers must not depend on which others are computed with it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.convex.problem import Bounds
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.estimate import identify
from jointstiff.solver.fitting.method import Method
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.inference.estimate import Estimate
from jointstiff.solver.observability import Excitation
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.block import regressor_blocks
from jointstiff.solver.terms.joints import JOINTS
from jointstiff.solver.terms.term import whitened_rows

TILE_RESIDUALS = 2**17
"""Maximum number of residuals per block, 1 MB: they stay in the cache."""


@dataclass(frozen=True, eq=False)
class StageBlocks:
    """One least-squares problem of a method, configuration by configuration.

    Columns are divided by their norms over the full set, so that no square under- or overflows, and a
    diagonal entry of a sum of `gram` is the share of the full set's information on that column.
    """

    joints: IndexArray  #: (p,) the joints that it estimates
    known: IndexArray  #: (q,) joints that an earlier stage has estimated; their deflection is subtracted
    #: (N, r, p + q + 1) weighted rows [A_joints A_known d]; zeros where a target was not read
    rows: FloatArray
    gram: FloatArray  #: (N, p + q + 1, p + q + 1) Gram matrix of each configuration's rows
    unit: FloatArray  #: (p + q,) unit of the scaled parameters x, ``c = unit · x`` [rad/(N·m)]
    size: float = 1.0  #: norm of the weighted readings d, by which they are divided

    def total(self, weights: FloatArray) -> FloatArray:
        """``Σ_i w_ki gram_i`` (K, p + q + 1, p + q + 1) for the weights (K, N)."""
        upper = np.triu_indices(self.gram.shape[1])
        sums: FloatArray = np.zeros((len(upper[0]), len(weights)))
        for weight, gram in zip(np.ascontiguousarray(weights.T), self.gram[:, *upper], strict=True):
            sums += gram[:, None] * weight
        total: FloatArray = np.empty((len(weights), *self.gram.shape[1:]))
        total[:, *upper] = sums.T
        total[:, upper[1], upper[0]] = sums.T
        return total


@dataclass(frozen=True, eq=False)
class GramBlocks:
    """A method on a measurement set, ready to be fitted to any of its N configurations."""

    parameters: int  #: n, number of joints
    stages: tuple[StageBlocks, ...]  #: stages of the method, in the order in which they are solved
    visible: IndexArray  #: (v,) the joints that leave a trace in the full set
    #: (v, 3, M) regressor of the M readings of all targets in all configurations, axes of R0 [m/(rad/(N·m))];
    #: compensation is judged on these whatever a method fits
    regressor: FloatArray
    deflection: FloatArray  #: (3, M) deflection of the same readings, axes of R0 [m]
    characteristic_length: float | None  #: [m], that of the full set, if the weighting uses one

    def __len__(self) -> int:
        return len(self.stages[0].rows)

    def compensation(self, compliance: FloatArray) -> FloatArray:
        """``1 − mean‖δp − δp̂‖ / mean‖δp‖`` over all readings (method.md §6).

        Args:
            compliance: (K, n) [rad/(N·m)].

        Returns:
            (K,) dimensionless; NaN where a visible joint has no number.
        """
        moved = np.linalg.norm(self.deflection, axis=0).mean()
        left = np.empty(len(compliance))
        step = max(1, TILE_RESIDUALS // self.deflection.size)
        for first in range(0, len(left), step):
            part = compliance[first : first + step, self.visible]
            residual = np.repeat(self.deflection[None], len(part), axis=0)
            for c, column in zip(part.T, self.regressor, strict=True):
                residual -= c[:, None, None] * column
            left[first : first + step] = np.sqrt(np.square(residual).sum(axis=1)).mean(axis=1)
        shares: FloatArray = 1.0 - left / moved
        return shares


def gram_blocks(robot: Robot, measurements: Measurements, settings: Settings) -> GramBlocks:
    """Compute the blocks of a method.

    The full set is identified first: what it cannot support is refused in its words. A characteristic length
    that is to be found, and the compliances at which K_c is taken, are those of the full set for all
    resamples.

    Args:
        robot: n joints.
        measurements: N observations.
        settings: method, weighting and K_c; without K_c its bounds play no part, and its confidence never.

    Raises:
        JointstiffError: as `jointstiff.solver.estimate.identify` does on the full set.
        UnsupportedMethodError: a loss or a model that is not linear in the readings.
    """
    refuse_nonlinear(settings)
    if not settings.complementary_stiffness:
        settings = replace(settings, bounds=Bounds.unconstrained(robot.n))
    return blocks_of_identified(robot, measurements, settings, identify(robot, measurements, settings))


def blocks_of_identified(
    robot: Robot, measurements: Measurements, settings: Settings, estimate: Estimate
) -> GramBlocks:
    """Compute the blocks of a method on a set that was identified by it.

    Args:
        robot: n joints.
        measurements: N observations.
        settings: method, weighting and K_c; all else plays no part.
        estimate: of the full set: its characteristic length, if the weighting uses one, and the compliances
            at which K_c is taken, so that the rows are linear.
    """
    method = Method(robot, settings, estimate.characteristic_length)
    compliance = estimate.compliance if settings.complementary_stiffness else None
    excitation = Excitation(robot.joint_names)
    fitted, regressors, deflections = [], [], []
    for block in regressor_blocks(robot, measurements, compliance):
        excitation.add(block)
        whitened = whitened_rows(block, [JOINTS], estimate.compliance)
        fitted.append([rows.fitted for rows in method.rows(block, whitened)])
        present = block.measurements.present
        regressors.append(block.A[present])
        deflections.append(block.measurements.deflection[present])
    seen = ~excitation.observability().null
    visible = np.flatnonzero(seen)
    stages = (
        _stage(np.concatenate(rows), stage.joints[seen[stage.joints]], stage.known[seen[stage.known]])
        for stage, rows in zip(method.stages, zip(*fitted, strict=True), strict=True)
        if seen[stage.joints].any()
    )
    return GramBlocks(
        parameters=robot.n,
        stages=tuple(stages),
        visible=visible,
        regressor=np.ascontiguousarray(np.concatenate(regressors).transpose(2, 1, 0)[visible]),
        deflection=np.ascontiguousarray(np.concatenate(deflections).T),
        characteristic_length=estimate.characteristic_length,
    )


def refuse_nonlinear(settings: Settings) -> None:
    """Sums over configurations serve every draw only where no draw changes the rows.

    Raises:
        UnsupportedMethodError: a loss or a model that is not linear in the readings.
    """
    if settings.loss != "squared":
        raise UnsupportedMethodError(
            f"resampling supports only the squared loss, not loss {settings.loss}",
            where="resampling",
            remedy="omit `resampling`, or use loss squared and omit the suspicious readings",
        )
    if settings.prior is not None or settings.order:
        raise UnsupportedMethodError(
            "resampling supports neither `priors` nor `stiffness_order`",
            where="resampling",
            remedy="omit `resampling`, or `priors` and `stiffness_order`",
        )


def _stage(rows: FloatArray, joints: IndexArray, known: IndexArray) -> StageBlocks:
    columns = np.concatenate([joints, known])
    chosen = rows[..., [*columns, -1]]
    largest = np.abs(chosen).max(axis=(0, 1))
    # Scaled first: the squares of a column in other units may under- or overflow.
    largest = np.where(largest > 0, largest, 1.0)
    norms = np.sqrt(np.square(chosen / largest).sum(axis=(0, 1))) * largest
    norms = np.where(norms > 0, norms, 1.0)
    scaled = chosen / norms
    gram = np.swapaxes(scaled, 1, 2) @ scaled
    return StageBlocks(joints, known, scaled, gram, norms[-1] / norms[:-1], float(norms[-1]))
