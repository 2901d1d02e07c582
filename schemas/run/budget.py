"""Uncertainty budget of a run, in the words of the GUM (JCGM 100:2008)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from jointstiff.schemas.fields import Compliance, Dimensionless, Message, Name

BudgetSource = Annotated[
    str,
    Field(
        description="Source of uncertainty: `readings`, the name of a stated error (`force_scale`, "
        "`force_direction`, `load_point`, `target_places`, `axes`), `assumed_load_point`, `model_error` or "
        "`complementary_stiffness`."
    ),
]

BudgetGap = Literal["model_error", "lack_of_fit"]

Evaluation = Annotated[
    Literal["A", "B"],
    Field(description="Type of evaluation: A by statistics of these readings, B as stated with them."),
]


class BudgetComponent(Message):
    """One source of uncertainty."""

    source: BudgetSource
    evaluation: Evaluation
    included: bool = Field(
        description="True if the component is part of the joints' standard uncertainty. Model error is "
        "included only if joints alone do not fit; a neglected complementary stiffness never is."
    )
    degrees_of_freedom: Dimensionless[float | None] = Field(
        description="Degrees of freedom of an evaluation of type A; null for infinitely many."
    )
    contributions: Compliance[list[float]] = Field(
        description="Contribution to the standard uncertainty of each joint of the budget."
    )
    correlation: Dimensionless[list[list[float]]] = Field(
        description="Correlation coefficients between the joints by this source; 0 if a contribution is 0."
    )


class Budget(Message):
    """Uncertainty budget of the compliances. The relative uncertainty of a stiffness is the same."""

    joints: list[Name] = Field(description="Joints with an estimate, in the order of all numbers here.")
    components: list[BudgetComponent]
    standard_uncertainty: Compliance[list[float]] = Field(
        description="Combined standard uncertainty: the root of the sum of the included squares."
    )
    correlation: Dimensionless[list[list[float]]] = Field(
        description="Correlation coefficients of the combined uncertainty between the joints."
    )
    probability: Dimensionless[float] = Field(description="Coverage probability.")
    coverage_factor: Dimensionless[float] = Field(
        description="Factor for that probability: normal, or Student's if sigma comes from the residuals or "
        "the model error is included."
    )
    expanded_uncertainty: Compliance[list[float]] = Field(
        description="Expanded uncertainty: factor times the combined standard uncertainty."
    )
    expanded_with_model_error: Compliance[list[float]] = Field(
        description="Expanded uncertainty of all components, including those not in the intervals."
    )
    missing: list[BudgetGap] = Field(
        description="Sources without a component: with one of them an expanded uncertainty is partial. "
        "`model_error`: too few postures for a bound. `lack_of_fit`: the assessment names a lack of "
        "fit, such as links that bend."
    )
