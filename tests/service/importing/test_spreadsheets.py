"""Spreadsheets in OpenDocument: read like Excel workbooks, and within their limits."""

import io
import zipfile

import pytest
from support.importing_samples import CAMPAIGN, read, refusals

SPACES = " ".join(
    f'xmlns:{name}="urn:oasis:names:tc:opendocument:xmlns:{name}:1.0"' for name in ("office", "table", "text")
)
ROWS = [line.split(";") for line in CAMPAIGN.splitlines() if not line.startswith("#")]


def cell(text, repeat=1, more=""):
    repeated = f'table:number-columns-repeated="{repeat}" ' if repeat != 1 else ""
    if text.lstrip("-").replace(".", "", 1).isdigit():
        # what is shown is rounded; what is stored counts
        type_, shown = f'office:value-type="float" office:value="{text}"', text[:3]
    else:
        type_, shown = 'office:value-type="string"', f"{text[:1]}<text:span>{text[1:]}</text:span>"
    return f"<table:table-cell {repeated}{more}{type_}><text:p>{shown}</text:p></table:table-cell>"


def row(*cells, repeat=1):
    repeated = f' table:number-rows-repeated="{repeat}"' if repeat != 1 else ""
    return f"<table:table-row{repeated}>{''.join(cells)}</table:table-row>"


EMPTY = row('<table:table-cell table:number-columns-repeated="16384"/>', repeat=1_000_000)


def spreadsheet(*rows, head="", more=""):
    table = f'<table:table table:name="Data">{"".join(rows)}</table:table>'
    body = f"<office:body><office:spreadsheet>{table}{more}</office:spreadsheet></office:body>"
    text = f'<?xml version="1.0"?>{head}<office:document-content {SPACES}>{body}</office:document-content>'
    output = io.BytesIO()
    with zipfile.ZipFile(output, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        archive.writestr("content.xml", text)
    return output.getvalue()


def data(rows=ROWS):
    return [row(*map(cell, cells)) for cells in rows]


def test_a_spreadsheet_is_read_like_the_text_of_its_stored_values():
    spread = read(("a.ods", spreadsheet(*data(), EMPTY)))
    expected = read(("a.csv", CAMPAIGN))
    assert [each.values.keys() for each in spread.observations] == [
        each.values.keys() for each in expected.observations
    ]
    for own, other in zip(spread.observations, expected.observations, strict=True):
        assert own.label == other.label
        assert [value.vector for value in own.values.values()] == [
            value.vector for value in other.values.values()
        ]


def test_rows_in_groups_below_empty_rows_have_their_lines():
    grouped = f"<table:table-row-group>{''.join(data(ROWS[1:]))}</table:table-row-group>"
    header = f"<table:table-header-rows>{data(ROWS[:1])[0]}</table:table-header-rows>"
    spread = read(("a.ods", spreadsheet(row("<table:table-cell/>", repeat=4), header, grouped)))
    assert spread.preview.files[0].header_lines == [5]
    assert spread.preview.files[0].first_lines[0] == 6


def test_a_repeated_number_is_in_each_of_its_cells():
    rows = data()
    rows[1] = row(cell(ROWS[1][0]), cell("1.5", repeat=len(ROWS[1]) - 1))
    assert read(("a.ods", spreadsheet(*rows))).preview.files[0].first_rows[0][1:] == ["1.5"] * (
        len(ROWS[1]) - 1
    )


ENTITY = '<!DOCTYPE a [<!ENTITY b "bbbbbbbb">]>'
NO_NUMBER = cell("7.5").replace('office:value="7.5"', 'office:value="1e9999x"')
HOSTILE = {
    "more than 500000 cells": spreadsheet(row(cell("1"), repeat=9_999_999)),
    "500000 cells": spreadsheet(*[row(cell("1", repeat=250), repeat=900)] * 3),
    "more than 256 columns": spreadsheet(row(cell("1", repeat=16384))),
    "256 columns": spreadsheet(row("<table:table-cell/>" * 300, cell("1"))),
    "is no number of repeated rows": spreadsheet(row(cell("1"), repeat=10**12)),
    "is no number of repeated columns": spreadsheet(row(cell("1", repeat=-4))),
    "declares a document type": spreadsheet(*data(), head=ENTITY),
    "two sheets with the same name": spreadsheet(*data(), more='<table:table table:name="Data"/>'),
    "in place of a number": spreadsheet(*data(), row(NO_NUMBER)),
    "more than 256 characters": spreadsheet(*data(), row(cell("a" * 300))),
    "elements or 64 levels": spreadsheet("<table:table-row-group>" * 70 + "</table:table-row-group>" * 70),
    "more than 100 times as large": spreadsheet(row(cell("a" * 3_000_000))),
}


@pytest.mark.parametrize("said", HOSTILE)
def test_a_hostile_spreadsheet_is_refused_in_a_sentence(said):
    assert said in refusals(("a.ods", HOSTILE[said]))[0]


def test_a_text_document_is_no_spreadsheet():
    output = io.BytesIO()
    with zipfile.ZipFile(output, "w") as archive:
        archive.writestr("content.xml", f"<office:document-content {SPACES}/>")
    assert "the file has no sheet" in refusals(("a.odt", output.getvalue()))[0]


def test_an_error_of_a_formula_is_no_number():
    rows = data()
    rows[2] = rows[2].replace(cell(ROWS[2][3]), cell("#DIV/0!", more='table:formula="of:=1/0" '))
    assert "#DIV/0!" in refusals(("a.ods", spreadsheet(*rows)))[0]
