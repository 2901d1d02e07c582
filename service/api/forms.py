"""Forms with files (multipart/form-data, RFC 7578), kept in memory; incomplete ones are refused."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from typing import Final

from fastapi import HTTPException, Request
from starlette.datastructures import FormData, UploadFile
from starlette.formparsers import MultiPartException, MultiPartParser

from jointstiff.schemas.fields import MAX_NAME_LENGTH
from jointstiff.service.api.limits import MAX_BYTES, SMALL_BYTES
from jointstiff.solver.errors import RequestError

MAX_FILES: Final = 64
_MAX_TEXTS: Final = 8
"""Fields without a file name; more than one is refused by its name."""
_PLAIN: Final = frozenset({"7bit", "8bit", "binary"})
_TOO_LARGE: Final = ("Too many", "Part exceeded")


class _Parser(MultiPartParser):
    """Starlette's parser, which keeps files in memory and notices the closing boundary."""

    spool_max_size = max(MAX_BYTES.values())
    is_complete = False

    def on_end(self) -> None:
        """Note that the closing boundary has come."""
        self.is_complete = True


async def read_form(request: Request) -> FormData:
    """Read fields `files`, and `options` as text, even if it came as a file; `BodyLimits` limits the body.

    Raises:
        RequestError: the body is not such a form.
        HTTPException: the form has too many fields, or its options are too long (413).
    """

    async def whole() -> AsyncGenerator[bytes]:
        async for chunk in request.stream():
            yield chunk
        if not parser.is_complete:
            raise MultiPartException("The form does not end with its boundary.")

    limits = {"max_files": MAX_FILES + 1, "max_fields": _MAX_TEXTS, "max_part_size": SMALL_BYTES}
    parser = _Parser(request.headers, whole(), **limits)
    try:
        form = await parser.parse()
    except MultiPartException as error:
        if error.message.startswith(_TOO_LARGE):
            raise HTTPException(413, error.message) from None
        raise _malformed(error.message) from None
    try:
        _refuse_strange(form)
        fields = [
            (name, await _text(value) if name == "options" else value) for name, value in form.multi_items()
        ]
    except BaseException:
        await form.close()
        raise
    return FormData(fields)


def _refuse_strange(form: FormData) -> None:
    for name, value in form.multi_items():
        if name not in {"files", "options"}:
            name = name[:MAX_NAME_LENGTH]
            raise RequestError(
                f"a form has no field {name!r}",
                remedy="send only the fields `files` and `options`",
                where="body",
            )
        headers = value.headers if isinstance(value, UploadFile) else {}
        if headers.get("content-transfer-encoding", "binary").lower() not in _PLAIN:
            raise _malformed("a file has a Content-Transfer-Encoding")
        if name == "files" and isinstance(value, str):
            raise RequestError("a file has no name", remedy="send it with a `filename`", where="files")
    if len(form.getlist("options")) > 1:
        raise RequestError(
            "the field `options` is given twice",
            remedy="send one JSON document in `options`",
            where="options",
        )


async def _text(value: UploadFile | str) -> str:
    """Return the options as text."""
    if isinstance(value, str):
        return value
    content = await value.read()
    await value.close()
    if len(content) > SMALL_BYTES:
        raise HTTPException(413, f"the options exceed {SMALL_BYTES // 1024} KiB")
    try:
        return content.decode()
    except UnicodeDecodeError:
        raise RequestError(
            "the options are not UTF-8", remedy="send one JSON document in `options`", where="options"
        ) from None


def _malformed(reason: str) -> RequestError:
    return RequestError(
        reason, remedy="send multipart/form-data as browsers, curl -F and HTTP libraries do", where="body"
    )
