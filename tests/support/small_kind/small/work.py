"""The work of a small kind."""

from __future__ import annotations

from jointstiff.service.conversion.readings import hash_of
from jointstiff.service.inputs.inputs import Inputs
from jointstiff.service.kinds.small.messages import SmallRequest, SmallResult
from jointstiff.service.kinds.work import QuickWork


def work(inputs: Inputs, request: SmallRequest) -> QuickWork:
    """Return the work of a count."""
    prepared = inputs.measured(request.measurement_set_id, "measurement_set_id")
    counts = prepared.measurements.present.sum(axis=1).tolist()
    kept = [count for count in counts if count >= request.least]
    return QuickWork(
        compute=lambda: SmallResult(observations=len(kept), readings=sum(kept)),
        input_hash=hash_of(prepared.content, str(request.least)),
        robot_id=prepared.robot_id,
    )
