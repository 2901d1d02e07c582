"""Options of an identification: method, weighting, what may bend, constraints, priors, draws, own weight."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from jointstiff.schemas.fields import (
    Confidence,
    Message,
    Metres,
    Name,
    Newtons,
    Stiffness,
    Terminal,
    Vector3,
    parse_cause,
    parse_names,
    parse_prior,
    parse_resampling,
)
from jointstiff.schemas.finding import NamedCause
from jointstiff.schemas.robot import MAX_JOINTS

ElasticModel = Literal[
    "joints", "joints_and_base", "coupled_joints", "diagonal_links", "joints_and_links", "links_and_base"
]
Elasticity = Literal[
    "joints",
    "joints_and_base",
    "coupled_joints",
    "diagonal_links",
    "joints_and_links",
    "links_and_base",
    "automatic",
]
Loss = Literal["squared", "huber"]
StoredLoss = Literal["squared", "huber", "absolute"]
"""Losses of results: `absolute` is in stored results alone, of documents up to version 18."""


class CrossValidation(Message):
    """Settings of the cross-validation, which chooses the penalty of the links and compares the models."""

    folds: Annotated[int, Field(strict=True, ge=2, le=20)] = Field(
        default=5, description="Number of folds of the cross-validation; fewer if there are fewer postures."
    )
    draws: Annotated[int, Field(strict=True, ge=1, le=20)] = Field(
        default=1,
        description="Number of random divisions of the postures into folds; 1 if `link_penalty` is given.",
    )
    seed: Annotated[int, Field(strict=True, ge=0, le=2**53)] = Field(
        default=0, description="Random seed of the division of the postures into folds."
    )
    rule: Literal["best", "one_standard_error"] = Field(
        default="best",
        description="Rule that chooses the penalty. `best`: least held-out residual (mean length; beyond "
        "500 targets root mean square). `one_standard_error`: largest penalty within one standard error of "
        "the best.",
    )


MAX_REPETITIONS = 100_000
MAX_CAUSES = 4
MAX_LEFT_OUT = 1_000


class Resampling(Message):
    """Size, number and seed of the draws."""

    size: Annotated[int, Field(strict=True, ge=1, le=10_000)] = Field(
        description="Number of configurations in each draw, at most the number in the set.", examples=[10]
    )
    repetitions: Annotated[int, Field(strict=True, ge=1, le=MAX_REPETITIONS)] = Field(
        default=1000, description="Number of draws."
    )
    seed: Annotated[int, Field(strict=True, ge=0, le=2**53)] = Field(
        default=0, description="Random seed; the same seed gives the same numbers on any machine."
    )
    replacement: Annotated[bool, Field(strict=True)] = Field(
        default=False, description="True if a configuration may be drawn more than once (bootstrap)."
    )


_Bounds = tuple[Annotated[float, Field(strict=True, ge=0.0, le=1e9)], Annotated[float, Field(gt=0.0, le=1e9)]]


class Balancer(Message):
    """A spring between the base and a link, pulled from its free length."""

    joint: Name = Field(description="Name of the joint that carries the moving end of the spring.")
    on_base: Metres[Vector3] = Field(
        description="Position of the spring's fixed end on the base, in the base frame R0."
    )
    on_link: Metres[Vector3] = Field(
        description="Position of the spring's moving end, in the frame that moves with the joint."
    )
    rate: _Bounds = Field(description="Least and greatest spring rate, in N/m.")
    pull: Newtons[_Bounds] = Field(
        description="Least and greatest product of spring rate and free length, in N."
    )

    @model_validator(mode="after")
    def _require_ordered_ranges(self) -> Balancer:
        if self.rate[0] > self.rate[1] or self.pull[0] > self.pull[1]:
            raise ValueError("give the least value of `rate` and of `pull` first, then the greatest value")
        return self


class OwnWeight(Message):
    """Own weight of the robot as the only load.

    A run also estimates the robot's geometry and the targets' positions; a plan supports no balancers.
    """

    kind: Literal["own_weight"] = "own_weight"
    gravity: Vector3 = Field(
        default=(0.0, 0.0, -9.80665),
        description="Acceleration of gravity in the robot's base frame R0, in m/s²; default: along −z.",
    )
    estimate_gravity: Annotated[bool, Field(strict=True)] = Field(
        default=False,
        description="True to estimate the direction of gravity.",
    )
    rigid_base: Annotated[bool, Field(strict=True)] = Field(
        default=False,
        description="True if the base is rigid; if false, the tilt of the base under the weight is "
        "estimated.",
    )
    balancers: Annotated[list[Balancer], Field(max_length=MAX_JOINTS)] = Field(
        default_factory=list, description="Spring balancers of the arm, each with bounds of its spring."
    )

    @model_validator(mode="after")
    def _require_plausible_gravity(self) -> OwnWeight:
        if not 1.0 <= sum(part**2 for part in self.gravity) ** 0.5 <= 100.0:
            raise ValueError("gravity must be 1 to 100 m/s²; on the earth it is 9.80665 m/s²")
        return self


METHODS_IN_SHORT = {"CP": "complete_pose", "PP": "partial_pose", "DPP": "decoupled_partial_pose"}
"""The paper's abbreviations, which are taken for the names of the methods."""


def _expand_method_name(name: object) -> object:
    """Return the full name of a method for its abbreviation, upper or lower case; return others unchanged."""
    return METHODS_IN_SHORT.get(name.upper(), name) if isinstance(name, str) else name


Method = Annotated[
    Literal["complete_pose", "partial_pose", "decoupled_partial_pose"], BeforeValidator(_expand_method_name)
]
Weighting = Literal["covariance", "characteristic_length", "uniform"]
PositiveStiffness = Annotated[float, Field(strict=True, ge=1.0, le=1e15)]
StiffnessBound = tuple[PositiveStiffness | None, PositiveStiffness | None]


class StiffnessPrior(Message):
    """Prior knowledge of a joint's stiffness."""

    stiffness: Stiffness[PositiveStiffness]
    standard_uncertainty: Stiffness[PositiveStiffness] = Field(
        description="Standard uncertainty of the prior stiffness; at most half of the stiffness."
    )

    @field_validator("standard_uncertainty", mode="after")
    @classmethod
    def _refuse_vague_prior(cls, uncertainty: float, info: ValidationInfo) -> float:
        stiffness = info.data.get("stiffness")
        if stiffness is not None and uncertainty > stiffness / 2:
            raise ValueError(
                "must be at most half of the stiffness: omit the prior if the stiffness is less certain"
            )
        return uncertainty


def _replace_missing_loss(loss: object) -> object:
    return "automatic" if loss is None else loss


class MethodOptions(Message):
    """A method of identification with the weights of its rows."""

    method: Method = Field(
        default="partial_pose",
        description="Method of the fit. `complete_pose`: six rows per configuration, from three targets or "
        "more. `partial_pose`: three rows per target. `decoupled_partial_pose`: fits the arm by the wrist "
        "centre, then the wrist; needs three targets and a spherical wrist.",
    )
    weighting: Weighting = Field(
        default="covariance",
        description="Weighting of the readings. `covariance`: by their uncertainty. "
        "`characteristic_length`: translations divided by a length (complete pose only). `uniform`: equal "
        "in SI units.",
    )
    characteristic_length: Metres[Annotated[float, Field(strict=True, ge=1e-3, le=1e3)] | None] = Field(
        default=None,
        description="Length for the weighting `characteristic_length`; default: the length that minimises "
        "the condition number of the regressor.",
    )

    @field_validator("characteristic_length", mode="after")
    @classmethod
    def _require_weighting_by_length(cls, length: float | None, info: ValidationInfo) -> float | None:
        weighting = info.data.get("weighting")
        if length is not None and weighting != "characteristic_length":
            raise ValueError(f"needs the weighting `characteristic_length`, not `{weighting}`")
        return length


def _refuse_repeated_causes(causes: list[NamedCause]) -> list[NamedCause]:
    if len({(cause.name, cause.first) for cause in causes}) < len(causes):
        raise ValueError("must not name the same cause twice")
    return causes


Causes = Annotated[
    list[NamedCause],
    Field(max_length=MAX_CAUSES),
    AfterValidator(_refuse_repeated_causes),
    Terminal("--cause", "NAME[:FIRST]", parse_cause, "list"),
]
"""Causes that are fitted with the joints."""


class RunOptions(MethodOptions):
    """Options of an identification. All defaults suit three targets and a tracker."""

    positive: Annotated[bool, Field(strict=True)] = Field(
        default=True, strict=True, description="True to constrain every compliance to be zero or positive."
    )
    stiffness_bounds: Stiffness[Annotated[dict[Name, StiffnessBound], Field(max_length=MAX_JOINTS)]] = Field(
        default_factory=dict,
        description="Minimum and maximum stiffness of each joint, null for no limit. Bounds imply a "
        "positive stiffness.",
        examples=[{"joint_2": [1e6, None]}],
    )
    loss: Annotated[Literal["squared", "huber", "automatic"], BeforeValidator(_replace_missing_loss)] = Field(
        default="automatic",
        description="Loss of the norm of each target's whitened residual. `huber`: linear beyond a "
        "threshold, so that bumped targets count less; with links, at most 500 targets. `automatic`: "
        "`squared` for joints alone and with `link_penalty`, else chosen by cross-validation.",
    )
    huber_threshold: Annotated[float, Field(strict=True, ge=0.1, le=100.0)] | None = Field(
        default=None,
        description="Threshold of the Huber loss, in units of sigma, for the length of a target's "
        "residual. Default: 2.8, which 5 % of good readings exceed. Dimensionless.",
    )
    complementary_stiffness: Literal["neglected", "included"] = Field(
        default="included",
        description="Treatment of the change of joint torques by the deflection (Chen & Kao): `included` "
        "or `neglected`. Models with links or coupling always neglect the change.",
    )
    causes: Causes = Field(
        default_factory=list,
        description="Systematic errors to fit together with the joints, as a reason of the verdict "
        "recommends. The readings do not change, and the intervals include the uncertainty "
        "of the errors.",
    )
    priors: Annotated[
        dict[Name, StiffnessPrior],
        Field(max_length=MAX_JOINTS),
        Terminal("--prior", "JOINT=STIFFNESS:UNCERTAINTY", parse_prior, "dict"),
    ] = Field(
        default_factory=dict,
        description="Prior knowledge of stiffnesses by joint name, for example from a data sheet.",
        examples=[{"joint_5": {"stiffness": 4e5, "standard_uncertainty": 4e4}}],
    )
    stiffness_order: Annotated[
        list[Annotated[list[Name], Field(min_length=2, max_length=MAX_JOINTS)]],
        Field(max_length=MAX_JOINTS),
        Terminal("", "JOINT,JOINT,...", parse_names, "list"),
    ] = Field(
        default_factory=list,
        description="Order of stiffnesses, as chains of joints. Each joint is at least as stiff as the "
        "next joint of the chain. The stiffnesses of these joints are positive.",
        examples=[[["joint_2", "joint_4"]]],
    )
    elasticity: Elasticity = Field(
        default="automatic",
        validate_default=True,
        description="Parts that bend. `coupled_joints`: a full matrix of the joints. `diagonal_links`: "
        "joints, six compliances per link. `joints_and_links`: joints, 6 x 6 per link. "
        "`joints_and_base`: joints, 6 x 6 of the base. `links_and_base`: joints, links, "
        "base. `automatic`: joints, unless a test shows that other parts bend; then the "
        "simplest model within one standard error of the best. Other models than `joints` "
        "need method `partial_pose` and weighting `covariance`, without bounds, priors, "
        "order, encoder readings or resampling. With other options, `automatic` uses "
        "joints.",
    )
    links: Annotated[list[Name], Field(max_length=MAX_JOINTS)] = Field(
        default_factory=list,
        description="Elastic links, each named by the joint that carries the link; default: all links.",
        examples=[["joint_2", "joint_3"]],
    )
    link_penalty: Annotated[float, Field(strict=True, ge=1e-9, le=1e3)] | None = Field(
        default=None,
        description="Weight of the term that keeps compliances of links and coupling small; default: "
        "chosen by cross-validation (slow).",
    )
    cross_validation: CrossValidation = Field(
        default=CrossValidation(),
        description="Settings of the cross-validation; not used for the elasticity `joints`.",
    )
    resampling: Annotated[
        Resampling | None, Terminal("--resample", "SIZE[:REPETITIONS[:SEED]]", parse_resampling)
    ] = Field(
        default=None,
        description="Resampling: repeat the fit on configurations drawn at random; the run may "
        "then take long.",
    )
    confidence: Confidence = 0.95
    weight: OwnWeight | None = Field(
        default=None,
        description="Run with the robot's own weight as a load, in addition to known loads of the set. "
        "The run also estimates the geometry. `bodies` of the robot and the default method, "
        "weighting, loss and elasticity are needed. Bounds, priors, order and resampling are "
        "excluded.",
    )
    leave_out: Annotated[list[Name], Field(max_length=MAX_LEFT_OUT)] = Field(
        default_factory=list,
        description="Labels of observations to omit; the checks are then repeated for the remaining "
        "observations.",
        examples=[["c07"]],
    )

    @field_validator("huber_threshold", mode="after")
    @classmethod
    def _require_huber_loss(cls, threshold: float | None, info: ValidationInfo) -> float | None:
        if threshold is not None and info.data.get("loss") != "huber":
            raise ValueError("needs the loss `huber`")
        return threshold

    @field_validator("links", "link_penalty", mode="after")
    @classmethod
    def _require_elastic_links(
        cls, chosen: list[str] | float | None, info: ValidationInfo
    ) -> list[str] | float | None:
        """Refuse chosen links, or a penalty of links, unless the elasticity has links."""
        elasticity = info.data.get("elasticity")
        if chosen and elasticity == "joints":
            raise ValueError("needs an elasticity other than `joints`")
        if isinstance(chosen, float) and elasticity == "automatic":
            raise ValueError(
                "must be omitted with the elasticity `automatic`, which chooses the penalty itself"
            )
        if isinstance(chosen, list) and chosen and elasticity in {"coupled_joints", "joints_and_base"}:
            raise ValueError(f"needs an elasticity with links, not `{elasticity}`")
        return chosen

    @field_validator("weight", mode="after")
    @classmethod
    def _refuse_incompatible_options(cls, weight: OwnWeight | None, info: ValidationInfo) -> OwnWeight | None:
        """Refuse own weight together with options that differ from those that own weight supports."""
        if weight is None:
            return weight
        incompatible = {"method", "weighting", "positive", "resampling", "priors"}
        incompatible |= {"stiffness_bounds", "stiffness_order", "causes"}
        for name in sorted(incompatible & info.data.keys()):
            if info.data[name] != cls.model_fields[name].get_default(call_default_factory=True):
                raise ValueError(f"cannot be combined with `{name}`: omit one of the two options")
        compatible = {"loss": {"automatic", "squared"}, "elasticity": {"automatic", "joints"}}
        for name, accepted in compatible.items():
            if name in info.data and info.data[name] not in accepted:
                raise ValueError(
                    f"cannot be combined with {name} `{info.data[name]}`: omit one of the two options"
                )
        return weight

    @field_validator("stiffness_bounds", mode="after")
    @classmethod
    def _require_ordered_bounds(cls, bounds: dict[str, StiffnessBound]) -> dict[str, StiffnessBound]:
        for name, (least, greatest) in bounds.items():
            if least is not None and greatest is not None and least >= greatest:
                raise ValueError(f"{name}: the minimum stiffness must be less than the maximum")
        return bounds
