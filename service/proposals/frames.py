"""Proposals of the frame of positions that names explain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jointstiff.schemas.imports import ImportAnswer, ImportRequest
from jointstiff.schemas.measurement import MeasurementSetDocument, Observation
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.proposals.proposed_import import NoProposal, ProposedImport
from jointstiff.service.proposals.search import propose_import
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.table import METRES
from jointstiff.solver.mechanics.robot import KnownRobot


def is_in_another_frame(answer: ImportAnswer) -> bool:
    """Return whether names explain files whose positions are in another frame than R0."""
    return any(finding.code == "frame_mistaken" for finding in answer.findings or ())


def propose_frame(
    files: Sequence[SourceFile], request: ImportRequest, robot: KnownRobot, answer: ImportAnswer
) -> ProposedImport | None:
    """Propose the frame of positions that names explain; None unless nothing but the frame changes.

    Args:
        files: files of readings.
        request: options of the import.
        robot: robot that was measured.
        answer: import of the files by the names of their columns, with a measurement set.
    """
    proposed = propose_import(files, request, [robot])
    if isinstance(proposed, NoProposal) or proposed.proposal.doubt or answer.measurement_set is None:
        return None
    turned = proposed.accept().measurement_set
    if turned is None or not _have_same_readings(turned, answer.measurement_set):
        return None
    return proposed


def _have_same_readings(turned: MeasurementSetDocument, by_names: MeasurementSetDocument) -> bool:
    """Return whether two sets have the same joints, forces and shifts under load, in different frames."""
    observations = list(zip(turned.observations, by_names.observations, strict=False))
    if len(turned.observations) != len(by_names.observations):
        return False
    length = METRES[turned.units.length] / METRES[by_names.units.length]
    for own, named in observations:
        own_shifts, named_shifts = _measure_shifts(own), _measure_shifts(named)
        if own.force != named.force or len(own_shifts) != len(named_shifts):
            return False
        if not np.allclose(own.joints, named.joints, atol=1e-6):
            return False
        if not np.allclose(length * own_shifts, named_shifts, rtol=1e-3, atol=1e-6):
            return False
    return True


def _measure_shifts(observation: Observation) -> FloatArray:
    """Return the distances (N,) between the positions with and without load, in the order of readings."""
    positions = [(each.unloaded, each.loaded) for each in observation.readings]
    known = [(first, second) for first, second in positions if first is not None and second is not None]
    return np.array([np.linalg.norm(np.subtract(second, first)) for first, second in known])
