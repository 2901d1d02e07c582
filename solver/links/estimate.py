"""Estimate of elastic links: compliances, their shares, and the evidence (method.md §7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fitting.fit import student_quantile
from jointstiff.solver.inference.prediction import Prediction
from jointstiff.solver.links.model import ElasticModel, Formulation

ElementKind = Literal["joint", "coupling", "link"]


@dataclass(frozen=True)
class LinkCertificate:
    """Evidence of optimality, from the data."""

    least_eigenvalue: float  #: of the matrices as they are returned, each in SI units; zero or positive
    dual: float  #: how far the slack matrices are from positive semidefinite, over the weight of the penalty
    #: in units of `scale`. Squared loss: bound of the distance, over all weighted readings, between what is
    #: fitted and what the optimum fits. Robust losses: bound of the objective's excess over the optimum, as
    #: mean norm of a target's residual.
    gap: float
    scale: float  #: sigma where it is given, else the residual scale of joints alone [m]
    tolerance: float  #: tolerance of Clarabel, that sufficed


@dataclass(frozen=True, eq=False)
class PrincipalCompliance:
    """A principal compliance [m/N] or [rad/(N·m)] and its direction (3,), a unit vector."""

    value: float
    direction: FloatArray


@dataclass(frozen=True, eq=False)
class LinkCompliance:
    """The compliance of a link, in the frame of the joint that carries it."""

    joint: int  #: index of that joint
    #: (6, 6) displacement (m, then rad) by the load's wrench (N, then N·m), about the origin of the joint's
    #: frame and in its axes
    matrix: FloatArray
    translation: tuple[PrincipalCompliance, ...]  #: three principal compliances [m/N], largest first
    rotation: tuple[PrincipalCompliance, ...]  #: the same of rotations [rad/(N·m)]
    effective_freedom: float  #: how many of its numbers the readings determine
    parameters: int  #: how many numbers it has


@dataclass(frozen=True, eq=False)
class Element:
    """Contribution of an element to the deflection."""

    kind: ElementKind  #: a joint, the coupling between joints, or a link
    joint: int | None  #: index of the joint, or of the one that carries the link; None for the coupling
    share: float  #: share of the measured deflection, ``Σ δp_e·δp / Σ ‖δp‖²`` over the set
    by_observation: FloatArray  #: (N,) the same of each observation; zero where nothing moved


@dataclass(frozen=True, eq=False)
class Companion:
    """Plain squares beside an estimate: what its uncertainties are computed with.

    Those whose weights give a robust loss's optimum count a residual that the loss makes zero many times, and
    promise too much.
    """

    formulation: Formulation  #: formulation of the whole set
    weight: float  #: λ of its penalty
    #: sigma of one coordinate of one reading, of the residuals where these exceed what is stated [m]; None
    #: without degrees of freedom
    sigma: float | None
    degrees_of_freedom: float | None  #: of a sigma that comes from residuals; None for one that was given

    def quantile(self, confidence: float) -> float:
        """Return half the width of a two-sided interval in standard uncertainties."""
        return student_quantile(0.5 * (1.0 + confidence), self.degrees_of_freedom)


@dataclass(frozen=True, eq=False)
class ElasticEstimate:
    """Joint and link compliances with their evidence."""

    model: ElasticModel  #: what bends
    penalty: float  #: weight λ of the penalty
    compliance: FloatArray  #: (n,) of the joints [rad/(N·m)]; NaN where the readings do not see one
    #: (n, n) full joint compliance [rad/(N·m)], zero in rows of joints that are not seen; None where joints
    #: are not coupled
    coupled_joints: FloatArray | None
    entries: FloatArray  #: (P,) all compliances by their columns, which predict: rows @ entries
    links: tuple[LinkCompliance, ...]  #: links that bend
    elements: tuple[Element, ...]  #: what each explains
    prediction: Prediction  #: prediction of all deflections
    sigma: float | None  #: given, or of the residuals [m]; None without degrees of freedom
    chi_square: float  #: chi square of the weighted residuals, under sigma
    degrees_of_freedom: float  #: readings less effective freedom
    effective_freedom: float  #: effective freedom of the whole model: how many numbers the readings determine
    parameters: int  #: how many numbers the model has
    certificate: LinkCertificate  #: certificate of optimality
    companion: Companion  #: what uncertainties are computed with

    @property
    def unexplained(self) -> float:
        """Share of the measured deflection that no element explains."""
        return 1.0 - sum(element.share for element in self.elements)


def principal(block: FloatArray) -> tuple[PrincipalCompliance, ...]:
    """Return the principal compliances of a block (3, 3), largest first."""
    values, vectors = np.linalg.eigh(block)
    pairs = zip(np.maximum(values[::-1], 0.0).tolist(), vectors[:, ::-1].T, strict=True)
    return tuple(PrincipalCompliance(value, direction) for value, direction in pairs)
