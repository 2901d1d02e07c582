"""The work of a run: the solver's identification, carried out in steps."""

from __future__ import annotations

from collections.abc import Sequence

from jointstiff.schemas.run import RunRequest, RunResult
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.service.kinds.work import Arrays, Span, Work
from jointstiff.service.resources.inputs import Inputs
from jointstiff.service.runs.verdicts import refuse_implausible_bounds, refuse_implausible_length
from jointstiff.solver.errors import MeasurementError, SolverError
from jointstiff.solver.own_weight.run import choose_own_weight_if_unloaded
from jointstiff.solver.run import Identification


class RunWork(Work):
    """Work of a run; only resampling, and cross-validation of elastic models, take steps."""

    def __init__(self, prepared: PreparedSet, request: RunRequest) -> None:
        """Check the request and prepare the identification; if own weight is the only load, add it.

        Raises:
            RequestError: the readings cannot support the request.
        """
        refuse_implausible_bounds(prepared.robot, request.stiffness_bounds)
        refuse_implausible_length(prepared.robot, request.characteristic_length)
        request = choose_own_weight_if_unloaded(prepared.robot, prepared.measurements, request)
        self.robot_id, self.input_hash = prepared.robot_id, prepared.run_hash(request)
        self.details = {"request": request}
        self._mistakes = [each for each in prepared.warnings if each.weight == "do_not_use"]
        self._run = Identification(prepared.robot, prepared.measurements, request, prepared.warnings)
        if self._run.long is not None:
            self.unit, self.activity = self._run.long.unit, self._run.long.activity

    def steps(self) -> Sequence[Span]:
        """Return the steps of the run; no steps if the run is quick."""
        return () if self._run.long is None else self._run.long.steps()

    def compute(self, span: Span) -> Arrays:
        """Carry out a step and return its arrays, which do not depend on the worker.

        Raises:
            JointstiffError: the run fails.
        """
        return super().compute(span) if self._run.long is None else self._run.long.compute(span)

    def conclude(self, parts: Sequence[Arrays]) -> RunResult:
        """Return the result of the run, from the arrays of all steps in order.

        Raises:
            JointstiffError: the run fails; the error says why. If no optimum of mistaken readings could be
                certified, the error is the mistake that the checks found.
        """
        try:
            return self._run.conclude(parts)
        except SolverError:
            if not self._mistakes:
                raise
            mistake = self._mistakes[0]
            raise MeasurementError(mistake.message, remedy=mistake.remedy, where=mistake.where) from None


def prepare_identification(inputs: Inputs, request: RunRequest) -> RunWork:
    """Fetch the measurement set of a request, and return the work of its identification.

    Raises:
        RequestError: the set does not exist, or the readings cannot support the request.
    """
    prepared = inputs.measured(request.measurement_set_id, "measurement_set_id", request.leave_out)
    return RunWork(prepared, request)
