"""Force that the caller states in axes of the positions, turned into R0."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.proposals.forces.evidence import ForceEvidence
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.meaning.proposal import Proposal

_LEAST_PART: Final = 1e-3
"""Least part of a force along an axis, as a part of its size: less is an error of the fit."""


def turn_stated_force(
    proposal: Proposal, named: Sequence[NamedReading], joints: NumberTable, request: ImportRequest
) -> str:
    """Return the stated force, as one in axes of the positions, in axes of R0, such as `206,-773,0N`.

    Empty unless the targets clearly move along the turned force, which explains their moves better.
    """
    frame = proposal.frame
    unit = None if request.units is None else request.units.force
    if request.force is None or unit is None or frame.is_base or frame.is_mirrored:
        return ""
    stated = np.array(request.force)
    turned = frame.rotation @ stated
    evidence = ForceEvidence(proposal, named, joints, request)
    if evidence.count_moved_along(turned) is None or not evidence.explains_better(turned, stated):
        return ""
    least = _LEAST_PART * np.linalg.norm(turned)
    numbers = [f"{each:.4g}" if abs(each) > least else "0" for each in turned]
    return f"{','.join(numbers)}{unit}"
