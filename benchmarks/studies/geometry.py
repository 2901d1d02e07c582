"""Sweeps simulated over and over: do the stated regions cover, and what is worth what?"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy import stats

from benchmarks.report import Figure, Section
from jointstiff.simulator.sweeps import HOME, SWEEPS, TrackedArm, imperfect_arm
from jointstiff.simulator.urdf import urdf_text
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.geometry.charts import Axis, RigidTransform
from jointstiff.solver.geometry.findings import sweep_findings
from jointstiff.solver.geometry.frames import find_base_frame, find_wrist_centre
from jointstiff.solver.geometry.model import FlangeConvention, identify_model
from jointstiff.solver.geometry.sweeps import (
    AngleUse,
    AxisFit,
    Sweep,
    SweepSet,
    SweptAxes,
    fit_axis,
    identify_axes,
    refine_axes,
)
from jointstiff.solver.robot.model import JointMap
from jointstiff.solver.robot.urdf import read_urdf

__all__ = ["run"]


SIGMA = 15e-6
COUNT = 15
NAMES = ("P10", "P11", "P12")
GEAR_ERROR = 60e-6  # rad, once every 30 degrees
USES: tuple[AngleUse, ...] = ("free", "controller")
WAYS: dict[str, Callable[[SweepSet], SweptAxes]] = {
    "one by one": identify_axes,
    "together": lambda sweeps: refine_axes(identify_axes(sweeps)),
    "together, controller's angles": lambda sweeps: refine_axes(
        identify_axes(sweeps, angles="controller"), angles="controller"
    ),
}


def run(*, quick: bool) -> list[Section]:
    """Coverage of all regions, the two uses of angles, a target near its axis, and flags."""
    return [
        _coverage(4 if quick else 500),
        _angles(4 if quick else 100),
        _near_target(4 if quick else 300),
        _flags(12 if quick else 1000),
    ]


def sweeps_of(cell: TrackedArm, rng: np.random.Generator, homes: FloatArray | None = None) -> SweepSet:
    """Each joint turned alone, with noise; the others at rest at HOME, or each sweep's home (6, 6) [rad]."""
    rests = np.tile(HOME, (6, 1)) if homes is None else homes
    parts = [_sweep(cell, joint, _arc(joint), rng, home=rests[joint]) for joint in range(6)]
    return SweepSet(tuple(parts), NAMES, JointMap.identity(6), SIGMA)


def _arc(joint: int) -> FloatArray:
    return np.linspace(float(SWEEPS[joint, 0]), float(SWEEPS[joint, 1]), COUNT)


def _sweep(
    cell: TrackedArm,
    joint: int,
    angles: FloatArray,
    rng: np.random.Generator,
    *,
    home: FloatArray = HOME,
    real: FloatArray | None = None,
) -> Sweep:
    points = cell.readings(cell.sweep(joint, angles if real is None else real, home))
    points = points + rng.normal(0.0, SIGMA, points.shape)
    present = np.ones(points.shape[:2], dtype=np.bool_)
    return Sweep(cell.sweep(joint, angles, home), points, present, f"joint_{joint + 1}", joint)


def _fit(sweep: Sweep, angles: AngleUse = "free") -> AxisFit:
    return fit_axis(sweep, sweep.angles[:, sweep.joint], sigma=SIGMA, angles=angles)


def _square(error: FloatArray, covariance: FloatArray) -> float:
    return float(error @ np.linalg.solve(covariance, error))


def _coverage(sets: int) -> Section:
    """Return the share of 95 % regions that contain the truth, by quantity and way."""
    cell = TrackedArm()
    inside: dict[tuple[str, str], list[bool]] = defaultdict(list)
    errors: dict[tuple[str, str], list[float]] = defaultdict(list)
    for seed in range(sets):
        sweeps = sweeps_of(cell, np.random.default_rng([seed, 1]))
        for way, identify in WAYS.items():
            for what, error, covariance in _compared(cell, identify(sweeps)):
                square = _square(error, covariance)
                inside[what, way].append(square < float(stats.chi2.ppf(0.95, len(error))))
                errors[what, way].append(float(np.linalg.norm(error[:3])))
    rows, figures = [], []
    for (what, way), held in inside.items():
        share, rms = float(np.mean(held)), float(np.sqrt(np.mean(np.square(errors[what, way]))))
        rows.append((f"{what}, {way}", f"{100 * share:.1f} %", f"{1e6 * rms:.1f} µm"))
        figures.append(Figure(f"coverage of {what}, {way}", share, "at least", 0.93))
        figures.append(Figure(f"coverage of {what}, {way}", share, "at most", 0.97))
    return Section(
        f"Geometry: 95 % regions of {sets} sweep sets at 15 µm",
        ("quantity", "cover", "rms error, lengths"),
        tuple(rows),
        tuple(figures),
        notes=("axes: all six together, 4 numbers each; targets: all three, in the flange frame",),
        data={f"{what}, {way}": float(np.mean(held)) for (what, way), held in inside.items()},
    )


def _compared(cell: TrackedArm, found: SweptAxes) -> list[tuple[str, FloatArray, FloatArray]]:
    """Errors and covariances of all that sweeps tell."""
    chain = read_urdf(urdf_text(cell.arm), "base_link", "flange")
    true = RigidTransform(cell.rotation.T, -cell.rotation.T @ cell.translation)
    axes = [found.axes[j].chart(Axis.through(*cell.axis(j, np.zeros(6)))) for j in range(6)]
    base = find_base_frame(found, chain)
    model = identify_model(found, base, FlangeConvention.of_chain(chain), nominal=chain)
    wrist = find_wrist_centre(found)
    centre, covariance = wrist.in_base(wrist.combined, base, found)
    truth = cell.arm.posture(HOME).axis_points[4]
    transform = base.transform_tracker_to_base
    return [
        ("axes", np.concatenate(axes), found.covariance[:24, :24]),
        ("base frame", transform.chart(true), transform.covariance),
        ("wrist centre in R0", centre - truth, covariance),
        (
            "wrist centre, tracker",
            wrist.combined.centre - cell.rotation @ truth - cell.translation,
            wrist.combined.covariance,
        ),
        ("targets", (model.targets_in_flange - cell.targets).ravel(), model.targets_covariance),
    ]


def _angles(sets: int) -> Section:
    """Position of each axis with free and with the controller's angles, and true or false encoders."""
    cell = TrackedArm(imperfect_arm(1))
    rows = []
    data: dict[str, float] = {}
    for joint in range(6):
        cells = [f"joint {joint + 1}"]
        for gear in (0.0, GEAR_ERROR):
            for use in USES:
                rms, square = _axis_errors(cell, joint, gear, use, sets)
                cells.append(f"{1e6 * rms:.0f} µm, {square:.1f}")
                data[f"joint {joint + 1}, {use}, {gear:g}"] = square
        rows.append(tuple(cells))
    worst = max(data[f"joint {j + 1}, free, {GEAR_ERROR:g}"] for j in range(6))
    return Section(
        "Geometry: angles free or the controller's; rms error of the axis's position, mean χ² of 4 numbers",
        ("axis", "true, free", "true, controller", "gear error, free", "gear error, controller"),
        tuple(rows),
        (Figure("free angles with gear errors: mean χ² of 4 numbers", worst, "at most", 5.5),),
        notes=(
            f"gear error: {1e6 * GEAR_ERROR:.0f} µrad, once every 30°; χ² is 4 where the covariance is true",
        ),
        data=data,
    )


def _axis_errors(cell: TrackedArm, joint: int, gear: float, use: AngleUse, sets: int) -> tuple[float, float]:
    errors, squares = [], []
    for seed in range(sets):
        rng = np.random.default_rng([seed, 2])
        shown = _arc(joint)
        real = shown + gear * np.sin(12.0 * shown + rng.uniform(0.0, 6.3))
        fit = _fit(_sweep(cell, joint, shown, rng, real=real), use)
        error = fit.axis.chart(Axis.through(*cell.axis(joint, HOME)))
        errors.append(error[:2])
        squares.append(_square(error, fit.axis_covariance))
    return float(np.sqrt(np.mean(np.sum(np.square(errors), axis=1)))), float(np.mean(squares))


def _near_target(sets: int) -> Section:
    """Direction of axes 4 and 6 with and without a fourth target 1.7 mm from both."""
    cell = TrackedArm()
    home = np.zeros(6)
    posture = cell.arm.posture(home)
    place = posture.axis_points[5] - 0.5 * posture.axis_directions[5] + [0.0, 1.7e-3, 0.0]
    near = posture.flange_rotation.T @ (place - posture.flange_translation)
    four = replace(cell, targets=np.vstack([cell.targets, near]))
    rows, figures = [], []
    for joint in (3, 5):
        angles = _arc(joint)
        truth = Axis.through(*cell.axis(joint, home))
        errors = []
        for seed in range(sets):
            sweep = _sweep(four, joint, angles, np.random.default_rng([seed, 3]), home=home)
            three = replace(sweep, points=sweep.points[:, :3], present=sweep.present[:, :3])
            fits = (_fit(sweep), _fit(three))
            errors.append([np.sum(fit.axis.chart(truth)[2:] ** 2) for fit in fits])
        with_it, without = np.sqrt(np.mean(errors, axis=0))
        rows.append((f"axis {joint + 1}", f"{1e6 * with_it:.1f} µrad", f"{1e6 * without:.1f} µrad"))
        figures.append(
            Figure(f"axis {joint + 1}: direction with / without", with_it / without, "at most", 1.0)
        )
    return Section(
        "Geometry: a fourth target 1.7 mm from axes 4 and 6",
        ("axis", "direction, with it", "without"),
        tuple(rows),
        tuple(figures),
    )


def _flags(sweeps: int) -> Section:
    """False alarms of clean sweeps, and bumps found."""
    cell = TrackedArm(imperfect_arm(2))
    alarms, found, placed = 0, 0, 0
    for seed in range(sweeps):
        rng = np.random.default_rng([seed, 4])
        joint = seed % 6
        clean = _sweep(cell, joint, _arc(joint), rng)
        alarms += any(True for _ in sweep_findings(_fit(clean), NAMES))
        at, push = int(rng.integers(2, COUNT - 1)), rng.normal(size=3)
        points = clean.points.copy()
        points[at:] += 2e-4 * push / np.linalg.norm(push)
        findings = list(sweep_findings(_fit(replace(clean, points=points)), NAMES))
        found += any(finding.code != "residuals_exceed_sigma" for finding in findings)
        placed += any(
            finding.code == "tracker_bumped" and str(finding.where).endswith(f"position {at + 1}")
            for finding in findings
        )
    return Section(
        f"Geometry: flags on {sweeps} clean sweeps, and on the same with the tracker bumped by 0.2 mm",
        ("clean, flagged", "bumped, flagged", "bumped, at the right position"),
        ((str(alarms), f"{found / sweeps:.1%}", f"{placed / sweeps:.1%}"),),
        (
            Figure("clean sweeps flagged", alarms, "at most", 0),
            Figure("bumps of 0.2 mm flagged", found / sweeps, "at least", 0.99),
        ),
        data={"false": alarms, "found": found / sweeps, "placed": placed / sweeps},
    )
