"""Rows of the readings about a geometry and its sag: linear in geometry, compliances and their products.

With θ the sag, ``p = f(q + θ; φ)`` and ``θ_j = c_j (τ_j + Σ_k Y_jk (π_k − π_k⁰))``, both torques taken in the
posture that sags, so that at convergence the balance is exact. About (φ, θ):

    p − f(q + θ; φ) + J_θ θ = J_φ δφ + Σ_j J_θj (τ_j c_j + Σ_k Y_jk η_jk),   η_jk = c_j (π_k − π_k⁰)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.geometry.charts import RigidTransform
from jointstiff.solver.geometry.poses import Motion, PoseReadings, PoseState, chain_axes
from jointstiff.solver.robot.configuration import joint_frames
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.weight.bodies import Placement, Torques, WeightReadings


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of a nominal robot at angle zero, to be laid on fitted axes."""

    rotation: FloatArray  #: (n, 3, 3) of the frames that move with the joints, frame of the positions
    origin: FloatArray  #: (n, 3) [m]
    flange: tuple[
        FloatArray, FloatArray
    ]  #: of the flange frame: (3, 3), (3,) from the last joint's origin [m]
    base: RigidTransform  #: from R0 to the frame of the positions

    @classmethod
    def of(cls, robot: Robot, base: RigidTransform) -> Frames:
        """Take the frames of a robot that stands at `base`."""
        rotation, origin = joint_frames(robot, np.zeros((1, robot.n)))
        _, flange = chain_axes(robot.chain)
        lever = base.rotation @ (flange.translation - origin[0, -1])
        place = (base.rotation @ flange.rotation, lever)
        return cls(base.rotation @ rotation[0], base.apply(origin[0]), place, base)


@dataclass(frozen=True, eq=False)
class Rows:
    """The linearised readings, whitened, in units of sigma²."""

    residual: FloatArray  #: (m,) left side of the equation above [m]
    geometry: FloatArray  #: (m, g) J_φ
    joints: FloatArray  #: (m, n) J_θj τ_j, factors of c_j
    products: FloatArray  #: (m, n, K) J_θj Y_jk, factors of η_jk
    torques: Torques  #: torques of the N observations
    gravity: FloatArray  #: (m, 2) derivative by gravity's direction, about two axes across it [m/rad]
    across: FloatArray  #: (n,) greatest torque of the same weights and loads across each axis [N·m]


def rows_at(
    readings: WeightReadings,
    whitened: PoseReadings,
    frames: Frames,
    state: PoseState,
    sag: FloatArray,
    compliance: FloatArray,
) -> Rows:
    """Linearise the readings.

    Args:
        readings: N observations, gravity as it is taken to be.
        whitened: the same positions with their weights.
        frames: of the nominal robot.
        state: geometry to linearise about.
        sag: (N, n) θ [rad].
        compliance: (n,) by which gravity's direction shows [rad/(N·m)].
    """
    motion = Motion(state, replace(whitened, angles=whitened.angles + sag))
    torques = torques_of(readings, frames, motion)
    swings = motion.swings()
    gap = whitened.points - motion.stages[0] + np.einsum("ktin,kn->kti", swings, sag)
    weighted = (whitened.weight @ swings).reshape(*swings.shape[:1], -1, swings.shape[-1])
    geometry = whitened.weight @ motion.jacobian()
    m = gap.size
    tilt = across(readings.burden.gravity) * np.linalg.norm(readings.burden.gravity)
    tilted = np.einsum("kij,kjg,j->kig", weighted, torques.by_gravity @ tilt, compliance)
    return Rows(
        residual=(whitened.weight @ gap[..., None]).reshape(m),
        geometry=geometry.reshape(m, -1),
        joints=(weighted * torques.known[:, None]).reshape(m, -1),
        products=(weighted[..., None] * torques.unit[:, None]).reshape(m, *torques.unit.shape[1:]),
        torques=torques,
        gravity=tilted.reshape(m, 2),
        across=np.maximum(
            np.abs(torques.known).max(axis=0),
            np.linalg.norm(readings.burden.gravity) * np.linalg.norm(torques.by_gravity, axis=2).max(axis=0),
        ),
    )


def across(vector: FloatArray) -> FloatArray:
    """Return two unit vectors (3, 2) across a vector (3,)."""
    frame = np.linalg.svd(vector[None])[2]
    return np.asarray(frame[1:].T)


def torques_of(readings: WeightReadings, frames: Frames, motion: Motion) -> Torques:
    """Return the torques of loads, bodies and balancers in the postures of a motion."""
    axes = motion.state.axes
    origins = np.array([axis.nearest(origin) for axis, origin in zip(axes, frames.origin, strict=True)])
    shift, points, places = np.zeros((len(readings.force), 3)), [], []
    for axis, origin, before, turn in zip(axes, origins, motion.before[:-1], motion.turns, strict=True):
        points.append(before @ axis.point + shift)
        shift = points[-1] - before @ turn @ axis.point
        places.append(before @ turn @ origin + shift)
    placed = Placement(
        direction=np.stack([b @ axis.direction for b, axis in zip(motion.before[:-1], axes, strict=True)], 1),
        point=np.stack(points, axis=1),
        rotation=np.stack(motion.before[1:], axis=1) @ frames.rotation,
        origin=np.stack(places, axis=1),
        base=(frames.base.rotation, frames.base.translation),
    )
    torques = readings.burden.torques(placed, readings.carried)
    rotation, lever = frames.flange
    arm = (motion.before[-1] @ (readings.load_point @ rotation.T + lever)[..., None])[..., 0]
    place = placed.origin[:, -1] + arm
    levers = np.cross(placed.direction, place[:, None] - placed.point)
    known = np.einsum("kji,ki->kj", levers, readings.force)
    known += np.einsum("kji,ki->kj", placed.direction, readings.moment)
    return Torques(torques.known + known, torques.unit, torques.by_gravity)
