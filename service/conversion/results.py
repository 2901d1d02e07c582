"""Results: from estimate and prediction to messages."""

from __future__ import annotations

from math import isfinite

import numpy as np

from schemas import run as runs
from schemas.measurement_set import SetWarning
from service.conversion.readings import ReadingArrays
from solver.estimate import Estimate, JointCompliance
from solver.identifiability import Identifiability
from solver.measurements import Measurements
from solver.prediction import Prediction

__all__ = ["to_result"]


def to_result(
    estimate: Estimate,
    prediction: Prediction,
    measurements: Measurements,
    readings: ReadingArrays,
    warnings: list[SetWarning],
) -> runs.RunResult:
    """The numbers of a run, with residuals by observation and target."""
    return runs.RunResult(
        joints=[_joint(joint) for joint in estimate.joints],
        compensation=prediction.compensation,
        rms_residual=prediction.rms_residual,
        sigma=estimate.sigma,
        goodness=runs.Goodness(
            chi_square=estimate.chi_square,
            degrees_of_freedom=estimate.degrees_of_freedom,
            sigma_source="given" if estimate.sigma_given else "residuals",
        ),
        identifiability=[_identifiability(analysis, estimate) for analysis in estimate.identifiability],
        certificate=[
            runs.Certificate(
                primal=certificate.primal,
                dual=certificate.dual,
                complementarity=certificate.complementarity,
                solved_by=certificate.solved_by,
            )
            for certificate in estimate.certificates
        ],
        characteristic_length=estimate.characteristic_length,
        residuals=_residuals(prediction, measurements, readings),
        warnings=warnings,
    )


def _joint(joint: JointCompliance) -> runs.JointResult:
    return runs.JointResult(
        name=joint.name,
        status=joint.status,
        compliance=joint.compliance,
        stiffness=_stiffness(joint.compliance),
        standard_uncertainty=joint.standard_uncertainty,
        compliance_interval=joint.interval,
        stiffness_interval=_stiffness_interval(joint.interval),
        reason=joint.reason,
    )


def _stiffness(compliance: float | None) -> float | None:
    """1 / c; None for a rigid joint and for numbers whose inverse overflows."""
    if not compliance:
        return None
    stiffness = 1.0 / compliance
    return stiffness if isfinite(stiffness) else None


def _stiffness_interval(interval: tuple[float, float] | None) -> tuple[float, float | None] | None:
    """[1/c_hi, 1/c_lo], open above where the compliance reaches zero.

    An interval of compliances that are all negative, or that spans zero downwards, is no interval of
    stiffness: it has no least stiffness.
    """
    if interval is None or interval[0] < 0 or interval[1] <= 0:
        return None
    return 1.0 / interval[1], _stiffness(interval[0])


def _identifiability(analysis: Identifiability, estimate: Estimate) -> runs.Identifiability:
    names = [joint.name for joint in estimate.joints]
    condition = analysis.condition_number
    return runs.Identifiability(
        parameters=analysis.parameters,
        rank=analysis.rank,
        condition_number=condition if isfinite(condition) else None,
        singular_values=analysis.singular_values.tolist(),
        combinations=[[names[j] for j in group.joints] for group in analysis.combinations],
    )


def _residuals(
    prediction: Prediction, measurements: Measurements, readings: ReadingArrays
) -> list[runs.Residual]:
    labels, targets = readings.labels.tolist(), readings.targets.tolist()
    rows, columns = np.nonzero(measurements.present)
    place = rows, columns
    return [
        runs.Residual(
            observation=labels[i],
            target=targets[t],
            deflection=tuple(deflection),
            predicted=tuple(predicted),
            residual=tuple(residual),
        )
        for i, t, deflection, predicted, residual in zip(
            rows.tolist(),
            columns.tolist(),
            measurements.deflection[place].tolist(),
            prediction.predicted[place].tolist(),
            prediction.residual[place].tolist(),
            strict=True,
        )
    ]
