"""Keys as a table for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from rich.table import Table
from rich.text import Text

from jointstiff.schemas.access import Key


def keys_table(keys: Sequence[Key], now: datetime) -> Table:
    """Return a table of keys, times in UTC."""
    table = Table("id", "name", "role", "state", "made", "last used", title="Keys, times in UTC")
    for key in keys:
        cells = (key.id, key.name, key.role, _state(key, now), _time(key.created_at), _time(key.last_used_at))
        table.add_row(*(Text(cell) for cell in cells))
    return table


def _state(key: Key, now: datetime) -> str:
    if key.revoked_at is not None:
        return f"revoked {_time(key.revoked_at)}"
    if key.expires_at is None:
        return "valid"
    return f"{'valid until' if now < key.expires_at else 'expired'} {_time(key.expires_at)}"


def _time(time: datetime | None) -> str:
    return "—" if time is None else f"{time:%Y-%m-%d %H:%M}"
