"""The assessment of a result: one verdict on whether its numbers may be used, with reasons and remedies."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from jointstiff.schemas.fields import Dimensionless, Message, Name, Radians
from jointstiff.schemas.terminal import Terminal

Verdict = Literal["use", "use_with_care", "do_not_use"]


class Action(Message):
    """Action that a program can offer at a click; it changes only what is named here."""

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
        "or force; `convert_units` declares `unit` for the numbers as they are; `exchange_readings` "
        "exchanges unloaded and loaded readings; `choose_model` lets the readings choose elasticity and loss."
    )
    observations: list[Name] = Field(description="Labels of the observations to leave out, or to show.")
    joints: list[Name] = Field(description="Joints whose columns are exchanged, or whose map is corrected.")
    joint_map: Dimensionless[list[list[float]]] = Field(
        description="Rows of the matrix of the corrected joint map; empty for other actions."
    )
    offset: Radians[list[float]] = Field(
        description="Offset of the corrected joint map; empty for other actions."
    )
    target: Name | None = Field(
        description="Target whose place and the load point are exchanged; null for other actions."
    )
    correction: list[float] = Field(
        description="Vector that is added: to the load points in the flange frame, in m, or to the forces in "
        "the axes of R0, in N; empty for other actions.",
    )
    unit: Literal["m", "mm", "deg", "rad", "N", "kN"] | None = Field(
        description="Unit that the numbers are in; null for other actions."
    )


class Reason(Message):
    """One reason not to use the numbers without further ado."""

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
        description="The best verdict that a result with this reason can have."
    )
    where: str | None = Field(
        description="Which observation, reading or joint; null for all of it. In a pair it begins with the "
        "side."
    )
    message: str = Field(description="Reason in words, with its figure and unit.")
    remedy: str = Field(description="Remedy in words.")
    action: Action | None = Field(
        description="Remedy that a program can carry out; null where only people can."
    )


class Assessment(Message):
    """Assessment of a result: may the numbers be used?"""

    verdict: Verdict = Field(description="The least that the reasons allow; `use` where there are none.")
    reasons: list[Reason] = Field(description="Most severe first.")
    notes: list[str] = Field(
        default_factory=list,
        description="Notes on what the readings could not show, and on what was assumed instead.",
    )


class AcceptingOptions(Message):
    """Options of what acts on a robot or guides a measurement: refused from a run not to be used."""

    accept_verdict: Annotated[
        Literal["do_not_use"] | None, Terminal("--despite-verdict", flag="do_not_use")
    ] = Field(
        default=None,
        description="`do_not_use` to go on although the verdict on the run is that; it is refused otherwise.",
    )


class VerdictSummary(Message):
    """Verdict of a result for listings; null while there is none."""

    verdict: Verdict | None = Field(
        default=None,
        description="Verdict of the result's assessment; the worst one where it has several fits.",
    )


class ResultSummary(VerdictSummary):
    """Summary of a result for listings; all null while there is none."""

    compensation: Dimensionless[float | None] = Field(
        default=None,
        description="Share of the mean deflection that the model predicts: of a comparison the greatest, of "
        "a pair that of the side with less.",
    )
    joints_identified: int | None = Field(
        default=None,
        description="Joints of status `identified`: of a comparison in the fit with most, of a pair those "
        "on both sides; null for geometries.",
    )
    joint_count: int | None = Field(default=None, description="All joints; null for geometries.")
    warning_count: int | None = Field(
        default=None, description="Warnings of the result; for geometries findings that are no notes."
    )
