"""A run: one identification of one measurement set, with its evidence and provenance; a campaign file."""

from __future__ import annotations

from collections.abc import Iterable
from math import hypot
from typing import Annotated, ClassVar, Literal, Protocol

from pydantic import Field, StrictBool, WithJsonSchema

from jointstiff.schemas.fields import (
    Compliance,
    Dimensionless,
    Identifier,
    Interval,
    Message,
    Metres,
    Name,
    Newtons,
    Point,
    Positions,
    Radians,
    Stiffness,
    Torque,
)
from jointstiff.schemas.finding import Assessment, Finding, ResultSummary, Verdict
from jointstiff.schemas.job import Job, Result
from jointstiff.schemas.joints import StatedKind
from jointstiff.schemas.measurement import MeasurementSetDocument
from jointstiff.schemas.model import IdentifiedModel, LinksResult, ScoredModel
from jointstiff.schemas.options import (
    Elasticity,
    ElasticModel,
    RunOptions,
    StoredLoss,
)
from jointstiff.schemas.robot import RobotDocument


class JointResult(Message):
    """Result of one joint. A joint that is not observable has no numbers."""

    name: Name
    kind: StatedKind = "revolute"
    status: Literal["identified", "uncertain", "at_bound", "not_observable"]
    verdict: Verdict = Field(
        description="Verdict on the joint's stiffness, limited by the joint's status and by the reasons."
    )
    compliance: Compliance[float | None] = Field(
        description="Compliance of the joint; with `links` the effective compliance, which includes the "
        "compliance of the link (for joint 1 also of the base) about the joint's axis."
    )
    own_compliance: Compliance[float | None] = Field(
        default=None,
        description="Compliance of the joint alone, which predicts together with `links`; "
        "null if only joints bend.",
    )
    stiffness: Stiffness[float | None] = Field(
        description="Stiffness, 1 / compliance; null if the compliance is zero."
    )
    standard_uncertainty: Compliance[float | None] = Field(
        description="Standard uncertainty of the unconstrained estimate."
    )
    compliance_interval: Compliance[Interval | None] = Field(
        description="Profile-likelihood interval under the constraints, at the run's confidence."
    )
    stiffness_interval: Stiffness[tuple[float, float | None] | None] = Field(
        description="Interval of the stiffness; an upper end of null means that the stiffness has no upper "
        "limit."
    )
    stiffness_at_least: Stiffness[float | None] = Field(
        default=None,
        description="One-sided lower bound of the stiffness at the run's confidence; null if the "
        "compliance may be negative.",
    )
    prior_to_data: float | None = Field(
        default=None,
        description="Information of the prior divided by the information of the readings; above 1 the prior "
        "dominates; null without a prior.",
    )
    reason: str | None = Field(
        description="Reason why the joint has no number, or why the number is at a bound."
    )


class _Joint(Protocol):
    """A joint of a run, of the solver's estimate or of a message."""

    @property
    def status(self) -> str:
        """Status of the estimate: `identified`, `uncertain`, `at_bound` or `not_observable`."""

    @property
    def stiffness(self) -> float | None:
        """Stiffness; None without a number."""

    @property
    def stiffness_interval(self) -> tuple[float, float | None] | None:
        """Lower and upper end of the interval of the stiffness; an upper end of None means no upper limit."""


def count_identified_joints(joints: Iterable[_Joint]) -> int:
    """Return the number of joints with a stiffness that is bounded above.

    The stiffness of a joint without an interval counts as bounded if the status is `identified`.
    """
    count = 0
    for joint in joints:
        interval = joint.stiffness_interval  # (lower end, upper end or None)
        is_bounded = joint.status == "identified" if interval is None else interval[1] is not None
        count += joint.stiffness is not None and is_bounded
    return count


BudgetSource = Annotated[
    str,
    Field(
        description="Source of the uncertainty: `readings`, a stated error (`force_scale`, "
        "`force_direction`, `rope_zero`, `load_point`, `target_places`, `axes`, `drift`), "
        "`assumed_load_point`, `assumed_force_scale`, `fitted_causes`, `model_error` or "
        "`complementary_stiffness`."
    ),
]
BudgetGap = Literal["model_error", "lack_of_fit"]
Evaluation = Annotated[
    Literal["A", "B"],
    Field(
        description="Type of evaluation of the uncertainty: A by statistics of the readings, B by "
        "other information."
    ),
]


class BudgetComponent(Message):
    """One source of uncertainty."""

    source: BudgetSource
    evaluation: Evaluation
    included: StrictBool = Field(
        description="True if the standard uncertainty includes the source. The model error is included "
        "only if joints alone do not fit. A neglected complementary stiffness is never "
        "included."
    )
    degrees_of_freedom: Dimensionless[float | None] = Field(
        description="Degrees of freedom of a type A evaluation; null for infinitely many."
    )
    contributions: Compliance[list[float]] = Field(
        description="Contribution of the source to the standard uncertainty of each joint."
    )
    correlation: Dimensionless[list[list[float]]] = Field(
        description="Correlation between joints that the source causes."
    )
    responses: Compliance[list[tuple[float, float, float]] | None] = Field(
        default=None,
        description="Change of each joint if the load point moves by one standard uncertainty along each "
        "flange axis; null for other sources.",
    )


class Budget(Message):
    """Uncertainty budget of the compliances. The relative uncertainty of a stiffness is the same."""

    joints: list[Name] = Field(
        description="Joints with an estimate, in the order that all lists of the budget have."
    )
    components: list[BudgetComponent]
    standard_uncertainty: Compliance[list[float]] = Field(
        description="Combined standard uncertainty of all included components."
    )
    correlation: Dimensionless[list[list[float]]] = Field(
        description="Correlation between the joints, by the combined uncertainty."
    )
    probability: Dimensionless[float] = Field(description="Coverage probability.")
    coverage_factor: Dimensionless[float] = Field(
        description="Coverage factor. The distribution is normal, or Student's t if sigma is estimated "
        "or the model error is included."
    )
    expanded_uncertainty: Compliance[list[float]] = Field(
        description="Expanded uncertainty: coverage factor times standard uncertainty."
    )
    expanded_with_model_error: Compliance[list[float]] = Field(
        description="Expanded uncertainty of all components."
    )
    missing: list[BudgetGap] = Field(
        description="Sources without a component. `model_error`: too few postures for a bound. "
        "`lack_of_fit`: joints alone do not fit, also because of a mistake that forbids the numbers."
    )

    def contributions_to(self, joint: str) -> dict[str, float]:
        """Return source → contribution to the standard uncertainty of a joint, given its name.

        Sources that are not included in the intervals are left out; empty for an unknown joint.
        """
        if joint not in self.joints:
            return {}
        index = self.joints.index(joint)
        return {
            component.source: component.contributions[index]
            for component in self.components
            if component.included
        }


class StageIdentifiability(Message):
    """Observability in one stage of a method, over the joints of that stage."""

    rank: int = Field(description="Rank of the regressor: number of determined compliances or combinations.")
    condition_number: float | None = Field(
        description="Condition number of the weighted regressor after scaling its columns to unit length; "
        "null if rank-deficient."
    )
    singular_values: list[float] = Field(description="Singular values of the regressor, largest first.")


ObservabilityIndex = Literal["o1", "o2", "o3", "o4", "o5"]


class Advice(Message):
    """A measurement that would reduce a joint's uncertainty."""

    joint: Name
    message: str = Field(description="Advice in words.")
    joints: Positions[list[float]] = Field(description="Joint positions as the controller shows them.")
    observation: Name | None = Field(
        description="Label of the observation with the proposed posture; null if no observation has the "
        "posture."
    )
    force: Newtons[Point] = Field(
        description="Force on the robot along the axes of R0, as large as the largest force of the set, and "
        "no larger than the payload."
    )
    uncertainty_ratio: float | None = Field(
        description="Standard uncertainty of the compliance with the proposed reading, divided by the "
        "present one; null if not determined so far."
    )
    standard_uncertainty: Compliance[float | None] = Field(
        default=None,
        description="Standard uncertainty of the compliance with the proposed reading of all targets; "
        "null if sigma is unknown.",
    )


class Identifiability(Message):
    """Observability of the parameters of the joint model."""

    parameters: int = Field(description="Number of joints of the robot.")
    rank: int = Field(description="Rank of the regressor: number of determined compliances or combinations.")
    condition_number: float | None = Field(
        description="Condition number of the regressor, the largest of all stages; null if rank-deficient."
    )
    combinations: list[list[Name]] = Field(
        description="Groups of joints whose combinations alone are observable."
    )
    observability: Dimensionless[dict[ObservabilityIndex, float] | None] = Field(
        default=None,
        description="Observability indices (Sun & Hollerbach 2008); null if rank-deficient. Of the "
        "singular values, `o1` is the geometric mean, `o2` the least divided by the "
        "greatest, `o3` the least, `o4` the squared least divided by the greatest, `o5` the "
        "inverse of the sum of inverses. A larger index is better; no index exceeds 1.",
    )
    advice: list[Advice] = Field(
        default_factory=list,
        description="Advice on the next measurements, for at most three joints with an uncertainty above 10 "
        "%. A joint has at most two proposals, and the better proposal is first.",
    )
    weakest: list[str] = Field(
        default_factory=list,
        description="Joints that are hard to distinguish, with the proportion of their compliances, for "
        "each stage with a condition number above 100.",
    )
    stages: list[StageIdentifiability] = Field(
        description="Stages of the method. The decoupled method has two stages, first the arm and then "
        "the wrist; other methods have one."
    )


class ResampledJoint(Message):
    """Statistics of one joint over all draws."""

    name: Name
    kind: StatedKind = "revolute"
    compliance_mean: Compliance[float | None]
    compliance_deviation: Compliance[float | None] = Field(description="Standard deviation over the draws.")
    compliance_interval: Compliance[Interval | None] = Field(
        description="Percentile interval over all draws, at the run's confidence."
    )
    stiffness_mean: Stiffness[float | None] = Field(
        description="Mean of the finite stiffnesses over the draws; `share_infinite` counts infinite "
        "stiffnesses."
    )
    stiffness_deviation: Stiffness[float | None] = Field(
        description="Standard deviation of the finite stiffnesses over the draws."
    )
    share_negative: Dimensionless[float] = Field(
        description="Fraction of the draws with a negative stiffness."
    )
    share_infinite: Dimensionless[float] = Field(description="Fraction of the draws with compliance zero.")
    share_undetermined: Dimensionless[float] = Field(
        description="Fraction of the draws in which the stiffness of the joint is not observable."
    )


class ResamplingResult(Message):
    """Dispersion due to the choice of configurations. Joints that are not observable have no numbers."""

    repetitions: int
    joints: list[ResampledJoint]
    share_any_negative: Dimensionless[float] = Field(
        description="Fraction of the draws with a negative stiffness of at least one joint."
    )
    compensation_mean: Dimensionless[float | None] = Field(
        description="Mean compensation on all configurations, whether drawn or not."
    )
    compensation_deviation: Dimensionless[float | None] = Field(
        description="Standard deviation of the compensation over the draws."
    )
    compensation_interval: Dimensionless[Interval | None] = Field(
        description="Percentile interval of the compensation."
    )


class WeightShare(Message):
    """Causes of the width of a joint's interval."""

    joint: Name
    torque: Torque[Interval] = Field(description="Least and greatest torque of the loads about the joint.")
    largest_sag: Radians[float | None] = Field(
        description="Greatest sag of the joint by own weight; null if the joint's stiffness is unknown."
    )
    readings: Dimensionless[float | None] = Field(
        description="Fraction of the interval's width that would remain if the masses were exact; null "
        "without a number."
    )
    masses: Dimensionless[float | None] = Field(
        description="Fraction of the interval's width that the uncertain masses cause; null without a number."
    )


class WeightResult(Message):
    """Additional results of a run with `weight`."""

    joints: list[WeightShare]
    gravity: Point = Field(
        description="Acceleration of gravity in the robot's base frame R0, in m/s², stated or estimated."
    )
    rms_without_sag: Metres[float] = Field(
        description="Root mean square of the residuals of the coordinates if the sag is neglected."
    )
    rms_residual: Metres[float] = Field(
        description="Root mean square of the residuals of the coordinates if the sag is included."
    )
    steps: int = Field(description="Number of Gauss-Newton steps.")


class RunRequest(RunOptions):
    """Request of a run."""

    measurement_set_id: Identifier
    variant_of: Identifier | None = Field(
        default=None,
        description="Id of an earlier run that this run is to improve, for lists of runs.",
    )


SupportFinder = Literal["least_squares", "pivoting", "clarabel", "active_set", "least_distance"]


class Certificate(Message):
    """Proof of optimality, recomputed from the data. Dimensionless; zero is exact up to rounding."""

    primal: float = Field(description="Largest violation of a bound.")
    dual: float = Field(description="Largest component of the gradient with the wrong sign.")
    complementarity: float = Field(description="Largest min(slack, multiplier).")
    solved_by: list[SupportFinder] = Field(
        description="Algorithms of the fit: first of the robust loss, if any, then of each stage."
    )
    solver_distance: float | None = Field(
        default=None,
        description="Distance between Clarabel's answer and the exact answer, relative to the readings.",
    )


class Goodness(Message):
    """Chi-square of the residuals, in units of sigma."""

    chi_square: float = Field(
        description="Sum of the squared whitened residuals. With the robust loss, residuals are cut at "
        "the threshold and scaled to the same expectation."
    )
    degrees_of_freedom: float
    sigma_source: Literal["given", "residuals"] = Field(
        description="Source of sigma: stated by the user, or estimated from the residuals."
    )
    p_value: Dimensionless[float | None] = Field(
        default=None,
        description="p-value of the two-sided chi-square test of the stated sigma; null without degrees of "
        "freedom.",
    )
    test: Literal["consistent", "residuals_too_large", "residuals_too_small"] | None = Field(
        default=None, description="Result of the chi-square test of the stated sigma at the level of 1 %."
    )
    repeatability: Radians[float | None] = Field(
        default=None,
        description="Standard deviation of a joint's random angle from posture to posture; null if "
        "residuals show no random angle.",
    )
    repeatability_at_targets: Metres[float | None] = Field(
        default=None,
        description="Root mean square motion of the targets that the random joint angles "
        "(`repeatability`) cause.",
    )
    repeatability_source: Literal["given", "residuals"] | None = None


class ComplementaryStiffness(Message):
    """Effect of the change of the load's joint torques with the deflection."""

    included: StrictBool
    iterations: int = Field(
        description="Number of fits until convergence; 0 if the complementary stiffness is neglected."
    )
    largest_ratio: float = Field(
        description="Largest ratio of complementary stiffness to joint "
        "stiffness over all observations of the set."
    )
    largest_shift: float | None = Field(
        description="Largest change of a compliance by the complementary stiffness, in standard "
        "uncertainties; null if unknown."
    )


class SuspiciousReading(Message):
    """A reading to which the robust loss gives less weight.

    Among good readings, one in a thousand is listed.
    """

    observation: Name
    target: Name
    weight: float = Field(description="Weight of the reading in the fit; 1 for a good reading.")
    residual_norm: float = Field(
        description="Norm of the whitened residual of the reading, in units of sigma."
    )


class Residual(Message):
    """Residual of one target in one observation."""

    observation: Name
    target: Name
    deflection: Metres[Point]
    predicted: Metres[Point]
    residual: Metres[Point] = Field(
        description="Residual: measured minus predicted deflection, along the axes of the base frame R0."
    )


class Contribution(Message):
    """Contribution of one joint to the predicted deflection, by projection."""

    joint: Name
    share: Dimensionless[float] = Field(
        description="Contribution of the joint to the mean length of the predicted deflections; all "
        "contributions add up to 1. Zero for a joint without a number."
    )
    mean: Metres[float] = Field(description="Mean contribution over all readings.")
    by_observation: Metres[list[float]] = Field(
        description="Contribution of the joint in each observation, mean over its targets."
    )


class EncoderResidual(Message):
    """Residual of one secondary encoder in one observation."""

    observation: Name
    joint: Name
    deflection: Radians[float] = Field(
        description="Deflection of the joint under load, loaded minus unloaded position."
    )
    predicted: Radians[float]
    residual: Radians[float] = Field(description="Residual, measured minus predicted.")


class ModelChoice(Message):
    """Elastic elements and loss of the run, with the evidence for the choice."""

    elasticity: ElasticModel
    loss: StoredLoss
    source: Literal["given", "screening", "cross_validation", "options"] = Field(
        description="Way in which the model was chosen. `given`: by the request. `screening`: no test shows "
        "that parts other than joints bend. `cross_validation`: models compared on held-out postures. "
        "`options`: other options allow only joints."
    )
    links_p_value: Dimensionless[float | None] = Field(
        description="p-value of the F test for elastic links; null if no test was made."
    )
    message: str = Field(description="Explanation of the choice of the model, with numbers.")
    models: list[ScoredModel] = Field(
        default_factory=list,
        description="Scores of each model with each loss, from the simplest to the richest model; empty if "
        "no models were compared.",
    )
    losses: dict[ElasticModel, StoredLoss] = Field(
        default_factory=dict, description="Loss with the least held-out residual, for each model."
    )
    best: ElasticModel | None = Field(
        default=None,
        description="Model with the least mean held-out residual, if each model has its best loss.",
    )
    simplest: ElasticModel | None = Field(
        default=None,
        description="Recommended model: the simplest within one standard error of the best (for joints "
        "alone, two standard errors).",
    )


class CauseTest(Message):
    """Test of a cause that may have moved the targets."""

    name: Name = Field(description="Name of the systematic error, as in the `causes` of a run.")
    first: Name | None = Field(
        description="Label of the first observation with the error; null if all observations have the error."
    )
    p_value: Dimensionless[float] = Field(
        description="p-value of the F test for the error, the larger one of tests with stated weights "
        "and with equal weights."
    )


_NO_PROMISE = {"anyOf": [{"type": "object"}, {"type": "null"}]}
"""Schema of an object that the service reads again, and whose form is not part of the API."""


class JointAlone(Message):
    """Compliance of a joint in a fit in which only joints bend."""

    name: Name
    compliance: Compliance[float | None] = Field(description="Compliance; null if not observable.")
    stiffness: Stiffness[float | None] = Field(description="Stiffness, 1 / compliance; null if rigid.")


class JointsAloneResult(Message):
    """Fit of the same readings in which only joints bend, for programs that know no other springs."""

    joints: list[JointAlone]
    compensation: Dimensionless[float] = Field(
        description="Mean compensation of held-out configurations by joints alone."
    )


class RunResult(Result):
    """Result of a run."""

    assessment: Assessment
    joints: list[JointResult]
    compensation: float | None = Field(
        description="Fraction of the mean deflection that the model explains; null if nothing moved or "
        "no degrees of freedom remain."
    )
    rms_residual: Metres[float] = Field(description="Root mean square of the residual vectors' lengths.")
    sigma: Metres[float | None] = Field(
        description="Standard uncertainty of one coordinate of one reading; null if it is neither given nor "
        "estimated."
    )
    goodness: Goodness
    identifiability: Identifiability
    certificate: Certificate = Field(
        description="Largest violation of each optimality condition over all stages."
    )
    characteristic_length: Metres[float | None] = Field(
        description="Length that divides translations; null if the weighting uses no length."
    )
    complementary_stiffness: ComplementaryStiffness | None = Field(
        description="Effect of the complementary stiffness; null with elastic links or coupling, whose "
        "models neglect the effect."
    )
    huber_threshold: Dimensionless[float | None] = Field(
        default=None, description="Threshold of the Huber loss in units of sigma; null for other losses."
    )
    suspicious: list[SuspiciousReading] = Field(
        default_factory=list,
        description="Readings to which the Huber loss gives less weight; the worst is first. By chance, one "
        "good reading in a thousand is listed.",
    )
    suspicious_count: int = Field(
        default=0, description="Number of suspicious readings; `suspicious` lists at most 100 of them."
    )
    resampling: ResamplingResult | None = Field(
        default=None, description="Results of the resampling, if requested."
    )
    links: LinksResult | None = Field(
        default=None,
        description="Results of elastic links or coupling, which predict together with `own_compliance` of "
        "the joints. Intervals of the joints contain all values that fit with 0.12 times the best penalty; "
        "null if `link_penalty` is given.",
    )
    alone: JointsAloneResult | None = Field(
        default=None, description="Fit by joints alone, next to one with `links`; null if only joints bend."
    )
    choice: ModelChoice | None = Field(
        default=None,
        description="Elastic parts and loss of the run, with the reason for the choice; null for runs by "
        "own weight.",
    )
    causes: list[CauseTest] = Field(
        default_factory=list,
        description="Systematic errors that were tested; the most significant is first.",
    )
    residuals: list[Residual]
    contributions: list[Contribution] = Field(
        default_factory=list,
        description="Contribution of each joint to the predicted deflection, by projection; empty if links "
        "or coupling are elastic.",
    )
    encoder_residuals: list[EncoderResidual] = Field(
        default_factory=list, description="Fit of encoders behind gearboxes."
    )
    gearboxes: list[JointResult] = Field(default_factory=list, description="Gearboxes in front of encoders.")
    structures: list[JointResult] = Field(
        default_factory=list, description="Structure behind these encoders."
    )
    model: Annotated[IdentifiedModel | None, WithJsonSchema(_NO_PROMISE)] = Field(
        default=None,
        description="Errors of the published numbers, for intervals of predictions; not part of the API; "
        "null if own weight determines no joint.",
    )
    budget: Budget | None = Field(
        default=None,
        description="Uncertainty budget of the compliances; null if unknown, and with elastic links or "
        "coupling.",
    )
    weight: WeightResult | None = Field(
        default=None,
        description="Result of a run with `weight`; null for other runs. Deflections are relative to an "
        "arm without sag, and intervals are outer bounds over all masses.",
    )
    warnings: list[Finding] = Field(description="Warnings of the measurement set, then warnings of the fit.")

    @property
    def summary(self) -> ResultSummary:
        """Summary of the result for listings."""
        return ResultSummary(
            verdict=self.assessment.verdict,
            compensation=self.compensation,
            joints_identified=self.assessment.joints_identified,
            joint_count=len(self.joints),
            warning_count=len(self.warnings),
        )

    def mean_lengths(self, quantity: Literal["deflection", "residual"]) -> dict[str, float]:
        """Return label of an observation → mean length [m] of the quantity over the targets."""
        lengths: dict[str, list[float]] = {}
        for residual in self.residuals:  # one for each target in each observation
            lengths.setdefault(residual.observation, []).append(hypot(*getattr(residual, quantity)))
        return {label: sum(values) / len(values) for label, values in lengths.items()}


class Run(Job):
    """A stored run."""

    collection: ClassVar[str] = "runs"

    kind: Literal["run"] = "run"
    request: RunRequest
    result: RunResult | None = Field(description="Result of the run; null until the run has succeeded.")

    @property
    def elasticity(self) -> Elasticity:
        """Elasticity of the result's model; before the run has ended, the elasticity of the request."""
        choice = None if self.result is None else self.result.choice
        if self.request.weight is not None:  # identification by own weight supports joints only
            return "joints"
        return self.request.elasticity if choice is None else choice.elasticity


class Campaign(Message):
    """One robot, one of the robot's measurement sets, and the options of the run."""

    robot: RobotDocument
    measurement_set: MeasurementSetDocument
    run: RunOptions = Field(default_factory=RunOptions)
