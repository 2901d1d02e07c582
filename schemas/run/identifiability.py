"""What the readings can determine, and what to measure next."""

from __future__ import annotations

from pydantic import Field

from jointstiff.schemas.fields import Compliance, Message, Name, Newtons, Point, Radians


class StageIdentifiability(Message):
    """Of one stage of a method, over the joints that it sees."""

    rank: int = Field(description="How many compliances, or combinations, are determined.")
    condition_number: float | None = Field(
        description="Of the weighted regressor, columns of unit norm; null where the rank is not full. "
        "Dimensionless."
    )
    singular_values: list[float] = Field(description="Of the same matrix, largest first. Dimensionless.")


class ObservabilityIndices(Message):
    """The field's indices of how well a set of postures shows the parameters (Sun & Hollerbach 2008).

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
    """A measurement that would tell more of a joint."""

    joint: Name
    message: str = Field(description="In words: which posture, which load, and what it would bring.")
    joints: Radians[list[float]] = Field(description="Angles as the controller shows them.")
    observation: Name | None = Field(description="The observation that has this posture, if one has.")
    force: Newtons[Point] = Field(
        description="On the robot, axes of R0, as strong as the strongest of the set; at the load point of "
        "that observation, for a new posture at that of the strongest force."
    )
    uncertainty_ratio: float | None = Field(
        description="Standard uncertainty of the compliance after one such reading of all targets over that "
        "before, as the partial pose has them, without constraints and priors; null where the readings so "
        "far do not determine the compliance. Dimensionless."
    )
    standard_uncertainty: Compliance[float | None] = Field(
        default=None, description="Of the compliance after that reading; null where sigma is unknown."
    )


class Identifiability(Message):
    """What the readings can determine, by a model of joints alone."""

    parameters: int = Field(description="Number of joints of the robot.")
    rank: int = Field(description="How many compliances, or combinations, are determined.")
    condition_number: float | None = Field(
        description="The greatest of the stages'; null where a rank is not full. Dimensionless."
    )
    combinations: list[list[Name]] = Field(
        description="Groups of joints whose compliances show in the readings only together."
    )
    observability: ObservabilityIndices | None = Field(
        default=None, description="Over the joints that the readings see; null where the rank is not full."
    )
    advice: list[Advice] = Field(
        default_factory=list,
        description="What to measure next, for at most three joints: those without a number, at zero "
        "compliance, or with a standard uncertainty above a tenth of it. At most two pieces a joint, the "
        "better first: another load in a posture of the set, and a new posture.",
    )
    weakest: list[str] = Field(
        default_factory=list,
        description="In words, for each stage with a condition number above 100: which joints the readings "
        "hardly tell apart, and in which proportion.",
    )
    stages: list[StageIdentifiability] = Field(
        description="One a stage of the method: two for the decoupled one, arm then wrist."
    )
