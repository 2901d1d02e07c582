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
from jointstiff.solver.fitting.methods import displacement_readings
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.identification import identify, spherical_wrist
from jointstiff.solver.inference.estimate import Estimate
from jointstiff.solver.observability.identifiability import Excitation
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.regression.pose import fit_displacement
from jointstiff.solver.regression.regressor import RegressorBlock, regressor_blocks
from jointstiff.solver.regression.stage_rows import encoder_readings, target_readings, wrist_centre_readings
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.robot.wrist import WRIST_JOINTS

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
        JointstiffError: as `jointstiff.solver.identification.identify` does on the full set.
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
    length = estimate.characteristic_length
    compliance = estimate.compliance if settings.complementary_stiffness else None
    excitation = Excitation(robot.joint_names)
    weighted, regressors, deflections = [], [], []
    for block in regressor_blocks(robot, measurements, compliance):
        excitation.add(block)
        weighted.append(_weighted_rows(robot, settings, length, block))
        present = block.measurements.present
        regressors.append(block.A[present])
        deflections.append(block.measurements.deflection[present])
    visible = np.flatnonzero(~excitation.observability().null)
    rows = [np.concatenate([of_block[s] for of_block in weighted]) for s in range(len(weighted[0]))]
    return GramBlocks(
        parameters=robot.n,
        stages=_stages(rows, visible, robot.n - WRIST_JOINTS),
        visible=visible,
        regressor=np.ascontiguousarray(np.concatenate(regressors).transpose(2, 1, 0)[visible]),
        deflection=np.ascontiguousarray(np.concatenate(deflections).T),
        characteristic_length=length,
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


def _weighted_rows(
    robot: Robot, settings: Settings, length: float | None, block: RegressorBlock
) -> list[FloatArray]:
    """(B, r, n + 1) rows for each stage, weighted as `jointstiff.solver.fitting.methods` does.

    After those of a stage come the rows of the encoders of its joints.
    """
    uniform, joints = settings.weighting == "uniform", np.arange(robot.n)
    equal = np.ones(3) if uniform else None
    if settings.method == "partial_pose":
        stages = [(target_readings(block), equal, joints)]
    elif settings.method == "complete_pose":
        length = 1.0 if uniform else length
        weight = None if length is None else np.repeat([1.0 / length, 1.0], 3)
        stages = [(displacement_readings(block), weight, joints)]
    else:
        centre, *_ = wrist_centre_readings(block, fit_displacement(block), spherical_wrist(robot).centre)
        arm, wrist = joints[:-WRIST_JOINTS], joints[-WRIST_JOINTS:]
        stages = [(centre, equal, arm), (target_readings(block), equal, wrist)]
    parts = []
    for readings, root_weight, own in stages:
        rows = readings.whitened() if root_weight is None else readings.weighted(root_weight)
        rows = rows.reshape(len(block.torque), -1, rows.shape[-1])
        encoders = encoder_readings(block, own)
        parts.append(rows if encoders is None else np.concatenate([rows, encoders.whitened()], axis=1))
    return parts


def _stages(rows: list[FloatArray], visible: IndexArray, arm_joints: int) -> tuple[StageBlocks, ...]:
    """One stage for all joints, or two: the arm from the wrist centre, then the wrist from the targets."""
    if len(rows) == 1:
        return (_stage(rows[0], visible, visible[:0]),)
    arm, wrist = visible[visible < arm_joints], visible[visible >= arm_joints]
    stages = ((rows[0], arm, arm[:0]), (rows[1], wrist, arm))
    return tuple(_stage(of_stage, joints, known) for of_stage, joints, known in stages if len(joints))


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
