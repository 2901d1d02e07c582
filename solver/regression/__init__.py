"""Regressors: linear maps from joint compliances to what is read."""

from __future__ import annotations

from jointstiff.solver.regression.characteristic_length import least_condition_length
from jointstiff.solver.regression.complementary_stiffness import (
    ComplementaryStiffness,
    LargestStiffness,
    neglected_readings,
    wrench_stiffness,
)
from jointstiff.solver.regression.compression import Compression
from jointstiff.solver.regression.pose import fit_displacement, refuse_unless_posed, skew
from jointstiff.solver.regression.regressor import (
    BLOCK_LENGTH,
    RegressorBlock,
    joint_torque,
    regressor_blocks,
    unloaded_block,
    whitener,
)
from jointstiff.solver.regression.stage_rows import (
    DerivedReadings,
    Stage,
    encoder_readings,
    pose_readings,
    target_readings,
    wrist_centre_readings,
)
from jointstiff.solver.regression.target_rows import TargetRows

__all__ = [
    "BLOCK_LENGTH",
    "ComplementaryStiffness",
    "Compression",
    "DerivedReadings",
    "LargestStiffness",
    "RegressorBlock",
    "Stage",
    "TargetRows",
    "encoder_readings",
    "fit_displacement",
    "joint_torque",
    "least_condition_length",
    "neglected_readings",
    "pose_readings",
    "refuse_unless_posed",
    "regressor_blocks",
    "skew",
    "target_readings",
    "unloaded_block",
    "whitener",
    "wrench_stiffness",
    "wrist_centre_readings",
]
