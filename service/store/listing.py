"""Listings of a table: the database searches, sorts and counts the rows, and cuts them into pages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import sqlalchemy as sa

from jointstiff.schemas.fields import MOST_COUNTED
from jointstiff.service import problems
from jointstiff.service.store.database import Database
from jointstiff.service.store.tables import RecordPage, Row

LAST_SEQUENCE: Final = 2**63 - 1
_MAX_INDEXED: Final = 500
"""Greatest length of an indexed text [characters]: PostgreSQL allows 2704 bytes, schemas 200 characters."""
_MAX_WORD: Final = 150  # searched characters of a name
_MAX_WORDS: Final = 2_400  # bytes of all searched names of a row, which must fit into an index
_SEPARATOR: Final = "\x1f"  # between two names; no name has it


@dataclass(frozen=True, slots=True)
class Order:
    """Order, limit and search of a listing."""

    limit: int  # greatest number of records, one or more
    cursor: str | None = None  # `next` of the page before; None for the first page
    q: str | None = None  # words to search, each a part of a name; None for no search
    # `created_at` or `name`, in descending order with a minus in front; or `worst`, by `rank`
    sort: str = "-created_at"
    # True to count the records of all pages to `MOST_COUNTED` and one, which is done with the first page
    counted: bool = False
    rank: sa.ColumnElement[Any] | None = None  # number of a row for the order `worst`, never null

    @property
    def is_descending(self) -> bool:
        """True if the order is descending."""
        return self.sort.startswith("-") or self.sort == "worst"

    def columns_of(self, table: sa.Table) -> list[sa.ColumnElement[Any]]:
        """Return the columns by which a table is ordered, first of all those before `sequence`."""
        if self.sort == "worst" and self.rank is not None:
            return [self.rank, table.c.sequence]
        return [table.c.words, table.c.sequence] if self.is_by_name else [table.c.sequence]

    @property
    def is_by_name(self) -> bool:
        """True if records are sorted by their names, not by time."""
        return self.sort.removeprefix("-") == "name"


def read_page(
    database: Database,
    table: sa.Table,
    rows: sa.Select[Any],
    record: type[Row],
    where: Iterable[sa.ColumnElement[bool]],
    order: Order,
) -> RecordPage[Row]:
    """Return one page of a table. Records that are added later do not shift the next page.

    A subquery finds the page from columns of an index alone; then only the rows of the page are read.

    Args:
        database: database of the table.
        table: table with a column `sequence`, and `words` if it can be searched or sorted by name.
        rows: query of the columns to return.
        record: dataclass for the rows that `rows` returns.
        where: conditions that all records must meet.
        order: order, search and limit of the listing.

    Raises:
        CursorError: no page gave this cursor.
    """
    sequence, conditions = table.c.sequence, [*where]
    if order.q is not None:
        conditions += _search_conditions(database, table.c.words, order.q)
    sorted_by = order.columns_of(table)
    page_query = sa.select(sequence).where(*conditions)
    if order.cursor is not None:
        page_query = page_query.where(
            _after_record(order, sorted_by, _values_at_cursor(database, table, order))
        )
    sorting = [column.desc() if order.is_descending else column for column in sorted_by]
    is_counted = order.counted and order.cursor is None
    # One row more than the limit shows whether another page follows.
    page_query = page_query.order_by(*sorting).limit(sa.bindparam("limit", order.limit + 1, type_=sa.Integer))
    on_page = sequence.in_(page_query)
    total = None
    if is_counted and order.q is not None:
        # A search reads the whole index: this query serves the page and the count at once.
        found = database.rows(page_query, {"limit": MOST_COUNTED + 1})
        total = len(found)
        on_page = sequence.in_([row.sequence for row in found[: order.limit + 1]])
    # The columns of the order are read with each row, to count the rows after the page and to make the next
    # cursor.
    order_columns = [column.label(f"place_{number}") for number, column in enumerate(sorted_by)]
    query = rows.add_columns(*order_columns).where(on_page).order_by(*sorting)
    rows_read = [dict(row._mapping) for row in database.rows(query)]
    order_values = [tuple(row.pop(place.name) for place in order_columns) for row in rows_read]
    is_last = len(rows_read) <= order.limit
    if is_counted and total is None:
        total = len(rows_read)
        if not is_last:  # only the rows after those read must be counted
            # With `sequence` itself SQLite would read whole rows; with a sum it uses the index.
            index_columns = [*sorted_by[:-1], sequence + 0]
            is_after = _after_record(order, index_columns, order_values[-1])
            rows_after = sa.select(sa.literal(1)).select_from(table).where(*conditions, is_after)
            counted_rows = rows_after.limit(max(0, MOST_COUNTED + 1 - total)).subquery()
            total += int(database.rows(sa.select(sa.func.count()).select_from(counted_rows))[0][0])
    records = tuple(record(**row) for row in rows_read[: order.limit])
    return RecordPage(records, None if is_last else str(order_values[order.limit - 1][-1]), total)


def _search_conditions(database: Database, words: sa.Column[Any], q: str) -> list[sa.ColumnElement[bool]]:
    """Return the conditions of a search for words; the longest word, usually the rarest, comes first."""
    find = sa.func.instr if database.dialect == "sqlite" else sa.func.strpos
    searched_words = sorted(set(_fold_case(q).split()), key=lambda word: (-len(word), word))
    return [find(words, word) > 0 for word in searched_words]


def make_search_text(*names: str | None) -> str:
    """Join names, with case folded, to a text for searches; the first name decides the order by name."""
    words = _SEPARATOR.join(_fold_case(name or "")[:_MAX_WORD] for name in names)
    return words.encode()[:_MAX_WORDS].decode(errors="ignore")


def _fold_case(text: str) -> str:
    return text.casefold()


def _after_record(
    order: Order, sorted_by: Sequence[sa.ColumnElement[Any]], last_values: tuple[object, ...]
) -> sa.ColumnElement[bool]:
    """Return the condition of the records after the one with `last_values` in the columns `sorted_by`."""
    columns, values = sa.tuple_(*sorted_by), sa.tuple_(*last_values)
    return columns < values if order.is_descending else columns > values


def _values_at_cursor(database: Database, table: sa.Table, order: Order) -> tuple[object, ...]:
    """Return the values of the record at the cursor in the columns by which the listing is ordered."""
    cursor = order.cursor or ""
    sequence = parse_cursor(cursor)
    *first, _ = order.columns_of(table)
    if not first:
        return (sequence,)
    for row in database.rows(sa.select(*first).where(table.c.sequence == sequence)):
        return (*row, sequence)
    raise problems.CursorError(cursor)


def parse_cursor(cursor: str) -> int:
    """Return the sequence number that the cursor of a page holds.

    Raises:
        CursorError: no page gave this cursor.
    """
    if cursor.isascii() and cursor.isdecimal() and len(cursor) <= len(str(LAST_SEQUENCE)):
        sequence = int(cursor)
        if 0 < sequence <= LAST_SEQUENCE:
            return sequence
    raise problems.CursorError(cursor)


def is_indexable(text: str) -> bool:
    """Return whether both kinds of database can store a text in an index, as they store ids and names."""
    if len(text) > _MAX_INDEXED or "\x00" in text:
        return False
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True
