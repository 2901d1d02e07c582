"""Forward models of the loaded robot, as compensation needs them (docs/method.md section 13)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.deflection.elastic import ElasticPredictor
from jointstiff.solver.deflection.joint_model import JointModel
from jointstiff.solver.deflection.load_cases import LoadCases
from jointstiff.solver.deflection.loaded import (
    LARGEST_DEFLECTION,
    load_and_stiffness,
    no_balance,
    refuse_unbalanced,
    require_stable,
    rotation_vector,
    solved,
)
from jointstiff.solver.deflection.own_weight import OwnWeight
from jointstiff.solver.errors import RequestError
from jointstiff.solver.links.places import ElasticPlaces
from jointstiff.solver.regression.pose import skew
from jointstiff.solver.regression.regressor import joint_torque
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot

_STEPS: Final = 20
_LAST_STEP: Final = 5e-7
"""Step of Newton's method [rad or m] that is taken to first order: what it leaves is its square."""
_WEIGHT_STEPS: Final = 8
"""Steps in which the own weight of the commanded posture settles; each gains three digits."""
_REACHED: Final = 1e-12
"""Distance [m] and angle [rad] from the wanted pose that is rounding."""
_DAMPING: Final = 1e-12


class Bent(Protocol):
    """B loaded places."""

    @property
    def place(self) -> FloatArray:
        """(B, 3) in R0 [m]."""
        ...

    @property
    def rotation(self) -> FloatArray:
        """(B, 3, 3) axes of the flange in R0."""
        ...

    def readings(self) -> tuple[BoolArray, FloatArray | None]:
        """Return what the readings say of the displacements.

        Returns:
            (B,) whether a load twists a joint of which they say nothing, and (B, 3, p) H, where H Hᵀ is the
            covariance of the displacement [m²]; None where it is unknown.
        """
        ...


class ForwardModel(Protocol):
    """A model that says where a load takes the tool, and what to command against it."""

    @property
    def robot(self) -> Robot:
        """The robot, n joints."""
        ...

    def quantile(self, confidence: float) -> float:
        """Return half the width of a two-sided interval in standard uncertainties."""
        ...

    def bent(self, cases: LoadCases, unloaded: Configurations, near: Configurations | None = None) -> Bent:
        """Return where loads take the places.

        Args:
            cases: B load cases.
            unloaded: their kinematics without the load.
            near: kinematics near the loaded postures.

        Raises:
            RequestError: a load finds no stable balance.
        """
        ...

    def command(self, wanted: LoadCases, goal: Configurations, share: FloatArray) -> FloatArray:
        """Return angles (B, n) of the model [rad] under which a share of the deflection ends at the goal.

        Args:
            wanted: B loaded postures.
            goal: their kinematics.
            share: (B,) 0 to 1.

        Raises:
            RequestError: there are none.
        """
        ...


@dataclass(frozen=True, eq=False)
class JointForward:
    """Elastic joints: the exact balance of springs, load and own weight."""

    model: JointModel  #: elastic joints
    #: of the links; None leaves it out, as the controller's zero has it in already
    weight: OwnWeight | None = None

    @property
    def robot(self) -> Robot:
        """The robot, n joints."""
        return self.model.robot

    def quantile(self, confidence: float) -> float:
        """Return half the width of a two-sided interval in standard uncertainties."""
        return self.model.quantile(confidence)

    def bent(
        self, cases: LoadCases, unloaded: Configurations, near: Configurations | None = None
    ) -> BentJoints:
        """Balance springs and loads by Newton's method, the last step to first order.

        Raises:
            RequestError: a load finds no stable balance near the unloaded posture.
        """
        robot, compliance, q = self.robot, self.model.compliance, unloaded.q
        rest = self._own(q, unloaded)[0]
        loaded = unloaded if near is None else near
        for _ in range(_STEPS):
            deflection = loaded.q - q
            torque, stiffness = load_and_stiffness(cases, loaded)
            own, own_stiffness = self._own(loaded.q, loaded)
            torque, stiffness = torque + own - rest, stiffness + own_stiffness
            slope = np.eye(robot.n) - compliance[:, None] * stiffness
            step = solved(slope, compliance * torque - deflection)
            deflection = deflection + step
            if (np.abs(step) <= _LAST_STEP).all():
                require_stable(deflection, slope)
                return BentJoints.of(self.model, cases, loaded, (torque, slope, step))
            refuse_unbalanced(np.asarray(~(np.abs(deflection) <= 2.0 * LARGEST_DEFLECTION).all(axis=1)))
            loaded = Configurations(robot, q + deflection)
        raise no_balance(int(np.argmax(np.abs(step).max(axis=1))))

    def command(self, wanted: LoadCases, goal: Configurations, share: FloatArray) -> FloatArray:
        """Return ``θ − s c ∘ (τ(θ) + g(θ) − g(q_cmd))`` (B, n), angles of the model [rad]."""
        theta = goal.q
        torque = load_torque(wanted, goal)
        step = share[:, None] * self.model.compliance
        commanded: FloatArray = theta - step * torque
        if self.weight is None:
            return commanded
        own = self._own(theta, goal)[0]
        for _ in range(_WEIGHT_STEPS):
            rest = self._own(commanded, Configurations(self.robot, commanded))[0]
            commanded = theta - step * (torque + own - rest)
        return commanded

    def _own(self, q: FloatArray, here: Configurations) -> tuple[FloatArray | float, FloatArray | float]:
        return (0.0, 0.0) if self.weight is None else self.weight.torque_and_stiffness(self.robot, q, here)


@dataclass(frozen=True, eq=False)
class BentJoints:
    """B loaded places of a robot whose joints bend."""

    place: FloatArray  #: (B, 3) in R0 [m]
    rotation: FloatArray  #: (B, 3, 3) axes of the flange in R0
    _model: JointModel
    _jacobian: FloatArray
    _torque: FloatArray
    _slope: FloatArray

    @classmethod
    def of(
        cls,
        model: JointModel,
        cases: LoadCases,
        loaded: Configurations,
        balance: tuple[FloatArray, FloatArray, FloatArray],
    ) -> BentJoints:
        """Take the last step, with torques (B, n), slope (B, n, n) and step (B, n) [rad] of the balance."""
        torque, slope, step = balance
        place = loaded.to_base(cases.place[:, None])
        jacobian = np.concatenate([loaded.jacobian_at(place)[:, 0], loaded.angular_jacobian], axis=1)
        moved = (jacobian @ step[..., None])[..., 0]
        turned = loaded.flange_rotation + skew(moved[:, 3:]) @ loaded.flange_rotation
        return cls(place[:, 0] + moved[:, :3], turned, model, jacobian, torque, slope)

    def readings(self) -> tuple[BoolArray, FloatArray | None]:
        """Return what the readings say of the displacements: see `Bent`."""
        transposed = self._slope.transpose(0, 2, 1)
        answer = np.linalg.solve(transposed, self._jacobian.transpose(0, 2, 1)).transpose(0, 2, 1)
        rows = answer * self._torque[:, None]  # ∂(displacement, rotation)/∂c
        unseen: BoolArray = np.asarray(self._model.unseen(rows).any(axis=1))
        return unseen, None if self._model.likelihood is None else rows[:, :3] @ self._model.root


@dataclass(frozen=True, eq=False)
class ElasticForward:
    """Elastic joints and links, to first order in the load at the unloaded posture."""

    model: ElasticPredictor  #: what predicts

    @property
    def robot(self) -> Robot:
        """The robot, n joints."""
        return self.model.robot

    def quantile(self, confidence: float) -> float:
        """Return half the width of a two-sided interval in standard uncertainties."""
        return self.model.quantile(confidence)

    def bent(
        self,
        cases: LoadCases,
        unloaded: Configurations,
        near: Configurations | None = None,  # noqa: ARG002  # nothing is balanced
    ) -> BentLinks:
        """Return where loads take the places."""
        places = self.model.places(cases, unloaded)
        return BentLinks.of(self.model, places, cases, unloaded, np.ones(len(cases)))

    def command(self, wanted: LoadCases, goal: Configurations, share: FloatArray) -> FloatArray:
        """Follow Newton's method to the posture whose bent place is the goal.

        The answer of the deflection to the posture is left out of the slope: each step gains three digits.

        Raises:
            RequestError: the place is at a singular posture, or too far.
        """
        target, robot = goal.to_base(wanted.place[:, None])[:, 0], self.robot
        q = goal.q
        for _ in range(_STEPS):
            here = Configurations(robot, q)
            places = self.model.places(wanted, here)
            bent = BentLinks.of(self.model, places, wanted, here, share)
            off = np.concatenate(
                [
                    target - bent.place,
                    rotation_vector(goal.flange_rotation @ bent.rotation.transpose(0, 2, 1)),
                ],
                axis=1,
            )
            if (np.abs(off) <= _REACHED).all():
                return q
            jacobian = places.jacobian
            normal = jacobian @ jacobian.transpose(0, 2, 1) + _DAMPING * np.eye(6)
            q = q + (jacobian.transpose(0, 2, 1) @ np.linalg.solve(normal, off[..., None]))[..., 0]
        raise RequestError(
            "no posture near it brings the loaded tool there",
            where=f"cases[{int(np.argmax(np.abs(off).max(axis=1)))}]",
            remedy="move the part away from the singularity, or leave the load out here",
        )


@dataclass(frozen=True, eq=False)
class BentLinks:
    """B loaded places of a robot whose links bend."""

    place: FloatArray  #: (B, 3) in R0 [m]
    rotation: FloatArray  #: (B, 3, 3) axes of the flange in R0
    _model: ElasticPredictor
    _places: ElasticPlaces

    @classmethod
    def of(
        cls,
        model: ElasticPredictor,
        places: ElasticPlaces,
        cases: LoadCases,
        unloaded: Configurations,
        share: FloatArray,
    ) -> BentLinks:
        """Move the unloaded places by a share (B,) of their deflection."""
        moved = share[:, None] * places.deflection(model.compliances)
        still = unloaded.to_base(cases.place[:, None])[:, 0]
        rotation = rotations(moved[:, 3:]) @ unloaded.flange_rotation
        return cls(still + moved[:, :3], rotation, model, places)

    def readings(self) -> tuple[BoolArray, FloatArray | None]:
        """Return what the readings say of the displacements: see `Bent`."""
        unseen: BoolArray = np.asarray(self._model.unseen(self._places).any(axis=1))
        half = self._model.half(self._places)
        return unseen, None if half is None else half[:, :3]


def load_torque(cases: LoadCases, here: Configurations) -> FloatArray:
    """Return the torques (B, n) [N·m] of the loads in given postures."""
    jacobian = here.jacobian_at(here.to_base(cases.load_point[:, None]))[:, 0]
    return joint_torque(here, jacobian, cases.force, cases.moment)


def rotations(vectors: FloatArray) -> FloatArray:
    """Return the rotations (B, 3, 3) of rotation vectors (B, 3) [rad] (Rodrigues)."""
    turn = skew(vectors)
    angle = np.linalg.norm(vectors, axis=1)[:, None, None] / np.pi  # in half turns, as `sinc` takes it
    rotation: FloatArray = np.eye(3) + np.sinc(angle) * turn + 0.5 * np.sinc(0.5 * angle) ** 2 * (turn @ turn)
    return rotation
