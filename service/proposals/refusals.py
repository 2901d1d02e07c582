"""Proposals that a person cannot accept: statements of the caller or numbers of the files contradict them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from jointstiff.service.importing.errors import quote
from jointstiff.service.proposals.columns.stated import find_contradiction
from jointstiff.service.proposals.names.naming import NamedReading, are_distinct
from jointstiff.service.proposals.no_proposal import NoProposalError
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.meaning.proposal import Proposal
from jointstiff.solver.meaning.words import describe


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
