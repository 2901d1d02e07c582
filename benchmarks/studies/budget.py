"""Uncertainty budgets beside Monte Carlo, and their coverage where load and places are off.

Exact springs. By name only: it takes five minutes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.campaigns import default_robot
from benchmarks.designs import SIGMA, Design, planned_design, with_compliances
from benchmarks.report import Figure, Section
from benchmarks.studies.verdicts import CONFIDENCE, METHODS, Campaign, Verdicts, Way, judge
from jointstiff import identify
from jointstiff.schemas.run import Budget
from jointstiff.simulator import (
    TARGETS,
    SpringArm,
    default_arm,
    deflections,
    linear_deflections,
    simulate_campaign,
)
from jointstiff.simulator.campaign import Document
from jointstiff.simulator.elastic_links import beam_arm, elastic_campaign
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.evidence.estimate import UncertaintyBudget
from jointstiff.solver.readings.measurements import CommonUncertainty, Measurements

__all__ = ["KINDS", "expanded_by_monte_carlo", "expanded_by_product", "headline", "run", "wrong_campaigns"]

DESIGNS, DRAWS = 20, 100
MONTE_CARLO_DRAWS = 100_000
KINDS = {
    "scale 1 %": CommonUncertainty(scale=0.01),
    "scale 5 %": CommonUncertainty(scale=0.05),
    "direction 5 mrad": CommonUncertainty(direction=5e-3),
    "scale 1 %, targets 1 mm": CommonUncertainty(scale=0.01, target_places=1e-3),
    "scale 1 %, direction 5 mrad, load point 2 mm, targets 1 mm": CommonUncertainty(0.01, 5e-3, 2e-3, 1e-3),
}
_HEADLINES = {
    "joints alone, 24 postures": (24, 0.0),
    "joints alone, 10 postures": (10, 0.0),
    "links bend 3 % of the beams, 24 postures": (24, 1.0 / 30.0),
    "links bend as beams, 24 postures": (24, 1.0),
}
"""Postures, and the links' compliance relative to the beams of the simulator."""
_MANY = 400
_STREAM = 21
_POINTS: FloatArray = np.array(list(TARGETS.values()))


def run(*, quick: bool) -> list[Section]:
    """Expanded uncertainties beside Monte Carlo; each kind of uncertainty, stated and ignored."""
    return [
        _monte_carlo(500 if quick else MONTE_CARLO_DRAWS),
        _coverage(2, 3) if quick else _coverage(),
        headline(2 if quick else DESIGNS * DRAWS // len(_HEADLINES), 50 if quick else _MANY),
    ]


def _monte_carlo(draws: int) -> Section:
    rows: list[tuple[str, ...]] = []
    worst = 0.0
    design = planned_design(default_arm(), seed=0)
    for name, uncertainty in list(KINDS.items())[-2:]:
        truth = expanded_by_monte_carlo(design, uncertainty, draws)
        ratio = expanded_by_product(design, uncertainty) / truth
        rows.append((name, *(f"{value:.4f}" for value in ratio)))
        worst = max(worst, float(np.abs(ratio - 1.0).max()))
    return Section(
        title=f"Expanded uncertainty of the budget over that of {draws:,} Monte Carlo draws",
        columns=("ratio at 95 %", *(f"joint {j + 1}" for j in range(6))),
        rows=tuple(rows),
        figures=(Figure("largest deviation from 1", 100.0 * worst, "at most", 1.0, " %"),),
        notes=(
            "load, places and readings drawn, deflections by the simulator, estimates by numpy's "
            "pseudo-inverse of its regressor; half of the interval with 2.5 % of the draws on either side",
        ),
    )


def expanded_by_monte_carlo(design: Design, uncertainty: CommonUncertainty, draws: int) -> FloatArray:
    """Return half-widths (n,) of the intervals with equal tails, without any code of the solver."""
    arm, plan = design.arm, design.experiment
    units = [with_compliances(arm, unit) for unit in np.eye(len(arm.compliances))]
    A = np.stack([_linear(unit, plan.joints, *plan.wrenches, _POINTS) for unit in units], axis=1)
    size = np.linalg.norm(A, axis=0)
    H = np.linalg.pinv(A / size) / size[:, None]
    generator = np.random.default_rng(_STREAM)
    found = []
    for _ in range(draws):
        force, moment, load_points, points = _true(design, uncertainty, generator)
        exact = _linear(arm, plan.joints, force, moment, load_points, points)
        found.append(H @ (exact + np.sqrt(2.0) * SIGMA * generator.standard_normal(exact.shape)))
    tail = 50.0 * (1.0 - CONFIDENCE)
    half: FloatArray = 0.5 * np.ptp(np.percentile(found, [tail, 100.0 - tail], axis=0), axis=0)
    return half


def _linear(arm: SpringArm, *campaign: FloatArray) -> FloatArray:
    return linear_deflections(arm, *campaign).ravel()


def expanded_by_product(design: Design, uncertainty: CommonUncertainty) -> FloatArray:
    """Return the expanded uncertainties (n,) of the budget, for readings of exact linear springs."""
    plan = design.experiment
    deflection = linear_deflections(design.arm, plan.joints, *plan.wrenches, _POINTS)
    measured = replace(_stated(design, deflection), common_uncertainty=uncertainty)
    way = Way("partial pose", complementary_stiffness=False)
    estimate = way.estimate(default_robot(design.arm), measured)
    budget = UncertaintyBudget.of(estimate, CONFIDENCE)
    if budget is None:
        raise ValueError("sigma is given, so there is a budget")
    return budget.coverage_factor * budget.total().uncertainty


def _coverage(designs: int = DESIGNS, draws: int = DRAWS) -> Section:
    rows: list[tuple[str, ...]] = []
    figures: list[Figure] = []
    for name, uncertainty in KINDS.items():
        campaigns = list(wrong_campaigns(designs, draws, uncertainty))
        ignored = [(design, replace(m, common_uncertainty=None)) for design, m in campaigns]
        ways = [Way(method) for method in METHODS if method != "complete pose"]
        for way, verdicts in judge(ways, campaigns).items():
            shares = 100.0 * verdicts.covered.mean(axis=0)
            rows.append(_row(f"{name}, {way.method}", verdicts))
            figures += [
                Figure(
                    f"coverage, {name}, {way.method}: least of a joint", shares.min(), "at least", 93.5, " %"
                ),
                Figure("the same: greatest of a joint", shares.max(), "at most", 96.5, " %"),
            ]
        rows.append(_row(f"{name}, not stated", judge(ways[:1], ignored)[ways[0]]))
    return Section(
        title=f"Coverage of 95 % intervals, load or places off, {designs * draws:,} campaigns of each kind",
        columns=("share that holds the truth, %", *(f"joint {j + 1}" for j in range(6))),
        rows=tuple(rows),
        figures=tuple(figures),
        notes=(
            "each campaign has one error of load and places for all its observations, drawn as it states; "
            f"exact springs, {1e6 * SIGMA:g} µm, K_c included, sigma given",
            "the binomial standard error of a share is 0.49 %",
        ),
    )


def headline(draws: int, many: int = _MANY) -> Section:
    """Coverage of the expanded uncertainty as reports state it, and how often they say *partial* instead.

    Args:
        draws: campaigns of each kind.
        many: postures by which the stiffness of joints with bending links beside them is defined.
    """
    rows: list[tuple[str, ...]] = []
    figures: list[Figure] = []
    for name, (size, links) in _HEADLINES.items():
        truth = _defined(links, many)
        covered = []
        for seed in range(draws):
            budget, compliance = _fitted(_campaign(links, size, seed))
            if budget is None or budget.missing:
                continue
            k = max(2.0, budget.coverage_factor) / budget.coverage_factor
            pairs = zip(budget.joints, budget.expanded_with_model_error, strict=True)
            covered.append([abs(compliance[joint] - truth[joint]) <= k * U for joint, U in pairs])
        shares = 100.0 * np.mean(covered, axis=0) if covered else np.array([])
        stated = 100.0 * len(covered) / draws
        rows.append((name, f"{stated:.1f}", *(f"{share:.1f}" for share in shares)))
        if covered:
            figures.append(
                Figure(f"coverage, {name}: least of a joint", float(shares.min()), "at least", 93.5, " %")
            )
    return Section(
        title=f"Coverage of U of reports where it is stated, {draws * len(_HEADLINES):,} campaigns",
        columns=("share, %", "stated", *(f"joint {j + 1}" for j in range(6))),
        rows=tuple(rows),
        figures=tuple(figures),
        notes=(
            "joints alone are fitted; where links bend, a joint's compliance is that of the same fit to "
            f"{many} other postures; all others are stated as partial",
        ),
    )


def _campaign(links: float, size: int, seed: int) -> Document:
    """Return a campaign of the default arm, with links that bend by a share of the beams' compliance."""
    arm = default_arm()
    if links == 0.0:
        return simulate_campaign(arm, load="pull", configurations=size, seed=seed)
    beams = beam_arm(arm, bending=6e6 / links, torsion=4e6 / links, axial=2e9 / links, shear=6e8 / links)
    return elastic_campaign(beams, configurations=size, seed=seed)


def _defined(links: float, many: int) -> dict[str, float]:
    """Return the compliances that the estimates should have."""
    arm = default_arm()
    if links == 0.0:
        return dict(zip(arm.joint_names, arm.compliances.tolist(), strict=True))
    return _fitted(_campaign(links, many, seed=99_999))[1]


def _fitted(campaign: Document) -> tuple[Budget | None, dict[str, float]]:
    """Return budget and compliances of joints alone."""
    run = identify(campaign, elasticity="joints")
    if run.result is None:
        raise ValueError(f"the run failed: {run.error}")
    joints = run.result.joints
    return run.result.budget, {each.name: each.compliance for each in joints if each.compliance is not None}


def wrong_campaigns(designs: int, draws: int, uncertainty: CommonUncertainty) -> Iterator[Campaign]:
    """Campaigns whose true load and places differ from what they state.

    Args:
        designs: how many.
        draws: campaigns of each.
        uncertainty: of the errors, drawn once a campaign.
    """
    for seed in range(designs):
        design = planned_design(default_arm(), seed=seed)
        generator = np.random.default_rng([seed, _STREAM])
        for _ in range(draws):
            force, moment, load_points, points = _true(design, uncertainty, generator)
            joints = design.experiment.joints
            exact = np.stack(deflections(design.arm, joints, force, moment, load_points, points))
            unloaded, loaded = exact + SIGMA * generator.standard_normal(exact.shape)
            yield design, replace(_stated(design, loaded - unloaded), common_uncertainty=uncertainty)


def _true(
    design: Design, uncertainty: CommonUncertainty, generator: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Draw true forces, moments and load points (N, 3), and targets (T, 3)."""
    plan = design.experiment
    scale, *turn = generator.standard_normal(4)
    rotation = _rotation(uncertainty.direction * np.array(turn))
    force, moment = (
        (1.0 + uncertainty.scale * scale) * wrench @ rotation.T for wrench in (plan.forces, plan.moments)
    )
    load_points = plan.load_points + uncertainty.load_point * generator.standard_normal(3)
    points = _POINTS + uncertainty.target_places * generator.standard_normal(_POINTS.shape)
    return force, moment, load_points, points


def _stated(design: Design, deflection: FloatArray) -> Measurements:
    """Return deflections (N, T, 3) of targets whose places in the flange frame are stated."""
    plain = design.measurements(np.zeros_like(deflection), deflection, sigma=SIGMA)
    position = np.broadcast_to(_POINTS, deflection.shape).copy()
    return replace(plain, position=position, in_flange=plain.present)


def _rotation(vector: FloatArray) -> FloatArray:
    """Rotation (3, 3) by a vector [rad], by Rodrigues."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: FloatArray = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)
    return rotation


def _row(name: str, verdicts: Verdicts) -> tuple[str, ...]:
    return (name, *(f"{100.0 * share:.1f}" for share in verdicts.covered.mean(axis=0)))
