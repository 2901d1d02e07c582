"""Bridges from trackers to the pages that show open sets.

A page opens a bridge and shows its code; a command at the tracker's computer joins with the code, once. Then
the page says in which posture and under which load it wants positions, and the command sends positions. No
position becomes a reading here: the page shows the positions, and a person sends the reading.
"""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Final
from uuid import uuid4

from jointstiff.schemas.bridge import Bridge, BridgePoints, BridgeStand, BridgeState, BridgeTask
from jointstiff.service.problems import NotFoundError, Resource
from jointstiff.service.store.bridges import BRIDGE_LASTS, CODE_LASTS
from jointstiff.service.store.collection import MEASUREMENT_SET
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import AccessKey, BridgeRecord

BRIDGE: Final = Resource("bridge", "bridges")
_LETTERS: Final = "23456789ABCDEFGHJKMNPQRSTUVWXYZ"
"""Characters of codes, without those that people confuse: 0 and O, 1, I and L."""
_CODE_LENGTH: Final = 8
"""Number of characters of a code: 31⁸ = 8.5e11 codes."""
_SILENT: Final = timedelta(seconds=10)
"""Time without a message after which the command of a bridge counts as gone."""


class TrackerBridges:
    """The bridges of a store."""

    def __init__(self, store: Store, is_open: Callable[[str], bool]) -> None:
        """Serve the bridges of a store; `is_open` returns whether an id is that of an open set."""
        self._bridges, self._is_open = store.bridges, is_open

    def open(self, set_id: str, key: AccessKey | None) -> Bridge:
        """Open a bridge to the page of an open set; return the bridge with its code.

        Raises:
            NotFoundError: there is no such open set.
        """
        if not self._is_open(set_id):
            raise NotFoundError(MEASUREMENT_SET, set_id)
        code, now = "".join(secrets.choice(_LETTERS) for _ in range(_CODE_LENGTH)), datetime.now(UTC)
        record = BridgeRecord(
            id=uuid4().hex,
            set_id=set_id,
            page_key=_id_of(key),
            command_key=None,
            code_hash=_hash(code),
            created_at=now,
            stand=None,
            reading=None,
            heard_at=None,
        )
        self._bridges.add(record)
        shown = f"{code[: _CODE_LENGTH // 2]}-{code[_CODE_LENGTH // 2 :]}"
        return Bridge(id=record.id, set_id=set_id, code=shown, ends_at=now + CODE_LASTS)

    def join(self, code: str, key: AccessKey | None) -> Bridge | None:
        """Let a command join the bridge with a code; return the bridge, None for an invalid code.

        Letters of either case, blanks and hyphens are accepted.
        """
        typed = "".join(character for character in code.upper() if character.isalnum())
        now = datetime.now(UTC)
        bridge_id = self._bridges.join(_hash(typed), _id_of(key), now)
        record = None if bridge_id is None else self._bridges.find(bridge_id, now)
        if record is None:
            return None
        return Bridge(id=record.id, set_id=record.set_id, ends_at=record.created_at + BRIDGE_LASTS)

    def show_stand(self, bridge_id: str, stand: BridgeStand, key: AccessKey | None) -> None:
        """Store the stand that the page shows.

        Raises:
            NotFoundError: there is no such bridge, or another key opened it.
        """
        self._find_of_page(bridge_id, key)
        self._bridges.put_stand(bridge_id, stand.model_dump_json())

    def state(self, bridge_id: str, key: AccessKey | None) -> BridgeState:
        """Return the state of a bridge for the page.

        Raises:
            NotFoundError: there is no such bridge, or another key opened it.
        """
        record = self._find_of_page(bridge_id, key)
        heard = record.heard_at is not None and datetime.now(UTC) - record.heard_at < _SILENT
        reading = (
            BridgePoints() if record.reading is None else BridgePoints.model_validate_json(record.reading)
        )
        return BridgeState(joined=record.command_key is not None, connected=heard, reading=reading)

    def send_points(self, bridge_id: str, reading: BridgePoints, key: AccessKey | None) -> BridgeTask:
        """Store the last positions of a tracker; return the stand in which the command reads next.

        Raises:
            NotFoundError: there is no such bridge, a command with another key joined it, or its set was
                closed.
        """
        record = self._bridges.find(bridge_id, datetime.now(UTC))
        if record is None or record.command_key != _id_of(key) or not self._is_open(record.set_id):
            raise NotFoundError(BRIDGE, bridge_id)
        self._bridges.put_reading(bridge_id, reading.model_dump_json(), datetime.now(UTC))
        stand = None if record.stand is None else BridgeStand.model_validate_json(record.stand)
        return BridgeTask(stand=stand)

    def close(self, bridge_id: str, key: AccessKey | None) -> None:
        """End a bridge.

        Raises:
            NotFoundError: there is no such bridge, or another key opened it.
        """
        self._find_of_page(bridge_id, key)
        self._bridges.remove(bridge_id)

    def _find_of_page(self, bridge_id: str, key: AccessKey | None) -> BridgeRecord:
        """Return a bridge of the page that has a key; raise `NotFoundError` for any other bridge."""
        record = self._bridges.find(bridge_id, datetime.now(UTC))
        if record is None or record.page_key != _id_of(key):
            raise NotFoundError(BRIDGE, bridge_id)
        return record


def _id_of(key: AccessKey | None) -> str:
    """Return the id of a key; an empty text if the service requires no keys."""
    return "" if key is None else key.id


def _hash(code: str) -> str:
    """Return the SHA-256 of a code in hexadecimal; the database has only this hash."""
    return hashlib.sha256(code.encode()).hexdigest()
