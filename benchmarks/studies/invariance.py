"""Invariance of an estimate: unit of length, reference point, frame. With and without a length.

The numbers of `docs/replication.md`, on a campaign of `examples` that anyone can repeat.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.campaigns import default_robot, small_campaign
from benchmarks.report import Figure, Section
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import LOAD_POINT, SpringArm
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fitting.method import fit_displacement
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.configuration import skew
from jointstiff.solver.terms.block import RegressorBlock, regressor_blocks, whitened_rows
from jointstiff.solver.terms.springs import JOINTS

__all__ = ["View", "complete_pose", "run", "views"]


LENGTHS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Characteristic lengths [m]."""
LENGTH = 0.5
"""The one that is used where the reference point changes [m]."""
INCH = 0.0254
_ANGLES = (0.7, -0.4, 1.1)


@dataclass(frozen=True, eq=False)
class View:
    """The same campaign, written down in another way.

    Attributes:
        arm: in the view's frame and unit of length.
        measurements: in the same.
        reference: which point stands for the flange; None for the barycentre of the targets.
        unit: of length [m].
    """

    arm: SpringArm
    measurements: Measurements
    reference: str | None = None
    unit: float = 1.0


def run(*, quick: bool) -> list[Section]:  # noqa: ARG001 - quick as it is
    """Views of one campaign by covariance and by characteristic length; then one length after the other."""
    found = {name: _both(view) for name, view in views().items()}
    first = next(iter(found.values()))
    changes = {
        name: [_change(c, nominal) for c, nominal in zip(pair, first, strict=True)]
        for name, pair in found.items()
    }
    rows = [
        (name, f"{by_covariance:.1e}", f"{by_length:.1e}")
        for name, (by_covariance, by_length) in changes.items()
    ]
    greatest = max(by_covariance for by_covariance, _ in changes.values())
    return [
        Section(
            title="Complete pose, the same campaign written otherwise: relative change of a compliance",
            columns=("what is changed", "weighted by covariance", f"L = {LENGTH:g}"),
            rows=tuple(rows),
            figures=(
                Figure("invariance: relative change, weighted by covariance", greatest, "at most", 1e-9),
            ),
            notes=(
                "campaign: examples.simulator, 19 configurations, 1500 N in all directions, 20 µm, seed 0",
                f"L = {LENGTH:g} of whatever unit of length the campaign is in: a number without a reason",
            ),
            data={name: list(pair) for name, pair in changes.items()},
        ),
        _lengths_section(),
    ]


def views() -> dict[str, View]:
    """One campaign in a number of ways; the first is as it was measured."""
    campaign = small_campaign()
    plain = View(default_arm(), campaign.measurements)
    return {
        "nothing": plain,
        "unit of length: inch": _in_inches(plain),
        "frame: turned and moved": _turned(plain),
        "reference point: flange": replace(plain, reference="flange"),
        "reference point: load": replace(plain, reference="load"),
        "reference point: base": replace(plain, reference="base"),
    }


def complete_pose(view: View, length: float | None) -> tuple[FloatArray, FloatArray]:
    """Unconstrained compliances and their standard uncertainties [rad/(N·m)].

    Args:
        view: of a campaign.
        length: characteristic length, in the view's unit; None to weight by covariance.
    """
    robot = default_robot(view.arm)
    (block,) = regressor_blocks(robot, view.measurements)
    Q, R, barycentre = fit_displacement(block)
    # The displacement of the reference point and the rotation: E R⁻¹ Qᵀ of the whitened readings
    E = np.tile(np.eye(6), (len(Q), 1, 1))
    E[:, :3, 3:] = -skew(_reference(view, block, barycentre) - barycentre)
    half = E @ np.linalg.inv(R)
    W = np.linalg.inv(np.linalg.cholesky(half @ half.transpose(0, 2, 1)))
    if length is not None:
        W = np.broadcast_to(np.diag(np.repeat([1.0 / length, 1.0], 3)), W.shape)
    targets = whitened_rows(block, [JOINTS], np.zeros(robot.n)).targets.reshape(len(Q), -1, robot.n + 1)
    maps = W @ half @ Q.transpose(0, 2, 1)
    rows = (maps @ targets).reshape(-1, robot.n + 1)
    unit = 1.0 / np.linalg.norm(rows[:, :-1], axis=0)
    inverse = unit[:, None] * np.linalg.pinv(rows[:, :-1] * unit)
    of_readings = inverse.reshape(robot.n, len(Q), 6).transpose(1, 0, 2) @ maps
    variance = np.square(of_readings).sum(axis=(0, 2))
    sigma = view.measurements.sigma or np.nan
    return inverse @ rows[:, -1] / view.unit, sigma * np.sqrt(variance) / view.unit


def _both(view: View) -> tuple[FloatArray, FloatArray]:
    return complete_pose(view, None)[0], complete_pose(view, LENGTH)[0]


def _change(compliance: FloatArray, nominal: FloatArray) -> float:
    return float(np.abs(compliance / nominal - 1.0).max())


def _reference(view: View, block: RegressorBlock, barycentre: FloatArray) -> FloatArray:
    count = len(block.torque)
    points: Mapping[str, FloatArray] = {
        "flange": block.configurations.flange_translation,
        "load": block.configurations.to_base(np.broadcast_to(LOAD_POINT, (count, 1, 3)))[:, 0],
        "base": np.zeros((count, 3)),
    }
    return barycentre if view.reference is None else points[view.reference]


def _in_inches(view: View) -> View:
    """Lengths in inches, moments in N·in, hence compliances in rad/(N·in), which `unit` brings back."""
    scale = 1.0 / INCH
    arm = replace(
        view.arm,
        axis_points=scale * view.arm.axis_points,
        flange_translation=scale * view.arm.flange_translation,
    )
    m = view.measurements
    measurements = replace(
        m,
        moment=scale * m.moment,
        load_point=scale * m.load_point,
        position=scale * m.position,
        deflection=scale * m.deflection,
        sigma=None if m.sigma is None else scale * m.sigma,
    )
    return View(arm, measurements, unit=INCH)


def _turned(view: View) -> View:
    """Everything in R0 seen from another frame."""
    R, t = Rotation.from_euler("xyz", _ANGLES).as_matrix(), np.array([1.0, -2.0, 0.5])
    arm = replace(
        view.arm,
        axis_points=view.arm.axis_points @ R.T + t,
        axis_directions=view.arm.axis_directions @ R.T,
        flange_rotation=R @ view.arm.flange_rotation,
        flange_translation=R @ view.arm.flange_translation + t,
    )
    m = view.measurements
    measurements = replace(
        m,
        force=m.force @ R.T,
        moment=m.moment @ R.T,
        position=m.position @ R.T + t,
        deflection=m.deflection @ R.T,
    )
    return View(arm, measurements)


def _lengths_section() -> Section:
    plain = views()["nothing"]
    by_covariance, least = complete_pose(plain, None)
    ways = {f"L = {length:g} m": complete_pose(plain, length) for length in LENGTHS}
    ways = {"by covariance": (by_covariance, least)} | ways
    truth = plain.arm.stiffnesses
    rows = [
        (
            name,
            *(
                f"{1e-6 / c:.4g} ± {1e-6 * u / c**2:.2g}"
                for c, u in zip(compliance, uncertainty, strict=True)
            ),
            f"{np.abs((compliance - by_covariance) / least).max():.1f}",
        )
        for name, (compliance, uncertainty) in ways.items()
    ]
    return Section(
        title="Complete pose: stiffness in 10⁶ N·m/rad, unconstrained, ± standard uncertainty",
        columns=("weighting", *(f"joint {j + 1}" for j in range(len(truth))), "moved"),
        rows=(*rows, ("truth", *(f"{k / 1e6:g}" for k in truth), "")),
        notes=("moved: greatest change of a compliance in units of its standard uncertainty by covariance",),
    )
