"""The model that a run identified, complete enough to predict with."""

from __future__ import annotations

from pydantic import Field

from jointstiff.schemas.fields import (
    Compliance,
    Message,
    Metres,
    Name,
    Newtons,
    Point,
    SquareCompliance,
    Torque,
)


class ScoreStep(Message):
    """A step of the distribution of residuals in postures omitted from the fit."""

    score: Metres[float | None] = Field(
        description="Length of a residual divided by the root of its load's size; null if the other "
        "postures do not determine it."
    )
    share: float = Field(
        description="Share of the readings with that score at most, each posture counting the same, times "
        "P/(P + 1) for P postures. Dimensionless."
    )


class ModelError(Message):
    """Residuals in postures omitted in turn, which calibrate the bound of the model error."""

    postures: int = Field(description="Number of postures that were omitted in turn.")
    steps: list[ScoreStep] = Field(
        description="Points by ascending score, neighbours merged beyond about 500."
    )
    force: Newtons[float] = Field(
        description="Unit of a load's size: the greatest load has size 1; zero without loads."
    )
    moment: Torque[float] = Field(
        description="Unit of a load's moment: the greatest moment has size 1; zero without moments."
    )
    least_load: float = Field(description="Least size of a load. Dimensionless.")
    leverage: Metres[float] = Field(
        description="Greatest standard uncertainty of a target's prediction over the size of its load."
    )


class ElasticPart(Message):
    """Compliances of joints, coupling and links, with their covariance."""

    links: list[Name] = Field(description="Joints whose links may bend.")
    columns: list[int] = Field(
        description="Place of each entry among the n joints, the upper triangle of their coupling by "
        "columns, and 21 entries per link in the same order; entries off a diagonal are multiplied by √2."
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
        description="Compliance of each joint, as predictions use it; zero if nothing tells it. Those of "
        "joints not in `seen` serve the sag by own weight only."
    )
    seen: list[Name] = Field(description="Joints to which the following rows and columns belong.")
    estimate: Compliance[list[float]] = Field(description="Estimate without constraints.")
    covariance: SquareCompliance[list[list[float]]] = Field(
        description="Covariance of that estimate, the uncertainty of the force included; empty if sigma is "
        "unknown."
    )
    information_root: list[list[float]] | None = Field(
        description="Matrix R with R'R the inverse of the covariance of the determined combinations, in "
        "N.m/rad; null if the covariance is regular."
    )
    lower: Compliance[list[float | None]] = Field(description="Lower bound of each joint; null for none.")
    upper: Compliance[list[float | None]] = Field(description="Upper bound of each joint; null for none.")
    order: list[tuple[int, int]] = Field(
        description="Pairs of joints: the first is no softer than the second."
    )
    elastic: ElasticPart | None = Field(
        default=None,
        description="All compliances if links or coupling are elastic; the rows and columns above are then "
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
