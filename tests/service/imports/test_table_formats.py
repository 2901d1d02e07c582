"""Formats of tables: each gives the same campaign, a bomb of each is refused, and no file runs anything."""

import io
import json
import pickle
import zipfile

import h5py
import numpy as np
import openpyxl
import pyarrow
import pytest
from pyarrow.parquet import write_table
from scipy.io import savemat
from support.importing_samples import CAMPAIGN, CAMPAIGN_NUMBERS, answered, numbers_of, sources_of

from jointstiff.service.imports.formats import read_files
from jointstiff.service.imports.tables import TableError

SHEET = "xl/worksheets/sheet1.xml"
HEADERS, *ROWS = [line.split(";") for line in CAMPAIGN.splitlines()[1:]]
VALUES = [[row[0], *map(float, row[1:])] for row in ROWS]
RECORDS = [dict(zip(HEADERS, row, strict=True)) for row in VALUES]
COLUMNS = {header: [row[header] for row in RECORDS] for header in HEADERS}


def text(delimiter, mark=".", encoding="utf-8"):
    lines = [HEADERS, *([row[0], *(cell.replace(".", mark) for cell in row[1:])] for row in ROWS)]
    return "\r\n".join(delimiter.join(line) for line in lines).encode(encoding)


def workbook(rows=VALUES, before=()):
    book = openpyxl.Workbook()
    for row in [*before, HEADERS, *rows]:
        book.active.append(row)
    output = io.BytesIO()
    book.save(output)
    return output.getvalue()


def hdf5(name="readings", **options):
    output = io.BytesIO()
    kinds = [(header, "S8" if header == "label" else float) for header in HEADERS]
    with h5py.File(output, "w") as file:
        rows = np.array([tuple(row) for row in VALUES], dtype=kinds)
        file.create_dataset(name, data=rows, **options)
    return output.getvalue()


def structured(save):
    output = io.BytesIO()
    kinds = [(header, "U8" if header == "label" else float) for header in HEADERS]
    save(output, np.array([tuple(row) for row in VALUES], dtype=kinds))
    return output.getvalue()


def parquet():
    output = io.BytesIO()
    write_table(pyarrow.table(COLUMNS), output)
    return output.getvalue()


def mat():
    output = io.BytesIO()
    names = [f"c{number}" for number in range(len(HEADERS))]
    savemat(output, {"t": dict(zip(names, COLUMNS.values(), strict=True))}, do_compression=True)
    return output.getvalue()


TEXTS = {
    "semicolons.csv": text(";"),
    "decimal_commas.csv": text(";", ","),
    "commas.csv": text(","),
    "tabs.txt": text("\t"),
    "bars.md": text("|"),
    "utf_16.csv": text(";", encoding="utf-16"),
    "marked.csv": b"\xef\xbb\xbf" + text(";"),
    "records.json": json.dumps(RECORDS).encode(),
    "lines.jsonl": "\n".join(map(json.dumps, RECORDS)).encode(),
    "columns.json": json.dumps(COLUMNS).encode(),
    "document.json": json.dumps({"operator": "A", "readings": RECORDS}).encode(),
}
PACKED = {
    "book.xlsx": workbook(),
    "titled.xlsx": workbook(before=[["Cell 3"], []]),
    "texts.xlsx": workbook(rows=[[row[0], *(cell.replace(".", ",") for cell in row[1:])] for row in ROWS]),
    "readings.h5": hdf5(),
    "zipped.h5": hdf5(compression="gzip"),
    "rows.npy": structured(np.save),
    "rows.npz": structured(lambda output, rows: np.savez(output, rows=rows)),
    "readings.parquet": parquet(),
}


@pytest.mark.parametrize(
    ("name", "content"),
    [*TEXTS.items(), *(pytest.param(*each, marks=pytest.mark.process) for each in PACKED.items())],
)
def test_each_format_gives_the_same_campaign(name, content):
    found = numbers_of(answered((name, content)))
    assert found == CAMPAIGN_NUMBERS


@pytest.mark.process
def test_the_fields_of_a_matlab_struct_are_the_columns_of_a_table():
    (table,) = read_files(sources_of(("readings.mat", mat())))
    assert [column.header for column in table.columns] == [f"t.c{n}" for n in range(len(HEADERS))]
    assert list(table.columns[4].cells) == [row[4] for row in VALUES]


def packed_xml(size):
    output = io.BytesIO()
    with zipfile.ZipFile(output, "w", zipfile.ZIP_DEFLATED) as archive:
        with zipfile.ZipFile(io.BytesIO(workbook())) as sound:
            for name in sound.namelist():
                if name != SHEET:
                    archive.writestr(name, sound.read(name))
        archive.writestr(SHEET, b"<sheetData>" + b"<row><c><v>1</v></c></row>" * size)
    return output.getvalue()


def zeros(save, shape=(30_000, 10_000)):
    output = io.BytesIO()
    save(output, np.zeros(shape, dtype=np.int8))
    return output.getvalue()


class Executed:
    """An object that writes a file when somebody unpickles it."""

    def __reduce__(self):
        return (open, ("executed", "w"))


def pickled():
    output = io.BytesIO()
    np.save(output, np.array([Executed()], dtype=object), allow_pickle=True)
    return output.getvalue()


def hdf5_of_zeros():
    output = io.BytesIO()
    with h5py.File(output, "w") as file:
        shape, chunks = (40_000_000, 8), (100_000, 8)
        file.create_dataset("zeros", shape=shape, dtype="f8", chunks=chunks, compression="gzip")
    return output.getvalue()


BOMBS = {
    "rows.csv": b"1;2\n" * 400_001,
    "columns.csv": (b"1;" * 300 + b"\n") * 5,
    "cells.csv": (b";".join([b"1"] * 250) + b"\n") * 4_100,
    "long.csv": b"a;b\n1;" + b"x" * 1_000_000 + b"\n1;2\n",
    "nested.json": b"[" * 100_000,
    "deep.json": b'{"a":' * 500 + b"1" + b"}" * 500,
    "null.csv": b"\0" * 1000,
}
PACKED_BOMBS = {
    "xml.xlsx": packed_xml(4_000_000),
    "no_zip.xlsx": b"PK\x03\x04" + b"\xff" * 5000,
    "empty.ods": b"",
    "old.xls": b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(range(256)) * 40,
    "zeros.npz": zeros(np.savez_compressed),
    "pickled.npy": pickled(),
    "short.npy": b"\x93NUMPY\x01\x00",
    "zeros.h5": hdf5_of_zeros(),
    "broken.h5": hdf5()[:700],
    "broken.mat": mat()[:300],
    "pickle.mat": pickle.dumps(Executed()),
    "broken.parquet": parquet()[:-300] + b"PAR1",
}


@pytest.mark.parametrize(
    ("name", "content"),
    [*BOMBS.items(), *(pytest.param(*each, marks=pytest.mark.process) for each in PACKED_BOMBS.items())],
    ids=[*BOMBS, *PACKED_BOMBS],
)
def test_a_bomb_of_each_format_is_refused_and_nothing_is_executed(name, content, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(TableError) as refused:
        read_files(sources_of((name, content)))
    assert refused.value.remedy
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("moves.src", b"DEF p()\nPTP HOME\nEND\n"),
        ("table.tex", b"\\begin{tabular}{l}\nlabel \\\\\n\\end{tabular}\n"),
        ("page.html", b"<html><body>no table</body></html>"),
        ("notes.md", b"# Readings\n\nThe arm was warm.\n"),
    ],
)
def test_what_is_no_table_is_refused_with_the_page_of_the_template(name, content):
    with pytest.raises(TableError, match="no table of numbers") as refused:
        read_files(sources_of((name, content)))
    assert refused.value.where == name
    assert "export the readings as a table" in refused.value.remedy
    assert "docs/import.md#a-table-of-your-own" in refused.value.remedy


def test_too_many_and_repeated_files_are_refused():
    with pytest.raises(TableError, match="65 files were sent"):
        read_files(sources_of(*((f"{number}.csv", f"{number};1\n") for number in range(65))))
    with pytest.raises(TableError, match="a file was sent twice"):
        read_files(sources_of(("a.csv", CAMPAIGN), ("b.csv", CAMPAIGN)))
    with pytest.raises(TableError, match="more than 8 MiB together"):
        read_files(sources_of(("a.csv", b"1;2\n" * (2 << 20)), ("b.csv", b"1;2;3\n")))
