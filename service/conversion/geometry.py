"""Geometries: from what was found to messages, in the tracker's frame and in R0."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jointstiff.schemas.geometry import result as results
from jointstiff.schemas.robot import JointMap, RobotDocument, UrdfModel
from jointstiff.service.conversion.assessments import to_geometry_assessment
from jointstiff.service.conversion.message import message, rows
from jointstiff.solver.geometry import CalibratedAxes, CentreEstimate, DhTable, Survey, WristCentre
from jointstiff.solver.robot import JointMap as RobotJointMap
from jointstiff.solver.robot import write_urdf


def to_geometry_result(survey: Survey, name: str, joint_map: RobotJointMap) -> results.GeometryResult:
    """Return what was found.

    Args:
        survey: all of it.
        name: of the identified robot.
        joint_map: of the readings.
    """
    joints = survey.model.chain.joint_names
    identified, wrist = survey.identified, survey.wrist
    return message(
        results.GeometryResult,
        survey,
        assessment=to_geometry_assessment(survey.findings),
        poses=message(results.PoseEvidence, identified) if isinstance(identified, CalibratedAxes) else None,
        goodness=message(results.GeometryGoodness, survey, degrees_of_freedom=identified.dof),
        base_frame=message(
            results.BaseFrameResult,
            survey.base,
            by=survey.conventions.base,
            covariance=survey.base_covariance,
        ),
        wrist=_wrist(survey, wrist) if isinstance(wrist, WristCentre) else None,
        no_wrist=None if isinstance(wrist, WristCentre) else wrist,
        targets=rows(
            results.FlangeTarget,
            name=survey.model.target_names,
            position=survey.model.targets_in_flange,
            covariance=survey.target_covariances,
        ),
        flange=survey.conventions.flange,
        links=[message(results.LinkComparison, link, joint=joints[link.joint]) for link in survey.links],
        robot=_robot(survey, name, joint_map),
        dh=[_table(table, joints) for table in survey.tables],
    )


def _wrist(survey: Survey, wrist: WristCentre) -> results.WristResult:
    return message(
        results.WristResult,
        wrist,
        estimates=[
            message(results.WristEstimate, way, weight=way.share, **_centre(survey, wrist, way))
            for way in wrist.estimates
        ],
        combined=message(results.WristCentre, wrist.combined, **_centre(survey, wrist, wrist.combined)),
        distances=wrist.disagreements,
        miss_distance=wrist.miss.distance,
        miss_uncertainty=wrist.miss.standard_uncertainty,
        miss_probability=wrist.miss.probability,
        decoupled_method=wrist.miss.spherical,
    )


def _centre(survey: Survey, wrist: WristCentre, estimate: CentreEstimate) -> dict[str, object]:
    centre, covariance = wrist.in_base(estimate, survey.base, survey.identified)
    return {
        "tracker": estimate.centre,
        "tracker_covariance": estimate.covariance,
        "base": centre,
        "base_covariance": covariance,
    }


def _robot(survey: Survey, name: str, joint_map: RobotJointMap) -> RobotDocument:
    chain = survey.model.chain
    model = UrdfModel(format="urdf", urdf=write_urdf(chain), base=chain.base, flange=chain.flange)
    matrix, offset = joint_map.matrix, joint_map.offset
    plain = np.array_equal(matrix, np.eye(joint_map.n)) and not offset.any()
    return RobotDocument(name=name, model=model, joint_map=None if plain else message(JointMap, joint_map))


def _table(table: DhTable, joints: Sequence[str]) -> results.IdentifiedDh:
    parallel = [message(results.NearlyParallel, pair, joint=joints[pair.joint]) for pair in table.parallel]
    return message(results.IdentifiedDh, table, parallel=parallel)
