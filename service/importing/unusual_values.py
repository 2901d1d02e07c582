"""Values that are far from all others of their column, which a person has to confirm."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from statistics import median, pstdev
from typing import Final, NamedTuple

from jointstiff.service.importing.errors import Place
from jointstiff.service.importing.rows import ObservationRecord

_MAX_SPREADS: Final = 100.0
"""Distance of a value from its column's median, in spreads, beyond which the user has to confirm it."""
_MIN_VALUES: Final = 5
"""Fewest values of a column for which a spread is computed."""


class _PlacedNumber(NamedTuple):
    """Number of a file, and where it is."""

    number: float
    place: Place


def describe_unusual_values(observations: Iterable[ObservationRecord]) -> Iterator[str]:
    """Yield a sentence for each value that is farther than 100 spreads from the median of its column."""
    for name, numbers in _list_numbers_by_column(observations).items():
        if len(numbers) >= _MIN_VALUES:
            yield from _find_unusual_numbers(name, numbers)


def _list_numbers_by_column(
    observations: Iterable[ObservationRecord],
) -> dict[str, list[_PlacedNumber]]:
    """Return column, such as `joint 2` or `P1 loaded x`, → its numbers in all observations."""
    columns: dict[str, list[_PlacedNumber]] = {}
    items = (item for observation in observations for item in observation.values.items())
    for (kind, target, state), value in items:
        name = f"{target} {state}" if target else kind
        for axis, number in enumerate(value.vector or ()):
            part = str(axis + 1) if kind == "joint" else "xyz"[axis]
            columns.setdefault(f"{name} {part}", []).append(_PlacedNumber(number, value.place))
    return columns


def _find_unusual_numbers(name: str, numbers: Sequence[_PlacedNumber]) -> Iterator[str]:
    """Yield a sentence for each number of the column `name` that is farther than 100 spreads from the median.

    The spread is the standard deviation of the nine tenths of the values that are nearest to the median, or
    the size of the median if these values are all equal.
    """
    middle = median(each.number for each in numbers)
    nearest_first = sorted(numbers, key=lambda each: abs(each.number - middle))
    far_count = max(1, len(numbers) // 10)
    nearest, farthest = nearest_first[:-far_count], nearest_first[-far_count:]
    spread = pstdev(each.number for each in nearest) or abs(middle)
    for number, place in farthest:
        spreads = abs(number - middle) / spread if spread else 0.0
        # 0.99: a value whose distance is the limit itself is listed despite rounding.
        if spreads > 0.99 * _MAX_SPREADS:
            distance = (
                f"{spreads:.0f} times the spread of the other values away from the median (up to "
                f"{_MAX_SPREADS:g} times is plausible)"
            )
            yield f"{name} {number:g} ({place}) is {distance}"
