"""Columns of documents: JSON texts, and other bytes, compressed by zlib."""

from __future__ import annotations

from typing import Annotated, Any

import sqlalchemy as sa
from pydantic_core import from_json, to_json

from jointstiff.service.history.raising import raise_document
from jointstiff.service.store.compression import compress, compress_text, decode, decompress
from jointstiff.service.store.packing import is_packed, unpack_text


def read_text(content: bytes) -> str:
    """Return a stored text, whatever layout stored the text.

    Raises:
        DamagedError: the content is damaged, or too large.
    """
    return unpack_text(content) if is_packed(content) else decode(decompress(content))


def raise_text(kind: str, text: str, version: int) -> str:
    """Return the JSON text of a document of an earlier version, raised to today's shape.

    Args:
        kind: kind of the document.
        text: JSON text; a text that is no JSON object is returned unchanged, as its reader will refuse it.
        version: version of the document.
    """
    try:
        document = from_json(text)
        is_object = isinstance(document, dict)
        return to_json(raise_document(kind, document, version).document).decode() if is_object else text
    except ValueError:
        return text


class CompressedText(sa.TypeDecorator[str]):
    """Column type for texts that are stored compressed."""

    impl = sa.LargeBinary
    cache_ok = True

    def process_bind_param(self, value: str | None, _: sa.Dialect) -> bytes | None:
        """Compress a text for the database."""
        return None if value is None else compress_text(value)

    def process_result_value(self, value: Any | None, _: sa.Dialect) -> str | None:  # noqa: ANN401 - of either driver
        """Decompress a text from the database."""
        return None if value is None else read_text(bytes(value))


class CompressedBytes(sa.TypeDecorator[bytes]):
    """Column type for bytes that are stored compressed."""

    impl = sa.LargeBinary
    cache_ok = True

    def process_bind_param(self, value: bytes | None, _: sa.Dialect) -> bytes | None:
        """Compress bytes for the database."""
        return None if value is None else compress(value)

    def process_result_value(self, value: Any | None, _: sa.Dialect) -> bytes | None:  # noqa: ANN401 - of either driver
        """Decompress bytes from the database."""
        return None if value is None else decompress(bytes(value))


Document = Annotated[str, CompressedText()]
"""Field for a text that no listing shows; its column is compressed, and comes after all others."""
Content = Annotated[bytes, CompressedBytes()]
"""Field for bytes that no listing shows; its column is compressed, and comes after all others."""
