"""An application of our own in this process, for tests that need no other database and no socket."""

from collections.abc import Iterator

import pytest
from support.in_process import Client

from jointstiff.service.jobs import Parts
from jointstiff.service.store.store import Store


@pytest.fixture
def store() -> Iterator[Store]:
    """A store in memory, for one test."""
    with Store.open("sqlite://") as opened:
        yield opened


@pytest.fixture(scope="module")
def memory() -> Iterator[Store]:
    """A store in memory."""
    with Store.open("sqlite://") as store:
        yield store


@pytest.fixture(scope="module")
def parts(memory: Store) -> Parts:
    """What is stored there and made of it, without an application."""
    return Parts(memory)


@pytest.fixture(scope="module")
def local(memory: Store) -> Client:
    """A client of an application on it."""
    return Client(memory)
