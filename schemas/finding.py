"""Findings in readings and results, their assessment, and problems of requests: what is wrong, what to do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final, Literal

from pydantic import Field

from jointstiff.schemas.fields import (
    Dimensionless,
    Identifier,
    Message,
    Name,
    Payload,
    Positions,
    Terminal,
)


class ProblemItem(Message):
    """One fault in a request."""

    where: str = Field(description="Path of the field.", examples=["observations[3].force"])
    reason: str = Field(description="Description of the fault.")
    remedy: str | None = Field(default=None, description="Recommended correction.")


class Problem(Message):
    """Problem details with the fault, the place of the fault and the remedy."""

    type: str = Field(
        description="Identifier of the kind of problem.",
        examples=["urn:jointstiff:problem:invalid-request"],
    )
    title: str = Field(description="Title of the kind of problem.")
    status: int = Field(description="HTTP status code.")
    detail: str = Field(description="Description of the problem in one sentence.")
    where: str | None = Field(
        default=None, description="Path of the field with the fault; null if no single field has the fault."
    )
    remedy: str | None = Field(default=None, description="Recommended correction.")
    request_id: str | None = Field(
        default=None, description="Identifier of the request, as in `X-Request-Id` and in the service's log."
    )
    errors: list[ProblemItem] = Field(
        default_factory=list, description="First twenty faults of the request, each with the faulty field."
    )


Verdict = Literal["use", "use_with_care", "do_not_use"]

ActionKind = Literal[
    "leave_out_readings",
    "use_huber",
    "include_complementary_stiffness",
    "omit_noise",
    "exchange_columns",
    "apply_joint_map",
    "exchange_load_and_target",
    "omit_load_point",
    "fit_causes",
    "convert_units",
    "exchange_readings",
    "choose_model",
    "choose_robot",
    "state_payload",
    "show_posture",
]

Unit = Literal["m", "mm", "deg", "rad", "N", "kN", "kgf", "lbf"]


class NamedCause(Message):
    """Cause, other than the stiffness of joints, that moved the targets.

    Examples are a wrong load point and play in gears.
    """

    name: Name = Field(
        description="`load_point`, `constant_force` (axes of R0), `load_zero` (a force along the flange's "
        "axes), `rope_zero` (along the rope), `hook_weight`, `load_scale` (of each distinct load, or before "
        "and after), `tool` (bends), `play`, `curved_springs`, `stiffness` (another one since `first`), "
        "`growth` (of the arm), `growth_over_time`, `shift` or `turn` (with a shift) of all positions under "
        "load."
    )
    first: Name | None = Field(
        default=None,
        description="Label of the first observation that the mistake affects; null if all observations "
        "are affected.",
    )

    @property
    def name_and_first_label(self) -> tuple[str, str | None]:
        """Pair (name of the cause, label of the first observation that it concerns, or None for all)."""
        return self.name, self.first


class AdvisedAction(Message):
    """Action that a program can offer. The action changes only the named options or readings."""

    kind: ActionKind = Field(
        description="`fit_causes`: identify with `causes` as further unknowns, without `observations`. "
        "`convert_units`: keep the numbers, and declare `unit`. `exchange_readings`: swap unloaded and "
        "loaded readings. `choose_model`: let the readings choose elasticity and loss. `choose_robot`: "
        "identify with `robot`. `state_payload`: keep `payload` with the robot. `omit_load_point`: keep "
        "the reading of the load point only."
    )
    observations: list[Name] = Field(description="Labels of the observations that the action omits or shows.")
    joints: list[Name] = Field(
        description="Joints whose columns the action exchanges, or whose joint map the action corrects."
    )
    joint_map: Dimensionless[list[list[float]]] = Field(
        description="Rows of the matrix of the corrected joint map; empty unless the action corrects the map."
    )
    offset: Positions[list[float]] = Field(
        description="Offset of each joint in the corrected joint map; empty unless the action corrects the "
        "map."
    )
    target: Name | None = Field(
        description="Target whose position is exchanged with the load point; null for other actions."
    )
    targets: list[Name] = Field(
        default_factory=list,
        description="Targets whose readings are exchanged; empty if the readings of all targets are "
        "exchanged.",
    )
    causes: list[NamedCause] = Field(
        description="Systematic errors to fit together with the joints; empty for other actions."
    )
    unit: Unit | None = Field(
        description="Unit of the numbers after their correction; null for other actions."
    )
    robot: Name | None = Field(
        default=None,
        description="Name of the robot that the action chooses; null for other actions.",
    )
    robot_id: Identifier | None = Field(
        default=None,
        description="Id of the stored robot; null for an arm of the catalogue and for other actions.",
    )
    payload: Payload | None = Field(
        default=None,
        description="Payload of the robot, for the action `state_payload`.",
    )

    @classmethod
    def of(
        cls,
        kind: ActionKind,
        observations: Sequence[str] = (),
        *,
        joints: Sequence[str] = (),
        joint_map: Sequence[Sequence[float]] = (),
        offset: Sequence[float] = (),
        target: str | None = None,
        targets: Sequence[str] = (),
        causes: Sequence[NamedCause] = (),
        unit: Unit | None = None,
        robot: str | None = None,
        robot_id: str | None = None,
    ) -> AdvisedAction:
        """Build an action; fields for which no argument is given are empty or null."""
        return cls(
            kind=kind,
            observations=list(observations),
            joints=list(joints),
            joint_map=[list(row) for row in joint_map],
            offset=list(offset),
            target=target,
            targets=list(targets),
            causes=list(causes),
            unit=unit,
            robot=robot,
            robot_id=robot_id,
        )


FindingCode = Literal[
    # in the readings
    "targets_not_rigid",
    "target_moved",
    "targets_swapped",
    "target_off_model",
    "another_robot_fits",
    "observations_out_of_order",
    "duplicated_observation",
    "joint_sign_suspect",
    "joints_swapped",
    "joints_counted_otherwise",
    "frame_mistaken",
    "frame_left_handed",
    "lengths_differ",
    "length_unit_suspect",
    "force_unit_suspect",
    "force_sign_suspect",
    "load_point_refuted",
    "drift_in_time",
    "repeated_readings",
    "residual_outlier",
    "deflections_unexplained",
    "target_name_suspect",
    "deflection_against_force",
    "encoder_against_torque",
    "encoder_deflection_implausibly_large",
    "joint_outside_limits",
    "angle_unit_suspect",
    "deflection_implausibly_large",
    "deflection_implausibly_small",
    "deflection_below_noise",
    "sigma_suspect",
    "zero_load",
    "angle_rounded",
    # in the readings of a geometry
    "short_arc",
    "tracker_bumped",
    "position_suspect",
    "reading_suspect",
    "residuals_below_sigma",
    "angle_scale_suspect",
    "axes_nearly_parallel",
    "base_drifted",
    "base_target_moved",
    "sweeps_disagree",
    "wrist_centres_disagree",
    "parameters_not_identified",
    # in a result
    "no_joint_identified",
    "no_residual_freedom",
    "few_postures",
    "residuals_exceed_sigma",
    "sigma_overstated",
    "residuals_vanish",
    "deflection_unexplained",
    "alternative_explains_better",
    "cause_fitted",
    "load_at_target",
    "joint_poorly_known",
    "stiffness_negative",
    "stiffness_implausible",
    "stiffness_against_payload",
    "payload_not_stated",
    "prior_dominates",
    "complementary_stiffness_matters",
    "statement_dropped",
    "solver_disagrees",
    "links_bend_with_joints",
    "base_bends",
    "links_or_base",
    "base_unchecked",
    "masses_contradicted",
    "masses_unchecked",
    "lack_of_fit",
    "sigma_implausible",
    "deflection_remains",
    "deflections_below_noise",
    "link_penalty_at_end",
    "link_penalty_raised",
    "loss_not_compared",
    # in a corrected program
    "moves_left",
    "corrections_capped",
    "beyond_campaign",
    "near_singularity",
    "nothing_corrected",
    # in a process
    "prior_stiffness",
    # in a weight step
    "mass_assumed",
    "approach_unknown",
    "approaches_alike",
    "posture_against_encoders",
    "encoder_referenced_anew",
    "step_off_the_others",
    "gearbox_uncertain",
    "check_by_log",
    "logs_contradict",
    # in what is made of a run
    "prediction_implausible",
    "point_implausible",
    "numbers_missing",
    "joint_left_out",
    "joint_stays_uncertain",
    # in two results side by side
    "no_common_configuration",
    "configurations_differ",
    "encoder_against_difference",
    "robot_models_differ",
]


ROOT_MISTAKES: Final[frozenset[FindingCode]] = frozenset(
    {
        "length_unit_suspect",
        "angle_unit_suspect",
        "force_unit_suspect",
        "another_robot_fits",
        "frame_mistaken",
        "frame_left_handed",
    }
)
"""Codes of findings that cause other findings: an assessment with one of them lists no other reason."""

QUESTIONS: Final[frozenset[FindingCode]] = frozenset({"payload_not_stated"})
"""Codes of findings that ask a person; they limit no verdict."""
UNKNOWN_JOINTS: Final[frozenset[FindingCode]] = frozenset({"joint_poorly_known", "stiffness_negative"})
"""Codes of findings on a joint whose stiffness is not known well enough to be used."""


class Finding(Message):
    """Suspicious fact about readings or a result. No data are refused or changed because of a finding."""

    code: FindingCode = Field(description="Kind of the finding.")
    weight: Verdict = Field(
        description="Best verdict that the finding allows. `do_not_use`: the readings almost certainly "
        "contain a mistake. `use_with_care`: check the readings. `use`: the finding is a remark."
    )
    where: str | None = Field(
        default=None,
        description="Observation, reading, sweep or joint that the finding concerns; null for the whole "
        "set. In a comparison of two sides, the text begins with the side.",
    )
    observation: Name | None = Field(
        default=None,
        description="Label of the observation; null if the finding concerns no single observation.",
    )
    message: str = Field(description="Observed effect, with number and unit.")
    remedy: str = Field(description="Remedy in words.")
    action: AdvisedAction | None = Field(
        default=None,
        description="Remedy that a program can carry out; null if only a person can correct the mistake.",
    )

    @property
    def is_remark(self) -> bool:
        """True if the finding allows the verdict `use`."""
        return self.weight == "use"


class Assessment(Message):
    """Assessment of a result by a verdict and the reasons for the verdict."""

    verdict: Verdict = Field(description="Worst verdict that a reason allows; `use` if there are no reasons.")
    reasons: list[Finding] = Field(
        description="Findings that do not allow the verdict `use`; the most severe is first."
    )
    questions: list[Finding] = Field(
        default_factory=list,
        description="Questions about facts that a person knows and readings do not show, as the payload. "
        "An answer is kept with the robot; an open question limits no verdict.",
    )
    joints_identified: int | None = Field(
        default=None,
        description="Least number of joints, over all fits, whose stiffness is positive, has an upper limit "
        "and, if the joint carries 5 % of the deflection, is known within the goal; null for geometries.",
    )
    joint_count: int | None = Field(default=None, description="Number of joints; null for geometries.")
    headline: str | None = Field(
        default=None,
        description="Verdict in one line, for results that are computed from a run; null for runs and "
        "geometries.",
    )
    notes: list[str] = Field(
        default_factory=list,
        description="Checks that the readings do not allow, and assumptions made in place of the checks.",
    )


class AcceptingOptions(Message):
    """Options of jobs that use the model of a run; a run with the verdict `do_not_use` is refused."""

    accept_verdict: Annotated[
        Literal["do_not_use"] | None, Terminal("--despite-verdict", flag="do_not_use")
    ] = Field(
        default=None,
        description="`do_not_use` confirms the use of a run with the verdict *do not use*.",
    )


class ResultSummary(Message):
    """Summary of a result for listings; fields are null while there is no result."""

    verdict: Verdict | None = Field(
        default=None,
        description="Verdict; the worst one of several fits.",
    )
    compensation: Dimensionless[float | None] = Field(
        default=None,
        description="Fraction of the mean deflection that the model predicts. A comparison has the "
        "greatest fraction of its runs, or the smaller of two sets.",
    )
    joints_identified: int | None = Field(
        default=None,
        description="Number of joints whose stiffness has an upper limit; null for geometries. A "
        "comparison has the greatest number of its runs, or the smaller of two sets.",
    )
    joint_count: int | None = Field(default=None, description="Number of joints; null for geometries.")
    warning_count: int | None = Field(
        default=None,
        description="Number of warnings; for a geometry, the number of findings that are not notes.",
    )


def combine_assessments(assessments: Sequence[Assessment]) -> Assessment:
    """Merge assessments: return the worst verdict with all reasons, most severe first.

    Of reasons with equal code and place only the first is kept. The numbers of joints are taken from the
    assessment with the fewest identified joints. Notes are left out, because they concern a single run. Each
    question is kept once, without the action, which concerns a single run, too.
    """
    reasons: dict[tuple[str, str | None], Finding] = {}  # (code, place) → reason
    questions: dict[str, Finding] = {}  # code → question
    for assessment in assessments:
        for reason in assessment.reasons:
            reasons.setdefault((reason.code, reason.where), reason)
        for question in assessment.questions:
            questions.setdefault(question.code, question.model_copy(update={"action": None}))
    counts = [
        (assessment.joints_identified, assessment.joint_count)
        for assessment in assessments
        if assessment.joints_identified is not None
    ]
    joints_identified, joint_count = min(counts, default=(None, None))
    verdicts = (assessment.verdict for assessment in assessments)
    return Assessment(
        joints_identified=joints_identified,
        joint_count=joint_count,
        verdict=max(verdicts, key=_VERDICTS_BY_SEVERITY.index, default="use"),
        reasons=sorted(reasons.values(), key=lambda reason: -_VERDICTS_BY_SEVERITY.index(reason.weight)),
        questions=list(questions.values()),
    )


_VERDICTS_BY_SEVERITY: tuple[Verdict, ...] = ("use", "use_with_care", "do_not_use")
