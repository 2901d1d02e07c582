"""Evidence of the deflections for the meaning of columns that may be forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import permutations
from typing import Final

import numpy as np

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.naming import NamedReading
from jointstiff.service.importing.numbers import NumberTable
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.proposal import Proposal, read_positions
from jointstiff.solver.meaning.springs import (
    LARGEST_UNEXPLAINED,
    LEAST_MARGIN,
    DeflectedTargets,
)
from jointstiff.solver.meaning.table import METRES
from jointstiff.solver.mechanics.postures import Postures

_SAME_TURN: Final = 1e-3
"""Largest change of a force by a turn that changes nothing, as a part of the largest force."""


class ForceEvidence:
    """Deflections of the loaded readings of a proposal, which forces may explain."""

    def __init__(
        self,
        proposal: Proposal,
        named: Sequence[NamedReading],
        joints: NumberTable,
        request: ImportRequest,
    ) -> None:
        """Compute the motions of the targets; without a load point, the load is at the flange."""
        self._proposal, self._joints = proposal, joints
        unloaded = {each.target: each.reading.positions for each in named if each.state == "unloaded"}
        self._loaded = [each for each in named if each.state == "loaded" and each.target in unloaded]
        robot = proposal.robots[0].robot
        q = read_positions(joints.table, proposal.joints, robot)
        self._targets: DeflectedTargets | None = None
        if self._loaded and np.isfinite(q).all():
            places = np.stack([unloaded[each.target] for each in self._loaded], axis=1)
            loaded = np.stack([each.reading.positions for each in self._loaded], axis=1)
            size = METRES[request.length_unit or proposal.unit]
            point = size * np.array(request.load_point or (0.0, 0.0, 0.0))
            targets = DeflectedTargets.of(Postures(robot, q), point, places, loaded - places)
            self._targets = targets if targets.are_enough else None

    def _take_rows(self, numbers: FloatArray) -> FloatArray:
        """Return numbers (N, K, m) of the K loaded readings from those of the rows of the joints' table."""
        groups = self._proposal.joints.groups
        by_posture = groups.split(numbers)
        rows = [
            each.reading.index if each.reading.points.table == self._joints.name else 0
            for each in self._loaded
        ]
        in_posture = [row if row < groups.count else 0 for row in rows]
        return np.nan_to_num(by_posture[:, in_posture])

    def are_in_axes_of_positions(self, forces: FloatArray) -> bool:
        """Return whether forces (rows, 3) explain the deflections with a margin if they are turned into R0.

        They are then in the axes of the instrument, as the positions of the file are.
        """
        frame = self._proposal.frame
        turned = forces @ frame.rotation.T
        is_same = np.abs(turned - forces).max() <= _SAME_TURN * np.abs(forces).max(initial=1e-9)
        return not (is_same or frame.is_mirrored) and self._explain(turned, [forces])

    def are_forces(self, numbers: FloatArray) -> bool:
        """Return whether numbers (rows, 3) are forces in R0, or in the axes of the positions.

        No other order of the numbers explains the deflections, nor does another sign of one of them.
        """
        others = [
            sign * numbers[:, list(order)]
            for order in permutations(range(3))
            for sign in (np.ones(3), *(1.0 - 2.0 * np.eye(3)))
        ][1:]
        frame = self._proposal.frame
        turns = [np.eye(3)]
        if not (frame.is_base or frame.is_mirrored):
            turns.append(frame.rotation)
        return any(self._explain(numbers @ turn.T, [each @ turn.T for each in others]) for turn in turns)

    def _explain(self, forces: FloatArray, others: Sequence[FloatArray]) -> bool:
        """Return whether forces (rows, 3) explain the deflections, and others do so clearly worse."""
        targets = self._targets
        if targets is None:
            return False
        unexplained = targets.measure_unexplained(self._take_rows(forces))
        if unexplained > LARGEST_UNEXPLAINED:
            return False
        by_others = [targets.measure_unexplained(self._take_rows(each)) for each in others]
        return all(targets.measure_margin(unexplained, each) >= LEAST_MARGIN for each in by_others)

    def are_down(self, sizes_of_load: Mapping[str, FloatArray]) -> bool:
        """Return whether forces act along −z of R0, and along no other fixed direction.

        `sizes_of_load` has load in words → sizes (N, m) of the force in each posture; the load of a file of
        joints alone has no words.
        """
        if self._targets is None:
            return False
        first = next(iter(sizes_of_load.values()))
        sizes = [np.abs(sizes_of_load.get(each.load, first))[:, 0] for each in self._loaded]
        return self._targets.are_down(np.stack(sizes, axis=1))
