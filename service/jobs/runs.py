"""Runs as jobs: one identification of one measurement set, with its resampling."""

from __future__ import annotations

from collections.abc import Sequence

from jointstiff.schemas.run import Run, RunRequest, RunResult
from jointstiff.service.conversion import to_settings
from jointstiff.service.jobs.elastic import ElasticWork, decode_fits, encode_fits
from jointstiff.service.jobs.identify import run_identification
from jointstiff.service.jobs.kinds import Kind, prepared_for
from jointstiff.service.jobs.resample import ResamplingWork, decode, encode
from jointstiff.service.jobs.work import Span, Work
from jointstiff.service.resources import MeasurementSets, PreparedSet
from jointstiff.service.store import RunRecord
from jointstiff.solver.identification import refuse_unsupported
from jointstiff.solver.links import FoldFit
from jointstiff.solver.resampling import Resamples

__all__ = ["RunKind", "RunWork"]


Part = Resamples | list[FoldFit]
"""Some draws, or what some weights of the links' penalty come to in a fold."""


class RunWork(Work[Part]):
    """What a run takes: its draws or its cross-validation, of which a quick one has none."""

    def __init__(self, prepared: PreparedSet, request: RunRequest) -> None:
        """Check what is asked for.

        Raises:
            RequestError: the readings cannot support it, or what cannot be drawn.
        """
        self.robot_id, self.content = prepared.robot_id, prepared.content
        self._prepared, self._request = prepared, request
        self._draws: ResamplingWork | None = None
        self._elastic: ElasticWork | None = None
        if request.elasticity != "joints":
            self._elastic = ElasticWork(prepared, request)
            self.unit, self.activity = "penalties", "cross-validating"
        elif request.resampling is not None:
            refuse_unsupported(prepared.robot, prepared.measurements, to_settings(request, prepared.robot))
            self._draws = ResamplingWork(prepared, request, request.resampling)

    def steps(self) -> Sequence[Span]:
        """The draws, or the cross-validation, cut into steps."""
        work = self._elastic or self._draws
        return () if work is None else work.steps()

    def compute(self, span: Span) -> Part:
        """Carry out a step.

        Raises:
            JointstiffError: as the identification of the whole set does.
        """
        work = self._elastic or self._draws
        if work is None:
            raise ValueError("this run takes no steps")
        return work.compute(span)

    def encode(self, part: Part) -> str:
        """As text that an engine can keep."""
        return encode_fits(part) if isinstance(part, list) else encode(part)

    def decode(self, text: str) -> Part:
        """What `encode` wrote."""
        return decode(text) if self._elastic is None else decode_fits(text)

    def conclude(self, parts: Sequence[Part]) -> RunResult:
        """The whole set's identification, with what the steps say.

        Raises:
            JointstiffError: as `run_identification` does.
        """
        if self._elastic is not None:
            return self._elastic.conclude([part for part in parts if isinstance(part, list)])
        draws = [part for part in parts if isinstance(part, Resamples)]
        return run_identification(self._prepared, self._request, draws)


class RunKind(Kind[RunRequest, Run, RunRecord]):
    """What a run is."""

    name = "run"
    unit = "resamples"
    activity = "resampling"
    message = Run
    record = RunRecord

    def __init__(self, sets: MeasurementSets) -> None:
        self._sets = sets

    def work(self, request: RunRequest) -> RunWork:
        """What a request takes.

        Raises:
            RequestError: there is no such set, or the readings cannot support what is asked for.
        """
        return RunWork(prepared_for(self._sets, request.measurement_set_id), request)

    def row(self, job: Run, robot_id: str) -> RunRecord:
        """A run as the store keeps it."""
        return RunRecord(
            id=job.id,
            measurement_set_id=job.request.measurement_set_id,
            robot_id=robot_id,
            method=job.request.method,
            weighting=job.request.weighting,
            positive=job.request.positive,
            elasticity=job.request.elasticity,
            state=job.state,
            created_at=job.provenance.created_at,
            document=job.model_dump_json(),
        )
