"""Identification of one of many measurement sets; `identify_many` consists of such runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from jointstiff.schemas.finding import Problem
from jointstiff.schemas.run import Run, RunRequest
from jointstiff.service.kinds.run.work import prepare_identification
from jointstiff.service.kinds.work import carry_out, compute_outcome, make_failed_job, new_job
from jointstiff.service.resources.inputs import Inputs

AnyRun = TypeVar("AnyRun", bound=Run)


def identify_one_of_many(
    inputs: Inputs,
    request: RunRequest,
    run_class: type[AnyRun],
    *,
    cancelled: Callable[[], object] = lambda: False,
    retried: tuple[type[Exception], ...] = (),
    name_place: Callable[[Problem], Problem] = lambda problem: problem,
) -> AnyRun:
    """Identify a measurement set, with all steps in this process; return its run.

    No error of a set ends the work on the other sets: the run is then in state `failed`.

    Args:
        inputs: measurement sets by id.
        request: id of the set, and the options of the run.
        run_class: class of the run.
        cancelled: called between the steps; a true answer ends the run in state `cancelled`.
        retried: classes of errors that the set did not cause; they are raised again.
        name_place: returns the problem of a refused request with the place where the user finds it.

    Raises:
        Exception: an error of a class in `retried`.
    """

    def identify() -> AnyRun:
        """Prepare and carry out the run; raise the error of a request that the readings cannot support."""
        work = prepare_identification(inputs, request)
        queued = new_job(run_class, request, work)
        return carry_out(queued, work, cancelled=cancelled, retried=retried)

    run, refusal = compute_outcome(identify, retried)
    if refusal is not None:
        return make_failed_job(run_class, request, name_place(refusal))
    assert run is not None  # noqa: S101 - for mypy: without a problem there is a run
    return run
