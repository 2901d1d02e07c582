"""Sections of a run's report: method with deviations, adjustment, conditions and traceability."""

from __future__ import annotations

from collections.abc import Iterator
from statistics import fmean
from typing import Final

import numpy as np

from jointstiff.schemas.measurement.measurement_set import MeasurementSetDocument
from jointstiff.schemas.measurement.noise import Noise
from jointstiff.schemas.report import Laboratory
from jointstiff.schemas.run.run import RunRequest
from jointstiff.service.conversion.units import FORCE, LENGTH
from jointstiff.service.exporting.model import ExportedModel
from jointstiff.service.reports import statements
from jointstiff.service.reports.document import Section
from jointstiff.service.reports.wording import NOT_STATED, percent
from jointstiff.service.tables.numbers import figure, rounded
from jointstiff.service.tables.terminal import METHOD_NAMES

_TARGETS_NAMED: Final = 8


def method(model: ExportedModel, laboratory: Laboratory | None) -> Section:
    """Return the method, and what was done otherwise than by default."""
    request, version = model.run.request, model.run.provenance.versions.get("jointstiff", "")
    constraint = "compliances not negative" if request.positive else "without constraints"
    stated = None if laboratory is None else laboratory.method
    way = (
        "Identification of joint compliances from readings of targets before and under load, "
        f"{METHOD_NAMES[request.method]}, {request.weighting.replace('_', ' ')} weights, {constraint}"
    )
    masses = []
    if request.weight is not None:
        way = (
            "Identification of joint compliances, geometry and sag under the own weight from laser-tracker "
            f"positions of targets and masses within bounds, {constraint}"
        )
        bodies = [
            f"{body.name} {body.mass:g} kg ({body.least:.4g} to {body.most:.4g})"
            for body in model.robot.bodies
        ]
        masses = [("Masses with their bounds", "; ".join(bodies))]
    return Section(
        statements.METHOD,
        facts=[
            (
                "Method",
                f"{way}; jointstiff {version}, as its documentation states (docs/method.md).",
            ),
            *masses,
            ("Procedure of the laboratory", stated or NOT_STATED),
        ],
        notes=[f"Deviation: {line}" for line in _deviations(request)] or ["Deviations: none."],
    )


def _deviations(request: RunRequest) -> Iterator[str]:
    """Yield options that differ from the defaults, in words."""
    chains = "; ".join(" ≥ ".join(chain) for chain in request.stiffness_order)
    sentences = (
        (request.leave_out, f"observations left out: {', '.join(request.leave_out)}."),
        (not request.positive, "negative compliances were allowed."),
        (request.loss not in {"automatic", "squared"}, f"loss {request.loss}: large residuals count less."),
        (request.priors, f"prior knowledge of {', '.join(request.priors)} was used."),
        (request.stiffness_bounds, f"stiffness of {', '.join(request.stiffness_bounds)} was bounded."),
        (request.stiffness_order, f"an order of stiffness was required: {chains}."),
        (
            request.elasticity not in {"automatic", "joints"},
            f"elastic elements: {request.elasticity.replace('_', ' ')}.",
        ),
        (request.complementary_stiffness == "neglected", "the complementary stiffness is neglected."),
    )
    yield from (text for differs, text in sentences if differs)


def adjustment(model: ExportedModel) -> Section:
    """Return deflections as found, and as the model would leave them."""
    residuals = model.result.residuals
    facts = []
    if residuals:
        before = 1e3 * fmean(float(np.linalg.norm(each.deflection)) for each in residuals)
        after = 1e3 * fmean(float(np.linalg.norm(each.residual)) for each in residuals)
        facts = [
            ("Mean deflection, before: as measured", f"{rounded(before)} mm"),
            ("Mean deflection, after compensation by the model, computed", f"{rounded(after)} mm"),
            ("Share that the model compensates", percent(model.result.compensation)),
        ]
    return Section(
        statements.ADJUSTMENT,
        facts=facts,
        paragraphs=[
            "No adjustment or repair between the readings is stated: all results are as found. The second "
            "number is computed from the same readings and is no measurement."
        ],
    )


def traceability(readings: MeasurementSetDocument, laboratory: Laboratory | None) -> Section:
    """Return conditions, instrument and what its uncertainty rests on."""
    conditions = readings.conditions or (None if laboratory is None else laboratory.conditions)
    chain = None if laboratory is None else laboratory.traceability
    return Section(
        statements.TRACEABILITY,
        facts=[
            ("Conditions", conditions or NOT_STATED),
            ("Instrument", readings.instrument or NOT_STATED),
            ("Metrological traceability", chain or NOT_STATED),
            ("Uncertainty of readings and load", " ".join(_noise(readings))),
            ("Position loop closed by", f"{readings.encoders} encoders"),
            ("Observations", f"{len(readings.observations)}"),
            ("Force on the robot", _force(readings)),
            ("Load point in the flange frame", _load_point(readings)),
            ("Targets read", _targets(readings)),
        ],
    )


def _force(readings: MeasurementSetDocument) -> str:
    """Return the least and the greatest magnitude of the force over the observations."""
    newtons = FORCE[readings.units.force]
    sizes = [newtons * float(np.linalg.norm(each.force)) for each in readings.observations]
    least, greatest = rounded(min(sizes)), rounded(max(sizes))
    size = f"{greatest} N" if least == greatest else f"{least} N to {greatest} N"
    moments = any(each.moment is not None and any(each.moment) for each in readings.observations)
    return f"{size}, and moments" if moments else size


def _load_point(readings: MeasurementSetDocument) -> str:
    if readings.load_point is None or any(each.load_point is not None for each in readings.observations):
        return "stated with each observation"
    millimetres = 1e3 * LENGTH[readings.units.length]
    return f"({', '.join(f'{figure(millimetres * value)}' for value in readings.load_point)}) mm"


def _targets(readings: MeasurementSetDocument) -> str:
    names = list(dict.fromkeys(each.target for one in readings.observations for each in one.readings))
    shown = ", ".join(names[:_TARGETS_NAMED])
    return f"{len(names)}: {shown}{', …' if len(names) > _TARGETS_NAMED else ''}"


def _noise(readings: MeasurementSetDocument) -> Iterator[str]:
    noise, length = readings.noise, LENGTH[readings.units.length]
    if noise is not None and noise.refuted:
        yield "estimated from the residuals, which refuted the noise as stated."
    elif noise is None or (noise.sigma is None and noise.instrument is None):
        by_reading = any(
            reading.sigma is not None or reading.loaded_covariance is not None
            for observation in readings.observations
            for reading in observation.readings
        )
        yield "stated with each reading." if by_reading else "estimated from the residuals."
    if noise is not None:
        if noise.sigma is not None:
            refuted = "Stated and refuted: " if noise.refuted else ""
            yield f"{refuted}σ = {rounded(1e6 * length * noise.sigma)} µm of a coordinate of a reading."
        if noise.instrument is not None and not noise.refuted:
            yield "from the data sheet of the instrument."
        yield from _common(noise, 1e3 * length)
    if noise is None or noise.force is None:
        yield "Force: no uncertainty stated, counted as exact."


def _common(noise: Noise, millimetres: float) -> Iterator[str]:
    """Yield what all observations share, with lengths in mm for those of the set."""
    if noise.force is not None:
        yield f"Force: relative {noise.force.scale:g}, direction {rounded(1e3 * noise.force.direction)} mrad."
    for name, value in (("Load point", noise.load_point), ("Places of the targets", noise.target_places)):
        if value is not None:
            yield f"{name}: {rounded(millimetres * value)} mm a coordinate."
    if noise.axes is not None:
        yield (
            f"Axes of the robot's model: {rounded(millimetres * noise.axes.position)} mm across, "
            f"{rounded(1e3 * noise.axes.direction)} mrad."
        )
