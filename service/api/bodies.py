"""Request bodies, JSON or forms: parsed strictly by the route, before FastAPI looks at them."""

from __future__ import annotations

import gc
import hashlib
from collections.abc import AsyncGenerator, Awaitable, Callable, Coroutine, Iterator, Mapping, Set
from contextlib import contextmanager, suppress
from typing import Annotated, Any, ClassVar, Final

from anyio import CapacityLimiter
from anyio.to_thread import run_sync
from fastapi import Body, Depends, Header, HTTPException, Request, Response, params
from fastapi.exceptions import RequestValidationError
from fastapi.openapi.models import Example
from pydantic import BaseModel
from starlette.datastructures import FormData, Headers, UploadFile
from starlette.formparsers import MultiPartException, MultiPartParser

from jointstiff.schemas.fields import MAX_NAME_LENGTH
from jointstiff.schemas.measurement import MeasurementSetDocument, MeasurementSetRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import Campaign
from jointstiff.service.conversion.parsing import (
    NOT_JSON,
    USE_ARRAYS,
    MalformedError,
    parse,
)
from jointstiff.service.security.access import AccessRoute
from jointstiff.service.security.admission import MAX_BYTES, SMALL_BYTES, SPLIT_BODY, refuse_structure
from jointstiff.service.store.tables import IdempotencyKey
from jointstiff.solver.errors import RequestError

MAX_KEY_LENGTH: Final = 255
MAX_FILES: Final = 64
_MAX_TEXT_FIELDS: Final = 8
"""Greatest number of fields without a file name; `_check_fields` refuses more than one and names it."""
_ALLOWED_ENCODINGS: Final = frozenset({"7bit", "8bit", "binary"})
_TOO_LARGE: Final = ("Too many", "Part exceeded")


def json_body(examples: Mapping[str, Any]) -> Any:  # noqa: ANN401 - as FastAPI has it
    """Return FastAPI's declaration of a JSON body; its description shows `examples` with their names."""
    return Body(openapi_examples={name: Example(value=value) for name, value in examples.items()})


Handler = Callable[[Request], Coroutine[Any, Any, Response]]


class BodyRoute(AccessRoute):
    """Route that parses and validates its body before FastAPI, which still describes the body.

    FastAPI would parse on the event loop, list faults without limit, and accept any media type.
    """

    takes_files: ClassVar[bool] = False
    """Whether the address of this route for JSON takes a file in a form, too."""

    def get_route_handler(self) -> Handler:
        """Return a handler that parses the body and then calls FastAPI's handler."""
        handle = super().get_route_handler()
        field = self.body_field
        if field is None:
            return handle
        is_form = isinstance(field.field_info, params.Form)
        # Media type, and its name in an error message
        json_words = _COLUMNS_OR_FORM if self.takes_files else "JSON"
        media_type_and_words = (
            ("multipart/form-data", _A_FORM) if is_form else ("application/json", json_words)
        )
        message: type[BaseModel] = field.field_info.annotation  # type: ignore[assignment]

        async def handle_parsed(request: Request) -> Response:
            """Parse the body and let FastAPI handle the request, unless the child process answers it."""
            require_media_type(request, *media_type_and_words)
            if (child_answer := await _answer_by_child(request)) is not None:
                return await self.finish_child_answer(request, child_answer)
            if is_form:  # FastAPI takes the form or the JSON that Starlette's request has stored
                request._form = await read_form(request)
            else:
                request._json = await read_json(request, message)
            return await handle(request)

        return handle_parsed

    async def finish_child_answer(self, _: Request, response: Response) -> Response:
        """Return the answer that the child process gave to the request; subclasses may change it."""
        return response


_A_FORM: Final = "a form of the fields `files` and `options`, as curl -F does"
_COLUMNS_OR_FORM: Final = f"a file in {_A_FORM} (multipart/form-data); or send columns as JSON"


_TABLES: Final = frozenset(
    (
        "application/vnd.ms-excel",
        "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
        "multipart/form-data",
        "text/csv",
        "text/tab-separated-values",
    )
)
"""Media types in which programs send tables."""


async def read_json(request: Request, message: type[BaseModel]) -> BaseModel:
    """Parse a JSON body as a message; large bodies are parsed in a limited number of threads.

    Raises:
        HTTPException: the body is too large (413).
        RequestValidationError: the body does not have the form of the message.
    """
    content = await request.body()
    if len(content) <= SMALL_BYTES:
        return parse_body(message, content)
    limiter: CapacityLimiter = request.app.state.parsers
    return await run_sync(parse_body, message, content, limiter=limiter)


async def _answer_by_child(request: Request) -> Response | None:
    """Return the answer of the child process that parses large bodies; None if this process has to answer."""
    child: Callable[[Request], Awaitable[Response | None]] | None = request.app.state.answer_elsewhere
    return None if child is None else await child(request)


def limiter_of_large_work(request: Request) -> CapacityLimiter:
    """Return the limiter of the number of threads for large work, such as reading big files."""
    limiter: CapacityLimiter = request.app.state.large_bodies
    return limiter


KeyText = Annotated[
    str | None,
    Header(
        min_length=1,
        max_length=MAX_KEY_LENGTH,
        description="Any text that identifies the request, for safe retries: the same body with the same "
        "key returns the resource that the first request created.",
    ),
]
"""Text of an idempotency key."""


def bind_key(key: str | None, body: bytes) -> IdempotencyKey | None:
    """Return an idempotency key with the hash of the body with which it was sent; None without a key."""
    return None if key is None else IdempotencyKey(key, hashlib.sha256(body).hexdigest())


_NAMES_OF_FILES: Final = frozenset(("file", "files[]", "file[]", "upload", "data", "attachment", "program"))
"""Names that forms elsewhere have for files."""


async def _read_idempotency_key(request: Request, idempotency_key: KeyText = None) -> IdempotencyKey | None:
    """Return the idempotency key of a request, with the hash of its body; None without a key."""
    return None if idempotency_key is None else bind_key(idempotency_key, await request.body())


Key = Annotated[IdempotencyKey | None, Depends(_read_idempotency_key)]
"""Idempotency key of a request, bound to the bytes of its body."""


def require_media_type(request: Request, media_type: str, words: str) -> None:
    """Refuse (415) a compressed body or one of another media type; `words` names the type in the error."""
    coding = request.headers.get("content-encoding", "identity").strip().lower()
    if coding != "identity":
        raise HTTPException(
            415, f"the body has the Content-Encoding {coding[:40]!r}; send the body without that header"
        )
    stated = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if stated != media_type:
        reason = (
            f"the body has the Content-Type {stated[:80]!r}" if stated else "the body has no Content-Type"
        )
        if stated in _TABLES and words == "JSON":
            words = f"a table to POST /v1/imports, in {_A_FORM}; or send JSON"
        raise HTTPException(415, f"{reason}; send {words}, with the header Content-Type: {media_type}")


def parse_body(message: type[BaseModel], content: bytes) -> BaseModel:
    """Parse a JSON body as a message, and validate it; the parser limits the depth to 200.

    Raises:
        HTTPException: the body has too large a structure (413).
        RequestValidationError: the body does not have the form of the message.
        RequestError: the body is no text in UTF-8, or a document of another kind.
    """
    is_set = issubclass(message, Campaign | MeasurementSetDocument)
    refuse_structure(content, USE_ARRAYS if is_set else SPLIT_BODY)
    try:
        with garbage_collector_paused():
            return parse(message, content)
    except MalformedError as error:
        if error.keys is NOT_JSON:
            _refuse_file(content)
            _refuse_no_text(content)
        elif not error.keys:
            _refuse_encoded_twice(content)
        _refuse_other_document(message, content, error.keys)
        raise RequestValidationError(error.faults) from None


def _refuse_other_document(message: type[BaseModel], content: bytes, keys: Set[str]) -> None:
    """Refuse a body that is a valid document of another kind than the expected message.

    Only a kind whose names of fields fit the `keys` of the body is tried.

    Raises:
        RequestError: the body is a valid document of another kind; the remedy names the address for it.
    """
    for other, kind, remedy in _DOCUMENTS:
        fields = other.model_fields
        required = {name for name, field in fields.items() if field.is_required()}
        is_expected = issubclass(other, message) or issubclass(message, other)
        if is_expected or not required <= keys <= fields.keys():
            continue
        with suppress(MalformedError):
            parse(other, content)
            raise RequestError(f"the body is {kind}", remedy=remedy, where="body")


_DOCUMENTS: Final = (
    (RobotDocument, "a robot", "send the robot with POST /v1/robots"),
    (Campaign, "a campaign", "send the campaign with POST /v1/campaigns"),
    (
        MeasurementSetRequest,
        "a measurement set of a stored robot",
        "send the measurement set with POST /v1/measurement-sets",
    ),
    (
        MeasurementSetDocument,
        "a measurement set without a robot",
        "add `robot_id` and send the set with POST /v1/measurement-sets, or send it with its robot as "
        '{"robot": …, "measurement_set": …} with POST /v1/campaigns',
    ),
)
"""Documents that a program may send to the wrong address: class, kind, and what to do."""


def _refuse_no_text(content: bytes) -> None:
    """Refuse a body that is empty, or a text in another encoding than UTF-8.

    Raises:
        RequestError: the body is such a body.
    """
    if not content.strip():
        raise RequestError("the body is empty", remedy="send a JSON document as the body", where="body")
    try:
        is_utf_8 = "\0" not in content.decode()
    except UnicodeDecodeError:
        is_utf_8 = False
    if not is_utf_8:
        raise RequestError(
            "the body of the request is not a text in UTF-8",
            remedy="send the JSON document in UTF-8",
            where="body",
        )


_SEND_FILES: Final = (
    "send tables and point lists as `files` of a form with POST /v1/imports, and a URDF as the text `urdf` "
    "of a robot's model"
)


def _refuse_file(content: bytes) -> None:
    """Refuse a body that is a file of a known type, such as a workbook.

    Raises:
        RequestError: names the type of the file.
    """
    if content.startswith(_GZIP):
        raise RequestError("the body is compressed", remedy="send the document uncompressed", where="body")
    if content.startswith(_ZIP):
        reason = "the body is a workbook or an archive, not a JSON document"
        raise RequestError(reason, remedy=_SEND_FILES, where="body")


_GZIP: Final = b"\x1f\x8b"
"""First bytes of what gzip compressed."""
_ZIP: Final = b"PK\x03\x04"
"""First bytes of workbooks and archives."""


def _refuse_encoded_twice(content: bytes) -> None:
    """Refuse a JSON document that was written as a text into another JSON document.

    Raises:
        RequestError: the body is such a text.
    """
    text = content.strip()
    if text.startswith(b'"{') or text.startswith(b'"['):
        raise RequestError(
            "the body is a JSON document in quotes: it was encoded twice",
            remedy="encode the document once: `json=document`, not `json=json.dumps(document)`",
            where="body",
        )


@contextmanager
def garbage_collector_paused() -> Iterator[None]:
    """Pause the garbage collector in the block: it would inspect a million new lists again and again.

    These inspections would take five times as long as the parser and stop all other threads. If two blocks
    overlap, the collector runs again when the first block ends.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


class _Parser(MultiPartParser):
    """Starlette's parser of forms, which keeps files in memory and refuses a form without its end."""

    spool_max_size = max(MAX_BYTES.values())

    def __init__(self, headers: Headers, stream: AsyncGenerator[bytes], **limits: int) -> None:
        super().__init__(headers, self._yield_all(stream), **limits)
        self._is_complete = False

    def on_end(self) -> None:
        """Note that the closing boundary of the form was read."""
        self._is_complete = True

    async def _yield_all(self, chunks: AsyncGenerator[bytes]) -> AsyncGenerator[bytes]:
        """Yield the parts of the body.

        Raises:
            MultiPartException: the body ends before the closing boundary.
        """
        async for chunk in chunks:
            yield chunk
        if not self._is_complete:
            raise MultiPartException("The form does not end with its boundary.")


async def read_form(request: Request) -> FormData:
    """Read a form, and return its fields `files` and `options`; `options` as text, even if sent as a file.

    Raises:
        RequestError: the body is not a form with these fields.
        HTTPException: the form has too many fields, or its options are too long (413).
    """
    # One file more than allowed, as the options may be sent as a file.
    limits = {"max_files": MAX_FILES + 1, "max_fields": _MAX_TEXT_FIELDS, "max_part_size": SMALL_BYTES}
    try:
        form = await _Parser(request.headers, request.stream(), **limits).parse()
    except MultiPartException as error:
        if error.message.startswith(_TOO_LARGE):
            raise HTTPException(413, error.message) from None
        raise _malformed_form(error.message) from None
    try:
        _check_fields(form)
        fields = [
            (name, await _decode_options(value) if name == "options" else value)
            for name, value in form.multi_items()
        ]
    except BaseException:
        await form.close()
        raise
    return FormData(fields)


def _check_fields(form: FormData) -> None:
    """Check that a form has only `files` with names, and `options` at most once.

    Raises:
        RequestError: a field is unknown, repeated, encoded, or a file without a name.
    """
    for name, value in form.multi_items():
        if name not in {"files", "options"}:
            name = name[:MAX_NAME_LENGTH]
            raise RequestError(
                f"the form has an unknown field {name!r}",
                remedy=f"send only the fields `files` and `options`; {_name_right_field(name, value)}",
                where="body",
            )
        headers = value.headers if isinstance(value, UploadFile) else {}
        if headers.get("content-transfer-encoding", "binary").lower() not in _ALLOWED_ENCODINGS:
            raise _malformed_form("a file has an unsupported Content-Transfer-Encoding")
        if name == "files" and isinstance(value, str):
            remedy = "send the file with a `filename`"
            if "." in value and "\n" not in value.strip():
                remedy += f": with curl, `-F files=@{value.strip()[:40]}`"
            raise RequestError("a file has no name", remedy=remedy, where="files")
    if len(form.getlist("options")) > 1:
        raise RequestError(
            "the field `options` is given twice",
            remedy="send one JSON document in `options`",
            where="options",
        )


def _name_right_field(name: str, value: UploadFile | str) -> str:
    """Return what to do with a field of a form that is neither `files` nor `options`.

    Args:
        name: name of the field.
        value: a file is meant as one of `files`, an object as `options`, another text as an option.
    """
    if isinstance(value, UploadFile):
        return f"send the file as `files`, not as `{name}`"
    text = value.strip()
    if text.startswith("{"):
        return f"send the JSON object as `options`, not as `{name}`"
    if name in _NAMES_OF_FILES:
        return f"send the file as `files`, with its content: with curl, `-F files=@{text[:40] or 'FILE'}`"
    return f'`options` is one JSON object of all options, such as {{"{name}": …}}'


async def _decode_options(value: UploadFile | str) -> str:
    """Return the options as text, without a byte order mark."""
    if isinstance(value, str):
        return value.removeprefix("\ufeff")
    content = await value.read()
    await value.close()
    if len(content) > SMALL_BYTES:
        raise HTTPException(413, f"the options exceed {SMALL_BYTES // 1024} KiB")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise RequestError(
            "the options are not UTF-8", remedy="send one JSON document in `options`", where="options"
        ) from None


def _malformed_form(reason: str) -> RequestError:
    """Return the error for a body that is not a valid form; `reason` says why."""
    return RequestError(
        reason, remedy="send multipart/form-data as browsers, curl -F and HTTP libraries do", where="body"
    )
