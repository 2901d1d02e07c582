"""Observability of the parameters, and advice on the next measurements."""

from __future__ import annotations

from pydantic import Field

from jointstiff.schemas.fields import Compliance, Message, Name, Newtons, Point, Radians


class StageIdentifiability(Message):
    """Observability in one stage of a method, over the joints of that stage."""

    rank: int = Field(
        description="Rank: number of compliances, or combinations, that the readings determine."
    )
    condition_number: float | None = Field(
        description="Condition number of the weighted regressor with columns of unit norm; null if "
        "rank-deficient. Dimensionless."
    )
    singular_values: list[float] = Field(
        description="Singular values of the same matrix, largest first. Dimensionless."
    )


class ObservabilityIndices(Message):
    """Observability indices of the parameters in a set of postures (Sun & Hollerbach 2008).

    Of the singular values s of the regressor with each column divided by what it would have been had the
    force pulled across the joint's lever and the moment turned about its axis, in every observation: no
    unit, no frame, and sets of any size compare. They concern the readings of all targets, whatever the
    method made of them. Larger is better; none exceeds 1.
    """

    o1: float = Field(description="Geometric mean of s (Borm & Menq 1991). Dimensionless.")
    o2: float = Field(description="Least over greatest s (Driels & Pathre 1990). Dimensionless.")
    o3: float = Field(description="Least s (Nahvi, Hollerbach & Hayward 1994). Dimensionless.")
    o4: float = Field(
        description="Least s squared over the greatest (Nahvi & Hollerbach 1996). Dimensionless."
    )
    o5: float = Field(description="1 / sum of 1/s (Sun & Hollerbach 2008). Dimensionless.")


class Advice(Message):
    """A measurement that would reduce a joint's uncertainty."""

    joint: Name
    message: str = Field(description="Advice in words: posture, load, and the expected gain.")
    joints: Radians[list[float]] = Field(description="Joint angles as displayed by the controller.")
    observation: Name | None = Field(
        description="Label of the observation with this posture, if there is one."
    )
    force: Newtons[Point] = Field(
        description="Force on the robot, axes of R0, with the magnitude of the set's largest force, at the "
        "load point of that observation, or for a new posture at that of the largest force."
    )
    uncertainty_ratio: float | None = Field(
        description="Ratio of the standard uncertainties of the compliance, after one such reading of all "
        "targets to before, with partial pose, without constraints and priors; null if the "
        "readings so far do not determine the compliance. Dimensionless."
    )
    standard_uncertainty: Compliance[float | None] = Field(
        default=None,
        description="Standard uncertainty of the compliance after that reading; null if sigma is unknown.",
    )


class Identifiability(Message):
    """Observability of the parameters of the joint model."""

    parameters: int = Field(description="Number of joints of the robot.")
    rank: int = Field(
        description="Rank: number of compliances, or combinations, that the readings determine."
    )
    condition_number: float | None = Field(
        description="Condition number, the largest of all stages; null if rank-deficient. Dimensionless."
    )
    combinations: list[list[Name]] = Field(
        description="Groups of joints of which only combinations are observable."
    )
    observability: ObservabilityIndices | None = Field(
        default=None, description="Observability indices of the observable joints; null if rank-deficient."
    )
    advice: list[Advice] = Field(
        default_factory=list,
        description="Advice on the next measurements, for at most three joints: those without a number, at "
        "zero compliance, or with a standard uncertainty above 10 %. At most two pieces of advice "
        "per joint, the better first: another load in a posture of the set, and a new posture.",
    )
    weakest: list[str] = Field(
        default_factory=list,
        description="Messages for each stage with a condition number above 100: joints that are hard to "
        "distinguish, and in which proportion.",
    )
    stages: list[StageIdentifiability] = Field(
        description="Stages of the method: two for the decoupled one, arm then wrist."
    )
