"""Orders of the loads of observations that mistakes of bookkeeping make."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jointstiff.solver.arrays import IndexArray

_SHOWN_LABELS: Final = 4
"""Number of labels that a finding about their order names."""
_MOST_SHIFTED: Final = 3
"""Greatest shift of the loads against the readings that is searched, in rows."""


@dataclass(frozen=True, eq=False)
class OrderOfLoads:
    """An order of the loads that a mistake of bookkeeping makes, and how to undo it."""

    rows: IndexArray  # (N,) row of the load that belongs to each row
    cause: str
    remedy: str
    shift: int = 0  # number of rows by which the loads are shifted


def list_orders_of_loads(labels: Sequence[str]) -> list[OrderOfLoads]:
    """Return the orders of loads that mistakes of bookkeeping make: sorted labels, shifts, reverse order.

    An order that two mistakes make is listed once.
    """
    rows = np.arange(len(labels))
    orders = []
    by_text = _rank(list(labels))
    by_number = _rank([_split_at_numbers(label) for label in labels])
    for ranks, order in ((by_text, "as text"), (by_number, "by their numbers")):
        first = ", ".join(f"'{labels[i]}'" for i in np.argsort(ranks)[:_SHOWN_LABELS])
        orders.append(
            OrderOfLoads(
                ranks,
                f"the forces are in the order of the labels sorted {order} ({first}, …), but the readings "
                "are not",
                "match the forces with the observations by label, not by position: programs sort rows by "
                "their labels when they group rows (pandas keeps the order of the log with `sort=False`)",
            )
        )
    most = min(_MOST_SHIFTED, (len(rows) - 1) // 2)
    for shift in sorted(range(-most, most + 1), key=abs):
        count = "one row" if abs(shift) == 1 else f"{abs(shift)} rows"
        side = "after" if shift > 0 else "before"
        orders.append(
            OrderOfLoads(
                np.roll(rows, -shift),
                f"the forces are shifted by {count} against the readings",
                f"shift the forces by {count}: the force of each observation is {count} {side} its own row",
                abs(shift),
            )
        )
    orders.append(
        OrderOfLoads(rows[::-1], "the forces are in reverse order", "reverse the order of the forces")
    )
    by_rows = {tuple(order.rows.tolist()): order for order in reversed(orders)}
    del by_rows[tuple(rows.tolist())]  # as posted
    return list(by_rows.values())


def _rank(keys: Sequence[Any]) -> IndexArray:
    """Return the position (N,) of each of N keys after sorting; equal keys keep their order."""
    ranks = np.empty(len(keys), dtype=np.int_)
    ranks[sorted(range(len(keys)), key=keys.__getitem__)] = np.arange(len(keys))
    return ranks


def _split_at_numbers(label: str) -> list[tuple[int, str]]:
    """Split a label into texts and numbers, so that 'c2' is sorted before 'c10'."""
    parts = re.split(r"([0-9]+)", label)
    parts[1::2] = [number.lstrip("0") for number in parts[1::2]]
    return [(len(part) * (i % 2), part) for i, part in enumerate(parts)]
