"""Causes of what joints alone leave unexplained: planted, named, fitted beside the joints; clean ones silent.

Readings come from springs that balance the load exactly; what is planted is done to loads, angles and places
of that simulator, never by the solver's own terms.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.report import Figure, Part, Section
from benchmarks.studies.endings import study_pairs, study_single_readings
from benchmarks.studies.planted import (
    CAUSES,
    STREAM,
    Plant,
    Planted,
    design_campaign,
    plant_curved_springs,
    read,
)
from jointstiff.schemas.options import RunOptions
from jointstiff.simulator.campaign import SpringArm
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.evidence.fitted_causes import fit_causes
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.block import fitted_errors
from jointstiff.solver.mechanics.measurements import DifferenceNoise, Instrument, Measurements
from tests.support.springs import robot_of

__all__ = ["Outcome", "identify_with_causes", "run"]

_STATION = 6e-5
"""Standard deviation of a station's error along each axis [m]."""
_BEYOND = 3.0
"""Standard uncertainties beyond which a joint is wrong."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of a campaign: causes named, whether links are tried, and joints whose intervals hold."""

    named: tuple[str, ...]
    waits: bool
    covered: int = 0
    joints: int = 0
    worst: float = 0.0  #: largest error of a joint, in standard uncertainties


def identify_with_causes(arm: SpringArm, measured: Measurements) -> Outcome:
    """Identify the joints, and once more with the causes that are named."""
    robot = robot_of(arm)
    settings = Settings.from_options(RunOptions(), robot)
    joints = JointsAlone(Rows(robot, measured), settings)
    estimate, screening = joints.estimate, joints.screening
    named = [(cause.suspect.name, cause.suspect.first) for cause in screening.causes]
    if named:
        measured = fit_causes(Rows(robot, measured), named)
        estimate = JointsAlone(Rows(robot, measured), settings).estimate
    truth = arm.compliances
    ends = [
        (joint.compliance_interval, truth[j])
        for j, joint in enumerate(estimate.joints)
        if joint.compliance_interval is not None
    ]
    covered = sum(low <= c <= high for (low, high), c in ends)
    worst = max(
        abs((joint.compliance or 0.0) - truth[j]) / joint.standard_uncertainty
        for j, joint in enumerate(estimate.joints)
        if joint.standard_uncertainty
    )
    names = tuple(name for name, _ in named)
    return Outcome(names, screening.links_need_validation, covered, len(ends), worst)


def run(*, quick: bool, part: Part) -> list[Section]:
    """Plant each cause, name it and fit it beside the joints; then read clean arms."""
    seeds, clean = part.of(4 if quick else 30), part.of(8 if quick else 200)
    rows, figures, right = [], [], 0
    for cause, plant in CAUSES.items():
        outcomes = [_planted(plant, seed) for seed in seeds]
        alone = sum(each.named == (cause,) for each in outcomes)
        tied = sum(cause in each.named for each in outcomes) - alone
        right += alone + tied
        others = Counter(", ".join(each.named) or "none" for each in outcomes if cause not in each.named)
        joints = sum(each.joints for each in outcomes)
        share = 100.0 * sum(each.covered for each in outcomes) / max(1, joints)
        instead = ", ".join(f"{name} {count}" for name, count in others.items())
        rows.append((cause, str(alone), str(tied), instead, f"{share:.1f} of {joints}"))
        what = f"{cause}: intervals that hold after the mend"
        figures.append(Figure(what, share, "at least", 93.0, " %"))
    named = 100.0 * right / (len(seeds) * len(CAUSES))
    silent = [_clean(seed) for seed in clean]
    accused, waiting = sum(bool(each.named) for each in silent), sum(each.waits for each in silent)
    figures += [
        Figure("planted causes named, or in a tie", named, "at least", 90.0, " %"),
        Figure.none(f"of {len(clean)} clean campaigns, causes named", accused),
        Figure.none(f"of {len(clean)} clean campaigns, waiting for a cross-validation", waiting),
    ]
    return [
        Section(
            title=f"{len(seeds)} campaigns with each cause planted; {len(clean)} clean ones",
            columns=("planted", "named alone", "in a tie", "named instead", "intervals that hold [%]"),
            rows=tuple(rows),
            figures=tuple(figures),
            notes=("half of the clean campaigns state a data sheet of the wrong shape",),
        ),
        *(_study_further(quick=quick) if part.number == 1 else []),
    ]


def _planted(plant: Plant, seed: int) -> Outcome:
    generator = np.random.default_rng([seed, STREAM, 1])
    design = design_campaign(seed)
    return identify_with_causes(
        design.arm, read(plant(Planted.clean(design), generator), generator, sigma=seed % 2 == 0)
    )


def _clean(seed: int) -> Outcome:
    """Read a clean arm; every other campaign states a data sheet of the wrong shape."""
    generator = np.random.default_rng([seed, STREAM, 2])
    design = design_campaign(1000 + seed)
    measured = read(Planted.clean(design), generator, sigma=True)
    if seed % 2:
        sheet = Instrument((4.0, 1.0, 1.5), 3e-6, 1e-6, 1e-5, 5e-6)
        noise = DifferenceNoise.from_instrument(sheet, robot_of(design.arm), measured)
        measured = replace(measured, sigma=noise.sigma, covariance=noise.covariance)
    return identify_with_causes(design.arm, measured)


def _study_further(*, quick: bool) -> list[Section]:
    """Return the studies that are not divided into parts."""
    return [
        _study_curved_springs(quick=quick),
        study_pairs(quick=quick),
        study_single_readings(quick=quick),
        _study_shared_errors(quick=quick),
    ]


def _study_curved_springs(*, quick: bool) -> Section:
    """Plant springs that harden; count how often they are named, and how far joints are off afterwards."""
    names, off = Counter[str](), []
    seeds = range(4 if quick else 40)
    for seed in seeds:
        generator, design = np.random.default_rng([seed, STREAM, 4]), design_campaign(3000 + seed)
        planted = plant_curved_springs(Planted.clean(design), generator)
        outcome = identify_with_causes(design.arm, read(planted, generator, sigma=seed % 2 == 0))
        names[" or ".join(sorted(set(outcome.named))) or "none"] += 1
        off.append(outcome.worst)
    right = sum(
        count for name, count in names.items() if name in ("curved_springs", "curved_springs or play")
    )
    within = sum(each <= _BEYOND for each in off)
    return Section(
        title=f"{len(seeds)} campaigns with springs that harden",
        columns=("named", "campaigns"),
        rows=tuple((name, str(count)) for name, count in names.most_common()),
        figures=(
            Figure(
                "curved springs named, or in a tie with play",
                100.0 * right / len(seeds),
                "at least",
                90.0,
                " %",
            ),
            Figure(
                f"curved springs: of {len(seeds)}, within 3 u after the mend",
                within,
                "at least",
                0.9 * len(seeds),
            ),
        ),
    )


def _shift_errors(seed: int) -> FloatArray:
    """Fit a shift under a station whose error is new in each posture; return errors in claimed uncertainties.

    The targets of a posture share the station's error of 60 µm, three times the noise of a coordinate.
    """
    generator = np.random.default_rng([seed, STREAM, 3])
    design = design_campaign(2000 + seed)
    moved = 1e-4 * np.array([1.0, -0.5, 0.5])
    station = _STATION * generator.standard_normal((len(design.loaded), 1, 3))
    measured = read(Planted.clean(design).move(moved + station), generator, sigma=True)
    fitted = fitted_errors(fit_causes(Rows(robot_of(design.arm), measured), [("shift", None)]))
    return np.asarray((fitted.unknowns[0] - moved) / np.linalg.norm(fitted.root, axis=1))


def _study_shared_errors(*, quick: bool) -> Section:
    """Compare what is claimed of a shift with its true error, where the targets of a posture share errors."""
    errors = np.array([_shift_errors(seed) for seed in range(6 if quick else 100)])
    ratio = float(np.sqrt(np.mean(errors**2)))
    return Section(
        title=f"A shift fitted under a station of {1e6 * _STATION:.0f} µm",
        columns=("errors of the shift", "root mean square, in claimed uncertainties"),
        rows=((str(errors.size), f"{ratio:.2f}"),),
        figures=(
            Figure("shift under a station of 60 µm: true over claimed uncertainty", ratio, "at least", 0.85),
            Figure("shift under a station of 60 µm: true over claimed uncertainty", ratio, "at most", 1.15),
        ),
    )
