"""A geometry for people: findings, frames, wrist, links; each number with its uncertainty and unit."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, floor, isfinite, log10, sqrt

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from jointstiff.schemas.geometry.message import Geometry
from jointstiff.schemas.geometry.result import (
    BaseFrameResult,
    Drift,
    GeometryResult,
    LinkComparison,
    PoseEvidence,
    SweepEvidence,
    WristResult,
)
from jointstiff.service.tables.terminal import problem_text
from jointstiff.service.tables.verdict import remedies, to_do_lines, verdict_lines

_MILLI, _MICRO = 1e3, 1e6
_CONTROLLER_LEVEL = 0.01
"""Probability below which the controller's angles do not fit."""
_LEAST_PROBABILITY = 1e-6
"""Less is no different for people."""


def geometry_report(geometry: Geometry, *, details: bool = False) -> RenderableType:
    """Lay out the verdict, the axes, the links and what to do; with details all evidence."""
    result = geometry.result
    if result is None:
        return problem_text(geometry.error) if geometry.error else Text(f"the geometry is {geometry.state}")
    parts: list[RenderableType] = [*verdict_lines(result.assessment, details=details), _axes(result)]
    if details:
        parts += _evidence(result)
    if result.links:
        parts.append(_links(result.links))
    parts.append(Text("\n".join(f"  {line}" for line in _summary(result, details=details))))
    notes = [finding for finding in result.findings if finding.severity == "note"]
    parts += [Text(f"  {f.where}: {f.message}; {f.remedy}", style="dim") for f in notes if details]
    return Group(*parts, *to_do_lines(remedies(result.assessment), details=details))


def _evidence(result: GeometryResult) -> list[RenderableType]:
    """Return what the axes rest on, and what follows from them beside the links."""
    parts: list[RenderableType] = []
    if result.sweeps:
        parts.append(_sweeps(result.sweeps))
    if result.poses is not None:
        parts.append(_poses(result.poses))
    parts += [_frame(result.base_frame), _targets(result)]
    if result.wrist is not None:
        parts.append(_wrist(result.wrist))
    if result.drift is not None:
        parts.append(_drift(result.drift))
    return parts


def _axes(result: GeometryResult) -> Table:
    table = Table(
        title="Axes at model angle zero, in R0",
        caption="points in mm; u: largest standard uncertainty across the axis, and of its direction",
        box=SIMPLE_HEAD,
        padding=0,
        show_edge=False,
    )
    for heading in ("axis", "x", "y", "z", "direction", "u [µm]", "u [µrad]"):
        table.add_column(heading, justify="left" if heading == "axis" else "right")
    for axis in result.axes:
        direction = " ".join(f"{round(part, 5) + 0.0:+.5f}" for part in axis.base.direction)
        table.add_row(
            Text(axis.name),
            *(f"{_MILLI * part:.3f}" for part in axis.base.point),
            direction,
            _micro(axis.position_uncertainty),
            _micro(axis.direction_uncertainty),
        )
    return table


def _sweeps(sweeps: Sequence[SweepEvidence]) -> Table:
    table = _table(
        "Sweeps, each fitted separately",
        "residuals by target, root mean square in µm; scale: rotation of the joint over that of "
        "the controller",
        ("joint", "arc", "positions", "scale", "χ²/dof", "radial", "axial"),
    )
    for sweep in sweeps:
        table.add_row(
            Text(sweep.joint),
            f"{degrees(sweep.arc):.1f}°",
            str(sweep.positions),
            f"{sweep.angle_scale:.5f}",
            f"{sweep.variance_factor:.2f}",
            Text(" ".join(_micro(target.radial_rms) for target in sweep.targets)),
            Text(" ".join(_micro(target.axial_rms) for target in sweep.targets)),
        )
    return table


def _poses(poses: PoseEvidence) -> Text:
    lines = [
        f"{poses.positions} poses determine {poses.determined} of {poses.unknowns} unknowns; residual "
        f"{_MICRO * poses.rms_residual:.1f} µm rms of a coordinate"
    ]
    if poses.held_out_rms is not None:
        lines.append(f"poses left out of the fit are predicted to {_MICRO * poses.held_out_rms:.1f} µm rms")
    lines += [f"not determined: {', '.join(names)}" for names in poses.only_together]
    return Text("\n".join(f"  {line}" for line in lines))


def _frame(frame: BaseFrameResult) -> Table:
    transform = frame.transform_tracker_to_base
    table = _table(
        f"Tracker to R0, placed by {'the nominal model' if frame.by == 'nominal' else 'the axes'}",
        "y = R x + t; t in mm; u: standard uncertainty of a translation in µm and of a rotation in "
        "µrad, axes of R0",
        ("", "R", "t", "u shift", "u turn"),
    )
    spread = [None] * 6 if frame.covariance is None else [sqrt(frame.covariance[i][i]) for i in range(6)]
    for i, name in enumerate("xyz"):
        table.add_row(
            name,
            " ".join(f"{part:+.7f}" for part in transform.rotation[i]),
            f"{_MILLI * transform.translation[i]:.3f}",
            _micro(spread[i]),
            _micro(spread[3 + i]),
        )
    return table


def _targets(result: GeometryResult) -> Table:
    table = _table(
        "Targets in the flange frame",
        "in mm, with the standard uncertainty of the last digits",
        ("target", "x", "y", "z"),
    )
    for target in result.targets:
        C = target.covariance
        spread = [None if C is None else sqrt(C[i][i]) for i in range(3)]
        cells = (_concise(_MILLI * p, u and _MILLI * u) for p, u in zip(target.position, spread, strict=True))
        table.add_row(Text(target.name), *cells)
    return table


def _wrist(wrist: WristResult) -> Group:
    table = _table(
        "Wrist centre, in R0",
        "in mm, with the standard uncertainty of the last digits; weight in the combined centre",
        ("by", "x", "y", "z", "weight"),
    )
    centres = [(e.way, e, f"{e.weight:.2f}") for e in wrist.estimates] + [("combined", wrist.combined, "")]
    for way, centre, weight in centres:
        spread = [sqrt(centre.base_covariance[i][i]) for i in range(3)]
        cells = (_concise(_MILLI * p, _MILLI * u) for p, u in zip(centre.base, spread, strict=True))
        table.add_row(way, *cells, weight)
    lines = [
        f"{pair.first} and {pair.second} are {_MICRO * pair.distance:.1f} µm apart (by chance: "
        f"{pair.probability:.2g})"
        for pair in wrist.distances
    ]
    lines.append(_miss(wrist))
    return Group(table, Text("\n".join(f"  {line}" for line in lines)))


def _miss(wrist: WristResult) -> str:
    applies = "applies" if wrist.decoupled_method else "does not apply"
    return (
        f"the last three axes miss each other by {_MICRO * wrist.miss_distance:.1f} ± "
        f"{_MICRO * wrist.miss_uncertainty:.1f} µm: the decoupled method {applies}"
    )


def _links(links: Sequence[LinkComparison]) -> Table:
    table = _table(
        "Links, nominal and identified",
        "lengths in mm, angles in mrad; difference with the standard uncertainty of its last digits",
        ("link", "after", "nominal", "identified", "difference"),
    )
    for link in links:
        uncertainty = link.standard_uncertainty
        table.add_row(
            link.quantity,
            Text(link.joint),
            f"{_MILLI * link.nominal:.3f}",
            f"{_MILLI * link.identified:.3f}" if uncertainty is not None else "not determined",
            _concise(_MILLI * link.difference, uncertainty and _MILLI * uncertainty)
            if uncertainty is not None
            else "—",
        )
    return table


def _drift(drift: Drift) -> Text:
    size = sqrt(sum(part**2 for part in drift.displacement))
    turn = sqrt(sum(part**2 for part in drift.rotation))
    verdict = "beyond noise" if drift.significant else "within noise"
    return Text(
        f"  base targets: moved by {_MICRO * size:.1f} µm at the robot and turned by "
        f"{_MICRO * turn:.1f} µrad, {verdict} (by chance: {drift.probability:.2g})"
    )


def _summary(result: GeometryResult, *, details: bool) -> list[str]:
    goodness = result.goodness
    lines = [
        f"sigma of a coordinate {_MICRO * goodness.sigma:.1f} µm ({goodness.sigma_source}), χ²/dof "
        f"{goodness.variance_factor:.2f} with {goodness.degrees_of_freedom} degrees of freedom"
    ]
    if goodness.agreement_probability is not None:
        fits = "does not fit" if result.fit == "one_by_one" else "fits"
        lines.append(f"one robot {fits} all sweeps ({_chance(goodness.agreement_probability)})")
    if goodness.controller_probability is not None:
        fit = "fit" if goodness.controller_probability >= _CONTROLLER_LEVEL else "do not fit"
        lines.append(
            f"the controller's angles {fit} the readings ({_chance(goodness.controller_probability)})"
        )
    if result.no_wrist is not None:
        lines.append(f"no wrist centre: {result.no_wrist}")
    if result.wrist is not None and not details:
        lines.append(_miss(result.wrist))
    if details:
        tables = (f"{table.convention} {_MICRO * table.deviation:.1f} µm" for table in result.dh)
        lines.append(f"deviation of the DH tables (see --json): {', '.join(tables)}")
    return lines


def _chance(probability: float) -> str:
    """Return the probability that noise alone makes a fit so bad."""
    return f"noise alone fits no better with probability {max(probability, _LEAST_PROBABILITY):.1g}" + (
        " or less" if probability < _LEAST_PROBABILITY else ""
    )


def _table(title: str, caption: str, headings: Sequence[str]) -> Table:
    table = Table(title=title, caption=caption)
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="right" if number else "left")
    return table


def _micro(value: float | None) -> str:
    if value is None:
        return "—"
    return f"{_MICRO * value:.3g}"


def _concise(value: float, uncertainty: float | None) -> str:
    """With the standard uncertainty in units of the last digits (GUM, 7.2.2)."""
    if not uncertainty or not isfinite(uncertainty):
        return f"{value:.4f}"
    decimals = max(0, 1 - floor(log10(uncertainty)))
    return f"{value:.{decimals}f}({round(uncertainty * 10**decimals)})"
