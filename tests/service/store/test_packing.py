"""Documents as the store keeps them: small, exact, and bounded when they are read."""

import json
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic_core import to_json

from jointstiff.service.problems import DamagedError
from jointstiff.service.store import packing
from jointstiff.service.store.packing import pack_text, unpack_bytes, unpack_text

NUMBERS = st.floats(allow_nan=False, allow_infinity=False) | st.integers() | st.none() | st.booleans()
DOCUMENTS = st.recursive(
    NUMBERS | st.text(st.characters(exclude_categories=["Cs"])),
    lambda inner: st.lists(inner) | st.dictionaries(st.text("abc:,[]1.e-"), inner),
    max_leaves=30,
)


@given(DOCUMENTS)
def test_a_document_comes_back_to_the_last_digit(document):
    text = to_json(document).decode()
    assert unpack_text(pack_text(text)) == text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        "no JSON",
        '{"number":1.50}',  # which pydantic writes as 1.5
        "[1.0,2.50,1e5]",
        "[1e999]",
        "[0.1,\x00,0.2]",
        '["1.10.0",3.25]',
        json.dumps([0.5, -0.0, 5e-324, 1.7976931348623157e308]),
    ],
)
def test_a_text_that_pydantic_did_not_write_comes_back_too(text):
    assert unpack_text(pack_text(text)) == text


def test_a_number_takes_its_eight_bytes_and_not_its_digits():
    numbers = [(1.0 / 3.0) ** n for n in range(1, 501)]
    text = to_json(numbers).decode()
    assert len(text) > 9_000
    assert len(pack_text(text)) < 8 * len(numbers) + 100


def test_what_unpacks_to_more_than_any_document_is_refused(monkeypatch):
    monkeypatch.setattr(packing, "MOST_BYTES", 1_000)
    assert len(unpack_text(pack_text("x" * 1_000))) == 1_000
    for packed in (pack_text("x" * 1_001), zlib.compress(bytes(1_001))):
        with pytest.raises(DamagedError, match="damaged"):
            unpack_bytes(packed)


def test_a_damaged_document_is_refused():
    packed = pack_text('{"stiffness":[1.25,2.5]}')
    words = pack_text('{"stiffness":[1.25]}')
    for damaged in (b"", packed[:-1], packed[:9], b"\xff" + packed[1:], words[:20]):
        with pytest.raises(DamagedError, match="damaged"):
            unpack_text(damaged)
