"""Identification of joint stiffnesses from one measurement set."""

from __future__ import annotations

from typing import Any, Final

from jointstiff.schemas.run.options import RunOptions
from jointstiff.schemas.run.run import Run, RunRequest, RunSummary
from jointstiff.service.kinds.kind import Kind

_EXAMPLES: Final[dict[str, Any]] = {
    "default": {"measurement_set_id": "ID_OF_A_STORED_SET"},
    "decoupled, bounded": {
        "measurement_set_id": "ID_OF_A_STORED_SET",
        "method": "decoupled_partial_pose",
        "weighting": "covariance",
        "stiffness_bounds": {"joint_2": [1e6, None]},
    },
}

RUN: Final = Kind[Run, RunRequest, RunSummary](
    room=__name__,
    message=Run,
    request=RunRequest,
    options=RunOptions,
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
