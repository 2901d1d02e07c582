"""A pair: two prepared measurement sets side by side, identified at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Final, NamedTuple

from jointstiff.schemas import pair as pairs
from jointstiff.schemas.assessment import Assessment, combined
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.pair import PairRequest, PairResult
from jointstiff.schemas.run import JointResult
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.service.conversion.readings import hash_of
from jointstiff.service.inputs import Inputs
from jointstiff.service.kinds.identification import to_settings
from jointstiff.service.kinds.work import QuickWork
from jointstiff.solver.compare.pair import (
    Campaign,
    JointRatio,
    compare_campaigns,
    models_differ,
    refuse_other_joints,
)
from jointstiff.solver.design.results import to_assessment, to_joint_budgets
from jointstiff.solver.errors import RequestError
from jointstiff.solver.estimate import identify, refuse_unsupported
from jointstiff.solver.evidence.budget import UncertaintyBudget
from jointstiff.solver.evidence.prediction import predict
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.messages import message, messages_of

_NOTHING_COMMON: Final = Finding(
    code="no_common_configuration",
    weight="use_with_care",
    message="no configuration was measured on both sides, so the avoided deflection is a prediction alone",
    remedy="measure some of the same postures under the same load on both sides",
)


class AssessedSide(NamedTuple):
    """A side by itself; places in its messages begin with its name."""

    assessment: Assessment
    joints: list[JointResult]  # with their verdicts
    compensation: float | None  # share of the mean deflection that its model predicts; None: nothing moved
    warnings: list[Finding]  # about its set and its fit


@dataclass(frozen=True, eq=False)
class Side:
    """One side of a pair."""

    name: str  # `first` or `second`
    set_id: str  # id of its measurement set
    prepared: PreparedSet  # the set
    options: RunOptions  # how to identify it

    @cached_property
    def settings(self) -> Settings:
        """Return how to identify it.

        Raises:
            RequestError: the options do not fit the robot, or are for more than joints.
        """
        if self.options.elasticity not in {"automatic", "joints"}:
            raise RequestError(
                f"a pair compares joints only, not elasticity {self.options.elasticity}",
                where="options.elasticity",
                remedy="use elasticity joints",
            )
        return to_settings(self.options, self.prepared.robot)

    @cached_property
    def campaign(self) -> Campaign:
        """Return the side identified by itself."""
        prepared = self.prepared
        return Campaign(
            robot=prepared.robot,
            measurements=prepared.measurements,
            settings=self.settings,
            estimate=identify(prepared.robot, prepared.measurements, self.settings),
        )

    @property
    def content(self) -> str:
        """Hash of robot, readings and options."""
        unasked = {"measurement_set_id", "resampling"}
        return hash_of(self.prepared.content, self.options.model_dump_json(exclude=unasked))

    def assessed(self) -> AssessedSide:
        """Assess the side by itself."""
        campaign = self.campaign
        estimate = campaign.estimate
        prediction = predict(
            campaign.robot,
            campaign.measurements,
            estimate.compliance,
            complementary_stiffness=campaign.settings.complementary_stiffness,
        )
        assessment = self.prepared.assess(campaign.settings, estimate, prediction)
        budget = UncertaintyBudget.of(estimate, campaign.settings.confidence)
        judgement = to_assessment(assessment, estimate.joints)
        return AssessedSide(
            assessment=judgement.model_copy(
                update={"reasons": [self._placed(each) for each in judgement.reasons]}
            ),
            joints=messages_of(
                JointResult,
                estimate.joints,
                verdict=assessment.joints,
                budget=to_joint_budgets(budget, len(estimate.joints)),
            ),
            compensation=assessment.supported(prediction).compensation,
            warnings=[self._placed(each) for each in (*self.prepared.warnings, *assessment.remarks)],
        )

    def _placed(self, said: Finding) -> Finding:
        """Return a finding whose place begins with the side."""
        where = f"{self.name}.{said.where}" if said.where else self.name
        return said.model_copy(update={"where": where})


def work(inputs: Inputs, request: PairRequest) -> QuickWork:
    """Return the work of a pair.

    Raises:
        RequestError: a set or a run is not there, the robots' joints differ, or the readings cannot support
            what is asked for.
    """
    first, second = _side(inputs, "first", request), _side(inputs, "second", request)
    refuse_other_joints(first.prepared.robot, second.prepared.robot)
    for side in (first, second):
        refuse_unsupported(side.prepared.robot, side.prepared.measurements, side.settings)
    return QuickWork(
        result=partial(_compare, first, second, ordered=request.ordered),
        input_hash=hash_of(first.content, second.content, str(request.ordered)),
        robot_id=first.prepared.robot_id,
        details={"first_set_id": first.set_id, "second_set_id": second.set_id},
    )


def _side(inputs: Inputs, name: str, request: PairRequest) -> Side:
    side = request.first if name == "first" else request.second
    set_id, options = side.measurement_set_id, RunOptions.model_validate(request.options)
    leave_out = side.leave_out
    if side.run_id is not None:
        asked = inputs.run(side.run_id, f"{name}.run_id").run.request
        set_id, options, leave_out = asked.measurement_set_id, asked, asked.leave_out
    if options.weight is not None:
        raise RequestError(
            "a run by the robot's own weight cannot be one of a pair",
            where=name,
            remedy="pair sets that were measured under loads",
        )
    prepared = inputs.measured(str(set_id), f"{name}.measurement_set_id", leave_out).with_loads()
    return Side(name, str(set_id), prepared, request.options_at(options))


def _compare(first: Side, second: Side, *, ordered: bool) -> PairResult:
    one, other = first.campaign, second.campaign
    pair = compare_campaigns(one, other, confidence=one.settings.confidence, ordered=ordered)
    unlike = pair.avoided.unlike
    warnings = []
    if models_differ(one.robot, other.robot):
        warnings.append(
            Finding(
                code="robot_models_differ",
                weight="use",
                message="the robots differ in their kinematics or joint map",
                remedy="check that both are of one model; ratios compare joints with the same name",
            )
        )
    if unlike:
        warnings.append(
            Finding(
                code="configurations_differ",
                weight="use",
                message=f"{len(unlike)} observations have the same label but different postures or "
                "loads, or no "
                f"common target; first '{unlike[0]}'",
                remedy="measure the same postures under the same load, or give different labels",
            )
        )
    sides = first.assessed(), second.assessed()
    assessments = [side.assessment for side in sides]
    if not pair.avoided.matching:
        assessments.append(Assessment(verdict=_NOTHING_COMMON.weight, reasons=[_NOTHING_COMMON]))
    return pairs.PairResult(
        assessment=combined(assessments),
        compensation_first=sides[0].compensation,
        compensation_second=sides[1].compensation,
        joints=list(map(_joint, pair.joints, sides[0].joints, sides[1].joints)),
        avoided=message(pairs.AvoidedDeflection, pair.avoided),
        ordered=None if pair.ordered is None else message(pairs.OrderedResult, pair.ordered),
        warnings=[*sides[0].warnings, *sides[1].warnings, *warnings],
    )


def _joint(ratio: JointRatio, first: JointResult, second: JointResult) -> pairs.PairedJoint:
    interval = ratio.interval
    return message(
        pairs.PairedJoint,
        ratio,
        first=first,
        second=second,
        ratio_interval=None if interval is None else (interval.lower, interval.upper),
        ratio_excluded=None if interval is None else interval.excluded,
    )
