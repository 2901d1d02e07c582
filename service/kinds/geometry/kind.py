"""A robot's geometry from sweeps or poses: the declaration of the kind, its report and its computation."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from math import degrees, sqrt
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from jointstiff.schemas.geometry import (
    Drift,
    Geometry,
    GeometryRequest,
    GeometryResult,
    LinkComparison,
    PoseEvidence,
    SweepEvidence,
    WristResult,
)
from jointstiff.service.kinds.kind import READINGS_BYTES, File, Kind
from jointstiff.service.tables.estimate import (
    NORMAL_95,
    ShownEstimate,
    half_width,
    show_cell,
    show_estimate,
)
from jointstiff.service.tables.report import Report, View
from jointstiff.service.tables.table import (
    Chart,
    Column,
    Line,
    Part,
    Sheet,
    Table,
    number_formatter,
    vector_formatter,
)
from jointstiff.solver.errors import RequestError
from jointstiff.solver.text import figure, length_text

if TYPE_CHECKING:
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.resources.inputs import Inputs
    from jointstiff.solver.geometry.poses import Poses
    from jointstiff.solver.geometry.sweeps import SweepSet
    from jointstiff.solver.mechanics.robot import KnownRobot, Robot

_MILLI, _MICRO = 1e3, 1e6


_SIGNIFICANCE_LEVEL = 0.01
"""p-value below which the report says that the controller's angles do not fit the readings."""
_LEAST_PROBABILITY = 1e-6
"""Smallest probability that is shown; a smaller probability is shown as this number "or less"."""


def _make_report(_job: Geometry, result: GeometryResult, view: View) -> Report:
    """Return the report: axes, links and a summary; `view.details` adds the evidence and notes."""
    parts: list[Part] = [_make_axes_table(result)]
    if view.details:
        parts += _make_evidence_parts(result)
    if result.links:
        parts.append(_make_links_table(result.links))
    parts.append(Line("\n".join(f"  {line}" for line in _make_summary_lines(result, details=view.details))))
    if view.details:
        notes = [finding for finding in result.findings if finding.is_remark]
        parts += [Line(f"  {note.where}: {note.message}; {note.remedy}", "dim") for note in notes]
    return Report(parts)


def _make_evidence_parts(result: GeometryResult) -> list[Part]:
    """Return the evidence: tables and lines on sweeps, poses, tracker, targets, wrist centre and drift."""
    parts: list[Part] = []
    if result.sweeps:
        parts.append(_make_sweeps_table(result.sweeps))
    if result.poses is not None:
        lines = [f"  {line}" for line in _describe_poses(result.poses)]
        parts.append(Line("\n".join(lines)))
    parts += [_make_tracker_frame_table(result), _make_targets_table(result)]
    if result.wrist is not None:
        parts += _make_wrist_parts(result.wrist)
    if result.drift is not None:
        parts.append(_make_drift_line(result.drift))
    return parts


def _describe_poses(poses: PoseEvidence) -> Iterator[str]:
    """Yield lines on a calibration by poses: what the poses determine, how well they fit, what is unknown."""
    yield (
        f"{poses.positions} poses determine {poses.determined} of {poses.unknowns} unknowns; the "
        f"residual is {length_text(poses.rms_residual)} rms of a coordinate"
    )
    if poses.held_out_rms is not None:
        yield f"poses that were left out of the fit have a residual of {length_text(poses.held_out_rms)} rms"
    for names in poses.only_together:
        yield f"not determined: {', '.join(names)}"


def _make_axes_table(result: GeometryResult) -> Table:
    """Return a table with a point on each joint axis, the direction of the axis, and uncertainties."""
    axes = result.axes
    columns = [Column("axis", [axis.name for axis in axes], text=True)]
    for i, x in enumerate("xyz"):
        columns.append(Column(x, [axis.point[i] for axis in axes], number_formatter(".3f", _MILLI)))
    place_widths = [half_width(axis.position_uncertainty, _MICRO) for axis in axes]
    turn_widths = [half_width(axis.direction_uncertainty, _MICRO) for axis in axes]
    columns.append(Column("direction", [axis.direction for axis in axes], _format_direction))
    columns.append(Column("place", place_widths, unit="µm"))
    columns.append(Column("turn", turn_widths, unit="µrad"))
    return Table(
        columns,
        title="Axes at model angle zero, in R0",
        caption="points in mm; ±: half of the 95 % interval, of the place across the axis and of the "
        "direction, where it is largest",
        plain=True,
    )


def _format_direction(direction: Sequence[float]) -> str:
    """Format the components of a direction, such as "+0.00000 +0.00000 +1.00000"."""
    # Adding 0.0 turns −0 into 0, so that no "-0.00000" is shown.
    return " ".join(f"{round(component, 5) + 0.0:+.5f}" for component in direction)


def _make_sweeps_table(sweeps: Sequence[SweepEvidence]) -> Table:
    """Return a table of the sweeps of single joints: arc, number of positions, scale and residuals."""
    format_micro = vector_formatter(".3g", _MICRO, " ")
    arcs = [f"{degrees(sweep.arc):.1f}°" for sweep in sweeps]
    scales = [sweep.angle_scale for sweep in sweeps]
    variance_factors = [sweep.variance_factor for sweep in sweeps]
    radial = [list(sweep.radial_rms.values()) for sweep in sweeps]
    axial = [list(sweep.axial_rms.values()) for sweep in sweeps]
    columns = [
        Column("joint", [sweep.joint for sweep in sweeps], text=True),
        Column("arc", arcs),
        Column("positions", [sweep.positions for sweep in sweeps]),
        Column("scale", scales, number_formatter(".5f")),
        Column("χ²/dof", variance_factors, number_formatter(".2f")),
        Column("radial", radial, format_micro),
        Column("axial", axial, format_micro),
    ]
    return Table(
        columns,
        title="Sweeps, each fitted separately",
        caption="residuals by target, root mean square in µm; scale: rotation of the joint divided by "
        "the rotation that the controller shows",
    )


def _make_tracker_frame_table(result: GeometryResult) -> Table:
    """Return a table of the transform from the tracker's frame to R0, with half-widths of its intervals."""
    transform, covariance = result.transform_tracker_to_base, result.transform_covariance
    # Standard uncertainties of the translation along x, y, z [m], then of the rotation about x, y, z [rad].
    uncertainties = [None] * 6 if covariance is None else [sqrt(covariance[i][i]) for i in range(6)]
    half_widths = [half_width(each, _MICRO) for each in uncertainties]
    columns = [
        Column("", list("xyz"), text=True),
        Column("R", transform.rotation, vector_formatter("+.7f", 1.0, " ")),
        Column("t", transform.translation, number_formatter(".3f", _MILLI)),
        Column("shift", half_widths[:3], unit="µm"),
        Column("turn", half_widths[3:], unit="µrad"),
    ]
    source = "the nominal model" if result.base == "nominal" else "the axes"
    return Table(
        columns,
        title=f"Tracker to R0, placed by {source}",
        caption="y = R x + t, with x in the tracker's frame and y in R0; t in mm; ±: half of the 95 % "
        "interval of a shift and of a turn, axes of R0",
    )


def _make_targets_table(result: GeometryResult) -> Table:
    """Return a table of the targets' positions in the flange frame."""
    rows = [_format_position(target.position, target.covariance) for target in result.targets]
    return Table(
        [
            Column("target", [target.name for target in result.targets], text=True),
            *(Column(axis, [row[i] for row in rows], show_cell) for i, axis in enumerate("xyz")),
        ],
        title="Targets in the flange frame",
        caption="in mm, with the 95 % interval",
    )


def _format_position(
    position: Sequence[float], covariance: Sequence[Sequence[float]] | None
) -> list[ShownEstimate]:
    """Format three coordinates [m] in mm, each with its 95 % interval."""
    uncertainties = [None if covariance is None else sqrt(covariance[i][i]) for i in range(3)]
    return [
        _show_length(coordinate, uncertainty)
        for coordinate, uncertainty in zip(position, uncertainties, strict=True)
    ]


def _show_length(length: float, uncertainty: float | None) -> ShownEstimate:
    """Format a length [m] in mm, or an angle [rad] in mrad, with the 95 % interval of its uncertainty."""
    if uncertainty is None:
        return show_estimate(length, None, _MILLI, bare=".4f")
    half = NORMAL_95 * uncertainty
    return show_estimate(length, (length - half, length + half), _MILLI, bare=".4f")


def make_wrist_table(wrist: WristResult) -> Table:
    """Return the table of the estimates of the wrist centre."""
    centres = [*wrist.estimates, wrist.combined]
    rows = [_format_position(centre.base, centre.base_covariance) for centre in centres]
    return Table(
        [
            Column("by", [centre.way for centre in centres], text=True),
            *(Column(axis, [row[i] for row in rows], show_cell) for i, axis in enumerate("xyz")),
            Column("weight", [f"{estimate.weight:.2f}" for estimate in wrist.estimates] + [""]),
        ],
        title="Wrist centre, in R0",
        caption="in mm, with the 95 % interval; weight in the combined centre",
    )


def _make_wrist_parts(wrist: WristResult) -> list[Part]:
    """Return tables of the wrist centre and of targets, and lines on the distances between estimates."""
    lines = [
        f"{pair.first} and {pair.second} are {_MICRO * pair.distance:.1f} µm apart (p-value "
        f"{pair.probability:.2g})"
        for pair in wrist.distances
    ]
    targets = [make_wrist_targets_table(wrist)] if wrist.targets else []
    text = "\n".join(f"  {line}" for line in [*lines, _describe_distance_of_axes(wrist)])
    return [make_wrist_table(wrist), *targets, Line(text)]


def make_wrist_targets_table(wrist: WristResult) -> Table:
    """Return the table of the targets relative to the wrist centre."""
    targets = wrist.targets
    columns = [Column("target", [each.name for each in targets], text=True)]
    for i, axis in enumerate("xyz"):
        offsets = [_MILLI * each.offset[i] for each in targets]
        columns.append(Column(axis, offsets, number_formatter(".3f")))
    distances = [_show_length(each.distance, each.standard_uncertainty) for each in targets]
    columns.append(Column("distance", distances, show_cell))
    used = ["yes" if each.trilaterates else "no" for each in targets]
    columns.append(Column("used", used, text=True))
    caption = (
        "offset in the flange frame, and distance by the spheres with its 95 % interval, in mm; used "
        "for trilateration"
    )
    return Table(columns, title="Targets from the wrist centre", caption=caption)


def _describe_distance_of_axes(wrist: WristResult) -> str:
    """Describe the distance between the last three axes, and whether the decoupled method applies."""
    applicability = "applies" if wrist.decoupled_method else "does not apply"
    return (
        f"the last three axes miss each other by {_MICRO * wrist.miss_distance:.1f} µm "
        f"({half_width(wrist.miss_uncertainty, _MICRO)} µm): the decoupled method {applicability}"
    )


def _make_links_table(links: Sequence[LinkComparison]) -> Table:
    """Return a table of the links' lengths and angles: nominal, identified, and their difference."""
    return Table(
        [
            Column("link", [link.quantity for link in links], text=True),
            Column("after", [link.joint for link in links]),
            Column("nominal", [_format_link_size(link, link.nominal) for link in links]),
            Column("identified", links, _format_identified_size),
            Column("difference", [_show_difference(link) for link in links], show_cell),
        ],
        title="Links, nominal and identified",
        caption="lengths in mm, angles in degrees; difference in mm or mrad, with its 95 % interval",
    )


def _format_link_size(link: LinkComparison, value: float) -> str:
    """Format an angle [rad] of a link in degrees, or a length [m] in mm."""
    return f"{degrees(value):.4f}°" if link.unit == "rad" else f"{_MILLI * value:.3f}"


def _format_identified_size(link: LinkComparison) -> str:
    """Format the identified size of a link, or return "not determined"."""
    return "not determined" if link.standard_uncertainty is None else _format_link_size(link, link.identified)


def _show_difference(link: LinkComparison) -> ShownEstimate:
    """Format identified minus nominal size in mm or mrad, with its 95 % interval; a dash if unknown."""
    uncertainty = link.standard_uncertainty
    if uncertainty is None:
        return show_estimate(None, None)
    return _show_length(link.difference, uncertainty)


def _make_drift_line(drift: Drift) -> Line:
    """Return a line on the motion of the targets on the base during the measurement."""
    shift = sqrt(sum(component**2 for component in drift.displacement))
    rotation = sqrt(sum(component**2 for component in drift.rotation))
    verdict = "beyond noise" if drift.significant else "within noise"
    return Line(
        f"  base targets: moved by {_MICRO * shift:.1f} µm at the robot and turned by "
        f"{_MICRO * rotation:.1f} µrad, {verdict} (p-value {drift.probability:.2g})"
    )


def _make_summary_lines(result: GeometryResult, *, details: bool) -> list[str]:
    """Return lines on sigma, the fit of all sweeps, the controller's angles, and the wrist centre."""
    lines = [
        f"sigma of a coordinate {_MICRO * result.sigma:.1f} µm ({result.sigma_source}), χ²/dof "
        f"{result.variance_factor:.2f} with {result.degrees_of_freedom} degrees of freedom",
        *_describe_agreement(result),
    ]
    if result.no_wrist is not None:
        lines.append(f"no wrist centre: {result.no_wrist}")
    if result.wrist is not None and not details:
        lines.append(_describe_distance_of_axes(result.wrist))
    if details:
        tables = (f"{table.convention} {_MICRO * table.deviation:.1f} µm" for table in result.dh)
        lines.append(f"deviation of the DH tables (all numbers in the JSON): {', '.join(tables)}")
    return lines


def _describe_agreement(result: GeometryResult) -> Iterator[str]:
    """Yield lines on two tests, as far as they were made: of one model for all sweeps, and of the angles."""
    if result.agreement_probability is not None:
        verdict = "does not fit" if result.fit == "one_by_one" else "fits"
        probability = _describe_fit_probability(result.agreement_probability)
        yield f"one robot model {verdict} all sweeps ({probability})"
    if result.controller_probability is not None:
        verdict = "fit" if result.controller_probability >= _SIGNIFICANCE_LEVEL else "do not fit"
        probability = _describe_fit_probability(result.controller_probability)
        yield f"the controller's angles {verdict} the readings ({probability})"


def _describe_fit_probability(probability: float) -> str:
    """Describe the p-value of a fit: the probability that noise alone gives a worse fit."""
    percent = figure(100.0 * max(probability, _LEAST_PROBABILITY), ".1g")
    or_less = " or less" if probability < _LEAST_PROBABILITY else ""
    return f"noise alone would give a worse fit with a probability of {percent} %{or_less}"


def make_charts(result: GeometryResult) -> list[Chart]:
    """Return a chart of the half-width of the interval of each axis's position, across the axis."""
    names = [axis.name for axis in result.axes]
    series = {"position": [axis.position_uncertainty for axis in result.axes]}
    title = "Half-width of the 95 % interval across each axis"
    # The factor makes half-widths of 95 % intervals of the standard uncertainties.
    return [Chart(title, names, series, NORMAL_95 * _MICRO, "± µm", "axes", quantity="half-width")]


def axes_sheet(geometry: Geometry) -> Sheet:
    """Return the file `axes.csv`: a row for each axis; empty if the job has no result."""
    return Sheet.from_messages(geometry.result.axes if geometry.result else [], _AXES)


_AXES: Final = {
    "axis": "name",
    "point {x y z}": "point",
    "direction {x y z}": "direction",
    "position uncertainty": "position_uncertainty",
    "direction uncertainty": "direction_uncertainty",
}


def _prepare_work(inputs: Inputs, request: GeometryRequest) -> Work:
    """Check robot and readings, and return the work that identifies the geometry.

    Only inputs that influence the result are hashed: names and ids do not influence it.

    Raises:
        RequestError: the robot is missing, does not exist or cannot be used; or the readings contradict each
            other or the nominal model.
    """
    from jointstiff.service.conversion.readings import hash_texts
    from jointstiff.service.kinds.work import QuickWork

    _refuse_poses_without_robot(request)
    nominal = _find_nominal_robot(inputs, request)
    readings = _convert_readings(request, nominal.robot)
    options = request.model_dump_json(exclude={"robot_id": True, "name": True, "robot": {"name"}})
    payload = None if nominal.robot is None else nominal.robot.payload
    stated = () if payload is None else (repr(payload),)

    def identify() -> GeometryResult:
        """Return the result; the identified robot has the payload of the nominal one."""
        result = _identify(request, readings, nominal.robot, inputs.list_confusable_robots())
        return result.model_copy(update={"robot": result.robot.model_copy(update={"payload": payload})})

    return QuickWork(
        result=identify,
        input_hash=hash_texts(nominal.content_hash, options, *stated),
        robot_id=request.robot_id,
        details={"name": request.name},
    )


def _refuse_poses_without_robot(request: GeometryRequest) -> None:
    """Refuse a request with poses, which calibrate a nominal robot model, but without a robot.

    Raises:
        RequestError: the robot is missing.
    """
    if request.poses is not None and not request.has_robot:
        raise RequestError(
            "poses calibrate a nominal robot model, but the request has no robot",
            where="robot_id",
            remedy="give `robot_id` or `robot`",
        )


class _NominalRobot(NamedTuple):
    """The nominal robot of a request."""

    robot: Robot | None = None  # None if the request has none
    content_hash: str = ""  # empty for a robot in the request, which is hashed with the other options


def _find_nominal_robot(inputs: Inputs, request: GeometryRequest) -> _NominalRobot:
    """Return the robot that the request contains, or names by its id.

    Raises:
        RequestError: the robot does not exist or cannot be used.
    """
    from jointstiff.service.conversion.prepared import prepare_robot
    from jointstiff.service.kinds.work import as_request_errors

    if request.robot is not None:
        with as_request_errors("robot"):
            return _NominalRobot(prepare_robot(request.robot).robot)
    if request.robot_id is not None:
        return _NominalRobot(*inputs.robot(request.robot_id, "robot_id"))
    return _NominalRobot()


def _convert_readings(request: GeometryRequest, nominal: Robot | None) -> SweepSet | Poses:
    """Return the sweeps of a request or, if it has none, its poses; poses need a nominal robot.

    Raises:
        RequestError: the readings contradict each other or the nominal model.
    """
    from jointstiff.service.conversion.geometry import to_poses, to_sweeps
    from jointstiff.service.kinds.work import as_request_errors

    with as_request_errors():
        if request.sweeps is None and nominal is not None:
            return to_poses(request, nominal)
        return to_sweeps(request, nominal)


def _identify(
    request: GeometryRequest,
    readings: SweepSet | Poses,
    robot: Robot | None,
    others: Iterable[KnownRobot],
) -> GeometryResult:
    """Identify the geometry from sweeps, or from poses and the robot's nominal model; return the result.

    `others` are robots that may have been measured in place of the chosen one.
    """
    from jointstiff.service.conversion.geometry import to_conventions
    from jointstiff.service.conversion.prepared import to_base_targets
    from jointstiff.service.kinds.work import as_request_errors
    from jointstiff.solver.geometry.identification import identify_from_poses, identify_from_sweeps
    from jointstiff.solver.geometry.poses import Poses

    nominal = None if robot is None else robot.chain
    with as_request_errors():
        conventions = to_conventions(request, readings.targets)
        base_targets = to_base_targets(request, readings.sigma)
        if not isinstance(readings, Poses):
            return identify_from_sweeps(
                readings,
                conventions,
                nominal=nominal,
                name=request.name,
                fit=request.fit,
                angles=request.angles,
                base_targets=base_targets,
                others=others,
            )
        if nominal is not None:
            return identify_from_poses(
                readings,
                conventions,
                nominal=nominal,
                name=request.name,
                base_targets=base_targets,
                others=others,
            )
        raise ValueError("poses need a nominal model to calibrate, but the request has none")


_EXAMPLES: Final[dict[str, Any]] = {
    "two joints": {
        "name": "pan and tilt",
        "units": {"length": "mm", "angle": "deg"},
        "noise": {"sigma": 0.01},
        "sweeps": [
            {
                "joint": "joint_1",
                "observations": [
                    {"joints": [-60.0, 0.0], "targets": {"P10": [3374.935, -1874.21, 100.004]}},
                    {"joints": [-20.0, 0.0], "targets": {"P10": [3603.561, -1154.073, 99.991]}},
                    {"joints": [20.0, 0.0], "targets": {"P10": [3315.867, -455.455, 99.989]}},
                    {"joints": [60.0, 0.0], "targets": {"P10": [2646.413, -105.212, 100.0]}},
                ],
            },
            {
                "joint": "joint_2",
                "observations": [
                    {"joints": [0.0, -60.0], "targets": {"P10": [3139.182, -897.597, 792.84]}},
                    {"joints": [0.0, -20.0], "targets": {"P10": [3475.218, -793.655, 373.625]}},
                    {"joints": [0.0, 20.0], "targets": {"P10": [3475.199, -793.642, -173.626]}},
                    {"joints": [0.0, 60.0], "targets": {"P10": [3139.179, -897.613, -592.82]}},
                ],
            },
        ],
    },
    "configurations of a stored robot": {
        "units": {"length": "mm", "angle": "deg"},
        "robot_id": "ID_OF_A_STORED_ROBOT",
        "poses": [
            {"joints": [0.0, -30.0, 45.0, 0.0, 60.0, 0.0], "targets": {"P10": [1562.104, 151.336, 1120.48]}}
        ],
    },
}


GEOMETRY: Final = Kind[Geometry, GeometryRequest](
    message=Geometry,
    request=GeometryRequest,
    options=GeometryRequest,
    prepare_work=_prepare_work,
    make_report=_make_report,
    sources=("readings",),
    make_charts=make_charts,
    files=(
        File(
            name="axes.csv",
            description="each axis: a point, the direction, and the uncertainties of both, in the base "
            "frame R0 at model angle zero",
            sheet=axes_sheet,
            made_of="result",
        ),
    ),
    title="Geometry of a robot",
    max_bytes=READINGS_BYTES,
    has_report=False,
    examples=_EXAMPLES,
    description="Identify a robot's geometry from sweeps of single joints, or from poses without load. Post "
    'the identified model as the model of a robot: `{"format": "geometry", …}`. Suspicious readings are '
    "reported. Readings that do not determine the geometry are refused.",
)
