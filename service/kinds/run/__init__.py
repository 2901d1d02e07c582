"""Identification of joint stiffnesses from one measurement set."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Run, RunRequest, RunSummary
from jointstiff.service.kinds.kind import Kind

if TYPE_CHECKING:
    from jointstiff.schemas.run import RunResult
    from jointstiff.service.inputs import Inputs
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.tables.report import Report, View

_EXAMPLES: Final[dict[str, Any]] = {
    "default": {"measurement_set_id": "ID_OF_A_STORED_SET"},
    "decoupled, bounded": {
        "measurement_set_id": "ID_OF_A_STORED_SET",
        "method": "decoupled_partial_pose",
        "weighting": "covariance",
        "stiffness_bounds": {"joint_2": [1e6, None]},
    },
}


def _compute(inputs: Inputs, request: RunRequest) -> Work:
    from jointstiff.service.kinds.run.work import work

    return work(inputs, request)


def _report(job: Run, result: RunResult, view: View) -> Report:
    from jointstiff.service.kinds.run.tables import report

    return report(job, result, view)


RUN: Final = Kind[Run, RunRequest, RunSummary](
    message=Run,
    request=RunRequest,
    options=RunOptions,
    compute=_compute,
    report=_report,
    sources=("measurement_set",),
    summary=RunSummary,
    title="Joint stiffness",
    stepped=True,
    reported=False,
    filters={
        "measurement_set_id": "measurement set",
        "robot_id": "robot",
        "method": "method",
        "weighting": "weighting",
        "elasticity": "elasticity",
    },
    examples=_EXAMPLES,
    description="""Identify the joint stiffnesses, and store the result with its provenance.

Answers 201 with the finished run, or, if it resamples and takes longer than `wait` seconds, 202 with the
run as it is and its address. A method that the readings cannot support is refused, and nothing is stored.
Any other failure is a stored run in state `failed` with its `error`.""",
)
