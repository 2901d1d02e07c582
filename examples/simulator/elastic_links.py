"""An arm whose links bend as well as its joints, in exact balance with a dead force.

Units are SI (m, rad, N, N·m). Behind each joint j its link yields by a translation t and a rotation vector φ,
in the frame that moves with the joint; at zero angles all these frames are parallel to R0, each with its
origin at the point of its axis, as `simulator.urdf` writes them. The state s holds the joints' deflections
(n,), then (t, φ) of each link (6n,). With D, the compliances on the diagonal, and the work W = F · p_W(s) of
the force, balance is ``s = D ∂W/∂s``: rotations are finite and nothing is linearised.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import ArrayLike

from jointstiff.simulator.arm import FloatArray, SpringArm
from jointstiff.simulator.document import Document, measurement_set, robot_document
from jointstiff.simulator.equilibrium import EquilibriumError
from jointstiff.simulator.experiment import NOISE_STREAM, TARGETS, Experiment, Targets, plan_experiment
from jointstiff.simulator.units import SI_UNITS

__all__ = [
    "ElasticArm",
    "beam_arm",
    "beam_compliance",
    "elastic_campaign",
    "elastic_deflections",
    "elastic_positions",
]

MAX_STEPS = 100
TERMS = 7  # of the series below: exact to rounding for rotations below 0.1 rad
MAX_ROTATION = 0.1
ROUNDING_ERRORS = 64.0


@dataclass(frozen=True, eq=False)
class ElasticArm:
    """An arm with elastic links."""

    arm: SpringArm  #: Kinematics and joint springs, n joints
    #: Compliance of the link behind each joint, (n, 6, 6): (t, φ) [m, rad] by force and moment [N, N·m]
    #: about the origin of the joint's frame, in its axes; zeros for a rigid link
    links: FloatArray


def beam_compliance(
    vector: ArrayLike, *, bending: float, torsion: float, axial: float, shear: float
) -> FloatArray:
    """Compliance (6, 6) of a straight beam from the origin along a vector, at its end, about the origin.

    Timoshenko's beam: the strains of each section, carried to the origin, summed along the beam.

    Args:
        vector: From the frame's origin to the end of the beam [m], (3,).
        bending: E I [N·m²].
        torsion: G J [N·m²].
        axial: E A [N].
        shear: G A [N].
    """
    vector = np.asarray(vector, dtype=float)
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        return np.zeros((6, 6))
    along = np.outer(vector, vector) / length**2
    across = np.eye(3) - along
    section = np.zeros((6, 6))
    section[:3, :3] = along / axial + across / shear
    section[3:, 3:] = along / torsion + across / bending
    nodes, weights = np.polynomial.legendre.leggauss(2)  # exact: the integrand is quadratic
    compliance = np.zeros((6, 6))
    for node, weight in zip(0.5 * (nodes + 1.0), 0.5 * length * weights, strict=True):
        carry = np.eye(6)
        carry[:3, 3:] = _cross_matrix(node * vector)
        compliance += weight * carry @ section @ carry.T
    return 0.5 * (compliance + compliance.T)


def beam_arm(
    arm: SpringArm, *, bending: float = 6e6, torsion: float = 4e6, axial: float = 2e9, shear: float = 6e8
) -> ElasticArm:
    """The arm with a beam from each axis point to the next, and to the flange; see `beam_compliance`."""
    vectors = np.diff(np.vstack([arm.axis_points, arm.flange_translation]), axis=0)
    links = [
        beam_compliance(vector, bending=bending, torsion=torsion, axial=axial, shear=shear)
        for vector in vectors
    ]
    return ElasticArm(arm, np.array(links))


def elastic_deflections(
    elastic: ElasticArm, q: FloatArray, force: FloatArray, load_point: FloatArray, targets: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Exact positions of the targets in R0 [m], each (N, T, 3): without load, and with it.

    Args:
        elastic: The arm.
        q: Angles without load [rad], (N, n).
        force: On the robot at the load point [N], axes of R0, (N, 3).
        load_point: In the flange frame [m], (N, 3).
        targets: In the flange frame [m], (T, 3).

    Raises:
        EquilibriumError: No balance is found.
    """
    state = _balance(elastic, q, force, load_point)
    points = np.broadcast_to(targets, (len(q), *targets.shape))
    unloaded = _flange_points(elastic, q, np.zeros_like(state), points)
    loaded = _flange_points(elastic, q, state, points)
    return unloaded, loaded


def elastic_positions(
    elastic: ElasticArm, experiment: Experiment, targets: Targets, *, sigma: float, seed: int
) -> tuple[FloatArray, FloatArray]:
    """The same as a tracker reads them, with noise of sigma [m] a coordinate; moments must be zero.

    Raises:
        ValueError: The load has a moment.
        EquilibriumError: No balance is found.
    """
    if np.any(experiment.moments):
        msg = "loads with a moment are not simulated: a dead moment has no potential"
        raise ValueError(msg)
    points = np.array(list(targets.values()), dtype=float)
    exact = elastic_deflections(elastic, experiment.joints, experiment.forces, experiment.load_points, points)
    noise = sigma * np.random.default_rng([seed, NOISE_STREAM]).standard_normal((2, *exact[0].shape))
    return exact[0] + noise[0], exact[1] + noise[1]


def elastic_campaign(
    elastic: ElasticArm,
    *,
    configurations: int = 40,
    force: float = 1500.0,
    sigma: float = 2e-5,
    targets: Targets = TARGETS,
    seed: int = 0,
) -> Document:
    """A campaign of pulls in all directions, as `jointstiff.simulator.campaign.simulate_campaign` writes it.

    Args:
        elastic: The arm.
        configurations: How many.
        force: Size of the force [N].
        sigma: Standard deviation of each coordinate of each position read [m].
        targets: In the flange frame [m], by name.
        seed: Of configurations, directions and noise.
    """
    experiment = plan_experiment(
        elastic.arm, configurations=configurations, load="pull", force=force, seed=seed
    )
    unloaded, loaded = elastic_positions(elastic, experiment, targets, sigma=sigma, seed=seed)
    document = measurement_set(
        experiment,
        targets,
        unloaded,
        loaded,
        name=f"elastic links, {configurations} configurations",
        units=SI_UNITS,
        encoders="motor",
        readings="positions",
        sigma=sigma or None,
    )
    return {
        "robot": robot_document(elastic.arm),
        "measurement_set": document,
        "run": {"method": "partial_pose", "elasticity": "joints_and_links"},
    }


def _balance(elastic: ElasticArm, q: FloatArray, force: FloatArray, load_point: FloatArray) -> FloatArray:
    """State (N, 7n) with ``s = D ∂W/∂s``, applied again and again until nothing but rounding changes.

    Each step leaves D ∂²W/∂s² of the error, which is below one for springs that hold the load.
    """
    D = _compliances(elastic)
    state = np.zeros((len(q), len(D)))
    for _ in range(MAX_STEPS):
        load = _work_gradient(elastic, q, state, force, load_point)
        balanced = load @ D
        rounding = (
            ROUNDING_ERRORS * np.finfo(float).eps * (np.abs(load) @ np.abs(D)).max(axis=1, keepdims=True)
        )
        if np.all(np.abs(state - balanced) <= rounding):
            return state
        state = balanced
        if np.abs(state).max() > MAX_ROTATION:
            break
    msg = "no balance near the unloaded posture; reduce the load or stiffen the arm"
    raise EquilibriumError(msg)


def _compliances(elastic: ElasticArm) -> FloatArray:
    n = len(elastic.links)
    D = np.zeros((7 * n, 7 * n))
    D[:n, :n] = np.diag(elastic.arm.compliances)
    for j, link in enumerate(elastic.links):
        place = slice(n + 6 * j, n + 6 * j + 6)
        D[place, place] = link
    return D


def _work_gradient(
    elastic: ElasticArm, q: FloatArray, state: FloatArray, force: FloatArray, load_point: FloatArray
) -> FloatArray:
    """∂W/∂s (N, 7n): torque about each axis, then force and moment that turn and move each link's end."""
    n = len(elastic.links)
    frames = _frames(elastic, q, state)
    at = _flange_points(elastic, q, state, load_point[:, None])[:, 0]
    gradient = np.empty_like(state)
    for j, (axis, origin, rotation, end) in enumerate(frames):
        moment = np.cross(at - origin, force)
        gradient[:, j] = (axis * moment).sum(axis=1)
        phi = state[:, n + 6 * j + 3 : n + 6 * j + 6]
        gradient[:, n + 6 * j : n + 6 * j + 3] = np.einsum("nji,nj->ni", rotation, force)
        turning = np.einsum("nji,nj->ni", rotation, np.cross(at - end, force))
        gradient[:, n + 6 * j + 3 : n + 6 * j + 6] = np.einsum(
            "nji,nj->ni", _rotation_and_jacobian(phi)[1], turning
        )
    return gradient


def _frames(
    elastic: ElasticArm, q: FloatArray, state: FloatArray
) -> list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
    """Axis, origin, rotation of each joint's frame and the end of its link's translation, in R0."""
    arm, n = elastic.arm, len(elastic.links)
    rotation = np.broadcast_to(np.eye(3), (len(q), 3, 3)).astype(state.dtype)
    position = np.zeros((len(q), 3), dtype=state.dtype)
    before = np.zeros(3)
    frames = []
    for j in range(n):
        position = position + rotation @ (arm.axis_points[j] - before)
        before = arm.axis_points[j]
        axis = rotation @ arm.axis_directions[j]
        rotation = rotation @ _about(arm.axis_directions[j], q[:, j] + state[:, j])
        shift, phi = np.split(state[:, n + 6 * j : n + 6 * j + 6], 2, axis=1)
        end = position + np.einsum("nij,nj->ni", rotation, shift)
        frames.append((axis, position, rotation, end))
        position, rotation = end, rotation @ _rotation_and_jacobian(phi)[0]
    return frames


def _flange_points(elastic: ElasticArm, q: FloatArray, state: FloatArray, points: FloatArray) -> FloatArray:
    """Points of the flange frame (N, T, 3) in R0."""
    arm, n = elastic.arm, len(elastic.links)
    _, _, rotation, end = _frames(elastic, q, state)[-1]
    rotation = rotation @ _rotation_and_jacobian(state[:, 7 * n - 3 :])[0]
    local = points @ arm.flange_rotation.T + (arm.flange_translation - arm.axis_points[-1])
    out: FloatArray = np.einsum("nij,ntj->nti", rotation, local) + end[:, None]
    return out


def _about(axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Rotation by angle (N,) about a unit vector (3,), by Rodrigues."""
    K = _cross_matrix(axis)
    rotation: FloatArray = (
        np.eye(3) + np.sin(angle)[:, None, None] * K + (1.0 - np.cos(angle))[:, None, None] * (K @ K)
    )
    return rotation


def _rotation_and_jacobian(phi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """exp[φ] and its left Jacobian J, ``δ(exp[φ]) = [J δφ] exp[φ]``, as series: also at zero."""
    square = (phi * phi).sum(axis=-1)[..., None, None]
    first, second, third = (
        sum((-square) ** k / factorial(2 * k + order) for k in range(TERMS)) for order in (1, 2, 3)
    )
    K = _cross_matrix(phi)
    KK = K @ K
    return np.eye(3) + first * K + second * KK, np.eye(3) + second * K + third * KK


def _cross_matrix(v: FloatArray) -> FloatArray:
    """Matrices (..., 3, 3) of the cross product with vectors (..., 3)."""
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*v.shape, 3)
