"""Documents as the store keeps them, today and in layout 0018: exact, and bounded when they are read."""

import json
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic_core import to_json
from support.packed import pack_text

import jointstiff as js
from jointstiff.service.problems import DamagedError
from jointstiff.service.store import compression
from jointstiff.service.store.compression import compress, compress_text, decompress
from jointstiff.service.store.documents import read_text
from jointstiff.service.store.packing import unpack_text
from jointstiff.simulator import default_arm, simulate_campaign

NUMBERS = st.floats(allow_nan=False, allow_infinity=False) | st.integers() | st.none() | st.booleans()
DOCUMENTS = st.recursive(
    NUMBERS | st.text(st.characters(exclude_categories=["Cs"])),
    lambda inner: st.lists(inner) | st.dictionaries(st.text("abc:,[]1.e-"), inner),
    max_leaves=30,
)
OF_TODAY_AND_PACKED = pytest.mark.parametrize("store", [compress_text, pack_text], ids=["today", "packed"])


@given(DOCUMENTS)
def test_a_document_comes_back_to_the_last_digit(document):
    text = to_json(document).decode()
    assert read_text(pack_text(text)) == text
    assert read_text(compress_text(text)) == text


@OF_TODAY_AND_PACKED
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
def test_a_text_that_pydantic_did_not_write_comes_back_too(store, text):
    assert read_text(store(text)) == text


@given(DOCUMENTS)
def test_programs_of_layout_0018_read_what_is_stored_today(document):
    """Their reader, which is kept, took any stream of zlib: so both versions work on one database."""
    text = to_json(document).decode()
    assert unpack_text(compress_text(text)) == text


@pytest.fixture(scope="module")
def run_text():
    """JSON of a run of 19 configurations: some 37 kB."""
    campaign = simulate_campaign(default_arm(), configurations=19, load="pull", seed=1)
    return js.identify(campaign).model_dump_json()


def test_a_long_document_is_a_stream_of_zlib_and_shorter_than_by_its_defaults(run_text):
    stored = compress_text(run_text)
    assert zlib.decompress(stored).decode() == unpack_text(stored) == run_text
    assert len(stored) < 0.95 * len(zlib.compress(run_text.encode(), 6))


def test_a_long_document_that_is_damaged_is_refused(run_text):
    stored = compress_text(run_text)
    changed = bytearray(stored)
    changed[1_000] ^= 0x10
    for damaged in (stored[:-1], bytes(changed)):
        with pytest.raises(DamagedError, match="damaged"):
            read_text(damaged)


@OF_TODAY_AND_PACKED
def test_what_unpacks_to_more_than_any_document_is_refused(store, monkeypatch):
    monkeypatch.setattr(compression, "MOST_BYTES", 1_000)
    assert len(read_text(store("x" * 1_000))) == 1_000
    with pytest.raises(DamagedError, match="damaged"):
        read_text(store("x" * 1_001))
    with pytest.raises(DamagedError, match="damaged"):
        decompress(zlib.compress(bytes(1_001)))


@OF_TODAY_AND_PACKED
def test_a_damaged_document_is_refused(store):
    stored = store('{"stiffness":[1.25,2.5]}')
    words = store('{"stiffness":[1.25]}')
    for damaged in (b"", stored[:-1], stored[:9], b"\xff" + stored[1:], words[:20], compress(b"\xff")):
        with pytest.raises(DamagedError, match="damaged"):
            read_text(damaged)
