"""Rehearsals: the readings of a campaign simulated with known stiffnesses, identified, and compared."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jointstiff.schemas.measurement import MeasurementSetDocument, Observation, Reading
from jointstiff.schemas.plan import Plan
from jointstiff.schemas.rehearsal import RehearsalResult, RehearsedJoint
from jointstiff.schemas.run import Campaign, JointResult
from jointstiff.service.conversion.prepared import read_stated_transform
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, MOMENT
from jointstiff.service.kinds.plan.kind import make_campaign_to_fill_in
from jointstiff.service.library.here import Here
from jointstiff.service.library.results import Presented, TabledRun
from jointstiff.service.library.robots import prepare_once
from jointstiff.service.library.robots import robot as describe_robot
from jointstiff.service.live.sources import draw_plausible_stiffness
from jointstiff.service.problems import as_campaign_error
from jointstiff.service.resources.documents import parse_document, read_campaign, read_content
from jointstiff.service.tables.stiffness import DEFAULT_UNIT, UNITS
from jointstiff.service.tables.table import NO_NUMBER, Chart, Line, Part, Sheet, text_table
from jointstiff.solver.errors import RequestError
from jointstiff.solver.estimation.problem import Bounds, Constraints
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.models import JointModel
from jointstiff.solver.text import figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jointstiff.service.reports.plots import PlotStyle
    from jointstiff.solver.arrays import FloatArray

_USUAL_SIGMA: Final = 20e-6
"""Noise of a coordinate where the campaign states none [m]."""
_USUAL_TARGETS: Final = ((0.15, 0.0, 0.05), (-0.1, 0.12, 0.05), (-0.1, -0.12, 0.1))
"""Places in the flange frame of targets that the campaign does not place [m]."""
_WIDE: Final = 0.15
"""Half-width of a joint's interval, relative to its compliance, from which the rehearsal calls it wide."""


class Rehearsal(Presented, RehearsalResult):
    """Stiffnesses that a campaign would find next to those that were planted; shown as a table."""

    def _parts(self) -> Sequence[Part]:
        """Return the verdict on the campaign, the joints, and the remarks."""
        return [*map(Line, self._describe()), self._joints_table(), *map(Line, self.remarks)]

    def _describe(self) -> Iterator[str]:
        """Yield the verdict on the campaign in words: what it determines, and how well."""
        total = len(self.joints)
        yield (
            f"This campaign determines {self.determined} of {total} joints "
            f"({self.postures} postures, noise {figure(1e6 * self.sigma, '.3g')} µm)"
        )
        if undetermined := [joint.name for joint in self.joints if _has_no_upper_limit(joint)]:
            yield (
                f"these joints have no stiffness or no upper limit: {', '.join(undetermined)}; add loads "
                "that twist these joints"
            )
        wide_joints = [
            joint
            for joint in self.joints
            if (joint.half_width or 0.0) > _WIDE and not _has_no_upper_limit(joint)
        ]
        if wide_joints:
            names = ", ".join(
                f"{joint.name} ± {100 * (joint.half_width or 0.0):.0f} %" for joint in wide_joints
            )
            yield (
                f"the intervals of these joints are wider than ± {100 * _WIDE:.0f} %: {names}; read more "
                "postures or use a larger load"
            )
        if not_contained := [joint.name for joint in self.joints if joint.contained is False]:
            chance = 100 * (1 - self.confidence)
            yield (
                f"the planted stiffness is outside the interval: {', '.join(not_contained)}; this happens "
                f"by chance for {chance:.0f} % of joints: rehearse with another seed"
            )

    def _joints_table(self) -> Part:
        """Return the table of the joints: planted stiffness, stiffness found, and its interval."""
        rows = []
        for joint in self.joints:
            unit = UNITS[DEFAULT_UNIT].for_kind(joint.kind)
            lower, upper = joint.interval or (None, None)
            end_texts = [
                "no limit" if end is None else figure(unit.factor * end, ".4g") for end in (lower, upper)
            ]
            width = NO_NUMBER if joint.half_width is None else f"± {100 * joint.half_width:.2g} %"
            rows.append(
                [
                    joint.name,
                    figure(unit.factor * joint.planted, ".4g"),
                    NO_NUMBER if joint.found is None else figure(unit.factor * joint.found, ".4g"),
                    NO_NUMBER if joint.interval is None else " … ".join(end_texts),
                    width,
                ]
            )
        unit = UNITS[DEFAULT_UNIT]
        column_titles = ["joint", "planted", "found", f"{100 * self.confidence:g} % interval", "half-width"]
        return text_table(
            column_titles, rows, caption=f"stiffnesses in {unit.label}; planted by {self.planted_by}"
        )

    def _sheets(self) -> Mapping[str, Callable[[], Sheet]]:
        """Return table name → function that makes the table; the only table has a row for each joint."""
        return {"joints": self._make_sheet}

    def _make_sheet(self) -> Sheet:
        """Return the table of the joints in SI units."""
        limits = [joint.interval or (None, None) for joint in self.joints]
        columns = {
            "joint": [joint.name for joint in self.joints],
            "planted [N.m/rad]": [joint.planted for joint in self.joints],
            "found [N.m/rad]": [joint.found for joint in self.joints],
            "low [N.m/rad]": [lower for lower, _ in limits],
            "high [N.m/rad]": [upper for _, upper in limits],
            "half-width [1]": [joint.half_width for joint in self.joints],
        }
        return Sheet.with_joint_kinds(
            Sheet(columns, frozenset({"joint"})), [joint.kind for joint in self.joints]
        )

    def _draw_figure(self, style: PlotStyle) -> Figure:
        """Draw planted and found stiffnesses with their intervals."""
        from jointstiff.service.reports.plots import draw_figure

        unit = UNITS[DEFAULT_UNIT]
        series: dict[str, list[float | None]] = {
            "planted": [joint.planted for joint in self.joints],
            "found": [joint.found for joint in self.joints],
        }
        intervals = {"found": [joint.interval for joint in self.joints]}
        names = [joint.name for joint in self.joints]
        title = "Planted and found stiffness"
        chart = Chart(title, names, series, unit.factor, unit.label, "joints", intervals, True, "stiffness")
        return draw_figure([chart], style=style)


def _has_no_upper_limit(joint: RehearsedJoint) -> bool:
    """Return whether the interval of a joint's stiffness is unknown or has no upper end."""
    return joint.interval is None or None in joint.interval


def rehearse(
    source: Any,  # noqa: ANN401 - a campaign, a run or a plan
    /,
    *,
    robot: object = None,
    stiffness: Mapping[str, float] | None = None,
    seed: int = 1,
) -> Rehearsal:
    """Simulate the readings of a campaign with known stiffnesses, identify the stiffnesses, and compare both.

    Robot, postures, loads, kinds of readings and noise are those of the campaign. The deflections are the
    exact balance of springs and load. The known ("planted") stiffnesses are those of the run. Joints without
    a number, and campaigns that are not measured yet, get stiffnesses that are plausible for an arm of this
    size.

    Args:
        source: a campaign, a run, or a plan; as an object, a document, or the name of a file. In a campaign
            that is not measured yet, readings may be null.
        robot: robot of a plan; anything that `jointstiff.robot` accepts.
        stiffness: planted stiffnesses by joint name [N·m/rad; N/m of a prismatic joint].
        seed: random seed of the noise and of plausible stiffnesses.

    Returns:
        The joints with planted and found stiffness and the interval, with a verdict in words.

    Raises:
        CampaignError: the campaign cannot be used.
        RequestError: a plan has no robot, a joint has another name, or the load is the own weight.
    """
    campaign, measured_source = _read_source(source, robot)
    with as_campaign_error("robot"):
        prepared = prepare_once(campaign.robot).robot
    with as_campaign_error(""):
        if campaign.run.weight is not None:
            raise RequestError(
                "a run by the robot's own weight cannot be rehearsed",
                where="run.weight",
                remedy="rehearse a campaign with loads",
            )
        generator, remarks = np.random.default_rng(seed), list[str]()
        run = (
            measured_source
            if isinstance(measured_source, TabledRun)
            else Here().identify(campaign)
            if measured_source
            else None
        )
        planted_stiffness, planted_by = _choose_stiffness(prepared, run, stiffness, generator)
        simulation = _Simulation(
            campaign.measurement_set, prepared, planted_stiffness, run, generator, remarks
        )
        readings = simulation.measure()
    simulated = campaign.model_copy(update={"measurement_set": readings})
    run_of_simulation = Here().identify(Campaign.model_validate(dict(simulated)))
    joints = [
        _compare_with_planted(joint, float(value))
        for joint, value in zip(run_of_simulation._require_result().joints, planted_stiffness, strict=True)
    ]
    return Rehearsal(
        joints=joints,
        determined=sum(not _has_no_upper_limit(joint) for joint in joints),
        confidence=run_of_simulation.request.confidence,
        postures=len(readings.observations),
        sigma=simulation.sigma,
        seed=seed,
        planted_by=planted_by,
        assessment=run_of_simulation._require_result().assessment,
        remarks=remarks,
    )


def _compare_with_planted(joint: JointResult, planted: float) -> RehearsedJoint:
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


def _read_source(source: Any, robot: object) -> tuple[Campaign, Any]:  # noqa: ANN401 - as of `rehearse`
    """Return the campaign of a source, and its run: a run, true if the campaign has readings, else false."""
    from jointstiff.service.library.saved import load, use_saved

    if isinstance(source, str | PathLike) and Path(source).is_file():
        document = json.loads(read_content(Path(source)))
        if isinstance(document, dict) and document.get("kind") == "plan":
            source = load(source)
        elif isinstance(document, dict) and "measurement_set" in document:
            source = document
        else:
            source = use_saved(source)
    if isinstance(source, TabledRun):
        return source.campaign, source
    if isinstance(source, Plan):
        if robot is None:
            raise RequestError("the plan has no robot", where="robot", remedy="give the argument `robot`")
        source = make_campaign_to_fill_in(describe_robot(robot), source) | {"targets": source.result}
        targets = source.pop("targets").targets
        source["measurement_set"]["flange_targets"] = targets
    if not isinstance(source, Mapping):
        return read_campaign(source), True
    filled, is_measured = _fill_missing_readings(source)
    return parse_document(filled, Campaign), is_measured


def _fill_missing_readings(document: Mapping[str, Any]) -> tuple[dict[str, Any], bool]:
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


def _choose_stiffness(
    robot: Robot,
    run: TabledRun | None,
    stated_stiffness: Mapping[str, float] | None,
    generator: np.random.Generator,
) -> tuple[FloatArray, str]:
    """Return the stiffnesses (n,) to plant [N·m/rad or N/m], and their source in words.

    Args:
        robot: n joints.
        run: run whose stiffnesses are planted; None if the campaign is not measured.
        stated_stiffness: stiffnesses that the caller states, by joint name; they take precedence.
        generator: random numbers for stiffnesses that are not known.

    Raises:
        RequestError: a stated stiffness is not positive, or the robot has no such joint.
    """
    stiffness = draw_plausible_stiffness(robot, generator)
    source = "plausible values for an arm of this size"
    if run is not None:
        is_known = np.isfinite(run.stiffness) & (run.stiffness > 0.0)
        stiffness = np.where(is_known, run.stiffness, stiffness)
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
        run: TabledRun | None,
        random: np.random.Generator,
        remarks: list[str],
    ) -> None:
        """Convert the set to SI units and R0.

        Raises:
            RequestError: the frame of the set is that of a stored geometry.
        """
        units = readings.units
        self._set, self._robot, self._random, self._remarks = readings, robot, random, remarks
        self._length, self._force = LENGTH[units.length], FORCE[units.force]
        self._moment = MOMENT[units.moment] if units.moment else self._force
        self._angle = np.where(robot.prismatic, self._length, ANGLE[units.angle])
        self._rotation, self._translation = np.eye(3), np.zeros(3)
        if readings.frame is not None:
            if readings.frame.rotation is None:
                raise RequestError(
                    "this process does not know the frame of a stored geometry",
                    where="measurement_set.frame",
                    remedy="give `rotation` and `translation`",
                )
            transform = read_stated_transform(readings.frame, self._length)
            self._rotation, self._translation = transform.rotation, np.asarray(transform.translation)
        self._model = JointModel(robot, 1.0 / stiffness, None, Constraints(Bounds.positive(robot.n)))
        self.sigma = self._choose_sigma(run)
        self._joints = self._angle * np.array([each.joints for each in readings.observations])
        self._unloaded = Postures(robot, robot.joint_map.model_angles(self._joints))
        self._places = self._find_places()

    def _choose_sigma(self, run: TabledRun | None) -> float:
        """Return the noise of a coordinate [m]: as the campaign states, else of the run, else usual noise."""
        noise = self._set.noise
        if noise is not None and noise.sigma is not None:
            return self._length * noise.sigma
        stated = [
            reading.sigma for each in self._set.observations for reading in each.readings if reading.sigma
        ]
        if stated:
            return self._length * float(np.median(stated))
        if run is not None and run._require_result().sigma:
            return float(run._require_result().sigma or 0.0)
        self._remarks.append(f"no noise of the readings is stated: {1e6 * _USUAL_SIGMA:.0f} µm is assumed")
        return _USUAL_SIGMA

    def _find_places(self) -> dict[str, FloatArray]:
        """Return target → place in the flange frame [m]: as stated, else as read, else a usual place."""
        places = {name: self._length * np.array(place) for name, place in self._set.flange_targets.items()}
        places_as_read: dict[str, list[FloatArray]] = {}
        for index, observation in enumerate(self._set.observations):
            for reading in observation.readings:
                if reading.unloaded is not None and any(reading.unloaded):
                    position = (
                        self._rotation @ (self._length * np.array(reading.unloaded)) + self._translation
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
        """Return force [N], moment [N·m], axes of R0, and load point in the flange frame [m]."""
        frame = self._set.frame
        axes = self._rotation if frame is not None and frame.forces == "tracker" else np.eye(3)
        zero = (0.0, 0.0, 0.0)
        force = self._force * (axes @ np.array(observation.force or zero))
        moment = self._moment * (axes @ np.array(observation.moment or zero))
        point = observation.load_point or self._set.load_point or zero
        return force, moment, self._length * np.array(point)

    def _read(self, reading: Reading, before: FloatArray, after: FloatArray, flange: FloatArray) -> Reading:
        """Return a reading of the same kind with simulated numbers, in the units and the frame of the set."""
        noise = self.sigma * self._random.standard_normal((2, 3))
        moved = after - before
        if reading.displacement is not None:
            along = (
                flange @ np.array(reading.flange_direction)
                if reading.direction is None
                else self._rotation @ np.array(reading.direction)
            )
            length = moved @ along / np.linalg.norm(along) + noise[1, 0] - noise[0, 0]
            return reading.model_copy(update={"displacement": float(length / self._length)})
        if reading.deflection is not None:
            deflection = self._rotation.T @ (moved + noise[1] - noise[0]) / self._length
            return reading.model_copy(update={"deflection": tuple(deflection.tolist())})
        unloaded, loaded = (
            tuple((self._rotation.T @ (each - self._translation) / self._length).tolist())
            for each in (before + noise[0], after + noise[1])
        )
        return reading.model_copy(update={"unloaded": unloaded, "loaded": loaded})
