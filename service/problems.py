"""Errors of the service, each with its remedy, and their problem details (RFC 9457).

The table `_KINDS` gives the HTTP status of each class of errors, also of those of the numerical core.

ServiceError                   an error whose cause is not in the request: see the remedy
├── ServerError                the service cannot start (service/server.py)
├── KeysFileError              a file of keys cannot be read or written (security/keys.py)
├── SettingsError              the settings of a laboratory cannot be used (reports/laboratory.py)
├── MissingExtraError          a library of an extra is not installed: install the extra
├── ExecutorError              the caller's executor failed: see the executor's error
└── StoreError                 base of the errors of the store
    ├── MissingDatabaseError   there is no database file: give the URL of a database that exists
    ├── StoreUnavailableError  the database does not answer: try again, or look at the server
    │   └── LockedError        another program has the rows locked: try again, or end the other program
    ├── DamagedError           a document that cannot be read: delete it, or restore a copy
    ├── NotFoundError          no such record: check the id
    │   └── DeletedError       the record was deleted: restore it
    ├── NotEndedError          a job that has not ended cannot be deleted: cancel it first
    ├── ClosedError            a closed set takes no more readings: open another set
    ├── ReferencedError        other resources refer to the resource to delete: delete those first
    ├── WorkerLostError        the workers of a job died: send the job again
    ├── QuotaError             the database has reached its quota: delete resources, or raise --quota
    ├── TooManyJobsError       the queue of jobs is full: post the job later
    ├── KeyRefusedError        the request has no valid key: send a valid key
    │   └── WrongKeysError     too many wrong keys were sent: wait, then send the right key
    ├── RoleError              the key's role does not allow the request: use another key
    ├── IdempotencyConflictError  an idempotency key was used for another body: use a new key
    └── CursorError            the cursor is not that of a page: start from the first page

RequestError of the numerical core
├── TooManyRowsError           a table with more rows than a request may have: send parts, or use a command
└── ItemsError                 a request with several faults
    ├── FilesError             files that were not understood: correct the files
    │   └── MovesLeftError     moves that cannot be corrected: correct the program, or leave these moves
    └── VerdictError           a result with the verdict "do not use": correct the readings, or accept it

ProblemError                   a problem document as an exception, for programs and commands
├── CampaignError              a campaign that cannot be identified: correct it
└── RefusedError               the service refused: see the remedy
    └── AwayError              the service does not answer now: try again
"""

from __future__ import annotations

import os
import re
import shlex
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from errno import EISDIR, ENAMETOOLONG, ENOENT
from http import HTTPStatus
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple, get_args

from jointstiff.schemas.finding import Problem, ProblemItem
from jointstiff.schemas.measurement import AngleUnit, ForceUnit, LengthUnit
from jointstiff.solver.errors import (
    JointstiffError,
    MeasurementError,
    NotObservableError,
    RequestError,
    RobotError,
    SolverError,
    UnsupportedMethodError,
)

_MAX_SHOWN = 80
_COLLECTIONS_WITH_ADDRESS = ("robots", "measurement-sets")
"""Collections that have addresses of their own; all other resources are jobs."""


class Resource(NamedTuple):
    """A kind of resource."""

    name: str  # name of the kind in messages, such as `measurement set`
    collection: str  # name of the kind in addresses, such as `measurement-sets`

    @property
    def listing(self) -> str:
        """Address that lists the resources of this kind."""
        if self.collection in (*_COLLECTIONS_WITH_ADDRESS, "jobs"):
            return f"/v1/{self.collection}"
        return f"/v1/jobs?kind={self.name}"

    def change_request(self, identifier: str, change: str) -> str:
        """Return the text of an HTTP request that changes a resource: method, address and body.

        `change` is the content of the JSON object in the body, such as `"deleted": false`.
        """
        collection = self.collection if self.collection in _COLLECTIONS_WITH_ADDRESS else "jobs"
        return f"PATCH /v1/{collection}/{identifier} {{{change}}}"


class ItemsError(RequestError):
    """A request with several faults, each with its place, reason and remedy."""

    def __init__(
        self, reason: str, *, remedy: str, where: str | None = None, items: Iterable[Sequence[str]] = ()
    ) -> None:
        super().__init__(reason, remedy=remedy, where=where)
        # (place, reason, remedy) of each fault, if several faults are known
        self.items = tuple((place, fault_reason, fault_remedy) for place, fault_reason, fault_remedy in items)


class FilesError(ItemsError):
    """Files that were not understood; `where` is file:line:column, if there is a single place."""


class TooManyRowsError(RequestError):
    """A table has more rows than one request may have."""


class MovesLeftError(FilesError):
    """Moves of a program that cannot be corrected, in a request that does not leave them as they are."""


class VerdictError(ItemsError):
    """A result has the verdict "do not use", and the request does not accept this verdict."""

    @classmethod
    def for_result(cls, subject: str, where: str, items: Iterable[Sequence[str]]) -> VerdictError:
        """Return the error for a result whose verdict is "do not use".

        Args:
            subject: name of the result in the message, such as `the run`.
            where: field of the request that names the result.
            items: one (place, text, remedy) for each reason of the verdict.
        """
        return cls(
            f"the verdict on {subject} is: do not use",
            where=where,
            remedy="follow the remedies of the reasons and identify again; to continue anyway, give "
            "`accept_verdict: do_not_use`",
            items=items,
        )


def _quote(text: str) -> str:
    """Return a text of a user in quotes, escaped, and cut to at most `_MAX_SHOWN` characters."""
    return repr(text if len(text) <= _MAX_SHOWN else text[:_MAX_SHOWN] + "…")


class ServiceError(Exception):
    """An error whose cause is not in the request, such as a full database or a missing library."""

    def __init__(self, reason: str, remedy: str) -> None:
        super().__init__(f"{reason}: {remedy}")
        self.reason = reason  # sentence that says what is wrong
        self.remedy = remedy  # sentence that says how to correct the cause


EXTRAS: Final[Mapping[str, str]] = MappingProxyType(
    dict.fromkeys(
        (
            "alembic",
            "anyio",
            "dbos",
            "fastapi",
            "prometheus_client",
            "psycopg",
            "segno",
            "sqlalchemy",
            "starlette",
            "uvicorn",
            "yaml",
        ),
        "service",
    )
    | {
        "distributed": "cluster",
        "h5py": "tables",
        "httpx2": "client",
        "matplotlib": "plot",
        "openpyxl": "excel",
        "pandas": "frames",
        "polars": "frames",
        "pyarrow": "tables",
        "python_calamine": "excel",
        "robotprograms": "programs",
        "typst": "reports",
    }
)
"""Optional library → extra of this package that installs it."""


class MissingExtraError(ServiceError, ImportError):
    """A library that an extra of this package installs is not installed."""

    def __init__(self, feature: str, extra: str) -> None:
        super().__init__(
            f"{feature} needs the extra `{extra}`, which is not installed",
            f'pip install "jointstiff[{extra}]"',
        )


def explain_missing_library(feature: str, error: ImportError) -> ImportError:
    """Return the error that names the extra which installs a missing library.

    If no extra of this package installs the library, return `error`.

    Args:
        feature: the feature that needs the library, as the subject of the message, such as `a chart`.
        error: error of the import.
    """
    extra = EXTRAS.get((error.name or "").partition(".")[0])
    return error if extra is None else MissingExtraError(feature, extra)


@contextmanager
def naming_missing_extra(feature: str) -> Iterator[None]:
    """Raise a failed import of the block as the error that names the extra which installs the library.

    Args:
        feature: the feature that needs the library, as in `explain_missing_library`.

    Raises:
        MissingExtraError: the library belongs to an extra.
    """
    try:
        yield
    except ImportError as error:
        raise explain_missing_library(feature, error) from None


class ExecutorError(ServiceError):
    """An executor of the caller failed; its own error is the cause."""

    def __init__(self, error: Exception) -> None:
        super().__init__(
            f"the executor failed: {type(error).__name__}: {error}",
            "start the executor again; without `executor`, this process does the work",
        )


class StoreError(ServiceError):
    """Base of the store's errors."""


class MissingDatabaseError(StoreError):
    """There is no database file at the URL."""


class StoreUnavailableError(StoreError):
    """The database does not answer, or refuses an operation of the store."""

    def __init__(self, reason: str, remedy: str, public_reason: str | None = None) -> None:
        super().__init__(reason, remedy)
        # the reason without names of hosts and users, for answers over the network
        self.public_reason = reason if public_reason is None else public_reason


class LockedError(StoreUnavailableError):
    """Another program has locked what a statement needs, for longer than the statement may wait."""


class DamagedError(StoreError):
    """A document in the database cannot be read."""

    def __init__(self) -> None:
        super().__init__(
            "a document in the database is damaged",
            "delete the resource, or restore the database from a copy",
        )


_NEXT_STEPS: Final[Mapping[tuple[str, str], str]] = MappingProxyType(
    {
        ("run", "measurement set"): 'identify the set with POST /v1/runs {{"measurement_set_id": "{id}"}}',
        ("run", "robot"): "give the id of one of the robot's runs, GET /v1/jobs?kind=run&robot_id={id}",
        ("measurement set", "robot"): "give the id of one of the robot's sets, "
        "GET /v1/measurement-sets?robot_id={id}",
        ("measurement set", "run"): "give `request.measurement_set_id` of the run, GET /v1/jobs/{id}",
        ("robot", "measurement set"): "give `robot_id` of the set, GET /v1/measurement-sets/{id}",
        ("robot", "run"): "give `robot_id` of the run's measurement set, which GET /v1/jobs/{id} names",
        ("job", "measurement set"): "get the set with GET /v1/measurement-sets/{id}",
        ("job", "robot"): "get the robot with GET /v1/robots/{id}",
    }
)
"""Kind of the requested resource and kind that has the id → what to do; `{id}` is for the id."""


class NotFoundError(StoreError):
    """No record has the requested id."""

    def __init__(self, kind: Resource, identifier: str, owner: str | None = None) -> None:
        """Build the error.

        Args:
            kind: kind of the missing resource.
            identifier: the unknown id.
            owner: name of the other kind that has a resource with this id; None if there is none.
        """
        reason, remedy = f"there is no {kind.name} {_quote(identifier)}", "check the id"
        if owner is not None:
            reason += f": this is the id of a {owner}"
            remedy = _NEXT_STEPS.get((kind.name, owner), f"give the id of a {kind.name}").format(
                id=identifier
            )
        or_list = "list" if owner is None else "or list"
        super().__init__(reason, f"{remedy}; {or_list} the existing ids with GET {kind.listing}")
        self.kind = kind  # the kind of the missing resource
        self.id = identifier  # the unknown id; text from outside, of any length


class DeletedError(NotFoundError):
    """The record was deleted, and can still be restored."""

    def __init__(self, kind: Resource, identifier: str) -> None:
        super().__init__(kind, identifier)
        self.reason = f"the {kind.name} {_quote(identifier)} was deleted"
        self.remedy = "restore it with " + kind.change_request(identifier, '"deleted": false')
        self.args = (f"{self.reason}: {self.remedy}",)


class NotEndedError(StoreError):
    """A job that has not ended cannot be deleted."""

    def __init__(self, kind: Resource, identifier: str) -> None:
        cancel = kind.change_request(identifier, '"cancelled": true')
        super().__init__(
            f"the {kind.name} {_quote(identifier)} has not finished",
            f"cancel the {kind.name} first with {cancel}, or wait until it has finished",
        )


class ClosedError(StoreError):
    """A measurement set that was closed takes no more readings."""

    def __init__(self, identifier: str) -> None:
        super().__init__(
            f"the measurement set {_quote(identifier)} is closed",
            "declare another live campaign; the readings of this set are kept",
        )


class LabelTakenError(StoreError):
    """A live measurement set has a different observation with the same label already."""

    def __init__(self, label: str) -> None:
        super().__init__(
            f"the set already has a different observation with the label {_quote(label)}",
            "another device may have sent that observation: send this observation with another label",
        )


class ReferencedError(StoreError):
    """A robot or measurement set cannot be deleted, as other resources refer to it."""

    def __init__(self, kind: Resource, identifier: str, users: Sequence[str], *, more: bool) -> None:
        super().__init__(
            f"the {kind.name} {_quote(identifier)} is used by {', '.join(users)}{', …' if more else ''}",
            "delete these resources first",
        )


class WorkerLostError(StoreError):
    """The workers of a job died, or the job queue gave the job up."""

    def __init__(self, reason: str) -> None:
        super().__init__(
            reason,
            "send the job again; if the workers die again, split the job into several jobs or give the "
            "workers more memory; the logs of the workers have details",
        )


class QuotaError(StoreError):
    """The database has reached its quota."""

    def __init__(self, used: int, quota: int) -> None:
        super().__init__(
            f"the database has {used / 1e6:,.0f} MB, and its quota is {quota / 1e6:,.0f} MB",
            "delete jobs and measurement sets (their space is free after 30 days), or start the service with "
            "a larger --quota",
        )


class TooManyJobsError(StoreError):
    """The queue of a kind of job is full."""

    def __init__(self, kind: Resource, most: int) -> None:
        super().__init__(
            f"{most:,} {kind.collection} are queued or running; no more are accepted",
            "try again when some jobs have finished, or cancel some jobs",
        )


class KeyRefusedError(StoreError):
    """A request came without a key that opens the service."""


class WrongKeysError(KeyRefusedError):
    """Too many wrong keys came from an address; valid keys are still accepted."""

    def __init__(self) -> None:
        super().__init__(
            "too many wrong keys were sent from this address",
            "wait a minute before trying again; a valid key is accepted at any time",
        )


class RoleError(StoreError):
    """The role of a key does not allow the request."""


class IdempotencyConflictError(StoreError):
    """An idempotency key came again with another body."""

    def __init__(self, kind: Resource, key: str) -> None:
        super().__init__(
            f"the idempotency key {_quote(key)} was already used with another body to create a {kind.name}",
            "send the first body again, or use a new key",
        )
        self.kind = kind  # The kind of resource that the key created
        self.key = key  # The key; text from outside, of any length


class CursorError(StoreError):
    """A cursor that was not returned as `next` of any page."""

    def __init__(self, cursor: str) -> None:
        super().__init__(
            f"{_quote(cursor)} is no cursor of this list",
            "use `next` of the previous page unchanged, with the same address, filters and `sort`, or omit "
            "`cursor`",
        )


MAX_ITEMS: Final = 20
"""Maximum number of faults listed in one answer."""
MAX_PROBLEM_BYTES: Final = 8_000
"""Maximum size of an error body [bytes]."""
_LONGEST: Final = 300
_WITHIN_LIMIT: Final = "give a number within this limit, and check its unit"
_AN_OBJECT: Final = "give its fields by name, in braces"
_A_TIME: Final = "write a time such as 2026-11-20T14:30:00+01:00"

_OUTSIDE_BODY: Final = {"query", "path", "header"}  # parts of a request other than its body
# pydantic's types of faults of a value that is no JSON object
_NO_OBJECT: Final = {"model_type", "model_attributes_type", "dict_type"}

_KINDS: Final[Mapping[type[Exception], tuple[int, str, str]]] = MappingProxyType(
    {
        UnsupportedMethodError: (422, "unsupported-method", "The readings cannot support this method"),
        VerdictError: (422, "not-to-be-used", "The result must not be used"),
        FilesError: (422, "invalid-file", "The files were not understood"),
        MovesLeftError: (422, "invalid-file", "Moves cannot be corrected"),
        TooManyRowsError: (413, "too-many-rows", "The table has too many rows for one request"),
        RequestError: (422, "invalid-request", "The request cannot be carried out"),
        RobotError: (422, "invalid-robot", "The robot's description cannot be used"),
        MeasurementError: (422, "invalid-measurement-set", "The measurement set cannot be used"),
        NotObservableError: (422, "not-observable", "The readings cannot determine any joint"),
        SolverError: (500, "solver", "The optimum could not be certified"),
        IdempotencyConflictError: (
            422,
            "idempotency-conflict",
            "The idempotency key was used with another body",
        ),
        CursorError: (422, "invalid-cursor", "Invalid pagination cursor"),
        DeletedError: (404, "deleted", "The resource was deleted"),
        TooManyJobsError: (429, "too-many-jobs", "The queue is full"),
        ReferencedError: (409, "referenced", "Other resources refer to this resource"),
        QuotaError: (507, "quota", "The database is full"),
        ClosedError: (409, "closed", "The measurement set is closed"),
        LabelTakenError: (409, "label-taken", "Another reading has this label"),
        NotEndedError: (409, "not-ended", "The job has not finished"),
        WorkerLostError: (500, "worker-lost", "The workers of the job died"),
        NotFoundError: (404, "not-found", "The resource does not exist"),
        WrongKeysError: (429, "too-many-wrong-keys", "Too many wrong keys"),
        KeyRefusedError: (401, "no-valid-key", "A valid key is needed"),
        RoleError: (403, "role", "The role does not allow this"),
        StoreUnavailableError: (503, "store-unavailable", "The database is not available"),
        StoreError: (500, "store", "The database cannot be used"),
        MissingExtraError: (501, "missing-extra", "A library is not installed"),
    }
)
"""Class of errors → (HTTP status, last part of the URN that is the type of the problem, title)."""

_REMEDIES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "missing": "add this field",
        "extra_forbidden": "remove this field, or check its spelling",
        "finite_number": "give a finite number",
        "json_invalid": "send valid JSON with finite numbers and at most 200 levels",
        "union_tag_invalid": "use one of these formats",
        "too_long": "send fewer items, or split the items into several resources",
        "literal_error": "use one of these words exactly as written",
        "bool_type": "give true or false",
        "bool_parsing": "give true or false",
        "float_parsing": "give a number",
        "float_type": "give one number",
        "timezone_aware": "add the time zone, such as 2026-11-20T14:30:00+01:00",
        "greater_than": _WITHIN_LIMIT,
        "greater_than_equal": _WITHIN_LIMIT,
        "less_than": _WITHIN_LIMIT,
        "less_than_equal": _WITHIN_LIMIT,
        "int_type": "give one whole number",
        "int_parsing": "give a whole number",
        "int_from_float": "give a whole number",
        "string_type": "give a text, in quotes",
        "string_too_short": "write a longer text",
        "string_too_long": "write a shorter text",
        "list_type": "give a list in brackets, such as [1, 2, 3]",
        "tuple_type": "give a list in brackets, such as [1, 2, 3]",
        "too_short": "add the missing entries",
        "dict_type": 'give a value by name, in braces, such as {"NAME": …}',
        "model_type": _AN_OBJECT,
        "model_attributes_type": _AN_OBJECT,
        "datetime_parsing": _A_TIME,
        "datetime_from_date_parsing": _A_TIME,
        "datetime_type": _A_TIME,
        "union_tag_not_found": "add this field",
    }
)
"""Type of a fault that pydantic found → remedy."""
_UNITS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {"length": get_args(LengthUnit), "angle": get_args(AngleUnit), "force": get_args(ForceUnit)}
)
"""Quantity → its units, as requests name them."""
_MOST_FILES: Final = 3
"""Files of a folder that an error names."""
_LONGEST_NAME: Final = 60
MISSING: Final = "required field is missing"

_WORDING: Final = tuple(
    (re.compile(pattern, re.DOTALL), wording)
    for pattern, wording in (
        (r"Value error, (.+)", r"\1"),
        (r"Field required", MISSING),
        (r"Extra inputs are not permitted", "unknown field"),
        (r"Input should be a valid (?:dictionary|mapping).*", "must be an object"),
        (r"Input should be a valid (?:list|tuple|array).*", "must be a list"),
        (r"Input should be a valid string.*", "must be a text"),
        (r"Input should be a valid boolean.*", "must be true or false"),
        (r"Input should be a valid integer.*", "must be a whole number"),
        (r"Input should be a valid number.*", "must be a number"),
        (r"Input should be None", "must be null"),
        (r"Input should have timezone info", "must have a time zone"),
        (r"Input should be (.+)", r"must be \1"),
        (r"String should match pattern (.+)", r"must match the pattern \1"),
        (r"Unable to extract tag using discriminator (.+)", r"needs the field \1"),
        (
            r"Input tag (.+) found using (.+) does not match any of the expected tags: (.+)",
            r"\2 is \1, but must be one of \3",
        ),
        (
            r"\w+ should have at (least|most) (\d+) items? after validation, not (.+)",
            r"must have at \1 \2 items, but has \3",
        ),
        (r"\w+ should have at (least|most) (.+)", r"must have at \1 \2"),
    )
)
"""(pattern of a message of pydantic, message in the words of this project); the first match is used.

A message that no pattern matches remains unchanged.
"""


def problem_from_error(error: JointstiffError | ServiceError) -> Problem:
    """Return the problem details of an error.

    Status, type and title are those of the nearest class in the table `_KINDS`.
    """
    unknown_kind = (500, "internal", "Internal error")
    status, slug, title = next((_KINDS[each] for each in type(error).__mro__ if each in _KINDS), unknown_kind)
    items = error.items if isinstance(error, ItemsError) else ()
    problem = Problem(
        type=_urn(slug),
        title=title,
        status=status,
        detail=_shorten(
            error.public_reason if isinstance(error, StoreUnavailableError) else error.reason, 2 * _LONGEST
        ),
        where=_shorten(error.where) if isinstance(error, JointstiffError) and error.where else None,
        remedy=_shorten(error.remedy, 2 * _LONGEST),
        errors=[
            ProblemItem(where=_shorten(place), reason=_shorten(reason), remedy=_shorten(remedy))
            for place, reason, remedy in items
        ],
    )
    return _fit_into_body(problem)


_LINE_OF_FILE: Final = re.compile(r", line \d+\b")
"""Place in a file, as `naming_file` writes it."""


def find_path_in_document(section: str, where: str | None) -> str | None:
    """Return the path of a faulty field in a document of several sections, such as a campaign.

    A path that begins with `observations` belongs to the section `measurement_set`, even if an error names
    another section. A line of a file, such as `poses.csv, line 2`, belongs to no section.

    Args:
        section: section with the fault; empty for a document of one section.
        where: path within this section; None if the path is not known.

    Returns:
        The path in the whole document; None if neither section nor path are known.
    """
    is_in_observations = re.match(r"observations\b", where or "") is not None
    if _LINE_OF_FILE.search(where or ""):
        return where
    if section and where == "measurement_set_id":
        return "measurement_set"  # a document contains the set itself in place of the set's id
    if section and is_in_observations and not section.endswith("measurement_set"):
        section = "measurement_set"
    return ".".join(part for part in (section, where) if part) or None


def http_problem(status: int, detail: str, remedy: str | None = None) -> Problem:
    """Return problem details with the type and the title of an HTTP status, a detail and a remedy."""
    phrase = HTTPStatus(status).phrase
    return Problem(
        type=_urn(phrase.lower().replace(" ", "-")),
        title=phrase,
        status=status,
        detail=_shorten(detail, 2 * _LONGEST),
        remedy=remedy,
    )


def problem_from_faults(errors: Sequence[Mapping[str, Any]], parameters: Sequence[str] = ()) -> Problem:
    """Return the problem details of a request that pydantic refused.

    They list the first `MAX_ITEMS` faults, without the values that were sent.

    Args:
        errors: faults, as pydantic lists them (`ValidationError.errors()`).
        parameters: names of the query parameters of the route, to suggest a name for an unknown parameter.
    """
    items = [
        ProblemItem(
            where=_shorten(_path_text(error["loc"])) or "body",
            reason="must be an object"
            if error["type"] in _NO_OBJECT
            else _shorten(reword_fault(error, parameters)),
            remedy=_find_remedy(error, parameters),
        )
        for error in errors[:MAX_ITEMS]
    ]
    return _fit_into_body(
        Problem(
            type=_urn("invalid-request"),
            title="The request does not match the API's schema",
            status=422,
            detail=describe_first_fault(len(errors), items[0].where, items[0].reason),
            where=items[0].where,
            remedy=items[0].remedy or _general_remedy(errors[0]),
            errors=items,
        )
    )


def describe_first_fault(count: int, place: str, reason: str) -> str:
    """Return the number of faults of a request, and place and reason of the first fault, in words."""
    faults = "1 fault" if count == 1 else f"{count} faults"
    return f"{faults}; first: {place}: {reason}"


def _general_remedy(error: Mapping[str, Any]) -> str:
    """Return the remedy for a fault whose type has no remedy in `_REMEDIES`."""
    if error["loc"] and error["loc"][0] in _OUTSIDE_BODY:
        return "correct the parameter as the reason says"
    return "correct the field as the reason says"


def _find_remedy(error: Mapping[str, Any], parameters: Sequence[str]) -> str | None:
    """Return the remedy for a type of fault that pydantic found; None if the type has no remedy.

    For an unknown query parameter with a name like that of a known one, the remedy names the known one.
    """
    meant = _find_meant_parameter(error, parameters)
    if meant is not None:
        return f"give `{meant}` in its place, or remove this parameter"
    if error["type"] == "extra_forbidden" and error["loc"][:1] == ("query",):
        known = f", or use one of {', '.join(parameters)}" if parameters else ""
        return f"leave out this parameter{known}"
    if error["type"] == "missing" and (remedy := _find_remedy_of_units(error["loc"])):
        return remedy
    return (
        _find_remedy_of_ids(error)
        or _find_remedy_of_fields_of_sets(error)
        or _find_remedy_of_unread(error)
        or _find_remedy_of_limits(error)
        or _explain_encoders(error)
        or _find_remedy_of_numbers(error)
        or _REMEDIES.get(str(error["type"]))
    )


def _find_remedy_of_numbers(error: Mapping[str, Any]) -> str | None:
    """Return the remedy for wrong numbers or entries of a list; None for other faults."""
    message = str(error["msg"])
    if _is_missing_entry(error):
        return "add this entry; a place, a vector or a grid has three numbers, along x, y and z"
    is_box = error["loc"][-1:] in {("area",), ("work_area",)}
    if is_box and error["type"] in {"list_type", "too_long", "too_short", "tuple_type"}:
        return "give two corners of the box, each with its x, y and z: [[x1, y1, z1], [x2, y2, z2]]"
    if error["type"] in {"too_long", "too_short"} and message.startswith("Tuple"):
        return _find_remedy_of_vectors(error)
    if error["type"] == "string_type" and "leave_out" in error["loc"]:
        return "give labels of observations as texts, in quotes, not their numbers"
    if error["type"] == "list_type" and "leave_out" in error["loc"]:
        return 'give a list of labels, such as ["c03"]'
    if error["type"] == "list_type" and error["loc"][-1:] == ("causes",):
        return 'give a list of causes, such as [{"name": "play"}]'
    if message.endswith("must not contain duplicates"):
        return "give each entry only once"
    return None


def _find_remedy_of_vectors(error: Mapping[str, Any]) -> str:
    """Return the remedy for a vector with more or fewer than three numbers, such as a force with a moment."""
    # A vector with decimal commas, such as 1,5,2,5,3,5, has too many numbers.
    three = "give one number for each of x, y and z, with decimal points, not commas"
    if "force" not in error["loc"]:
        return three
    if not str(error["msg"]).endswith("not 6"):
        return f"{three}; give a moment as `moment`"
    return (
        f"{three}; if these are a force and a moment, give the moment as `moment`, or in the columns Mx, My, "
        "Mz of a table of poses: the force is first in a wrench of ROS and in most load cells, last in "
        "spatial vectors"
    )


STIFFNESS_REMEDY: Final = (
    "give stiffnesses in N·m/rad (prismatic: N/m); 3.1 · 10⁶ N·m/rad in a table is 3.1e6"
)
_REMEDIES_OF_GOALS: Final = MappingProxyType(
    {
        "relative": 'give an uncertainty from 0.1 % to 100 %, such as "15 %"; as a number, 0.15',
        "uncertainty": 'give an uncertainty from 0.001 µm to 1 m, such as "6 um"; as a number, 6e-6 in m',
        "limit": 'give a limit from 0.001 µm to 1 m, such as "below 0.5 mm"; as a number, 5e-4 in m',
        "mistake": 'give a length from 0.001 µm to 1 m, such as "load point 10 mm"; as a number, 0.01 in m',
    }
)
"""Field of a goal → remedy for a number outside the limits of `jointstiff.schemas.plan`."""


def _is_missing_entry(error: Mapping[str, Any]) -> bool:
    """Return whether the fault is an entry that a list of a fixed length lacks."""
    return error["type"] == "missing" and isinstance(error["loc"][-1], int)


def _explain_encoders(error: Mapping[str, Any]) -> str | None:
    """Return what the words for encoders mean; None for other faults."""
    is_choice = error["type"] == "literal_error" and error["loc"][-1:] == ("encoders",)
    return ENCODERS_REMEDY if is_choice else None


ENCODERS_REMEDY: Final = (
    "give `motor` if the controller closes the position loop by the encoders at the motors, `secondary` if "
    "by encoders behind the gearboxes; absolute or incremental makes no difference"
)


def _find_remedy_of_limits(error: Mapping[str, Any]) -> str | None:
    """Return the remedy for a number outside the limits of its field; None without a remedy of the field."""
    if error["type"] not in {"greater_than_equal", "less_than_equal"}:
        return None
    place = error["loc"]
    if {"priors", "stiffness_bounds"}.intersection(place):
        return STIFFNESS_REMEDY
    if place[-1:] == ("characteristic_length",):
        return (
            "give a length from 1 mm to the arm's reach, such as 0.25 where lengths are in m, as in messages "
            "and HTTP requests, and 250 where they are in mm"
        )
    if place[-1:] == ("confidence",):
        return "give a fraction, such as 0.95 for 95 %"
    return _REMEDIES_OF_GOALS.get(str(place[-1])) if "goal" in place else None


_LIMIT: Final = re.compile(r"must be (?:greater|less) than or equal to ([\d.]+)")
"""Reason for a number outside a limit, with the limit."""


def _reword_limit_of_goal(error: Mapping[str, Any], message: str) -> str:
    """Return the reason for a relative goal outside a limit, with the limit in percent, too."""
    limit = _LIMIT.fullmatch(message)
    is_goal = "goal" in error["loc"] and error["loc"][-1] == "relative"
    if limit is None or not is_goal:
        return message
    return f"{message}, that is {100 * float(limit[1]):g} %"


def _find_remedy_of_unread(error: Mapping[str, Any]) -> str | None:
    """Return the remedy for a number of an observation that is no finite number; None for other faults."""
    place = error["loc"]
    if "readings" in place[-2:] and error["type"] in {"list_type", "model_type"}:
        return (
            'give a list of objects, such as [{"target": "P10", "unloaded": [1.2, 0.3, 0.8], "loaded": '
            "[1.2, 0.3, 0.799]}]"
        )
    is_posture = place[-1:] == ("joints",) and {"observations", "cases"}.intersection(place)
    if is_posture and error["type"] == "list_type":
        return "give a list of one number for each joint, in the order of the robot's joints"
    if "observations" not in place or error["type"] not in {"finite_number", "float_type"}:
        return None
    remedy = _REMEDIES[error["type"]]
    if "readings" in place:
        return f"{remedy}; leave out the reading of a target that was not read"
    if any(name in place for name in ("joints", "force", "moment")):
        return f"{remedy}; leave out the observation if the number is unknown"
    return None


def _find_remedy_of_units(location: Sequence[int | str]) -> str | None:
    """Return the remedy for missing units, or for the missing unit of a quantity; None for other fields."""
    names = location[-2:]
    if names[-1:] == ("units",):
        words = "; ".join(f"{name} is {' or '.join(units)}" for name, units in _UNITS.items())
        example = ", ".join(f'"{name}": "{units[0]}"' for name, units in _UNITS.items())
        return f"add this field, such as {{{example}}}: {words}; without forces, leave out force"
    if names[:1] == ("units",) and names[1] in _UNITS:
        return f"add this field: {' or '.join(_UNITS[str(names[1])])}"
    return None


def _urn(slug: str) -> str:
    """Return the URN that is the `type` of problem details; `slug` is a short name of the kind of problem."""
    return f"urn:jointstiff:problem:{slug}"


def _fit_into_body(problem: Problem) -> Problem:
    """Drop the last faults of a problem until its JSON has at most `MAX_PROBLEM_BYTES`."""
    while len(problem.model_dump_json().encode()) > MAX_PROBLEM_BYTES and len(problem.errors) > 1:
        problem = problem.model_copy(update={"errors": problem.errors[:-1]})
    return problem


def _shorten(text: str, longest: int = _LONGEST) -> str:
    """Return a text cut to `longest` characters, with � in place of unprintable characters."""
    printable = "".join(c if c.isprintable() else "�" for c in text[: longest + 1])
    return printable if len(printable) <= longest else printable[:longest] + "…"


def _path_text(location: Sequence[int | str]) -> str:
    """Return the path of a field as text, such as `observations[3].force[0]`.

    The parts of `location` that are no fields are left out: FastAPI's first part `body`, and the format of a
    robot's model, which pydantic adds after `model`.
    """
    location = location[1:] if location[:1] == ("body",) else location
    path = ""
    for i, part in enumerate(location):
        is_model_format = i and location[i - 1] == "model"
        if is_model_format and part in {"urdf", "dh", "geometry", "catalogue"}:
            continue
        if isinstance(part, int):
            path += f"[{part}]"
        else:
            path += f".{part}" if path else str(part)
    return path


def reword_fault(error: Mapping[str, Any], parameters: Sequence[str] = ()) -> str:
    """Return the message of a fault that pydantic found, in the project's words.

    Args:
        error: the fault as pydantic lists it, with `type`, `loc` and `msg`.
        parameters: names of the query parameters of the route, to suggest a name for an unknown parameter.
    """
    message = str(error["msg"])
    if _is_no_id(error):
        return "must be an id, which has at most 64 letters, digits, - and _; a name is no id"
    for pattern, wording in _WORDING:
        if match := pattern.fullmatch(message):
            message = match.expand(wording)
            break
    if _is_missing_entry(error):
        message = f"entry {error['loc'][-1] + 1} of the list is missing"
    message = _reword_limit_of_goal(error, message)
    meant = _find_meant_parameter(error, parameters)
    return message if meant is None else f"{message}; did you mean `{meant}`?"


def _find_meant_parameter(error: Mapping[str, Any], parameters: Sequence[str]) -> str | None:
    """Return the known query parameter that an unknown one resembles; None if there is none."""
    is_unknown = error["type"] == "extra_forbidden" and error["loc"][:1] == ("query",)
    return find_similar_name(str(error["loc"][-1]), parameters) if is_unknown else None


_FEWEST_LETTERS: Final = 4
"""Least number of letters of a misspelt name: `tol` and `tool` are two words."""
_SPELLED_ALIKE: Final = 0.81
"""Least similarity, by difflib, of a misspelt name and the name that is meant."""


def find_similar_name(unknown: str, known: Iterable[str]) -> str | None:
    """Return the known name that is misspelt in an unknown name; None if no known name is similar."""
    names = list(known)
    name = unknown.casefold().replace("-", "_")
    if not _FEWEST_LETTERS <= len(name) <= _LONGEST_NAME or unknown in names:
        return None
    # People seldom mistype the first letter, which tells `points` from `joints`, and `port` from `report`.
    names = [each for each in names if each[:1] == name[:1]]
    exchanged = [each for each in names if sorted(each) == sorted(name)]
    similar = exchanged or get_close_matches(name, names, n=1, cutoff=_SPELLED_ALIKE)
    return similar[0] if similar else None


_BELONGS_TO_SET: Final = frozenset(
    ("encoders", "flange_targets", "forces", "frame", "load_point", "noise", "observations", "sigma")
)
"""Fields of a measurement set, and words for them, that are mistaken for options of a run."""
_LISTINGS: Final = MappingProxyType(
    {
        "measurement_set_id": "GET /v1/measurement-sets",
        "measurement_set_ids": "GET /v1/measurement-sets",
        "robot_id": "GET /v1/robots",
        "run_id": "GET /v1/jobs?kind=run",
        "run_ids": "GET /v1/jobs?kind=run",
    }
)
"""Field with the id of a resource → request that lists the ids with the names."""


def _find_listing(error: Mapping[str, Any]) -> str | None:
    """Return the request that lists the ids for the field of a fault; None if the field has no id."""
    fields = [part for part in error["loc"] if isinstance(part, str)]
    return _LISTINGS.get(fields[-1]) if fields else None


def _is_no_id(error: Mapping[str, Any]) -> bool:
    """Return whether a text in the field of an id is no id, but perhaps a name."""
    kinds = {"string_pattern_mismatch", "string_too_long"}
    return error["type"] in kinds and _find_listing(error) is not None


def _find_remedy_of_ids(error: Mapping[str, Any]) -> str | None:
    """Return the remedy for a missing id, or for a name in the place of an id; None for other faults."""
    listing = _find_listing(error)
    if error["type"] == "missing" and listing is not None:
        return f"add this field, with an id, not a name: {listing} lists the ids with the names"
    if _is_no_id(error) or (error["type"] == "string_type" and listing is not None):
        return f"give the id: {listing} lists the ids with the names"
    return None


def _find_remedy_of_fields_of_sets(error: Mapping[str, Any]) -> str | None:
    """Return the remedy for an unknown field that a campaign states elsewhere; None for other faults."""
    if error["type"] != "extra_forbidden" or "observations" in error["loc"]:
        return None
    name = str(error["loc"][-1])
    if name in _BELONGS_TO_SET:
        place = "in `noise` of the measurement set" if name == "sigma" else "in the measurement set"
        return f"remove this field: it is stated {place}, when the campaign is made"
    return None


_COMMAND_IN_TEXT: Final = re.compile(
    r"`jointstiff (compare|correct|gearbox|geometry|identify|import|map|measure|plan|predict"
    r"|process|rehearse)((?: [^\s`]+)*)`"
)
"""Command of the terminal for which Python has a function: its name and its words."""


def name_functions_in_text(text: str) -> str:
    """Return a text for users of Python: commands of the terminal are calls of functions.

    `jointstiff import FILE --robot ROBOT` becomes `jointstiff.read(FILE, robot=ROBOT)`; the option `--save`
    becomes the method `save` of the result. Commands without a function are left as they are.
    """

    def replace_command(match: re.Match[str]) -> str:
        """Return the call for a matched command; without words, the function."""
        function = "read" if match[1] == "import" else match[1]
        arguments = list[str]()
        method = ""
        try:
            words = deque(shlex.split(match[2]))
        except ValueError:  # an apostrophe of a name: the words are not those of a command line
            return match[0]
        while words:
            word = words.popleft()
            if not word.startswith("--"):
                arguments.append(_quote_value(word))
                continue
            has_value = bool(words) and not words[0].startswith("--")
            value = _quote_value(words.popleft()) if has_value else "True"
            if word == "--save":
                method = f".save({value if has_value else ''})"
            else:
                arguments.append(f"{word[2:].replace('-', '_')}={value}")
        call = f"({', '.join(arguments)})" if match[2] else ""
        return f"`jointstiff.{function}{call}{method}`"

    return _COMMAND_IN_TEXT.sub(replace_command, text)


def _quote_value(word: str) -> str:
    """Return a word of a command in quotes, but a word in capitals, such as FILE, as it is."""
    return word if word.isupper() and word.isidentifier() else repr(word)


class ProblemError(Exception):
    """An error with problem details; its text says what is wrong, where, and how to correct it."""

    def __init__(self, problem: Problem) -> None:
        place = f"{problem.where}: " if problem.where and problem.where not in problem.detail else ""
        remedy = f"; remedy: {name_functions_in_text(problem.remedy)}" if problem.remedy else ""
        super().__init__(f"{place}{problem.detail}{remedy}")
        self.problem = problem  #: the problem details, as the API would answer them


class CampaignError(ProblemError):
    """A campaign that cannot be identified."""


class RefusedError(ProblemError):
    """The service refused, or did not answer."""


class AwayError(RefusedError):
    """The service cannot be reached at present; a later request may succeed."""


def find_similar_file(path: Path) -> Path | None:
    """Return the path in the folder of a missing path whose name is most alike; None without one."""
    folder = path.parent
    names = [each.name for each in folder.iterdir()] if folder.is_dir() else []
    similar = get_close_matches(path.name, names, n=1, cutoff=0.8)
    return folder / similar[0] if similar else None


class MissingFileError(CampaignError, FileNotFoundError):
    """A file that does not exist; the remedy names a file with a similar name, if there is one."""

    def __init__(self, path: Path) -> None:
        folder, similar = path.parent, find_similar_file(path)
        place = f"in the folder {folder.absolute()}" if folder.is_dir() else f"as there is no folder {folder}"
        remedy = f"give {similar}" if similar else "give the name of a file that exists"
        super().__init__(http_problem(422, f"there is no file '{path}', {place}", remedy))
        self.errno, self.strerror, self.filename = ENOENT, os.strerror(ENOENT), str(path)

    def __str__(self) -> str:
        """Return what is wrong, and how to correct it."""
        return str(self.args[0])


_LONGEST_FILE_NAME: Final = 255
"""Bytes of the longest name of a file or folder that file systems allow."""


def is_content(text: str) -> bool:
    """Return whether a text in the place of a file's name is the content of a file."""
    has_breaks = any(mark in text for mark in "\n\r\0")
    if has_breaks or any(len(os.fsencode(name)) > _LONGEST_FILE_NAME for name in Path(text).parts):
        return True
    return text.lstrip()[:1] in ("{", "<") and not Path(text).exists()


def describe_content(text: str) -> str:
    """Return the sentence that a text is the content of a file, with its first words."""
    first_line = text.strip("\ufeff\0 \t\r\n").partition("\n")[0]
    shown = " ".join(text[:_LONGEST_FILE_NAME].split())[:_SHOWN_CONTENT].strip()
    separators = max(first_line.count(separator) for separator in ",;\t")
    kind = "a table" if separators > 1 else "a program or a table"
    if first_line[:1] in ("{", "["):
        kind = "a JSON document"
    elif first_line[:1] == "<":
        kind = "an XML document"
    return f"'{shown}…' is the text of {kind}"


GIVE_NAME: Final = "give the name of its file"
_SHOWN_CONTENT: Final = 30
"""Characters of a text that an error shows."""


class ContentError(CampaignError, FileNotFoundError):
    """The text of a file in the place of the file's name."""

    def __init__(self, text: str) -> None:
        super().__init__(http_problem(422, describe_content(text), GIVE_NAME))
        self.errno, self.strerror, self.filename = ENOENT, os.strerror(ENOENT), None

    def __str__(self) -> str:
        """Return what is wrong, and how to correct it."""
        return str(self.args[0])


class FolderError(CampaignError, IsADirectoryError):
    """A folder in the place of a file; the remedy names files of the folder."""

    def __init__(self, path: Path) -> None:
        super().__init__(http_problem(422, f"'{path}' is a folder", f"give a file in it{list_files(path)}"))
        self.errno, self.strerror, self.filename = EISDIR, os.strerror(EISDIR), str(path)

    def __str__(self) -> str:
        """Return what is wrong, and how to correct it."""
        return str(self.args[0])


class MissingFolderError(CampaignError, FileNotFoundError):
    """A file cannot be written, as its folder does not exist."""

    def __init__(self, path: Path) -> None:
        reason = f"'{path}' cannot be written, as there is no folder '{path.parent}'"
        super().__init__(http_problem(422, reason, "make this folder first, or choose another path"))
        self.errno, self.strerror, self.filename = ENOENT, os.strerror(ENOENT), str(path)

    def __str__(self) -> str:
        """Return what is wrong, and how to correct it."""
        return str(self.args[0])


def require_folder(path: Path) -> Path:
    """Return the path of a file to write.

    Raises:
        MissingFolderError: the folder of the file does not exist.
    """
    if not path.parent.is_dir():
        raise MissingFolderError(path)
    return path


def list_files(folder: Path) -> str:
    """Return the end of a sentence about a folder: its first files, or that it has none."""
    names = sorted(each.name for each in folder.iterdir() if each.is_file())
    shown = ", ".join(str(folder / name) for name in names[:_MOST_FILES])
    more = ", …" if len(names) > _MOST_FILES else ""
    return f": {shown}{more}" if names else ", the folder has none"


@contextmanager
def naming_missing_file() -> Iterator[None]:
    """Turn the error of the block for a missing file, or for a folder, into an error with a remedy."""
    try:
        yield
    except (MissingFileError, MissingFolderError, ContentError):
        raise
    except IsADirectoryError as error:
        if not isinstance(error.filename, str):
            raise
        raise FolderError(Path(error.filename)) from None
    except OSError as error:
        if not isinstance(error.filename, str) or error.errno not in (ENOENT, ENAMETOOLONG):
            raise
        if is_content(error.filename):
            raise ContentError(error.filename) from None
        raise MissingFileError(Path(error.filename)) from None


@contextmanager
def naming_file(path: Path) -> Iterator[None]:
    """Name a table's file in the place of errors of the block, such as `poses.csv, line 2`."""
    try:
        yield
    except RequestError as error:
        if error.where is not None and error.where.startswith("line "):
            error.where = f"{path.name}, {error.where}"
        raise


@contextmanager
def as_campaign_error(section: str) -> Iterator[None]:
    """Turn errors of the block into a `CampaignError` whose `where` begins with a section of the file."""
    try:
        yield
    except JointstiffError as error:
        problem = problem_from_error(error)
        raise CampaignError(
            problem.model_copy(update={"where": find_path_in_document(section, problem.where)})
        ) from error
