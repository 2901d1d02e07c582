"""A mapping applied to tables: which columns a role names, and the table that a part of the mapping reads."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase

from jointstiff.schemas.imports import Mapping, Role, RoleName, TableMapping
from jointstiff.service.conversion.units import COLUMN_UNITS
from jointstiff.service.imports.tables import Column, Table, TableError, letter, split_words, stack, transpose


def list_columns(role: Role) -> list[str]:
    """Return the ids of the columns of a role, such as B, C, D of `B:D` and D, C, B of `D:B`."""
    names = []
    for part in role.columns.split(","):
        first, mark, last = part.strip().partition(":")
        if not mark:
            names.append(first)
            continue
        start, end = _read_letter(first), _read_letter(last)
        step = 1 if end >= start else -1
        names += [letter(index) for index in range(start, end + step, step)]
    return names


def _read_letter(name: str) -> int:
    """Return the index of a column: A → 0, AA → 26.

    Raises:
        TableError: the text is no column.
    """
    name = name.strip().upper()
    if not 0 < len(name) <= 3 or not all("A" <= character <= "Z" for character in name):
        raise TableError(f"{name!r} is no column", where="columns", remedy="write columns such as B:G")
    number = 0
    for character in name:
        number = 26 * number + ord(character) - ord("A") + 1
    return number - 1


def name_columns(ids: Sequence[str]) -> str:
    """Return columns as `B:G` if they follow each other, else as `B,D,F`."""
    text = ",".join(ids)
    if len(ids) > 2 and all(name.isalpha() and name.isupper() for name in ids):
        columns = f"{ids[0]}:{ids[-1]}"
        if list_columns(Role(columns=columns, role="ignore")) == list(ids):
            return columns
    return text


def find_roles(mapping: TableMapping, *names: RoleName) -> list[Role]:
    """Return the roles of some kinds, in the order of the mapping."""
    return [role for role in mapping.roles if role.role in names]


def get_factor(role: Role) -> float:
    """Return the factor from the unit of a role to SI units; 1 without a unit."""
    return COLUMN_UNITS[role.unit] if role.unit else 1.0


def name_tables(parts: Sequence[TableMapping], table_count: int) -> list[TableMapping]:
    """Return parts of a mapping; a single part that reads all tables reads any name, as of the next day."""
    if len(parts) > 1 or any(len(part.table) < table_count for part in parts):
        return list(parts)
    return [part.model_copy(update={"table": ["*"]}) for part in parts]


def is_named(table: Table, mapping: TableMapping) -> bool:
    """Return whether a part of a mapping names a table."""
    return any(fnmatchcase(table.name, name) for name in mapping.table)


def choose_tables(tables: Sequence[Table], mapping: TableMapping) -> list[Table]:
    """Return the tables that a part of a mapping names.

    Raises:
        TableError: no table has such a name, or the tables differ in their columns.
    """
    chosen = [each for each in tables if is_named(each, mapping)]
    if not chosen:
        names = ", ".join(table.name for table in tables)
        raise TableError(f"no table is named {' or '.join(mapping.table)}", remedy=f"the tables are {names}")
    if len({each.form for each in chosen}) > 1:
        names = ", ".join(each.name for each in chosen)
        raise TableError(f"{names} have different columns", remedy="write a part of the mapping for each")
    return chosen


def read_table(tables: Sequence[Table], mapping: TableMapping) -> Table:
    """Return the table of a part of a mapping: stacked, turned, with the parts of words, and filled down.

    Raises:
        TableError: the mapping does not fit the tables.
    """
    chosen = choose_tables(tables, mapping)
    table = stack([transpose(each) for each in chosen] if mapping.transpose else chosen)
    parts: list[Column] = []
    for name, marks in mapping.split.items():
        parts += split_words(table.column(name), marks)
    table = table.with_columns(parts)
    if mapping.fill_down:
        filled = find_roles(mapping, "label", "joints", "force", "moment", "load", "mass", "target", "state")
        table = table.fill_down([name for role in filled for name in list_columns(role)])
    return table


def describe_role(role: Role) -> str:
    """Return a role in words, such as `T1 loaded [mm]`."""
    is_named = role.role == "position" and role.target
    words = [role.target or "", role.state or "", "" if is_named else role.role]
    unit = f"[{role.unit}]" if role.unit else ""
    return " ".join(filter(None, [*words, unit]))


def replace_role(mapping: Mapping, number: int, role: Role) -> Mapping:
    """Return a mapping in which the columns of a role have no other role in part `number` of the mapping."""
    names = set(list_columns(role))
    part = mapping.tables[number]
    others = [each for each in part.roles if not names & set(list_columns(each))]
    tables = list(mapping.tables)
    tables[number] = part.model_copy(update={"roles": [*others, role]})
    return mapping.model_copy(update={"tables": tables})


def exchange_states(mapping: Mapping) -> Mapping:
    """Return a mapping in which what was unloaded is loaded, and what was loaded is unloaded."""
    tables = []
    for part in mapping.tables:
        roles = [_exchange_role(role) for role in part.roles]
        cycle = [row.model_copy(update={"state": _exchange(row.state)}) for row in part.cycle]
        tables.append(part.model_copy(update={"roles": roles, "cycle": cycle}))
    return mapping.model_copy(update={"tables": tables})


def _exchange_role(role: Role) -> Role:
    words = {word: " ".join(_exchange_words(meaning)) for word, meaning in role.words.items()}
    return role.model_copy(update={"state": _exchange(role.state), "words": words})


def _exchange_words(meaning: str) -> Iterator[str]:
    for word in meaning.split(" "):
        yield _exchange(word) or ""


def _exchange(state: str | None) -> str | None:
    return {"unloaded": "loaded", "loaded": "unloaded"}.get(state or "", state)
