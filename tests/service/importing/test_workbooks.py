"""Workbooks: which sheet and cells are read, what is refused, and archives that mean harm."""

import datetime
import io
import re
import zipfile

import pytest
from support.importing_samples import CAMPAIGN_NUMBERS, answered, numbers_of, points_of, read, refusals
from support.workbooks import SHEET, bomb, repacked, rows_of_values, workbook

from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.formats.excel import MAX_XML_TAGS, Archive
from jointstiff.service.importing.limits import MAX_UNPACKED_BYTES

SAVE_AGAIN = "open the file in Excel and save it again as .xlsx, or save the sheet as CSV"
ENTER = (
    "enter a number, and format the cell as a number; replace a formula without a stored value by its value"
)
TEXTS = "xl/sharedStrings.xml"


def edited(old, new):
    """Return the workbook with its sheet changed."""
    return "a.xlsx", repacked(workbook(), SHEET, lambda data: data.replace(old, new))


def with_cell(value, form="General"):
    """Return the workbook with another value in C3."""

    def put(_book, sheet):
        sheet["C3"] = value
        sheet["C3"].number_format = form

    return "a.xlsx", workbook(change=put)


@pytest.mark.parametrize(
    "form", ["0.000", '0.00 "mm"', "0.00E+00", "#,##0.00_-;[Red]-#,##0.00", "@", "General"]
)
def test_the_format_of_a_number_does_not_matter(form):
    def formatted(_book, sheet):
        for row in sheet.iter_rows(min_row=2, min_col=2):
            for cell in row:
                cell.number_format = form

    answer = answered(("a.xlsx", workbook(change=formatted)))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert (answer.files[0].format, answer.files[0].assumptions) == ("xlsx", [])


def test_a_column_that_is_left_out_may_have_any_cell():
    values = ["date", datetime.date(2026, 11, 20), "=1/0", True]
    rows = [[*row, value] for row, value in zip(rows_of_values(), values, strict=True)]
    assert numbers_of(answered(("a.xlsx", workbook(rows)))) == CAMPAIGN_NUMBERS


def test_the_sheet_is_stated_where_several_have_data():
    def repeated(book, sheet):
        more = book.create_sheet("again")
        for row in sheet.iter_rows(values_only=True):
            more.append(row)

    file = "a.xlsx", workbook(change=repeated)
    assert refusals(file) == [
        "a.xlsx: several sheets have data: 'Sheet, again'; give `sheet`; separate several names by "
        "semicolons [sheet]"
    ]
    assert refusals(file, sheet="Tabelle1") == [
        "a.xlsx: the workbook has no sheet 'Tabelle1'; give one of 'Sheet, again' as `sheet` [sheet]"
    ]
    assert answered(file, show_faults=True).faults[0].words == ["Sheet", "again"]
    assert numbers_of(answered(file, sheet="Sheet")) == CAMPAIGN_NUMBERS


def test_the_cells_of_all_sheets_are_limited_together(monkeypatch):
    """Each of several sheets was once read in full before the question which one to read."""
    monkeypatch.setattr("jointstiff.service.importing.formats.excel.MAX_SHEET_CELLS", 300)

    def repeated(book, sheet):
        for number in range(10):
            more = book.create_sheet(f"again {number}")
            for row in sheet.iter_rows(values_only=True):
                more.append(row)

    read_parts = []
    elements = Archive.elements

    def noted(archive, name, *wanted):
        for element in elements(archive, name, *wanted):
            read_parts.append((name, element))
            yield element

    monkeypatch.setattr(Archive, "elements", noted)
    file = "a.xlsx", workbook(change=repeated)
    (refusal,) = refusals(file)
    assert "several sheets have data" in refusal
    rows = sum("worksheets" in name for name, _ in read_parts)
    assert rows < 11 * 3
    assert numbers_of(answered(file, sheet="Sheet")) == CAMPAIGN_NUMBERS


def test_sheets_without_a_table_are_named_and_not_read():
    def noted(book, sheet):
        sheet.title = "data"
        info = book.create_sheet("Info", 0)
        for row in [("Load", "120 kg"), ("Load CG", 120, "mm"), ("Units", "mm, deg")]:
            info.append(row)
        book.create_sheet("notes")["A1"] = "windy"

    answer = answered(("a.xlsx", workbook(change=noted)))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.files[0].assumptions == ["the sheets 'Info', 'notes' have no table, and were not read"]


def test_comments_and_empty_rows_are_skipped_and_hidden_rows_are_read():
    def hidden(_book, sheet):
        sheet.row_dimensions[3].hidden = True

    commented = answered(("a.xlsx", workbook([["# day 1"], [], *rows_of_values(), [], ["% end"]])))
    assert numbers_of(commented) == CAMPAIGN_NUMBERS
    assert commented.files[0].assumptions == ["comments were skipped (2 rows), the first in row 1"]
    answer = answered(("a.xlsx", workbook(change=hidden)))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.files[0].assumptions == ["1 rows or columns are hidden in the sheet, and were read as well"]


def test_the_stored_value_of_a_formula_is_used_and_told():
    answer = answered(edited(b'<c r="C3" t="n"><v>', b'<c r="C3"><f>B3*2</f><v>'))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.files[0].assumptions == ["the stored values of formulas were used (1 cells)"]


def test_the_size_that_a_sheet_states_does_not_matter():
    wrong = edited(b'<dimension ref="A1:M4"', b'<dimension ref="A1:B2"')
    assert numbers_of(answered(wrong)) == CAMPAIGN_NUMBERS


@pytest.mark.parametrize(
    ("cell", "kind"),
    [
        (with_cell("=B2+1"), "formula: '= …'"),
        (with_cell(45000.5, "dd.mm.yyyy"), "date: '45000.5'"),
        (with_cell(0.5, "0.00%"), "percentage: '0.5'"),
        (with_cell(True), "truth value: '1'"),
        (with_cell("#DIV/0!"), "error: '#DIV/0!'"),
        (with_cell("none yet"), "text: 'none yet'"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_cell_of_another_type_is_no_number(cell, kind):
    assert refusals(cell) == [f"a.xlsx:3:3: a number is needed, but the cell has type {kind}; {ENTER}"]


def with_shared_texts(content):
    """Return a workbook whose texts are in a part of their own, as Excel writes them; cells have numbers."""
    texts = list[bytes]()

    def numbered(match):
        texts.append(match[1])
        return b't="s"><v>%d</v></c>' % (len(texts) - 1)

    kind = b"http://schemas.openxmlformats.org/officeDocument/2006/relationships/sharedStrings"
    relation = b'<Relationship Type="%s" Target="sharedStrings.xml" Id="rIdT"/></Relationships>' % kind
    inline = rb't="inlineStr"><is>(<t>[^<]*</t>)</is></c>'
    content = repacked(content, SHEET, lambda data: re.sub(inline, numbered, data))
    relations = "xl/_rels/workbook.xml.rels"
    content = repacked(content, relations, lambda data: data.replace(b"</Relationships>", relation))
    output = io.BytesIO(content)
    with zipfile.ZipFile(output, "a") as archive:
        items = b"".join(b"<si>%s</si>" % text for text in texts)
        space = b"http://schemas.openxmlformats.org/spreadsheetml/2006/main"
        archive.writestr(TEXTS, b'<sst xmlns="%s">%s</sst>' % (space, items))
    return output.getvalue()


def test_texts_in_a_part_of_their_own_are_read_without_their_pronunciation():
    content = with_shared_texts(workbook())
    pieces = b"<r><t>c</t></r><r><t>01</t></r><rPh><t>x</t></rPh>"
    in_pieces = repacked(content, TEXTS, lambda data: data.replace(b"<t>c01</t>", pieces))
    for each in (content, in_pieces):
        assert numbers_of(answered(("a.xlsx", each))) == CAMPAIGN_NUMBERS
    other = repacked(content, TEXTS, lambda _: b'<sst xmlns="urn:other"><si><t>a</t></si></sst>')
    assert refusals(("a.xlsx", other)) == [
        f"a.xlsx:1:1: a cell refers to the shared text '0', which the workbook does not contain; {SAVE_AGAIN}"
    ]


def related(kind):
    """Return a workbook without a relation to its parts of a kind."""
    kinds = b"relationships/" + kind, b"relationships/styles"
    return repacked(workbook(), "xl/_rels/workbook.xml.rels", lambda data: data.replace(*kinds))


def lying():
    """Return a workbook with a sheet of 80 MiB that states a size of 10 bytes."""
    size = 80 << 20
    content = repacked(workbook(), SHEET, lambda _: b" " * size)
    assert content.count(size.to_bytes(4, "little")) == 2
    return content.replace(size.to_bytes(4, "little"), (10).to_bytes(4, "little"))


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (
            lambda: b"PK\x03\x04" + b"x" * 1000,
            "the file is not an Excel file (.xlsx), or is damaged (BadZipFile)",
        ),
        (lambda: workbook()[:-30], "the file is not an Excel file (.xlsx), or is damaged (BadZipFile)"),
        (lying, "the file is not an Excel file (.xlsx), or is damaged (BadZipFile)"),
        (lambda: bomb(MAX_UNPACKED_BYTES + 1), "the file has more than 64 MiB when it is unpacked"),
        (lambda: bomb(MAX_UNPACKED_BYTES // 8, parts=9), "the file has more than 64 MiB when it is unpacked"),
        (lambda: bomb(1, parts=1001), "the file has more than 1000 parts, or two parts with the same name"),
        (
            lambda: bomb(10),
            "the file is not an Excel file (.xlsx): it has no part 'xl/_rels/workbook.xml.rels'",
        ),
        (
            lambda: related(b"worksheet"),
            "the workbook has no sheet, or more than one part with shared texts or with styles",
        ),
        (
            lambda: related(b"theme"),
            "the workbook has no sheet, or more than one part with shared texts or with styles",
        ),
    ],
)
def test_an_archive_that_means_harm_is_refused(made, said):
    assert refusals(("a.xlsx", made())) == [f"a.xlsx: {said}; {SAVE_AGAIN}"]


@pytest.mark.parametrize(
    "part", [SHEET, TEXTS, "xl/workbook.xml", "xl/styles.xml", "xl/_rels/workbook.xml.rels"]
)
def test_no_part_may_define_entities(part):
    ten = b"".join(b'<!ENTITY %c "%s">' % (98 + number, b"&%c;" % (97 + number) * 10) for number in range(8))
    harm = b'<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">' + ten + b"]><a>&i;</a>"
    assert refusals(("a.xlsx", repacked(with_shared_texts(workbook()), part, lambda _: harm))) == [
        f"a.xlsx: part '{part}' declares an XML document type, which is not allowed; {SAVE_AGAIN}"
    ]


def test_the_tags_of_all_parts_are_counted_together():
    archive = Archive(
        "a.xlsx", repacked(workbook(), SHEET, lambda _: b"<a>" + b"<b/>" * 98 + b"</a>"), "a file"
    )
    archive.count_tags("xl/styles.xml", MAX_XML_TAGS - 100)
    assert list(archive.elements(SHEET, "row")) == []
    with pytest.raises(ImportFileError) as caught:
        list(archive.elements(SHEET, "row"))
    assert str(caught.value) == (
        f"'a.xlsx': the file has more than 2500000 XML tags up to part '{SHEET}'; {SAVE_AGAIN}"
    )


def test_the_preview_shows_numbers_as_excel_does_and_the_import_keeps_all_digits():
    values = rows_of_values()
    values[1] = [*values[1][:2], -69.95999999999999, *values[1][3:7], 841.8997000000001, *values[1][8:]]
    file = "a.xlsx", workbook(values)
    first_row = answered(file).files[0].first_rows[0]
    assert (first_row[2], first_row[7]) == ("-69.96", "841.8997")
    assert points_of(read(file))["c01", "P10", "unloaded"][0] == 841.8997000000001
