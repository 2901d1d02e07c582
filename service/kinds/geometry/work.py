"""A geometry: from the readings of sweeps or poses to axes, frames and a robot, at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import numpy as np

from jointstiff.schemas import geometry as results
from jointstiff.schemas.geometry import GeometryRequest, GeometryResult
from jointstiff.schemas.robot import JointMap, RobotDocument, UrdfModel
from jointstiff.service.conversion.assessments import to_geometry_assessment
from jointstiff.service.conversion.prepared import prepare_robot, to_base_targets
from jointstiff.service.conversion.readings import hash_of
from jointstiff.service.inputs import Inputs
from jointstiff.service.kinds.geometry.readings import to_conventions, to_poses, to_sweeps
from jointstiff.service.kinds.work import QuickWork
from jointstiff.solver.errors import InputError, NotObservableError, RequestError
from jointstiff.solver.geometry.frames import CentreEstimate, WristCentre
from jointstiff.solver.geometry.identification import (
    IdentifiedGeometry,
    identify_from_poses,
    identify_from_sweeps,
)
from jointstiff.solver.geometry.poses import CalibratedAxes, Poses
from jointstiff.solver.geometry.sweeps import SweepSet
from jointstiff.solver.messages import message, rows
from jointstiff.solver.robot.model import JointMap as RobotJointMap
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.robot.urdf import write_urdf


def work(inputs: Inputs, request: GeometryRequest) -> QuickWork:
    """Return the work of a geometry.

    Raises:
        RequestError: there is no such robot, it cannot be used, or the readings contradict themselves or the
            nominal model.
    """
    nominal, robot_hash = None, ""
    if request.robot is not None:
        with as_request_errors("robot"):
            nominal = prepare_robot(request.robot).robot
    elif request.robot_id is not None:
        nominal, robot_hash = inputs.robot(request.robot_id, "robot_id")
    with as_request_errors():
        readings: SweepSet | Poses
        if request.sweeps is None and nominal is not None:
            readings = to_poses(request, nominal)
        else:
            readings = to_sweeps(request, nominal)
    # Names and ids do not count.
    options = request.model_dump_json(exclude={"robot_id": True, "name": True, "robot": {"name"}})
    return QuickWork(
        result=partial(_identify, request, readings, nominal),
        input_hash=hash_of(robot_hash, options),
        robot_id=request.robot_id,
        details={"name": request.name},
    )


@contextmanager
def as_request_errors(section: str | None = None) -> Iterator[None]:
    """Refuse readings that determine no robot, which are not worth storing.

    Args:
        section: of the request, to which places in messages refer.

    Raises:
        RequestError: in place of errors of the input.
    """
    try:
        yield
    except (InputError, NotObservableError) as error:
        where = ".".join(part for part in (section, error.where) if part)
        raise RequestError(error.reason, remedy=error.remedy, where=where or None) from error


def _identify(request: GeometryRequest, readings: SweepSet | Poses, robot: Robot | None) -> GeometryResult:
    nominal = robot.chain if robot is not None else None
    with as_request_errors():
        conventions = to_conventions(request, readings.targets)
        base_targets = to_base_targets(request, readings.sigma)
        if isinstance(readings, SweepSet):
            geometry = identify_from_sweeps(
                readings,
                conventions,
                nominal=nominal,
                name=request.name,
                fit=request.fit,
                angles=request.angles,
                base_targets=base_targets,
            )
        elif nominal is not None:
            geometry = identify_from_poses(
                readings, conventions, nominal=nominal, name=request.name, base_targets=base_targets
            )
        else:
            raise ValueError("poses need a nominal model to calibrate, but the request has none")
        return to_geometry_result(geometry, request.name, readings.joint_map)


def to_geometry_result(
    geometry: IdentifiedGeometry, name: str, joint_map: RobotJointMap
) -> results.GeometryResult:
    """Return what was found."""
    identified, wrist = geometry.identified, geometry.wrist
    return message(
        results.GeometryResult,
        geometry,
        assessment=to_geometry_assessment(geometry.findings),
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
