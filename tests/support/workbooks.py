"""Workbooks and tables to import: ordinary ones, and archives that mean harm."""

import io
import zipfile

import numpy as np
import openpyxl
import pytest
from scipy.io import savemat
from support.importing_samples import CAMPAIGN

SHEET = "xl/worksheets/sheet1.xml"
ROWS = [line.split(";") for line in CAMPAIGN.splitlines()[1:]]


def rows_of_values():
    return [ROWS[0], *([row[0], *map(float, row[1:])] for row in ROWS[1:])]


def workbook(rows=None, change=lambda _book, _sheet: None):
    book = openpyxl.Workbook()
    for row in rows_of_values() if rows is None else rows:
        book.active.append(row)
    change(book, book.active)
    output = io.BytesIO()
    book.save(output)
    return output.getvalue()


def arrays(**variables):
    """Return a .mat file with matrices, and lists of texts as cell arrays."""
    output = io.BytesIO()
    is_list = lambda each: isinstance(each, list) and isinstance(each[0], str)  # noqa: E731
    savemat(output, {
        name: np.array(each, dtype=object).reshape(-1, 1) if is_list(each) else each
        for name, each in variables.items()
    }, do_compression=True)  # fmt: skip
    return output.getvalue()


def hdf5(fill):
    """Return an HDF5 file that a function fills; the test is skipped without h5py."""
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    output = io.BytesIO()
    with h5py.File(output, "w") as file:
        fill(file)
    return output.getvalue()


def parquet(columns, **options):
    """Return a Parquet file of columns by their names; the test is skipped without pyarrow."""
    pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    from pyarrow.parquet import write_table

    output = io.BytesIO()
    write_table(pa.table(columns), output, **options)
    return output.getvalue()


def repacked(content, name, change):
    """The same workbook with one part changed, and its checksums right."""
    output = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(content)) as old,
        zipfile.ZipFile(output, "w", zipfile.ZIP_DEFLATED) as new,
    ):
        for part in old.namelist():
            data = old.read(part)
            new.writestr(part, change(data) if part == name else data)
    return output.getvalue()


def bomb(size, name=SHEET, parts=1):
    output = io.BytesIO()
    with zipfile.ZipFile(output, "w", zipfile.ZIP_DEFLATED) as archive:
        for number in range(parts):
            archive.writestr(name if parts == 1 else f"{number}/{name}", b" " * size)
    return output.getvalue()


def table_of(campaign):
    """The readings of a campaign document as a table in m, rad and N; forces where a load was read."""
    observations = campaign["measurement_set"]["observations"]
    targets = [reading["target"] for reading in observations[0]["readings"]]
    states = [state for state in ("unloaded", "loaded") if state in observations[0]["readings"][0]]
    header = ["label", *(f"J{i} [rad]" for i in range(1, 7))]
    header += [f"F{axis} [N]" for axis in "xyz"] if "loaded" in states else []
    header += [f"{t} {s} {axis} [m]" for t in targets for s in states for axis in "xyz"]
    rows = [header]
    for one in observations:
        numbers = [*one["joints"], *(one["force"] if "loaded" in states else ())]
        for reading in one["readings"]:
            numbers += [number for state in states for number in reading[state]]
        rows.append([one["label"], *map(repr, numbers)])
    return "\n".join(";".join(row) for row in rows).encode()


def workbook_of_sheets(**sheets):
    """Return a workbook with the rows of each sheet."""

    def add(book, first):
        for name, rows in sheets.items():
            sheet = book.create_sheet(name)
            for row in rows:
                sheet.append(row)
        book.remove(first)

    return workbook([["x"]], add)
