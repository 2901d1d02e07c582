"""Errors of the service, beside those of the numerical core; each says how to mend it.

ServiceError                   something outside of a request is in the way: see the remedy
├── ServerError                the service cannot start (service/server.py)
├── KeysFileError              a file of keys cannot be read or written (access/keys_file.py)
├── SettingsError              a laboratory's settings cannot be used (reports/laboratory.py)
└── StoreError                 a database that this software cannot work with
    ├── StoreUnavailableError  the database does not answer: try again, or look at the server
    ├── NotFoundError          no such record: check the id
    │   └── DeletedError       it was deleted: restore it
    ├── NotEndedError          a job that goes on cannot be deleted: cancel it first
    ├── ClosedError            a set that was closed takes no more readings: open another one
    ├── ReferencedError        others refer to what is to be deleted: delete those first
    ├── AuthorisedError        the report of a run that is to be deleted was authorised: keep it
    ├── WorkerLostError        the workers of a job died: send it again
    ├── QuotaError             the database has its full size: delete something, or raise --quota
    ├── TooManyJobsError       as many jobs wait as may: post again later
    ├── KeyRefusedError        no valid key came: send one
    │   └── WrongKeysError     too many wrong ones came: wait, then send the right one
    ├── RoleError              the key's role does not allow it: use another key
    ├── IdempotencyConflictError  a key used again for another body: take a new key
    └── CursorError            not a cursor that a page gave: start from the first page

RequestError of the numerical core
└── ItemsError                 a request with several faults
    ├── FilesError             files that were not understood: mend them
    └── VerdictError           a result that is not to be used: mend the readings, or accept its verdict
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from jointstiff.solver.errors import RequestError

_MAX_SHOWN = 80
_CHANGED = ("robots", "measurement-sets")
"""Collections that are no jobs, whose resources are changed at their own addresses."""


class Resource(NamedTuple):
    """A kind of resource."""

    name: str  # in messages
    collection: str  # name of all resources of this kind in addresses

    def change(self, identifier: str, change: str) -> str:
        """Return the request that changes one, for remedies; jobs of all kinds have one address."""
        collection = self.collection if self.collection in _CHANGED else "jobs"
        return f"PATCH /v1/{collection}/{identifier} {{{change}}}"


class ItemsError(RequestError):
    """A request with several faults, each with its place, reason and remedy."""

    def __init__(
        self, reason: str, *, remedy: str, where: str | None = None, items: Iterable[Sequence[str]] = ()
    ) -> None:
        super().__init__(reason, remedy=remedy, where=where)
        # place, reason and remedy of each fault, where several are known
        self.items = tuple((place, why, mend) for place, why, mend in items)


class FilesError(ItemsError):
    """Files that were not understood; `where` is file:line:column, as far as it is one place."""


class VerdictError(ItemsError):
    """A result is not to be used, and the request does not accept that."""

    @classmethod
    def of(cls, subject: str, where: str, items: Iterable[Sequence[str]]) -> VerdictError:
        """Return the refusal of a result, with the reasons of its verdict."""
        return cls(
            f"the verdict on {subject} is: do not use",
            where=where,
            remedy="follow the remedies of its reasons and identify again; to continue anyway, give "
            "`accept_verdict`: do_not_use (--despite-verdict in the terminal)",
            items=items,
        )


def _shown(text: str) -> str:
    """Text from outside, quoted, escaped and short enough for a message."""
    return repr(text if len(text) <= _MAX_SHOWN else text[:_MAX_SHOWN] + "…")


class ServiceError(Exception):
    """Something outside of a request is in the way."""

    def __init__(self, reason: str, remedy: str) -> None:
        super().__init__(f"{reason}: {remedy}")
        self.reason = reason  # what is wrong, in a sentence
        self.remedy = remedy  # how to mend it


class StoreError(ServiceError):
    """Base of the store's errors."""


class StoreUnavailableError(StoreError):
    """The database does not answer, or refuses what the store must do."""

    def __init__(self, reason: str, remedy: str, public_reason: str | None = None) -> None:
        super().__init__(reason, remedy)
        # The reason without names of hosts and users, for those who ask over the network
        self.public_reason = reason if public_reason is None else public_reason


class NotFoundError(StoreError):
    """There is no such record."""

    def __init__(self, kind: Resource, identifier: str) -> None:
        super().__init__(
            f"there is no {kind.name} {_shown(identifier)}",
            f"check the id; list them with GET /v1/{kind.collection}",
        )
        self.kind = kind  # The kind of resource that was looked for
        self.id = identifier  # The id that nothing has; text from outside, of any length


class DeletedError(NotFoundError):
    """The record was deleted, and has not been removed yet."""

    def __init__(self, kind: Resource, identifier: str) -> None:
        super().__init__(kind, identifier)
        self.reason = f"the {kind.name} {_shown(identifier)} was deleted"
        self.remedy = "restore it with " + kind.change(identifier, '"deleted": false')
        self.args = (f"{self.reason}: {self.remedy}",)


class NotEndedError(StoreError):
    """A job that has not ended cannot be deleted."""

    def __init__(self, kind: Resource, identifier: str) -> None:
        cancel = kind.change(identifier, '"cancelled": true')
        super().__init__(
            f"the {kind.name} {_shown(identifier)} has not finished",
            f"cancel it first with {cancel}, or wait until it has finished",
        )


class ClosedError(StoreError):
    """A measurement set that was closed takes no more readings."""

    def __init__(self, identifier: str) -> None:
        super().__init__(
            f"the measurement set {_shown(identifier)} is closed",
            "open another one; what was read stays in this one",
        )


class TakenError(StoreError):
    """An open set has another reading of that label."""

    def __init__(self, label: str) -> None:
        super().__init__(
            f"the set has another observation {_shown(label)}",
            "another device may have sent it: ask what is next, and send this one with a label of its own",
        )


class ReferencedError(StoreError):
    """A robot or measurement set that others refer to cannot be deleted."""

    def __init__(self, kind: Resource, identifier: str, users: Sequence[str], *, more: bool) -> None:
        super().__init__(
            f"the {kind.name} {_shown(identifier)} is used by {', '.join(users)}{', …' if more else ''}",
            "delete these first",
        )


class AuthorisedError(StoreError):
    """A run whose report was authorised cannot be deleted."""

    def __init__(self, identifier: str) -> None:
        super().__init__(
            f"a report on the run {_shown(identifier)} was authorised",
            "keep the run: the report refers to it",
        )


class WorkerLostError(StoreError):
    """The workers of a job died, or their engine gave it up."""

    def __init__(self, reason: str) -> None:
        super().__init__(
            reason,
            "send it again; if its workers end again, split it, give them more memory, or read their logs",
        )


class QuotaError(StoreError):
    """The database has reached the size that it may have."""

    def __init__(self, used: int, quota: int) -> None:
        super().__init__(
            f"the database has {used / 1e6:,.0f} MB, and its quota is {quota / 1e6:,.0f} MB",
            "delete jobs and measurement sets, which gives room after 30 days, or start the service with a "
            "larger --quota",
        )


class TooManyJobsError(StoreError):
    """The queue of a kind of job is full."""

    def __init__(self, kind: Resource, most: int) -> None:
        super().__init__(
            f"{most:,} {kind.collection} are queued or running, which is the maximum",
            "try again when some have finished, or cancel some",
        )


class KeyRefusedError(StoreError):
    """A request came without a key that opens the service."""


class WrongKeysError(KeyRefusedError):
    """Too many wrong keys came from an address; right ones are still taken."""

    def __init__(self) -> None:
        super().__init__(
            "too many wrong keys were sent from this address",
            "wait a minute before trying again; a valid key is accepted at any time",
        )


class RoleError(StoreError):
    """The role of a key does not allow what it asks for."""


class IdempotencyConflictError(StoreError):
    """An idempotency key came again with another body."""

    def __init__(self, kind: Resource, key: str) -> None:
        super().__init__(
            f"the idempotency key {_shown(key)} was already used with another body to create a {kind.name}",
            "send the first body again, or use a new key",
        )
        self.kind = kind  # The kind of resource that the key created
        self.key = key  # The key; text from outside, of any length


class CursorError(StoreError):
    """A cursor that no page gave."""

    def __init__(self, cursor: str) -> None:
        super().__init__(
            f"{_shown(cursor)} is not a valid pagination cursor",
            "use `next` of the previous page unchanged, or omit `cursor`",
        )
