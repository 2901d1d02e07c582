"""The last step of a geometry: the result classes of `schemas`, filled once."""

from __future__ import annotations

import numpy as np

from jointstiff.schemas import geometry as results
from jointstiff.schemas.assessment import Assessment, combined
from jointstiff.schemas.robot import JointMap, RobotDocument, UrdfModel
from jointstiff.solver.geometry.frames import CentreEstimate, WristCentre
from jointstiff.solver.geometry.identification import IdentifiedGeometry
from jointstiff.solver.geometry.poses import CalibratedAxes
from jointstiff.solver.messages import message, rows
from jointstiff.solver.robot.model import JointMap as RobotJointMap
from jointstiff.solver.robot.urdf import write_urdf


def to_geometry_result(
    geometry: IdentifiedGeometry, name: str, joint_map: RobotJointMap
) -> results.GeometryResult:
    """Return what was found."""
    identified, wrist = geometry.identified, geometry.wrist
    reasons = [finding for finding in geometry.findings if finding.weight != "use"]
    return message(
        results.GeometryResult,
        geometry,
        assessment=combined([Assessment(verdict=each.weight, reasons=[each]) for each in reasons]),
        poses=identified.evidence if isinstance(identified, CalibratedAxes) else None,
        goodness=message(
            results.GeometryGoodness,
            geometry,
            sigma=identified.sigma,
            variance_factor=identified.variance_factor,
            degrees_of_freedom=identified.dof,
        ),
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
            name=identified.names,
            position=geometry.model.targets_in_flange,
            covariance=geometry.target_covariances,
        ),
        flange=geometry.conventions.flange,
        robot=_robot(geometry, name, joint_map),
        dh=[message(results.IdentifiedDh, table) for table in geometry.tables],
    )


def _wrist(geometry: IdentifiedGeometry, wrist: WristCentre) -> results.WristResult:
    return message(
        results.WristResult,
        wrist,
        estimates=[
            message(results.WristEstimate, way, **_centre(geometry, wrist, way)) for way in wrist.estimates
        ],
        combined=message(results.WristCentre, wrist.combined, **_centre(geometry, wrist, wrist.combined)),
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
