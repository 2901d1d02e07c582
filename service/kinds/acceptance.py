"""Refusal of what acts on a robot, or guides a measurement, by a run that is not to be used."""

from __future__ import annotations

from collections.abc import Collection

from jointstiff.schemas.assessment import Assessment
from jointstiff.schemas.map import MapRequest
from jointstiff.schemas.program import ProgramRequest
from jointstiff.service.inputs import Inputs, MeasuredRun
from jointstiff.service.problems.errors import VerdictError


def accepted_run(inputs: Inputs, request: MapRequest | ProgramRequest) -> MeasuredRun:
    """Return the run that a request names.

    Raises:
        RequestError: there is no such run, or it is not to be used and the request does not accept that.
    """
    run = inputs.run(request.run_id, "run_id")
    if run.run.result is not None:
        refuse_unaccepted(run.run.result.assessment, request.accept_verdict, f"run '{run.run.id}'")
    return run


def refuse_unaccepted(
    assessment: Assessment,
    accept_verdict: str | None,
    subject: str,
    where: str = "run_id",
    *,
    passed_over: Collection[str] = (),
) -> None:
    """Refuse a result that is not to be used, with the reasons.

    Raises:
        VerdictError: it is not to be used, and the request does not accept that.
    """
    reasons = [
        (reason.where or "all readings", reason.message, reason.remedy)
        for reason in assessment.reasons
        if reason.weight == "do_not_use" and reason.code not in passed_over
    ]
    if reasons and accept_verdict != assessment.verdict:
        raise VerdictError.of(subject, where, reasons)
