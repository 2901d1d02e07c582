"""Tables of web pages with text around them are read like the sheets of a workbook."""

import time
from contextlib import suppress

import pytest
from support.importing_samples import CAMPAIGN, MM, answered, points_of, read, refusals, values_of
from support.strange_files import JOINTS, both, joint_rows, judge, points, simulate, wide

import jointstiff as js
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.formats.web_pages import read_web_page
from jointstiff.service.importing.grid import file_type

ARM = "KUKA KR 210 R2700 extra"
ASKED = {"encoders": "motor", "load_point": [0, 0, 120], "force": [0, 0, -981], "units": {"force": "N"}}
SIMULATED = simulate(ARM, seed=3, postures=10)
ROWS = [line.split(";") for line in CAMPAIGN.splitlines()[1:]]


def table(rows: list[list[str]], before: str = "") -> str:
    lines = ("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table border=1>{before}\n" + "\n".join(lines) + "\n</table>\n"


def page(body: str, head: str = "") -> str:
    return f"<!doctype HTML><html><head>{head}<title>Report</title></head>\n<body>\n{body}</body></html>\n"


def rows_of(text: str, number: int = 0) -> list[tuple[str, ...]]:
    return [row.cells for row in read_web_page("a.htm", text.encode(), None)[number].rows]


def judged(path) -> list[str]:
    proposal = js.read(path, robot=ARM, **ASKED)
    return judge(SIMULATED, proposal.accept().measurement_set.model_dump(mode="json"))


@pytest.mark.parametrize(
    ("label", "codec"), [("big5", "big5"), ("gb2312", "gb18030"), ("utf-8", "utf-8"), ("Shift_JIS", "cp932")]
)
def test_a_report_with_merged_headers_is_read_in_the_encoding_that_it_states(tmp_path, label, codec):
    head = "<tr><th rowspan=2>No.</th><th colspan=6>joints (deg)</th><th colspan=3>空 unloaded (mm)</th>"
    head += "<th colspan='3'>loaded (mm)</th></tr><tr>" + "".join(
        f"<th>{each}" for each in [*JOINTS, *2 * "XYZ"]
    )
    text = page(
        table(wide(SIMULATED, *both(SIMULATED)), head),
        f'<meta http-equiv="Content-Type" content="text/html; charset={label}">',
    )
    path = tmp_path / "report.htm"
    path.write_bytes(text.encode(codec))
    assert judged(path) == []
    (found,) = read_web_page("report.htm", path.read_bytes(), None)
    assert found.rows[0].cells[7] == "空 unloaded (mm)"
    assert found.preview.encoding == codec


def test_several_tables_of_a_page_are_a_table_each(tmp_path):
    body = "<h1>Check</h1><table><tr><td>Robot<td>no. 4<tr><td>Inspector<td>Li</table>"
    body += "<h2>Poses</h2>" + table([["pose", *JOINTS], *joint_rows(SIMULATED)])
    body += table([["pose", *"xyz"], *points(SIMULATED, 0)], "<caption>unloaded</caption>")
    body += table([["pose", *"xyz"], *points(SIMULATED, 1)], "<caption>loaded</caption>")
    path = tmp_path / "report.html"
    path.write_text(page(body))
    assert judged(path) == []


def test_a_load_in_the_text_of_a_page_is_suggested(tmp_path):
    path = tmp_path / "report.htm"
    path.write_text(page("<p>3 July</p><p>Load: <b>5</b> kg</p>" + table(wide(SIMULATED, *both(SIMULATED)))))
    missing = js.read(path, robot=ARM, encoders="motor", load_point=[0, 0, 120]).accept().missing
    assert any("'report.htm' says \"Load 5 kg\" in line 3: if this load hangs" in each for each in missing)


@pytest.mark.parametrize(
    ("cells", "plain"),
    [
        ("<td>1<td>&minus;2,5</td><th> 3&nbsp; </th>", ("1", "-2,5", "3")),
        ("<td><b>1</b><td>m<sup>2</sup><td>a<br/>b&#176;", ("1", "m2", "a b°")),
        ("<td colspan=2>a</td><td>b", ("a", "", "b")),
        ("<td><s>1</s>2<td><script>3</script><td/>", ("2", "", "")),
        ("<td><p>J<sub>1</sub></p><p>deg</p><td>x<td><!-- 5 -->6", ("J1 deg", "x", "6")),
    ],
)
def test_cells_have_the_text_that_a_page_shows(cells, plain):
    assert rows_of(page(f"<table><tr>{cells}</tr><tr><td>1<td>2<td>3</table>"))[0] == plain


def test_merged_rows_leave_their_cells_empty():
    body = "<table><tr><td rowspan=2>a<td>1<td>2<td>3<tr><td>4<td>5<td rowspan=9>6<tr><td>7<td>8<td>9</table>"
    assert rows_of(page(body)) == [("a", "1", "2", "3"), ("", "4", "5", "6"), ("7", "8", "9", "")]


def test_a_table_around_others_is_a_frame():
    body = f"<table><tr><td>Menu<td>{table([['1', '2', '3']])}</table>"
    (found,) = read_web_page("a.htm", page(body).encode(), None)
    assert [row.cells for row in found.rows] == [("1", "2", "3")]
    assert "Menu" in [remark.text for remark in found.comments]


def test_places_are_lines_of_the_file_and_texts_around_tables_are_remarks():
    (found,) = read_web_page(
        "a.htm", page("<p>Load: <b>5</b> kg</p>\n" + table([["1", "2", "3"]])).encode(), None
    )
    assert [row.line for row in found.rows] == [5]
    assert [tuple(remark) for remark in found.comments] == [(1, "Report"), (3, "Load: 5 kg")]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-8"])
def test_a_page_is_read_like_delimited_text(encoding):
    imported = read(("a.html", page(table(ROWS)).encode(encoding)), units=MM)
    expected = read(("a.csv", CAMPAIGN), units=MM)
    assert (values_of(imported), points_of(imported)) == (values_of(expected), points_of(expected))


def test_a_missing_cell_is_refused_and_not_shifted():
    rows = [list(row) for row in ROWS]
    del rows[2][9]
    assert any("the row has 12 cells" in said for said in refusals(("a.htm", page(table(rows))), units=MM))


def test_one_of_several_tables_can_be_stated():
    tables = table(ROWS, "<caption>Monday; cell 3</caption>") + table(ROWS, "<caption>Tuesday</caption>")
    (said,) = refusals(("a.htm", page(tables)), units=MM)
    assert "several sheets have data: 'Monday, cell 3, Tuesday'" in said
    answer = answered(("a.htm", page(tables)), units=MM, sheet="Tuesday")
    assert [(file.sheet, file.row_count) for file in answer.files] == [("Tuesday", 3)]


@pytest.mark.parametrize(
    "start",
    ["<html>", "\n<!-- saved -->\n<!DOCTYPE HTML PUBLIC '-//W3C//DTD HTML 4.01//EN'>", "<TABLE>",
     '<?xml version="1.0"?>\n<!DOCTYPE html>', '<meta charset="utf-8">', "<head>"],
)  # fmt: skip
def test_a_page_is_known_by_its_beginning(start):
    assert file_type(start.encode()) == file_type(start.encode("utf-16")) == "a web page (HTML)"


@pytest.mark.parametrize("start", ['<?xml version="1.0"?><table><row/></table>', "<tabletop>", "1<html>"])
def test_another_document_is_no_page(start):
    assert file_type(start.encode()) != "a web page (HTML)"


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("<table><tr><td>1<td>2<td>3", "the page is cut off"),
        ("<table><tr><td>1<td>2<td>3</table><!-- ", "the page is cut off"),
        ("<table><tr><td>1<td>2<td>3</table><tr><td>4<td>5<td>6</table>", "the element 'tr' is in no table"),
        ("<table><tr>12.5<td>1</table>", "the text '12.5' is between the cells"),
        ("<table><tr><td colspan=1000000>1</table>", "a cell covers more than 256 columns"),
        ("<table><tr>" + "<td colspan=200>1" * 2 + "</table>", "more than 256 columns"),
        ("<table><tr><td>" + "a" * 300 + "</table>", "a cell has more than 256"),
        ("<table><tr><td>" * 40, "more than 32 tables are within each other"),
        ("<table>" + "<tr><td colspan=256>1" * 3_000 + "</table>", "more than 256 columns or 1000000 cells"),
    ],
)
def test_a_damaged_or_hostile_table_is_refused(body, reason):
    with pytest.raises(ImportFileError, match=reason):
        rows_of("<html>" + body)


@pytest.mark.parametrize(
    "piece",
    ["<", "<!--", "<td>", "<table>", "<table></table>", "</", "<tr><td rowspan=99999>1", "<a x='", "&",
     "<script>", "<td colspan=256>", "<?", "<![CDATA[", "\n", "<br>1 2 3", "<h1>a</h1>",
     "<caption>a", "a<b>", "<td/", "a<b"],
)  # fmt: skip
def test_a_hostile_page_is_read_or_refused_in_linear_time(piece):
    start = time.perf_counter()
    for before in ("", "<table><tr>", "<table><caption>" + "a" * 1_000_000):
        with suppress(ImportFileError):
            read_web_page("a.htm", ("<html>" + before + piece * (99_000 // len(piece))).encode(), None)
    assert time.perf_counter() - start < 20.0


def test_a_page_beyond_a_limit_is_refused_unread():
    for body in ("a" * 2_000_001, "<b>" * 200_001, "<table><tr><td>1<td>2<td>3</table>" * 1_001):
        with pytest.raises(ImportFileError, match="the document has more than"):
            rows_of("<html>" + body)
