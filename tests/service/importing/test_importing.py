"""Tables and workbooks that are read, understood or asked about, and come back as they were written."""

import datetime
import io
import re
import time
import zipfile

import numpy as np
import openpyxl
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from support import importing_samples as samples
from support.examples import examples, is_full
from support.importing_samples import (
    CAMPAIGN,
    MM,
    POINTS,
    READ_POINTS,
    Dialect,
    answered,
    points_of,
    read,
    refused,
    sources_of,
    values_of,
)
from support.memory import peak_of
from support.shared_data import MISSING, SHARED
from support.workbooks import SHEET, bomb, repacked, rows_of_values, table_of, workbook

import jointstiff
from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.parsing import MAX_SET_BYTES
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.importing import grid
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.excel import MAX_UNPACKED_BYTES, MAX_XML_TAGS, Archive
from jointstiff.service.importing.grid import MAX_COLUMNS, MAX_FILE_BYTES
from jointstiff.service.importing.reading import SourceFile, understand_files
from jointstiff.service.importing.rows import Template
from jointstiff.service.resources.imports import import_files
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.own_weight import unloaded_campaign

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


def refused_workbook(content, reason, line=None, column=None, **options):
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
    refused_workbook(
        repacked(workbook(), SHEET, lambda data: data.replace(b'r="M4"', b'r="%s"' % far)), "", 4, 12
    )


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
    refused_workbook(content, reason)


def test_a_stated_size_that_lies():
    """The archive says 10 bytes, and unpacks to 80 MiB: no more than stated is read, and refused."""
    content = repacked(workbook(), SHEET, lambda _: b" " * (80 << 20))
    size = (80 << 20).to_bytes(4, "little")
    assert content.count(size) == 2
    refused_workbook(
        content.replace(size, (10).to_bytes(4, "little")), "not an Excel file (.xlsx), or damaged"
    )


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
        refused_workbook(content, "a document type")


NUMBERS = st.one_of(
    st.floats(-1e12, 1e12, allow_nan=False),
    st.floats(-3000, 3000, allow_nan=False),
    st.integers(-10_000, 10_000).map(float),
    st.decimals(-3000, 3000, places=4).map(float),
)
NAMES = st.text(st.characters(codec="latin-1", categories=("L", "N")), min_size=1, max_size=8).map(
    lambda text: "n" + text
)
DIALECTS = st.builds(
    Dialect,
    delimiter=st.sampled_from(["comma", "semicolon", "tab", "whitespace"]),
    mark=st.sampled_from([".", ","]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"]),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    quote=st.booleans(),
)


@st.composite
def campaigns(draw):
    """A header in some order, and numbers by label and meaning."""
    labels = draw(st.lists(NAMES, min_size=1, max_size=4, unique=True))
    targets = draw(st.lists(NAMES, max_size=3, unique_by=str.casefold))
    assume(not any(word in "sigma nominal" for word in targets))
    vectors = {"force": [f"F{axis} [N]" for axis in "xyz"]}
    vectors["joint"] = [f"J{number} [deg]" for number in range(1, 1 + draw(st.integers(1, 7)))]
    for target in targets:
        for state in ("unloaded", "loaded") if draw(st.booleans()) else ("deflection",):
            vectors[target, state] = [f"{target}_{state}_{axis} [mm]" for axis in "xyz"]
    header = draw(st.permutations(["label", *(name for names in vectors.values() for name in names)]))
    table = {label: {name: draw(NUMBERS) for name in header if name != "label"} for label in labels}
    return header, vectors, table


def expected(vectors, table):
    values, points = {}, {}
    for label, cells in table.items():
        for key, names in vectors.items():
            vector = tuple(cells[name] for name in names)
            if isinstance(key, str):
                values[label, key] = vector
            else:
                points[label, *key] = vector
    return values, points


@given(campaigns(), DIALECTS)
@examples(60)
def test_text(campaign, dialect):
    header, vectors, table = campaign
    rows = [
        header,
        *([label, *(repr(table[label][name]) for name in header if name != "label")] for label in table),
    ]
    place = header.index("label")
    rows = [header, *([*row[1 : place + 1], row[0], *row[place + 1 :]] for row in rows[1:])]
    content = dialect.write(rows)
    try:
        imported = read(("a.csv", content))
    except ImportFileError as error:
        if "thousands separator" not in error.reason:
            raise
        imported = read(("a.csv", content), decimal_mark="comma")
    assert (values_of(imported), points_of(imported)) == expected(vectors, table)
    file = imported.preview.files[0]
    assert file.delimiter == dialect.delimiter
    assert imported.preview.observation_count == len(table)


@given(campaigns())
@examples(20)
def test_excel(campaign):
    header, vectors, table = campaign
    book = openpyxl.Workbook()
    book.active.append(header)
    for label, cells in table.items():
        book.active.append([label if name == "label" else cells[name] for name in header])
    output = io.BytesIO()
    book.save(output)
    # openpyxl writes 16 digits, of which it reads these numbers again
    sheet = openpyxl.load_workbook(io.BytesIO(output.getvalue())).active
    stored = [dict(zip(header, row, strict=True)) for row in sheet.iter_rows(min_row=2, values_only=True)]
    imported = read(("a.xlsx", output.getvalue()))
    by_label = {row["label"]: row for row in stored}
    assert (values_of(imported), points_of(imported)) == expected(vectors, by_label)


@given(
    st.dictionaries(st.tuples(NAMES, NAMES, st.sampled_from(["unloaded", "loaded"])),
                    st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=8),
    DIALECTS, st.sampled_from(["_", "::"]),
)  # fmt: skip
@examples(60)
def test_points(points, dialect, separator):
    rows = [[separator.join(key), *map(repr, vector)] for key, vector in points.items()]
    options = {"units": {"length": "mm", "angle": "deg", "force": "N"}, "allow_missing": True}
    one_state = len({state for _, _, state in points}) == 1
    complete = {
        key: vector for key, vector in points.items()
        if one_state or {(*key[:2], "unloaded"), (*key[:2], "loaded")} <= set(points)
    }  # fmt: skip
    try:
        imported = read(("a.txt", dialect.write(rows)), **options)
    except ImportFileError as error:
        if "thousands separator" not in error.reason:
            if complete or "no observation has a reading" not in error.reason:
                raise
            return
        imported = read(("a.txt", dialect.write(rows)), decimal_mark="comma", **options)
    assert points_of(imported) == complete


ROWS = [line.split(";") for line in POINTS.splitlines()]


@pytest.mark.parametrize("header", ["Kraft_C_t_mean", "Kraft C (links)", "Kraft C N", "Kraft_x_m"])
def test_a_tail_that_is_no_unit_of_it_is_not_taken_for_one(header):
    found = read(("a.csv", CAMPAIGN.replace("Fz [N]", header)), columns={header: "Fz [N]"})
    assert values_of(found) == values_of(read(("a.csv", CAMPAIGN)))
    measured = CAMPAIGN.replace("P10 unloaded x [mm]", "x_m")
    found = read(("a.csv", measured), columns={"x_m": "P10 unloaded x [mm]"})
    assert points_of(found) == points_of(read(("a.csv", CAMPAIGN)))


@pytest.mark.parametrize("word", ["Zoll", "pouces", "INCHES"])
def test_inches_are_read_in_three_languages(word):
    found = read(("a.csv", f"name;x [{word}];y [{word}];z [{word}]\n{POINTS.splitlines()[0]}\n"))
    inches = pytest.approx((31641.12036, -7876.86258, 6075.71556))
    assert points_of(found)["c01", "P10", "unloaded"] == inches


def uncertain(header, *cells):
    head = f"name;x [mm];y [mm];z [mm];{header}\n"
    return head + "".join(f"{';'.join(row)};{cell}\n" for row, cell in zip(ROWS, cells, strict=True))


def test_an_empty_position_needs_no_uncertainty():
    table = uncertain("U95 [mm]", "0.03", "0.03", "", "").replace(";".join(ROWS[2][1:]), ";;")
    imported = read(("a.csv", table.replace(";".join(ROWS[3][1:]), ";;")), allow_missing=True)
    assert {label for label, _, _ in points_of(imported)} == {"c01"}


@pytest.mark.parametrize("file", [" .csv", "\u2028.csv", "a" * 240 + ".csv"])
def test_any_file_name_gives_a_name(file):
    poses = "name;J1 [deg];P unloaded x [mm];P unloaded y [mm];P unloaded z [mm]\nc01;1;2;3;4\n"
    name = "readings" if len(file) < 10 else "a" * 200
    assert import_files(sources_of((file, poses)), ImportRequest()).poses.name == name
    assert answered((file, CAMPAIGN)).measurement_set.name == name


def wide():
    """Two files of more headers than a template holds."""
    head, *rows = CAMPAIGN.splitlines()[1:]
    spare = [f"spare {number}" for number in range(256)]
    first = "\n".join([";".join([head, *spare[:240]]), *(row + ";1" * 240 for row in rows)])
    joints = [";".join(row.split(";")[:4]) for row in (head, *rows)]
    other = "\n".join([";".join([joints[0], *spare[240:]]), *(row + ";1" * 16 for row in joints[1:])])
    return [("a.csv", first + "\n"), ("b.csv", other + "\n")], {"ignore": spare}


def long():
    """A file whose headers of two rows are longer than those of a template."""
    head, *rows = CAMPAIGN.splitlines()[1:]
    name, below = "P" * 200, "position coordinate position coordinate position"
    headers = [header.split() for header in head.split(";")]
    groups = [f"{name} {words[1]}" if "P10" in words else "" for words in headers]
    axes = [" ".join([below, *words[2:]] if "P10" in words else words) for words in headers]
    return [("a.csv", "\n".join([";".join(groups), ";".join(axes), *rows]) + "\n")], {}


@pytest.mark.parametrize("files", [wide, long])
def test_files_beyond_what_a_template_holds_are_read_without_one(files):
    contents, options = files()
    answer = answered(*contents, **options)
    assert (answer.measurement_set is not None, answer.template) == (True, None)
    assert answer.preview.targets == (["P" * 200] if files is long else ["P10"])


def test_a_load_point_in_metres_is_blamed_on_itself():
    campaign = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=7)
    robot = prepare_robot(RobotDocument.model_validate(campaign["robot"])).robot
    request = ImportRequest(encoders="motor", load_point=(0.0, 0.0, 0.12), length_unit="mm")
    findings = import_files(sources_of(("a.csv", table_of(campaign))), request, robot).findings
    (finding,) = [one for one in findings if one.code == "length_unit_suspect"]
    assert finding.message.startswith("the load points and targets in the flange frame are up to 120 µm")
    assert finding.remedy == "check the unit of `load_point`"


def test_the_preview_has_the_rows_with_faults_beyond_the_first_ones():
    rows = [f"c{i:02d},10,20,{'1.2.3' if i == 11 else '5'}" for i in range(1, 13)]
    table = "\n".join(["label,joint_1 [deg],joint_2 [deg],joint_3 [deg]", *rows, ""])
    understood = understand_files([SourceFile("a.csv", table.encode())])
    file = understood.preview.files[0]
    assert any(fault.place.line == 12 for fault in understood.faults)
    assert 12 not in file.first_lines
    assert (file.fault_lines, file.fault_rows) == ([12], [["c11", "10", "20", "1.2.3"]])


def test_a_template_reads_the_same_form_and_no_other():
    files = [SourceFile("a.csv", CAMPAIGN.replace("[deg]", "").encode())]
    request = ImportRequest(units={"angle": "deg"}, encoders="motor", load_point=(0.0, 0.0, 0.0), name="x")
    first = import_files(files, request)
    template = ImportRequest.model_validate_json(first.template.model_dump_json())
    again = import_files([SourceFile("day2.csv", files[0].content)], template)
    assert again.measurement_set.model_copy(update={"name": "x"}) == first.measurement_set
    assert again.template == first.template
    for old, new, reason in (
        ("J1 ", "q1 ", "does not fit the template; missing: 'J1'; not in the template: 'q1'"),
        ("[mm]", "[m]", "does not fit the template"),
        (";", ",", "does not fit the template"),
        (".", ",", "decimal"),
    ):
        changed = SourceFile("a.csv", files[0].content.decode().replace(old, new).encode())
        shown = import_files([changed], template.model_copy(update={"show_faults": True}))
        assert any(reason in fault.reason for fault in shown.faults), (old, shown.faults)


TABLE = """name,J1 [deg],J2 [deg],P1 unloaded x [mm],P1 unloaded y [mm],P1 unloaded z [mm],dx,dy,dz
c01,10,20,1000,200,300,0.5,-0.25,0.125
c02,30,40,900,400,350,-0.5,0.75,0
"""
UR = {
    "ur5": ((0, 0.089159), (-0.425, 0), (-0.39225, 0), (0, 0.10915), (0, 0.09465), (0, 0.0823)),
    "ur10": ((0, 0.1273), (-0.612, 0), (-0.5723, 0), (0, 0.163941), (0, 0.1157), (0, 0.0922)),
}
"""The maker's a and d, in m."""
TWISTS = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)


def robot_of(name):
    rows = [
        {"a": a, "alpha": alpha, "d": d, "theta": 0.0} for (a, d), alpha in zip(UR[name], TWISTS, strict=True)
    ]
    model = {"format": "dh", "convention": "standard", "rows": rows}
    return RobotDocument.model_validate({"name": name, "model": model})


def test_uncertainties_in_the_files_become_one_sigma():
    expanded = TABLE.replace(
        "dx,dy,dz", "P1 unloaded U95 x [mm],P1 unloaded U95 y [mm],P1 unloaded U95 z [mm]"
    )
    file = sources_of(("poses.csv", expanded.replace("-0.", "0.")))
    answer = import_files(file, ImportRequest())
    squares = (np.array([0.5, 0.25, 0.125, 0.5, 0.75, 5e-4]) / 1.96) ** 2
    assert answer.poses.noise.sigma == pytest.approx(np.sqrt(squares.mean()), rel=1e-12)


@pytest.mark.slow  # those of a UR10 by day
@pytest.mark.skipif(not SHARED.is_dir(), reason=MISSING)
def test_the_poses_of_a_real_ur5_give_its_geometry():
    """1,000 poses, read as target plus deviation: residuals as small as the best published, 0.15 mm."""
    columns = {"step_order": "label", **{f"joint_{number}": f"J{number} [deg]" for number in range(1, 7)}}
    for axis in "xyz":
        columns |= {f"{axis}_t": f"tool unloaded {axis} [mm]"}
        columns |= {f"{axis}_dif": f"tool unloaded plus {axis} [mm]"}
    file = SHARED / "ur5_grid" / "3D_UR5_uncalibrated_grid_cleaned.csv"
    poses = jointstiff.import_files(file, columns=columns).poses
    assert len(poses.poses) == 1_000
    few = poses.model_copy(update={"poses": poses.poses[::5]})
    found = jointstiff.geometry(few.model_dump(mode="json"), robot=robot_of("ur5"))
    assert found.result.goodness.sigma < 0.15e-3


@pytest.mark.skipif(not SHARED.is_dir(), reason=MISSING)
def test_the_poses_of_a_real_ur10_give_its_geometry():
    """Decimal commas, no labels, uncertainties that are no U(95): 632 poses of a T-Mac."""
    joints = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    columns = {f"{name}_joint": f"J{number} [rad]" for number, name in enumerate(joints, 1)}
    columns |= {f"measurement_{axis}": f"TMAC unloaded {axis} [mm]" for axis in "xyz"}
    file = SHARED / "ur10_poses" / "measurements_iso_cubes.csv"
    ignore = [header for header in file.read_text().splitlines()[0].split(";") if header not in columns]
    poses = jointstiff.import_files(file, columns=columns, ignore=ignore, by_order=True).poses
    assert len(poses.poses) == 632
    few = poses.model_copy(update={"poses": poses.poses[::12]})
    found = jointstiff.geometry(few.model_dump(mode="json"), robot=robot_of("ur10"))
    assert found.result.goodness.sigma < 1e-3


def by_target_and_state(name="{target}_{state}.txt"):
    files = {}
    for point, *xyz in [line.split(";") for line in POINTS.splitlines()]:
        label, target, state = point.split("_")
        file = name.format(target=target, state=state)
        files[file] = files.get(file, "") + " ".join([label, *xyz]) + "\n"
    return list(files.items())


def test_a_file_for_each_target_and_state():
    imported = read(*by_target_and_state(), units=MM)
    assert points_of(imported) == READ_POINTS
    note = "P10_unloaded.txt: state unloaded and target P10 by the name of the file"
    assert note in imported.preview.assumptions
    assert points_of(read(*by_target_and_state("{state}_{target}.xyz"), units=MM)) == READ_POINTS
    named = by_target_and_state("2026-11-20 {target} {state}.txt")
    refused(*named, reason="given neither by the table nor", file=named[0][0], units=MM)
    assert points_of(read(*named, units=MM, file_name="{any} {target} {state}")) == READ_POINTS


@pytest.mark.parametrize(
    ("template", "name"),
    [
        ("{label}_{target}_{state}", "c_01_P10_loaded"),
        ("{state}_{target}_{label}", "loaded_P_10_c01"),
        ("{label}_{target}_{state}", "c01_P10_hot"),
        ("{label}_{target}_{state}", "c01__loaded"),
        ("{label}_{target}_{state}", "_" * 200),
        ("c.{label}", "cx1"),
    ],
)
def test_names_that_do_not_fit(template, name):
    """A name that would fit in two ways fits in none."""
    with pytest.raises(ImportFileError, match="does not fit the template"):
        Template(template).parse(name, {})


def test_units_of_all_files_agree():
    files = [(name, f"name x[{unit}] y[{unit}] z[{unit}]\n{content}")
             for (name, content), unit in zip(by_target_and_state(), ("mm", "m"), strict=True)]  # fmt: skip
    refused(*files, reason="length is m, but mm in other files", file="P10_loaded.txt")


def refused_table(content, *, name="a.csv", **stated):
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
    refused_table(";".join("a" * (MAX_COLUMNS + 1)), reason="more than 256 columns", line=1)
    refused_table(b"a" * 70_000, reason="a line has more than", line=1)
    refused_table(b'"' + b"a" * 20_000, reason="quotation marks", line=1)
    monkeypatch.setattr(grid, "MAX_ROWS", 300)
    refused_table(b"a\n" * 301, reason="more than 300 rows", line=301)
    monkeypatch.setattr(grid, "MAX_LINES", 400)
    refused_table(b"\n" * 400 + b"a b\r\n", reason="more than 400 lines together")
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


UNLOADED = unloaded_campaign(default_arm(), configurations=30, seed=4)
POSITIONS = "grid.csv", table_of(UNLOADED) + b"\n"
BARE = {name: value for name, value in UNLOADED["robot"].items() if name != "bodies"}


def masses(*, joint="{name}", bound="± [%]", scale=100.0):
    rows = [f"body;joint;mass [kg];{bound};cog x [mm];cog y [mm];cog z [mm]"]
    for number, body in enumerate(UNLOADED["robot"]["bodies"], start=1):
        named = joint.format(name=body["joint"], number=number)
        width = body["mass_uncertainty"] * (body["mass"] if scale == 1.0 else scale)
        centre = ";".join(f"{1e3 * number:.10g}" for number in body["centre"])
        rows.append(f"{body['name']};{named};{body['mass']!r};{width:.12g};{centre}")
    return "masses.csv", "\n".join(rows) + "\n"


def test_a_robot_with_masses_makes_a_set_that_is_identified_without_an_option(tmp_path):
    """The numbers are those of the campaign as it was simulated; nothing says `weight`."""
    table = tmp_path / "grid.csv"
    table.write_bytes(POSITIONS[1])
    options = {"encoders": "motor", "noise": {"sigma": 0.03}, "length_unit": "mm"}
    answer = jointstiff.import_files(table, robot=UNLOADED["robot"], **options)
    assert (answer.missing, answer.findings) == ([], [])
    assert {one.force for one in answer.measurement_set.observations} == {(0.0, 0.0, 0.0)}
    read = answer.measurement_set.model_dump(mode="json", exclude_none=True)
    run = jointstiff.identify({"robot": UNLOADED["robot"], "measurement_set": read})
    stated = jointstiff.identify(UNLOADED)
    assert run.request.weight is not None
    pairs = [
        (one.stiffness, other.stiffness)
        for one, other in zip(run.result.joints, stated.result.joints, strict=True)
    ]
    numbers = [pair for pair in pairs if None not in pair]
    assert len(numbers) >= 3
    assert all(one == pytest.approx(other, rel=1e-6) for one, other in numbers)
    assert all(pair == (None, None) for pair in pairs if None in pair)


@pytest.mark.parametrize(
    "table", [{}, {"joint": "{number}"}, {"joint": "Axis {number}"}, {"bound": "± [kg]", "scale": 1.0}]
)
def test_a_table_of_masses_gives_the_bodies(table):
    robot = prepare_robot(RobotDocument.model_validate(BARE)).robot
    answer = import_files(sources_of(POSITIONS, masses(**table)), ImportRequest(encoders="motor"), robot)
    assert answer.measurement_set is not None
    for body, stated in zip(answer.bodies, UNLOADED["robot"]["bodies"], strict=True):
        assert (body.name, body.joint, body.mass) == (stated["name"], stated["joint"], stated["mass"])
        assert body.mass_uncertainty == pytest.approx(stated["mass_uncertainty"], rel=1e-9)
        assert body.centre == pytest.approx(tuple(stated["centre"]), rel=1e-9)
