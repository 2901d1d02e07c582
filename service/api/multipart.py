"""Forms with files (multipart/form-data, RFC 7578), hostile until parsed: strict, and in linear time.

The body is complete and of limited size by then (`bodies.read_content`), so that no part of it is ever kept
in a file, and what is not quite such a form is refused instead of guessed at.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from fastapi import HTTPException

from jointstiff.solver.errors import RequestError

__all__ = ["MAX_HEADER_BYTES", "MAX_PARTS", "Part", "read_parts"]

MAX_PARTS: Final = 65
"""Of a form: 64 files, and options."""
MAX_HEADER_BYTES: Final = 4096
"""Headers of a part together."""
_MAX_BOUNDARY: Final = 70
"""RFC 2046, 5.1.1."""
_PLAIN: Final = frozenset({"7bit", "8bit", "binary"})
_END: Final = b"\r\n"

_PARAMETER: Final = re.compile(
    r""";[ \t]*(?P<name>[A-Za-z0-9!#$%&'*+.^_`|~-]+)=
        (?:"(?P<quoted>(?:[^"\\]|\\.)*)"|(?P<plain>[^\s;"\\]+))[ \t]*""",
    re.VERBOSE,
)
_ESCAPED: Final = re.compile(r'\\(["\\])')
"""Other backslashes stand for themselves, as in names of files of long ago."""


@dataclass(frozen=True)
class Part:
    """One field of a form.

    Attributes:
        name: of the field.
        file_name: without folders, as the client called it; None if it is no file.
        content: its bytes.
    """

    name: str
    file_name: str | None
    content: bytes


def read_parts(content_type: str, content: bytes) -> list[Part]:
    """Take a form apart.

    Args:
        content_type: the header of the request.
        content: its body.

    Raises:
        HTTPException: it is not declared as a form (415), or has too many parts (413).
        RequestError: it is not such a form.
    """
    delimiter = _END + b"--" + _boundary(content_type)
    body = _END + content  # the first delimiter may begin the body
    if body.count(delimiter) > MAX_PARTS + 1:
        raise HTTPException(413, f"the form has more than {MAX_PARTS} parts; send less at once")
    _, *parts = body.split(delimiter)
    if not parts or not parts[-1].startswith(b"--"):
        raise _malformed("the form does not end with its boundary")
    return [_part(part) for part in parts[:-1]]


def _boundary(content_type: str) -> bytes:
    media_type, parameters = _parameters(content_type)
    if media_type != "multipart/form-data":
        raise HTTPException(415, "send a form, with the header Content-Type: multipart/form-data")
    boundary = parameters.get("boundary", "")
    if not (0 < len(boundary) <= _MAX_BOUNDARY and boundary.isascii() and boundary.isprintable()):
        raise _malformed(f"a form has a boundary of 1 to {_MAX_BOUNDARY} characters in its Content-Type")
    return boundary.encode("ascii")


def _part(text: bytes) -> Part:
    """One part, from the end of its delimiter to the next one."""
    padding, end, rest = text.partition(_END)
    if padding.strip(b" \t") or not end:
        raise _malformed("a boundary is not alone on its line")
    block, end, content = rest.partition(_END + _END)
    if not end or len(block) > MAX_HEADER_BYTES:
        raise _malformed(f"a part has no headers, or more than {MAX_HEADER_BYTES} bytes of them")
    headers = _headers(block)
    kind, parameters = _parameters(headers.get("content-disposition", ""))
    if kind != "form-data" or not parameters.get("name"):
        raise _malformed("a part has no `Content-Disposition: form-data; name=...`")
    if headers.get("content-transfer-encoding", "binary").lower() not in _PLAIN:
        raise _malformed("a part has a transfer encoding")
    file_name = parameters.get("filename")
    return Part(parameters["name"], None if file_name is None else _without_folders(file_name), content)


def _headers(block: bytes) -> dict[str, str]:
    try:
        lines = block.decode("utf-8").split("\r\n")
    except UnicodeDecodeError:
        raise _malformed("the headers of a part are not UTF-8") from None
    headers = {}
    for line in lines:
        name, colon, value = line.partition(":")
        if not colon or name != name.strip() or not name:
            raise _malformed("a header of a part is none")
        headers[name.lower()] = value.strip()
    return headers


def _parameters(header: str) -> tuple[str, dict[str, str]]:
    """A header's value and its parameters.

    Raises:
        RequestError: there is something else behind them.
    """
    value, semicolon, rest = header.partition(";")
    rest = semicolon + rest
    found: dict[str, str] = {}
    position = 0
    while (match := _PARAMETER.match(rest, position)) is not None:
        quoted = match["quoted"]
        text = match["plain"] if quoted is None else _ESCAPED.sub(r"\1", quoted)
        found.setdefault(match["name"].lower(), text)
        position = match.end()
    if rest[position:].strip("; \t"):
        raise _malformed("the parameters of a header are none")
    return value.strip().lower(), found


def _without_folders(name: str) -> str:
    return name.replace("\\", "/").rpartition("/")[2]


def _malformed(reason: str) -> RequestError:
    return RequestError(
        reason, remedy="send multipart/form-data as browsers, curl -F and HTTP libraries do", where="body"
    )
