"""A run's model for predictions; elastic links; models scored on held-out postures."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from jointstiff.schemas.fields import (
    Compliance,
    Dimensionless,
    Message,
    Metres,
    Name,
    Newtons,
    Point,
    RotationalCompliance,
    SquareCompliance,
    Torque,
    TranslationalCompliance,
)
from jointstiff.schemas.options import ElasticModel, StoredLoss


class ScoreStep(Message):
    """A step of the distribution of residuals in postures omitted from the fit."""

    score: Metres[float | None] = Field(
        description="Scaled length of the residual of an omitted reading; null if the other postures do "
        "not determine the prediction. The scale is the root of the load's size, or the "
        "residual's growth with `noise`."
    )
    share: float = Field(
        description="Fraction of the readings with at most this score. Postures count equally, and P "
        "postures give a factor of P/(P + 1). Dimensionless."
    )


class ModelError(Message):
    """Residuals of postures omitted one by one, which calibrate the bound of the model error."""

    postures: int = Field(description="Number of postures that were omitted, one after the other.")
    steps: list[ScoreStep] = Field(
        description="Steps of the cumulative distribution of scores in ascending order, merged to about "
        "500 steps."
    )
    force: Newtons[float] = Field(
        description="Reference for the size of forces: the greatest load has size 1; zero without loads."
    )
    moment: Torque[float] = Field(
        description="Reference for the size of moments: the greatest moment has size 1; zero without moments."
    )
    least_load: float = Field(description="Least size of a load in the campaign. Dimensionless.")
    leverage: Metres[float] = Field(
        description="Greatest ratio of the standard uncertainty of a target's prediction to the size of "
        "the load."
    )
    noise: Metres[float | None] = Field(
        default=None,
        description="Standard deviation of a coordinate of a reading. Residuals grow with this value and "
        "with the prediction's standard uncertainty; null if residuals grow with the root of "
        "the load.",
    )
    load_point_leverage: Metres[float] = Field(
        default=0.0,
        description="Greatest ratio of the standard uncertainty of a load point's "
        "prediction to the size of the load, in the measured postures.",
    )


class ElasticPart(Message):
    """Compliances of joints, coupling and links, with their covariance."""

    links: list[Name] = Field(description="Joints whose links may bend.")
    columns: list[int] = Field(
        description="Position of each entry in the list of all compliances. The list has the joints, the "
        "upper triangle of the joints' coupling by columns, 21 entries for each link, and 21 "
        "of the base. Entries off a diagonal are multiplied by √2."
    )
    entries: list[float] = Field(description="Values of the entries in SI units: rad/(N.m), m/N, rad/N.")
    covariance_root: list[float] = Field(
        description="Upper triangular factor T of the covariance T T' of the entries, row by row; empty "
        "if sigma is unknown."
    )


class WeightPart(Message):
    """Own weight of the robot, identified together with the compliances, to predict the sag."""

    gravity: Point = Field(description="Acceleration of gravity in the robot's base frame R0, in m/s².")
    mass: list[list[float]] = Field(
        description="Mass in kg that each joint (column) carries, for the torque of each joint (row). "
        "Readings determine only products of a compliance and a mass.",
        json_schema_extra={"unit": "kg"},
    )
    centre: Metres[list[list[Point]]] = Field(
        description="Centres of the masses, each in the frame that moves with the joint."
    )
    compliance: Compliance[list[float]] = Field(
        description="Compliance of each joint for the sag, also of joints without a published compliance."
    )
    covariance_root: list[list[float]] = Field(
        description="Factor R of the covariance R R' of all compliances, then of products of compliance "
        "with mass and first moment, ordered like `mass`. SI units."
    )


class IdentifiedModel(Message):
    """Errors of the published compliances before any constraint, and the constraints."""

    joints: list[Name] = Field(description="All joints of the robot, in the robot's order.")
    seen: list[Name] = Field(
        description="Joints to which the rows and columns of the following matrices belong."
    )
    estimate: Compliance[list[float]] = Field(description="Estimate without constraints.")
    covariance: SquareCompliance[list[list[float]]] = Field(
        description="Covariance of the unconstrained estimate, including the uncertainty of the force; "
        "empty if sigma is unknown."
    )
    information_root: list[list[float]] | None = Field(
        description="Factor R of the inverse covariance R'R of the determined combinations, in N.m/rad; "
        "null if the covariance is regular."
    )
    lower: Compliance[list[float | None]] = Field(
        description="Lower bound of each joint's compliance; null for a joint without a bound."
    )
    upper: Compliance[list[float | None]] = Field(
        description="Upper bound of each joint's compliance; null for a joint without a bound."
    )
    order: list[tuple[int, int]] = Field(
        description="Pairs of joints in which the first joint is at least as stiff as the second."
    )
    elastic: ElasticPart | None = Field(
        default=None,
        description="All compliances of a model with elastic links or coupling. `seen` then lists the "
        "observable joints, and the other matrices are empty.",
    )
    weight: WeightPart | None = Field(
        default=None,
        description="Effect of the own weight; null for a run by loads alone, or with spring balancers.",
    )
    degrees_of_freedom: float | None = Field(
        description="Degrees of freedom of the estimate of sigma; null if sigma was given."
    )
    error: ModelError | None = Field(
        description="Model error; null if no posture could be omitted, with the reason in `no_error`."
    )
    no_error: str | None = Field(
        default=None, description="Reason why no posture could be omitted from the fit."
    )


Source = Literal["given", "cross_validation"]
Matrix = list[list[float]]


class PrincipalCompliance(Message):
    """Principal compliance to forces or to moments, in the axes of the joint's frame or of R0."""

    value: float = Field(
        description="Compliance along a principal axis: m/N for translation, rad/(N.m) for rotation."
    )
    direction: Dimensionless[Point] = Field(description="Unit vector along the principal axis.")


class ElasticCompliance(Message):
    """Compliance of a link, or of the base below joint 1, in the frame of the link or base."""

    joint: Name | None = Field(
        description="Joint whose frame moves with the near end of the link; null for the base, whose frame "
        "is R0."
    )
    matrix: Matrix = Field(
        description="Compliance matrix, 6 x 6, positive semidefinite: displacement and rotation caused by "
        "force and moment. Units of the blocks of three: m/N, rad/N; m/(N.m), rad/(N.m).",
    )
    translation: TranslationalCompliance[list[PrincipalCompliance]] = Field(
        description="Principal translational compliances, largest first."
    )
    rotation: RotationalCompliance[list[PrincipalCompliance]] = Field(
        description="Principal rotational compliances, largest first."
    )
    effective_freedom: Dimensionless[float] = Field(
        description="Effective number of parameters that the readings, not the penalty, determine."
    )
    parameters: int = Field(description="Number of parameters.")


class ElementShare(Message):
    """Fraction of the measured deflection that an element explains."""

    kind: Literal["joint", "coupling", "link", "base"]
    joint: Name | None = Field(
        description="Joint, or joint that carries the link; null for the coupling and for the base."
    )
    share: Dimensionless[float] = Field(
        description="Fraction of the measured deflections that the element explains, by projection. The "
        "fractions of all elements and of the rest add up to 1."
    )
    by_observation: Dimensionless[list[float]] = Field(
        description="Fraction for each observation, in the order of the set."
    )


class LinkCertificate(Message):
    """Proof of optimality, recomputed from the data at the returned numbers."""

    least_eigenvalue: float = Field(
        description="Least eigenvalue of all compliance matrices, in their SI units; never negative."
    )
    dual: Dimensionless[float] = Field(
        description="Distance of the slack matrices from positive semidefinite matrices, relative to the "
        "penalty."
    )
    gap: Dimensionless[float] = Field(
        description="Gap of the solution, in units of `scale`. Loss `squared`: bound of the distance "
        "between fitted and optimal readings; other losses: bound of the excess of the objective."
    )
    scale: Metres[float] = Field(
        description="Sigma if it was given, else the scale of the residuals of the joint model."
    )


class LinksResult(Message):
    """Compliances of the elements that deflect besides the joints."""

    loss_source: Source = Field(
        description="Source of the loss; `given` also if the options allow only this loss."
    )
    penalty: Dimensionless[float] = Field(description="Weight of the penalty.")
    penalty_source: Source
    coupled_joints: Compliance[Matrix | None] = Field(
        description="Compliance matrix of the joints for elasticity `coupled_joints`; zero for joints that "
        "are not observable."
    )
    links: list[ElasticCompliance] = Field(description="Compliances of the elastic links.")
    base: ElasticCompliance | None = Field(
        default=None, description="Compliance matrix of the base; null for elasticities with a rigid base."
    )
    elements: list[ElementShare] = Field(
        description="Contribution of each joint and link to the deflections."
    )
    unexplained: Dimensionless[float] = Field(
        description="Fraction of the squared deflection that no element explains; `compensation` compares "
        "mean lengths instead."
    )
    effective_freedom: Dimensionless[float] = Field(
        description="Effective number of parameters that the readings determine."
    )
    parameters: int = Field(description="Number of parameters of the whole model.")
    certificate: LinkCertificate


class ScoredModel(Message):
    """Prediction of held-out configurations by a model with one loss."""

    model: ElasticModel
    loss: StoredLoss
    penalty: Dimensionless[float | None] = Field(description="Penalty; null for joints alone.")
    compensation: Dimensionless[float] = Field(
        description="Mean compensation of held-out configurations over all folds."
    )
    standard_error: Dimensionless[float] = Field(
        description="Standard error of the mean compensation, from the dispersion of the folds."
    )
    by_fold: Dimensionless[list[float]] = Field(description="Compensation of each fold.")
    mean_residual: Metres[float | None] = Field(
        description="Mean length of the residuals of held-out postures; null if the model could not be "
        "fitted."
    )
