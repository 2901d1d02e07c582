"""Loads that hang near axis 6: intervals with the load point free beside a dense grid, and what they cost.

Loads hang where chance puts them, 10 mm about their stated place, which is not stated to be better known. The
dense grid varies the compliance, the load point and all other compliances by the simulator's own columns.
Other methods, weightings and losses, whose fits do not contain the load point, are counted by coverage. Where
no lever is short, all numbers are those of a fit without profiles.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from time import process_time

import numpy as np
from scipy.optimize import least_squares

from benchmarks.designs import SIGMA, with_compliances
from benchmarks.report import Figure, Section
from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import TARGETS, default_arm
from jointstiff.simulator.campaign import Experiment, SpringArm, linear_deflections, plan_experiment
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.fit import identify as identification
from jointstiff.solver.fit import lever as levers
from jointstiff.solver.fit.estimate import JointCompliance, LeverProfile
from jointstiff.solver.fit.lever import Profile, ProfileEnds
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.triangle import compute_triangular_factor
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Measurements
from jointstiff.solver.run import run as identify_and_judge
from tests.support.springs import SpringCampaign, robot_of

__all__ = ["run"]

_STREAM = 101
_LEVERS = (0.001, 0.005, 0.01, 0.015, 0.02, 0.025, 0.03, 0.035)
"""Distances of the stated load point from axis 6 [m]."""
_CAMPAIGNS = 60
_GRIDS = 12
"""Campaigns of each lever from 15 mm on with a dense grid."""
_TIMED = 3
"""Campaigns of each lever of which a whole run is timed."""
_OTHERS: dict[str, RunOptions] = {
    "decoupled": RunOptions(method="decoupled_partial_pose"),
    "uniform weights": RunOptions(weighting="uniform"),
    "Huber's loss": RunOptions(loss="huber"),
}
_CAMPAIGNS_OF_OTHERS = 10
"""Campaigns of each lever for each of the other methods."""
_LONG = 0.3
"""Lever that is not short [m]."""
_LONG_CAMPAIGNS = 40
ASSUMED = CommonUncertainty(load_point=0.01, scale=0.01, assumed=frozenset({"load_point", "force_scale"}))
_POINTS: FloatArray = np.array(list(TARGETS.values()))
_QUANTILE = 1.959964


def _measure(lever: float, seed: int) -> tuple[SpringArm, Experiment, FloatArray, Measurements]:
    """Return arm, stated experiment, noise-free difference of exact and linear deflections, and readings."""
    generator = np.random.default_rng([seed, _STREAM, int(1e4 * lever)])
    arm = default_arm()
    arm = replace(arm, stiffnesses=arm.stiffnesses * generator.uniform(0.5, 2.0, 6))
    count, angle = int(generator.integers(12, 31)), generator.uniform(0.0, 2.0 * np.pi)
    force = 1500.0 * generator.uniform(0.6, 1.3)
    plan = plan_experiment(
        arm, configurations=count, load="pull", force=force, seed=int(generator.integers(1 << 30))
    )
    place = np.array([lever * np.cos(angle), lever * np.sin(angle), 0.15])  # axis 6 is z of the flange
    plan = replace(plan, load_points=np.tile(place, (count, 1)))
    true = replace(
        plan,
        load_points=plan.load_points + ASSUMED.load_point * generator.standard_normal(3),
        forces=plan.forces * (1.0 + ASSUMED.scale * generator.standard_normal()),
    )
    campaign = SpringCampaign.by(arm, true)
    noise = SIGMA * generator.standard_normal((2, *campaign.loaded.shape))
    measurements = replace(campaign, experiment=plan).measurements(
        campaign.unloaded + noise[0], campaign.loaded + noise[1], sigma=SIGMA
    )
    linear = linear_deflections(arm, true.joints, *true.wrenches, _POINTS)
    bent = campaign.loaded - campaign.unloaded - linear
    return arm, plan, bent, replace(measurements, common_uncertainty=ASSUMED)


def _find_dense_ends(
    arm: SpringArm, plan: Experiment, deflection: FloatArray, estimate: float, truth: float
) -> tuple[float, float]:
    """Return the interval of joint 6 by a grid, each point minimised over load point and other joints.

    Args:
        arm: kinematics of the arm.
        plan: experiment as stated.
        deflection: (N, T, 3) deflections without what a linear model neglects [m].
        estimate: compliance around which the error of the force's scale acts [rad/(N·m)].
        truth: compliance around which the grid lies [rad/(N·m)].
    """
    unit = np.sqrt(2.0) * SIGMA

    def columns(shift: FloatArray) -> FloatArray:
        """Return the columns (m, 6) for a load point that is shifted by so much [m]."""
        moved = replace(plan, load_points=plan.load_points + shift)
        parts = [
            linear_deflections(with_compliances(arm, c), moved.joints, *moved.wrenches, _POINTS).ravel()
            for c in np.eye(6)
        ]
        stacked: FloatArray = np.stack(parts, axis=1) / unit
        return stacked

    stated = columns(np.zeros(3))
    by_shift = np.stack([columns(shift) - stated for shift in 0.01 * np.eye(3)])  # linear in the shift
    rows = np.hstack([stated, *by_shift, deflection.reshape(-1, 1) / unit])
    R = compute_triangular_factor(rows)  # all sums of squares are those of the rows
    A, B, d = R[:, :6], R[:, 6:24].reshape(-1, 3, 6), R[:, 24]

    def squares(value: float, start: FloatArray) -> tuple[float, FloatArray]:
        def residual(e: FloatArray) -> FloatArray:
            at = A + np.einsum("a,rak->rk", e, B)
            left, others = d - at[:, 5] * value, at[:, :5]
            scale = np.linalg.norm(others, axis=0)
            c = np.linalg.lstsq(others / scale, left, rcond=None)[0]
            return np.concatenate([left - others / scale @ c, e])

        best = least_squares(residual, start)
        return 2.0 * float(best.cost), best.x

    grid = np.concatenate([[0.0], np.geomspace(truth / 20.0, 60.0 * truth, 240)])
    values, point = np.empty(len(grid)), np.zeros(3)
    middle = int(np.abs(grid - truth).argmin())
    for part in (range(middle, len(grid)), range(middle - 1, -1, -1)):
        point = np.zeros(3)
        for k in part:
            values[k], point = squares(float(grid[k]), point)
    rise = np.sqrt(values - values.min())
    inside = np.flatnonzero(rise <= _QUANTILE)
    first, last = int(inside[0]), int(inside[-1])
    if last == len(grid) - 1:
        return float(grid[first]), inf
    high = float(np.interp(_QUANTILE, rise[last : last + 2], grid[last : last + 2]))
    low = 0.0
    if first > 0:
        low = float(np.interp(-_QUANTILE, -rise[first - 1 : first + 1], grid[first - 1 : first + 1]))
    widened = [
        estimate + side * np.hypot(end - estimate, _QUANTILE * ASSUMED.scale * end)
        for side, end in ((-1.0, low), (1.0, high))
    ]
    return max(float(widened[0]), 0.0), float(widened[1])


class _Programs:
    """Counts of convex programs, and time, of the profiles of runs."""

    def __init__(self) -> None:
        self.most, self.seconds = 0, 0.0
        self._find_ends = Profile.find_ends

    def find_ends(self, profile: Profile, radii: FloatArray) -> ProfileEnds:
        """Find the ends and count."""
        ends = self._find_ends(profile, radii)
        self.most = max(self.most, profile.programs)
        return ends


def _count_others(name: str, *, quick: bool) -> tuple[int, int, int]:
    """Return for another method: campaigns, intervals that miss the truth, and joints without an interval."""
    count, missed, without = 0, 0, 0
    for lever in _LEVERS:
        for seed in range(1 if quick else _CAMPAIGNS_OF_OTHERS):
            arm, _, _, measurements = _measure(lever, seed)
            robot = robot_of(arm)
            settings = Settings.from_options(_OTHERS[name], robot)
            interval = (
                identification.identify(Rows(robot, measurements), settings).joints[5].compliance_interval
            )
            count, without = count + 1, without + (interval is None)
            low, high = interval or (0.0, inf)
            missed += not low <= arm.compliances[5] <= high
    return count, missed, without


def _list_numbers(joint: JointCompliance) -> list[float]:
    """Return the numbers of a joint; zero for a number that does not exist."""
    low, high = joint.compliance_interval or (0.0, 0.0)
    return [joint.compliance or 0.0, joint.standard_uncertainty or 0.0, low, high]


def _find_greatest_change(*, quick: bool) -> float:
    """Return the greatest relative change of a number by profiles where no lever is short."""
    greatest, short = 0.0, levers.SHORT_LEVER
    for seed in range(2 if quick else _LONG_CAMPAIGNS):
        arm, _, _, measurements = _measure(_LONG, seed)
        robot = robot_of(arm)
        settings = Settings.from_options(RunOptions(), robot)
        numbers = []
        for criterion in (short, 0.0):
            levers.SHORT_LEVER = criterion  # type: ignore[misc]  # measured from outside
            try:
                found = JointsAlone(Rows(robot, measurements), settings).estimate.joints
            finally:
                levers.SHORT_LEVER = short  # type: ignore[misc]
            numbers.append([_list_numbers(joint) for joint in found])
        now, before = np.array(numbers, dtype=np.float64)
        greatest = max(greatest, float(np.abs(now / np.where(before, before, 1.0) - (before != 0.0)).max()))
    return greatest


def run(*, quick: bool) -> list[Section]:
    """Draw campaigns with each lever, and compare widths with a dense grid."""
    counts, rows = _Programs(), []
    held, total, wrong, ratios, in_profiles, in_runs = 0, 0, 0, list[float](), 0.0, 0.0
    profile_levers = identification._profile_joints_near_load  # measured from outside

    def timed(*arguments: object) -> dict[int, LeverProfile]:
        start = process_time()
        profiles: dict[int, LeverProfile] = profile_levers(*arguments)  # type: ignore[arg-type]
        counts.seconds += process_time() - start
        return profiles

    identification._profile_joints_near_load = timed  # type: ignore[assignment]
    Profile.find_ends = lambda profile, radii: counts.find_ends(profile, radii)  # type: ignore[method-assign, assignment]
    try:
        for lever in _LEVERS:
            of_lever, without, numbers = 0, 0, list[float]()
            for seed in range(2 if quick else _CAMPAIGNS):
                arm, plan, bent, measurements = _measure(lever, seed)
                robot = robot_of(arm)
                settings = Settings.from_options(RunOptions(), robot)
                joint = JointsAlone(Rows(robot, measurements), settings).estimate.joints[5]
                truth = float(arm.compliances[5])
                total += 1
                if seed < _TIMED:
                    counts.seconds, start = 0.0, process_time()
                    identify_and_judge(robot, measurements, RunOptions())
                    in_runs += process_time() - start
                    in_profiles += counts.seconds
                if joint.compliance is None or joint.compliance_interval is None:
                    without += 1
                    of_lever += 1
                    continue
                low, high = joint.compliance_interval
                of_lever += low <= truth <= high
                numbers.append(low <= truth <= high)
                u = joint.standard_uncertainty or 0.0
                wrong += joint.status == "identified" and abs(joint.compliance - truth) > 4.0 * u
                if lever >= 0.015 and seed < _GRIDS:
                    linear = measurements.deflection - bent
                    dense = _find_dense_ends(arm, plan, linear, joint.compliance, truth)
                    if np.isfinite(dense[1]):
                        ratios.append((high - low) / (dense[1] - dense[0]))
            held += of_lever
            share = 100.0 * float(np.mean(numbers)) if numbers else float("nan")
            rows.append((f"{1e3 * lever:g} mm", str(len(numbers)), f"{share:.1f}", str(without)))
    finally:
        identification._profile_joints_near_load = profile_levers
        Profile.find_ends = counts._find_ends  # type: ignore[method-assign]
    share = 100.0 * held / total
    width = float(np.median(ratios))
    seconds = 100.0 * in_profiles / in_runs
    others = {name: _count_others(name, quick=quick) for name in _OTHERS}
    of_others = sum(count for count, _, _ in others.values())
    not_excluded = 100.0 * (1.0 - sum(missed for _, missed, _ in others.values()) / of_others)
    return [
        Section(
            title=f"Joint 6 with a short lever: {total} campaigns, load point assumed to 10 mm",
            columns=("stated lever", "intervals", "hold the truth [%]", "no interval: no upper end"),
            rows=tuple(rows),
            figures=(
                Figure("joint 6, levers up to 35 mm, truth not excluded", share, "at least", 92.5, " %"),
                Figure("joint 6, levers up to 35 mm, truth not excluded", share, "at most", 97.0, " %"),
                Figure("identified, and beyond 4 u", wrong, "at most", 0),
                Figure("width from 15 mm on, relative to a dense grid, median", width, "at least", 0.95),
                Figure("width from 15 mm on, relative to a dense grid, median", width, "at most", 1.1),
                Figure("convex programs of a joint", counts.most, "at most", 60),
                Figure("time of the profiles, of the runs", seconds, "at most", 10.0, " %"),
            ),
            notes=(
                "12 to 30 pulls of 900 to 1950 N, three targets, 20 µm, force scale assumed to 1 %",
                f"widths of {len(ratios)} campaigns: "
                f"{np.quantile(ratios, 0.1):.2f} to {np.quantile(ratios, 0.9):.2f} (10 to 90 %)",
            ),
        ),
        Section(
            title=f"Joint 6 with a short lever by other methods and losses: {of_others} campaigns",
            columns=("method", "campaigns", "truth missed", "no interval: no upper end"),
            rows=tuple((name, *map(str, counted)) for name, counted in others.items()),
            figures=(
                Figure("other methods and losses, truth not excluded", not_excluded, "at least", 92.5, " %"),
                Figure(
                    "lever of 300 mm: greatest relative change of a number",
                    _find_greatest_change(quick=quick),
                    "at most",
                    1e-12,
                ),
            ),
        ),
    ]
