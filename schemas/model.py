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
        description="Length of a residual divided by the root of its load's size, or by its growth with "
        "`noise`; null if the other postures do not determine it."
    )
    share: float = Field(
        description="Fraction of the readings whose score is at most this score, with equal weights of the "
        "P postures, multiplied by P/(P + 1). Dimensionless."
    )


class ModelError(Message):
    """Residuals in postures omitted in turn, which calibrate the bound of the model error."""

    postures: int = Field(description="Number of postures that were omitted in turn.")
    steps: list[ScoreStep] = Field(
        description="Steps of the distribution of scores, ascending; neighbours are merged to leave about "
        "500."
    )
    force: Newtons[float] = Field(
        description="Reference for the size of loads: the greatest load has size 1; zero without loads."
    )
    moment: Torque[float] = Field(
        description="Reference for moments of loads: the greatest moment has size 1; zero without moments."
    )
    least_load: float = Field(description="Least size of a load. Dimensionless.")
    leverage: Metres[float] = Field(
        description="Greatest standard uncertainty of a target's prediction over the size of its load."
    )
    noise: Metres[float | None] = Field(
        default=None,
        description="Standard deviation of a coordinate of a reading: residuals grow with it and the "
        "standard uncertainty of the prediction; null if they grow with the root of the load.",
    )
    load_point_leverage: Metres[float] = Field(
        default=0.0, description="The same as `leverage`, for load points in their postures."
    )


class ElasticPart(Message):
    """Compliances of joints, coupling and links, with their covariance."""

    links: list[Name] = Field(description="Joints whose links may bend.")
    columns: list[int] = Field(
        description="Place of each entry among the n joints, the upper triangle of their coupling by "
        "columns, 21 entries per link in the same order, and 21 of the base; entries off a diagonal are "
        "multiplied by √2."
    )
    entries: list[float] = Field(description="Entries in SI units: rad/(N.m), m/N, rad/N.")
    covariance_root: list[float] = Field(
        description="Upper triangular T row by row, T T' the covariance of the entries; empty if sigma is "
        "unknown. Units of the entries."
    )


class WeightPart(Message):
    """Own weight of the robot as it was identified with the compliances, for the sag."""

    gravity: Point = Field(description="Acceleration of gravity in R0, in m/s².")
    mass: list[list[float]] = Field(
        description="Mass in kg that each joint carries (columns), in the torque of each joint (rows); "
        "readings determine products of a compliance and a mass.",
        json_schema_extra={"unit": "kg"},
    )
    centre: Metres[list[list[Point]]] = Field(
        description="Centres of these masses, in the frames that move with the joints."
    )
    covariance_root: list[list[float]] = Field(
        description="R with R R' the covariance of all compliances, then of their products with mass and "
        "first moment in the order of `mass`. SI units."
    )


class IdentifiedModel(Message):
    """Compliances with their errors before any constraint, and the constraints."""

    joints: list[Name] = Field(description="All joints, in the order of the robot.")
    compliance: Compliance[list[float]] = Field(
        description="Compliance of each joint, as predictions use it; zero if unknown. Those of "
        "joints not in `seen` serve the sag by own weight only."
    )
    seen: list[Name] = Field(description="Joints to which the following rows and columns belong.")
    estimate: Compliance[list[float]] = Field(description="Estimate without constraints.")
    covariance: SquareCompliance[list[list[float]]] = Field(
        description="Covariance of the unconstrained estimate, the uncertainty of the force included; "
        "empty if sigma is unknown."
    )
    information_root: list[list[float]] | None = Field(
        description="Matrix R with R'R the inverse of the covariance of the determined combinations, in "
        "N.m/rad; null if the covariance is regular."
    )
    lower: Compliance[list[float | None]] = Field(
        description="Lower bound of each joint's compliance; null: no bound."
    )
    upper: Compliance[list[float | None]] = Field(
        description="Upper bound of each joint's compliance; null: no bound."
    )
    order: list[tuple[int, int]] = Field(
        description="Pairs of joints: the first is no softer than the second."
    )
    elastic: ElasticPart | None = Field(
        default=None,
        description="All compliances if links or coupling are elastic; the other matrices are then "
        "empty, and `seen` names the observable joints.",
    )
    weight: WeightPart | None = Field(
        default=None, description="Own weight; null for a run by loads alone, or with spring balancers."
    )
    degrees_of_freedom: float | None = Field(
        description="Degrees of freedom of sigma; null if sigma was given."
    )
    error: ModelError | None = Field(
        description="Model error; null if no posture could be omitted, see `no_error`."
    )
    no_error: str | None = Field(default=None, description="Reason why no posture could be omitted.")


Source = Literal["given", "cross_validation"]
Matrix = list[list[float]]


class PrincipalCompliance(Message):
    """Principal compliance to forces or to moments, in the axes of the joint's frame or of R0."""

    value: float = Field(description="Principal compliance: m/N for translation, rad/(N.m) for rotation.")
    direction: Dimensionless[Point] = Field(description="Unit vector of its axis.")


class ElasticCompliance(Message):
    """Compliance of a link, or of the base below joint 1, about the origin and in the axes of its frame."""

    joint: Name | None = Field(
        description="Joint whose frame moves with the link's near end; null for the base, whose frame is R0."
    )
    matrix: Matrix = Field(
        description="Compliance, 6 x 6, positive semidefinite: displacement and rotation by force and "
        "moment. Units by block of three: m/N, rad/N; m/(N.m), rad/(N.m).",
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
        description="Joint, or joint that carries the link; null for coupling and base."
    )
    share: Dimensionless[float] = Field(
        description="Fraction of the measured deflections that this element explains, by projection; with "
        "the rest the sum is 1."
    )
    by_observation: Dimensionless[list[float]] = Field(
        description="Fractions in each observation, in the order of the set."
    )


class LinkCertificate(Message):
    """Proof of optimality, recomputed from the data at the returned numbers."""

    least_eigenvalue: float = Field(
        description="Least eigenvalue of all matrices, in their SI units; never negative."
    )
    dual: Dimensionless[float] = Field(
        description="Distance of the slack matrices from semidefinite, relative to the penalty."
    )
    gap: Dimensionless[float] = Field(
        description="Gap, in units of `scale`: for the loss `squared`, bound of the distance of the fitted "
        "readings from the optimum's; else of the objective's excess."
    )
    scale: Metres[float] = Field(description="Sigma if given, else the residual scale of the joint model.")


class LinksResult(Message):
    """Compliances of the elements that deflect besides the joints."""

    loss_source: Source = Field(description="Source of the loss; `given` also if the options allow only one.")
    penalty: Dimensionless[float] = Field(description="Weight of the penalty.")
    penalty_source: Source
    coupled_joints: Compliance[Matrix | None] = Field(
        description="Joint compliance for elasticity `coupled_joints`; zero for joints that are not "
        "observable."
    )
    links: list[ElasticCompliance] = Field(description="Compliances of the elastic links.")
    base: ElasticCompliance | None = Field(
        default=None, description="Compliance of the base; null for elasticities whose base is rigid."
    )
    elements: list[ElementShare] = Field(description="Contribution of each joint and link.")
    unexplained: Dimensionless[float] = Field(
        description="Fraction of the squared deflection that no element explains; `compensation` compares "
        "lengths instead."
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
        description="Compensation of held-out configurations, mean over the folds."
    )
    standard_error: Dimensionless[float] = Field(
        description="Standard error of that mean, from the dispersion of the folds."
    )
    by_fold: Dimensionless[list[float]] = Field(description="Compensation of each fold.")
    mean_residual: Metres[float | None] = Field(
        description="Mean length of the residuals of held-out postures; null without an answer."
    )
