"""What the routes are handed: the parts of the application, and the vocabulary of their parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Final, cast

from fastapi import Depends, Request, Response

from schemas.problem import Problem
from service.measurement_sets import MeasurementSets
from service.robots import Robots
from service.runs import Runs
from service.store import Store

__all__ = [
    "LOCATION",
    "Parts",
    "PartsOf",
    "created",
    "json_response",
    "problems",
]


@dataclass(frozen=True)
class Parts:
    """The application's parts, composed once."""

    store: Store
    robots: Robots
    sets: MeasurementSets
    runs: Runs

    @classmethod
    def of(cls, store: Store) -> Parts:
        """Compose the parts on a store."""
        robots = Robots(store)
        sets = MeasurementSets(store, robots)
        return cls(store, robots, sets, Runs(store, sets))


def _parts(request: Request) -> Parts:
    return cast("Parts", request.app.state.parts)


PartsOf = Annotated[Parts, Depends(_parts)]


def json_response(text: str, status: int = 200) -> Response:
    """A stored document as it is, without parsing it again."""
    return Response(text, status, media_type="application/json")


def created(collection: str, identifier: str, text: str) -> Response:
    """201 with the resource and its address."""
    response = json_response(text, 201)
    response.headers["Location"] = f"/v1/{collection}/{identifier}"
    return response


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The OpenAPI description of the errors a route may answer with; 503 is one of each."""
    schema = {"$ref": f"#/components/schemas/{Problem.__name__}"}
    return {
        status: {
            "description": _DESCRIPTIONS[status],
            "content": {"application/problem+json": {"schema": schema}},
        }
        for status in (*statuses, 503)
    }


LOCATION: Final[dict[int | str, dict[str, Any]]] = {
    201: {
        "description": "Stored.",
        "headers": {"Location": {"description": "Address of the resource.", "schema": {"type": "string"}}},
    }
}

_DESCRIPTIONS: Final = {
    400: "The client left before its body was complete.",
    404: "There is no such resource.",
    413: "The body is too large.",
    415: "The body is not declared as JSON.",
    422: "The request cannot be carried out; `where` names the field and `remedy` how to mend it.",
    503: "The database does not answer.",
}
