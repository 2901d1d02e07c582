"""Elastic links: what may bend beside the joints, and what is found of it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from jointstiff.schemas.fields import (
    Compliance,
    Dimensionless,
    Message,
    Metres,
    Name,
    Point,
    TranslationalCompliance,
)

Elasticity = Literal["joints", "coupled_joints", "diagonal_links", "joints_and_links"]


Matrix = list[list[float]]


class CrossValidation(Message):
    """How held-out configurations choose the penalty of the links, and compare the models."""

    folds: Annotated[int, Field(strict=True, ge=2, le=20)] = Field(
        default=5, description="Parts, each held out once; fewer where there are fewer postures."
    )
    seed: Annotated[int, Field(strict=True, ge=0, le=2**53)] = Field(
        default=0, description="Of the draw that shares out the configurations."
    )
    rule: Literal["best", "one_standard_error"] = Field(
        default="best",
        description="`best`: the penalty of least held-out residual. `one_standard_error`: the largest whose "
        "residual is within one standard error of that.",
    )


class PrincipalCompliance(Message):
    """Of the compliance to forces or to moments, in the axes of the joint's frame."""

    value: float = Field(description="m/N of translation, rad/(N.m) of rotation.")
    direction: Dimensionless[Point] = Field(description="Unit vector.")


class LinkCompliance(Message):
    """The compliance of the link behind a joint, about the origin and in the axes of the joint's frame."""

    joint: Name = Field(description="Whose frame moves with the near end of the link.")
    matrix: Matrix = Field(
        description="6 x 6, symmetric and positive semidefinite: displacement and rotation by force and "
        "moment. Units by block of three: m/N, rad/N; m/(N.m), rad/(N.m).",
    )
    translation: TranslationalCompliance[list[PrincipalCompliance]] = Field(
        description="Of the block of force and displacement, largest first."
    )
    rotation: Compliance[list[PrincipalCompliance]] = Field(
        description="Of the block of moment and rotation, largest first."
    )
    effective_freedom: Dimensionless[float] = Field(
        description="How many of its numbers the readings determine; the penalty settles the others."
    )
    parameters: int = Field(description="How many numbers it has.")


class ElementShare(Message):
    """How much of the measured deflection an element explains."""

    kind: Literal["joint", "coupling", "link"]
    joint: Name | None = Field(description="The joint, or the one that carries the link; null of coupling.")
    share: Dimensionless[float] = Field(
        description="Over the set: projection of its predicted deflections on the measured ones, over those; "
        "all elements and what is left unexplained sum to 1."
    )
    by_observation: Dimensionless[list[float]] = Field(
        description="The same of each observation, in the order of the set."
    )


class LinkCertificate(Message):
    """Proof of optimality, recomputed from the data at the very numbers that are returned."""

    least_eigenvalue: float = Field(
        description="Of all matrices in SI units, and the least joint compliance; never negative. In the "
        "unit of its matrix."
    )
    dual: Dimensionless[float] = Field(
        description="How far the slack matrices are from positive semidefinite, over the penalty."
    )
    gap: Dimensionless[float] = Field(
        description="The fitted readings, all together and weighted, differ from those of the optimum by no "
        "more than so many `scale`."
    )
    scale: Metres[float] = Field(
        description="Sigma where it is given, otherwise the residual scale of joints alone."
    )


class LinksResult(Message):
    """What bends beside the joints."""

    model: Elasticity
    penalty: Dimensionless[float] = Field(description="Weight of the penalty.")
    penalty_source: Literal["given", "cross_validation"]
    coupled_joints: Compliance[Matrix | None] = Field(
        description="Full joint compliance, positive semidefinite, for elasticity `coupled_joints`; zero for "
        "joints that are not observable."
    )
    links: list[LinkCompliance] = Field(description="Of the links that may bend.")
    elements: list[ElementShare] = Field(description="What each joint and link explains.")
    unexplained: Dimensionless[float] = Field(
        description="Share of the measured deflection that no element explains."
    )
    effective_freedom: Dimensionless[float] = Field(
        description="How many numbers of the whole model the readings determine."
    )
    parameters: int = Field(description="How many numbers the whole model has.")
    certificate: LinkCertificate


class ScoredModel(Message):
    """How a model predicts configurations that it was not fitted to."""

    model: Elasticity
    penalty: Dimensionless[float | None] = Field(
        description="Weight, chosen for this model or given; null of joints alone."
    )
    compensation: Dimensionless[float] = Field(description="Of held-out configurations, mean over the folds.")
    standard_error: Dimensionless[float] = Field(description="Of that mean, from the spread of the folds.")
    by_fold: Dimensionless[list[float]] = Field(description="Compensation of each fold.")


class ModelSelection(Message):
    """The models side by side, from simple to rich."""

    models: list[ScoredModel]
    best: Elasticity = Field(description="Of the greatest held-out compensation.")
    simplest: Elasticity = Field(
        description="The simplest within one standard error of the best: what the readings call for."
    )
