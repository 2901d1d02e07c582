"""Documents as programs of layout 0018 packed them: the writer of what `store/packing.py` reads."""

import re
import struct
import zlib

from pydantic_core import to_json

from jointstiff.service.store.packing import _read_dictionary

NUMBER = re.compile(r"(?<=[\[,:])(-?\d+(?:\.\d+(?:e-?\d+)?|e-?\d+))(?=[\],}])", re.ASCII)


def pack_text(text: str) -> bytes:
    """Pack a text: numbers of JSON as IEEE doubles, if they convert back to the same text."""
    pieces = NUMBER.split(text)  # texts and numbers in turn: every second piece is a number
    numbers = list(map(float, pieces[1::2]))
    if "\x00" in text or (to_json(numbers)[1:-1].decode().split(",") if numbers else []) != pieces[1::2]:
        return pack_words(text)
    doubles = struct.pack(f"<{len(numbers)}d", *numbers)
    return pack_words("\x00".join(pieces[::2])) + zlib.compress(doubles, 6)


def pack_words(words: str) -> bytes:
    stream = zlib.compressobj(6, zdict=_read_dictionary())
    return stream.compress(words.encode()) + stream.flush()
