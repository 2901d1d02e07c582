"""Geometries: from what was found to messages, in the tracker's frame and in R0."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jointstiff.schemas.geometry import result as results
from jointstiff.schemas.robot import JointMap, RobotDocument, UrdfModel
from jointstiff.service.conversion.assessments import to_geometry_assessment
from jointstiff.service.conversion.message import message, rows
from jointstiff.solver.geometry.frames.wrist_centre import CentreEstimate, WristCentre
from jointstiff.solver.geometry.identified_geometry import IdentifiedGeometry
from jointstiff.solver.geometry.model.dh_identification import DhTable
from jointstiff.solver.geometry.model.kinematic_calibration import CalibratedAxes
from jointstiff.solver.robot.joint_map import JointMap as RobotJointMap
from jointstiff.solver.robot.urdf import write_urdf


def to_geometry_result(
    geometry: IdentifiedGeometry, name: str, joint_map: RobotJointMap
) -> results.GeometryResult:
    """Return what was found.

    Args:
        geometry: all of it.
        name: of the identified robot.
        joint_map: of the readings.
    """
    joints = geometry.model.chain.joint_names
    identified, wrist = geometry.identified, geometry.wrist
    return message(
        results.GeometryResult,
        geometry,
        assessment=to_geometry_assessment(geometry.findings),
        poses=message(results.PoseEvidence, identified) if isinstance(identified, CalibratedAxes) else None,
        goodness=message(results.GeometryGoodness, geometry, degrees_of_freedom=identified.dof),
        base_frame=message(
            results.BaseFrameResult,
            geometry.base,
            by=geometry.conventions.base,
            covariance=geometry.base_covariance,
        ),
        wrist=_wrist(geometry, wrist) if isinstance(wrist, WristCentre) else None,
        no_wrist=None if isinstance(wrist, WristCentre) else wrist,
        targets=rows(
            results.FlangeTarget,
            name=geometry.model.target_names,
            position=geometry.model.targets_in_flange,
            covariance=geometry.target_covariances,
        ),
        flange=geometry.conventions.flange,
        links=[message(results.LinkComparison, link, joint=joints[link.joint]) for link in geometry.links],
        robot=_robot(geometry, name, joint_map),
        dh=[_table(table, joints) for table in geometry.tables],
    )


def _wrist(geometry: IdentifiedGeometry, wrist: WristCentre) -> results.WristResult:
    return message(
        results.WristResult,
        wrist,
        estimates=[
            message(results.WristEstimate, way, weight=way.share, **_centre(geometry, wrist, way))
            for way in wrist.estimates
        ],
        combined=message(results.WristCentre, wrist.combined, **_centre(geometry, wrist, wrist.combined)),
        distances=wrist.disagreements,
        miss_distance=wrist.miss.distance,
        miss_uncertainty=wrist.miss.standard_uncertainty,
        miss_probability=wrist.miss.probability,
        decoupled_method=wrist.miss.spherical,
    )


def _centre(geometry: IdentifiedGeometry, wrist: WristCentre, estimate: CentreEstimate) -> dict[str, object]:
    centre, covariance = wrist.in_base(estimate, geometry.base, geometry.identified)
    return {
        "tracker": estimate.centre,
        "tracker_covariance": estimate.covariance,
        "base": centre,
        "base_covariance": covariance,
    }


def _robot(geometry: IdentifiedGeometry, name: str, joint_map: RobotJointMap) -> RobotDocument:
    chain = geometry.model.chain
    model = UrdfModel(format="urdf", urdf=write_urdf(chain), base=chain.base, flange=chain.flange)
    matrix, offset = joint_map.matrix, joint_map.offset
    plain = np.array_equal(matrix, np.eye(joint_map.n)) and not offset.any()
    return RobotDocument(name=name, model=model, joint_map=None if plain else message(JointMap, joint_map))


def _table(table: DhTable, joints: Sequence[str]) -> results.IdentifiedDh:
    parallel = [message(results.NearlyParallel, pair, joint=joints[pair.joint]) for pair in table.parallel]
    return message(results.IdentifiedDh, table, parallel=parallel)
