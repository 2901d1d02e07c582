"""Compression of stored texts and bytes by zlib (RFC 1950), which every language reads."""

from __future__ import annotations

import zlib
from typing import Final

from jointstiff.service.problems import DamagedError

MOST_BYTES: Final = 512 * 1024 * 1024
"""Greatest size of a decompressed document [bytes]; no request is half as large."""
_LEVEL: Final = 6  # level of compression
_LONG_TEXT: Final = 12_000  # bytes
_MEMORY_LEVEL: Final = 5  # of long texts: blocks of some 4 kB of the stream


def compress(content: bytes) -> bytes:
    """Compress bytes."""
    return zlib.compress(content, _LEVEL)


def compress_text(text: str) -> bytes:
    """Compress a text as a stream of zlib.

    A long text is mostly numbers of 17 digits, whose short repetitions cost more than they save. Together
    with tables of frequencies for each short block, a run needs 7 % fewer bytes than by zlib's defaults.
    """
    content = text.encode()
    if len(content) < _LONG_TEXT:
        return compress(content)
    stream = zlib.compressobj(_LEVEL, zlib.DEFLATED, zlib.MAX_WBITS, _MEMORY_LEVEL, zlib.Z_FILTERED)
    return stream.compress(content) + stream.flush()


def decompress(content: bytes) -> bytes:
    """Decompress bytes.

    Raises:
        DamagedError: the content is damaged, or larger than `MOST_BYTES`.
    """
    return decompress_first_stream(content)[0]


def decompress_first_stream(content: bytes, dictionary: bytes = b"") -> tuple[bytes, bytes]:
    """Decompress the first stream of zlib; return its content, and the bytes after the stream.

    Args:
        content: the stream, and more bytes.
        dictionary: text that the compression knew in advance; used only by streams that need a dictionary.

    Raises:
        DamagedError: the stream is damaged, or its content larger than `MOST_BYTES`.
    """
    stream = zlib.decompressobj(zdict=dictionary)
    try:
        decompressed = stream.decompress(content, MOST_BYTES)
    except zlib.error as error:
        raise DamagedError from error
    if not stream.eof:
        raise DamagedError
    return decompressed, stream.unused_data


def decode(text: bytes) -> str:
    """Decode a text of UTF-8.

    Raises:
        DamagedError: the text is damaged.
    """
    try:
        return text.decode()
    except UnicodeDecodeError as error:
        raise DamagedError from error
