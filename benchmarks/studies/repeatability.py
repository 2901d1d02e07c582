"""Few postures, or one target, of joints that do not repeat: coverage, and width relative to an oracle's.

Readings come from springs that balance the load exactly, with joints that turn in that simulator; encoders
behind three gearboxes see the same turns. The oracle knows sigma and the repeatability. Its width is that of
the same fit with both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.designs import SIGMA, Design, planned_design
from benchmarks.report import Figure, Section
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import TARGETS, deflections
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.fit.constraints import Bounds
from jointstiff.solver.fit.estimate import Estimate
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.measurements import Measurements, Scatter
from tests.support.springs import robot_of

__all__ = ["run"]

_STREAM = 193
_CAMPAIGNS = 320
"""Campaigns of a row: the standard error of 1,920 intervals, 0.5 %, is a sixth of what a share may be off."""
_DESIGNS = 20
_REPEATABILITIES = (0.0, 1e-5, 2e-5, 4e-5)
"""Standard deviations of a joint's angle [rad]."""
_BROCHURES = (1.0, 0.5, 2.0)
"""Repeatabilities that are stated, relative to the true one; the true one is the first."""
_OF_BROCHURE = 2e-5
"""True standard deviation of a joint's angle where a repeatability is stated [rad]."""
_POINTS: FloatArray = np.array(list(TARGETS.values()))


@dataclass(frozen=True)
class _Layout:
    """Size of a campaign."""

    name: str
    least: int  # postures
    most: int
    targets: int


_LAYOUTS = (
    _Layout("4–5 postures", 4, 5, 3),
    _Layout("6–8 postures", 6, 8, 3),
    _Layout("one target, 12–19 postures", 12, 19, 1),
)


@dataclass(frozen=True, eq=False)
class _Outcome:
    """Intervals of one campaign."""

    held: list[bool]  # whether the interval of each joint holds the truth
    width: list[float]  # of each joint's interval, relative to that of the oracle


def _simulate(layout: _Layout, repeatability: float, seed: int) -> tuple[Design, Measurements]:
    """Return a design, and readings of some of its postures."""
    generator = np.random.default_rng([_STREAM, seed, layout.least, round(1e6 * repeatability)])
    design = planned_design(default_arm(), seed=seed % _DESIGNS)
    joints = design.experiment.joints
    turned = joints + repeatability * generator.standard_normal(joints.shape)
    loaded = deflections(design.arm, turned, *design.experiment.wrenches, _POINTS)[1]
    noise = SIGMA * generator.standard_normal((2, *loaded.shape))
    count = int(generator.integers(layout.least, layout.most + 1))
    kept = np.sort(generator.permutation(len(loaded))[:count])
    measurements = design.measurements(design.unloaded + noise[0], loaded + noise[1], sigma=SIGMA)[kept]
    present = measurements.present & (np.arange(len(_POINTS)) < layout.targets)
    deflection = np.where(present[..., None], measurements.deflection, 0.0)
    return design, replace(measurements, present=present, deflection=deflection)


def _compare(
    layout: _Layout, repeatability: float, *, stated: bool, seed: int, brochure: float | None = None
) -> _Outcome:
    """Identify a campaign with sigma stated or not, and as the oracle does.

    `brochure` is the stated repeatability, relative to the true one; None states none.
    """
    design, measurements = _simulate(layout, repeatability, seed)
    if brochure is not None:
        measurements = replace(measurements, repeatability=brochure * repeatability)
    robot = robot_of(design.arm)
    settings = Settings("partial_pose", "covariance", Bounds.positive(robot.n), confidence=0.95)
    rows = Rows(robot, replace(measurements, sigma=SIGMA if stated else None))
    ends = _list_intervals(JointsAlone(rows, settings).estimate)
    known = Rows(robot, replace(measurements, scatter=Scatter(repeatability / SIGMA)))
    ends_of_oracle = _list_intervals(identify(known, settings))
    truth = design.arm.compliances
    return _Outcome(
        held=((ends[:, 0] <= truth) & (truth <= ends[:, 1])).tolist(),
        width=(np.ptp(ends, axis=1) / np.ptp(ends_of_oracle, axis=1)).tolist(),
    )


def _list_intervals(estimate: Estimate) -> FloatArray:
    """Return the ends (n, 2) of the compliances' intervals; an interval without numbers holds nothing."""
    return np.array([joint.compliance_interval or (np.nan, np.nan) for joint in estimate.joints])


def _compare_layout(layout: _Layout, seeds: Sequence[int]) -> tuple[list[tuple[str, ...]], list[Figure]]:
    """Return the rows and the figures of a layout."""
    rows, shares, widths = list[tuple[str, ...]](), list[float](), list[float]()
    for repeatability in _REPEATABILITIES:
        for stated in (True, False):
            outcomes = [_compare(layout, repeatability, stated=stated, seed=seed) for seed in seeds]
            shares.append(100.0 * float(np.mean([each.held for each in outcomes])))
            widths.append(float(np.median([each.width for each in outcomes])))
            noise = "sigma stated" if stated else "nothing stated"
            what = f"{layout.name}, {1e6 * repeatability:g} µrad, {noise}"
            rows.append((what, f"{shares[-1]:.1f}", f"{widths[-1]:.2f}"))
    figures = [
        Figure(f"{layout.name}: least coverage", min(shares), "at least", 92.0, " %"),
        Figure(f"{layout.name}: greatest coverage", max(shares), "at most", 98.0, " %"),
        Figure(f"{layout.name}: greatest width relative to an oracle's", max(widths), "at most", 1.15),
    ]
    return rows, figures


def _build_section_on_brochures(seeds: Sequence[int]) -> Section:
    """Return the section on repeatabilities that are stated at half and at twice their true size."""
    rows, figures = list[tuple[str, ...]](), list[Figure]()
    for layout in _LAYOUTS[1:]:
        shares = dict[float, float]()
        for factor in _BROCHURES:
            outcomes = [
                _compare(layout, _OF_BROCHURE, stated=True, seed=seed, brochure=factor) for seed in seeds
            ]
            held = [each for outcome in outcomes for each in outcome.held]
            width = float(np.median([each.width for each in outcomes]))
            shares[factor] = 100.0 * float(np.mean(held))
            what = f"{layout.name}, stated × {factor:g}"
            rows.append((what, f"{sum(held)} of {len(held)} ({shares[factor]:.1f} %)", f"{width:.2f}"))
        for factor in _BROCHURES[1:]:
            what = f"{layout.name}, stated × {factor:g}: coverage relative to that of the true figure"
            figures.append(Figure(what, abs(shares[factor] - shares[1.0]), "at most", 2.0, " %"))
    return Section(
        title=f"Stated repeatability, truly {1e6 * _OF_BROCHURE:g} µrad: {len(seeds)} campaigns each",
        columns=("campaign", "holds the truth", "median width, relative to an oracle's"),
        rows=tuple(rows),
        figures=tuple(figures),
    )


def run(*, quick: bool) -> list[Section]:
    """Draw campaigns of each size and repeatability, with sigma stated and without."""
    seeds = range(2 if quick else _CAMPAIGNS)
    rows, figures = list[tuple[str, ...]](), list[Figure]()
    for layout in _LAYOUTS:
        rows_of_layout, figures_of_layout = _compare_layout(layout, seeds)
        rows.extend(rows_of_layout)
        figures.extend(figures_of_layout)
    standard_error = 100.0 * float(np.sqrt(0.95 * 0.05 / (6 * len(seeds))))
    return [
        Section(
            title=f"Joints that do not repeat, few readings: {len(seeds)} campaigns each",
            columns=("campaign", "holds the truth [%]", "median width, relative to an oracle's"),
            rows=tuple(rows),
            figures=tuple(figures),
            notes=(
                f"sigma {1e6 * SIGMA:g} µm; the binomial standard error of a share is {standard_error:.1f} %",
            ),
        ),
        _build_section_on_brochures(seeds),
    ]
