"""The documented headers: a table with them is its own mapping, without a robot (docs/import.md).

Headers are `label`, `target`, `state`, `J1 [deg]`, `P10 loaded x [mm]`, `P10 dx [mm]`, `P10 along x [mm]`,
`P10 loaded U95 [mm]`, `Fx [N]`, `Mx [N.m]` and `mass [kg]`. A plan's list also has `load point x [mm]`.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Final, Literal, NamedTuple, cast, get_args

from jointstiff.schemas.fields import Vector3
from jointstiff.schemas.imports import (
    UNITS_OF_ROLE,
    ColumnUnit,
    Doubt,
    Mapping,
    Role,
    RoleName,
    State,
    TableMapping,
)
from jointstiff.service.imports.mapping import list_columns, name_columns, name_tables
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
    ("ignore", re.compile("anchor|remark", re.IGNORECASE)),  # columns of a plan's list
    ("joints", re.compile(r"(?:J|joint_)(?P<number>\d+)", re.IGNORECASE)),
    ("force", re.compile(r"F(?P<axis>[xyz])", re.IGNORECASE)),
    ("moment", re.compile(r"M(?P<axis>[xyz])", re.IGNORECASE)),
    ("mass", re.compile("mass", re.IGNORECASE)),
    ("displacement", re.compile(r"(?:(?P<target>.+?)[ _])?(?:d|along )(?P<axis>[xyz])")),
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
_LOAD_POINT: Final = tuple(f"load point {axis} [mm]" for axis in "xyz")
_VECTORS: Final = frozenset(("joints", "force", "moment", "displacement", "uncertainty", "position"))


class _Header(NamedTuple):
    """Meaning of a documented header."""

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
        """Return whether the header states a unit of its role, if the role needs a unit."""
        units = UNITS_OF_ROLE.get(self.role)
        return self.unit is None if units is None else self.unit in units


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
        load_point = _find_load_point(columns)
        if load_point is not None:
            stated = stated.model_copy(update={"load_point": stated.load_point or load_point})
            columns = [column for column in columns if column.header not in _LOAD_POINT]
        headers = [_read_header(column.header) for column in columns]
        known = [(column, header) for column, header in zip(columns, headers, strict=True) if header]
        if not _are_complete([header for _, header in known]):
            return None
        places = [column.id for column in columns]
        roles = sorted(_list_roles(known), key=lambda role: places.index(list_columns(role)[0]))
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
    return stated.model_copy(update={"tables": name_tables(parts, len(tables)), "doubts": doubts})


def _are_complete(headers: Sequence[_Header]) -> bool:
    """Return whether headers have their units, each only once, joints from 1, and no vector lacks an axis."""
    vectors = [header for header in headers if header.role in _VECTORS]
    joints = sorted(header.number for header in headers if header.role == "joints")
    axes_of: dict[tuple[object, ...], set[str | None]] = defaultdict(set)
    for header in vectors:
        if header.role in ("position", "moment"):
            axes_of[header.role, header.target, header.state].add(header.axis)
    return (
        bool(vectors)
        and len({header[:3] + header[4:] for header in headers}) == len(headers)
        and all(header.is_complete for header in headers)
        and joints == list(range(1, len(joints) + 1))
        and all(len(axes) == len("xyz") for axes in axes_of.values())
    )


def _find_load_point(columns: Sequence[Column]) -> Vector3 | None:
    """Return the load point [mm] that a plan's list has in each row; None for other columns."""
    found = {column.header: set(column.cells) for column in columns if column.header in _LOAD_POINT}
    if len(found) < len(_LOAD_POINT) or any(len(numbers) > 1 for numbers in found.values()):
        return None
    x, y, z = (found[header].pop() for header in _LOAD_POINT)
    return cast("Vector3", (x, y, z))


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
