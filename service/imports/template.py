"""The documented headers: a table with them is its own mapping, without a robot (docs/import.md).

Headers are `label`, `target`, `state`, `J1 [deg]`, `P10 loaded x [mm]`, `P10 dx [mm]`, `P10 loaded U95 [mm]`,
`Fx [N]`, `Mx [N.m]` and `mass [kg]`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Final, Literal, NamedTuple, cast, get_args

from jointstiff.schemas.imports import ColumnUnit, Doubt, Mapping, Role, RoleName, State, TableMapping
from jointstiff.service.imports.mapping import name_columns
from jointstiff.service.imports.tables import Column, Table, group_forms

_HEADER: Final = re.compile(r"(?P<name>[^\[(]*?)\s*(?:[\[(](?P<unit>[^\])]+)[\])])?")
_SPELLINGS: Final = {"°": "deg", "Nm": "N.m", "um": "µm", "μm": "µm"}
"""Other ways to write units."""
_STATES: Final = "|".join(
    state.replace("_", "[ _]") for state in sorted(get_args(State), key=len, reverse=True)
)
_PATTERNS: Final[tuple[tuple[RoleName, re.Pattern[str]], ...]] = (
    ("label", re.compile("label", re.IGNORECASE)),
    ("target", re.compile("target", re.IGNORECASE)),
    ("state", re.compile("state", re.IGNORECASE)),
    ("joints", re.compile(r"J(?P<number>\d+)", re.IGNORECASE)),
    ("force", re.compile(r"F(?P<axis>[xyz])", re.IGNORECASE)),
    ("moment", re.compile(r"M(?P<axis>[xyz])", re.IGNORECASE)),
    ("mass", re.compile("mass", re.IGNORECASE)),
    ("displacement", re.compile(r"(?:(?P<target>.+?)[ _])?d(?P<axis>[xyz])")),
    (
        "uncertainty",
        re.compile(rf"(?:(?P<target>.+?)[ _])?(?:(?P<state>{_STATES})[ _])?U95(?:[ _](?P<axis>[xyz]))?"),
    ),
    (
        "position",
        re.compile(rf"(?:(?:(?P<target>.+?)[ _])?(?P<state>{_STATES})[ _])?(?P<axis>[xyz])", re.IGNORECASE),
    ),
)
"""Role → form of the header without its unit."""
_VECTORS: Final = frozenset(("joints", "force", "moment", "displacement", "uncertainty", "position"))


class _Header(NamedTuple):
    """What a documented header says."""

    role: RoleName
    target: str | None
    state: State | None
    unit: ColumnUnit | None
    number: int  # of the joint; 0 for other roles
    axis: Literal["x", "y", "z"] | None

    @property
    def order(self) -> tuple[str, str, str, int, str]:
        """Order in which the columns of one role follow each other: by number or axis."""
        return self.role, self.target or "", self.state or "", self.number, self.axis or ""

    @property
    def is_complete(self) -> bool:
        """Return whether the header states the unit that its role needs."""
        return self.unit is not None or self.role in ("label", "target", "state")


def read_unit(header: str) -> ColumnUnit | None:
    """Return the unit that a header has in square or round brackets; None without one."""
    match = _HEADER.fullmatch(header.strip())
    text = match["unit"].strip() if match and match["unit"] else ""
    unit = _SPELLINGS.get(text, text)
    return cast("ColumnUnit", unit) if unit in get_args(ColumnUnit) else None


def _read_header(header: str) -> _Header | None:
    """Return what a documented header says; None for any other header."""
    match = _HEADER.fullmatch(header.strip())
    if match is None:
        return None
    for role, pattern in _PATTERNS:
        if found := pattern.fullmatch(match["name"]):
            parts = {"target": None, "state": None, "number": None, "axis": None} | found.groupdict()
            state = parts["state"]
            known = cast("State", state.lower().replace(" ", "_")) if state else None
            axis = cast('Literal["x", "y", "z"]', parts["axis"].lower()) if parts["axis"] else None
            number = int(parts["number"] or 0)
            return _Header(role, parts["target"], known, read_unit(header), number, axis)
    return None


def find_template(tables: Sequence[Table], stated: Mapping) -> Mapping | None:
    """Return the mapping of tables with documented headers; None if a table has others.

    Columns of other tables and headers are not read, which a person confirms.
    """
    parts, unread = [], []
    for group in group_forms(tables):
        columns = [column for column in group[0].columns if column.is_own]
        headers = [_read_header(column.header) for column in columns]
        known = [(column, header) for column, header in zip(columns, headers, strict=True) if header]
        roles = list(_list_roles(known))
        if any(not header.is_complete for _, header in known) or not any(
            role.role in _VECTORS for role in roles
        ):
            return None
        unread += [column for column, header in zip(columns, headers, strict=True) if header is None]
        parts.append(TableMapping(table=[table.name for table in group], roles=roles))
    roles_found = {role.role for part in parts for role in part.roles}
    if "joints" not in roles_found or not roles_found & {"position", "displacement"}:
        return None
    are_loaded = bool(roles_found & {"force", "mass"}) or stated.force is not None
    have_states = bool(roles_found & {"state", "mass", "displacement"}) or any(
        role.state for part in parts for role in part.roles
    )
    if are_loaded and not have_states:
        return None
    doubts = list(stated.doubts)
    if unread:
        listed = ", ".join(f"{column.id} ({column.header or 'no header'})" for column in unread)
        doubts.append(Doubt(about="columns", text=f"columns {listed} are not read: is this right?"))
    return stated.model_copy(update={"tables": parts, "doubts": doubts})


def _list_roles(known: Sequence[tuple[Column, _Header]]) -> Iterator[Role]:
    """Yield a role for each vector, and for each other column; joints in several units have several roles."""

    def describe(pair: tuple[Column, _Header]) -> tuple[object, ...]:
        """Return what the columns of one role have in common."""
        column, header = pair
        return header[:4] if header.role in _VECTORS else (column.id,)

    ordered = sorted(known, key=lambda pair: pair[1].order)
    for _, group in groupby(ordered, describe):
        pairs = list(group)
        _, header = pairs[0]
        yield Role(
            columns=name_columns([column.id for column, _ in pairs]),
            role=header.role,
            target=header.target,
            state=header.state,
            unit=header.unit,
            axis=header.axis if header.role in ("displacement", "force") and len(pairs) == 1 else None,
        )
