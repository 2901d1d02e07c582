"""Pairs as jobs: two measurement sets, or runs, of one robot beside each other. They are quick."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

from jointstiff.schemas.measurement import QualityWarning
from jointstiff.schemas.pair import Pair, PairRequest, PairResult
from jointstiff.schemas.pair import PairSide as PairSideRequest
from jointstiff.schemas.run import Run, RunOptions
from jointstiff.service.conversion import to_pair_result, to_settings, to_warnings
from jointstiff.service.jobs.kinds import Kind
from jointstiff.service.jobs.work import Span, Work
from jointstiff.service.resources import MeasurementSets, PreparedSet
from jointstiff.service.store import NotFoundError, PairRecord, RunRecord, Store
from jointstiff.solver.errors import JointstiffError, RequestError
from jointstiff.solver.identification import refuse_unsupported
from jointstiff.solver.inference import Estimate, judge, predict
from jointstiff.solver.paired import PairSide, compare_pair, models_differ, refuse_other_joints

__all__ = ["PairKind", "PairWork"]


@dataclass(frozen=True, eq=False)
class _Side:
    """One side: what was measured, and how it is identified."""

    name: str
    set_id: str
    prepared: PreparedSet
    campaign: PairSide

    def warnings(self, estimate: Estimate) -> list[QualityWarning]:
        """Of the set and of its fit."""
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


class PairWork(Work[None]):
    """What a pair takes: no steps, as it is quick."""

    def __init__(self, first: _Side, second: _Side, request: PairRequest) -> None:
        """Check what is asked for.

        Raises:
            RequestError: the robots' joints differ, or the readings cannot support a method.
        """
        refuse_other_joints(first.campaign.robot, second.campaign.robot)
        for side in (first, second):
            campaign = side.campaign
            refuse_unsupported(campaign.robot, campaign.measurements, campaign.settings)
        self.robot_id = first.prepared.robot_id
        both = f"{first.prepared.content} {second.prepared.content}"
        self.content = hashlib.sha256(both.encode()).hexdigest()
        self._first, self._second, self._request = first, second, request

    def steps(self) -> Sequence[Span]:
        """None."""
        return ()

    def compute(self, span: Span) -> None:
        """There are no steps to carry out."""
        raise ValueError(f"a pair takes no steps, and {span} is one")

    def encode(self, part: None) -> str:
        """There is nothing to keep."""
        return str(part)

    def decode(self, text: str) -> None:
        """There is nothing that was kept."""

    def conclude(self, parts: Sequence[None]) -> PairResult:  # noqa: ARG002 - there are none
        """Compare the sides.

        Raises:
            JointstiffError: as the identification of either side does.
        """
        first, second = self._first.campaign, self._second.campaign
        confidence = first.settings.confidence
        pair = compare_pair(first, second, confidence=confidence, ordered=self._request.ordered)
        warnings = [
            *self._first.warnings(pair.first),
            *self._second.warnings(pair.second),
            *_of_the_pair(first, second, pair.avoided.matches.unlike),
        ]
        return to_pair_result(pair, warnings)


def _of_the_pair(first: PairSide, second: PairSide, unlike: tuple[str, ...]) -> list[QualityWarning]:
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


class PairKind(Kind[PairRequest, Pair, PairRecord]):
    """What a pair is."""

    name = "pair"
    unit = "pairs"
    activity = "comparing"
    message = Pair
    record = PairRecord

    def __init__(self, store: Store, sets: MeasurementSets) -> None:
        self._store = store
        self._sets = sets

    def work(self, request: PairRequest) -> PairWork:
        """What a request takes.

        Raises:
            RequestError: a set or a run is not there, the robots' joints differ, or the readings cannot
                support what is asked for.
        """
        return PairWork(self._side("first", request), self._side("second", request), request)

    def details(self, request: PairRequest) -> dict[str, object]:
        """The sets of its sides."""
        first, second = (self._set_and_options(side, request)[0] for side in ("first", "second"))
        return {"first_set_id": first, "second_set_id": second}

    def row(self, job: Pair, robot_id: str) -> PairRecord:
        """A pair as the store keeps it."""
        return PairRecord(
            id=job.id,
            first_set_id=job.first_set_id,
            second_set_id=job.second_set_id,
            robot_id=robot_id,
            state=job.state,
            created_at=job.provenance.created_at,
            document=job.model_dump_json(),
        )

    def _side(self, name: str, request: PairRequest) -> _Side:
        set_id, options = self._set_and_options(name, request)
        if options.elasticity != "joints":
            raise RequestError(
                f"a pair compares joints alone, and elasticity {options.elasticity} was asked for",
                where="options.elasticity",
                remedy="use elasticity joints",
            )
        confidence = request.confidence or request.options.confidence
        try:
            prepared = self._sets.prepared(set_id)
        except NotFoundError as error:
            raise _not_there(error, f"{name}.measurement_set_id") from error
        campaign = PairSide(
            robot=prepared.robot,
            measurements=prepared.measurements,
            labels=tuple(prepared.readings.labels.tolist()),
            targets=tuple(prepared.readings.targets.tolist()),
            settings=to_settings(options.model_copy(update={"confidence": confidence}), prepared.robot),
        )
        return _Side(name, set_id, prepared, campaign)

    def _set_and_options(self, name: str, request: PairRequest) -> tuple[str, RunOptions]:
        """The set of a side, and how it is identified."""
        side: PairSideRequest = getattr(request, name)
        if side.run_id is None:
            return str(side.measurement_set_id), request.options
        try:
            run = Run.model_validate_json(self._store.get(RunRecord, side.run_id).document)
        except NotFoundError as error:
            raise _not_there(error, f"{name}.run_id") from error
        return run.request.measurement_set_id, run.request


def _not_there(error: NotFoundError, where: str) -> JointstiffError:
    return RequestError(error.reason, remedy=error.remedy, where=where)
