"""Prismatic joints beside springs that balance loads exactly: a SCARA, and a six-axis arm on a rail."""

from __future__ import annotations

import numpy as np

from benchmarks.report import Figure, Section
from jointstiff.simulator import SpringArm, equilibrium
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.predict.models import JointModel
from tests.support.slides import arm_on_rail, scara
from tests.support.springs import SIGMA, SpringCampaign, robot_of

__all__ = ["run"]

CONFIGURATIONS, CASES = 24, 200
FORCES = (500.0, 50.0, 10.0)
"""Pulls of the exact campaigns [N]: what K_c leaves out falls with their square."""
CONFIDENCE = 0.95


def run(*, quick: bool) -> list[Section]:
    """Identify exact readings, readings with noise, and predict large motions."""
    draws = 5 if quick else 1_000
    robots = {"SCARA": (scara(), 500.0), "arm on a rail": (arm_on_rail(), 1500.0)}
    rows, figures = [], []
    for name, (arm, force) in robots.items():
        errors = [_error(arm, size) for size in FORCES]
        covered, slide = _coverage(arm, force, draws), arm.prismatic[0]
        shares = 100.0 * covered.mean(axis=0)
        apart = _prediction_error(arm, force)
        rows.append(
            (
                name,
                *(f"{error:.1e}" for error in errors),
                f"{shares.mean():.1f}",
                f"{shares[slide]:.1f}",
                f"{1e12 * apart:.2g}",
            )
        )
        count = covered.size
        held = f"{name}: 95 % intervals that hold, of {count:,} joints"
        figures += [
            Figure(f"{name}: relative error at {FORCES[-1]:g} N", errors[-1], "at most", 1e-9),
            Figure(f"{name}: predicted displacement beside exact springs", apart, "at most", 1e-12, " m"),
            Figure(held, shares.mean(), "at least", 93.0, " %"),
            Figure(held, shares.mean(), "at most", 97.0, " %"),
        ]
    heads = (f"error at {force:g} N" for force in FORCES)
    return [
        Section(
            title="Prismatic joints: identification and prediction beside exact springs",
            columns=("robot", *heads, "covered, %", "the slide, %", "prediction, pm"),
            rows=tuple(rows),
            figures=tuple(figures),
            notes=(
                f"{CONFIGURATIONS} configurations over half of each joint's range, pulls in all directions, "
                f"three targets, K_c included; intervals: {draws:,} campaigns of {1e6 * SIGMA:g} µm a robot",
                "error: greatest relative one of a compliance, exact readings; falls with the load squared",
                f"prediction: greatest difference of {CASES} displacements under pulls that bend it by mm",
            ),
        )
    ]


def _settings(n: int) -> Settings:
    return Settings("partial_pose", "covariance", Bounds.positive(n), complementary_stiffness=True)


def _error(arm: SpringArm, force: float) -> float:
    campaign = SpringCampaign.of(arm, configurations=CONFIGURATIONS, seed=1, force=force)
    exact = campaign.measurements(campaign.unloaded, campaign.loaded, sigma=SIGMA)
    found = identify(Rows(robot_of(arm), exact), _settings(len(arm.stiffnesses)))
    return float(np.abs(found.compliance * arm.stiffnesses - 1.0).max())


def _coverage(arm: SpringArm, force: float, draws: int) -> FloatArray:
    """Return which intervals (draws, n) hold the truth."""
    robot, held = robot_of(arm), []
    campaign = SpringCampaign.of(arm, configurations=CONFIGURATIONS, seed=2, force=force)
    for readings in campaign.measured(draws, seed=3):
        joints = identify(Rows(robot, readings), _settings(robot.n)).joints
        ends = np.array([joint.compliance_interval for joint in joints])
        held.append((ends[:, 0] <= arm.compliances) & (arm.compliances <= ends[:, 1]))
    return np.array(held, dtype=np.float64)


def _prediction_error(arm: SpringArm, force: float) -> float:
    plan = SpringCampaign.of(arm, configurations=CASES, seed=4, force=force).experiment
    place = np.tile([0.05, -0.08, 0.21], (CASES, 1))
    cases = LoadCases(plan.joints, plan.forces, plan.moments, np.array(plan.load_points), place)
    constraints = Constraints(Bounds.positive(len(arm.stiffnesses)))
    found = JointModel(robot_of(arm), arm.compliances, None, constraints).deflect(cases).displacement
    bent = plan.joints + equilibrium(arm, plan.joints, *plan.wrenches)
    before, after = (arm.posture(q).point_to_base(place) for q in (plan.joints, bent))
    return float(np.linalg.norm(found - (after - before), axis=1).max())
