"""Estimate of elastic links: compliances, their shares, and the evidence (method.md §7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import special

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.inference.prediction import Prediction
from jointstiff.solver.links.model import ElasticModel, Formulation

ElementKind = Literal["joint", "coupling", "link"]


@dataclass(frozen=True)
class LinkCertificate:
    """Evidence of optimality, from the data.

    Attributes:
        least_eigenvalue: of the matrices as they are returned, each in SI units; zero or positive.
        dual: how far the slack matrices are from positive semidefinite, over the weight of the penalty.
        gap: in units of `scale`. Squared loss: bound of the distance, over all weighted readings, between
            what is fitted and what the optimum fits. Robust losses: bound of the objective's excess over the
            optimum, as mean norm of a target's residual.
        scale: sigma where it is given, else the residual scale of joints alone [m].
        tolerance: of Clarabel, that sufficed.
    """

    least_eigenvalue: float
    dual: float
    gap: float
    scale: float
    tolerance: float


@dataclass(frozen=True, eq=False)
class PrincipalCompliance:
    """A principal compliance [m/N] or [rad/(N·m)] and its direction (3,), a unit vector."""

    value: float
    direction: FloatArray


@dataclass(frozen=True, eq=False)
class LinkCompliance:
    """The compliance of a link, in the frame of the joint that carries it.

    Attributes:
        joint: index of that joint.
        matrix: (6, 6) displacement (m, then rad) by the load's wrench (N, then N·m), about the origin of
            the joint's frame and in its axes.
        translation: three principal compliances [m/N], largest first.
        rotation: the same of rotations [rad/(N·m)].
        effective_freedom: how many of its numbers the readings determine.
        parameters: how many numbers it has.
    """

    joint: int
    matrix: FloatArray
    translation: tuple[PrincipalCompliance, ...]
    rotation: tuple[PrincipalCompliance, ...]
    effective_freedom: float
    parameters: int


@dataclass(frozen=True, eq=False)
class Element:
    """Contribution of an element to the deflection.

    Attributes:
        kind: a joint, the coupling between joints, or a link.
        joint: index of the joint, or of the one that carries the link; None for the coupling.
        share: of the measured deflection, ``Σ δp_e·δp / Σ ‖δp‖²`` over the set.
        by_observation: (N,) the same of each observation; zero where nothing moved.
    """

    kind: ElementKind
    joint: int | None
    share: float
    by_observation: FloatArray


@dataclass(frozen=True, eq=False)
class Companion:
    """Weighted squares that share the optimum of an estimate.

    Attributes:
        formulation: of the whole set, targets weighted by what the loss leaves of them.
        weight: λ of its penalty.
        sigma: of one coordinate of one reading, of the residuals where these exceed what is stated [m]; None
            without degrees of freedom.
        degrees_of_freedom: of a sigma that comes from residuals; None for one that was given.
    """

    formulation: Formulation
    weight: float
    sigma: float | None
    degrees_of_freedom: float | None

    def quantile(self, confidence: float) -> float:
        """Return half the width of a two-sided interval in standard uncertainties."""
        probability = 0.5 * (1.0 + confidence)
        if self.degrees_of_freedom is None:
            return float(special.ndtri(probability))
        return float(special.stdtrit(self.degrees_of_freedom, probability))


@dataclass(frozen=True, eq=False)
class ElasticEstimate:
    """Joint and link compliances with their evidence.

    Attributes:
        model: what bends.
        penalty: weight λ of the penalty.
        compliance: (n,) of the joints [rad/(N·m)]; NaN where the readings do not see one.
        coupled_joints: (n, n) full joint compliance [rad/(N·m)], zero in rows of joints that are not seen;
            None where joints are not coupled.
        entries: (P,) all compliances by their columns, which predict: rows @ entries.
        links: that bend.
        elements: what each explains.
        prediction: of all deflections.
        sigma: given, or of the residuals [m]; None without degrees of freedom.
        chi_square: of the weighted residuals, under sigma.
        degrees_of_freedom: readings less effective freedom.
        effective_freedom: of the whole model: how many numbers the readings determine.
        parameters: how many numbers the model has.
        certificate: of optimality.
        companion: program of weighted squares that shares the optimum, its weight of the penalty and its
            sigma: what uncertainties are computed with.
    """

    model: ElasticModel
    penalty: float
    compliance: FloatArray
    coupled_joints: FloatArray | None
    entries: FloatArray
    links: tuple[LinkCompliance, ...]
    elements: tuple[Element, ...]
    prediction: Prediction
    sigma: float | None
    chi_square: float
    degrees_of_freedom: float
    effective_freedom: float
    parameters: int
    certificate: LinkCertificate
    companion: Companion

    @property
    def unexplained(self) -> float:
        """Share of the measured deflection that no element explains."""
        return 1.0 - sum(element.share for element in self.elements)


def principal(block: FloatArray) -> tuple[PrincipalCompliance, ...]:
    """Return the principal compliances of a block (3, 3), largest first."""
    values, vectors = np.linalg.eigh(block)
    pairs = zip(np.maximum(values[::-1], 0.0).tolist(), vectors[:, ::-1].T, strict=True)
    return tuple(PrincipalCompliance(value, direction) for value, direction in pairs)
