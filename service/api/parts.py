"""Vocabulary of the routes: the parts of the application, and the descriptions of answers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Final, cast

from fastapi import APIRouter, Depends, Path, Request, Response
from pydantic import BaseModel

from jointstiff.schemas.problem import Problem
from jointstiff.service.api.access import OPERATOR
from jointstiff.service.jobs.parts import Parts


def _parts(request: Request) -> Parts:
    return cast("Parts", request.app.state.parts)


PartsOf = Annotated[Parts, Depends(_parts)]


def json_response(text: str, status: int = 200) -> Response:
    """Return a stored document as it is, without parsing it again."""
    return Response(text, status, media_type="application/json")


def created(collection: str, identifier: str, text: str, status: int = 201) -> Response:
    """Return a resource with its address."""
    response = json_response(text, status)
    response.headers["Location"] = f"/v1/{collection}/{identifier}"
    return response


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Describe the errors a route may answer with, for OpenAPI; those of access and 503 are some of each."""
    schema = {"$ref": f"#/components/schemas/{Problem.__name__}"}
    return {
        status: {
            "description": _DESCRIPTIONS[status],
            "content": {"application/problem+json": {"schema": schema}},
        }
        for status in sorted({*statuses, 401, 403, 429, 503})
    }


def accepted(message: type[BaseModel]) -> dict[int | str, dict[str, Any]]:
    """Describe the answer to a post that takes longer, for OpenAPI."""
    return {
        202: {
            "description": "Stored but not finished: poll its address, or follow its events.",
            "headers": {
                "Location": {"description": "Address of the resource.", "schema": {"type": "string"}}
            },
            "model": message,
        }
    }


def add_deletion(
    router: APIRouter,
    address: str,
    name: str,
    message: type[BaseModel],
    *,
    delete: Callable[[Parts, str], object],
    restore: Callable[[Parts, str], str],
    description: str,
) -> None:
    """Add the routes that delete and restore a resource.

    Args:
        router: to add to.
        address: of one resource, with its id in braces, such as `/robots/{robot_id}`.
        name: of the resource in names of operations.
        message: what `restore` answers.
        delete: delete the resource of an id.
        restore: restore it, and return it as JSON.
        description: of the deletion.
    """
    identifier = Annotated[str, Path(alias=address.partition("{")[2].removesuffix("}"), max_length=64)]

    def delete_resource(parts: PartsOf, identifier: str) -> Response:
        delete(parts, identifier)
        return Response(status_code=204)

    def restore_resource(parts: PartsOf, identifier: str) -> Response:
        return json_response(restore(parts, identifier))

    for route in (delete_resource, restore_resource):
        route.__annotations__["identifier"] = identifier  # which FastAPI reads
    router.delete(
        address,
        name=f"delete_{name}",
        dependencies=[OPERATOR],
        description=description,
        status_code=204,
        response_class=Response,
        responses=_DELETED | problems(404, 409, 422),
    )(delete_resource)
    router.post(
        f"{address}/restore",
        name=f"restore_{name}",
        dependencies=[OPERATOR],
        description=f"Restore a deleted {name.replace('_', ' ')}. One that is not deleted stays as it is.",
        response_model=message,
        responses=problems(404, 422),
    )(restore_resource)


_DELETED: Final[dict[int | str, dict[str, Any]]] = {
    204: {"description": "Deleted. `restore` undoes this for 30 days."}
}

LOCATION: Final[dict[int | str, dict[str, Any]]] = {
    201: {
        "description": "Stored.",
        "headers": {"Location": {"description": "Address of the resource.", "schema": {"type": "string"}}},
    }
}

_DESCRIPTIONS: Final = {
    400: "The client disconnected before its body was complete.",
    401: "A key is needed, and the request has no valid one.",
    403: "The key's role does not allow this, or a page of another site requested a change.",
    404: "The resource does not exist.",
    409: "The resource's state does not allow this; see `remedy`.",
    413: "The body is too large.",
    415: "The body has the wrong Content-Type.",
    422: "The request is invalid: `where` names the field, `remedy` says what to do.",
    507: "The database has reached its quota.",
    429: "The queue is full, or too many wrong keys were sent; try again later.",
    503: "The database is not available; try again later.",
}
