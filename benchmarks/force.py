"""Coverage of the intervals if the force differs from the stated one. Exact springs.

By name only: it takes a minute.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.designs import SIGMA, Design, planned_design
from benchmarks.report import Figure, Section
from benchmarks.verdicts import METHODS, Campaign, Verdicts, Way, judge
from jointstiff.simulator import TARGETS, default_arm, deflections
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.readings import ForceUncertainty, Measurements

__all__ = ["KINDS", "force_campaigns", "run"]

DESIGNS, DRAWS = 20, 100
KINDS = {
    "scale 1 %": ForceUncertainty(scale=0.01),
    "scale 5 %": ForceUncertainty(scale=0.05),
    "direction 5 mrad": ForceUncertainty(direction=5e-3),
    "scale 1 % and direction 5 mrad": ForceUncertainty(scale=0.01, direction=5e-3),
}
_STREAM = 21
_POINTS: FloatArray = np.array(list(TARGETS.values()))


def run(*, quick: bool) -> list[Section]:
    """Each kind of uncertainty, stated and ignored."""
    designs, draws = (2, 3) if quick else (DESIGNS, DRAWS)
    rows: list[tuple[str, ...]] = []
    figures: list[Figure] = []
    for name, uncertainty in KINDS.items():
        campaigns = list(force_campaigns(designs, draws, uncertainty))
        ignored = [(design, replace(m, force_uncertainty=None)) for design, m in campaigns]
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
    return [
        Section(
            title=f"Coverage of 95 % intervals, force off, {designs * draws:,} campaigns of each kind",
            columns=("share that holds the truth, %", *(f"joint {j + 1}" for j in range(6))),
            rows=tuple(rows),
            figures=tuple(figures),
            notes=(
                "each campaign has one error of the force for all its observations, drawn as it states; "
                f"exact springs, {1e6 * SIGMA:g} µm, K_c included, sigma given",
                "the binomial standard error of a share is 0.49 %",
            ),
        )
    ]


def force_campaigns(designs: int, draws: int, uncertainty: ForceUncertainty) -> Iterator[Campaign]:
    """Campaigns whose true wrench is ``(1 + ε) R(φ) W``, W being what they state.

    Args:
        designs: how many.
        draws: campaigns of each.
        uncertainty: of ε and φ.
    """
    for seed in range(designs):
        design = planned_design(default_arm(), seed=seed)
        generator = np.random.default_rng([seed, _STREAM])
        for _ in range(draws):
            error = uncertainty.standard_uncertainties * generator.standard_normal(4)
            yield design, _measured(design, error, generator, uncertainty)


def _measured(
    design: Design, error: FloatArray, generator: np.random.Generator, uncertainty: ForceUncertainty
) -> Measurements:
    plan = design.experiment
    true = [(1.0 + error[0]) * wrench @ _rotation(error[1:]).T for wrench in (plan.forces, plan.moments)]
    force, moment = true
    exact = np.stack(deflections(design.arm, plan.joints, force, moment, plan.load_points, _POINTS))
    unloaded, loaded = exact + SIGMA * generator.standard_normal(exact.shape)
    return replace(design.measurements(unloaded, loaded, sigma=SIGMA), force_uncertainty=uncertainty)


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
