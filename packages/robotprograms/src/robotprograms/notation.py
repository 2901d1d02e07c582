"""Numbers of a program: all numbers of a text, poses in SI units that they state, and other numbers."""

from __future__ import annotations

import ast
import math
import operator
import re
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from robotprograms.arrays import BoolArray, FloatArray, IndexArray
from robotprograms.rotations import (
    matrices_from_quaternions,
    matrices_from_vectors,
    quaternions_from_matrices,
    vectors_from_matrices,
)

MM: Final = 1e-3
DEGREE: Final = float(np.pi / 180)


class Orientation(Enum):
    """Convention by which a format writes the orientation of the tool's frame in the base's."""

    EULER_ZYX = "A, B, C about Z, Y', X''"
    FIXED_XYZ = "W, P, R about the fixed X, Y, Z"
    QUATERNION = "quaternion, scalar first"
    ROTATION_VECTOR = "rotation vector"
    TOOL_AXIS = "unit vector of the tool's axis, from the tip to the spindle"
    NONE = "position only"
    JOINTS = "the controller's joint angles"


_ORIENTATION_COUNTS: Final = {Orientation.QUATERNION: 4, Orientation.NONE: 0}
_UNIT_TOLERANCE: Final = 1e-3
"""Largest difference of a quaternion's length from 1 that the rounding of a program explains."""
_GIMBAL_COSINE: Final = 1e-9
"""|cos| of the middle angle below which the two other angles turn about the same axis."""
_ZERO_ANGLE: Final = 1e-12
"""Angle of a rotation [rad] below which its axis is not known."""


@dataclass(frozen=True, slots=True)
class Notation:
    """Meaning of the numbers of a target."""

    orientation: (
        Orientation  # convention of the numbers after the position; JOINTS if all numbers are joint angles
    )
    length: float = MM  # metres in the unit of position
    angle: float = DEGREE  # radians in the unit of angles (1 where there are none)
    length_decimals: int = 4  # digits behind the point that a changed position gets at least
    angle_decimals: int = 5  # fewest decimals of a changed angle or component of an orientation

    @property
    def count(self) -> int:
        """Count of the numbers after the position: 4 for a quaternion, 0 for a position only, else 3."""
        return _ORIENTATION_COUNTS.get(self.orientation, 3)

    def to_pose(self, values: Sequence[float] | FloatArray) -> FloatArray:
        """Return the pose (4, 4) [m] of the tool in the base that the numbers of a target state."""
        return np.asarray(self.to_poses(np.array([values], dtype=float))[0], dtype=float)

    @property
    def has_pose(self) -> bool:
        """Return whether the numbers state a position and a full orientation."""
        return self.orientation not in {Orientation.JOINTS, Orientation.TOOL_AXIS, Orientation.NONE}

    @property
    def is_joints(self) -> bool:
        """Return whether the numbers are joint angles."""
        return self.orientation is Orientation.JOINTS

    def is_valid_orientation(self, values: FloatArray) -> BoolArray:
        """Return a mask (...) of the targets whose numbers (..., 3 + count) state a valid orientation.

        The first three numbers are the position. A quaternion must have unit length, and a tool's axis must
        not be zero; any other orientation is valid.
        """
        lengths = np.linalg.norm(values[..., 3 : 3 + self.count], axis=-1)
        if self.orientation is Orientation.TOOL_AXIS:
            return np.asarray(lengths > 0.0)
        if self.orientation is Orientation.QUATERNION:
            return np.asarray(np.abs(lengths - 1.0) <= _UNIT_TOLERANCE)
        return np.ones_like(lengths, dtype=np.bool_)

    @property
    def decimals(self) -> tuple[int, ...]:
        """Fewest decimals of each number of a target when it is rewritten."""
        if self.is_joints:
            return (self.angle_decimals,) * 6
        return (self.length_decimals,) * 3 + (self.angle_decimals,) * self.count

    def to_poses(self, values: FloatArray) -> FloatArray:
        """Return the poses (m, 4, 4) [m], tool in base, that the numbers (m, 3 + count) of m targets state.

        Raises:
            ValueError: the notation states no full pose.
        """
        if not self.has_pose:
            raise ValueError(f"{self.orientation.value} is no full pose")
        poses = np.tile(np.eye(4), (len(values), 1, 1))
        poses[:, :3, 3] = values[:, :3] * self.length
        numbers = values[:, 3:]
        if self.orientation is Orientation.QUATERNION:
            poses[:, :3, :3] = matrices_from_quaternions(numbers)
        elif self.orientation is Orientation.ROTATION_VECTOR:
            poses[:, :3, :3] = matrices_from_vectors(numbers * self.angle)
        else:
            angles_about_zyx = self._swap_order_of_angles(numbers * self.angle)
            poses[:, :3, :3] = _to_rotation_matrices(angles_about_zyx)
        return poses

    def _swap_order_of_angles(self, angles: FloatArray) -> FloatArray:
        """Convert angles (m, 3) in the order of this notation to angles about Z, Y', X''; or these ones back.

        Rotations by w, p, r about the fixed axes X, Y, Z are the same as those by r, p, w about the turned
        axes Z, Y', X''. So the order is reversed in both directions; a notation in Z, Y', X'' keeps its
        order.
        """
        return angles if self.orientation is Orientation.EULER_ZYX else angles[:, ::-1]

    def from_poses(self, poses: FloatArray, near: FloatArray) -> FloatArray:
        """Return the numbers (m, 3 + count) by which this notation writes poses (m, 4, 4) [m].

        One orientation can be written by different numbers, such as angles that differ by 360°. The numbers
        nearest to the old numbers `near` (m, 3 + count) are returned, so that the arm does not turn by 360°.
        """
        if len(poses) == 0:
            return near.copy()
        positions = poses[:, :3, 3] / self.length
        orientations = self._write_orientations(poses[:, :3, :3], near[:, 3:])
        return np.hstack([positions, orientations])

    def _write_orientations(self, rotations: FloatArray, near: FloatArray) -> FloatArray:
        """Return the numbers (m, count) of rotations (m, 3, 3) that are nearest to the old numbers `near`."""
        if self.orientation is Orientation.QUATERNION:
            return _find_nearest_quaternions(rotations, near)
        if self.orientation is Orientation.ROTATION_VECTOR:
            vectors = _find_nearest_vectors(vectors_from_matrices(rotations), near * self.angle)
            return vectors / self.angle
        old_angles_about_zyx = self._swap_order_of_angles(near * self.angle)
        angles_about_zyx = _find_nearest_angles(rotations, old_angles_about_zyx)
        return self._swap_order_of_angles(angles_about_zyx) / self.angle


def _find_nearest_quaternions(rotations: FloatArray, near: FloatArray) -> FloatArray:
    """Return the quaternions (m, 4) of rotation matrices (m, 3, 3), with lengths and signs of `near` (m, 4).

    The old quaternion `near` has a rounded length: with the same length, an unchanged quaternion keeps its
    numbers. A quaternion and its negative state the same orientation.
    """
    quaternions = quaternions_from_matrices(rotations) * np.linalg.norm(near, axis=1, keepdims=True)
    is_opposite = np.sum(quaternions * near, axis=1, keepdims=True) < 0
    return np.asarray(np.where(is_opposite, -quaternions, quaternions))


def _find_nearest_vectors(vectors: FloatArray, near: FloatArray) -> FloatArray:
    """Return rotation vectors (m, 3) [rad] with full turns added that bring them nearest to `near` (m, 3).

    The vector α u, with the angle α and the unit axis u, states the same rotation as (α + 2πk) u for each
    whole k. A zero rotation has no axis: full turns are added about the axis of `near`.
    """
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    axis = np.where(angle < _ZERO_ANGLE, _divide_by_length(near), _divide_by_length(vectors))
    near_angle_about_axis = np.sum(axis * near, axis=1, keepdims=True)
    turns = np.round((near_angle_about_axis - angle) / (2 * np.pi))
    turned_vectors = axis * (angle + 2 * np.pi * turns)
    return np.where(turns == 0, vectors, turned_vectors)


def _divide_by_length(vectors: FloatArray) -> FloatArray:
    """Return the unit vectors (m, 3) along vectors (m, 3); zero for a vector of length zero."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(lengths > 0, lengths, 1))


def _to_rotation_matrices(angles: FloatArray) -> FloatArray:
    """Return the matrices Rz(a) Ry(b) Rx(c), as (m, 3, 3), of angles (m, 3) [rad] about Z, Y', X''."""
    (sin_a, sin_b, sin_c), (cos_a, cos_b, cos_c) = np.sin(angles).T, np.cos(angles).T
    rotations = np.empty((len(angles), 3, 3))
    rotations[:, 0, 0] = cos_a * cos_b
    rotations[:, 0, 1] = cos_a * sin_b * sin_c - sin_a * cos_c
    rotations[:, 0, 2] = cos_a * sin_b * cos_c + sin_a * sin_c
    rotations[:, 1, 0] = sin_a * cos_b
    rotations[:, 1, 1] = sin_a * sin_b * sin_c + cos_a * cos_c
    rotations[:, 1, 2] = sin_a * sin_b * cos_c - cos_a * sin_c
    rotations[:, 2, 0] = -sin_b
    rotations[:, 2, 1] = cos_b * sin_c
    rotations[:, 2, 2] = cos_b * cos_c
    return rotations


def _find_nearest_angles(rotations: FloatArray, near: FloatArray) -> FloatArray:
    """Return the angles (m, 3) [rad] about Z, Y', X'' of rotations (m, 3, 3), as near to `near` as possible.

    `near` (m, 3) [rad] are the angles before a small change. Each rotation has two solutions, up to full
    turns; in a gimbal lock it has one for each angle about X'', which then keeps its value.
    """
    is_locked = np.hypot(rotations[:, 0, 0], rotations[:, 1, 0]) < _GIMBAL_COSINE
    first, second = _find_both_solutions(rotations)
    if is_locked.any():
        locked = _find_locked_solution(rotations[is_locked], near[is_locked, 2])
        first[is_locked] = second[is_locked] = locked
    return _choose_nearer(_add_turns(first, near), _add_turns(second, near), near)


def _choose_nearer(first: FloatArray, second: FloatArray, near: FloatArray) -> FloatArray:
    """Return the row of `first` or of `second` that is nearer to that of `near`, for each of m rows (m, 3).

    The distance is Euclidean; of two rows at the same distance, the first one is returned.
    """
    distance_of_first = np.sum((first - near) ** 2, axis=1)
    distance_of_second = np.sum((second - near) ** 2, axis=1)
    is_first_nearer = (distance_of_first <= distance_of_second)[:, np.newaxis]
    return np.where(is_first_nearer, first, second)


def _find_both_solutions(rotations: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the angles (m, 3) [rad] about Z, Y', X'' of rotations (m, 3, 3): two solutions without turns.

    With the angles a, b, c, the first column of R = Rz(a) Ry(b) Rx(c) is (cos a cos b, sin a cos b, -sin b),
    and its last row is (-sin b, cos b sin c, cos b cos c). The first solution has cos b > 0, the second one
    has a + π, π - b, c + π.
    """
    r = rotations
    cosine_of_b = np.hypot(r[:, 0, 0], r[:, 1, 0])
    a = np.arctan2(r[:, 1, 0], r[:, 0, 0])
    b = np.arctan2(-r[:, 2, 0], cosine_of_b)
    c = np.arctan2(r[:, 2, 1], r[:, 2, 2])
    first = np.column_stack([a, b, c])
    second = np.column_stack([a + np.pi, np.pi - b, c + np.pi])
    return first, second


def _find_locked_solution(rotations: FloatArray, kept: FloatArray) -> FloatArray:
    """Return the angles (m, 3) [rad] about Z, Y', X'' of rotations in a gimbal lock.

    The last angles (m,) are `kept`. With the angles a, b, c and b = ±π/2, R = Rz(a) Ry(b) Rx(c) shows only
    the angle a ∓ c: the middle column of R is (-sin(a ∓ c), cos(a ∓ c), 0).
    """
    r = rotations
    cosine_of_b = np.hypot(r[:, 0, 0], r[:, 1, 0])
    b = np.arctan2(-r[:, 2, 0], cosine_of_b)
    sign_of_b = np.where(b > 0, 1.0, -1.0)
    shown_angle = np.arctan2(-r[:, 0, 1], r[:, 1, 1])
    return np.column_stack([shown_angle + sign_of_b * kept, b, kept])


def _add_turns(angles: FloatArray, near: FloatArray) -> FloatArray:
    """Return angles [rad] with full turns added that bring each angle nearest to that in `near`."""
    return np.asarray(angles + 2 * np.pi * np.round((near - angles) / (2 * np.pi)))


def calculate(expression: str) -> float | None:
    """Return the value of an expression of numbers, pi and d2r(); None if there is none."""
    try:
        value = _calculate(ast.parse(expression.strip(), mode="eval").body)
    except (SyntaxError, ValueError, KeyError, ArithmeticError, RecursionError, MemoryError):
        return None
    return value if math.isfinite(value) else None


def _calculate(node: ast.expr) -> float:
    """Return the value of an expression from its syntax tree, such as that of `pi/2 + d2r(30)`.

    Raises:
        ValueError: the expression has other parts than numbers, pi, d2r() and signs.
        KeyError: a sign is none of +, -, * and /.
    """
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name(id="pi"):
            return math.pi
        case ast.Call(func=ast.Name(id="d2r"), args=[degrees], keywords=[]):
            return math.radians(_calculate(degrees))
        case ast.UnaryOp(op=sign, operand=operand):
            return _ONE_OPERAND[type(sign)](_calculate(operand))
        case ast.BinOp(left=left, op=sign, right=right):
            return _TWO_OPERANDS[type(sign)](_calculate(left), _calculate(right))
    raise ValueError(ast.dump(node))


_ONE_OPERAND: Final[dict[type[ast.unaryop], Callable[[float], float]]] = {
    ast.UAdd: operator.pos, ast.USub: operator.neg
}  # fmt: skip
_TWO_OPERANDS: Final[dict[type[ast.operator], Callable[[float, float], float]]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv
}  # fmt: skip
_MOST_BLANKS: Final = 32
"""Most blanks before a number that are used to keep columns aligned."""
_BLOCK_LENGTH: Final = 1 << 16
"""Characters whose numbers are held as texts at a time."""
Places: TypeAlias = npt.NDArray[np.int32]
"""Places in a text; 32 bits are enough, because programs are limited in size."""
Characters: TypeAlias = npt.NDArray[np.uint8]
"""A text in one byte a character."""
Edit: TypeAlias = tuple[int, int, str]
"""First and last + 1 character, and the text in their place."""


@dataclass(frozen=True, slots=True, eq=False)
class Numerals:
    """All N numbers of a text, and the text with NUL in place of each number."""

    values: FloatArray  # (N,) numbers
    starts: Places  # (N,) first character of each number
    ends: Places  # (N,) last character + 1 of each number
    masked_text: str  # the text with `\0` in place of each number

    @classmethod
    def from_text(cls, text: str, pattern: str) -> Numerals:
        r"""Find the numbers in a text without `\0` by a pattern; no number spans two lines.

        In `X 1.5,Y 2`, the numbers are 1.5 and 2, and the masked text is `X \0,Y \0`. The text is read in
        blocks of whole lines, because the numbers of a long program would fill the memory as texts.
        """
        split_at_numbers = re.compile(f"({pattern})").split
        blocks = (
            cls._from_pieces(split_at_numbers(text[begin:end]), begin) for begin, end in _list_blocks(text)
        )
        return cls._join(blocks)

    @classmethod
    def _join(cls, blocks: Iterable[Numerals]) -> Numerals:
        """Join the numbers of the blocks of a text.

        Growing arrays hold them: many small arrays would leave gaps in the memory, as large as the numbers
        themselves.
        """
        values, starts, ends = array("d"), array("i"), array("i")
        masked_blocks = list[str]()
        for block in blocks:
            values.frombytes(block.values.tobytes())
            starts.frombytes(block.starts.tobytes())
            ends.frombytes(block.ends.tobytes())
            masked_blocks.append(block.masked_text)
        return cls(
            np.asarray(memoryview(values)),
            np.asarray(memoryview(starts)),
            np.asarray(memoryview(ends)),
            "".join(masked_blocks),
        )

    @classmethod
    def _from_pieces(cls, pieces: list[str], begin: int) -> Numerals:
        r"""Return the numbers of a block of a text that is split at its numbers.

        Args:
            pieces: text, number, text, number, …, text: as `X `, `1.5`, `,Y `, `2` and an empty text.
            begin: index of the block's first character in the whole text.
        """
        texts, numbers = pieces[::2], pieces[1::2]
        lengths = np.fromiter(map(len, pieces), dtype=np.int32, count=len(pieces))
        ends_of_pieces = begin + np.cumsum(lengths, dtype=np.int32)
        ends_of_texts, ends_of_numbers = ends_of_pieces[::2], ends_of_pieces[1::2]
        starts_of_numbers = ends_of_texts[:-1]  # a number begins where the text before it ends
        return cls(_parse_numbers(numbers), starts_of_numbers, ends_of_numbers, "\0".join(texts))

    def masked_texts(self, starts: IndexArray, ends: IndexArray) -> tuple[Iterator[str], IndexArray]:
        """Return k parts of the text, with NUL in place of each number.

        Args:
            starts: (k,) first character of each part.
            ends: (k,) last character + 1 of each part.

        Returns:
            Texts of the parts with NUL in place of each number; index (k,) of the first number of each part.
        """
        missing = self._count_missing_characters()
        first_number = np.searchsorted(self.starts, starts)
        end_of_numbers = np.searchsorted(self.starts, ends)
        masked_starts = starts - missing[first_number]
        masked_ends = ends - missing[end_of_numbers]
        text = self.masked_text
        spans = zip(iterate_integers(masked_starts), iterate_integers(masked_ends), strict=True)
        return (text[start:end] for start, end in spans), first_number

    def _count_missing_characters(self) -> Places:
        """Return how many characters the masked text lacks before each number and behind the last one.

        The counts (N + 1,) are computed in place, because long programs fill the memory.
        """
        missing = np.zeros(len(self.values) + 1, dtype=np.int32)
        np.subtract(self.ends, self.starts, out=missing[1:])
        missing[1:] -= 1  # NUL takes the place of the number
        np.cumsum(missing, out=missing)
        return missing


def _list_blocks(text: str) -> Iterator[tuple[int, int]]:
    """Yield the first and the last + 1 character of each block of a text; a block ends with a line."""
    begin = 0
    while begin < len(text):
        end_of_line = text.find("\n", begin + _BLOCK_LENGTH) + 1
        end = end_of_line or len(text)  # there is no further line end in the last block
        yield begin, end
        begin = end


def iterate_integers(values: IndexArray) -> Iterator[int]:
    """Yield the integers of an array in blocks: a list of all of them would take five times its memory."""
    for start in range(0, len(values), _BLOCK):
        yield from values[start : start + _BLOCK].tolist()


_BLOCK: Final = 4096


def _parse_numbers(numbers: Sequence[str]) -> FloatArray:
    """Return the values of numbers, which may have decimal commas, or be binary such as KUKA's 'B010'."""
    try:
        return np.fromiter(map(float, numbers), dtype=np.float64, count=len(numbers))
    except ValueError:  # a binary number or a decimal comma: the slower way
        return np.array([_parse_number(number) for number in numbers], dtype=np.float64)


def _parse_number(number: str) -> float:
    """Return the value of a number, such as 1.5, 1,5 or 'B010'."""
    if number.startswith("'"):
        digits = number.removeprefix("'B").strip(" '")
        return float(int(digits, 2))
    return float(number.replace(",", "."))


_CELL: Final = r"(?:^|[;\t])[ \"]*+{}[ \"]*+(?=[;\t\r\n]|\Z)"
_CELL_WITH_POINT: Final = re.compile(_CELL.format(r"[+-]?\d*+\.\d++"), re.MULTILINE)
_CELL_WITH_COMMA: Final = re.compile(
    _CELL.format(r"[+-]?(?:0,\d++|\d{4,15},\d++|\d{1,3},(?:\d\d?|\d{4,15}))"), re.MULTILINE
)
"""A comma with other than three digits behind it, or more than three before it, separates no thousands."""


_SEARCHED_LENGTH: Final = 1 << 16
"""Number of characters of a table in which decimal commas are looked for."""


def has_decimal_commas(table: str) -> bool:
    """Return whether a table has numbers with decimal commas, and no number with a decimal point."""
    begin = table[:_SEARCHED_LENGTH]
    return _CELL_WITH_COMMA.search(begin) is not None and _CELL_WITH_POINT.search(begin) is None


def format_new_numbers(
    characters: Characters, spans: Places, new: FloatArray, old: FloatArray, digits: IndexArray
) -> tuple[list[str], BoolArray]:
    """Format new numbers like the old ones in a text: with as many decimals at least, and with a plus sign.

    Args:
        characters: text with the old numbers, one byte per character.
        spans: (m, 2) first and last + 1 character of each old number.
        new: (m,) new numbers.
        old: (m,) old numbers.
        digits: (m,) fewest decimals of each new number; an old number with more decimals keeps them.

    Returns:
        Texts of the new numbers; mask (m,) of the new numbers that differ from the old numbers at these
        decimals.
    """
    digits = np.maximum(digits, _count_decimals(characters, spans))
    numbers = _format_numbers(new, digits)
    differ = np.ones(len(new), dtype=np.bool_)
    # Only numbers near the old number or near zero need a comparison of texts.
    distance = np.minimum(np.abs(new - old), np.abs(new))
    for i in np.flatnonzero(distance < 2.0 * 10.0**-digits).tolist():
        numbers[i] = _remove_sign_of_zero(numbers[i])
        old_number = _remove_sign_of_zero(f"{old[i]:.{digits[i]}f}")
        differ[i] = numbers[i] != old_number
    _copy_plus_signs(numbers, has_plus_sign=characters[spans[:, 0]] == ord("+"))
    return numbers, differ


def _remove_sign_of_zero(number: str) -> str:
    """Return a number as text: `0.00` for `-0.00`, any other number unchanged."""
    return number.removeprefix("-") if float(number) == 0.0 else number


def _copy_plus_signs(numbers: list[str], has_plus_sign: BoolArray) -> None:
    """Write a plus sign before each of m numbers, in place, whose old number has one, unless it is negative.

    `has_plus_sign` (m,) is the mask of the old numbers.
    """
    for i in np.flatnonzero(has_plus_sign).tolist():
        if not numbers[i].startswith("-"):
            numbers[i] = f"+{numbers[i]}"


def _format_numbers(numbers: FloatArray, digits: IndexArray) -> list[str]:
    """Return m numbers as texts, with the counts of decimals `digits` (m,).

    All numbers with the same count are formatted at once, because many formats would be slower.
    """
    texts = np.empty(len(numbers), dtype=object)
    for count in np.unique(digits).tolist():
        rows = np.flatnonzero(digits == count)
        format_of_all = "\n".join([f"%.{count}f"] * len(rows))
        joined_texts = format_of_all % tuple(numbers[rows].tolist())
        texts[rows] = joined_texts.split("\n")
    return list(texts)


def _count_decimals(characters: Characters, spans: Places) -> IndexArray:
    """Return the counts of decimals (m,) of m numbers, which are at the spans (m, 2) of a text.

    The decimals of a number are between its point or comma and its exponent or end.
    """
    starts, ends = spans.T
    exponents = np.flatnonzero((characters | 32) == ord("e"))  # | 32 makes capitals small letters
    points = np.flatnonzero((characters == ord(".")) | (characters == ord(",")))
    end_of_decimals = np.minimum(_find_next(exponents, starts, len(characters)), ends)
    end_of_whole_number = np.minimum(_find_next(points, starts, len(characters)), end_of_decimals)
    # One character less for the point; a number without a point has no decimals.
    return np.asarray(np.maximum(end_of_decimals - end_of_whole_number - 1, 0))


def _find_next(places: IndexArray, starts: Places, length: int) -> IndexArray:
    """Return for each start (m,) the next one of some sorted places in a text.

    Behind the last place, it is the length of the text.
    """
    places_and_end = np.append(places, length)
    index_of_next = np.searchsorted(places, starts)
    return np.asarray(places_and_end[index_of_next])


def pad_number(characters: Characters, start: int, end: int, number: str) -> Edit:
    """Return the edit that replaces a number and keeps its end in the same column of the text.

    Blanks before the number are removed or added. If there are too few blanks, the number ends further right.

    Args:
        characters: the text, one byte per character.
        start: first character of the old number.
        end: last character + 1 of the old number.
        number: text of the new number.
    """
    text_before = characters[max(start - _MOST_BLANKS, 0) : start].tobytes()
    count_of_blanks = len(text_before) - len(text_before.rstrip(b" "))
    growth = len(number) - (end - start)
    if growth > 0:
        removable_blanks = max(count_of_blanks - 1, 0)  # one blank stays
        return start - min(growth, removable_blanks), end, number
    padding = " " * -growth if count_of_blanks else ""
    return start, end, padding + number


def splice_texts(characters: Characters, spans: Places, texts: Sequence[str]) -> bytes:
    """Return the bytes of a text in which some parts are replaced.

    Args:
        characters: the text, one byte per character.
        spans: (m, 2) first and last + 1 character of each part that is replaced, in order.
        texts: m texts in place of these parts.
    """
    starts, ends = spans.T
    gaps = _measure_gaps(spans, len(characters))
    new_lengths = np.fromiter(map(len, texts), dtype=np.intp, count=len(texts))
    is_replaced = _mark_parts(gaps, ends - starts)  # mask of the old text
    is_new = _mark_parts(gaps, new_lengths)  # mask of the new text
    result = np.empty(len(is_new), dtype=np.uint8)
    result[is_new] = np.frombuffer("".join(texts).encode("latin-1"), dtype=np.uint8)
    result[~is_new] = characters[~is_replaced]
    return result.tobytes()


def _measure_gaps(spans: Places, length: int) -> IndexArray:
    """Return the lengths (m + 1,) of the gaps before, between and behind the m parts of a text.

    For the parts (2, 4) and (5, 6) of a text of 9 characters, the lengths are 2, 1 and 3.

    Args:
        spans: (m, 2) first and last + 1 character of each part, in order.
        length: number of characters of the text.
    """
    starts, ends = spans.T
    ends_of_gaps = np.append(starts, length)
    starts_of_gaps = np.concatenate([[0], ends])
    return np.asarray(ends_of_gaps - starts_of_gaps)


def _mark_parts(gaps: IndexArray, parts: IndexArray) -> BoolArray:
    """Return a mask of a text that is true at its m parts, from the lengths of parts (m,) and gaps (m + 1,).

    The text begins with a gap, and gaps and parts alternate.
    """
    lengths = np.empty(len(gaps) + len(parts), dtype=np.intp)
    lengths[::2], lengths[1::2] = gaps, parts
    is_part = np.arange(len(lengths)) % 2 == 1
    return np.repeat(is_part, lengths)
