"""Data that the engine keeps in its tables: JSON, and never an object that would run code when it is read.

The engine pickles unless it is told otherwise, and reads what a row calls a pickle whatever serializer it was
given: who can write the database, or hands over a backup, could run code in the workers.
"""

from __future__ import annotations

import json
from typing import Any, Final, NoReturn

from dbos import Serializer
from dbos._serialization import DefaultSerializer

from jointstiff.service.problems.errors import FilesError
from jointstiff.solver.errors import JointstiffError

_RAISED: Final = "raised"


class EngineDataError(Exception):
    """Data of a step cannot be used, or a step failed unexpectedly."""


class _RestoredFilesError(FilesError):
    """Files that were not understood, as another process told of them."""

    def __init__(self, reason: str, *, remedy: str, where: str | None, items: list[list[str]]) -> None:
        super().__init__(reason, remedy=remedy, where=where)
        self._items = tuple((place, why, mend) for place, why, mend in items)

    @property
    def items(self) -> tuple[tuple[str, str, str], ...]:
        """Place, reason and remedy of each fault."""
        return self._items


class JsonSerializer(Serializer):
    """JSON values, and exceptions as data: the refusals of the numerical core come back as what they were."""

    def name(self) -> str:
        """Return the name that marks our rows."""
        return "jointstiff_json"

    def serialize(self, data: Any) -> str:  # noqa: ANN401 - whatever a step returns or raises
        """Return arguments, a result or an exception as JSON."""
        return json.dumps(_described(data) if isinstance(data, BaseException) else data, allow_nan=False)

    def deserialize(self, serialized_data: str) -> Any:  # noqa: ANN401
        """Return what `serialize` was given; an exception as one to raise."""
        data = json.loads(serialized_data)
        return _restored(data[_RAISED]) if isinstance(data, dict) and _RAISED in data else data


def refuse_pickles() -> None:
    """Let the engine read no pickle in this process; it has no setting for it."""
    DefaultSerializer.deserialize = _refuse  # type: ignore[method-assign]


def _refuse(cls: DefaultSerializer, serialized_data: str) -> NoReturn:  # noqa: ARG001 - the engine's names
    raise EngineDataError("the engine's tables have a pickled object, which is not read")


def _described(error: BaseException) -> dict[str, dict[str, Any]]:
    described: dict[str, Any]
    if isinstance(error, JointstiffError):
        described = {"reason": error.reason, "remedy": error.remedy, "where": error.where}
        if isinstance(error, FilesError):  # of a class with a constructor of its own
            described["items"] = error.items
    else:
        described = {"reason": f"{type(error).__name__}: {error}"}
    return {_RAISED: {"kind": type(error).__name__, **described}}


def _restored(described: dict[str, Any]) -> Exception:
    if "items" in described:
        return _RestoredFilesError(
            **{name: described[name] for name in ("reason", "remedy", "where", "items")}
        )
    kind = _refusals().get(described["kind"])
    if kind is None or "remedy" not in described:
        return EngineDataError(described["reason"])
    return kind(described["reason"], remedy=described["remedy"], where=described["where"])


def _refusals() -> dict[str, type[JointstiffError]]:
    classes: dict[str, type[JointstiffError]] = {}
    waiting = [JointstiffError]
    while waiting:
        kind = waiting.pop()
        classes[kind.__name__] = kind
        waiting += kind.__subclasses__()
    return classes
