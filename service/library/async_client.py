"""The client for programs that await: each call is one of `Client`, in a thread."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from typing import TYPE_CHECKING, Any, TypeVar

from jointstiff.service.kinds.rooms import ROOMS
from jointstiff.service.library.client import Client, Collection

if TYPE_CHECKING:
    from jointstiff.service.library.typed import AsyncVerbs
else:
    AsyncVerbs = object

Value = TypeVar("Value")


class AsyncClient(AsyncVerbs):
    """A service whose verbs and collections are awaited: `run = await client.identify("campaign.json")`.

    Its arguments and methods are those of `Client`; `list` of a collection is iterated by `async for`. Where
    a task is cancelled while it awaits a verb, the job is cancelled in the service, too. `on_progress` is
    called in another thread. What a result does over the network, such as a report, is awaited by
    `client.call(run.report, "report.pdf")`.
    """

    def __init__(self, url: str, key: str | None = None, **options: Any) -> None:  # noqa: ANN401 - of Client
        """Make a client; arguments as of `Client`."""
        self._client = Client(url, key, **options)

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(self, *_: object) -> None:
        self._client.close()

    async def call(
        self,
        function: Callable[..., Value],
        *arguments: Any,  # noqa: ANN401 - of the function
        **options: Any,  # noqa: ANN401 - of the function
    ) -> Value:
        """Await a function that works over the network."""
        return await asyncio.to_thread(function, *arguments, **options)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - of Client
        """Return a method or a collection of the client, to be awaited."""
        value = getattr(self._client, name)
        if isinstance(value, Collection):
            return _AsyncCollection(value)
        stepped = any(room.command == name for room in ROOMS.values())
        return _awaited(value, stepped=stepped) if callable(value) else value


class _AsyncCollection:
    """Resources of one kind, whose methods are awaited."""

    def __init__(self, collection: Collection[Any, Any]) -> None:
        self._collection = collection

    async def list(self, **filters: str) -> AsyncIterator[Any]:
        """Yield summaries of the resources, newest first."""
        summaries, end = self._collection.list(**filters), object()
        while (summary := await asyncio.to_thread(next, summaries, end)) is not end:
            yield summary

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - of the collection
        return _awaited(getattr(self._collection, name), stepped=False)


def _awaited(function: Callable[..., Any], *, stepped: bool) -> Callable[..., Any]:
    """Return a function that is awaited; one that takes steps ends if its task is cancelled."""

    async def call(*arguments: Any, **options: Any) -> Any:  # noqa: ANN401 - of the function
        ended = threading.Event()
        if stepped:
            options.setdefault("cancel", ended.is_set)
        try:
            return await asyncio.to_thread(function, *arguments, **options)
        except asyncio.CancelledError:
            ended.set()
            raise

    call.__name__, call.__doc__ = getattr(function, "__name__", "call"), function.__doc__
    return call
