"""Gearboxes from a weight step: the declaration of the kind, its report and its computation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

from jointstiff.schemas.gearbox import Gearbox, GearboxRequest, GearboxResult, GearboxStiffness, HungLoad
from jointstiff.schemas.motion import Motion
from jointstiff.service.kinds.kind import READINGS_BYTES, Kind, list_table_files
from jointstiff.service.tables.estimate import (
    NORMAL_95,
    ShownEstimate,
    estimate_columns,
    show_estimate,
    style_for,
)
from jointstiff.service.tables.report import Report, View, joint_reason_lines
from jointstiff.service.tables.table import (
    NO_NUMBER,
    Chart,
    Column,
    Line,
    Part,
    Sheet,
    Table,
    format_percent,
    number_formatter,
)
from jointstiff.solver.text import figure, length_text

if TYPE_CHECKING:
    from collections.abc import Callable

    from jointstiff.service.kinds.work import Work
    from jointstiff.service.resources.inputs import Inputs
    from jointstiff.solver.mechanics.robot import Robot

_MEGA, _MICRO = 1e-6, 1e6
_CONFIDENCE: Final = 0.95


def _make_report(job: Gearbox, result: GearboxResult, view: View) -> Report:
    """Return the report: verdict, gearboxes and what they rest on; `view.details` adds the evidence."""
    motion = job.request.motion
    parts: list[Part] = [_gearbox_table(result)]
    parts += joint_reason_lines((each.joint, each.reason) for each in result.gearboxes)
    if result.not_observed:
        parts.append(Line(f"  {', '.join(result.not_observed)}: no second encoder was read, not observed"))
    if job.request.load is not None:
        parts.append(Line(f"  {_state_load(job.request.load, result)}"))
    parts.append(Line("  bearings and links behind the encoders are not in these numbers", "dim"))
    if view.details and motion is None:
        parts += [_evidence_table(result), _residuals_table(result)]
    elif view.details:
        parts += [_motion_table(result), _logs_table(result)]
    return Report(parts)


def _state_load(load: HungLoad, result: GearboxResult) -> str:
    """Return the sentence on which the numbers of a weight step rest."""
    half = figure(NORMAL_95 * (result.mass_uncertainty or 0.0), ".2g")
    place = length_text(NORMAL_95 * (result.point_uncertainty or 0.0))
    return f"by a load of {figure(load.mass)} kg ± {half} kg, whose place is known to ± {place} (95 %)"


def _gearbox_table(result: GearboxResult) -> Table:
    """Return the table of stiffnesses with their intervals."""
    style = style_for(result.assessment.verdict)
    gearboxes = result.gearboxes
    shown = list[ShownEstimate]()
    for gearbox in gearboxes:
        shown.append(show_estimate(gearbox.stiffness, gearbox.stiffness_interval, _MEGA, style=style))
    columns = [
        Column("gearbox of", [each.joint for each in gearboxes], text=True),
        *estimate_columns("stiffness", shown, _CONFIDENCE),
        Column("±", [format_percent(each.half_width) for each in gearboxes]),
        Column("torque", [_format_torques(each) for each in gearboxes]),
    ]
    title = "Gearboxes, motor to link encoder"
    caption = "stiffness in 10⁶ N·m/rad, with its 95 % interval; torque in N·m"
    return Table(columns, title=title, caption=caption)


def _format_torques(gearbox: GearboxStiffness) -> str:
    """Return the range of the load's torque [N·m] over the postures."""
    return f"{gearbox.least_torque:.0f} … {gearbox.greatest_torque:.0f}"


def _evidence_table(result: GearboxResult) -> Table:
    """Return the table of what else the twists show: lost motion, offsets and noise."""
    lost = [
        show_estimate(each.lost_motion, each.lost_motion_interval, _MICRO).cell for each in result.gearboxes
    ]
    return Table(
        [
            Column("gearbox of", [each.joint for each in result.gearboxes], text=True),
            Column("postures", [each.postures for each in result.gearboxes]),
            Column("lost motion", lost, lambda line: line),
            Column("offset", [each.offset for each in result.gearboxes], _format_micro),
            Column("noise", [each.noise for each in result.gearboxes], _format_micro),
        ],
        title="Twist without torque",
        caption="in µrad; offset: change between the states; noise: standard deviation of a step",
    )


def _motion_table(result: GearboxResult) -> Table:
    """Return the table of what else the twists of logs show: delay, lost motion and noise."""
    return Table(
        [
            Column("gearbox of", [each.joint for each in result.gearboxes], text=True),
            Column("independent samples", [each.degrees_of_freedom for each in result.gearboxes]),
            Column("delay", [each.delay for each in result.gearboxes], _format_milliseconds),
            Column("lost motion", [each.lost_motion for each in result.gearboxes], _format_micro),
            Column("noise", [each.noise for each in result.gearboxes], _format_micro),
        ],
        title="Twist without torque",
        caption="delay of the link's encoder in ms; lost motion and noise in µrad",
    )


def _logs_table(result: GearboxResult) -> Table:
    """Return the table of each log alone."""
    shown = [
        show_estimate(each.stiffness, each.stiffness_interval, _MEGA, style="dim") for each in result.by_log
    ]
    return Table(
        [
            Column("log", [each.label for each in result.by_log], text=True),
            Column("gearbox of", [each.joint for each in result.by_log], text=True),
            *estimate_columns("stiffness", shown, _CONFIDENCE),
        ],
        title="Each log alone",
        caption="stiffness in 10⁶ N·m/rad, with its 95 % interval",
    )


def _format_milliseconds(time: float | None) -> str:
    """Return a time [s] in ms."""
    return NO_NUMBER if time is None else figure(1e3 * time, ".3g")


def _format_micro(angle: float | None) -> str:
    """Return an angle [rad] in µrad."""
    return NO_NUMBER if angle is None else figure(_MICRO * angle, ".3g")


def _residuals_table(result: GearboxResult) -> Table:
    """Return the table of all steps."""
    return Table(
        [
            Column("posture", [each.label for each in result.residuals], text=True),
            Column("joint", [each.joint for each in result.residuals], text=True),
            Column("torque", [each.torque for each in result.residuals], number_formatter(".0f")),
            Column("step", [each.step for each in result.residuals], _format_micro),
            Column("residual", [each.residual for each in result.residuals], _format_micro),
        ],
        title="Steps of the twist",
        caption="torque with which the motor holds the load, in N·m; step and residual in µrad",
    )


def gearboxes_sheet(job: Gearbox) -> Sheet:
    """Return the table of the gearboxes, in SI units; empty if the job has no result."""
    return Sheet.from_messages(job.result.gearboxes if job.result else [], _GEARBOXES)


def steps_sheet(job: Gearbox) -> Sheet:
    """Return the table of all steps, in SI units; empty if the job has no result."""
    return Sheet.from_messages(job.result.residuals if job.result else [], _STEPS)


_GEARBOXES: Final = {
    "joint": "joint",
    "stiffness": "stiffness",
    "stiffness {lower upper}": "stiffness_interval",
    "half-width": "half_width",
    "compliance": "compliance",
    "compliance {lower upper}": "compliance_interval",
    "offset": "offset",
    "lost motion": "lost_motion",
    "noise": "noise",
    "delay": "delay",
    "degrees of freedom": "degrees_of_freedom",
    "reason": "reason",
}
_STEPS: Final = {
    "label": "label",
    "joint": "joint",
    "torque": "torque",
    "step": "step",
    "residual": "residual",
}


def make_charts(result: GearboxResult) -> list[Chart]:
    """Return a chart of the stiffnesses of the gearboxes."""
    names = [each.joint for each in result.gearboxes]
    series = {"stiffness": [each.stiffness for each in result.gearboxes]}
    return [Chart("Stiffness of gearboxes", names, series, _MEGA, "10⁶ N·m/rad", "gearboxes")]


def _prepare_work(inputs: Inputs, request: GearboxRequest) -> Work:
    """Check robot and readings, and return the work that identifies the gearboxes.

    Raises:
        RequestError: the robot does not exist or cannot be used, or the readings do not fit it.
    """
    from jointstiff.service.conversion.prepared import prepare_robot
    from jointstiff.service.conversion.readings import hash_texts
    from jointstiff.service.kinds.work import QuickWork, as_request_errors

    if request.robot is not None:
        with as_request_errors("robot"):
            prepared = prepare_robot(request.robot)
        robot, robot_hash = prepared.robot, ""  # a robot in the request is hashed with the other fields
    else:
        robot, robot_hash = inputs.robot(request.robot_id or "", "robot_id")
    with as_request_errors():
        identify = _prepare_identification(request, robot)
    content = request.model_dump_json(exclude={"robot_id": True, "name": True, "robot": {"name"}})
    return QuickWork(
        result=identify,
        input_hash=hash_texts(robot_hash, content, repr(robot.payload)),
        robot_id=request.robot_id,
        details={"name": request.name},
    )


def _prepare_identification(request: GearboxRequest, robot: Robot) -> Callable[[], GearboxResult]:
    """Return the identification of a request: by a weight step or by logs.

    Raises:
        MeasurementError: the readings do not fit the robot.
        RequestError: the robot has no joint of a name, or its masses are not known.
    """
    instrument = request.instrument
    if isinstance(instrument, Motion):
        from jointstiff.service.conversion.motion import to_motion_campaign
        from jointstiff.solver.gearboxes.log_outcome import identify_from_logs

        campaign = to_motion_campaign(request, instrument, robot)
        return lambda: identify_from_logs(campaign)
    from jointstiff.service.conversion.gearbox import to_weight_step
    from jointstiff.solver.gearboxes.outcome import identify_gearboxes

    step = to_weight_step(request, instrument, robot)
    return lambda: identify_gearboxes(step)


def _make_example(options: dict[str, Any]) -> dict[str, Any]:
    """Return a small weight step: an axis of an arm of the catalogue, in six postures, from both sides."""
    return {
        "units": {"length": "mm", "angle": "deg"},
        "robot": {"name": "KR 210", "model": {"format": "catalogue", "arm": "KUKA KR 210 R2700 extra"}},
        "load": {"mass": 200.0, "point": [0.0, 0.0, 150.0], **options},
        "observations": [posture.make_observation() for posture in _READ],
    }


class _EncoderAngles(NamedTuple):
    """Angles [deg] of joint 2 by its two encoders, without and with the load."""

    approach: str  # side from which the joint came: "+" or "-"
    motor_unloaded: float
    link_unloaded: float
    motor_loaded: float
    link_loaded: float

    def make_reading(self) -> dict[str, Any]:
        """Return the reading of both encoders, in the form of a request."""
        return {
            "joint": "joint_2",
            "approach": self.approach,
            "unloaded": {"motor": self.motor_unloaded, "link": self.link_unloaded},
            "loaded": {"motor": self.motor_loaded, "link": self.link_loaded},
        }


class _ReadPosture(NamedTuple):
    """A posture of the example in which the encoders were read."""

    label: str
    joints: list[float]  # [deg]
    angles: tuple[_EncoderAngles, ...]

    def make_observation(self) -> dict[str, Any]:
        """Return the observation of this posture, in the form of a request."""
        readings = [each.make_reading() for each in self.angles]
        return {"label": self.label, "joints": self.joints, "encoder_readings": readings}


_READ: Final = (
    _ReadPosture(
        "s01",
        [0.0, -20.0, 60.0, 0.0, 0.0, 0.0],
        (
            _EncoderAngles("+", -20.00006, -19.87077, -20.00011, -19.78924),
            _EncoderAngles("-", -20.00003, -19.86995, -19.99999, -19.78818),
        ),
    ),
    _ReadPosture(
        "s02",
        [40.0, -35.0, 70.0, 0.0, 30.0, 0.0],
        (
            _EncoderAngles("+", -35.00005, -34.88119, -35.00013, -34.80688),
            _EncoderAngles("-", -35.00008, -34.88053, -35.00008, -34.80596),
        ),
    ),
    _ReadPosture(
        "s03",
        [0.0, -110.0, 130.0, 0.0, -40.0, 0.0],
        (
            _EncoderAngles("+", -110.00007, -109.98934, -109.99998, -109.95055),
            _EncoderAngles("-", -109.99986, -109.98842, -109.99991, -109.94972),
        ),
    ),
    _ReadPosture(
        "s04",
        [-30.0, -120.0, 110.0, 0.0, 0.0, 0.0],
        (
            _EncoderAngles("+", -119.99995, -120.0012, -120.00011, -119.96546),
            _EncoderAngles("-", -119.99994, -120.00022, -120.00013, -119.96462),
        ),
    ),
    _ReadPosture(
        "s05",
        [0.0, -75.0, 80.0, 0.0, 20.0, 0.0],
        (
            _EncoderAngles("+", -75.00001, -74.92601, -74.99989, -74.85981),
            _EncoderAngles("-", -74.99976, -74.92505, -75.00012, -74.85884),
        ),
    ),
    _ReadPosture(
        "s06",
        [90.0, -50.0, 60.0, 0.0, 45.0, 0.0],
        (
            _EncoderAngles("+", -50.00006, -49.88873, -49.99993, -49.81155),
            _EncoderAngles("-", -49.99994, -49.888, -50.00012, -49.81066),
        ),
    ),
)


GEARBOX: Final = Kind[Gearbox, GearboxRequest](
    message=Gearbox,
    request=GearboxRequest,
    options=GearboxRequest,
    prepare_work=_prepare_work,
    make_report=_make_report,
    sources=("readings",),
    make_charts=make_charts,
    files=(
        *list_table_files("gearboxes", "each gearbox with stiffness and interval", gearboxes_sheet, "result"),
        *list_table_files("steps", "each step of a twist, with torque and residual", steps_sheet, "result"),
    ),
    title="Gearboxes from two encoders",
    max_bytes=READINGS_BYTES,
    examples={
        "weighed load": _make_example({"mass_uncertainty": 0.2, "point_uncertainty": 5.0}),
        "load not weighed": _make_example({}),
    },
    description="""Identify the stiffness of gearboxes from the angles of two encoders, without a tracker.

Read motor and link angle of joints at rest in planned postures, without and with a weighed
load. The result is the gearbox between the two encoders, not the joint. Logs of a motion,
together with the masses of the arm, give the same stiffness within a factor of 1.5.""",
)
