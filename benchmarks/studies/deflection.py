"""Do predicted deflections hold the truth, and is the compliance that of exact equilibria?

By name only: it takes a minute or two.
"""

from __future__ import annotations

import numpy as np

from benchmarks.campaigns import default_robot
from benchmarks.report import Figure, Section
from benchmarks.studies.coverage import interior_campaigns
from benchmarks.studies.fanuc import CAMPAIGN, prepared
from benchmarks.studies.verdicts import Way
from jointstiff.simulator import LOAD_POINT, SpringArm, default_arm, equilibrium
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.solution import Bounds, Constraints
from jointstiff.solver.estimate import identify
from jointstiff.solver.fitting.method import Settings
from jointstiff.solver.predict.forward import CartesianCompliance, LoadCases
from jointstiff.solver.predict.model_error import leave_postures_out
from jointstiff.solver.predict.models import JointModel
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot

__all__ = ["run"]

DESIGNS, DRAWS, CASES, SPLITS = 20, 50, 50, 200
FORCE = 1500.0
_POSITIVE = Constraints(Bounds.positive(6))


def run(*, quick: bool) -> list[Section]:
    """Coverage of intervals on exact springs, then the compliance."""
    return [
        _coverage(*((2, 3) if quick else (DESIGNS, DRAWS))),
        _compliance(10 if quick else 200),
        _held_out(2 if quick else SPLITS),
    ]


def load_cases(arm: SpringArm, count: int, seed: int) -> LoadCases:
    """Random postures over all of every joint's range with pulls in all directions at the tool."""
    generator = np.random.default_rng([seed, 31])
    force = generator.standard_normal((count, 3))
    point = np.broadcast_to(np.asarray(LOAD_POINT, dtype=np.float64), (count, 3)).copy()
    return LoadCases(
        joints=generator.uniform(arm.limits[:, 0], arm.limits[:, 1], size=(count, len(arm.limits))),
        force=FORCE * force / np.linalg.norm(force, axis=1, keepdims=True),
        moment=np.zeros((count, 3)),
        load_point=point,
        place=point.copy(),
    )


def _coverage(designs: int, draws: int) -> Section:
    arm = default_arm()
    robot, way, held = default_robot(arm), Way("partial pose"), []
    truth_model = JointModel(robot, arm.compliances, None, _POSITIVE)
    for k, (_, measurements) in enumerate(interior_campaigns(designs, draws)):
        cases = load_cases(arm, CASES, k)
        truth = truth_model.deflect(cases)
        model = JointModel.of(robot, way.estimate(robot, measurements), _POSITIVE)
        ends = model.deflect(cases).interval(0.95)
        if ends is None:
            raise RuntimeError("sigma is given, so there is an interval")
        exact = np.concatenate([truth.displacement, truth.rotation], axis=1)
        held.append((ends[..., 0] <= exact) & (exact <= ends[..., 1]))
    shares = 100.0 * np.mean(held, axis=(0, 1))
    return Section(
        title=f"Coverage of 95 % intervals of predictions, {designs * draws:,} campaigns × {CASES} cases",
        columns=("share that holds the truth, %", "x", "y", "z", "turn x", "turn y", "turn z"),
        rows=(("readings only", *(f"{share:.1f}" for share in shares)),),
        figures=(
            Figure("coverage of a component, least", float(shares.min()), "at least", 94.0, " %"),
            Figure("coverage of a component, greatest", float(shares.max()), "at most", 96.0, " %"),
        ),
        notes=(
            "exact springs, K_c included, sigma given; postures over the whole range, fitted in half of it",
        ),
        data={"shares": shares.tolist()},
    )


def _compliance(count: int) -> Section:
    arm = default_arm()
    cases = load_cases(arm, count, 0)
    model = JointModel(default_robot(arm), arm.compliances, None, _POSITIVE)
    found = model.deflect(cases)
    exact = (4.0 * _differences(arm, cases, 60.0) - _differences(arm, cases, 120.0)) / 3.0
    size = np.abs(exact).max(axis=(1, 2))
    rows = found.jacobian
    plain = (rows * model.compliance) @ rows.transpose(0, 2, 1)
    errors = [
        float((np.abs(matrix[:, :3, :3] - exact).max(axis=(1, 2)) / size).max())
        for matrix in (found.compliance.matrix, plain)
    ]
    return Section(
        title=f"Compliance beside differences of exact equilibria, {count} postures",
        columns=("compliance", "greatest relative error"),
        rows=(
            ("with K_c", f"{errors[0]:.1e}"),
            ("K_c left out", f"{errors[1]:.1e}"),
            *_ratios(found.compliance),
        ),
        figures=(Figure("relative error of the compliance", errors[0], "at most", 1e-8),),
        data={"errors": errors},
    )


def _held_out(splits: int) -> Section:
    """Fit 20 of the 30 postures of a real robot, and look at the 10 others."""
    title = "FANUC R-2000iC, real readings: 20 postures fitted, 10 held out"
    if not CAMPAIGN.is_file():
        note = "nothing done: the shared data are not beside this checkout (../shared/data)"
        return Section(title, ("absent",), (), notes=(note,))
    robot, measurements = prepared(CAMPAIGN)
    found = [_split(robot, measurements, seed) for seed in range(splits)]
    inside, components, readings, radius, moved = np.mean(found, axis=0)
    return Section(
        title=f"{title}, {splits} splits",
        columns=("nominal 90 %", "displacement inside", "components inside", "radius, mm"),
        rows=(
            ("with model error", f"{100 * inside:.1f} %", f"{100 * components:.1f} %", f"{1e3 * radius:.2f}"),
            ("readings only", "", f"{100 * readings:.1f} %", ""),
        ),
        figures=(Figure("held-out displacements within the ball", 100.0 * inside, "at least", 88.0, " %"),),
        notes=(f"joints alone, partial pose; mean deflection {1e3 * moved:.2f} mm",),
    )


def _split(robot: Robot, measurements: Measurements, seed: int) -> tuple[float, ...]:
    order = np.random.default_rng([seed, 32]).permutation(len(measurements))
    fitted, held = measurements[np.sort(order[:20])], measurements[np.sort(order[20:])]
    settings = Settings("partial_pose", "covariance", Bounds.positive(robot.n), confidence=0.9)
    estimate = identify(robot, fitted, settings)
    model = JointModel.of(robot, estimate, settings.constraints)
    error = leave_postures_out(robot, fitted, settings, estimate, model)
    place = held.position[:, 0]  # in the flange frame, as all readings of the set are deflections
    cases = LoadCases(held.joints, held.force, held.moment, held.load_point, place.copy())
    found = model.deflect(cases)
    bound, read = error.bound(cases, found.leverage, 0.9), held.deflection[:, 0]
    of_readings = found.interval(0.9)
    with_error = bound.interval(found.displacement, of_readings)
    if of_readings is None:
        raise RuntimeError("sigma comes from the residuals, so there is an interval")
    return (
        float((np.linalg.norm(read - found.displacement, axis=1) <= bound.radius).mean()),
        *(
            float(((ends[..., 0] <= read) & (read <= ends[..., 1])).mean())
            for ends in (with_error, of_readings[:, :3])
        ),
        float(bound.radius.mean()),
        float(np.linalg.norm(read, axis=1).mean()),
    )


def _differences(arm: SpringArm, cases: LoadCases, step: float) -> FloatArray:
    """(B, 3, 3) central differences of the exact place by the force [m/N]."""
    columns = []
    for unit in step * np.eye(3):
        ends = [_place(arm, cases, cases.force + sign * unit) for sign in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.stack(columns, axis=-1)


def _place(arm: SpringArm, cases: LoadCases, force: FloatArray) -> FloatArray:
    q = cases.joints + equilibrium(arm, cases.joints, force, cases.moment, cases.load_point)
    return arm.posture(q).point_to_base(cases.place)


def _ratios(compliance: CartesianCompliance) -> list[tuple[str, str]]:
    """Return the ratios of the three directional stiffnesses."""
    u = np.broadcast_to(np.eye(3)[2], (len(compliance.matrix), 3))
    free = compliance.stiffness_lateral_free(u)
    return [
        (name, f"{np.median(stiffness / free):.2g} times, up to {np.max(stiffness / free):.2g}")
        for name, stiffness in (
            (
                "stiffness along z, laterals blocked, over that with them free",
                compliance.stiffness_lateral_blocked(u),
            ),
            ("the same with rotations blocked, too", compliance.stiffness_rotation_blocked(u)),
        )
    ]
