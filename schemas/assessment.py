"""The assessment of a result: one verdict on whether its numbers may be used, with reasons and remedies."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from jointstiff.schemas.fields import Dimensionless, Message, Name, Radians
from jointstiff.schemas.terminal import Terminal

Verdict = Literal["use", "use_with_care", "do_not_use"]


class Action(Message):
    """Action that a program can offer; it changes only the named options or readings."""

    kind: Literal[
        "leave_out_readings",
        "use_huber",
        "include_complementary_stiffness",
        "omit_noise",
        "exchange_columns",
        "apply_joint_map",
        "exchange_load_and_target",
        "correct_load_point",
        "correct_force",
        "convert_units",
        "exchange_readings",
        "choose_model",
        "show_posture",
    ] = Field(
        description="Action. `correct_load_point` and `correct_force` add `correction` to every load point "
        "or force; `convert_units` declares `unit` and keeps the numbers; `exchange_readings` "
        "exchanges unloaded and loaded readings; `choose_model` lets the readings choose elasticity and loss."
    )
    observations: list[Name] = Field(description="Labels of the observations to omit, or to show.")
    joints: list[Name] = Field(description="Joints whose columns are exchanged, or whose map is corrected.")
    joint_map: Dimensionless[list[list[float]]] = Field(
        description="Rows of the matrix of the corrected joint map; empty for other actions."
    )
    offset: Radians[list[float]] = Field(
        description="Offset of the corrected joint map; empty for other actions."
    )
    target: Name | None = Field(
        description="Target whose position is exchanged with the load point; null for other actions."
    )
    correction: list[float] = Field(
        description="Vector to add to the load points (flange frame, in m) or to the forces (axes of R0, in "
        "N); empty for other actions.",
    )
    unit: Literal["m", "mm", "deg", "rad", "N", "kN"] | None = Field(
        description="Unit of the numbers; null for other actions."
    )


class Reason(Message):
    """One reason not to use the result, or to use it with care."""

    code: Literal[
        "no_joint_identified",
        "no_residual_freedom",
        "few_postures",
        "gross_error",
        "suspicious_readings",
        "length_unit_suspect",
        "residuals_exceed_sigma",
        "residuals_vanish",
        "deflection_unexplained",
        "alternative_explains_better",
        "load_at_target",
        "stiffness_implausible",
        "prior_dominates",
        "complementary_stiffness_matters",
        "links_bend_with_joints",
        "masses_contradicted",
        "lack_of_fit",
        "sigma_implausible",
        "deflections_below_noise",
        "no_common_configuration",
    ]
    weight: Literal["use_with_care", "do_not_use"] = Field(
        description="Best verdict of a result with this reason."
    )
    where: str | None = Field(
        description="Observation, reading or joint; null for the whole result. In a pair it begins with the "
        "side."
    )
    message: str = Field(description="Reason in words, with its figure and unit.")
    remedy: str = Field(description="Remedy in words.")
    action: Action | None = Field(
        description="Remedy that a program can carry out; null if it needs a person."
    )


class Assessment(Message):
    """Assessment of a result: its verdict with the reasons."""

    verdict: Verdict = Field(description="Worst verdict of the reasons; `use` without reasons.")
    reasons: list[Reason] = Field(description="Reasons, most severe first.")
    joints_identified: int | None = Field(
        default=None,
        description="Number of joints of status `identified`; the least of several fits; null for "
        "geometries.",
    )
    joint_count: int | None = Field(default=None, description="Number of joints; null for geometries.")
    notes: list[str] = Field(
        default_factory=list,
        description="Checks that these readings do not allow, and assumptions in their place.",
    )


class AcceptingOptions(Message):
    """Options of jobs that use the model of a run; a run with the verdict `do_not_use` is refused."""

    accept_verdict: Annotated[
        Literal["do_not_use"] | None, Terminal("--despite-verdict", flag="do_not_use")
    ] = Field(
        default=None,
        description="`do_not_use` accepts a run with this verdict, which is refused otherwise.",
    )


class VerdictSummary(Message):
    """Verdict of a result for listings; null while there is none."""

    verdict: Verdict | None = Field(
        default=None,
        description="Verdict of the result; the worst one of several fits.",
    )


class ResultSummary(VerdictSummary):
    """Summary of a result for listings; all null while there is none."""

    compensation: Dimensionless[float | None] = Field(
        default=None,
        description="Share of the mean deflection that the model predicts; the greatest of a comparison, "
        "the smaller of a pair.",
    )
    joints_identified: int | None = Field(
        default=None,
        description="Number of joints of status `identified`; the largest of a comparison's fits, those on "
        "both sides of a pair; null for geometries.",
    )
    joint_count: int | None = Field(default=None, description="Number of joints; null for geometries.")
    warning_count: int | None = Field(
        default=None, description="Number of warnings; for geometries of findings except notes."
    )
