"""An arm that bends under its own weight: the minimum of its potential energy.

Units are SI (m, rad, N, N·m); axes of R0. The energy of joint deflections θ beside the commanded angles q is

    V(θ) = ½ Σ θ_j² / c_j − Σ_b m_b g · x_b(q + θ) − F · p_W(q + θ) + ½ k_s (ℓ(q + θ) − s₀)²

with the centres of mass x_b, a dead force F at the flange, and a spring balancer of length ℓ. Body b is
carried by joint b, so its weight is a dead force on the arm that ends there.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from jointstiff.simulator.arm import FloatArray, SpringArm
from jointstiff.simulator.base import SPRINGS, on_pedestal, standing
from jointstiff.simulator.document import Document, robot_document
from jointstiff.simulator.equilibrium import EquilibriumError, torque_derivative, torques
from jointstiff.simulator.experiment import LOAD_POINT, NOISE_STREAM, TARGETS, random_configurations

__all__ = ["Balancer", "Bodies", "default_bodies", "energy", "sag", "unloaded_campaign"]

MAX_NEWTON_STEPS = 50
ROUNDING_ERRORS = 64.0 * float(np.finfo(float).eps)  # of a deflection, beside all forces at a lever of 1 m
STEP = 1e-6  # of the balancer's second derivatives [rad]


@dataclass(frozen=True, eq=False)
class Balancer:
    """A spring between the base and a link, which is shorter without load than where it is mounted."""

    rate: float  #: k_s [N/m]
    free_length: float  #: s₀ [m]
    on_base: FloatArray  #: Its point on the base, in R0 [m], (3,)
    joint: int  #: Index of the joint that carries its other point
    on_link: FloatArray  #: The other point at zero angles, from the point of that joint's axis [m], (3,)


@dataclass(frozen=True, eq=False)
class Bodies:
    """The n bodies of an arm."""

    masses: FloatArray  #: [kg], (n,)
    #: Centres of mass at zero angles, each from the point of its joint's axis, axes of R0 [m], (n, 3)
    centres: FloatArray
    gravity: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, -9.80665]))  #: [m/s²], (3,)


def default_bodies() -> Bodies:
    """Bodies of the 240 kg class arm of `default_arm`, our own: about a tonne, its wrist with a tool."""
    return Bodies(
        masses=np.array([380.0, 230.0, 260.0, 95.0, 55.0, 48.0]),
        centres=np.array(
            [
                [0.12, 0.01, 0.45],
                [0.02, -0.09, 0.52],
                [0.08, 0.06, 0.07],
                [0.72, 0.02, 0.01],
                [0.06, 0.01, 0.02],
                [0.26, 0.03, 0.05],
            ]
        ),
    )


def sag(
    arm: SpringArm,
    bodies: Bodies,
    q: ArrayLike,
    *,
    force: ArrayLike = (0.0, 0.0, 0.0),
    load_point: ArrayLike = (0.0, 0.0, 0.0),
    balancer: Balancer | None = None,
) -> FloatArray:
    """Joint deflections [rad], (N, n), at which the potential energy has its minimum.

    Newton's method on ``θ − c ∘ τ(q + θ) = 0``, which keeps a rigid joint exactly at zero.

    Args:
        arm: The arm.
        bodies: Its bodies.
        q: Commanded angles [rad], (N, n).
        force: Dead force at the load point [N], axes of R0, (3,) or (N, 3).
        load_point: In the flange frame [m], (3,) or (N, 3).
        balancer: None without.

    Raises:
        EquilibriumError: No minimum is found.
    """
    q = np.asarray(q, dtype=float)
    force, load_point = (np.broadcast_to(np.asarray(v, float), (len(q), 3)) for v in (force, load_point))
    theta = np.zeros(q.shape)
    weight = (
        np.abs(bodies.masses).sum() * np.linalg.norm(bodies.gravity) + np.linalg.norm(force, axis=1).max()
    )
    rounding = ROUNDING_ERRORS * arm.compliances.max() * weight
    for _ in range(MAX_NEWTON_STEPS):
        torque, slope = _torques(arm, bodies, q + theta, force, load_point, balancer)
        residual = theta - arm.compliances * torque
        derivative = np.eye(q.shape[1]) - arm.compliances[:, None] * slope
        if np.abs(residual).max() <= rounding:
            if np.any(np.linalg.eigvals(derivative).real <= 0.0):
                break
            return theta
        theta = theta - np.linalg.solve(derivative, residual[..., None])[..., 0]
    msg = "no minimum of the potential energy; reduce the masses or stiffen the joints"
    raise EquilibriumError(msg)


def unloaded_campaign(
    arm: SpringArm,
    bodies: Bodies | None = None,
    *,
    configurations: int = 40,
    mass_uncertainty: float = 0.1,
    payload: float = 0.0,
    sigma: float = 3e-5,
    seed: int = 0,
    pedestal: float | None = None,
) -> Document:
    """Simulate a campaign without loads, and write it down as the service takes it.

    Args:
        arm: The arm.
        bodies: Its bodies, stated as they are; `default_bodies` if None.
        configurations: How many configurations, N.
        mass_uncertainty: Half-width of the stated bounds of each mass, relative.
        payload: Mass [kg] that is then hung on at `LOAD_POINT` in each configuration; 0 for none.
        sigma: Standard deviation of each coordinate of each position read [m].
        seed: Seed of all random numbers.
        pedestal: Stiffness of a pedestal about x and y of R0 [N·m/rad]; None for a floor.

    Returns:
        The document, {"robot", "measurement_set", "run"}.
    """
    bodies = bodies or default_bodies()
    q = random_configurations(arm, configurations, seed)
    force, points = payload * bodies.gravity, np.array(list(TARGETS.values()))
    bent, carried, still = arm, bodies, q
    if pedestal is not None:
        none = np.zeros((SPRINGS, 3))
        masses, centres = np.append(none[:, 0], bodies.masses), np.vstack([none, bodies.centres])
        carried = replace(bodies, masses=masses, centres=centres)
        bent, still = on_pedestal(arm, pedestal), standing(q)
    loads = (0.0 * force, force)
    angles = [still + sag(bent, carried, still, force=each, load_point=LOAD_POINT) for each in loads]
    places = np.array([bent.posture(each).targets_to_base(points) for each in angles])
    noise = np.random.default_rng([seed, NOISE_STREAM]).standard_normal(places.shape)
    unloaded, loaded = np.round(places + sigma * noise, 8).tolist()
    robot = robot_document(arm)
    robot["bodies"] = [
        {
            "name": f"link {j + 1}",
            "joint": name,
            "mass": float(bodies.masses[j]),
            "mass_uncertainty": mass_uncertainty,
            "centre": bodies.centres[j].tolist(),
        }
        for j, name in enumerate(arm.joint_names)
    ]
    observations = [
        {
            "label": f"c{i + 1:02d}",
            "joints": q[i].tolist(),
            "force": force.tolist(),
            "readings": [
                {"target": target, "unloaded": unloaded[i][t]} | ({"loaded": loaded[i][t]} if payload else {})
                for t, target in enumerate(TARGETS)
            ],
        }
        for i in range(configurations)
    ]
    measurement_set = {
        "name": f"unloaded, {configurations} configurations",
        "units": {"length": "m", "angle": "rad", "force": "N"},
        "encoders": "motor",
        "noise": {"sigma": sigma},
        "load_point": list(LOAD_POINT),
        "observations": observations,
    }
    return {"robot": robot, "measurement_set": measurement_set, "run": {"weight": {}}}


def energy(
    arm: SpringArm,
    bodies: Bodies,
    q: FloatArray,
    theta: FloatArray,
    force: FloatArray,
    load_point: FloatArray,
    balancer: Balancer | None = None,
) -> FloatArray:
    """V [J], (N,), of joints none of which is rigid; see the head of this module."""
    angles = q + theta
    total = 0.5 * (theta**2 / arm.compliances).sum(axis=-1)
    for b, mass in enumerate(bodies.masses):
        centre = _up_to(arm, b, bodies.centres[b]).posture(angles[:, : b + 1]).flange_translation
        total = total - mass * centre @ bodies.gravity
    total = total - (arm.posture(angles).point_to_base(load_point) * force).sum(axis=-1)
    if balancer is not None:
        total = total + 0.5 * balancer.rate * (_length(arm, balancer, angles)[0] - balancer.free_length) ** 2
    return np.asarray(total)


def _torques(
    arm: SpringArm,
    bodies: Bodies,
    angles: FloatArray,
    force: FloatArray,
    load_point: FloatArray,
    balancer: Balancer | None,
) -> tuple[FloatArray, FloatArray]:
    """−∂V/∂θ of all but the springs, (N, n), and its derivative, (N, n, n)."""
    none = np.zeros(3)
    torque = torques(arm, angles, force, none, load_point)
    slope = torque_derivative(arm, angles, force, none, load_point)
    for b, mass in enumerate(bodies.masses):
        wrench = (_up_to(arm, b, bodies.centres[b]), angles[:, : b + 1], mass * bodies.gravity, none, none)
        torque[:, : b + 1] += torques(*wrench)
        slope[:, : b + 1, : b + 1] += torque_derivative(*wrench)
    if balancer is not None:
        torque += _balancing(arm, balancer, angles)
        for j, step in enumerate(STEP * np.eye(angles.shape[1])):
            ahead, behind = (_balancing(arm, balancer, angles + s) for s in (step, -step))
            slope[:, :, j] += (ahead - behind) / (2.0 * STEP)
    return torque, slope


def _balancing(arm: SpringArm, balancer: Balancer, angles: FloatArray) -> FloatArray:
    length, slope = _length(arm, balancer, angles)
    return np.asarray(-balancer.rate * (length - balancer.free_length)[:, None] * slope)


def _length(arm: SpringArm, balancer: Balancer, angles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Length of the balancer [m], (N,), and its derivative by the angles, (N, n)."""
    last = balancer.joint + 1
    posture = _up_to(arm, balancer.joint, balancer.on_link).posture(angles[:, :last])
    line = posture.flange_translation - balancer.on_base
    length = np.linalg.norm(line, axis=-1)
    slope = np.zeros(angles.shape)
    slope[:, :last] = np.einsum("bji,bi->bj", posture.velocities(posture.flange_translation), line)
    return length, slope / length[:, None]


def _up_to(arm: SpringArm, joint: int, point: FloatArray) -> SpringArm:
    """The arm that ends at a point of the body behind a joint, given from the point of its axis."""
    last = joint + 1
    return replace(
        arm,
        axis_points=arm.axis_points[:last],
        axis_directions=arm.axis_directions[:last],
        flange_rotation=np.eye(3),
        flange_translation=arm.axis_points[joint] + point,
        stiffnesses=arm.stiffnesses[:last],
        limits=arm.limits[:last],
    )
