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

ElasticModel = Literal["joints", "coupled_joints", "diagonal_links", "joints_and_links"]
Elasticity = Literal["joints", "coupled_joints", "diagonal_links", "joints_and_links", "automatic"]
Loss = Literal["squared", "huber", "absolute"]
Source = Literal["given", "cross_validation"]


Matrix = list[list[float]]


class CrossValidation(Message):
    """Settings of the cross-validation, which chooses the penalty of the links and compares the models."""

    folds: Annotated[int, Field(strict=True, ge=2, le=20)] = Field(
        default=5, description="Number of folds, each held out once; fewer if there are fewer postures."
    )
    draws: Annotated[int, Field(strict=True, ge=1, le=20)] = Field(
        default=4,
        description="Number of times that the configurations are assigned to folds anew; once if "
        "`link_penalty` is given.",
    )
    seed: Annotated[int, Field(strict=True, ge=0, le=2**53)] = Field(
        default=0, description="Random seed of the assignment of configurations to folds."
    )
    rule: Literal["best", "one_standard_error"] = Field(
        default="best",
        description="`best`: the penalty of least held-out residual (mean length; beyond 500 targets root "
        "mean square). `one_standard_error`: the largest within one standard error of the best.",
    )


class PrincipalCompliance(Message):
    """Principal compliance to forces or to moments, in the axes of the joint's frame."""

    value: float = Field(description="Principal compliance: m/N for translation, rad/(N.m) for rotation.")
    direction: Dimensionless[Point] = Field(description="Unit vector of its axis.")


class LinkCompliance(Message):
    """The compliance of the link behind a joint, about the origin and in the axes of the joint's frame."""

    joint: Name = Field(description="Joint whose frame moves with the near end of the link.")
    matrix: Matrix = Field(
        description="Compliance, 6 x 6, symmetric and positive semidefinite: displacement and rotation by "
        "force and moment. Units by block of three: m/N, rad/N; m/(N.m), rad/(N.m).",
    )
    translation: TranslationalCompliance[list[PrincipalCompliance]] = Field(
        description="Principal translational compliances, largest first."
    )
    rotation: Compliance[list[PrincipalCompliance]] = Field(
        description="Principal rotational compliances, largest first."
    )
    effective_freedom: Dimensionless[float] = Field(
        description="Effective number of parameters that the readings determine; the penalty determines the "
        "others."
    )
    parameters: int = Field(description="Number of parameters.")


class ElementShare(Message):
    """Share of the measured deflection that an element explains."""

    kind: Literal["joint", "coupling", "link"]
    joint: Name | None = Field(description="Joint, or joint that carries the link; null for coupling.")
    share: Dimensionless[float] = Field(
        description="Share over the set: projection of its predicted deflections on the measured ones, "
        "divided by these; all shares and the unexplained rest sum to 1."
    )
    by_observation: Dimensionless[list[float]] = Field(
        description="Shares in each observation, in the order of the set."
    )


class LinkCertificate(Message):
    """Proof of optimality, recomputed from the data at the returned numbers."""

    least_eigenvalue: float = Field(
        description="Least eigenvalue of all matrices and joint compliances, in the SI unit of its matrix; "
        "never negative."
    )
    dual: Dimensionless[float] = Field(
        description="Distance of the slack matrices from positive semidefinite, relative to the penalty."
    )
    gap: Dimensionless[float] = Field(
        description="Gap, in units of `scale`. Loss `squared`: bound of the difference between the weighted "
        "fitted readings and those of the optimum. Other losses: bound of the objective's excess over its "
        "optimum, as mean length of a residual."
    )
    scale: Metres[float] = Field(
        description="Scale: sigma if given, otherwise the residual scale of the joint model."
    )


class LinksResult(Message):
    """Compliances of the elements that deflect besides the joints."""

    model: ElasticModel
    model_source: Source = Field(description="`cross_validation` for elasticity `automatic`.")
    loss: Loss = Field(description="Loss function of the length of each target's residual.")
    loss_source: Source = Field(description="Source of the loss; `given` also if the options allow only one.")
    penalty: Dimensionless[float] = Field(description="Weight of the penalty.")
    penalty_source: Source
    coupled_joints: Compliance[Matrix | None] = Field(
        description="Full joint compliance, positive semidefinite, for elasticity `coupled_joints`; zero for "
        "joints that are not observable."
    )
    links: list[LinkCompliance] = Field(description="Compliances of the elastic links.")
    elements: list[ElementShare] = Field(description="Contribution of each joint and link.")
    unexplained: Dimensionless[float] = Field(
        description="Share of the measured deflection that no element explains, by squares as the shares of "
        "the elements; `compensation` compares lengths."
    )
    effective_freedom: Dimensionless[float] = Field(
        description="Effective number of parameters of the whole model that the readings determine."
    )
    parameters: int = Field(description="Number of parameters of the whole model.")
    certificate: LinkCertificate


class ScoredModel(Message):
    """Prediction error of a model, fitted with one loss, for held-out configurations."""

    model: ElasticModel
    loss: Loss
    penalty: Dimensionless[float | None] = Field(
        description="Penalty, chosen for this model and loss, or given; null for joints alone."
    )
    compensation: Dimensionless[float] = Field(
        description="Compensation of held-out configurations, mean over the folds."
    )
    standard_error: Dimensionless[float] = Field(
        description="Standard error of that mean, from the dispersion of the folds."
    )
    by_fold: Dimensionless[list[float]] = Field(description="Compensation of each fold.")


class HeldOutGain(Message):
    """Mean residual of held-out postures: the best model with links or coupling, and joints alone."""

    model: ElasticModel
    error: Metres[float] = Field(description="Mean length of the residuals of that model.")
    error_of_joints: Metres[float] = Field(description="Mean length of the residuals of joints alone.")
    standard_error: Metres[float] = Field(description="Standard error of the difference, paired by posture.")


class ModelSelection(Message):
    """Models and losses side by side, from simple to rich."""

    models: list[ScoredModel] = Field(description="Scores of each model with each loss.")
    chosen: ElasticModel = Field(description="Model of this run's numbers.")
    chosen_loss: Loss = Field(description="Loss of this run's numbers.")
    losses: dict[ElasticModel, Loss] = Field(description="Loss of least held-out residual of each model.")
    best: ElasticModel = Field(
        description="Model of least mean residual of held-out postures, each with its best loss."
    )
    simplest: ElasticModel = Field(
        description="Simplest model within one standard error of the best, paired by posture (joints alone: "
        "within two): the recommended one."
    )
    gain: HeldOutGain | None = Field(
        default=None, description="Best model with links or coupling beside joints alone."
    )
