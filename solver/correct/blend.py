"""Blended corrections: where the load turns at once, as at a corner, the correction changes over a length.

A correction that followed such a load from one row to the next would be a step of the path, for which the
joints are too slow, or at which the corrected path goes back. Near the step the commands are therefore
computed for the mean of the load over a length of the path, the least one with which the joints keep their
speeds. What is left of the deflection there is part of the residual.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.interpolate import make_interp_spline

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import CasesError
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.postures import Postures, flange_poses
from jointstiff.solver.predict.forward import ForwardModel
from jointstiff.solver.text import figure

_LENGTHS: Final = (0.002, 0.003, 0.004, 0.006, 0.008, 0.012, 0.016, 0.024)
"""Lengths over which a correction may change [m], in the order in which they are tried."""
_AIM: Final = 0.99
"""Part of a limit up to which a line is not too fast: on a part of the line joints are a bit faster."""
_UNBLENDED: Final = 0.02
"""Motion by the correction alone, relative to the limit, up to which the correction is not blended."""
_FASTER: Final = 1.05
"""Motion of a corrected line, relative to the wanted one, where this alone is too fast."""
_TURNED: Final = 0.01
"""Change of a load from a row to the next, relative to the load, up to which it does not turn at once."""
_ROWS_AT_ONCE: Final = 2_000
"""Rows whose commands are computed at a time."""
_PART: Final = 0.5
"""Part of a joint's speed that a correction may use: the rest is the controller's."""
_REST: Final = 1e-9
"""Length of a line below which the tool rests [m]."""


@dataclass(frozen=True, eq=False)
class Blend:
    """Loads of m rows for which commands are computed, where corrections are blended."""

    cases: LoadCases  #: the rows with these loads
    lengths: (
        FloatArray  #: (m,) lengths of the path over which loads are averaged [m]; zero where they are not
    )

    def select(self, rows: IndexArray) -> Blend:
        """Return the blend of some rows (k,)."""
        return Blend(self.cases[rows], self.lengths[rows])


def describe_blend(length: float, left: float) -> str:
    """Return words for corrections that change over up to a length [m], and what is left [m]."""
    return (
        f"the load turns faster than the joints can follow at the feed, so the correction changes over up to "
        f"{figure(1e3 * length, '.3g')} mm of the path, and up to {figure(1e3 * left, '.2g')} mm of the "
        "deflection remain there"
    )


def find_joint_limits(feed: FloatArray, speeds: FloatArray) -> FloatArray:
    """Return the greatest motion (m, n) of each joint along the path [rad/m or m/m]; inf if unknown.

    Args:
        feed: (m,) speed of the tool's centre on the line to each point [m/s]; NaN if unknown.
        speeds: (n,) greatest speeds of the model's joints [rad/s or m/s]; NaN if unknown.
    """
    limits = _PART * speeds / feed[:, None]
    return np.where(np.isnan(limits), np.inf, limits)


def blend_loads(
    model: ForwardModel, cases: LoadCases, continuous: BoolArray, limits: FloatArray
) -> Blend | None:
    """Average the loads of a path where the corrected joints would be too fast; None where nothing is.

    Rows without a load keep it, and nothing is averaged across them.

    Args:
        model: model of the loaded robot.
        cases: m wanted postures in the order of the path, with their loads.
        continuous: (m,) mask of rows to which a line leads from the row before.
        limits: (m, n) greatest motion of each of the model's joints for a length of the line to each row
            [rad/m or m/m]; inf where it is unknown.
    """
    continuous = _select_loaded_lines(continuous, cases.force, cases.moment)
    # A row that has no correction is not averaged with its neighbours; the correction names the reason.
    failed = model.find_overloads(cases, model.unloaded(cases))
    while True:
        continuous = _leave_out(continuous, failed)
        turned = continuous & _find_changes(cases.force, cases.moment, _TURNED)
        if not turned.any():
            return None
        try:
            return _Blending(model, cases, continuous, limits, turned).find()
        except CasesError as error:
            failed = error.failed


def _select_loaded_lines(continuous: BoolArray, force: FloatArray, moment: FloatArray) -> BoolArray:
    """Return the mask (m,) of the lines of `continuous` whose two ends are under load."""
    loaded = np.asarray(force.any(axis=1) | moment.any(axis=1))
    lines = continuous & loaded
    lines[1:] &= loaded[:-1]
    lines[:1] = False
    return lines


def _leave_out(lines: BoolArray, rows: BoolArray) -> BoolArray:
    """Return the mask (m,) of the lines of `lines` none of whose two ends is one of some rows (m,)."""
    return np.asarray(lines & ~rows & ~np.append(False, rows[:-1]))


def _find_changes(force: FloatArray, moment: FloatArray, part: float) -> BoolArray:
    """Return a mask (m,) of the rows whose load differs from the one before by more than a part of it."""
    changes = np.zeros(len(force), dtype=np.bool_)
    for loads in (force, moment):
        size = np.linalg.norm(loads, axis=1)
        change = np.linalg.norm(np.diff(loads, axis=0), axis=1)
        changes[1:] |= change > part * np.maximum(size[1:], size[:-1])
    return changes


def _find_near(lines: BoolArray, length: float, continuous: BoolArray, lengths: FloatArray) -> BoolArray:
    """Return a mask (m,) of the rows that are within half a length of lines (m,), in their stretch."""
    ends, starts = np.flatnonzero(lines), np.flatnonzero(~continuous)
    stretch = np.searchsorted(starts, ends, side="right") - 1
    begin_of_stretch, end_of_stretch = starts[stretch], np.append(starts[1:], len(lengths))[stretch]
    first = np.searchsorted(lengths, lengths[ends - 1] - 0.5 * length)
    last = np.searchsorted(lengths, lengths[ends] + 0.5 * length, side="right")
    # Each line adds 1 from its first row on, and takes it back behind its last.
    begins = np.bincount(np.maximum(first, begin_of_stretch), minlength=len(lengths) + 1)
    finishes = np.bincount(np.minimum(last, end_of_stretch), minlength=len(lengths) + 1)
    return np.asarray(np.cumsum(begins - finishes)[:-1] > 0)


class _Blending:
    """Search of the length over which the corrections of a path change."""

    def __init__(
        self,
        model: ForwardModel,
        cases: LoadCases,
        continuous: BoolArray,
        limits: FloatArray,
        turned: BoolArray,
    ) -> None:
        """Measure the path as wanted.

        Args:
            model: model of the loaded robot.
            cases: m wanted postures, with their loads.
            continuous: (m,) mask of rows to which a line leads from the row before, both under load.
            limits: (m, n) as of `blend_loads`.
            turned: (m,) mask of the lines on which the load turns; rows far from them are not examined.
        """
        self._model, self._cases, self._limits = model, cases, limits
        self._continuous = continuous
        self._goal = model.robot.joint_map.model_angles(cases.joints)
        self._wanted, self._steps = self._measure(self._goal)
        self._lengths = np.cumsum(self._steps)
        self._examined = _find_near(turned, _LENGTHS[-1], continuous, self._lengths)

    def find(self) -> Blend | None:
        """Return the loads, averaged near lines that are too fast over the least length that is enough.

        Lines that are near each other have the same length. Where none is enough, it is the greatest.
        """
        rows = np.flatnonzero(self._examined)
        group = np.cumsum(self._examined & ~np.append(False, self._examined[:-1]))  # of the examined rows
        commanded, loads, lengths = self._goal.copy(), self._cases, np.zeros(len(self._cases))
        commanded[rows] = self._command(loads[rows], rows)
        lines = np.zeros(len(lengths), dtype=np.bool_)
        length_of_group = np.zeros(int(group[-1]) + 1)
        for length in _LENGTHS:
            is_fast = self._find_fast(commanded)
            if not is_fast.any():
                break
            lines |= is_fast
            length_of_group[group[is_fast]] = length
            length_of_line = np.where(lines, length_of_group[group], 0.0)
            for each in np.unique(length_of_line[lines]):
                is_near = _find_near(length_of_line == each, float(each), self._continuous, self._lengths)
                lengths[is_near] = each
            loads = self._average(lengths)
            rows = np.flatnonzero(lengths)
            commanded[rows] = self._command(loads[rows], rows)
        return Blend(loads, lengths) if lengths.any() else None

    def _command(self, cases: LoadCases, rows: IndexArray) -> FloatArray:
        """Return the commands (k, n) of some rows under other loads, as the model's joints.

        Raises:
            CasesError: some rows have no command; `failed` is a mask of all m rows.
        """
        commanded = np.empty((len(rows), self._goal.shape[1]))
        for begin in range(0, len(rows), _ROWS_AT_ONCE):
            block = slice(begin, begin + _ROWS_AT_ONCE)
            goal = Postures(self._model.robot, self._goal[rows[block]])
            try:
                commanded[block] = self._model.compute_commands(cases[block], goal, np.ones(len(goal)))
            except CasesError as error:
                failed = np.isin(np.arange(len(self._goal)), rows[block][error.failed])
                raise CasesError(
                    error.reason, remedy=error.remedy or "", failed=failed, cause=error.cause
                ) from error
        return commanded

    def _measure(self, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the motion (m, n) of joints on the line to each row, and the line's length (m,) [m]."""
        poses = flange_poses(self._model.robot, joints)
        centres = (poses[:, :3, :3] @ self._cases.place[..., None])[..., 0] + poses[:, :3, 3]
        steps = np.append(0.0, np.linalg.norm(np.diff(centres, axis=0), axis=1))
        motion = np.abs(np.diff(joints, axis=0, prepend=joints[:1]))
        return np.where(self._continuous[:, None], motion, 0.0), np.where(self._continuous, steps, 0.0)

    def _find_fast(self, commanded: FloatArray) -> BoolArray:
        """Return a mask (m,) of the lines on which the correction makes the joints (m, n) too fast.

        A line on which the wanted joints are too fast may be a little faster as corrected.
        """
        motion, steps = self._measure(commanded)
        moves = self._steps > _REST
        moves[1:] &= self._examined[1:] & self._examined[:-1]
        limits = self._limits * steps[:, None]
        wanted = self._wanted * (steps / np.where(moves, self._steps, 1.0))[:, None]
        allowed = np.where(wanted > limits, _FASTER * wanted, _AIM * limits)
        is_fast = (motion > allowed) & (motion - wanted > _UNBLENDED * limits)
        return np.asarray(is_fast.any(axis=1) & moves)

    def _average(self, lengths: FloatArray) -> LoadCases:
        """Return the cases with the means of their loads over lengths (m,) of the path about each row.

        Between rows loads change evenly; before and behind a stretch they are as at its ends.
        """
        averaged = {"force": self._cases.force.copy(), "moment": self._cases.moment.copy()}
        starts = np.flatnonzero(~self._continuous)
        for first, last in zip(starts, np.append(starts[1:], len(lengths)), strict=True):
            inside = np.flatnonzero(lengths[first:last])
            if not len(inside):
                continue
            at, half = self._lengths[first:last], 0.5 * lengths[first:last][inside]
            distinct, index = np.unique(at, return_index=True)  # a tool that rests adds no length
            knots = np.concatenate([[at[0] - _LENGTHS[-1]], distinct, [at[-1] + _LENGTHS[-1]]])
            index = np.concatenate([index[:1], index, index[-1:]])
            for loads in averaged.values():
                own = loads[first:last]
                integral = make_interp_spline(knots, own[index], k=1).antiderivative()
                sums = integral(at[inside] + half) - integral(at[inside] - half)
                own[inside] = sums / (2.0 * half)[:, None]
        return replace(self._cases, **averaged)
