"""A map for people: how many places were reached, how far the tool bends there, and where most."""

from __future__ import annotations

from collections.abc import Callable
from math import degrees
from typing import Final

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from jointstiff.schemas.map import Map, MapPlace, MapResult
from jointstiff.service.tables.terminal import problem_text

_REASONS = {
    "out_of_reach": "out of reach",
    "joint_limits": "beyond the joints' limits",
    "unseen_joint": "load twists a joint that the readings say nothing of",
    "overloaded": "load beyond what springs are a model of",
}


def map_report(found: Map) -> RenderableType:
    """Counts first, then the worst and the stiffest place."""
    result = found.result
    if result is None:
        return problem_text(found.error) if found.error else Text(f"the map is {found.state}")
    return Group(*(Text(line) for line in _lines(result)), *_table(found, result))


def _lines(result: MapResult) -> list[str]:
    counts = result.counts.model_dump()
    without = ", ".join(f"{counts[name]} {reason}" for name, reason in _REASONS.items() if counts[name])
    lines = [f"{counts['reached']} of {result.places} places reached" + (f"; {without}" if without else "")]
    if result.quantiles:
        values = {each.share: 1e6 * each.deflection for each in result.quantiles}
        lines.append(
            f"deflection: median {values[0.5]:.3g} µm, 90 % of the places {values[0.05]:.3g} to "
            f"{values[0.95]:.3g} µm, greatest {values[1.0]:.3g} µm"
        )
    if result.extrapolated:
        lines.append(f"{result.extrapolated} places are beyond the loads or postures of the campaign")
    return [*lines, *result.remarks]


def _table(found: Map, result: MapResult) -> list[RenderableType]:
    if result.worst is None or result.stiffest is None:
        return []
    table = Table(caption=f"intervals at {100 * found.request.confidence:g} %", title_justify="left")
    table.add_column("")
    for heading in ("worst place", "stiffest place"):
        table.add_column(heading, justify="right")
    places = (result.worst, result.stiffest)
    for name, show in _ROWS.items():
        table.add_row(name, *(show(place) for place in places))
    return [table]


def _interval(ends: tuple[float, float] | None) -> str:
    return "—" if ends is None else f"{1e6 * ends[0]:.3g} to {1e6 * ends[1]:.3g}"


def _compliance(value: float | None) -> str:
    return "—" if value is None else f"{1e6 * value:.3g}"


def _numbers(values: tuple[float, ...] | list[float], digits: int) -> str:
    return "  ".join(f"{value:.{digits}f}" for value in values)


_ROWS: Final[dict[str, Callable[[MapPlace], str]]] = {
    "place [m]": lambda place: _numbers(place.position, 3),
    "controller's angles [°]": lambda place: _numbers([degrees(angle) for angle in place.joints], 1),
    "deflection [µm]": lambda place: f"{1e6 * place.deflection:.4g}",
    "readings only [µm]": lambda place: _interval(place.readings_only),
    "with model error [µm]": lambda place: _interval(place.with_model_error),
    "compliance along [µm/N]": lambda place: _compliance(place.compliance_along),
    "compliance across [µm/N]": lambda place: _compliance(place.compliance_across),
}
