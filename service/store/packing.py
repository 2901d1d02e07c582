"""Compression of stored documents; numbers of a JSON text take eight bytes each."""

from __future__ import annotations

import re
import struct
import zlib
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Final

import sqlalchemy as sa
from pydantic_core import to_json

from jointstiff.service.problems import DamagedError

MOST_BYTES: Final = 512 * 1024 * 1024
"""Greatest size of an unpacked document [bytes]; no request is half as large."""
_NUMBER: Final = re.compile(r"(?<=[\[,:])(-?\d+(?:\.\d+(?:e-?\d+)?|e-?\d+))(?=[\],}])", re.ASCII)
_NUMBER_PLACE: Final = "\x00"  # replaces a number; JSON texts have no such character
_LEVEL: Final = 6  # level of compression


def pack_text(text: str) -> bytes:
    """Compress a text; the JSON of a run shrinks to a quarter.

    Numbers of JSON are stored as IEEE doubles in a second stream, if they convert back to the same text.
    The compression knows frequent words, mostly names of fields, in advance (`dictionary.txt`).
    """
    pieces = _NUMBER.split(text)  # texts and numbers in turn: every second piece is a number
    numbers = list(map(float, pieces[1::2]))
    if _NUMBER_PLACE in text or _format_numbers(numbers) != pieces[1::2]:
        return _pack_words(text)
    doubles = struct.pack(f"<{len(numbers)}d", *numbers)
    return _pack_words(_NUMBER_PLACE.join(pieces[::2])) + zlib.compress(doubles, _LEVEL)


def unpack_text(packed: bytes) -> str:
    """Return the text that `pack_text` compressed.

    Raises:
        DamagedError: the content is damaged, or larger than `MOST_BYTES`.
    """
    words, packed_doubles = _decompress_first_stream(packed)
    if not packed_doubles:
        return words.decode()
    pieces, doubles = words.decode().split(_NUMBER_PLACE), unpack_bytes(packed_doubles)
    if len(doubles) != 8 * (len(pieces) - 1):
        raise DamagedError
    numbers = _format_numbers(list(struct.unpack(f"<{len(pieces) - 1}d", doubles)))
    return "".join(piece for pair in zip(pieces, [*numbers, ""], strict=True) for piece in pair)


def unpack_bytes(packed: bytes) -> bytes:
    """Decompress bytes.

    Raises:
        DamagedError: the content is damaged, or larger than `MOST_BYTES`.
    """
    return _decompress_first_stream(packed)[0]


def _pack_words(words: str) -> bytes:
    """Compress a text with the dictionary of frequent words."""
    stream = zlib.compressobj(_LEVEL, zdict=_read_dictionary())
    return stream.compress(words.encode()) + stream.flush()


@cache
def _read_dictionary() -> bytes:
    """Return the dictionary of frequent words for zlib. It must not change: stored texts need it."""
    lines = Path(__file__).with_name("dictionary.txt").read_text(encoding="utf-8").splitlines()
    return "".join(lines).replace("#", _NUMBER_PLACE).encode()


def _decompress_first_stream(packed: bytes) -> tuple[bytes, bytes]:
    """Decompress the first stream of zlib; return its content, and the bytes after it.

    Raises:
        DamagedError: the stream is damaged, or its content larger than `MOST_BYTES`.
    """
    stream = zlib.decompressobj(zdict=_read_dictionary())
    try:
        content = stream.decompress(packed, MOST_BYTES)
    except zlib.error as error:
        raise DamagedError from error
    if not stream.eof:
        raise DamagedError
    return content, stream.unused_data


def _format_numbers(numbers: list[float]) -> list[str]:
    """Return numbers as texts, formatted as pydantic formats them in the documents."""
    return to_json(numbers)[1:-1].decode().split(",") if numbers else []


class PackedText(sa.TypeDecorator[str]):
    """Column type for texts that are stored compressed."""

    impl = sa.LargeBinary
    cache_ok = True

    def process_bind_param(self, value: str | None, _: sa.Dialect) -> bytes | None:
        """Compress a text for the database."""
        return None if value is None else pack_text(value)

    def process_result_value(self, value: Any | None, _: sa.Dialect) -> str | None:  # noqa: ANN401 - of either driver
        """Decompress a text from the database."""
        return None if value is None else unpack_text(bytes(value))


class PackedBytes(sa.TypeDecorator[bytes]):
    """Column type for bytes that are stored compressed."""

    impl = sa.LargeBinary
    cache_ok = True

    def process_bind_param(self, value: bytes | None, _: sa.Dialect) -> bytes | None:
        """Compress bytes for the database."""
        return None if value is None else zlib.compress(value, _LEVEL)

    def process_result_value(self, value: Any | None, _: sa.Dialect) -> bytes | None:  # noqa: ANN401 - of either driver
        """Decompress bytes from the database."""
        return None if value is None else unpack_bytes(bytes(value))


Document = Annotated[str, PackedText()]
"""Field for a text that no listing shows; its column is compressed, and comes after all others."""
Content = Annotated[bytes, PackedBytes()]
"""Field for bytes that no listing shows; its column is compressed, and comes after all others."""
