"""A pair: two prepared measurement sets side by side, identified at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

from jointstiff.schemas.measurement import QualityWarning
from jointstiff.schemas.pair import PairRequest, PairResult
from jointstiff.schemas.run import RunOptions
from jointstiff.service.computation.prepared import PreparedSet
from jointstiff.service.computation.work import QuickWork, hash_of
from jointstiff.service.conversion import to_pair_result, to_settings, to_warnings
from jointstiff.solver.errors import RequestError
from jointstiff.solver.identification import refuse_unsupported
from jointstiff.solver.inference import Estimate, judge, predict
from jointstiff.solver.paired import PairSide, compare_pair, models_differ, refuse_other_joints


@dataclass(frozen=True, eq=False)
class Side:
    """One side of a pair.

    Attributes:
        name: `first` or `second`.
        set_id: id of its measurement set.
        prepared: the set.
        options: how to identify it.
    """

    name: str
    set_id: str
    prepared: PreparedSet
    options: RunOptions

    @cached_property
    def campaign(self) -> PairSide:
        """The side as the numerical core takes it.

        Raises:
            RequestError: the options do not fit the robot, or are for more than joints.
        """
        if self.options.elasticity != "joints":
            raise RequestError(
                f"a pair compares joints alone, and elasticity {self.options.elasticity} was asked for",
                where="options.elasticity",
                remedy="use elasticity joints",
            )
        prepared = self.prepared
        return PairSide(
            robot=prepared.robot,
            measurements=prepared.measurements,
            labels=tuple(prepared.readings.labels.tolist()),
            targets=tuple(prepared.readings.targets.tolist()),
            settings=to_settings(self.options, prepared.robot),
        )

    @property
    def content(self) -> str:
        """Hash of robot, readings and options."""
        unasked = {"measurement_set_id", "resampling"}
        return hash_of(self.prepared.content, self.options.model_dump_json(exclude=unasked))

    def warnings(self, estimate: Estimate) -> list[QualityWarning]:
        """Return the warnings about the set and its fit; `where` begins with the side."""
        campaign = self.campaign
        prediction = predict(
            campaign.robot,
            campaign.measurements,
            estimate.compliance,
            complementary_stiffness=campaign.settings.complementary_stiffness,
        )
        found = to_warnings(judge(estimate, prediction), self.prepared.readings)
        return [self._placed(warning) for warning in [*self.prepared.warnings, *found]]

    def _placed(self, warning: QualityWarning) -> QualityWarning:
        where = f"{self.name}.{warning.where}" if warning.where else self.name
        return warning.model_copy(update={"where": where})


def pair_work(first: Side, second: Side, request: PairRequest) -> QuickWork:
    """Return the work of a pair.

    Args:
        first: its first side.
        second: its second side.
        request: what is asked for.

    Raises:
        RequestError: the robots' joints differ, or the readings cannot support a method.
    """
    refuse_other_joints(first.campaign.robot, second.campaign.robot)
    for side in (first, second):
        refuse_unsupported(side.campaign.robot, side.campaign.measurements, side.campaign.settings)
    return QuickWork(
        compute=partial(_compare, first, second, ordered=request.ordered),
        input_hash=hash_of(first.content, second.content, str(request.ordered)),
        robot_id=first.prepared.robot_id,
        details={"first_set_id": first.set_id, "second_set_id": second.set_id},
    )


def _compare(first: Side, second: Side, *, ordered: bool) -> PairResult:
    one, other = first.campaign, second.campaign
    pair = compare_pair(one, other, confidence=one.settings.confidence, ordered=ordered)
    warnings = [
        *first.warnings(pair.first),
        *second.warnings(pair.second),
        *_about_both(one, other, pair.avoided.matches.unlike),
    ]
    return to_pair_result(pair, warnings)


def _about_both(first: PairSide, second: PairSide, unlike: tuple[str, ...]) -> list[QualityWarning]:
    warnings = []
    if models_differ(first.robot, second.robot):
        warnings.append(
            QualityWarning(
                code="robot_models_differ",
                where=None,
                message="the robots differ in their geometry or joint map",
                remedy="check that both are of one model; ratios compare joints of the same name",
            )
        )
    if unlike:
        warnings.append(
            QualityWarning(
                code="configurations_differ",
                where=None,
                message=f"{len(unlike)} observations have the same label but another posture or load, or "
                f"share no target; first '{unlike[0]}'",
                remedy="repeat the same postures under the same load, or give other labels",
            )
        )
    return warnings
