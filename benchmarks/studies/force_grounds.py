"""Forces known by a cell, beyond a pulley and by a catalogue: coverage with and without their ground.

Springs balance the true force exactly; the stated force has the error of its ground. Each campaign is
identified from its document, as a user's is. The scale of the force and the load point have errors as
stated, too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, sqrt
from typing import Any, Final

import numpy as np

from benchmarks.designs import SIGMA
from benchmarks.report import Figure, Section
from jointstiff import identify
from jointstiff.simulator import default_arm, robot_document
from jointstiff.simulator.campaign import TARGETS, plan_experiment
from jointstiff.simulator.document import measurement_set
from jointstiff.simulator.units import SI_UNITS
from jointstiff.solver.arrays import FloatArray
from tests.support.springs import SpringCampaign

__all__ = ["run"]

_STREAM: Final = 9204
_FORCE: Final = 1500.0
"""Size of the largest force [N]."""
_SIZES: Final = (0.5, 0.75, 1.0)
_SCALE: Final = 2e-3
"""Relative standard uncertainty of the instrument of the force."""
_POINT: Final = 1e-3
"""Standard uncertainty of a coordinate of the load point [m]."""


@dataclass(frozen=True)
class _Row:
    """Campaigns of one kind."""

    words: str  # for people
    ground: str | None = None  # what the force is stated to be known by
    zero: float = 0.0  # largest zero of a cell along the rope, of either sign [N]
    tared: float = 0.0  # standard deviation of the zero of a cell that was tared [N]
    friction: tuple[float, float] = (0.0, 0.0)  # least and greatest part of the force that a pulley takes
    weight: float = 0.0  # largest error of a weight of a catalogue, of either sign, relative
    sizes: bool = False  # whether the loads have three sizes
    bounds: tuple[float, float] | None = (92.5, 97.0)  # coverage that is required [%]

    def state_forces(self, forces: FloatArray, generator: np.random.Generator) -> FloatArray:
        """Return the forces (N, 3) that are stated, for true forces [N]."""
        size = np.linalg.norm(forces, axis=1, keepdims=True)
        zero = generator.uniform(-self.zero, self.zero) + self.tared * generator.standard_normal()
        friction = generator.uniform(*self.friction)
        weight = generator.uniform(-self.weight, self.weight)
        scale = 1.0 + _SCALE * generator.standard_normal()
        measured = scale * forces / (1.0 - friction) / (1.0 + weight)
        return np.asarray(measured + zero * forces / size)


_TAKEN: Final = (0.02, 0.08)
_AT_LEAST: Final = (92.5, 100.0)
_ROWS: Final = (
    _Row("zero of a cell within 60 N, three sizes, `cell`", "cell", zero=60.0, sizes=True),
    _Row("the same without a ground", zero=60.0, sizes=True, bounds=None),
    _Row("zero of a cell within 60 N, one size, `cell`", "cell", zero=60.0, bounds=_AT_LEAST),
    _Row("the same without a ground", zero=60.0, bounds=None),
    _Row("no zero, three sizes, `cell`", "cell", sizes=True, bounds=_AT_LEAST),
    _Row("no zero, three sizes, without a ground", sizes=True),
    _Row("zero of 2 N, one size, `cell` and tared", "cell", tared=2.0),
    _Row("a pulley takes 2 to 8 %, `pulley`", "pulley", friction=_TAKEN, bounds=_AT_LEAST),
    _Row("the same without a ground", friction=_TAKEN, bounds=None),
    _Row("weight within 5 % of its catalogue, `catalogue`", "catalogue", weight=0.05, bounds=_AT_LEAST),
    _Row("the same without a ground", weight=0.05, bounds=None),
)


@dataclass(frozen=True)
class _Outcome:
    """Result of one campaign, compared with the springs."""

    covered: int  # joints whose interval contains the true stiffness
    half_widths: list[float]  # of the intervals, relative to the true compliance
    verdict: str
    is_accused: bool  # whether the run has a reason against its use


def _measure(seed: int, row: _Row) -> dict[str, Any]:
    """Return a campaign of 12 to 30 pulls, whose stated forces have the error of the row."""
    generator = np.random.default_rng([seed, _STREAM])
    arm, count = default_arm(), int(generator.integers(12, 31))
    plan = plan_experiment(arm, configurations=count, load="pull", force=_FORCE, seed=seed)
    if row.sizes:
        plan = replace(plan, forces=generator.choice(_SIZES, (count, 1)) * plan.forces)
    error = _POINT * generator.standard_normal(3)
    exact = SpringCampaign.by(arm, replace(plan, load_points=plan.load_points + error))
    noise = SIGMA * generator.standard_normal((2, *exact.loaded.shape))
    measured = measurement_set(
        replace(plan, forces=row.state_forces(plan.forces, generator)),
        TARGETS,
        exact.unloaded + noise[0],
        exact.loaded + noise[1],
        name="forces",
        units=SI_UNITS,
        encoders="motor",
        readings="positions",
        sigma=SIGMA,
    )
    grounds: dict[str, Any] = {"load_point": "tracker"}
    if row.ground is not None:
        grounds["force"] = row.ground
    if row.tared:
        grounds["tared"] = True
    measured["noise"] |= {"load_point": _POINT, "force": {"scale": _SCALE}, "grounds": grounds}
    return {"robot": robot_document(arm), "measurement_set": measured}


def _identify(seed: int, row: _Row) -> _Outcome:
    """Identify a campaign, and compare its joints with the springs."""
    result = identify(_measure(seed, row)).result
    if result is None:
        return _Outcome(0, [], "none", is_accused=True)
    covered, half_widths = 0, list[float]()
    for joint, compliance in zip(result.joints, default_arm().compliances, strict=True):
        interval = joint.compliance_interval
        if interval is None:
            continue
        low, high = interval[0], inf if interval[1] is None else interval[1]
        covered += bool(low <= compliance <= high)
        half_widths.append(float((high - low) / (2.0 * compliance)))
    is_accused = bool(result.assessment.reasons)
    return _Outcome(covered, half_widths, result.assessment.verdict, is_accused=is_accused)


def run(*, quick: bool) -> list[Section]:
    """Identify campaigns whose forces have the error of a ground, with and without the ground."""
    rows = list[tuple[str, ...]]()
    figures = list[Figure]()
    data = dict[str, Any]()
    count = 3 if quick else 80
    before = ""
    for row in _ROWS:
        is_same = row.words.startswith("the same")
        words = f"{before}, without a ground" if is_same else row.words
        before = row.words.rpartition(", ")[0]
        outcomes = [_identify(seed, row) for seed in range(count)]
        half_widths = [each for outcome in outcomes for each in outcome.half_widths]
        covered, joints = sum(each.covered for each in outcomes), len(half_widths)
        share = 100.0 * covered / max(joints, 1)
        deviation = 100.0 * sqrt(share / 100.0 * (1.0 - share / 100.0) / max(joints, 1))
        width = 100.0 * float(np.median(half_widths))
        uses = sum(each.verdict == "use" for each in outcomes)
        accused = sum(each.is_accused for each in outcomes)
        rows.append(
            (
                words,
                f"{covered} of {joints} ({share:.1f} ± {deviation:.1f} %)",
                f"{width:.1f} %",
                f"{uses} of {count}",
                str(accused),
            )
        )
        data[words] = {"joints": joints, "covered": covered, "half width": width, "use": uses}
        if row.bounds is not None:
            least, most = row.bounds
            figures.append(Figure(f"{words}: covered", share, "at least", least, "%"))
            if most < 100.0:
                figures.append(Figure(f"{words}: covered at most", share, "at most", most, "%"))
    return [
        Section(
            title="Forces with and without a ground",
            columns=("campaigns", "covered", "median half-width", "use", "with a reason"),
            rows=tuple(rows),
            figures=tuple(figures),
            notes=(
                f"{count} campaigns a row, 12 to 30 pulls of {_FORCE:g} N, three targets, {1e6 * SIGMA:g} µm",
                f"scale of the force {100 * _SCALE:g} %, load point by tracker",
            ),
            data=data,
        )
    ]
