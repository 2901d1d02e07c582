"""Reader of documents as layouts up to 0018 packed them; numbers of a JSON text take eight bytes each.

The words of a text are compressed by zlib with a dictionary (`dictionary.txt`). Its numbers follow as IEEE
doubles in a second stream.
"""

from __future__ import annotations

import struct
from functools import cache
from pathlib import Path
from typing import Final

from pydantic_core import to_json

from jointstiff.service.problems import DamagedError
from jointstiff.service.store.compression import decode, decompress, decompress_first_stream

_NUMBER_PLACE: Final = "\x00"  # replaces a number; JSON texts have no such character


def is_packed(content: bytes) -> bool:
    """Return whether a stored text was packed: its stream needs the dictionary (FDICT of RFC 1950)."""
    return len(content) > 1 and bool(content[1] & 0x20)


def unpack_text(packed: bytes) -> str:
    """Return the text that was packed.

    Raises:
        DamagedError: the content is damaged, or too large.
    """
    words, packed_doubles = decompress_first_stream(packed, _read_dictionary())
    if not packed_doubles:
        return decode(words)
    pieces, doubles = decode(words).split(_NUMBER_PLACE), decompress(packed_doubles)
    if len(doubles) != 8 * (len(pieces) - 1):
        raise DamagedError
    numbers = _format_numbers(list(struct.unpack(f"<{len(pieces) - 1}d", doubles)))
    return "".join(piece for pair in zip(pieces, [*numbers, ""], strict=True) for piece in pair)


@cache
def _read_dictionary() -> bytes:
    """Return the dictionary of frequent words for zlib. It must not change: stored texts need it."""
    lines = Path(__file__).with_name("dictionary.txt").read_text(encoding="utf-8").splitlines()
    return "".join(lines).replace("#", _NUMBER_PLACE).encode()


def _format_numbers(numbers: list[float]) -> list[str]:
    """Return numbers as texts, formatted as pydantic formats them in the documents."""
    return to_json(numbers)[1:-1].decode().split(",") if numbers else []
