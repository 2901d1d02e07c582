"""Proposals that a person cannot accept: statements of the caller or numbers of the files contradict them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from itertools import combinations
from typing import Final

import numpy as np

from jointstiff.service.importing.errors import quote
from jointstiff.service.proposals.columns.stated import find_contradiction
from jointstiff.service.proposals.names.naming import NamedReading, are_distinct
from jointstiff.service.proposals.no_proposal import NoProposalError
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.meaning.proposal import Proposal
from jointstiff.solver.meaning.words import describe

_LEAST_BETWEEN_TARGETS: Final = 1e-3
"""Least distance [m] of two targets: a smaller one cannot be mounted."""
_NUMBER: Final = re.compile(r"\d{1,9}")


def refuse_counted_targets_at_one_place(proposal: Proposal, named: Sequence[NamedReading]) -> None:
    """Refuse targets such as `step 1` and `step 2` whose positions are too near each other for two targets.

    Raises:
        NoProposalError: there are such positions: they are repeats, or readings under several loads.
    """
    for first, second in combinations(named, 2):
        forms = {_NUMBER.sub("0", each.target) for each in (first, second)}
        are_counted = len(forms) == 1 and first.target != second.target
        has_word = any(map(str.isalpha, first.target))
        if first.state != second.state or not are_counted or not has_word:
            continue
        apart = np.linalg.norm(first.reading.positions - second.reading.positions, axis=1)
        known = apart[np.isfinite(apart)]
        if known.size and np.median(known) < _LEAST_BETWEEN_TARGETS:
            found = describe(proposal, [each.words for each in named])
            names = f"{quote(first.target)} and {quote(second.target)}"
            raise NoProposalError(
                f"{found}, but the positions of {names} are {1e3 * np.median(known):.2g} mm apart: they are "
                "repeats or readings under several loads, and no targets",
                "state the load of each position in its header, such as `50 kg`; or write a row for each of "
                "them, with its state or load in a column",
            )


def refuse_damaged_numbers(proposal: Proposal, tables: Sequence[NumberTable]) -> None:
    """Refuse a coordinate with digits that are no number: only an empty cell, or one with words, is missing.

    Raises:
        NoProposalError: a cell of a position has such digits.
    """
    for table in tables:
        columns = {
            column
            for reading in proposal.readings
            if reading.points.table == table.name
            for column in reading.points.columns
        }
        is_unread = np.isnan(table.table.numbers)
        for number, row in enumerate(table.rows):
            for column in sorted(columns):
                text = row.cells[column]
                if is_unread[number, column] and any(map(str.isdigit, text)):
                    place = table.grid.place(row, column)
                    raise NoProposalError(f"{place}: {quote(text)} is no number", "correct the cell")


def refuse_contradiction(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable]
) -> None:
    """Refuse a proposal that contradicts what the caller states of columns.

    Raises:
        NoProposalError: a stated column has another meaning, or is not read.
    """
    contradiction = find_contradiction(proposal, named, tables)
    if contradiction:
        remedy = "correct `columns`, or leave the statement out"
        raise NoProposalError(contradiction, remedy)


def refuse_repeats_without_names(proposal: Proposal, named: Sequence[NamedReading]) -> None:
    """Refuse repeated readings of a target in one state, if the order gives some of them this state.

    Raises:
        NoProposalError: there are such positions: the order of repeats tells no state.
    """
    if are_distinct(named) or not any(each.is_by_order for each in named):
        return
    most = max(Counter(each.target for each in named).items(), key=lambda item: item[1])
    raise NoProposalError(
        f"{describe(proposal, [each.words for each in named])} by their order, but {most[0]} has {most[1]} "
        "positions in a posture, and no names of postures and states tell which of them are repeats",
        "name the posture of each row in a column with the header `label`, and state or load in another one",
    )
