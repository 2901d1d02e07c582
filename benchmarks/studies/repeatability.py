"""Robots that do not come back exactly, measured in few postures or with one target, and with encoders.

Loads hang about their stated place as is assumed. An oracle knows the repeatability exactly: its intervals
are as narrow as honest ones can be. Readings come from springs that balance the load exactly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np

from benchmarks.designs import SIGMA
from benchmarks.report import Figure, Section
from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import SpringArm, default_arm
from jointstiff.simulator.campaign import TARGETS, deflections, plan_experiment
from jointstiff.simulator.equilibrium import equilibrium
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.fit.estimate import Estimate
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.measurements import (
    CommonUncertainty,
    EncoderReadings,
    Measurements,
    Scatter,
)
from jointstiff.solver.run import run as identify_and_judge
from tests.support.springs import readings_of, robot_of

__all__ = ["run"]

_STREAM: Final = 113
_CAMPAIGNS: Final = 20
_FULL: Final = 80
"""Campaigns of a row with `--all`: 480 joints."""
_CLEAN: Final = 40
_CLEAN_FULL: Final = 120
_REPEATABILITIES: Final = (0.0, 1e-5, 2e-5, 4e-5)
"""Standard deviations of a joint's angle from posture to posture [rad]."""
_ASSUMED: Final = CommonUncertainty(
    load_point=0.01, scale=0.01, assumed=frozenset({"load_point", "force_scale"})
)
_POINTS: FloatArray = np.array(list(TARGETS.values()))
_WITH_ENCODER: Final = (0, 1, 2)
_ENCODER_NOISE: Final = 5e-6


class Design(NamedTuple):
    """Size of a campaign."""

    name: str
    least: int  #: number of postures
    most: int
    targets: int


DESIGNS: Final = (
    Design("6 to 8 postures", 6, 8, 3),
    Design("one target", 12, 30, 1),
    Design("4 to 5 postures", 4, 5, 3),
)


@dataclass(frozen=True, eq=False)
class Campaign:
    """Readings with what is true."""

    arm: SpringArm
    measurements: Measurements


def simulate(design: Design, repeatability: float, seed: int, *, encoders: bool = False) -> Campaign:
    """Return a campaign with stated sigma, on an arm of random stiffnesses.

    Args:
        design: number of postures and targets.
        repeatability: standard deviation of a joint's angle from posture to posture [rad].
        seed: of arm, postures, loads and noise.
        encoders: whether three joints have an encoder, which sees the same turns as the targets.
    """
    generator = np.random.default_rng([seed, _STREAM, design.most, int(1e7 * repeatability)])
    arm = default_arm()
    arm = replace(arm, stiffnesses=arm.stiffnesses * generator.uniform(0.5, 2.0, 6))
    count = int(generator.integers(design.least, design.most + 1))
    force = 1500.0 * generator.uniform(0.6, 1.3)
    plan = plan_experiment(
        arm, configurations=count, load="pull", force=force, seed=int(generator.integers(1 << 30))
    )
    loads = plan.forces * (1.0 + _ASSUMED.scale * generator.standard_normal())
    places = plan.load_points + _ASSUMED.load_point * generator.standard_normal(3)
    true = replace(plan, forces=loads, load_points=places)
    points = _POINTS[: design.targets]
    turns = repeatability * generator.standard_normal(plan.joints.shape)
    unloaded = deflections(arm, plan.joints, *true.wrenches, points)[0]
    loaded = deflections(arm, plan.joints + turns, *true.wrenches, points)[1]
    noise = SIGMA * generator.standard_normal((2, *loaded.shape))
    stated: dict[str, Any] = {"sigma": SIGMA, "common_uncertainty": _ASSUMED, "moment": plan.moments}
    if encoders:
        bent = turns + equilibrium(arm, plan.joints + turns, *true.wrenches)
        stated["encoders"] = _read_encoders(bent, generator)
    change = loaded - unloaded + noise[1] - noise[0]
    stated_loads = (plan.joints, plan.forces, plan.load_points)
    return Campaign(arm, readings_of(*stated_loads, unloaded + noise[0], change, **stated))


def _read_encoders(bent: FloatArray, generator: np.random.Generator) -> EncoderReadings:
    """Return the readings of three encoders of the change (N, n) of the joints' angles [rad]."""
    noise = np.sqrt(2.0) * _ENCODER_NOISE * generator.standard_normal(bent.shape)
    present = np.isin(np.arange(bent.shape[1]), _WITH_ENCODER) & np.ones(bent.shape, dtype=np.bool_)
    return EncoderReadings(np.where(present, bent + noise, 0.0), present, _ENCODER_NOISE)


class Outcome(NamedTuple):
    """Intervals of one campaign."""

    holds: list[bool]  #: whether each joint's interval contains the truth
    width: list[float]  #: of each joint's interval, relative to that of the oracle
    found: float  #: standard deviation of a joint's angle that the fit accounts for [rad]


def _list_intervals(estimate: Estimate) -> Iterator[tuple[float, float]]:
    """Yield the interval of each joint's compliance; an interval without numbers contains nothing."""
    for joint in estimate.joints:
        yield joint.compliance_interval or (np.nan, np.nan)


def _identify(campaign: Campaign, measurements: Measurements, repeatability: float) -> Outcome:
    """Identify a campaign as it is stated, and as an oracle does."""
    robot = robot_of(campaign.arm)
    settings = Settings.from_options(RunOptions(), robot)
    joints = JointsAlone(Rows(robot, measurements), settings)
    noise = (1.0,) * robot.n if measurements.encoders is not None else ()
    known = Scatter(repeatability / SIGMA, encoders=noise)
    oracle = identify(Rows(robot, replace(measurements, scatter=known, repeatability=None)), settings)
    ends = np.array(list(_list_intervals(joints.estimate)))
    width = np.ptp(ends, axis=1) / np.ptp(np.array(list(_list_intervals(oracle))), axis=1)
    truth = campaign.arm.compliances
    holds = (ends[:, 0] <= truth) & (truth <= ends[:, 1])
    found = joints.measurements.scatter.joints * (joints.estimate.sigma or 0.0)
    return Outcome(holds.tolist(), width.tolist(), found)


class Row(NamedTuple):
    """Outcomes of many campaigns."""

    holds: float  #: intervals that contain the truth [%]
    width: float  #: median, relative to that of the oracle
    cells: tuple[str, ...]


def _summarise(what: str, outcomes: Sequence[Outcome]) -> Row:
    """Return share, median width, and the cells of a table."""
    holds = 100.0 * float(np.mean([each.holds for each in outcomes]))
    width = float(np.nanmedian([each.width for each in outcomes]))
    found = 1e6 * float(np.median([each.found for each in outcomes]))
    cells = (what, f"{6 * len(outcomes)}", f"{holds:.1f}", f"{width:.2f}", f"{found:.1f}")
    return Row(holds, width, cells)


_COLUMNS: Final = (
    "campaigns",
    "joints",
    "hold the truth [%]",
    "width to an oracle's",
    "accounted for [µrad]",
)


def _draw(design: Design, repeatability: float, seeds: range, *, is_stated: bool) -> list[Outcome]:
    """Identify campaigns with sigma stated, or nothing."""
    outcomes = []
    for seed in seeds:
        campaign = simulate(design, repeatability, seed)
        measurements = campaign.measurements
        if not is_stated:
            measurements = replace(measurements, sigma=None)
        outcomes.append(_identify(campaign, measurements, repeatability))
    return outcomes


def _study_designs(seeds: range) -> Section:
    """Study few postures and one target, with sigma stated and without."""
    rows = []
    for design in DESIGNS:
        for repeatability in _REPEATABILITIES:
            for is_stated in (True, False):
                outcomes = _draw(design, repeatability, seeds, is_stated=is_stated)
                statement = "sigma stated" if is_stated else "nothing stated"
                rows.append(_summarise(f"{design.name}, {1e6 * repeatability:g} µrad, {statement}", outcomes))
    return Section(
        title=f"Robots that do not come back: {len(seeds)} campaigns each",
        columns=_COLUMNS,
        rows=tuple(row.cells for row in rows),
        figures=(
            Figure(
                "few postures, one target: least coverage", min(r.holds for r in rows), "at least", 92.0, " %"
            ),
            Figure("few postures, one target: greatest", max(r.holds for r in rows), "at most", 98.0, " %"),
            Figure("greatest median width, to an oracle's", max(r.width for r in rows), "at most", 1.15),
        ),
        notes=("three targets unless one is said, 20 µm; load point off by 10 mm, force by 1 %, as assumed",),
    )


def _study_brochures(seeds: range) -> Section:
    """Study a stated repeatability that is half or double the truth."""
    rows, farthest = [], 0.0
    for repeatability in _REPEATABILITIES[1:]:
        shares = []
        for factor in (1.0, 0.5, 2.0):
            outcomes = []
            for seed in seeds:
                campaign = simulate(DESIGNS[0], repeatability, seed)
                stated = factor * repeatability
                scatter = Scatter(stated / SIGMA)
                measurements = replace(campaign.measurements, repeatability=stated, scatter=scatter)
                outcomes.append(_identify(campaign, measurements, repeatability))
            row = _summarise(f"{1e6 * repeatability:g} µrad, {factor:g} times as much stated", outcomes)
            rows.append(row)
            shares.append(row.holds)
        farthest = max(farthest, *(abs(share - shares[0]) for share in shares[1:]))
    return Section(
        title=f"A stated repeatability that is wrong: {len(seeds)} campaigns each of 6 to 8 postures",
        columns=_COLUMNS,
        rows=tuple(row.cells for row in rows),
        figures=(
            Figure(
                "stated repeatability: least coverage", min(r.holds for r in rows), "at least", 92.0, " %"
            ),
            Figure("wrong by a factor of 2: change of coverage", farthest, "at most", 2.0, " %"),
        ),
    )


def _study_encoders(seeds: range) -> Section:
    """Study encoders, which see the same turns as the targets."""
    rows = []
    for design in (DESIGNS[0], Design("12 to 19 postures", 12, 19, 3)):
        for repeatability in _REPEATABILITIES[2:]:
            outcomes = []
            for seed in seeds:
                campaign = simulate(design, repeatability, seed, encoders=True)
                outcomes.append(_identify(campaign, campaign.measurements, repeatability))
            rows.append(_summarise(f"{design.name}, {1e6 * repeatability:g} µrad", outcomes))
    return Section(
        title=f"Encoders behind three gearboxes: {len(seeds)} campaigns each",
        columns=_COLUMNS,
        rows=tuple(row.cells for row in rows),
        figures=(Figure("encoders: least coverage", min(r.holds for r in rows), "at least", 91.0, " %"),),
    )


def _study_clean(count: int) -> Section:
    """Count runs of campaigns without any mistake that name a cause."""
    rows, named = [], 0
    for repeatability in (0.0, 2e-5):
        accused = 0
        for seed in range(count):
            design = DESIGNS[0] if seed % 2 else Design("12 to 19 postures", 12, 19, 3)
            campaign = simulate(design, repeatability, 10_000 + seed)
            result = identify_and_judge(robot_of(campaign.arm), campaign.measurements, RunOptions())
            accused += result.assessment.verdict == "do_not_use"
        rows.append((f"{1e6 * repeatability:g} µrad", str(count), str(accused)))
        named += accused
    return Section(
        title="Campaigns without any mistake",
        columns=("repeatability", "campaigns", "do not use"),
        rows=tuple(rows),
        figures=(Figure("sound campaigns that must not be used", named, "at most", 0),),
    )


def run(*, quick: bool, full: bool) -> list[Section]:
    """Draw campaigns of each kind."""
    seeds = range(2 if quick else _FULL if full else _CAMPAIGNS)
    clean = 2 if quick else _CLEAN_FULL if full else _CLEAN
    return [_study_designs(seeds), _study_brochures(seeds), _study_encoders(seeds), _study_clean(clean)]
