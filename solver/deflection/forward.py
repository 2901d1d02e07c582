"""Forward models: where a load takes the tool, and what the readings say of it (method.md §9).

Prediction, maps and programs ask a `ForwardModel`, and nothing else tells joints from elastic links.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar, Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.deflection.cartesian import CartesianCompliance
from jointstiff.solver.deflection.load_cases import LoadCases
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fitting.fit import student_quantile
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot

LARGEST_TURN: Final = 0.25
"""Greatest deflection of a joint, or rotation of the flange, under a load of a process [rad]."""


@dataclass(frozen=True, eq=False)
class ForwardModel(ABC):
    """A model of the loaded robot."""

    first_order: ClassVar[bool]
    """Whether it is linear in the load, without own weight and complementary stiffness."""

    robot: Robot  #: n joints
    #: degrees of freedom of a sigma that comes from residuals; None for one that was given
    degrees_of_freedom: float | None = field(default=None, kw_only=True)

    @abstractmethod
    def deflect(
        self, cases: LoadCases, unloaded: Configurations | None = None, near: Configurations | None = None
    ) -> Deflection:
        """Bend the robot.

        Args:
            cases: B load cases.
            unloaded: their kinematics without the load; None computes them.
            near: kinematics near the loaded postures; None starts at the unloaded ones.

        Raises:
            RequestError: a load finds no stable balance.
        """

    @abstractmethod
    def command(self, wanted: LoadCases, goal: Configurations, share: FloatArray) -> FloatArray:
        """Return angles (B, n) of the model [rad] under which a share of the deflection ends at the goal.

        Args:
            wanted: B loaded postures.
            goal: their kinematics.
            share: (B,) 0 to 1.

        Raises:
            RequestError: there are none.
        """

    @abstractmethod
    def linear_displacement(self, cases: LoadCases, unloaded: Configurations) -> FloatArray:
        """Return displacements (B, 3) of the places, to first order in the load [m]."""

    @abstractmethod
    def overloaded(self, cases: LoadCases, unloaded: Configurations) -> BoolArray:
        """Return whether the loads (B,) are beyond what the model describes."""

    def unloaded(self, cases: LoadCases) -> Configurations:
        """Return the kinematics of load cases without their loads."""
        return Configurations(self.robot, self.robot.joint_map.model_angles(cases.joints))

    def quantile(self, confidence: float) -> float:
        """Return half the width of a two-sided interval in standard uncertainties."""
        if not 0.0 < confidence < 1.0:
            raise RequestError(
                f"the confidence is {confidence}",
                where="confidence",
                remedy="give a confidence between 0 and 1",
            )
        return student_quantile(0.5 * (1.0 + confidence), self.degrees_of_freedom)


@dataclass(frozen=True, eq=False)
class Deflection(ABC):
    """Deflections of B load cases by a forward model, axes of R0."""

    model: ForwardModel  #: model with p compliances
    cases: LoadCases  #: loads and places
    place: FloatArray  #: (B, 3) loaded places in R0 [m]
    axes: FloatArray  #: (B, 3, 3) axes of the flange in R0, under load

    @property
    @abstractmethod
    def displacement(self) -> FloatArray:
        """(B, 3) of the places [m]."""

    @property
    @abstractmethod
    def rotation(self) -> FloatArray:
        """(B, 3) rotation vectors of the flange [rad]."""

    @property
    @abstractmethod
    def rows(self) -> FloatArray:
        """(B, 6, p) ``∂(displacement, rotation)/∂c`` [m, then rad, / (rad/(N·m))]."""

    @property
    @abstractmethod
    def unseen(self) -> BoolArray:
        """(B, n) joints that the load twists and of which the readings say nothing.

        Where there is one, no number holds.
        """

    @property
    @abstractmethod
    def compliance(self) -> CartesianCompliance:
        """Cartesian compliance at the places, in the loaded postures."""

    @abstractmethod
    def compliance_known(self, direction: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Return whether the readings say how places answer to forces along directions (B, 3), and across.

        A joint of which they say nothing may answer to other forces than the load.
        """

    @abstractmethod
    def interval(self, confidence: float) -> FloatArray | None:
        """Return intervals (B, 6, 2) of displacement, then rotation, from the readings alone.

        They respect the constraints of the fit; None where no uncertainty is known.
        """

    @abstractmethod
    def interval_along(self, direction: FloatArray, confidence: float) -> FloatArray:
        """Return intervals (B, 2) of displacements along unit vectors (B, 3) [m]; NaN if unknown."""

    @property
    @abstractmethod
    def half(self) -> FloatArray | None:
        """(B, 6, p) H, H Hᵀ the covariance of displacement and rotation; None if it is unknown."""

    @property
    def covariance(self) -> FloatArray | None:
        """(B, 6, 6) from the readings alone, without constraints; None if it is unknown."""
        return None if self.half is None else np.asarray(self.half @ self.half.transpose(0, 2, 1))

    def deviation_along(self, direction: FloatArray) -> FloatArray:
        """Return standard uncertainties (B,) of displacements along unit vectors [m]; NaN if unknown."""
        if self.half is None:
            return np.full(len(direction), np.nan)
        return np.asarray(np.linalg.norm((direction[:, None] @ self.half[:, :3])[:, 0], axis=1))

    @property
    def leverage(self) -> FloatArray:
        """(B,) greatest standard uncertainty of a displacement in any direction [m]; zero if unknown."""
        return np.zeros(len(self.cases)) if self.half is None else greatest_deviation(self.half[:, :3])

    def length_uncertainties(self, covariances: FloatArray) -> FloatArray:
        """Return standard uncertainties of the displacements' lengths by source, ``√(uᵀ A C_k Aᵀ u)``.

        Args:
            covariances: (K, p, p) of the compliances, by source [(rad/(N·m))²].

        Returns:
            (B, K) [m]; zero where nothing moves.
        """
        row = np.einsum("bi,bip->bp", unit_vectors(self.displacement), self.rows[:, :3])
        variance = np.einsum("bp,kpq,bq->bk", row, covariances, row)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def unit_vectors(vectors: FloatArray) -> FloatArray:
    """Return the directions of vectors (B, 3); zero where there is none."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))


def greatest_deviation(half: FloatArray) -> FloatArray:
    """Return the greatest standard uncertainty (B,) in any direction, by roots (B, 3, p) of covariances."""
    greatest = np.linalg.eigvalsh(half @ half.transpose(0, 2, 1))[:, -1]
    return np.asarray(np.sqrt(np.maximum(greatest, 0.0)))
