"""A comparison: several methods on one set, unconstrained and constrained, the same draws for all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.schemas.assessment import Assessment, combined
from jointstiff.schemas.comparison import ComparedFit, ComparisonRequest, ComparisonResult
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.problem import Problem
from jointstiff.schemas.run import RunResult
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.service.conversion.readings import hash_of
from jointstiff.service.inputs import Inputs
from jointstiff.service.kinds.identification import ByJoints, ResamplingWork, to_settings
from jointstiff.service.kinds.work import Arrays, Span, Work
from jointstiff.service.problems.table import problem_of
from jointstiff.solver.convex.problem import Bounds
from jointstiff.solver.errors import JointstiffError, UnsupportedMethodError
from jointstiff.solver.estimate import refuse_unsupported
from jointstiff.solver.resampling import Resamples

Part = Resamples | Problem
"""Some draws of one fit, or why it has none."""


@dataclass(frozen=True, eq=False)
class _Fit:
    """One method with one constraint."""

    options: RunOptions  # as of a run
    error: Problem | None  # why the readings cannot support it
    draws: ResamplingWork | None  # draws of the method, if the comparison resamples
    bounds: Bounds  # on the compliances


class ComparisonWork(Work):
    """The work of a comparison: the draws of each fit that the readings support, one fit after the other."""

    unit = "resamples"
    activity = "resampling"

    def __init__(self, prepared: PreparedSet, request: ComparisonRequest) -> None:
        """Check what is asked for.

        Raises:
            RequestError: what cannot be drawn.
        """
        options = request.model_dump_json(exclude={"measurement_set_id", "leave_out"})
        self.robot_id, self.input_hash = prepared.robot_id, hash_of(prepared.content, options)
        self._prepared, self._request = prepared, request
        self._fits = [fit for number in range(len(request.methods)) for fit in self._fits_of(number)]

    def steps(self) -> Sequence[Span]:
        """Return the draws of all fits, cut into steps."""
        return tuple(
            (number * self._repetitions + start, number * self._repetitions + stop)
            for number, fit in enumerate(self._resampled)
            if fit.draws is not None
            for start, stop in fit.draws.steps()
        )

    def compute(self, span: Span) -> Arrays:
        """Fit some of the draws; a failure is that of the method, and the others go on."""
        number, start = divmod(span[0], self._repetitions)
        fit, stop = self._resampled[number], start + span[1] - span[0]
        if fit.draws is None:
            raise ValueError("this comparison has no steps")
        try:
            return vars(fit.draws.compute((start, stop), fit.bounds))
        except JointstiffError as error:
            return {"problem": np.array(problem_of(error).model_dump_json())}

    def conclude(self, parts: Sequence[Arrays]) -> ComparisonResult:
        """Return the fits side by side."""
        decoded: list[Part] = [
            Problem.model_validate_json(str(part["problem"])) if "problem" in part else Resamples(**part)
            for part in parts
        ]
        draws = dict(zip(self._resampled, self._by_fit(decoded), strict=True))
        outcomes = [self._outcome(fit, draws.get(fit, [])) for fit in self._fits]
        warnings = {(each.code, each.where): each for each in self._prepared.warnings}
        for outcome in outcomes:
            if isinstance(outcome, RunResult):
                warnings = {(each.code, each.where): each for each in outcome.warnings} | warnings
        return ComparisonResult(
            assessment=_assessment(outcomes),
            entries=[_entry(fit, outcome) for fit, outcome in zip(self._fits, outcomes, strict=True)],
            warnings=list(warnings.values()),
        )

    @property
    def _repetitions(self) -> int:
        return 0 if self._request.resampling is None else self._request.resampling.repetitions

    @property
    def _resampled(self) -> list[_Fit]:
        """The fits that have draws, in their order on the line of units."""
        return [fit for fit in self._fits if fit.draws is not None]

    def _fits_of(self, number: int) -> Iterator[_Fit]:
        """The fits of one method, which share what is computed of each configuration."""
        chosen, resampling = self._request.methods[number], self._request.resampling
        options = RunOptions(
            **chosen.model_dump(), resampling=resampling, confidence=self._request.confidence, positive=False
        )
        error, draws = None, None
        try:
            settings = to_settings(options, self._prepared.robot)
            refuse_unsupported(self._prepared.robot, self._prepared.measurements, settings)
        except UnsupportedMethodError as unsupported:
            error = problem_of(unsupported)
        if resampling is not None and error is None:
            draws = ResamplingWork(self._prepared, options, resampling)
        for constraint in self._request.constraints:
            constrained = options.model_copy(update={"positive": constraint == "positive"})
            bounds = to_settings(constrained, self._prepared.robot).bounds
            yield _Fit(constrained, error, draws, bounds)

    def _by_fit(self, parts: Sequence[Part]) -> list[list[Part]]:
        """The parts of each fit that has draws."""
        sorted_out: list[list[Part]] = [[] for _ in self._resampled]
        for (start, _), part in zip(self.steps(), parts, strict=True):
            sorted_out[start // self._repetitions].append(part)
        return sorted_out

    def _outcome(self, fit: _Fit, parts: Sequence[Part]) -> RunResult | Problem:
        """A fit of the whole set with what its draws say, or why there is none."""
        problems = [part for part in parts if isinstance(part, Problem)]
        if fit.error is not None:
            return fit.error
        try:
            resamples = [vars(part) for part in parts if isinstance(part, Resamples)]
            result = ByJoints(self._prepared, fit.options, self.input_hash).conclude(resamples)
        except JointstiffError as error:
            return problem_of(error)
        return problems[0] if problems else result


def _assessment(outcomes: Sequence[RunResult | Problem]) -> Assessment:
    """Return the worst verdict of the fits; without one there is nothing to use."""
    assessments = [each.assessment for each in outcomes if isinstance(each, RunResult)]
    return combined(assessments) if assessments else Assessment(verdict="do_not_use", reasons=[_NO_FIT])


_NO_FIT: Final = Finding(
    code="no_joint_identified",
    weight="do_not_use",
    message="these readings cannot support any of these methods",
    remedy="read the error of each method",
)


def _entry(fit: _Fit, outcome: RunResult | Problem) -> ComparedFit:
    result = outcome if isinstance(outcome, RunResult) else None
    return ComparedFit(
        method=fit.options.method,
        weighting=fit.options.weighting,
        characteristic_length=result.characteristic_length if result else None,
        positive=fit.options.positive,
        error=outcome if isinstance(outcome, Problem) else None,
        assessment=result.assessment if result else None,
        joints=result.joints if result else [],
        compensation=result.compensation if result else None,
        rms_residual=result.rms_residual if result else None,
        condition_number=result.identifiability.condition_number if result else None,
        resampling=result.resampling if result else None,
    )


def work(inputs: Inputs, request: ComparisonRequest) -> ComparisonWork:
    """Return the work of a comparison.

    Raises:
        RequestError: there is no such set, or draws that cannot be made.
    """
    prepared = inputs.measured(request.measurement_set_id, "measurement_set_id", request.leave_out)
    return ComparisonWork(prepared.with_loads(), request)
