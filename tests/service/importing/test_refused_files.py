"""Files that are refused: the place, the reason and the remedy that a person reads."""

import json
from pathlib import Path
from typing import Any

import pytest
from support import importing_samples
from support.importing_samples import CAMPAIGN, JOINTS, MM, POINTS, answered, read, refusals
from support.workbooks import SHEET, repacked, workbook

from jointstiff.service.importing.errors import ImportFileError

DIGITS = "use digits with at most one decimal mark, no unit, no thousands separator, no NaN"
EXPORT = "export the readings as CSV, text or .xlsx"
SAVE = "save the file as text in UTF-8"
ADD = "add a header such as `name x y z`, or give `header` [header]"
ROWS = CAMPAIGN.splitlines()[1:]


def edits():
    """Return each edit of the data file: the sample, what is edited, the options, and the faults."""
    sample, common, found = "", "{}", list[tuple[str, str, dict[str, Any], list[str]]]()
    text = Path(__file__).with_name("edits.txt").read_text(encoding="utf-8")
    for line in text.partition("\n\n")[2].splitlines():
        if line.startswith("    "):
            found[-1][3].append(line.strip())
        elif line.startswith("["):
            sample, _, common = line.strip("[").partition("]")
        else:
            edit, _, stated = line.partition("with {")
            options = json.loads(f"{{{stated}" if stated else common or "{}")
            found.append((sample, edit, options, []))
    return found


@pytest.mark.parametrize(("sample", "edit", "options", "wanted"), edits())
def test_an_edit_of_a_file_is_told_by_place_reason_and_remedy(sample, edit, options, wanted):
    old, _, new = (part.strip() for part in edit.partition("=>"))
    if sample == "SHEET":
        content = repacked(workbook(), SHEET, lambda data: data.replace(old.encode(), new.encode()))
        said = refusals(("a.xlsx", content))
    else:
        text = getattr(importing_samples, sample)
        assert old in text
        said = refusals(("a.csv", text.replace(old, new)), **options)
    assert len(said) == len(wanted)
    for line, whole in zip(said, wanted, strict=True):
        assert line == whole or (whole.endswith("…") and line.startswith(whole[:-1]))


@pytest.mark.parametrize(
    "text",
    ["1.2.3", "-nan", "-Infinity", "1_000", "0x10", "1 000.5", "٣.٥", "- 1.5", "1.5mm", "1.5 # up", "9" * 41],
)  # fmt: skip
def test_a_cell_that_is_no_plain_number_is_refused(text):
    said = f"a.csv:4:8: '{text}' is not a number with a decimal point; {DIGITS}"
    assert refusals(("a.csv", CAMPAIGN.replace("1102.5518", text))) == [said]


def test_a_number_at_the_bound_is_read():
    answer = answered(("a.csv", CAMPAIGN.replace("1102.5518", "1e12")), accept_unusual=True)
    assert answer.measurement_set.observations[1].readings[0].unloaded[0] == 1e12


@pytest.mark.parametrize("label", ["c\u20282", "c" * 201])
def test_a_label_is_a_name_that_can_be_printed(label):
    shown = "c\\u20282" if len(label) < 60 else f"{'c' * 60}…"
    assert refusals(("a.csv", CAMPAIGN.replace("c02;", f"{label};"))) == [
        f"a.csv:4:1: '{shown}' is not a valid name; "
        "give 1 to 200 printable characters, without blanks at the ends"
    ]
    assert answered(("a.csv", CAMPAIGN.replace("c02;", "c" * 200 + ";"))).first_labels[1] == "c" * 200


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", ": the file is empty; export the file again"),
        (b" \n\n", ": the file is empty; export the file again"),
        (b"# only\n// comments\n", ": the file has no row of data; check that this is the right file"),
        (b"#" * 100_000, ": the file has no row of data; check that this is the right file"),
        (b"label;x [mm]\n", ":1: the file has a header but no row of data; "
         "export the file again, with its rows"),
        (b"label;x [mm]\nc\x002;1\n", ":2: the file contains the control character '\\x00', "
         f"so it is not plain text; {SAVE}"),
        (b"\xff\xfe\x00", ": the text is damaged: its other bytes are UTF-16-LE, "
         f"but byte 1 is not valid in this encoding; {SAVE}"),
        (b"pos\xc3\xa9;1;2;3\nb\xff;1;2;3", ":2: the text is damaged: its other bytes are UTF-8, "
         f"but byte 14 is not valid in this encoding; {SAVE}"),
        (b"1.5 2.5 3.5\n", f":1: the rows have 3 cells, and there is no header; {ADD}"),
        (b"a;1;2;3;4;5;6;7\n", f":1: the rows have 8 cells, and there is no header; {ADD}"),
        (b"1.5;1.5;2.5;3.5\n", ":1:1: without a header, the name of a point must be where '1.5' is; "
         "give rows of name x y z, add a header, or give `header` [header]"),
        (b";" * 65_000, ":1: the file has more than 256 columns or 1000000 cells; "
         "remove columns that are not needed, or split the file"),
        (b"a" * 70_000, ":1: a line has more than 65536 characters; "
         "save the file with a line break after each row"),
        (b'"' + b"a" * 20_000, ":1: quotation marks do not enclose a whole cell; "
         'enclose a cell as in "Point 1", on one line, or remove the marks'),
        (b"PK\x03\x04", ": the file is not an Excel file (.xlsx), or is damaged (BadZipFile); open the "
        "file in Excel and save it again as .xlsx, or save the sheet as CSV"),
        (b"%PDF-1.7", f": the file is a PDF document, not a table; {EXPORT}"),
        (b"\xff\xd8\xff\xe0", f": the file is a picture (JPEG), not a table; {EXPORT}"),
        (b"\x89PNG\r\n\x1a\n", f": the file is a picture (PNG), not a table; {EXPORT}"),
        (b"\0\0\0\x18ftypheic", f": the file is a picture (HEIC) or a film, not a table; {EXPORT}"),
        (b"\xd0\xcf\x11\xe0\xa1", ": the file is an old Office document (such as .xls), "
         f"or an encrypted one, not a table; {EXPORT}"),
        (b"  <!DOCTYPE html><html>", f": the file is a web page (HTML), not a table; {EXPORT}"),
    ],
)  # fmt: skip
def test_a_file_without_a_table_is_told_what_it_is(content, said):
    assert refusals(("a.csv", content), units=MM) == [f"a.csv{said}"]


@pytest.mark.parametrize("content", [b'{"measurement_set": {}}\n', b'\xef\xbb\xbf [\n{"a": 1}\n]'])
def test_a_campaign_needs_no_import(content):
    assert refusals(("a.csv", content)) == [
        "a.csv: the file is a JSON document, not a table; "
        "a campaign needs no import: use `jointstiff identify FILE`"
    ]


def test_a_table_may_have_the_ending_of_json():
    answer = answered(("a.json", JOINTS), ("b.json", JOINTS.replace("c0", "d0").encode("utf-16")))
    assert answer.first_labels == ["c01", "c02", "d01", "d02"]
    files = ("c.json", '{"a": 1'.encode("utf-16-le")), ("d.json", "[" * 300 + "]" * 300)
    assert refusals(*files) == [
        "c.json: Invalid JSON: key must be a string at line 1 column 2; correct the JSON at this place; "
        "the file must be UTF-8",
        "d.json: Invalid JSON: recursion limit exceeded at line 1 column 202; correct the JSON at this "
        "place; the file must be UTF-8",
    ]


def test_64_files_of_8_mebibytes_are_taken():
    with pytest.raises(ImportFileError, match="65 files were sent; send 1 to 64 files"):
        read(*((str(number), b"a") for number in range(65)))
    with pytest.raises(ImportFileError, match="'1': the files exceed 8 MiB together; import fewer files"):
        read(("0", b"a" * (4 << 20)), ("1", b"a" * (4 << 20 | 1)))


def test_the_faults_of_all_files_are_in_one_answer():
    first = CAMPAIGN.replace("J1 [deg]", "elbow").replace("Fx [N]", "Fx [kg]").replace("10.5;", "x;")
    second = CAMPAIGN.replace("c0", "d0").replace("-20.25", "1.2.3").replace("42.75", "?")
    said = refusals(("a.csv", first), ("b.csv", second))
    assert [each.partition(";")[0] for each in said] == [
        "a.csv:2:2: unknown column header 'elbow'",
        "a.csv:2:5: 'Fx [kg]': 'kg' is not a known unit of force",
        "b.csv:3:3: '1.2.3' is not a number with a decimal point",
        "b.csv:4:4: '?' is not a number with a decimal point",
    ]


def test_the_first_twenty_faults_are_told():
    said = refusals(("j.csv", "\n".join(["name;J1 [deg]", *(f"c{row};x" for row in range(100))])))
    assert [each.split(" ")[0] for each in said] == [f"j.csv:{line}:2:" for line in range(2, 22)]


def test_the_rows_of_later_faults_are_shown():
    rows = [f"c{number:02},10,20,{'1.2.3' if number == 11 else '5'}" for number in range(1, 13)]
    answer = answered(("a.csv", "\n".join(["label,J1 [deg],J2 [deg],J3 [deg]", *rows, ""])), show_faults=True)
    (file,) = answer.files
    assert (file.fault_lines, file.fault_rows) == ([12], [["c11", "10", "20", "1.2.3"]])
    assert (file.header_lines, file.first_lines, file.row_count) == ([1], [2, 3, 4, 5, 6], 12)
    assert file.first_rows[0] == ["c01", "10", "20", "5"]


def test_an_observation_is_read_once():
    row = "c01,0.1,0,0,-150,{},0.1,0.2,0.3\n"
    table = "label,J1 [rad],Fx [N],Fy [N],Fz [N],target,dx [mm],dy [mm],dz [mm]\n" + row.format("P10")
    assert refusals(("a.csv", table + row.format("P11").replace("-150", "-151"))) == [
        "a.csv:3: the force of 'c01' differs from the value at 'a.csv', line 2; give each observation a "
        "unique label, or correct one of the two values"
    ]
    assert refusals(("a.csv", table + row.format("P10"))) == [
        "a.csv:3:7: P10 deflection of 'c01' occurs twice, first at 'a.csv', line 2, column 7; rename or "
        "remove one of the two readings, or use `mean_of_repeats` for repeated readings [mean_of_repeats]"
    ]


def test_observations_without_joints_are_skipped_where_readings_may_be_missing():
    files = [("j.csv", JOINTS.replace("c02", "c03")), ("p.txt", POINTS)]
    assert not refusals(*files, units=MM, allow_missing=True)


def test_labels_are_alike_in_all_files():
    said = refusals(("j.csv", JOINTS.replace("c02", "c03")), ("p.txt", POINTS), units=MM)
    assert said == [
        "p.txt:3: 'c02' has no joint, but other labels have: 'c01', 'c03'; "
        "add the joint of these labels, spell labels alike in all files, or use `allow_missing` to skip "
        "them; these labels have no joint: 'c02' [allow_missing]",
        "p.txt:3: 'c02' has no force, but other labels have: 'c01', 'c03'; "
        "add the force of these labels, spell labels alike in all files, or use `allow_missing` to skip "
        "them; these labels have no force: 'c02' [allow_missing]",
        "j.csv:3: c03: target P10 has no reading; "
        "add the reading, check the spelling of names, or use `allow_missing` [allow_missing]",
    ]


@pytest.mark.parametrize(
    "template", ["c01", "{any}", "{label}{target}", "{label}_{label}", "{x}", "{label}_{", "{}"]
)
def test_a_template_of_names_has_each_part_once_with_text_between(template):
    assert refusals(("points.txt", POINTS), units=MM, point_name=template) == [
        f"points.txt: the template '{template}' is invalid; "
        "in `point_name` use each of {label}, {target}, {state} at most once, "
        "{any} for the rest, with a text such as _ between them [point_name]"
    ]


def test_axes_are_spelt_alike_and_named_by_no_other_words():
    assert refusals(("a.csv", "name;Y;x;Z\n" + POINTS), units=MM) == [
        "a.csv:1:2: 'Y' and 'x' and 'Z' are not spelt alike; "
        "write x, y and z alike, or give their meaning in `columns` [columns]"
    ]
    assert refusals(("a.csv", "label;x_t;y_t;z_t\nc01;1;2;3\n")) == [
        "a.csv:1:2: 'x_t', read as t x, and 2 other columns have no unit; write the unit in the header, such "
        'as `x_t [mm]`, or state the unit, such as `units`: {"length": "mm"}; if the column means something '
        "else, give `columns`, such as x_t=x [units.length]"
    ]


def test_a_header_of_the_caller_fits_the_rows():
    body = "\n".join([*ROWS[1:], ""])
    said = refusals(("a.csv", body), header=ROWS[0].split(";")[:-1])
    row = "13: the row has 13 cells, but the header 12 (delimiter: semicolon); give every row the same number"
    assert [each[: len(row) + 8] for each in said[:3]] == [f"a.csv:{line}:{row}" for line in (1, 2, 3)]
    assert said[3].startswith("a.csv:11: column P10 loaded z is missing; add the column")
    again = refusals(("a.csv", CAMPAIGN), header=ROWS[0].split(";"))
    reason = "the header that is stated is not needed: every file has a known header of its own"
    assert again == [f"{reason}; omit `header`, or remove the header of the file [header]"]
