"""Deflection over a work area: the declaration of maps, and what people read of one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees, isfinite, nan
from typing import TYPE_CHECKING, Any, Final

from jointstiff.schemas.deflection import (
    Map,
    MapOptions,
    MapPlace,
    MapRequest,
    MapResult,
    PlaceStatus,
)
from jointstiff.schemas.joints import JointKind
from jointstiff.service.kinds.kind import File, Kind
from jointstiff.service.tables.estimate import (
    ShownEstimate,
    model_error_text,
    show_cell,
    show_estimate,
    style_for,
)
from jointstiff.service.tables.report import Report, View
from jointstiff.service.tables.table import (
    Area,
    Chart,
    Column,
    Line,
    Part,
    Style,
    Table,
    number_formatter,
    vector_formatter,
)
from jointstiff.solver.text import figure, posture_text

if TYPE_CHECKING:
    from jointstiff.service.kinds.map.work import MapWork
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.resources.inputs import Inputs
    from jointstiff.service.tables.table import Sheet

_EXAMPLES: Final[dict[str, Any]] = {
    "milling a plate": {
        "run_id": "ID_OF_A_RUN",
        "area": [[1.2, -0.6, 0.4], [2.0, 0.6, 0.4]],
        "grid": [9, 13, 1],
        "place": [0.0, 0.0, 0.25],
        "turns": 8,
        "force": [0.0, 300.0, -500.0],
    },
    "the same posture at all places, force along the tool": {
        "run_id": "ID_OF_A_RUN",
        "area": [[1.2, -0.6, 0.4], [2.0, 0.6, 1.2]],
        "grid": [9, 13, 5],
        "place": [0.0, 0.0, 0.25],
        "directions": [[0.0, 0.0, -1.0], [0.5, 0.0, -0.8660254]],
        "force": [100.0, 0.0, -400.0],
        "axes": "flange",
        "near": [0.0, -0.5, 0.8, 0.0, 1.0, 0.0],
    },
}


def _prepare_work(inputs: Inputs, request: MapRequest) -> Work:
    """Return the work of a map, which is computed later; numerical modules are imported here."""
    from jointstiff.service.kinds.map.work import prepare_map

    return prepare_map(inputs, request)


def _places_sheet(work: MapWork) -> Sheet:
    """Return the table of all places, computed again from the map's request."""
    return work.sheet()


_REASONS: Final[Mapping[PlaceStatus, str]] = {
    "out_of_reach": "out of reach",
    "joint_limits": "beyond the joints' limits",
    "unseen_joint": "load twists a joint that the readings do not determine",
    "overloaded": "load beyond the range of the spring model",
    "not_followed": "too near a singularity to keep the branch of the given posture",
}


def _make_report(job: Map, result: MapResult, _view: View) -> Report:
    """Return counts of places without posture, quantiles of the deflection, and worst and stiffest place."""
    lines = [_describe_missing_postures(result)]
    if result.percentiles:
        lines.append(_describe_quantiles(result.percentiles))
    if result.extrapolated:
        lines.append(f"{result.extrapolated} places are beyond the loads or postures of the campaign")
    parts: list[Part] = [Line(line) for line in [*lines, *result.remarks]]
    if result.worst is not None and result.stiffest is not None:
        places = (result.worst, result.stiffest)
        kinds, style = list(result.joint_kinds.values()), style_for(result.assessment.verdict)
        parts.append(_extremes_table(places, job.request.confidence, kinds, style))
    return Report(parts)


def _describe_missing_postures(result: MapResult) -> str:
    """Return the number of places without posture for each reason: "12 out of reach, 3 beyond …"."""
    counted = [f"{result.counts[name]} {reason}" for name, reason in _REASONS.items() if result.counts[name]]
    return ", ".join(counted) or f"all {result.places} places reached"


def _describe_quantiles(percentiles: Mapping[str, float]) -> str:
    """Return the quantiles of the deflection over the places in words; `percentiles` are in m, by percent."""
    values = {percent: 1e6 * size for percent, size in percentiles.items()}
    return (
        f"deflection: median {figure(values['50'])} µm, 90 % of the places {figure(values['5'])} to "
        f"{figure(values['95'])} µm, greatest {figure(values['100'])} µm"
    )


def _extremes_table(
    places: tuple[MapPlace, MapPlace], confidence: float, kinds: Sequence[JointKind], style: Style
) -> Table:
    """Return a table of the worst and the stiffest place: posture, deflection, compliance.

    `style` is that of the deflections.
    """
    micro = number_formatter(".3g", 1e6)
    deflections = [_show_deflection(place, style) for place in places]
    has_model_error = [place.with_model_error is not None for place in places]
    columns = [
        Column("", ["worst place", "stiffest place"], text=True),
        Column("place", [place.position for place in places], vector_formatter(".0f", 1e3), "mm"),
        _posture_column([place.joints for place in places], kinds),
        Column("deflection", deflections, show_cell, "µm"),
        Column("model error", [model_error_text(known) for known in has_model_error]),
        Column("compliance along", [place.compliance_along for place in places], micro, "µm/N"),
        Column("compliance across", [place.compliance_across for place in places], micro, "µm/N"),
    ]
    return Table(columns, caption=f"deflection with its {100 * confidence:g} % interval", upright=True)


def _show_deflection(place: MapPlace, style: Style) -> ShownEstimate:
    """Return the deflection of a place [µm] with its interval, which includes the model error if known."""
    interval = place.with_model_error or place.readings_only
    return show_estimate(place.deflection, interval, 1e6, style=style)


def _posture_column(postures: Sequence[Sequence[float]], kinds: Sequence[JointKind]) -> Column:
    """Return a column of postures [rad or m].

    A map that was stored without the kinds of the joints is of a robot with revolute joints only.
    """
    if kinds:
        texts = [posture_text(posture, kinds, 1) for posture in postures]
        return Column("controller's joints", texts, text=True)
    angles = [[degrees(position) for position in posture] for posture in postures]
    return Column("controller's angles", angles, vector_formatter(".1f"), "°")


def make_charts(result: MapResult) -> list[Chart]:
    """Return a chart of the quantiles of the deflection over the places; none if no place is reached."""
    names = [f"{percent} %" for percent in result.percentiles]
    series = {"deflection": [*result.percentiles.values()]}
    title = "Deflection that a fraction of the places does not exceed"
    chart = Chart(title, names, series, 1e6, "µm", "fraction of the places", quantity="deflection")
    return [chart] if names else []


def make_area_map(sheet: Sheet) -> Area:
    """Return a map of the deflection in one plane of the grid, which `plot` draws.

    The plane has the greatest deflection, and is normal to the axis of R0 along which the grid is shortest.
    """
    places = {axis: [1e3 * float(value) for value in sheet.columns[f"{axis} [m]"]] for axis in "xyz"}  # mm
    deflections = [nan if value is None else float(value) for value in sheet.columns["deflection [m]"]]
    normal = min("zyx", key=lambda axis: len(set(places[axis])))
    height = places[normal][_find_greatest(deflections)]
    in_plane = [i for i, height_of_place in enumerate(places[normal]) if height_of_place == height]
    first, second = [axis for axis in "xyz" if axis != normal]
    return Area(
        f"Deflection at {normal} = {height:.0f} mm",
        [places[first][i] for i in in_plane],
        [places[second][i] for i in in_plane],
        [deflections[i] for i in in_plane],
        (f"{first} [mm]", f"{second} [mm]", "deflection [µm]"),
        1e6,
    )


def _find_greatest(numbers: Sequence[float]) -> int:
    """Return the index of the greatest finite number; 0 if none is finite."""
    finite = [i for i, number in enumerate(numbers) if isfinite(number)]
    return max(finite, key=lambda i: numbers[i], default=0)


MAP: Final = Kind[Map, MapRequest](
    message=Map,
    request=MapRequest,
    options=MapOptions,
    prepare_work=_prepare_work,
    make_report=_make_report,
    sources=("run",),
    make_charts=make_charts,
    make_area_map=make_area_map,
    title="Map of a work area",
    stepped=True,
    examples=_EXAMPLES,
    files=(
        File(
            name="map.csv",
            description="all places with status, posture, deflection, intervals and compliance; the table "
            "is computed again, so keep the run",
            sheet=_places_sheet,
            made_of="work",
        ),
        File(
            name="map.npz",
            description="all places, with all digits",
            sheet=_places_sheet,
            made_of="work",
        ),
        File(
            name="map.json",
            description="the same by columns",
            sheet=_places_sheet,
            made_of="work",
        ),
    ),
    description="""Map a work area: deflection of the tool at each place, by the model of a run.

Each place gets the stiffest posture, or the posture nearest to a given one, within the joint
limits. `map.csv` and `map.npz` have all places.""",
)
