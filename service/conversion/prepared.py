"""Robots and measurement sets ready for computation, from their messages."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.measurement import MeasurementSetDocument, Observation, ResolvedFrame
from jointstiff.schemas.robot import DhModel, RobotDocument, UrdfModel
from jointstiff.service.conversion import robots
from jointstiff.service.conversion.frames import in_base, stated_transform, to_resolved
from jointstiff.service.conversion.measurements import to_measurements
from jointstiff.service.conversion.readings import ReadingArrays, content_hash, hash_of
from jointstiff.service.conversion.robots import dh_kinematics, to_bodies
from jointstiff.service.conversion.units import LENGTH
from jointstiff.solver.errors import RequestError, RobotError
from jointstiff.solver.evidence.assessment import Assessment, assess, gross_mistake
from jointstiff.solver.evidence.causes import Screening
from jointstiff.solver.evidence.estimate import Estimate
from jointstiff.solver.evidence.prediction import Prediction
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.integrity import inspect
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.chain import KinematicChain
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.robot.urdf import read_inertials, read_urdf, write_urdf


@dataclass(frozen=True, eq=False)
class PreparedRobot:
    """A robot ready for computation."""

    document: RobotDocument  # the robot as it was understood
    robot: Robot  # the robot
    content_hash: str  # SHA-256 of kinematics and joint map, not of the name


@dataclass(frozen=True, eq=False)
class CheckedSet:
    """A measurement set that was checked and inspected."""

    readings: ReadingArrays  # the readings as they are stored
    measurements: Measurements  # the readings in SI units
    warnings: list[Finding]  # what was noticed
    content_hash: str  # SHA-256 of readings, units and frame, not of the name


@dataclass(frozen=True, eq=False)
class PreparedSet:
    """A measurement set ready for computation, however many runs it gets."""

    robot: Robot  # the robot that was measured
    measurements: Measurements  # the readings in SI units
    warnings: list[Finding]  # what was noticed when the set was checked
    robot_id: str  # id of the stored robot
    content: str  # hash of robot and readings

    def with_loads(self) -> PreparedSet:
        """Return the set, if all of its readings are deflections by loads.

        Raises:
            RequestError: there are positions without a load.
        """
        if self.measurements.unloaded_only is not None:
            raise RequestError(
                "the set has positions without load, which show no deflection",
                where="measurement_set_id",
                remedy="identify it by the robot's own weight: give `weight` in the run",
            )
        return self

    def is_sound(self, estimate: Estimate) -> bool:
        """Return whether no gross mistake shows, behind which tests of smaller effects say nothing."""
        if any(finding.weight == "do_not_use" for finding in self.warnings):
            return False
        return gross_mistake(self.robot, self.measurements, estimate) is None

    def assess(
        self,
        settings: Settings,
        estimate: Estimate,
        prediction: Prediction,
        screening: Screening | None = None,
    ) -> Assessment:
        """Assess an identification of this set by its prediction, with what was noticed in the readings."""
        return assess(self.robot, self.measurements, settings, estimate, prediction, self.warnings, screening)


def prepare_robot(document: RobotDocument) -> PreparedRobot:
    """Understand a robot: of a URDF only the chain from base to flange is kept.

    Raises:
        RobotError: the description cannot be used.
    """
    model = document.model
    if isinstance(model, UrdfModel):
        chain = _chain_of_stranger(model)
        bodies = document.bodies or to_bodies(read_inertials(model.urdf, chain), chain)
        model = model.model_copy(update={"urdf": write_urdf(chain)})
        document = document.model_copy(update={"model": model, "bodies": bodies})
    content = document.model_dump_json(exclude={"name", "bodies"})
    return PreparedRobot(document, build_robot(document), hash_of(content))


def build_robot(document: RobotDocument) -> Robot:
    """Build a robot that was understood before.

    Raises:
        RobotError: the description cannot be used.
    """
    model = document.model
    if isinstance(model, DhModel):
        chain = dh_kinematics(model, document.name)
    else:
        chain = read_urdf(model.urdf, model.base, model.flange)
    return robots.build_robot(chain, document.joint_map, document.bodies or ())


def check_set(
    document: MeasurementSetDocument,
    robot: Robot,
    resolved: ResolvedFrame | None,
    noticed: list[Finding],
) -> CheckedSet:
    """Check a set, and look for the usual mistakes.

    Args:
        document: the set as it was posted.
        robot: the robot that was measured.
        resolved: the transform that its frame stands for; None if all is in R0.
        noticed: findings about that frame.

    Raises:
        MeasurementError: the set cannot be used; with the place and the remedy.
    """
    readings = ReadingArrays.from_observations(document.observations)
    measurements = to_measurements(*in_base(document, readings, resolved), robot)
    findings = list(noticed)
    if measurements.unloaded_only is None:  # without a load there is no deflection to inspect
        findings += inspect(robot, measurements, degrees=document.units.angle == "deg")
    return CheckedSet(readings, measurements, findings, content_hash(document, readings, resolved))


def prepare_set(document: MeasurementSetDocument, robot: PreparedRobot, robot_id: str) -> PreparedSet:
    """Prepare a set without a store.

    Args:
        document: the set, in R0 or in a frame that it states itself.
        robot: the robot that was measured.
        robot_id: any id for it.

    Raises:
        MeasurementError: the set cannot be used; with the place and the remedy.
        RequestError: its frame names a stored geometry.
    """
    frame, resolved = document.frame, None
    if frame is not None:
        if frame.geometry_id is not None:
            raise RequestError(
                f"the geometry '{frame.geometry_id}' cannot be used from a file",
                remedy="give the frame's rotation and translation, or post the set to a service",
                where="frame.geometry_id",
            )
        resolved = to_resolved(stated_transform(frame, LENGTH[document.units.length]))
    checked = check_set(document, robot.robot, resolved, [])
    return PreparedSet(
        robot=robot.robot,
        measurements=checked.measurements,
        warnings=checked.warnings,
        robot_id=robot_id,
        content=hash_of(robot.content_hash, checked.content_hash),
    )


def _chain_of_stranger(model: UrdfModel) -> KinematicChain:
    try:
        return read_urdf(model.urdf, model.base, model.flange)
    except RobotError as error:
        named = error.where in {"base", "flange"}
        place = f"model.{error.where}" if named else f"model.urdf: {error.where or 'document'}"
        raise RobotError(error.reason, remedy=error.remedy, where=place) from error


def without(observations: Sequence[Observation], labels: Collection[str]) -> list[Observation]:
    """Return the observations of a set but for those of some labels.

    Raises:
        RequestError: the set has no observation of such a label, or none remains.
    """
    unknown = set(labels) - {observation.label for observation in observations}
    if unknown:
        raise RequestError(
            f"the set has no observation '{min(unknown)}'",
            where="leave_out",
            remedy="give labels of its observations",
        )
    kept = [observation for observation in observations if observation.label not in labels]
    if not kept:
        raise RequestError("all observations are left out", where="leave_out", remedy="include some of them")
    return kept
