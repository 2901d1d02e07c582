"""An application of our own in this process, for tests that need no other database and no socket."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from support.in_process import Client

from jointstiff.service.store.store import Store


@pytest.fixture(scope="module")
def memory() -> Iterator[Store]:
    """A store in memory."""
    with Store.open("sqlite://") as store:
        yield store


@pytest.fixture(scope="module")
def local(memory: Store) -> Client:
    """A client of an application on it."""
    return Client(memory)
