"""A map for people and for spreadsheets: counts, the worst and the stiffest place; all places."""

from __future__ import annotations

from math import degrees
from typing import Final

import numpy as np

from jointstiff.schemas.map import Map, MapPlace, MapResult
from jointstiff.service.kinds.map.work import MapWork
from jointstiff.service.tables.report import Report, View
from jointstiff.service.tables.table import Column, Line, Part, Sheet, Table, ends, figure, number, numbers
from jointstiff.solver.predict.maps import STATUSES

_REASONS: Final = {
    "out_of_reach": "out of reach",
    "joint_limits": "beyond the joints' limits",
    "unseen_joint": "load twists a joint that the readings do not determine",
    "overloaded": "load beyond the range of the spring model",
    "not_followed": "too near a singularity to keep the branch of the given posture",
}


def report(job: Map, result: MapResult, _view: View) -> Report:
    """Return counts first, then the worst and the stiffest place."""
    counts = result.counts.model_dump()
    without = ", ".join(f"{counts[name]} {reason}" for name, reason in _REASONS.items() if counts[name])
    lines = [f"{counts['reached']} of {result.places} places reached" + (f"; {without}" if without else "")]
    if result.quantiles:
        values = {each.share: 1e6 * each.deflection for each in result.quantiles}
        lines.append(
            f"deflection: median {figure(values[0.5])} µm, 90 % of the places {figure(values[0.05])} to "
            f"{figure(values[0.95])} µm, greatest {figure(values[1.0])} µm"
        )
    if result.extrapolated:
        lines.append(f"{result.extrapolated} places are beyond the loads or postures of the campaign")
    parts: list[Part] = [Line(line) for line in [*lines, *result.remarks]]
    if result.worst is not None and result.stiffest is not None:
        parts.append(_extremes((result.worst, result.stiffest), job.request.confidence))
    return Report(parts)


def _extremes(places: tuple[MapPlace, MapPlace], confidence: float) -> Table:
    angles, micro = [[*map(degrees, each.joints)] for each in places], number(".3g", 1e6)
    interval = ends(".3g", 1e6)
    return Table(
        [
            Column("", ["worst place", "stiffest place"], text=True),
            Column("place", [each.position for each in places], numbers(".3f"), "m"),
            Column("controller's angles", angles, numbers(".1f"), "°"),
            Column("deflection", [each.deflection for each in places], number(".4g", 1e6), "µm"),
            Column("readings only", [each.readings_only for each in places], interval, "µm"),
            Column("with model error", [each.with_model_error for each in places], interval, "µm"),
            Column("compliance along", [each.compliance_along for each in places], micro, "µm/N"),
            Column("compliance across", [each.compliance_across for each in places], micro, "µm/N"),
        ],
        caption=f"intervals at {100 * confidence:g} %",
        upright=True,
    )


def places_sheet(work: MapWork) -> Sheet:
    """Return all places: status, place, posture, deflection, intervals, compliance; NaN for no number."""
    table, request = work.table, work.request
    direction, turn = np.divmod(table.orientation, request.turns)
    posed = ~np.isnan(table.joints[:, 0])
    columns = {"status": np.array(STATUSES)[table.status]}
    columns |= {f"{axis} [m]": work.places[:, i] for i, axis in enumerate("xyz")}
    columns["direction"] = np.where(posed, direction, np.nan)
    columns["turn"] = np.where(posed, turn, np.nan)
    columns |= {f"{name} [rad]": table.joints[:, j] for j, name in enumerate(work.robot.joint_names)}
    columns |= {f"d{axis} [m]": table.displacement[:, i] for i, axis in enumerate("xyz")}
    columns |= {
        "deflection [m]": table.length,
        "readings only low [m]": table.readings[:, 0],
        "readings only high [m]": table.readings[:, 1],
        "with model error low [m]": table.with_model_error[:, 0],
        "with model error high [m]": table.with_model_error[:, 1],
        "compliance along [m/N]": table.along,
        "compliance across [m/N]": table.across,
        "extrapolation [1]": np.where(np.isinf(table.extrapolation), np.nan, table.extrapolation),
    }
    return Sheet(columns, texts=frozenset({"status"}), digits=".10g")
