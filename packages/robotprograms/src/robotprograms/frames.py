"""Frames of moves: bases and tools in a state, as poses or by their names."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce

import numpy as np

from robotprograms import language as ir
from robotprograms.arrays import FloatArray
from robotprograms.columns import MAX_VALUE, OF_ROUTINE, Cause, WrittenNumbers, get_structure_name
from robotprograms.declarations import State
from robotprograms.language import Value
from robotprograms.places import Place
from robotprograms.program import FrameName
from robotprograms.statements import Statements


class FrameFinder:
    """Finder of frames."""

    def __init__(self, statements: Statements) -> None:
        """Prepare to find frames of a program."""
        self._statements, self._language = statements, statements.language
        self._contents = statements.contents
        self._poses: dict[tuple[WrittenNumbers, ...], FloatArray | None] = {}  # products of frames in numbers

    def evaluate(self, place: Place, value: Value | ir.Product, state: State) -> FrameName | Cause:
        """Return the base or tool that a move names, or the cause why the frame is unknown.

        Args:
            place: place of the move.
            value: the frame, or a product of frames whose poses are multiplied.
            state: contents of all names at the move.
        """
        values = [ir.Copy(name) for name in value.names] if isinstance(value, ir.Product) else [value]
        contents = [self._contents.evaluate(place, "", factor, state) for factor in values]
        for content in contents:
            if isinstance(content, Cause):
                return content
        numbers = tuple(content for content in contents if isinstance(content, WrittenNumbers))
        are_all_numbers = len(numbers) == len(contents)
        if not are_all_numbers:
            names = {get_structure_name(content) for content in contents if isinstance(content, str)}
            if numbers or len(names) > 1:
                reason = "the frame is only partly in numbers"
                return place.make_cause(reason, "give the whole frame in numbers")
            return self._find_named_frame(place, names.pop())
        if numbers not in self._poses:
            self._poses[numbers] = self._multiply_poses(numbers)
        first, pose = numbers[0], self._poses[numbers]
        label, _, routine = first.label.partition(OF_ROUTINE)
        is_known_by_name = routine or self._language.is_frame(label)
        if not is_known_by_name:
            label = f"{label or 'frame'} of line {first.line}"
        if pose is None:
            reason = f"{label} is not a whole frame in numbers"
            return Cause(first.line, reason, "give the whole frame in numbers", first.source)
        return FrameName(self._statements.restore_spelling(place, label), pose)

    def _find_named_frame(self, place: Place, name: str) -> FrameName:
        """Return a frame that is known by name only, with a pose if no program can change the frame."""
        if name not in self._contents.named:
            self._contents.named[name] = FrameName(
                self._statements.restore_spelling(place, name), self._language.constants.get(name)
            )
        return self._contents.named[name]

    def _multiply_poses(self, frames: Iterable[WrittenNumbers]) -> FloatArray | None:
        """Return the product (4, 4) [m] of poses in numbers; None if some numbers are not a pose."""
        poses = []
        for frame in frames:
            notation = frame.literal.notation
            numbers_of_file = self._statements.numerals[frame.source].values
            values = numbers_of_file[frame.first + np.array(frame.literal.numbers)]
            if not notation.has_pose:
                return None
            are_in_range = (np.abs(values) <= MAX_VALUE).all()
            if not are_in_range or not notation.is_valid_orientation(values):
                return None
            poses.append(notation.to_pose(values))
        return np.asarray(reduce(np.matmul, poses))
