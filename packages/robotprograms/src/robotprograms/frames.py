"""Frames of moves: bases and tools in a state, as poses or by their names."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce

import numpy as np

from robotprograms import language as ir
from robotprograms.arrays import FloatArray
from robotprograms.columns import MAX_VALUE, Cause, WrittenNumbers, get_structure_name, split_full_name
from robotprograms.declarations import State
from robotprograms.language import Value
from robotprograms.places import Place
from robotprograms.program import FrameName
from robotprograms.statements import Statements


class FrameFinder:
    """Finds the bases and tools of moves: with a pose if the program gives the numbers, else by name."""

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
        factors = [ir.Copy(name) for name in value.names] if isinstance(value, ir.Product) else [value]
        contents = [self._contents.evaluate(place, "", factor, state) for factor in factors]
        for content in contents:
            if isinstance(content, Cause):
                return content
        # A content that is no cause is either numbers in the text, or the name of a stored frame.
        numbers = tuple(content for content in contents if isinstance(content, WrittenNumbers))
        if len(numbers) == len(contents):
            return self._find_frame_in_numbers(place, numbers)
        names = {get_structure_name(content) for content in contents if isinstance(content, str)}
        if numbers or len(names) > 1:
            reason = "the frame is only partly in numbers"
            return place.make_cause(reason, "give the whole frame in numbers")
        return self._find_named_frame(place, names.pop())

    def _find_frame_in_numbers(self, place: Place, factors: tuple[WrittenNumbers, ...]) -> FrameName | Cause:
        """Return the product of frames in numbers, or the cause that some numbers are not a frame.

        The product has the name of its first factor, or the line of that factor if it has no name that the
        user knows. A product is calculated once.
        """
        if factors not in self._poses:
            self._poses[factors] = self._multiply_poses(factors)
        pose = self._poses[factors]
        first = factors[0]
        label, owner = split_full_name(first.label)
        is_known_by_name = owner or self._language.is_frame(label)
        if not is_known_by_name:
            label = f"{label or 'frame'} of line {first.line}"
        if pose is None:
            reason = f"{label} is not a whole frame in numbers"
            return Cause(first.line, reason, "give the whole frame in numbers", first.source)
        return FrameName(self._statements.restore_spelling(place, label), pose)

    def _find_named_frame(self, place: Place, name: str) -> FrameName:
        """Return a frame whose numbers the program does not give, under its name.

        The frame has a pose only if it is a constant of the controller, such as KUKA's $NULLFRAME. `place` is
        that of the move, near which the program spells the name.
        """
        frames = self._contents.named
        if name not in frames:
            spelling = self._statements.restore_spelling(place, name)
            frames[name] = FrameName(spelling, self._language.constants.get(name))
        return frames[name]

    def _multiply_poses(self, factors: Iterable[WrittenNumbers]) -> FloatArray | None:
        """Return the product (4, 4) [m] of the poses of frames, the first frame on the left.

        Return None if the numbers of a frame are not a whole pose: a position only, joint angles, a number
        out of range, or a quaternion that is not of unit length.
        """
        poses = []
        for factor in factors:
            notation = factor.literal.notation
            if not notation.has_pose:
                return None
            numbers = factor.read(self._statements.numerals)
            are_in_range = (np.abs(numbers) <= MAX_VALUE).all()
            if not are_in_range or not notation.is_valid_orientation(numbers):
                return None
            poses.append(notation.to_pose(numbers))
        return np.asarray(reduce(np.matmul, poses))
