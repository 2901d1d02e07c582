"""Errors that all targets of a posture share: coverage of the intervals, and what they cost without any.

Readings come from springs that balance the load exactly; joints that do not repeat turn in that simulator,
the station's error moves all targets of a posture alike. Nothing here knows the solver's own terms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.designs import SIGMA, Design, planned_design
from benchmarks.report import Figure, Section
from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import TARGETS, deflections
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.fit.constraints import Bounds
from jointstiff.solver.fit.estimate import Estimate
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.measurements import ASSUMED_LIVE_DRIFT, CommonUncertainty
from jointstiff.solver.run import run as identify_run
from tests.support.springs import robot_of

__all__ = ["run"]

_STREAM = 89
_CAMPAIGNS = 120
_DRIFTING = 360
"""Campaigns with each drift: many of them are named, and only the others count."""
_POSTURES = (12, 19)
_POINTS: FloatArray = np.array(list(TARGETS.values()))
Generator = np.random.Generator
Positions = tuple[FloatArray, FloatArray]
"""Places (N, T, 3) of the targets without load and under load [m]."""


def _repeats(scatter: float) -> Callable[[Design, Generator], Positions]:
    """Return a reader of an arm whose joints come back with a standard deviation [rad]."""

    def read(design: Design, generator: Generator) -> Positions:
        joints = design.experiment.joints
        turned = joints + scatter * generator.standard_normal(joints.shape)
        loaded = deflections(design.arm, turned, *design.experiment.wrenches, _POINTS)[1]
        noise = SIGMA * generator.standard_normal((2, *loaded.shape))
        return design.unloaded + noise[0], loaded + noise[1]

    return read


def _stands(share: float) -> Callable[[Design, Generator], Positions]:
    """Return a reader whose station has a part of the error of a reading [m], common to the targets."""

    def read(design: Design, generator: Generator) -> Positions:
        common = share * generator.standard_normal((2, *design.loaded.shape[:1], 1, 3))
        own = np.sqrt(SIGMA**2 - share**2) * generator.standard_normal((2, *design.loaded.shape))
        return design.unloaded + common[0] + own[0], design.loaded + common[1] + own[1]

    return read


ERRORS = {
    "repeatability 0": _repeats(0.0),
    "repeatability 10 µrad": _repeats(1e-5),
    "repeatability 20 µrad": _repeats(2e-5),
    "repeatability 40 µrad": _repeats(4e-5),
    "station 14 µm of 20 µm": _stands(1.4e-5),
}


@dataclass(frozen=True, eq=False)
class _Outcome:
    """Intervals of one campaign."""

    held: list[bool]  # whether each joint's interval holds the truth
    width: list[float]  # of each joint's interval, relative to that of readings without common errors
    scatter: float  # found, of a joint [rad]


def _outcome(read: Callable[[Design, Generator], Positions], *, stated: bool, seed: int) -> _Outcome:
    """Return the outcome of a campaign of some postures of a plan."""
    generator = np.random.default_rng([seed, _STREAM])
    design = planned_design(default_arm(), seed=seed % 20)
    unloaded, loaded = read(design, generator)
    count = int(generator.integers(_POSTURES[0], _POSTURES[1] + 1))
    kept = np.sort(generator.permutation(len(loaded))[:count])
    measurements = design.measurements(unloaded, loaded, sigma=SIGMA if stated else None)[kept]
    robot = robot_of(design.arm)
    settings = Settings("partial_pose", "covariance", Bounds.positive(robot.n), confidence=0.95)
    joints = JointsAlone(Rows(robot, measurements), settings)
    plain = identify(Rows(robot, measurements), settings)
    found = joints.estimate
    ends = np.array(list(_intervals(found)))
    truth = design.arm.compliances
    return _Outcome(
        held=((ends[:, 0] <= truth) & (truth <= ends[:, 1])).tolist(),
        width=(np.ptp(ends, axis=1) / np.ptp(np.array(list(_intervals(plain))), axis=1)).tolist(),
        scatter=joints.measurements.scatter.joints * (found.sigma or 0.0),
    )


def _intervals(estimate: Estimate) -> Iterator[tuple[float, float]]:
    """Yield the interval of each joint's compliance; an interval without numbers holds nothing."""
    for joint in estimate.joints:
        yield joint.compliance_interval or (np.nan, np.nan)


_DRIFTS = (0.0, 3e-5, 6e-5, 1.2e-4)
"""Shifts of the tracker from the first to the last posture of a campaign [m], between both readings."""
_ASSUMED = CommonUncertainty(drift=ASSUMED_LIVE_DRIFT)


def _drift(size: float, *, stated: bool, seed: int) -> tuple[bool, list[bool]]:
    """Identify a campaign whose tracker drifts; return whether a run says so, and what intervals hold.

    The drift of a live campaign is assumed.
    """
    generator = np.random.default_rng([seed, _STREAM, 1])
    design = planned_design(default_arm(), seed=seed % 20)
    count = int(generator.integers(_POSTURES[0], _POSTURES[1] + 1))
    kept = generator.permutation(len(design.loaded))[:count]
    direction = generator.standard_normal(3)
    drift = np.zeros((len(design.loaded), 1, 3))
    shares = np.linspace(0.0, 1.0, count)[:, None]
    drift[kept, 0] = size * shares * direction / np.linalg.norm(direction)
    noise = SIGMA * generator.standard_normal((2, *design.loaded.shape))
    readings = design.unloaded + noise[0], design.loaded + drift + noise[1]
    measurements = design.measurements(*readings, sigma=SIGMA if stated else None)[kept]
    # Readings are numbered in the order of reading, and have the exact load of the design.
    measurements = replace(measurements, common_uncertainty=_ASSUMED, order=np.arange(float(count)))
    result = identify_run(robot_of(design.arm), measurements, RunOptions())
    ends = [joint.compliance_interval or (np.nan, np.nan) for joint in result.joints]
    held = [lower <= c <= upper for (lower, upper), c in zip(ends, design.arm.compliances, strict=True)]
    return result.assessment.verdict != "use", held


def _drifts(*, quick: bool) -> Section:
    """Draw campaigns whose tracker drifts, with sigma stated and without."""
    rows, shares = [], list[float]()
    for size in _DRIFTS:
        for stated in (True, False):
            found = [_drift(size, stated=stated, seed=seed) for seed in range(3 if quick else _DRIFTING)]
            said = sum(each for each, _ in found)
            held = [one for each, joints in found if not each for one in joints]
            what = f"{1e6 * size:g} µm, {'sigma stated' if stated else 'nothing stated'}"
            share = 100.0 * float(np.mean(held)) if held else float("nan")
            rows.append((what, f"{said} of {len(found)}", f"{share:.1f}" if held else "", str(len(held))))
            shares.append(share)
    return Section(
        title="A tracker that drifts over a live campaign",
        columns=("drift", "named", "else holds the truth [%]", "joints"),
        rows=tuple(rows),
        figures=(
            Figure("drift up to 120 µm: least coverage of plain use", min(shares), "at least", 92.5, " %"),
            Figure("drift up to 120 µm: greatest coverage", max(shares), "at most", 97.0, " %"),
        ),
        notes=("the shift of the loaded readings grows from the first posture to the last",),
    )


def run(*, quick: bool) -> list[Section]:
    """Draw campaigns with each kind of error, with sigma stated and without."""
    rows, shares, widths = [], list[float](), list[float]()
    for name, read in ERRORS.items():
        for stated in (True, False):
            seeds = range(4 if quick else _CAMPAIGNS)
            outcomes = [_outcome(read, stated=stated, seed=seed) for seed in seeds]
            share = 100.0 * float(np.mean([each.held for each in outcomes]))
            width = float(np.median([each.width for each in outcomes]))
            scatter = 1e6 * np.array([each.scatter for each in outcomes])
            what = f"{name}, {'sigma stated' if stated else 'nothing stated'}"
            cells = (
                f"{share:.1f}",
                f"{width:.2f}",
                f"{scatter.mean():.1f}",
                str(int((scatter == 0.0).sum())),
            )
            rows.append((what, *cells))
            shares.append(share)
            if name == "repeatability 0":
                widths.append(width)
    return [
        Section(
            title=f"Errors shared by a posture's targets: {len(outcomes)} campaigns each, of 12 to 19",
            columns=("error", "holds the truth [%]", "median width", "found [µrad]", "found none"),
            rows=tuple(rows),
            figures=(
                Figure("least coverage of five errors", min(shares), "at least", 92.5, " %"),
                Figure("greatest coverage of five errors", max(shares), "at most", 97.0, " %"),
                Figure("half-width at repeatability 0, relative", max(widths), "at most", 1.1),
            ),
            notes=(
                "widths are relative to those of a fit that takes all errors of readings as independent",
                f"three targets, {1e6 * SIGMA:g} µm; the binomial standard error of a share is "
                f"{100.0 * float(np.sqrt(0.95 * 0.05 / (6 * len(outcomes)))):.1f} %",
            ),
        ),
        _drifts(quick=quick),
    ]
