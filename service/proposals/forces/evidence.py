"""Evidence of the deflections for the meaning of columns that may be forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import permutations
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.proposals.tables.numbers import NumberTable
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
_NO_FORCE: Final = 0.1
"""Size of a force in rows without load, at most, as a part of the largest force."""
_VERTICAL: Final = np.radians(0.3)
"""Largest angle to z of R0 [rad] of a weight, after a turn that the robot's errors blur."""
_CLEARLY_TILTED: Final = 3.0
"""Least ratio of the angles to z of R0 of the two readings of a weight."""
_LEAST_LEAN: Final = 2.0
"""Least difference of the logarithms of the likelihood from which deflections rather show the axes."""

_CLEAR_MOTION: Final = 3.0
"""Ratio of the motion of targets and its noise from which the motion shows the sign of a force."""
_LEAST_MOVED: Final = 8
"""Least number of postures in which targets move clearly."""
_LEAST_ALONG: Final = 0.9
"""Least part of these postures in which targets move along the force."""


class JudgedAxes(NamedTuple):
    """Axes that forces of a file are likely in, where these differ from those of R0."""

    are_of_positions: bool  # whether forces are turned into R0 as the positions are
    reason: str  # in words


class MovedPostures(NamedTuple):
    """Postures in which the targets move clearly under load."""

    along: int  # of these, those in which they move along the force
    total: int


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

    def judge_axes(self, forces: FloatArray, table: str) -> JudgedAxes | None:
        """Return whether forces (rows, 3) of a table are likely in the axes of the positions, and why.

        None if both readings are the same, or if the deflections show that the axes are those of R0. Forces
        that are vertical in one reading only are weights. Else the deflections decide, even without a margin,
        and without deflections the table: its vectors are in one frame.
        """
        frame = self._proposal.frame
        turned = forces @ frame.rotation.T
        size = np.nanmax(np.abs(forces), initial=1e-9)
        change = float(np.nanmax(np.linalg.norm(turned - forces, axis=1), initial=0.0) / size)
        if frame.is_mirrored or frame.is_base or change <= _SAME_TURN or self._explain(forces, [turned]):
            return None
        if self._explain(turned, [forces]):
            return JudgedAxes(True, "as the deflections show")
        tilts = {is_turned: _find_tilt(each) for is_turned, each in ((False, forces), (True, turned))}
        for is_turned, tilt in tilts.items():
            if tilt <= _VERTICAL and tilts[not is_turned] >= _CLEARLY_TILTED * tilt:
                return JudgedAxes(is_turned, "as they are then vertical, as a weight is")
        lean = self._measure_lean(turned, forces)
        if abs(lean) >= _LEAST_LEAN:
            return JudgedAxes(lean > 0.0, "as the deflections rather show")
        is_one_table = all(each.reading.points.table == table for each in self._loaded)
        reason = "as they are in one table" if is_one_table else "as the positions are in another table"
        return JudgedAxes(is_one_table, reason)

    def _measure_lean(self, forces: FloatArray, others: FloatArray) -> float:
        """Return by how much the log of the likelihood by forces (rows, 3) is greater than by others."""
        if self._targets is None:
            return 0.0
        unexplained, by_others = (
            self._targets.measure_unexplained(self._take_rows(each)) for each in (forces, others)
        )
        return self._targets.measure_margin(unexplained, by_others)

    def may_be_forces(self, numbers: FloatArray) -> bool:
        """Return whether the deflections leave it open whether numbers (rows, 3) are forces."""
        if self._targets is None:
            return True
        frame = self._proposal.frame
        return any(
            self._targets.measure_unexplained(self._take_rows(each)) <= LARGEST_UNEXPLAINED
            for each in (numbers, numbers @ frame.rotation.T)
        )

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

    def count_moved_along(self, force: FloatArray) -> MovedPostures | None:
        """Return in how many postures the targets move along one force (3,); None if the force is in doubt.

        The force explains the deflections, and the rest of these is their noise. The postures count whose
        targets move clearly more.
        """
        targets = self._targets
        forces = np.broadcast_to(force, (len(self._joints.rows), 1, 3))
        if targets is None:
            return None
        postures, readings = targets.indices.T
        unexplained = targets.measure_unexplained(np.tile(forces, (1, readings.max() + 1, 1)))
        noise = np.sqrt(unexplained * np.mean(targets.deflections**2))
        number = np.maximum(np.bincount(postures), 1)
        motion = np.bincount(postures, np.linalg.norm(targets.deflections, axis=1)) / number
        work = np.bincount(postures, targets.deflections @ force)
        is_clear = motion > _CLEAR_MOTION * noise
        moved = MovedPostures(int((work[is_clear] > 0.0).sum()), int(is_clear.sum()))
        is_sure = unexplained <= LARGEST_UNEXPLAINED and moved.total >= _LEAST_MOVED
        return moved if is_sure and moved.along >= _LEAST_ALONG * moved.total else None

    def explains_better(self, force: FloatArray, other: FloatArray) -> bool:
        """Return whether a force (3,) explains the deflections, and another one clearly worse."""
        count = len(self._joints.rows)
        return self._explain(np.tile(force, (count, 1)), [np.tile(other, (count, 1))])

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


def _find_tilt(forces: FloatArray) -> float:
    """Return the largest angle [rad] of forces (rows, 3) to the axis z; infinite without forces."""
    sizes = np.linalg.norm(np.nan_to_num(forces), axis=1)
    x, y, z = forces[sizes > _NO_FORCE * sizes.max(initial=0.0)].T
    return float(np.arctan2(np.hypot(x, y), np.abs(z)).max()) if len(z) else float("inf")
