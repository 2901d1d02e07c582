"""Peers, the tools of today's users, each used as its own manual recommends.

All of them take *ready-made rows*: A (m, n) and d (m,), every row divided by its standard uncertainty.
"""

from __future__ import annotations

import warnings

import cvxpy as cp
import numpy as np
import numpy.typing as npt
import pinocchio as pin
import qpsolvers
from scipy.optimize import lsq_linear, nnls

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot

__all__ = [
    "bare_pinocchio_loop",
    "bounded_least_squares",
    "cvxpy_clarabel",
    "numpy_qr_nnls",
    "proxqp",
    "scipy_nnls",
    "stacked_rows",
]


def cvxpy_clarabel(A: FloatArray, d: FloatArray) -> FloatArray:
    """A freshly built cvxpy problem on the stacked rows, solved by Clarabel as it comes."""
    c = cp.Variable(A.shape[1])
    problem = cp.Problem(cp.Minimize(cp.sum_squares(A @ c - d)), [c >= 0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns of an inaccurate answer and returns it
        problem.solve(solver=cp.CLARABEL)
    return _numbers(c.value, A)


def scipy_nnls(A: FloatArray, d: FloatArray) -> FloatArray:
    """The active-set method of Lawson & Hanson, by scipy."""
    return _numbers(nnls(A, d)[0], A)


def bounded_least_squares(A: FloatArray, d: FloatArray) -> FloatArray:
    """The active-set method of Stark & Parker, by scipy's lsq_linear."""
    return _numbers(lsq_linear(A, d, bounds=(0.0, np.inf), method="bvls").x, A)


def proxqp(A: FloatArray, d: FloatArray) -> FloatArray:
    """Least squares with bounds, stated by qpsolvers and solved by ProxQP."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        c = qpsolvers.solve_ls(A, d, lb=np.zeros(A.shape[1]), solver="proxqp")
    return _numbers(c, A)


def numpy_qr_nnls(A: FloatArray, d: FloatArray) -> FloatArray:
    """QR of all rows at once by numpy, then scipy nnls on the triangle."""
    Q, R = np.linalg.qr(A)
    return _numbers(nnls(R, Q.T @ d)[0], A)


def bare_pinocchio_loop(robot: Robot, q: FloatArray) -> None:
    """The Jacobians of all configurations, computed and thrown away: no regressor can do without."""
    model = robot.model
    data = model.createData()
    for angles in q:
        pin.computeJointJacobians(model, data, angles)


def stacked_rows(robot: Robot, measurements: Measurements) -> tuple[FloatArray, FloatArray]:
    """The whitened rows of all targets, from a loop over Pinocchio and arrays for the rest.

    It shares no code with `solver`. Column j of the Jacobian at x is v_j + ω_j × x.

    Args:
        robot: n joints.
        measurements: N observations of T targets, all measured in R0, with sigma.

    Returns:
        A (3 N T, n) and d (3 N T,), in units of the standard uncertainty of a deflection.
    """
    model = robot.model
    data = model.createData()
    frame = model.getFrameId(robot.flange, pin.FrameType.BODY)
    jacobian = np.empty((len(measurements), 6, robot.n))
    load_point = np.empty((len(measurements), 3))
    for i, angles in enumerate(measurements.joints):
        jacobian[i] = pin.computeJointJacobians(model, data, angles)
        load_point[i] = pin.updateFramePlacement(model, data, frame).act(measurements.load_point[i])
    linear, angular = (part.swapaxes(1, 2) for part in (jacobian[:, :3], jacobian[:, 3:]))
    at_load = linear + np.cross(angular, load_point[:, None])
    torque = np.einsum("nji,ni->nj", at_load, measurements.force)
    torque += np.einsum("nji,ni->nj", angular, measurements.moment)
    at_target = linear[:, None] + np.cross(angular[:, None], measurements.position[:, :, None])
    A = (at_target * torque[:, None, :, None]).swapaxes(2, 3).reshape(-1, robot.n)
    unit = np.sqrt(2.0) * (measurements.sigma or 1.0)
    return A / unit, measurements.deflection.reshape(-1) / unit


def _numbers(c: npt.ArrayLike | None, A: FloatArray) -> FloatArray:
    """The answer; not-a-number where there is none."""
    return np.full(A.shape[1], np.nan) if c is None else np.asarray(c, dtype=np.float64)
