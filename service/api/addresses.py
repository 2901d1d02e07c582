"""Remedies for requests to an address, by a method or with a parameter that does not exist."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from typing import Final

from fastapi.routing import RouteContext, iter_route_contexts
from starlette.requests import Request
from starlette.routing import BaseRoute, Match, Mount, Route
from starlette.types import Scope

from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.kinds.rooms import ROOMS
from jointstiff.service.problems import find_verb

METHODS: Final = ("DELETE", "GET", "PATCH", "POST", "PUT")
"""Methods that routes may have; HEAD and OPTIONS are answered for all of them."""
_ALIKE: Final = 0.75  # of a part of an address
_PARAMETER: Final = re.compile(r"\{\w+(?::\w+)?\}")
_COLLECTIONS_OF_JOBS: Final = frozenset(("campaigns", *(kind.collection for kind in KINDS)))
"""Collections to which jobs are posted; each job has its address in `jobs`."""
_IDENTIFIER: Final = re.compile(r"[A-Za-z0-9_.-]{1,64}")


def list_methods(routes: Iterable[BaseRoute], scope: Scope) -> list[str]:
    """Return the methods that are answered at the address of a request; none at an unknown address."""
    return [method for method in METHODS if scope["path"] == "*" or _is_answered(routes, scope, method)]


def _is_answered(routes: Iterable[BaseRoute], scope: Scope, method: str) -> bool:
    """Return whether a route answers a method at the address of a request."""
    return any(
        route.matches({**scope, "method": method})[0] is Match.FULL
        for route in routes
        if method == "GET" or not isinstance(route, Mount)  # mounts are static files, for GET only
    )


def advise_method(request: Request) -> str:
    """Return what to send in place of a request whose method does not exist at its address."""
    methods = list_methods(request.app.routes, request.scope)
    if request.method == "DELETE" and "PATCH" in methods:
        return 'send PATCH with {"deleted": true}'
    if request.method == "PUT" and "PATCH" in methods:
        if "/measurement-sets/" in request.url.path:
            return (
                "post the corrected set with POST /v1/measurement-sets, as readings of a stored set never "
                "change; PATCH changes its name and notes"
            )
        return "send PATCH with the fields to change"
    collection = request.url.path.rpartition("/")[2]
    kind = next((kind for kind in KINDS if kind.collection == collection), None)
    if request.method == "GET" and kind is not None:
        return f"send GET to /v1/jobs?kind={kind.name}"
    return f"send {' or '.join(methods)}"


def advise_address(request: Request) -> str:
    """Return the existing address that an unknown address resembles; the collections if there is none."""
    parts = ["v1", *_leave_out_prefix(request.url.path.split("/"))]
    if len(parts) == 4 and _IDENTIFIER.fullmatch(parts[2]) and (by_part := _advise_part(parts)) is not None:
        return by_part
    if len(parts) > 2 and parts[1] in _COLLECTIONS_OF_JOBS:
        parts[1] = "jobs"  # jobs of all kinds have their addresses there
    ends_in_verb = request.method == "POST" and len(parts) > 2 and find_verb(parts[-1]) is not None
    if ends_in_verb and (by_verb := _advise_verb(parts[::-1])) is not None:
        return by_verb
    contexts = list(iter_route_contexts(list(request.app.routes)))
    paths = [context.path for context in contexts if isinstance(context.original_route, Route)]
    templates = [path.strip("/").split("/") for path in paths if path is not None]
    # The files of a job have addresses of one more part.
    in_files = [*parts[:3], "files", *parts[3:]] if "." in parts[-1] else parts
    for likely in (parts, in_files, parts[1:]):
        for template in templates:
            if (meant := _fill_in(template, likely)) is not None:
                return f"use the address {meant}"
    if (by_verb := _advise_verb(parts)) is not None:
        return by_verb
    described = [context.path for context in contexts if _is_described(context)]
    collections = sorted({path for path in described if path and path.count("/") == 2 and path[:4] == "/v1/"})
    return f"use one of the addresses {', '.join(collections)}"


_VERSION: Final = re.compile(r"api|v\d+")
"""Part of an address before the collection, as APIs have it."""


def _leave_out_prefix(parts: Iterable[str]) -> list[str]:
    """Return the parts of an address behind the version of the API."""
    filled = [part for part in parts if part]
    while filled and _VERSION.fullmatch(filled[0]):
        filled = filled[1:]
    return filled


_CANCEL: Final = 'send PATCH to /v1/{collection}/{id} with {{"cancelled": true}}'
_DELETE: Final = 'send PATCH to /v1/{collection}/{id} with {{"deleted": true}}'
_RESTORE: Final = 'send PATCH to /v1/{collection}/{id} with {{"deleted": false}}'
_FIELD: Final = "send GET to /v1/{collection}/{id}, whose answer has `state` and `result`"
_FILE: Final = "get a file with GET /v1/jobs/{id}/files/NAME: `links` of /v1/jobs/{id} has the names"
_RUNS: Final = "send GET to /v1/jobs?kind=run&{owner}={id}"
_SETS: Final = "send GET to /v1/measurement-sets?{owner}={id}"
_OF_ALL: Final = {"delete": _DELETE, "remove": _DELETE, "restore": _RESTORE}
_OF_JOBS: Final = {
    **_OF_ALL,
    **dict.fromkeys(("abort", "cancel", "stop"), _CANCEL),
    **dict.fromkeys(("joints", "progress", "result", "results", "state", "status"), _FIELD),
    **dict.fromkeys(("download", "file", "files"), _FILE),
    "apply": "send POST to /v1/runs/{id}/apply",
}
_OF_SETS: Final = {**_OF_ALL, "jobs": _RUNS, "runs": _RUNS}
_OF_ROBOTS: Final = {**_OF_SETS, **dict.fromkeys(("measurement-sets", "measurements", "sets"), _SETS)}
_UNKNOWN_PARTS: Final = {"jobs": _OF_JOBS, "measurement-sets": _OF_SETS, "robots": _OF_ROBOTS}
"""Collection → part of a resource that has no address → what to send."""


def _advise_part(parts: Sequence[str]) -> str | None:
    """Return what to send in place of a request to an unknown part of a resource; None without advice.

    `parts` are the version, the collection, the id, and the unknown part.
    """
    _, collection, identifier, part = parts
    if collection in _COLLECTIONS_OF_JOBS:
        collection = "jobs"
    advice = _UNKNOWN_PARTS.get(collection, {}).get(part)
    if advice is None:
        return None
    owner = "robot_id" if collection == "robots" else "measurement_set_id"
    return advice.format(collection=collection, id=identifier, owner=owner)


def _is_described(context: RouteContext) -> bool:
    """Return whether a route is in the description of the API."""
    route = context.original_route
    return isinstance(route, Route) and route.include_in_schema


_REQUESTS_OF_VERBS: Final = {
    "identify": "send the campaign with POST /v1/campaigns, which answers its run; identify a stored "
    'measurement set with POST /v1/runs {"measurement_set_id": …}',
    "import": "send the files with POST /v1/imports",
    "predict": "predict by a stored run with POST /v1/deflections",
    "trend": "get the trend of a robot with GET /v1/robots/{id}/trend",
    "measure": "send readings as they are measured to POST /v1/measurement-sets",
    "measurements": "use the address /v1/measurement-sets",
    "metrics": "start the service with --metrics-port, and get /metrics from this port",
    "events": "get the events of a job with GET /v1/jobs/{id}/events",
    "sets": "use the address /v1/measurement-sets",
    "swagger": "get the description of the API with GET /openapi.json",
    "report": "get the files of a job with GET /v1/jobs/{id}, whose `links` name them",
    "robots": "list the robots with GET /v1/robots, and the arms of the catalogue with GET /v1/catalogue",
}
"""Verb that is no collection → what to send."""


def _advise_verb(parts: Sequence[str]) -> str | None:
    """Return what to send in place of a request to an address with a verb; None without a known verb."""
    collections = {ROOMS[kind.name].command: kind.collection for kind in KINDS if kind.name in ROOMS}
    for part in parts:
        verb = find_verb(part) or part
        if verb in _REQUESTS_OF_VERBS:
            return _REQUESTS_OF_VERBS[verb]
        if verb in collections:
            return f"send POST to /v1/{collections[verb]}"
    return None


def _fill_in(template: list[str], parts: list[str]) -> str | None:
    """Return an address of a route that resembles the parts of an unknown address; None if it does not."""
    if len(template) != len(parts):
        return None
    filled = list(_fill_in_parts(template, parts))
    return f"/{'/'.join(filled)}" if len(filled) == len(parts) else None


def _fill_in_parts(template: list[str], parts: list[str]) -> Iterator[str]:
    """Yield the parts of an address of a route, up to the first part that the unknown address has not."""
    for known, part in zip(template, parts, strict=True):
        if _PARAMETER.fullmatch(known) and _IDENTIFIER.fullmatch(part):
            yield part
        elif get_close_matches(part.replace("_", "-"), [known], cutoff=_ALIKE):
            yield known
        else:
            return
