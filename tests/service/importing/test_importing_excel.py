"""Excel files: as openpyxl writes them, and as those do who mean harm."""

import datetime
import io
import re
import time
import zipfile

import openpyxl
import pytest
from support import importing_samples as samples
from support.importing_samples import CAMPAIGN, points_of, read
from support.memory import peak_of
from support.workbooks import SHEET, bomb, repacked, rows_of_values, workbook

from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.excel import MAX_UNPACKED_BYTES, MAX_XML_TAGS, Archive

TEXTS = "xl/sharedStrings.xml"


def as_excel_writes(content):
    """Texts in a part of their own, which cells refer to by number; openpyxl writes them into the cells."""
    texts = []

    def number(match):
        texts.append(match[1])
        return b't="s"><v>%d</v></c>' % (len(texts) - 1)

    def relate(data):
        kind = b"http://schemas.openxmlformats.org/officeDocument/2006/relationships/sharedStrings"
        relation = b'<Relationship Type="%s" Target="sharedStrings.xml" Id="rIdT"/>' % kind
        return data.replace(b"</Relationships>", relation + b"</Relationships>")

    pattern = rb't="inlineStr"><is>(<t>[^<]*</t>)</is></c>'
    content = repacked(content, SHEET, lambda data: re.sub(pattern, number, data))
    content = repacked(content, "xl/_rels/workbook.xml.rels", relate)
    output = io.BytesIO(content)
    with zipfile.ZipFile(output, "a") as archive:
        archive.writestr(
            TEXTS,
            b'<sst xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main">'
            + b"".join(b"<si>%s</si>" % text for text in texts)
            + b"</sst>",
        )
    return output.getvalue()


def refused(content, reason, line=None, column=None, **options):
    return samples.refused(("a.xlsx", content), reason=reason, line=line, column=column, **options)


@pytest.mark.parametrize(
    "number_format", ["0.000", '0.00 "mm"', "0.00E+00", "#,##0.00_-;[Red]-#,##0.00", "@", "General"]
)
def test_formats_of_numbers(number_format):
    def change(_, sheet):
        for row in sheet.iter_rows(min_row=2, min_col=2):
            for cell in row:
                cell.number_format = number_format

    assert points_of(read(("a.xlsx", workbook(change=change)))) == points_of(read(("a.csv", CAMPAIGN)))


def test_columns_left_out_may_hold_anything():
    rows = [[*row, value] for row, value in zip(
        rows_of_values(), ["date", datetime.date(2026, 11, 20), "=1/0", True], strict=True)]  # fmt: skip
    assert points_of(read(("a.xlsx", workbook(rows)))) == points_of(read(("a.csv", CAMPAIGN)))


@pytest.mark.parametrize("far", [b"XFD3", b"IV1048576"])
def test_a_cell_far_from_the_others(far):
    """Which made python-calamine 0.9 abort the process."""
    refused(repacked(workbook(), SHEET, lambda data: data.replace(b'r="M4"', b'r="%s"' % far)), "", 4, 12)


def test_texts_by_number():
    content = as_excel_writes(workbook())
    assert points_of(read(("a.xlsx", content))) == points_of(read(("a.csv", CAMPAIGN)))
    missing = repacked(content, TEXTS, lambda _: b'<sst xmlns="urn:other"><si><t>a</t></si></sst>')
    with pytest.raises(ImportFileError, match="unknown text '0'"):
        read(("a.xlsx", missing))
    pieces = b"<r><t>c</t></r><r><t>01</t></r><rPh><t>x</t></rPh>"
    phonetic = repacked(content, TEXTS, lambda data: data.replace(b"<t>c01</t>", pieces))
    assert points_of(read(("a.xlsx", phonetic))) == points_of(read(("a.csv", CAMPAIGN)))


def related(kind):
    """A workbook with tables of styles in place of another part."""
    old, new = (b"relationships/" + each for each in (kind, b"styles"))
    return repacked(workbook(), "xl/_rels/workbook.xml.rels", lambda data: data.replace(old, new))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"PK\x03\x04", "not an Excel file"),
        (b"PK\x03\x04" + b"x" * 1000, "not an Excel file"),
        (workbook()[:-30], "not an Excel file"),
        (bomb(MAX_UNPACKED_BYTES + 1), "more than 64 MiB when unpacked"),
        (bomb(MAX_UNPACKED_BYTES // 8, parts=9), "more than 64 MiB when unpacked"),
        (bomb(1, parts=1001), "more than 1000 parts"),
        (bomb(10), "there is no part 'xl/_rels/workbook.xml.rels'"),
        *((related(old), "a workbook without a sheet, or with two") for old in (b"worksheet", b"theme")),
    ],
)
def test_hostile_archives(content, reason):
    refused(content, reason)


def test_a_stated_size_that_lies():
    """The archive says 10 bytes, and unpacks to 80 MiB: no more than stated is read, and refused."""
    content = repacked(workbook(), SHEET, lambda _: b" " * (80 << 20))
    size = (80 << 20).to_bytes(4, "little")
    assert content.count(size) == 2
    refused(content.replace(size, (10).to_bytes(4, "little")), "not an Excel file (.xlsx), or damaged")


def test_many_tags():
    """All parts of an archive count together, before they are parsed."""
    archive = Archive("a.xlsx", repacked(workbook(), SHEET, lambda _: b"<a>" + b"<b/>" * 98 + b"</a>"))
    archive.count("xl/styles.xml", MAX_XML_TAGS - 100)
    assert list(archive.elements(SHEET, "row")) == []
    with pytest.raises(ImportFileError, match=f"more than {MAX_XML_TAGS} tags in part"):
        list(archive.elements(SHEET, "row"))


SPACE = b"http://schemas.openxmlformats.org/spreadsheetml/2006/main"


@pytest.mark.parametrize(
    ("cells", "reason"),
    [
        (b"<row><c><v>1</v></c></row>" * 400_000, "100 times as large"),
        (b"<row>" + b"<c/>" * 257 + b"</row>", "more than 256 columns"),
        (b'<row><c r="IV%d"/></row>', "or 500000 cells"),
        (b"<row>" + b"<x/>" * 100_001 + b"</row>", "100000 in one"),
        (b"<row><c><v>" + b"1" * 400_000 + b"</v></c></row>", "a text of more than"),
    ],
)
def test_small_files_that_unpack_to_much_are_refused_at_once(cells, reason):
    if b"%d" in cells:
        cells = b"".join(cells % line for line in range(1, 3000))
    sheet = b'<worksheet xmlns="%s"><sheetData>%s</sheetData></worksheet>' % (SPACE, cells)
    content = repacked(workbook(), SHEET, lambda _: sheet)
    began = time.process_time()
    with pytest.raises(ImportFileError, match=reason):
        read(("a.xlsx", content))
    assert time.process_time() - began < 2


@pytest.mark.slow
@pytest.mark.process
def test_a_sheet_at_the_limits_takes_little_memory():
    """A list of points, of nearly as many cells as a sheet may have, and the postures."""
    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet()
    for number in range(3_600 * 16 * 2):
        label, target = divmod(number // 2, 16)
        name = f"c{label:04d}_P{target}_{'loaded' if number % 2 else 'unloaded'}"
        sheet.append([name, *(number * factor % 9973 / 10_000 for factor in (7, 11, 13))])
    output = io.BytesIO()
    book.save(output)
    rows = (f"c{label:04d};{label % 90};{label % 77};0;0;-100" for label in range(3_600))
    joints = "\n".join(["label;J1 [deg];J2 [deg];Fx [N];Fy [N];Fz [N]", *rows])
    files = ("points.xlsx", output.getvalue()), ("joints.csv", joints)

    def imported():
        answer = samples.answered(*files, units=samples.MM, accept_unusual=True)
        assert answer.preview.reading_count == 57_600
        assert answer.measurement_set is not None

    peak, outcome = peak_of(imported)
    assert outcome == "taken"
    assert peak < 256


def test_expanding_entities():
    lines = b'<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">' + b"".join(
        b'<!ENTITY %c "%s">' % (98 + number, b"&%c;" % (97 + number) * 10) for number in range(8)
    )  # fmt: skip
    for part in (SHEET, "xl/workbook.xml", TEXTS, "xl/styles.xml", "xl/_rels/workbook.xml.rels"):
        content = repacked(as_excel_writes(workbook()), part, lambda _: lines + b"]><a>&i;</a>")
        refused(content, "a document type")
