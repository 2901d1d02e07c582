"""Listings of a table: the database searches, sorts and counts the rows, and cuts them into pages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Any, Final, NamedTuple

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
_HASH_DIGITS: Final = 8
"""Hexadecimal digits of the hash of a list, by which a cursor of another list is noticed."""
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
    # what is listed besides the table: names and values of filters, in any order
    filters: tuple[tuple[str, object], ...] = ()

    def stamp_of(self, table: sa.Table) -> str:
        """Return the first part of a table's cursors in this order: the order, and a hash of the list."""
        listed = (table.name, self.q, sorted((name, str(value)) for name, value in self.filters))
        return f"{self.sort}:{sha256(repr(listed).encode()).hexdigest()[:_HASH_DIGITS]}"

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
    listing = _Listing(database, table, order, where)
    is_counted = order.counted and order.cursor is None
    total = None
    on_page = table.c.sequence.in_(listing.page_query)
    if is_counted and order.q is not None:
        # A search reads the whole index: one query serves the page and the count at once.
        found = listing.find_sequences(MOST_COUNTED + 1)
        total = len(found)
        on_page = table.c.sequence.in_(found[: order.limit + 1])
    read = listing.read_rows(rows, on_page)
    is_last = len(read) <= order.limit
    if is_counted and total is None:
        total = len(read)
        if not is_last:  # only the rows after those read must be counted
            total += listing.count_after(read[-1].place, max(0, MOST_COUNTED + 1 - total))
    records = tuple(record(**row.values) for row in read[: order.limit])
    next_cursor = None if is_last else write_cursor(order.stamp_of(table), read[order.limit - 1].place[-1])
    return RecordPage(records, next_cursor, total)


class _ReadRow(NamedTuple):
    """A row of a page."""

    values: dict[str, Any]  # column → value
    place: tuple[Any, ...]  # values of the columns of the order; the last one is `sequence`


class _Listing:
    """Queries of one listing: of the rows of a table that meet conditions, in an order."""

    def __init__(
        self,
        database: Database,
        table: sa.Table,
        order: Order,
        where: Iterable[sa.ColumnElement[bool]],
    ) -> None:
        """Build the query of the page, which finds the sequence numbers of its rows.

        Raises:
            CursorError: no page gave the cursor of the order.
        """
        self._database, self._table, self._order = database, table, order
        self._conditions = [*where]
        if order.q is not None:
            self._conditions += _search_conditions(database, table.c.words, order.q)
        self._sorted_by = order.columns_of(table)
        self._sorting = [column.desc() if order.is_descending else column for column in self._sorted_by]
        query = sa.select(table.c.sequence).where(*self._conditions)
        if order.cursor is not None:
            last_of_page_before = _values_at_cursor(database, table, order)
            query = query.where(_after_record(order, self._sorted_by, last_of_page_before))
        # One row more than the limit shows whether another page follows.
        limit = sa.bindparam("limit", order.limit + 1, type_=sa.Integer)
        self.page_query = query.order_by(*self._sorting).limit(limit)

    def find_sequences(self, limit: int) -> list[int]:
        """Return the sequence numbers of at most `limit` rows, in the order of the listing."""
        return [row.sequence for row in self._database.rows(self.page_query, {"limit": limit})]

    def read_rows(self, rows: sa.Select[Any], on_page: sa.ColumnElement[bool]) -> list[_ReadRow]:
        """Return the rows of a query that meet the condition of the page, each with its place in the order.

        The columns of the order are read with each row, to count the rows after the page and to make the
        next cursor.
        """
        order_columns = [column.label(f"place_{number}") for number, column in enumerate(self._sorted_by)]
        query = rows.add_columns(*order_columns).where(on_page).order_by(*self._sorting)
        read = list[_ReadRow]()
        for row in self._database.rows(query):
            values = dict(row._mapping)
            place = tuple(values.pop(column.name) for column in order_columns)
            read.append(_ReadRow(values, place))
        return read

    def count_after(self, place: tuple[Any, ...], most: int) -> int:
        """Return the number of rows after a place in the order; counting stops at `most`."""
        # With `sequence` itself SQLite would read whole rows; with a sum it uses the index.
        index_columns = [*self._sorted_by[:-1], self._table.c.sequence + 0]
        is_after = _after_record(self._order, index_columns, place)
        rows_after = sa.select(sa.literal(1)).select_from(self._table).where(*self._conditions, is_after)
        counted_rows = rows_after.limit(most).subquery()
        return int(self._database.rows(sa.select(sa.func.count()).select_from(counted_rows))[0][0])


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
    sequence = parse_cursor(cursor, order.stamp_of(table))
    *first, _ = order.columns_of(table)
    if not first:
        return (sequence,)
    for row in database.rows(sa.select(*first).where(table.c.sequence == sequence)):
        return (*row, sequence)
    raise problems.CursorError(cursor)


def write_cursor(stamp: str, sequence: int) -> str:
    """Return the cursor of the page after a record; it is no number that a program may take for a page's."""
    return f"{stamp}:{sequence}"


def parse_cursor(cursor: str, stamp: str) -> int:
    """Return the sequence number in the cursor of a page of the list with a stamp.

    Raises:
        CursorError: no page of this list gave this cursor.
    """
    stated_stamp, _, digits = cursor.rpartition(":")
    is_number = digits.isascii() and digits.isdecimal() and len(digits) <= len(str(LAST_SEQUENCE))
    if stated_stamp == stamp and is_number:
        sequence = int(digits)
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
