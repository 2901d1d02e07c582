"""Tables of numbers of files, with their rows in one order, for the robot to find their meaning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.errors import NOWHERE, ImportFileError
from jointstiff.service.importing.grammar import Vocabulary
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.proposals.columns.stated import refuse_unknown_headers
from jointstiff.service.proposals.names.joining import join_tables
from jointstiff.service.proposals.no_proposal import NoProposalError, UnreadError
from jointstiff.service.proposals.tables.deflections import add_deflections
from jointstiff.service.proposals.tables.lengths import unify_lengths
from jointstiff.service.proposals.tables.numbers import (
    GridReader,
    NumberFiles,
    NumberTable,
    read_number_tables,
)
from jointstiff.service.proposals.tables.relations import join_relations
from jointstiff.service.proposals.tables.repeated_columns import average_repeats
from jointstiff.service.proposals.tables.runs import stack_runs
from jointstiff.service.proposals.unread import advise_on_files_without_rows, find_remarks


class JoinedTables(NamedTuple):
    """Tables of numbers with their rows in one order."""

    tables: Sequence[NumberTable]
    notes: Sequence[str]  # what a person should know of the rows
    masses: tuple[SourceFile, ...]  # files with the masses of the robot's bodies
    files: NumberFiles  # as they were read
    separate: Sequence[NumberTable]  # with their rows in the order of the files


def read_numbers(
    files: Sequence[SourceFile], request: ImportRequest, joints: Sequence[str], read: GridReader
) -> JoinedTables:
    """Return the tables of numbers of the files with their rows in one order.

    `joints` are names of joints, and `read` reads a file as tables.

    Raises:
        NoProposalError: a file cannot be read or has no rows of numbers, or names of rows or headers do not
            fit.
    """
    try:
        found = read_number_tables(files, request, joints, read)
    except ImportFileError as fault:
        is_settled_by_option = fault.option is not None
        kind = UnreadError if fault.is_of_document or fault.option == "sheet" else NoProposalError
        if is_settled_by_option:
            raise kind(str(fault), fault=fault) from fault
        raise describe_fault(fault, kind) from fault
    if not found.tables:
        raise UnreadError("the files have no rows of numbers")
    remarks = find_remarks(files, found.without)
    unread = [name for name in found.without if name not in remarks]
    if unread:
        reason = f"{', '.join(unread)} has no rows of numbers"
        raise UnreadError(reason, advise_on_files_without_rows(files, unread))
    left_out = [f"{name} has no rows of numbers, and was left out" for name in remarks]
    found = replace(found, notes=(*found.notes, *left_out))
    try:
        refuse_unknown_headers(found.tables, request)
    except ImportFileError as fault:
        raise describe_fault(fault) from fault
    return join_numbers(found, unify_lengths(found.tables), request, joints)


def join_numbers(
    found: NumberFiles, tables: Sequence[NumberTable], request: ImportRequest, joints: Sequence[str]
) -> JoinedTables:
    """Return tables of files with their rows in one order; `joints` are names of joints.

    Raises:
        NoProposalError: names of rows or headers do not fit.
    """
    try:
        stacked, notes_on_runs = stack_runs(tables)
        related = join_relations(stacked)
        joined = join_tables(related.tables, request)
        averaged, notes_on_repeats = average_repeats(joined.tables)
        arranged, notes = add_deflections(averaged, Vocabulary(request, joints))
    except ImportFileError as fault:
        raise describe_fault(fault) from fault
    notes = [*found.notes, *notes_on_runs, *related.notes, *joined.notes, *notes_on_repeats, *notes]
    return JoinedTables(arranged, notes, found.masses, found, related.tables)


def describe_fault(fault: ImportFileError, kind: type[NoProposalError] = NoProposalError) -> NoProposalError:
    """Return the error, of a kind, that a fault of files, at its place, forbids a proposal."""
    place = "" if fault.place == NOWHERE else f"{fault.place}: "
    return kind(f"{place}{fault.reason}", fault.remedy, fault)
