"""A comparison of stored runs: methods side by side (the paper's Table II), and two measurement sets."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, StrictBool, field_validator

from jointstiff.schemas.fields import (
    Compliance,
    Confidence,
    Dimensionless,
    Identifier,
    Interval,
    Message,
    Metres,
    Name,
    Stiffness,
    Terminal,
    parse_resampling,
)
from jointstiff.schemas.finding import Assessment, Finding, Problem, ResultSummary
from jointstiff.schemas.job import Job, Result
from jointstiff.schemas.joints import StatedKind
from jointstiff.schemas.options import Method, MethodOptions, Resampling, RunOptions, Weighting
from jointstiff.schemas.robot import Estimate
from jointstiff.schemas.run import Certificate, JointResult, ResamplingResult, count_identified_joints

MAX_METHODS = 8
MAX_COMPARED = 48

Constraint = Literal["unconstrained", "positive"]
Side = Literal["first", "second"]


class ComparedMethod(MethodOptions):
    """One of the methods to compare."""

    method: Method


PAPER_METHODS = (
    ComparedMethod(method="complete_pose", weighting="characteristic_length"),
    ComparedMethod(method="complete_pose"),
    ComparedMethod(method="partial_pose"),
    ComparedMethod(method="decoupled_partial_pose"),
)
"""Methods to compare. Default: the paper's three, and the complete pose with covariance weights (method.md
§3)."""


class ComparisonOptions(Message):
    """Options of a comparison."""

    ordered: Annotated[bool, Field(strict=True)] = Field(
        default=False,
        description="True to fit both measurement sets also together, with no joint softer in the second "
        "set.",
    )
    same_load: Annotated[bool, Field(strict=True)] = Field(
        default=False,
        description="True if the load acted at the same point of the flange in both measurement sets. "
        "Both sets then share one error of the load point.",
    )
    same_cell: Annotated[bool, Field(strict=True)] = Field(
        default=False,
        description="True if one load cell, or one set of weights, gave the forces of both measurement "
        "sets. Both sets then share one error of scale.",
    )
    confidence: Confidence | None = Field(
        default=None,
        description="Confidence level of the intervals of the ratios; default: the confidence level of the "
        "first run.",
    )


class ComparisonRequest(ComparisonOptions):
    """Request to compare runs of one measurement set, or of two measurement sets (called sides)."""

    run_ids: Annotated[list[Identifier], Field(min_length=2, max_length=MAX_COMPARED)] = Field(
        description="Runs to compare; of two sets, the first run of each set is compared. For each run "
        "with an active constraint, list also the run with `positive` false, whose "
        "stiffnesses give the ratios."
    )

    @field_validator("run_ids", mode="after")
    @classmethod
    def _refuse_repeated_runs(cls, run_ids: list[str]) -> list[str]:
        if len(set(run_ids)) < len(run_ids):
            raise ValueError("must not contain duplicates")
        return run_ids


class CampaignComparison(ComparisonOptions):
    """Runs to identify from one or two campaigns, and to compare; default: the paper's Table II."""

    methods: Annotated[list[ComparedMethod], Field(max_length=MAX_METHODS)] = Field(
        default=list(PAPER_METHODS), description="Methods, each at most once."
    )
    constraints: Annotated[list[Constraint], Field(min_length=1, max_length=2)] = Field(
        default=["unconstrained", "positive"],
        description="Constraint of each fit: `unconstrained`, or `positive` for compliances of zero or more.",
    )
    resampling: Annotated[
        Resampling | None, Terminal("--resample", "SIZE[:REPETITIONS[:SEED]]", parse_resampling)
    ] = Field(
        default=None,
        description="Resampling: repeat each fit on configurations drawn at random, the same for all "
        "methods. The comparison may take long.",
    )
    run: RunOptions | None = Field(
        default=None,
        description="Options of the runs that compare two campaigns; default: the options of the first "
        "campaign. Each campaign states `priors`, `resampling` and `leave_out` itself.",
    )

    @field_validator("run", mode="after")
    @classmethod
    def _refuse_options_of_one_set(cls, options: RunOptions | None) -> RunOptions | None:
        """Refuse options that cannot be the same for both campaigns of a comparison."""
        if options is not None and (options.priors or options.resampling is not None):
            raise ValueError("must have neither `priors` nor `resampling`")
        if options is not None and options.leave_out:
            raise ValueError(
                "must not have `leave_out`, because each campaign states its own observations to omit"
            )
        return options

    @field_validator("methods", "constraints", mode="after")
    @classmethod
    def _refuse_repeated_items(cls, items: list[object]) -> list[object]:
        if any(item in items[:i] for i, item in enumerate(items)):
            raise ValueError("must not contain duplicates")
        return items


class ComparedRun(Message):
    """One run of the comparison; a failed run has no numbers."""

    run_id: Identifier
    side: Side = Field(description="Side of the comparison (first or second) to which the run belongs.")
    method: Method
    weighting: Weighting
    characteristic_length: Metres[float | None] = Field(
        description="Length that divides translations; null if the weighting uses no length."
    )
    positive: StrictBool = Field(
        description="True if compliances were constrained to be zero or more in the run."
    )
    error: Problem | None = Field(description="Reason why the run has no numbers; null if it has numbers.")
    joints: list[JointResult] = Field(
        description="Results of the joints from all configurations of the set; empty if the run has failed."
    )
    assessment: Assessment | None = Field(description="Assessment of the run; null if the run has failed.")
    compensation: Dimensionless[float | None] = Field(
        description="Fraction of the mean deflection that the model explains; null if nothing moved or "
        "no degrees of freedom remain."
    )
    rms_residual: Metres[float | None] = Field(
        description="Root mean square of the residual vectors' lengths."
    )
    condition_number: Dimensionless[float | None] = Field(
        description="Largest condition number of all stages, for regressor columns of unit length; null "
        "if rank-deficient."
    )
    draws: Resampling | None = Field(description="Options of the resampling, if requested.")
    resampling: ResamplingResult | None = Field(description="Results of the resampling, if requested.")
    left: Metres[list[float | None]] = Field(
        description="Mean length of the residuals in each configuration; null for configurations that the "
        "run omits."
    )


class ComparedSide(Message):
    """A measurement set of the comparison."""

    side: Side
    measurement_set_id: Identifier
    run_id: Identifier = Field(description="Run that represents the side.")
    configurations: list[Name] = Field(description="Labels of the side's observations.")
    deflection: Metres[list[float | None]] = Field(
        description="Mean length of the measured deflection in each configuration; null for configurations "
        "that all runs omit."
    )


class JointRatio(Message):
    """Ratio of the stiffnesses of one joint."""

    name: Name
    ratio: Dimensionless[float | None] = Field(
        default=None,
        description="Second stiffness divided by first stiffness, without constraints; null if one is "
        "not positive.",
    )
    ratio_interval: Dimensionless[tuple[float | None, float | None] | None] = Field(
        default=None,
        description="Fieller's interval of the ratio, cut at zero with the constraint. A null end means "
        "no limit; a null interval is unknown.",
    )
    ratio_excluded: Dimensionless[Interval | None] = Field(
        default=None,
        description="Lower and upper end of the excluded ratios, if the readings exclude only a range.",
    )
    p_value: Dimensionless[float | None] = Field(
        default=None,
        description="Two-sided p-value of an unchanged compliance.",
    )
    reason: str | None = Field(default=None, description="Reason why there is no ratio.")


class ConfigurationShare(Message):
    """Fraction of the deflection in one observation that the second side avoids."""

    observation: Name
    side: Literal["first", "second", "both"] = Field(
        description="Measurement sets that contain the observation."
    )
    measured: Estimate | None = Field(
        description="Measured fraction of avoided deflection; null if one measurement set lacks the "
        "observation."
    )
    predicted: float | None = Field(
        description="Predicted fraction of avoided deflection; null if a joint that deflects is not "
        "observable in one set."
    )


class AvoidedDeflection(Message):
    """One minus the mean deflection of the second measurement set divided by the mean of the first set."""

    matching: int = Field(
        description="Number of observations with equal label, posture and load in both measurement sets. "
        "Postures may differ by 1 mrad, loads by 0.5 % and 1 mm."
    )
    measured: Estimate | None = Field(
        description="Measured fraction of avoided deflection over matching observations; null if no "
        "observations match."
    )
    predicted: float | None = Field(description="Predicted fraction, of all observations.")
    configurations: list[ConfigurationShare]


class OrderedJoint(Message):
    """One joint in the common fit of two measurement sets.

    Numbers are null for a set that does not determine the joint.
    """

    name: Name
    kind: StatedKind = "revolute"
    compliance_first: Compliance[float | None]
    compliance_second: Compliance[float | None] = Field(description="Never larger than `compliance_first`.")
    stiffness_first: Stiffness[float | None] = Field(
        description="Stiffness, 1 / compliance; null if the compliance is zero."
    )
    stiffness_second: Stiffness[float | None]
    compliance_interval_first: Compliance[Interval | None] = Field(
        description="Profile-likelihood interval under all constraints."
    )
    compliance_interval_second: Compliance[Interval | None]
    equal: StrictBool = Field(description="True if the constraint makes the compliances of both sets equal.")


class OrderedResult(Message):
    """Common fit of two measurement sets in which no joint is softer in the second set."""

    joints: list[OrderedJoint]
    chi_square_increase: float = Field(
        description="Increase of chi-square by the constraint. An increase far above the number of "
        "`equal` joints contradicts the constraint."
    )
    certificate: Certificate = Field(description="Proof of optimality.")


class ComparisonResult(Result):
    """Result of a comparison with its runs and, for two measurement sets, ratios of the stiffnesses."""

    assessment: Assessment = Field(description="Worst verdict of all compared runs, with its reasons.")
    confidence: Dimensionless[float] = Field(description="Confidence level of ratios.")
    sides: list[ComparedSide] = Field(description="One or two measurement sets.")
    entries: list[ComparedRun] = Field(description="Runs in the requested order.")
    joints: list[JointRatio] = Field(
        description="Stiffness ratio of each joint; empty if only one measurement set is compared."
    )
    differences: list[JointResult] = Field(
        default_factory=list,
        description="Compliance of a joint in the first set minus compliance in the second set. The "
        "difference is the gearbox's compliance if only the second set closes the loop "
        "behind the gearbox.",
    )
    gearboxes: list[JointResult] = Field(
        default_factory=list,
        description="Compliance of each gearbox in front of a secondary encoder, by one fit. One "
        "measurement set reads the encoder; the other closes the position loop with the "
        "encoder.",
    )
    structures: list[JointResult] = Field(
        default_factory=list,
        description="Compliance of the structure behind the secondary encoders, by the same fit.",
    )
    avoided: AvoidedDeflection | None = Field(
        description="Fraction of the deflection that the second measurement set avoids; null if only one "
        "set is compared."
    )
    ordered: OrderedResult | None = Field(
        description="Common fit of two measurement sets; null if no common fit was requested."
    )
    warnings: list[Finding] = Field(
        description="Warnings of the measurement sets, then of the fits, then of the comparison. With "
        "two sets, `where` begins with the side."
    )

    @property
    def summary(self) -> ResultSummary:
        """Summary for listings.

        A comparison of two campaigns has the figures of the poorer campaign, a comparison of methods those of
        the best method.
        """
        runs_of_sides = {side.run_id for side in self.sides}
        has_two_sides = bool(self.joints)
        # An entry without joints has no figures. Of two campaigns only the runs that are compared count.
        entries = [
            entry
            for entry in self.entries
            if entry.joints and (not has_two_sides or entry.run_id in runs_of_sides)
        ]
        compensations = [entry.compensation for entry in entries if entry.compensation is not None]
        counts = [count_identified_joints(entry.joints) for entry in entries]
        poorer_or_best = min if has_two_sides else max
        return ResultSummary(
            verdict=self.assessment.verdict,
            compensation=poorer_or_best(compensations, default=None),
            joints_identified=poorer_or_best(counts, default=0),
            joint_count=max((len(entry.joints) for entry in entries), default=None),
            warning_count=len(self.warnings),
        )


class Comparison(Job):
    """A stored comparison."""

    collection: ClassVar[str] = "comparisons"

    kind: Literal["comparison"] = "comparison"
    measurement_set_id: Identifier = Field(description="Measurement set of the first side.")
    second_set_id: Identifier | None = Field(
        description="Second measurement set; null if only one measurement set is compared."
    )
    request: ComparisonRequest
    result: ComparisonResult | None = Field(description="Result; null until the comparison has succeeded.")
