"""Rehearsals: the readings of a campaign simulated with known stiffnesses, identified, and compared."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from jointstiff.schemas.fields import Vector3
from jointstiff.schemas.measurement import MeasurementSetDocument, Observation, Reading
from jointstiff.schemas.plan import PlannedReading, PlanResult
from jointstiff.schemas.rehearsal import RehearsalResult, RehearsedJoint
from jointstiff.schemas.run import Campaign, JointResult, RunRequest, RunResult
from jointstiff.service.conversion.prepared import PreparedRobot, read_stated_transform
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, MOMENT
from jointstiff.service.kinds.run.work import RunWork, prepare_identification
from jointstiff.service.live.sources import draw_plausible_stiffness
from jointstiff.service.resources.inputs import InMemoryInputs
from jointstiff.service.runs.verdicts import refuse_implausible_stiffness
from jointstiff.service.tables.estimate import estimate_columns
from jointstiff.service.tables.stiffness import StiffnessUnit
from jointstiff.service.tables.table import Column, Table, as_line
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fit.constraints import Bounds, Constraints
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
    _refuse_without_loads(campaign, robot)
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


def _refuse_without_loads(campaign: Campaign, robot: PreparedRobot) -> None:
    """Refuse a campaign whose readings show no deflection by a load.

    Raises:
        RequestError: the only load is the own weight, or no load is stated.
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
    yield (
        f"This campaign determines {rehearsal.determined} of {len(rehearsal.joints)} joints "
        f"({rehearsal.postures} postures, noise {figure(1e6 * rehearsal.sigma, '.3g')} µm)"
    )
    undetermined = [joint.name for joint in rehearsal.joints if _has_no_upper_limit(joint)]
    if undetermined:
        yield (
            f"these joints have no stiffness or no upper limit: {', '.join(undetermined)}; add loads "
            "that twist these joints"
        )
    wide = [f"{joint.name} ± {100 * (joint.half_width or 0.0):.0f} %" for joint in _list_wide(rehearsal)]
    if wide:
        yield (
            f"the intervals of these joints are wider than ± {100 * _WIDE:.0f} %: {', '.join(wide)}; read "
            "more postures or use a larger load"
        )
    not_contained = [joint.name for joint in rehearsal.joints if joint.contained is False]
    if not_contained:
        chance = 100 * (1 - rehearsal.confidence)
        yield (
            f"the planted stiffness is outside the interval: {', '.join(not_contained)}; this happens "
            f"by chance for {chance:.0f} % of joints: rehearse with another seed"
        )


def _list_wide(rehearsal: RehearsalResult) -> list[RehearsedJoint]:
    """Return the joints whose interval has two ends that are far from each other."""
    return [
        joint
        for joint in rehearsal.joints
        if (joint.half_width or 0.0) > _WIDE and not _has_no_upper_limit(joint)
    ]


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
    label = unit.label_of(joints)
    return Table(
        [
            Column("joint", [joint.name for joint in joints], text=True),
            Column("planted", planted, as_line),
            *estimate_columns("found", found, confidence),
        ],
        caption=f"stiffnesses in {label}; planted by {planted_by}",
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
    frame = _SetFrame.from_set(readings, robot)
    planned = [_make_planned_observation(each, plan, frame) for each in plan.readings]
    places = {name: tuple((np.array(place) / frame.length).tolist()) for name, place in plan.targets.items()}
    changed_set = readings.model_copy(
        update={
            "observations": [*readings.observations, *planned],
            "flange_targets": places | readings.flange_targets,
        }
    )
    return campaign.model_copy(update={"measurement_set": changed_set})


def _make_planned_observation(planned: PlannedReading, plan: PlanResult, frame: _SetFrame) -> Observation:
    """Return an observation of all targets of a plan, with zeros in place of numbers, in units of the set."""
    if planned.direction is None:
        readings = [Reading(target=name, unloaded=(0, 0, 0), loaded=(0, 0, 0)) for name in plan.targets]
    else:
        along = tuple((frame.rotation.T @ np.array(planned.direction)).tolist())
        readings = [Reading(target=name, displacement=0.0, direction=along) for name in plan.targets]
    return Observation(
        label=f"{planned.label} (planned)",
        joints=(np.array(planned.joints) / frame.joints).tolist(),
        force=tuple((frame.load_axes.T @ np.array(planned.force) / frame.force).tolist()),
        load_point=tuple((np.array(plan.load_point) / frame.length).tolist()),
        readings=readings,
    )


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
        RequestError: a stated stiffness is implausible, or the robot has no such joint.
    """
    stiffness = draw_plausible_stiffness(robot, generator)
    source = "plausible values for an arm of this size"
    if run is not None:
        springs = run.joints if run.alone is None else run.alone.joints  # simulated links are rigid
        found = np.array([joint.stiffness or 0.0 for joint in springs])
        is_known = found > 0.0
        stiffness = np.where(is_known, found, stiffness)
        source = "the run of these readings" + ("" if is_known.all() else ", and plausible values")
    if not stated_stiffness:
        return stiffness, source
    for name, value in stated_stiffness.items():
        refuse_implausible_stiffness(robot, name, value)
        stiffness[robot.joint_names.index(name)] = value
    states_all = len(stated_stiffness) == robot.n
    return stiffness, "the caller" if states_all else f"the caller, and {source}"


@dataclass(frozen=True, eq=False)
class _SetFrame:
    """Units and axes in which a measurement set states its numbers, to convert them to SI units in R0."""

    length: float  # size of the unit of length [m]
    force: float  # size of the unit of force [N]
    moment: float  # size of the unit of moment [N·m]
    joints: FloatArray  # (n,) size of the unit of each joint's positions [rad or m]
    rotation: FloatArray  # (3, 3) from the axes of the readings to those of R0
    translation: FloatArray  # (3,) origin of the readings in R0 [m]
    has_turned_loads: bool  # whether forces and moments are along the axes of the readings, not of R0

    @classmethod
    def from_set(cls, readings: MeasurementSetDocument, robot: Robot) -> _SetFrame:
        """Return the units and axes of a set, whose frame is R0 or stated in numbers."""
        units, frame = readings.units, readings.frame
        length, force = LENGTH[units.length], FORCE[units.force]
        rotation, translation = np.eye(3), np.zeros(3)
        if frame is not None:
            transform = read_stated_transform(frame, length)
            rotation, translation = transform.rotation, np.asarray(transform.translation)
        return cls(
            length=length,
            force=force,
            moment=MOMENT[units.moment] if units.moment else force,
            joints=np.where(robot.prismatic, length, ANGLE[units.angle]),
            rotation=rotation,
            translation=translation,
            has_turned_loads=frame is not None and frame.forces == "tracker",
        )

    @property
    def load_axes(self) -> FloatArray:
        """(3, 3) rotation from the axes of the stated loads to those of R0."""
        return self.rotation if self.has_turned_loads else np.eye(3)

    def to_base(self, place: Vector3) -> FloatArray:
        """Return a place of the set in R0 (3,) [m]."""
        return np.asarray(self.rotation @ (self.length * np.array(place)) + self.translation)

    def from_base(self, place: FloatArray) -> Vector3:
        """Return a place in R0 (3,) [m] in the frame and the unit of the set."""
        x, y, z = (self.rotation.T @ (place - self.translation) / self.length).tolist()
        return x, y, z

    def turn_from_base(self, displacement: FloatArray) -> Vector3:
        """Return a displacement along axes of R0 (3,) [m] along the axes and in the unit of the set."""
        x, y, z = (self.rotation.T @ displacement / self.length).tolist()
        return x, y, z


class _SimulatedLoad(NamedTuple):
    """Load of an observation."""

    force: FloatArray  # (3,) axes of R0 [N]
    moment: FloatArray  # (3,) axes of R0 [N·m]
    point: FloatArray  # (3,) flange frame [m]


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
        if readings.frame is not None and readings.frame.rotation is None:
            raise RequestError(
                "this process does not know the frame of a stored geometry",
                where="measurement_set.frame",
                remedy="give `rotation` and `translation`",
            )
        self._set, self._robot, self._random, self._remarks = readings, robot, random, remarks
        self._frame = _SetFrame.from_set(readings, robot)
        self._model = JointModel(robot, 1.0 / stiffness, None, Constraints(Bounds.positive(robot.n)))
        self.sigma = self._choose_sigma(run)
        self._joints = self._frame.joints * np.array([each.joints for each in readings.observations])
        self._unloaded = Postures(robot, robot.joint_map.model_angles(self._joints))
        self._places = self._find_places()

    def _choose_sigma(self, run: RunResult | None) -> float:
        """Return the noise of a coordinate [m]: as the campaign states, else of the run, else usual noise."""
        noise = self._set.noise
        if noise is not None and noise.sigma is not None:
            return self._frame.length * noise.sigma
        stated = [
            reading.sigma for each in self._set.observations for reading in each.readings if reading.sigma
        ]
        if stated:
            return self._frame.length * float(np.median(stated))
        if run is not None and run.sigma:
            return run.sigma
        self._remarks.append(f"no noise of the readings is stated: {1e6 * _USUAL_SIGMA:.0f} µm is assumed")
        return _USUAL_SIGMA

    def _find_places(self) -> dict[str, FloatArray]:
        """Return target → place in the flange frame [m]: as stated, else as read, else a usual place."""
        stated = {
            name: self._frame.length * np.array(place) for name, place in self._set.flange_targets.items()
        }
        as_read = {name: np.mean(each, axis=0) for name, each in self._list_places_as_read().items()}
        places = as_read | stated
        targets = [reading.target for each in self._set.observations for reading in each.readings]
        missing = [name for name in dict.fromkeys(targets) if name not in places]
        if missing:
            self._remarks.append(
                f"the places of {', '.join(missing)} on the flange are not stated: usual places are assumed"
            )
        usual_places = [np.array(place) for place in _USUAL_TARGETS]
        return places | dict(zip(missing, cycle(usual_places), strict=False))

    def _list_places_as_read(self) -> dict[str, list[FloatArray]]:
        """Return target → its places in the flange frame [m], one for each reading of it without load."""
        places: dict[str, list[FloatArray]] = {}
        flanges = zip(self._unloaded.flange_rotation, self._unloaded.flange_translation, strict=True)
        for observation, (rotation, translation) in zip(self._set.observations, flanges, strict=True):
            for reading in observation.readings:
                if reading.unloaded is not None and any(reading.unloaded):
                    offset = self._frame.to_base(reading.unloaded) - translation
                    places.setdefault(reading.target, []).append(rotation.T @ offset)
        return places

    def measure(self) -> MeasurementSetDocument:
        """Return the set with simulated readings, in its own units and frame.

        Raises:
            RequestError: a load has no balance with the springs.
        """
        observations = self._set.observations
        pairs = [(i, reading) for i, each in enumerate(observations) for reading in each.readings]
        cases = self._list_cases(pairs)
        loaded = self._model.deflect(cases).place  # (B, 3), in R0 [m]
        simulated: list[list[Reading]] = [[] for _ in observations]
        for (i, reading), place, after in zip(pairs, cases.place, loaded, strict=True):
            rotation = self._unloaded.flange_rotation[i]
            before = rotation @ place + self._unloaded.flange_translation[i]
            simulated[i].append(self._read(reading, before, after, rotation))
        updated = [
            observation.model_copy(update={"readings": readings, "encoder_readings": []})
            for observation, readings in zip(observations, simulated, strict=True)
        ]
        return self._set.model_copy(update={"observations": updated})

    def _list_cases(self, pairs: Sequence[tuple[int, Reading]]) -> LoadCases:
        """Return a load case for each (index of the observation, reading of a target)."""
        loads = [self._read_load(self._set.observations[i]) for i, _ in pairs]
        return LoadCases(
            joints=self._joints[[i for i, _ in pairs]],
            force=np.array([load.force for load in loads]),
            moment=np.array([load.moment for load in loads]),
            load_point=np.array([load.point for load in loads]),
            place=np.array([self._places[reading.target] for _, reading in pairs]),
        )

    def _read_load(self, observation: Observation) -> _SimulatedLoad:
        """Return the load of an observation; its point is stated, or that of the target on the hook."""
        frame, zero = self._frame, (0.0, 0.0, 0.0)
        if self._set.load_point_target is not None:  # the reading of the hook shows the load point
            point = self._places.get(self._set.load_point_target, np.zeros(3))
        else:
            point = frame.length * np.array(observation.load_point or self._set.load_point or zero)
        return _SimulatedLoad(
            force=frame.force * (frame.load_axes @ np.array(observation.force or zero)),
            moment=frame.moment * (frame.load_axes @ np.array(observation.moment or zero)),
            point=point,
        )

    def _read(self, reading: Reading, before: FloatArray, after: FloatArray, flange: FloatArray) -> Reading:
        """Return a reading of the same kind with simulated numbers, in the units and the frame of the set.

        Args:
            reading: reading whose numbers are replaced: a displacement, a deflection, or two places.
            before: (3,) place of the target without load, in R0 [m].
            after: (3,) place of the target under load, in R0 [m].
            flange: (3, 3) rotation from the flange frame to R0.
        """
        noise_before, noise_after = self.sigma * self._random.standard_normal((2, 3))
        if reading.displacement is not None:
            along = self._find_gauge_direction(reading, flange)
            # A gauge reads one number, so it has one number of the noise.
            moved = (after - before) @ along / np.linalg.norm(along) + noise_after[0] - noise_before[0]
            return reading.model_copy(update={"displacement": float(moved / self._frame.length)})
        if reading.deflection is not None:
            deflection = self._frame.turn_from_base(after - before + noise_after - noise_before)
            return reading.model_copy(update={"deflection": deflection})
        unloaded = self._frame.from_base(before + noise_before)
        if reading.loaded is None and self._set.load_point_target is not None:  # the hook needs no load
            return reading.model_copy(update={"unloaded": unloaded})
        loaded = self._frame.from_base(after + noise_after)
        return reading.model_copy(update={"unloaded": unloaded, "loaded": loaded})

    def _find_gauge_direction(self, reading: Reading, flange: FloatArray) -> FloatArray:
        """Return the direction (3,) in R0 along which a gauge reads; it may be stated in the flange frame."""
        if reading.direction is None:
            return np.asarray(flange @ np.array(reading.flange_direction))
        return np.asarray(self._frame.rotation @ np.array(reading.direction))
