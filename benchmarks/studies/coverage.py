"""Coverage of the intervals: thousands of simulated campaigns, truth off the bounds and on them.

By name only: it takes some minutes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from benchmarks.designs import CONFIGURATIONS, FORCE, SIGMA, Design, planned_design, with_compliances
from benchmarks.report import Figure, Section
from jointstiff.schemas.options import Method
from jointstiff.simulator import default_arm
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.fit.constraints import Bounds
from jointstiff.solver.fit.estimate import Estimate, JointCompliance
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from tests.support.springs import robot_of

__all__ = [
    "METHODS",
    "RIGID_SETS",
    "Verdicts",
    "Way",
    "interior_campaigns",
    "judge",
    "rigid_campaigns",
    "run",
]

Campaign = tuple[Design, Measurements]

CONFIDENCE = 0.95
METHODS: dict[str, Method] = {
    "complete pose": "complete_pose",
    "partial pose": "partial_pose",
    "decoupled": "decoupled_partial_pose",
}
DESIGNS, DRAWS = 20, 100
RIGID_SETS = (*combinations(range(6), 1), *combinations(range(6), 2))
"""Every joint by itself, every pair."""
_DESIGN_NOTE = (
    f"each design: {CONFIGURATIONS} configurations over half of every joint's range, pulls of {FORCE:g} N in "
    f"all directions, three targets, {1e6 * SIGMA:g} µm; the best of 20 random plans; exact springs"
)


@dataclass(frozen=True)
class Way:
    """One way to identify."""

    method: str  # a key of `METHODS`; complete pose is weighted by covariance
    complementary_stiffness: bool = True  # K_c is included
    sigma_given: bool = True  # else it is estimated from the residuals

    def __str__(self) -> str:
        stiffness = "K_c included" if self.complementary_stiffness else "K_c neglected"
        return f"{self.method}, {stiffness}, sigma {'given' if self.sigma_given else 'estimated'}"

    def estimate(self, robot: Robot, measurements: Measurements) -> Estimate:
        """Identify with positive compliances."""
        settings = Settings(
            METHODS[self.method],
            "covariance",
            Bounds.positive(robot.n),
            confidence=CONFIDENCE,
            complementary_stiffness=self.complementary_stiffness,
        )
        if not self.sigma_given:
            measurements = replace(measurements, sigma=None)
        return identify(Rows(robot, measurements), settings)


@dataclass(frozen=True, eq=False)
class Verdicts:
    """Estimates of K campaigns of an arm of n joints, beside the truth [rad/(N·m)]."""

    truth: FloatArray  # (K, n) compliances
    compliance: FloatArray  # (K, n) estimates
    standard_uncertainty: FloatArray  # (K, n) as reported
    interval: FloatArray  # (K, n, 2) two-sided
    one_sided: FloatArray  # (K, n, 2) at least, at most; each by itself

    @property
    def rigid(self) -> BoolArray:
        """(K, n) joints of no compliance at all."""
        return np.asarray(self.truth == 0.0)

    @property
    def covered(self) -> BoolArray:
        """(K, n) intervals that hold the truth; one that is not there, or NaN, does not."""
        return np.asarray((self.interval[..., 0] <= self.truth) & (self.truth <= self.interval[..., 1]))

    @property
    def above(self) -> BoolArray:
        """(K, n) compliances as great as the one-sided bound says at least."""
        return np.asarray(self.one_sided[..., 0] <= self.truth)

    @property
    def below(self) -> BoolArray:
        """(K, n) joints as stiff as the one-sided bound says at least."""
        return np.asarray(self.truth <= self.one_sided[..., 1])

    @property
    def unsound(self) -> int:
        """Return the number of values that are negative, NaN or infinite."""
        numbers = [self.compliance, self.standard_uncertainty, self.interval, self.one_sided]
        return sum(int((~(np.isfinite(array) & (array >= 0.0))).sum()) for array in numbers)


def judge(ways: Sequence[Way], campaigns: Iterable[Campaign]) -> dict[Way, Verdicts]:
    """Identify every campaign in every way; what is not observable is NaN."""
    robot = robot_of(default_arm())
    truth: list[FloatArray] = []
    found: dict[Way, list[list[tuple[float, ...]]]] = {way: [] for way in ways}
    for design, measurements in campaigns:
        truth.append(design.arm.compliances)
        for way in ways:
            found[way].append([_numbers(joint) for joint in way.estimate(robot, measurements).joints])
    numbers = {way: np.array(rows) for way, rows in found.items()}
    return {
        way: Verdicts(np.array(truth), each[..., 0], each[..., 1], each[..., 2:4], each[..., 4:])
        for way, each in numbers.items()
    }


def _numbers(joint: JointCompliance) -> tuple[float, ...]:
    """Return compliance, standard uncertainty, interval, and one-sided bounds."""
    nothing = float("nan")
    return (
        nothing if joint.compliance is None else joint.compliance,
        nothing if joint.standard_uncertainty is None else joint.standard_uncertainty,
        *(joint.compliance_interval or (nothing, nothing)),
        *(joint.one_sided or (nothing, nothing)),
    )


def run(*, quick: bool) -> list[Section]:
    """Interior truth, then one or two rigid joints."""
    designs, draws = (2, 3) if quick else (DESIGNS, DRAWS)
    ways = [Way(m, k, s) for k in (True, False) for s in (True, False) for m in METHODS]
    interior = judge(ways, interior_campaigns(designs, draws))
    rigid = judge([Way(m) for m in METHODS], rigid_campaigns(draws, RIGID_SETS[:6] if quick else RIGID_SETS))
    return [_interior_section(interior), _rigid_section(rigid)]


def interior_campaigns(designs: int, draws: int) -> Iterator[Campaign]:
    """Campaigns of an arm all of whose joints are elastic, far from rigid beside the noise."""
    for seed in range(designs):
        design = planned_design(default_arm(), seed=seed)
        for measurements in design.measured(draws, seed=seed):
            yield design, measurements


def rigid_campaigns(draws: int, sets: Sequence[tuple[int, ...]] = RIGID_SETS) -> Iterator[Campaign]:
    """Draws of each design with a set of joints rigid, planned as if they were not."""
    arm = default_arm()
    for seed, rigid in enumerate(sets):
        compliances = arm.compliances.copy()
        compliances[list(rigid)] = 0.0
        plan = planned_design(arm, seed=seed)
        design = Design.by(with_compliances(arm, compliances), plan.experiment)
        for measurements in design.measured(draws, seed=seed):
            yield design, measurements


def _interior_section(found: dict[Way, Verdicts]) -> Section:
    shares = {way: 100.0 * verdicts.covered.mean(axis=0) for way, verdicts in found.items()}
    campaigns, n = next(iter(found.values())).truth.shape
    asked = [way for way in found if way.complementary_stiffness and way.sigma_given]
    figures = []
    for way in asked:
        least, greatest = shares[way].min(), shares[way].max()
        figures += [
            Figure(f"coverage, {way.method}: least of a joint", least, "at least", 93.5, " %"),
            Figure(f"coverage, {way.method}: greatest of a joint", greatest, "at most", 96.5, " %"),
        ]
    return Section(
        title=f"Coverage of 95 % intervals, {campaigns:,} campaigns, interior truth",
        columns=("share that holds the truth, %", *(f"joint {j + 1}" for j in range(n))),
        rows=tuple((str(way), *(f"{share:.1f}" for share in row)) for way, row in shares.items()),
        figures=tuple(figures),
        notes=(
            _DESIGN_NOTE,
            f"the binomial standard error of a share is {_standard_error(campaigns):.2f} %; complete pose by "
            "covariance is the same estimate as partial pose",
        ),
        data={str(way): row.tolist() for way, row in shares.items()},
    )


def _rigid_section(found: dict[Way, Verdicts]) -> Section:
    rows: list[tuple[str, ...]] = []
    figures: list[Figure] = []
    for way, verdicts in found.items():
        rows += [(f"{way.method}: {what}", *cells) for what, cells in _rigid_rows(verdicts)]
        figures += _rigid_figures(way, verdicts)
    campaigns, n = next(iter(found.values())).truth.shape
    return Section(
        title=f"One or two joints truly rigid, {campaigns:,} campaigns, K_c included, sigma given",
        columns=("share, %", *(f"joint {j + 1}" for j in range(n)), "all"),
        rows=tuple(rows),
        figures=tuple(figures),
        notes=(
            _DESIGN_NOTE + "; every joint rigid by itself, then every pair",
            "stiffer than: the one-sided upper bound of the compliance holds; softer than: the lower one. "
            "What is truly rigid is stiffer than anything, so its row tells only that the bound is there",
            f"standard error of a share of all campaigns {_standard_error(campaigns):.2f} %, of those where "
            f"one joint is rigid {_standard_error(campaigns * 6 // len(RIGID_SETS)):.2f} %: where a bound "
            "holds in 95 % exactly, the least of six shares lies below that",
        ),
        data={str(way): dict(_rigid_rows(verdicts)) for way, verdicts in found.items()},
    )


def _rigid_rows(verdicts: Verdicts) -> list[tuple[str, tuple[str, ...]]]:
    held = {"two-sided": verdicts.covered, "stiffer than": verdicts.below, "softer than": verdicts.above}
    joints = {"rigid": verdicts.rigid, "elastic": ~verdicts.rigid}
    return [
        (f"{kind}, {bound}", _cells(holds, among))
        for kind, among in joints.items()
        for bound, holds in held.items()
    ]


def _rigid_figures(way: Way, verdicts: Verdicts) -> list[Figure]:
    name = f"rigid joints, {way.method}"
    both = 100.0 * np.stack([verdicts.above, verdicts.below])
    widths = np.ptp(verdicts.interval, axis=-1)
    relative = float((widths / verdicts.standard_uncertainty).max())
    greatest = float("inf") if np.isnan(widths).any() else relative
    rigid = [float(both[:, verdicts.rigid[:, j], j].mean(axis=1).min()) for j in range(widths.shape[1])]
    return [
        Figure(f"{name}: one-sided bounds that hold, least of the rigid", min(rigid), "at least", 95.0, " %"),
        Figure(f"{name}: one-sided bounds that hold, of all", float(both.mean()), "at least", 95.0, " %"),
        Figure(f"{name}: greatest width / standard uncertainty", greatest, "at most", 10.0),
        Figure.none(f"{name}: negative, NaN or infinite numbers", verdicts.unsound),
    ]


def _cells(held: BoolArray, among: BoolArray) -> tuple[str, ...]:
    """Share in % of each joint, and of all, among some of the (K, n)."""
    shares = [held[among[:, j], j].mean() for j in range(held.shape[1])]
    return tuple(f"{100.0 * share:.1f}" for share in [*shares, held[among].mean()])


def _standard_error(campaigns: int) -> float:
    return float(100.0 * np.sqrt(CONFIDENCE * (1.0 - CONFIDENCE) / campaigns))
