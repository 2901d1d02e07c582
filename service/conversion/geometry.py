"""Geometries: from what was found to messages, in the tracker's frame and in R0."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal

import numpy as np

from jointstiff.schemas.fields import Point
from jointstiff.schemas.geometry import result as results
from jointstiff.schemas.robot import DhRow, JointMap, RobotDocument, UrdfModel
from jointstiff.service.conversion.geometry_evidence import to_goodness, to_pose_evidence, to_sweep_evidence
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.geometry import (
    Axis,
    BaseDrift,
    CentreEstimate,
    DhTable,
    GeometryFinding,
    IdentifiedAxes,
    LinkParameter,
    RigidTransform,
    Survey,
    WristCentre,
)
from jointstiff.solver.geometry import Geometry as Quantity
from jointstiff.solver.robot import WRIST_TOLERANCE
from jointstiff.solver.robot import JointMap as RobotJointMap

__all__ = ["rigid_message", "to_geometry_result"]

Severity = Literal["error", "warning", "note"]

_SEVERITIES: Final[dict[str, Severity]] = {
    "tracker_bumped": "error",
    "angle_scale_suspect": "error",
    "residuals_below_sigma": "note",
    "axes_nearly_parallel": "note",
}
"""Of findings that are not warnings."""


def to_geometry_result(
    survey: Survey, name: str, joint_map: RobotJointMap, base_targets: Sequence[str]
) -> results.GeometryResult:
    """What was found.

    Args:
        survey: all of it.
        name: of the identified robot.
        joint_map: of the readings.
        base_targets: names of those that were read twice.
    """
    joints = survey.model.chain.joint_names
    wrist = survey.wrist
    return results.GeometryResult(
        axes=_axes(survey),
        sweeps=to_sweep_evidence(survey, joints),
        poses=to_pose_evidence(survey.identified),
        goodness=to_goodness(survey),
        base_frame=_base_frame(survey),
        wrist=_wrist(survey, wrist) if isinstance(wrist, WristCentre) else None,
        no_wrist=None if isinstance(wrist, WristCentre) else wrist,
        targets=_targets(survey),
        flange=survey.conventions.flange,
        links=[_link(row, joints) for row in survey.links],
        robot=_robot(survey, name, joint_map),
        dh=[_table(table, joints) for table in survey.tables],
        drift=_drift(survey.drift, base_targets) if survey.drift is not None else None,
        findings=[_finding(finding, base_targets) for finding in survey.findings],
    )


def rigid_message(transform: RigidTransform) -> results.Rigid:
    """A transform without its covariance."""
    return results.Rigid(rotation=_square(transform.rotation), translation=_point(transform.translation))


def _axes(survey: Survey) -> list[results.IdentifiedAxis]:
    identified, base = survey.identified, survey.base
    T = base.transform_tracker_to_base
    names = survey.model.chain.joint_names
    here = identified.axes
    there = tuple(axis.moved(T.rotation, T.translation) for axis in here)

    def in_tracker(axes: Sequence[Axis], _: FloatArray) -> FloatArray:
        return _places(axes, here)

    def in_base(axes: Sequence[Axis], _: FloatArray) -> FloatArray:
        placed = base.place(axes)
        return _places([axis.moved(placed.rotation, placed.translation) for axis in axes], there)

    tracker, in_r0 = _determined(identified, in_tracker), _determined(identified, in_base)
    out = []
    for i, name in enumerate(names):
        place, based = _axis(here[i], tracker[i]), _axis(there[i], in_r0[i])
        blocks = [tracker[i][:3, :3], tracker[i][3:, 3:]]
        spreads = [_greatest(block) for block in blocks]
        out.append(
            results.IdentifiedAxis(
                name=name,
                tracker=place,
                base=based,
                position_uncertainty=spreads[0],
                direction_uncertainty=spreads[1],
            )
        )
    return out


def _places(axes: Sequence[Axis], reference: Sequence[Axis]) -> FloatArray:
    """Where each axis passes, nearest to the reference's point, and its direction: (6 n,)."""
    parts = [
        np.concatenate([axis.at(axis.foot(other.point)), axis.direction])
        for axis, other in zip(axes, reference, strict=True)
    ]
    return np.concatenate(parts)


def _determined(identified: IdentifiedAxes, geometry: Quantity) -> list[FloatArray]:
    """Covariances (6, 6) by axis; NaN in the blocks that the readings do not determine."""
    J = identified.jacobian_of(geometry)
    hidden = np.isinf(identified.standard_uncertainties(J))
    C = J @ identified.covariance @ J.T
    out = []
    for i in range(identified.n):
        rows = slice(6 * i, 6 * i + 6)
        block, lost = C[rows, rows].copy(), hidden[rows]
        for part in (slice(0, 3), slice(3, 6)):
            if lost[part].any():
                block[part, part] = np.nan
        out.append(block)
    return out


def _greatest(covariance: FloatArray) -> float | None:
    if np.isnan(covariance).any():
        return None
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))


def _axis(axis: Axis, covariance: FloatArray) -> results.AxisPlace:
    return results.AxisPlace(
        point=_point(axis.point),
        direction=_point(axis.direction),
        point_covariance=_known(covariance[:3, :3]),
        direction_covariance=_known(covariance[3:, 3:]),
    )


def _base_frame(survey: Survey) -> results.BaseFrameResult:
    T = survey.base.transform_tracker_to_base
    known = np.isfinite(survey.identified.standard_uncertainties(survey.base.jacobian)).all()
    return results.BaseFrameResult(
        by=survey.conventions.base,
        transform_tracker_to_base=rigid_message(T),
        covariance=T.covariance.tolist() if known else None,
    )


def _wrist(survey: Survey, wrist: WristCentre) -> results.WristResult:
    return results.WristResult(
        estimates=[
            results.WristEstimate(
                way=estimate.way,
                weight=float(np.trace(estimate.weight) / 3.0),
                **dict(_centre(survey, wrist, estimate)),
            )
            for estimate in wrist.estimates
        ],
        combined=_centre(survey, wrist, wrist.combined),
        distances=[
            results.WristDistance(
                first=pair.first,
                second=pair.second,
                distance=pair.distance,
                probability=pair.probability,
            )
            for pair in wrist.disagreements
        ],
        posture=wrist.posture.tolist(),
        miss_distance=wrist.miss.distance,
        miss_uncertainty=wrist.miss.standard_uncertainty,
        miss_probability=wrist.miss.probability,
        decoupled_method=wrist.miss.distance <= WRIST_TOLERANCE,
    )


def _centre(survey: Survey, wrist: WristCentre, estimate: CentreEstimate) -> results.WristCentre:
    centre, covariance = wrist.in_base(estimate, survey.base, survey.identified)
    return results.WristCentre(
        tracker=_point(estimate.centre),
        tracker_covariance=_square(estimate.covariance),
        base=_point(centre),
        base_covariance=_square(covariance),
    )


def _targets(survey: Survey) -> list[results.FlangeTarget]:
    model = survey.model
    known = survey.targets_determined
    return [
        results.FlangeTarget(
            name=name,
            position=_point(model.targets_in_flange[t]),
            covariance=_square(model.targets_covariance[3 * t : 3 * t + 3, 3 * t : 3 * t + 3])
            if known[t]
            else None,
        )
        for t, name in enumerate(model.target_names)
    ]


def _link(row: LinkParameter, joints: Sequence[str]) -> results.LinkComparison:
    uncertainty = row.standard_uncertainty
    return results.LinkComparison(
        quantity=row.quantity,
        joint=joints[row.joint],
        unit=row.unit,
        nominal=row.nominal,
        identified=row.identified,
        difference=row.difference,
        standard_uncertainty=uncertainty if np.isfinite(uncertainty) else None,
    )


def _robot(survey: Survey, name: str, joint_map: RobotJointMap) -> RobotDocument:
    chain = survey.model.chain
    model = UrdfModel(format="urdf", urdf=chain.to_urdf(), base=chain.base, flange=chain.flange)
    matrix, offset = joint_map.matrix, joint_map.offset
    if np.array_equal(matrix, np.eye(joint_map.n)) and not offset.any():
        return RobotDocument(name=name, model=model)
    return RobotDocument(
        name=name, model=model, joint_map=JointMap(matrix=matrix.tolist(), offset=offset.tolist())
    )


def _table(table: DhTable, joints: Sequence[str]) -> results.IdentifiedDh:
    return results.IdentifiedDh(
        convention=table.convention,
        rows=[
            DhRow(a=row.a, alpha=row.alpha, d=row.d, theta=row.theta, lower=row.lower, upper=row.upper)
            for row in table.rows
        ],
        base=rigid_message(table.base),
        tool=rigid_message(table.tool),
        parallel=[
            results.NearlyParallel(joint=joints[p.joint], angle=p.angle, made_parallel=p.made_parallel)
            for p in table.parallel
        ],
        deviation=table.deviation,
    )


def _drift(drift: BaseDrift, names: Sequence[str]) -> results.Drift:
    return results.Drift(
        transform_after_to_before=rigid_message(drift.transform_after_to_before),
        displacement=_point(drift.displacement),
        displacement_covariance=_square(drift.displacement_covariance),
        rotation=_point(drift.rotation),
        probability=drift.probability,
        deformation_probability=drift.deformation_probability,
        significant=drift.significant,
        moved_targets=[names[index] for index in drift.moved_targets],
    )


def _finding(finding: GeometryFinding, base_targets: Sequence[str]) -> results.GeometryFinding:
    where = finding.where
    for index, name in enumerate(base_targets):
        where = where.replace(f"base_targets[{index}]", f"base_targets.after.{name}")
    return results.GeometryFinding(
        code=finding.code,
        severity=_SEVERITIES.get(finding.code, "warning"),
        where=where,
        figure=finding.figure,
        unit=finding.unit,
        message=finding.message,
        remedy=finding.remedy,
    )


def _point(vector: FloatArray) -> Point:
    x, y, z = vector.tolist()
    return x, y, z


def _square(matrix: FloatArray) -> tuple[Point, Point, Point]:
    x, y, z = (_point(row) for row in matrix)
    return x, y, z


def _known(matrix: FloatArray) -> tuple[Point, Point, Point] | None:
    return None if np.isnan(matrix).any() else _square(matrix)
