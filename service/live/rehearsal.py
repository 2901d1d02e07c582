"""Rehearsals: the readings of a campaign simulated with known stiffnesses, identified, and compared."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jointstiff.schemas.measurement import MeasurementSetDocument, Observation, Reading
from jointstiff.schemas.plan import PlannedReading, PlanResult
from jointstiff.schemas.rehearsal import RehearsalResult, RehearsedJoint
from jointstiff.schemas.run import Campaign, JointResult, RunRequest, RunResult
from jointstiff.service.conversion.prepared import PreparedRobot, read_stated_transform
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, MOMENT
from jointstiff.service.kinds.run.work import RunWork, prepare_identification
from jointstiff.service.live.sources import draw_plausible_stiffness
from jointstiff.service.resources.inputs import InMemoryInputs
from jointstiff.service.tables.estimate import estimate_columns
from jointstiff.service.tables.stiffness import StiffnessUnit
from jointstiff.service.tables.table import Column, Table, as_line
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fit.problem import Bounds, Constraints
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.models import JointModel
from jointstiff.solver.text import figure

if TYPE_CHECKING:
    from jointstiff.solver.arrays import FloatArray

_USUAL_SIGMA: Final = 20e-6
"""Noise of a coordinate where the campaign states none [m]."""
_USUAL_TARGETS: Final = ((0.15, 0.0, 0.05), (-0.1, 0.12, 0.05), (-0.1, -0.12, 0.1))
"""Places in the flange frame of targets that the campaign does not place [m]."""
_WIDE: Final = 0.15
"""Half-width of a joint's interval, relative to its compliance, from which the rehearsal calls it wide."""


def rehearse_campaign(
    campaign: Campaign,
    robot: PreparedRobot,
    measured: RunResult | None = None,
    stated_stiffness: Mapping[str, float] | None = None,
    seed: int = 1,
    *,
    quick_only: bool = False,
) -> RehearsalResult:
    """Simulate the readings of a campaign with known stiffnesses, identify them, and compare.

    Robot, postures, loads, kinds of readings and options are those of the campaign, but nothing is resampled.

    Args:
        campaign: campaign in R0, or in a frame that it states in numbers; its readings are not used.
        robot: robot of the campaign, with n joints.
        measured: result of the campaign's own readings, whose stiffnesses and noise are planted; None if the
            campaign is not measured.
        stated_stiffness: planted stiffnesses by joint name, which take precedence [N·m/rad, N/m].
        seed: random seed of the noise and of plausible stiffnesses.
        quick_only: True to refuse an identification that compares models of elastic links.

    Raises:
        RequestError: the only load is the own weight, no load is stated, a load has no balance, or a stated
            stiffness is wrong.
        JointstiffError: the simulated readings cannot be identified.
    """
    is_unloaded = not any(map(_has_load, campaign.measurement_set.observations))
    if campaign.run.weight is not None or (is_unloaded and robot.robot.bodies):
        raise RequestError(
            "a run by the robot's own weight cannot be rehearsed",
            where="run.weight",
            remedy="rehearse a campaign with loads",
        )
    if is_unloaded:
        raise RequestError(
            "no observation has a force or a moment",
            where="measurement_set.observations",
            remedy="state the load of each observation in `force` or `moment`",
        )
    generator, remarks = np.random.default_rng(seed), list[str]()
    planted, planted_by = _choose_stiffness(robot.robot, measured, stated_stiffness, generator)
    simulation = _Simulation(campaign.measurement_set, robot.robot, planted, measured, generator, remarks)
    readings = simulation.measure()
    inputs = InMemoryInputs()
    options = dict(campaign.run) | {"resampling": None}
    request = RunRequest(**options, measurement_set_id=inputs.add_set(readings, robot))
    work = prepare_identification(inputs, request)
    if quick_only:
        refuse_long_identification(work)
    result = work.conclude([work.compute(span) for span in work.steps()])
    joints = [
        compare_with_planted(joint, float(value)) for joint, value in zip(result.joints, planted, strict=True)
    ]
    return RehearsalResult(
        joints=joints,
        determined=sum(not _has_no_upper_limit(joint) for joint in joints),
        confidence=request.confidence,
        postures=len(readings.observations),
        sigma=simulation.sigma,
        seed=seed,
        planted_by=planted_by,
        assessment=result.assessment,
        remarks=remarks,
    )


def refuse_long_identification(work: RunWork) -> None:
    """Refuse an identification in steps, which cross-validates elastic links and may last minutes.

    Raises:
        RequestError: the identification has steps.
    """
    if work.steps():
        raise RequestError(
            "a campaign whose models of elastic links are compared is not rehearsed by the service",
            where="run.elasticity",
            remedy="rehearse the campaign with `jointstiff rehearse`",
        )


def describe_verdict(rehearsal: RehearsalResult) -> Iterator[str]:
    """Yield the verdict on the campaign in sentences: which joints it determines, and how well."""
    total = len(rehearsal.joints)
    yield (
        f"This campaign determines {rehearsal.determined} of {total} joints "
        f"({rehearsal.postures} postures, noise {figure(1e6 * rehearsal.sigma, '.3g')} µm)"
    )
    if undetermined := [joint.name for joint in rehearsal.joints if _has_no_upper_limit(joint)]:
        yield (
            f"these joints have no stiffness or no upper limit: {', '.join(undetermined)}; add loads "
            "that twist these joints"
        )
    wide_joints = [
        joint
        for joint in rehearsal.joints
        if (joint.half_width or 0.0) > _WIDE and not _has_no_upper_limit(joint)
    ]
    if wide_joints:
        names = ", ".join(f"{joint.name} ± {100 * (joint.half_width or 0.0):.0f} %" for joint in wide_joints)
        yield (
            f"the intervals of these joints are wider than ± {100 * _WIDE:.0f} %: {names}; read more "
            "postures or use a larger load"
        )
    if not_contained := [joint.name for joint in rehearsal.joints if joint.contained is False]:
        chance = 100 * (1 - rehearsal.confidence)
        yield (
            f"the planted stiffness is outside the interval: {', '.join(not_contained)}; this happens "
            f"by chance for {chance:.0f} % of joints: rehearse with another seed"
        )


def make_joints_table(rehearsal: RehearsalResult, unit: StiffnessUnit) -> Table:
    """Return the table of the joints: planted stiffness or compliance, the number found, and its interval."""
    return make_planted_table(rehearsal.joints, rehearsal.confidence, rehearsal.planted_by, unit)


def make_planted_table(
    joints: Sequence[RehearsedJoint], confidence: float, planted_by: str, unit: StiffnessUnit
) -> Table:
    """Return a table of planted stiffnesses or compliances, the numbers found, and their intervals.

    Args:
        joints: planted stiffness and result of each joint.
        confidence: probability of the intervals.
        planted_by: source of the planted stiffnesses, in words.
        unit: unit of the stiffnesses in the table.
    """
    planted = [unit.show_stiffness(joint.planted, None, joint.kind).value_cell for joint in joints]
    found = [unit.show_stiffness(joint.found, joint.interval, joint.kind) for joint in joints]
    label, name = unit.label_of(joints), "compliances" if unit.is_compliance else "stiffnesses"
    return Table(
        [
            Column("joint", [joint.name for joint in joints], text=True),
            Column("planted", planted, as_line),
            *estimate_columns("found", found, confidence),
        ],
        caption=f"{name} in {label}; planted by {planted_by}",
    )


def add_planned_readings(campaign: Campaign, plan: PlanResult, robot: Robot) -> Campaign:
    """Return the campaign with the readings of a plan that goes on from it.

    The planned readings have the units and the frame of the set of the campaign.

    Args:
        campaign: campaign in R0, or in a frame that its set states in numbers.
        plan: plan of further readings, in SI units and R0.
        robot: robot of the campaign, with n joints.
    """
    readings = campaign.measurement_set
    length, force = LENGTH[readings.units.length], FORCE[readings.units.force]
    angle = np.where(robot.prismatic, length, ANGLE[readings.units.angle])
    to_tracker = np.eye(3)
    if readings.frame is not None:
        to_tracker = read_stated_transform(readings.frame, length).rotation.T
    has_turned_forces = readings.frame is not None and readings.frame.forces == "tracker"
    force_axes = to_tracker if has_turned_forces else np.eye(3)

    def read_as_planned(planned: PlannedReading) -> list[Reading]:
        """Return a reading of each target with zeros in place of numbers."""
        if planned.direction is None:
            return [Reading(target=name, unloaded=(0, 0, 0), loaded=(0, 0, 0)) for name in plan.targets]
        along = tuple((to_tracker @ np.array(planned.direction)).tolist())
        return [Reading(target=name, displacement=0.0, direction=along) for name in plan.targets]

    planned_observations = [
        Observation(
            label=f"{planned.label} (planned)",
            joints=(np.array(planned.joints) / angle).tolist(),
            force=tuple((force_axes @ np.array(planned.force) / force).tolist()),
            load_point=tuple((np.array(plan.load_point) / length).tolist()),
            readings=read_as_planned(planned),
        )
        for planned in plan.readings
    ]
    places = {name: tuple((np.array(place) / length).tolist()) for name, place in plan.targets.items()}
    update = {
        "observations": [*readings.observations, *planned_observations],
        "flange_targets": places | readings.flange_targets,
    }
    return campaign.model_copy(update={"measurement_set": readings.model_copy(update=update)})


def fill_missing_readings(document: Mapping[str, Any]) -> tuple[dict[str, Any], bool]:
    """Return (campaign, is_measured): a campaign whose null readings are zeros, and whether none was null."""
    filled, is_measured = json.loads(json.dumps(document, default=_to_plain_value)), True
    for observation in filled.get("measurement_set", {}).get("observations", ()):
        for reading in observation.get("readings", ()):
            for name in ("unloaded", "loaded", "deflection", "displacement"):
                if name in reading and reading[name] is None:
                    reading[name] = 0.0 if name == "displacement" else [0.0, 0.0, 0.0]
                    is_measured = False
    return filled, is_measured


def _to_plain_value(value: Any) -> Any:  # noqa: ANN401 - of a document
    """Return a message or an array of a document as plain JSON values."""
    if hasattr(value, "model_dump"):
        return value.model_dump(mode="json", exclude_unset=True)
    return value.tolist()


def _has_load(observation: Observation) -> bool:
    """Return whether an observation has a force or a moment other than zero."""
    return any((*(observation.force or ()), *(observation.moment or ())))


def _has_no_upper_limit(joint: RehearsedJoint) -> bool:
    """Return whether the interval of a joint's stiffness is unknown or has no upper end."""
    return joint.interval is None or None in joint.interval


def compare_with_planted(joint: JointResult, planted: float) -> RehearsedJoint:
    """Return the identified result of a joint together with its planted stiffness [N·m/rad or N/m]."""
    contained, half_width = None, None
    if joint.stiffness_interval is not None:
        lower, upper = joint.stiffness_interval
        contained = (lower is None or lower <= planted) and (upper is None or planted <= upper)
    compliance_interval = joint.compliance_interval
    if joint.compliance and compliance_interval is not None and None not in compliance_interval:
        half_width = (compliance_interval[1] - compliance_interval[0]) / 2 / joint.compliance
    return RehearsedJoint(
        name=joint.name,
        kind=joint.kind,
        planted=planted,
        found=joint.stiffness,
        interval=joint.stiffness_interval,
        contained=contained,
        half_width=half_width,
    )


def _choose_stiffness(
    robot: Robot,
    run: RunResult | None,
    stated_stiffness: Mapping[str, float] | None,
    generator: np.random.Generator,
) -> tuple[FloatArray, str]:
    """Return the stiffnesses (n,) to plant [N·m/rad or N/m], and their source in words.

    Args:
        robot: n joints.
        run: result whose stiffnesses are planted; None if the campaign is not measured.
        stated_stiffness: stiffnesses that the caller states, by joint name; they take precedence.
        generator: random numbers for stiffnesses that are not known.

    Raises:
        RequestError: a stated stiffness is not positive, or the robot has no such joint.
    """
    stiffness = draw_plausible_stiffness(robot, generator)
    source = "plausible values for an arm of this size"
    if run is not None:
        found = np.array([joint.stiffness or 0.0 for joint in run.joints])
        is_known = found > 0.0
        stiffness = np.where(is_known, found, stiffness)
        source = "the run of these readings" + ("" if is_known.all() else ", and plausible values")
    for name, value in (stated_stiffness or {}).items():
        index = robot.joint_index(name, f"stiffness.{name}")
        if not value > 0.0:
            raise RequestError(
                f"the stiffness of {name} is not positive", where="stiffness", remedy="give N·m/rad"
            )
        stiffness[index] = value
    if stated_stiffness:
        source = "the caller" if len(stated_stiffness) == robot.n else f"the caller, and {source}"
    return stiffness, source


class _Simulation:
    """Simulated readings of a measurement set: exact balance of springs and load, and normal noise."""

    def __init__(
        self,
        readings: MeasurementSetDocument,
        robot: Robot,
        stiffness: FloatArray,
        run: RunResult | None,
        random: np.random.Generator,
        remarks: list[str],
    ) -> None:
        """Convert the set to SI units and R0.

        Raises:
            RequestError: the frame of the set is that of a stored geometry.
        """
        units = readings.units
        self._set, self._robot, self._random, self._remarks = readings, robot, random, remarks
        self._length_unit, self._force_unit = LENGTH[units.length], FORCE[units.force]
        self._moment_unit = MOMENT[units.moment] if units.moment else self._force_unit
        self._angle_units = np.where(robot.prismatic, self._length_unit, ANGLE[units.angle])
        self._rotation_from_tracker, self._translation_from_tracker = np.eye(3), np.zeros(3)
        if readings.frame is not None:
            if readings.frame.rotation is None:
                raise RequestError(
                    "this process does not know the frame of a stored geometry",
                    where="measurement_set.frame",
                    remedy="give `rotation` and `translation`",
                )
            transform = read_stated_transform(readings.frame, self._length_unit)
            self._rotation_from_tracker, self._translation_from_tracker = (
                transform.rotation,
                np.asarray(transform.translation),
            )
        self._model = JointModel(robot, 1.0 / stiffness, None, Constraints(Bounds.positive(robot.n)))
        self.sigma = self._choose_sigma(run)
        self._joints = self._angle_units * np.array([each.joints for each in readings.observations])
        self._unloaded = Postures(robot, robot.joint_map.model_angles(self._joints))
        self._places = self._find_places()

    def _choose_sigma(self, run: RunResult | None) -> float:
        """Return the noise of a coordinate [m]: as the campaign states, else of the run, else usual noise."""
        noise = self._set.noise
        if noise is not None and noise.sigma is not None:
            return self._length_unit * noise.sigma
        stated = [
            reading.sigma for each in self._set.observations for reading in each.readings if reading.sigma
        ]
        if stated:
            return self._length_unit * float(np.median(stated))
        if run is not None and run.sigma:
            return run.sigma
        self._remarks.append(f"no noise of the readings is stated: {1e6 * _USUAL_SIGMA:.0f} µm is assumed")
        return _USUAL_SIGMA

    def _find_places(self) -> dict[str, FloatArray]:
        """Return target → place in the flange frame [m]: as stated, else as read, else a usual place."""
        places = {
            name: self._length_unit * np.array(place) for name, place in self._set.flange_targets.items()
        }
        places_as_read: dict[str, list[FloatArray]] = {}
        for index, observation in enumerate(self._set.observations):
            for reading in observation.readings:
                if reading.unloaded is not None and any(reading.unloaded):
                    position = (
                        self._rotation_from_tracker @ (self._length_unit * np.array(reading.unloaded))
                        + self._translation_from_tracker
                    )
                    offset = position - self._unloaded.flange_translation[index]
                    places_as_read.setdefault(reading.target, []).append(
                        self._unloaded.flange_rotation[index].T @ offset
                    )
        places |= {name: np.mean(each, axis=0) for name, each in places_as_read.items() if name not in places}
        targets = [reading.target for each in self._set.observations for reading in each.readings]
        missing = [name for name in dict.fromkeys(targets) if name not in places]
        if missing:
            usual_places = (np.array(place) for place in _USUAL_TARGETS * len(missing))
            places |= dict(zip(missing, usual_places, strict=False))
            self._remarks.append(
                f"the places of {', '.join(missing)} on the flange are not stated: usual places are assumed"
            )
        return places

    def measure(self) -> MeasurementSetDocument:
        """Return the set with simulated readings, in its own units and frame.

        Raises:
            RequestError: a load has no balance with the springs.
        """
        observations = list(self._set.observations)
        pairs = [(i, reading) for i, each in enumerate(observations) for reading in each.readings]
        loads = [self._load(observations[i]) for i, _ in pairs]
        cases = LoadCases(
            joints=self._joints[[i for i, _ in pairs]],
            force=np.array([force for force, _, _ in loads]),
            moment=np.array([moment for _, moment, _ in loads]),
            load_point=np.array([point for _, _, point in loads]),
            place=np.array([self._places[reading.target] for _, reading in pairs]),
        )
        loaded = self._model.deflect(cases).place  # (B, 3), in R0 [m]
        rotation = self._unloaded.flange_rotation
        translation = self._unloaded.flange_translation
        simulated: dict[int, list[Reading]] = {}
        for (i, reading), place, after in zip(pairs, cases.place, loaded, strict=True):
            before = rotation[i] @ place + translation[i]
            simulated.setdefault(i, []).append(self._read(reading, before, after, rotation[i]))
        updated = [
            each.model_copy(update={"readings": simulated.get(i, []), "encoder_readings": []})
            for i, each in enumerate(observations)
        ]
        return self._set.model_copy(update={"observations": updated})

    def _load(self, observation: Observation) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return force [N] and moment [N·m] in axes of R0, and the load point [m] in the flange frame."""
        frame = self._set.frame
        axes = self._rotation_from_tracker if frame is not None and frame.forces == "tracker" else np.eye(3)
        zero = (0.0, 0.0, 0.0)
        force = self._force_unit * (axes @ np.array(observation.force or zero))
        moment = self._moment_unit * (axes @ np.array(observation.moment or zero))
        if self._set.load_point_target is not None:  # the reading of the hook shows the load point
            return force, moment, self._places.get(self._set.load_point_target, np.zeros(3))
        point = observation.load_point or self._set.load_point or zero
        return force, moment, self._length_unit * np.array(point)

    def _read(self, reading: Reading, before: FloatArray, after: FloatArray, flange: FloatArray) -> Reading:
        """Return a reading of the same kind with simulated numbers, in the units and the frame of the set."""
        noise = self.sigma * self._random.standard_normal((2, 3))
        moved = after - before
        if reading.displacement is not None:
            along = (
                flange @ np.array(reading.flange_direction)
                if reading.direction is None
                else self._rotation_from_tracker @ np.array(reading.direction)
            )
            length = moved @ along / np.linalg.norm(along) + noise[1, 0] - noise[0, 0]
            return reading.model_copy(update={"displacement": float(length / self._length_unit)})
        if reading.deflection is not None:
            deflection = self._rotation_from_tracker.T @ (moved + noise[1] - noise[0]) / self._length_unit
            return reading.model_copy(update={"deflection": tuple(deflection.tolist())})
        unloaded, loaded = (
            tuple(
                (
                    self._rotation_from_tracker.T
                    @ (each - self._translation_from_tracker)
                    / self._length_unit
                ).tolist()
            )
            for each in (before + noise[0], after + noise[1])
        )
        if reading.loaded is None and self._set.load_point_target is not None:  # the hook needs no load
            return reading.model_copy(update={"unloaded": unloaded})
        return reading.model_copy(update={"unloaded": unloaded, "loaded": loaded})
