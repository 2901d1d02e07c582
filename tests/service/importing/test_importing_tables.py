"""Campaign tables: what is understood, and what is refused, where and with which remedy."""

import pytest
from support import importing_samples as samples
from support.examples import is_full
from support.importing_samples import CAMPAIGN, MM, read
from support.memory import peak_of

from jointstiff.service.conversion.parsing import MAX_SET_BYTES
from jointstiff.service.importing import grid
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.grid import MAX_COLUMNS, MAX_FILE_BYTES


def refused(content, *, name="a.csv", **stated):
    return samples.refused((name, content), **stated)


def test_limits(monkeypatch):
    assert MAX_FILE_BYTES == MAX_SET_BYTES
    assert (grid.MAX_ROWS, grid.MAX_LINES) == (320_000, 400_000)
    big = [(str(index), b"a" * (MAX_FILE_BYTES // 2 + 1)) for index in range(2)]
    with pytest.raises(ImportFileError, match="exceed 8 MiB"):
        read(*big)
    for files in ([], [(str(index), b"a") for index in range(65)]):
        with pytest.raises(ImportFileError, match="1 to 64 files"):
            read(*files)
    with pytest.raises(ImportFileError, match="two files have this name"):
        read(*[("a", b"a")] * 2)
    refused(";".join("a" * (MAX_COLUMNS + 1)), reason="more than 256 columns", line=1)
    refused(b"a" * 70_000, reason="a line has more than", line=1)
    refused(b'"' + b"a" * 20_000, reason="quotation marks", line=1)
    monkeypatch.setattr(grid, "MAX_ROWS", 300)
    refused(b"a\n" * 301, reason="more than 300 rows", line=301)
    monkeypatch.setattr(grid, "MAX_LINES", 400)
    refused(b"\n" * 400 + b"a b\r\n", reason="more than 400 lines together")
    read(("a.csv", (CAMPAIGN + "\n" * 201).replace("\n", "\r\n").encode("utf-16")))


@pytest.mark.parametrize(
    "content",
    [
        b"ab\n" * 2_700_000,
        (b";".join([b"11"] * 250) + b"\n") * 11_000,
        (b"# " + b"11," * 250 + b"\n") * 11_000 + b"P1,1,2,3\n",
        b"no_state_in_this_name 1 2 3\n" * 50_000,
    ],
    ids=["lines", "cells", "cells of comments", "unclear names"],
)
@pytest.mark.process
def test_what_is_refused_takes_little_memory(content):
    peak, outcome = peak_of(lambda: read(("a.csv", content), units=MM))
    assert outcome == "ImportFileError"
    assert peak < 100


@pytest.mark.parametrize(
    "content",
    [
        b";" * 65_000,
        b'""' * 30_000,
        b"\t" * 60_000 + b"a",
        b"#" * 100_000,
        b"a;b\n" * (100_000 if is_full() else 10_000),
        b"\r" * 10_000 + b"x",
    ],
)
def test_hostile_texts(content):
    with pytest.raises(ImportFileError):
        read(("a.csv", content))
