"""Habits of people and of measuring software: read to the written numbers, or refused with all faults."""

import io
import zipfile

import pytest
from support.importing_samples import CAMPAIGN, JOINTS, MM, faults, points_of, read, values_of

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.reading import SourceFile, understand_files
from jointstiff.service.resources.imports import import_files


def refused(*files, **options):
    """The reasons of all faults."""
    return [fault.reason for fault in faults(*files, **options)]


def test_the_preview_has_the_rows_with_faults_beyond_the_first_ones():
    rows = [f"c{i:02d},10,20,{'1.2.3' if i == 11 else '5'}" for i in range(1, 13)]
    table = "\n".join(["label,joint_1 [deg],joint_2 [deg],joint_3 [deg]", *rows, ""])
    understood = understand_files([SourceFile("a.csv", table.encode())])
    file = understood.preview.files[0]
    assert any(fault.place.line == 12 for fault in understood.faults)
    assert 12 not in file.first_lines
    assert (file.fault_lines, file.fault_rows) == ([12], [["c11", "10", "20", "1.2.3"]])


def test_the_preview_shows_how_a_header_was_put_together():
    content = (
        "Messung Zelle 3\nPunkt;Achse [deg];;Kraft [N];;;P10 unbelastet [mm];;;P10 mit Last [mm];;\n"
        ";1;2;x;y;z;x;y;z;x;y;z\nc01;10,5;-20;0;0;-1471,5;1,5;2;3;1,5;2;2,5\n"
    )
    imported = read(("a.csv", content))
    file = imported.preview.files[0]
    assert [column.header for column in file.columns][:5] == [
        "Punkt", "Achse 1 [deg]", "Achse 2 [deg]", "Kraft x [N]", "Kraft y [N]",
    ]  # fmt: skip
    assert file.columns[-1].meaning == "P10 loaded z"
    assert all(column.guessed for column in file.columns)
    assert (file.header_lines, file.first_lines) == ([2, 3], [4])
    assert "rows above the header were read as titles: 1" in file.assumptions
    assert points_of(imported)["c01", "P10", "loaded"] == (1.5, 2.0, 2.5)


@pytest.mark.parametrize(
    "change", [("P10 mit Last", ""), ("Achse", ""), (";1;2;x", ";1;2;"), (";1;2", ";1;1")]
)
def test_headers_of_two_rows_with_a_gap_are_refused(change):
    content = "Punkt;Achse;;P10 ohne Last;;;P10 mit Last;;\n;1;2;x;y;z;x;y;z\nc01;10.5;-20;1;2;3;1;2;2.5\n"
    assert read(("a.csv", content), units=MM)
    assert refused(("a.csv", content.replace(*change)), units=MM)


SA = """// SpatialAnalyzer
// FRAME = A::R0
// AXES = CARTESIAN: X,  Y,  Z ({})
{}Collection,  Group,  {},  X,  Y,  Z
Unloaded, c01, P10, 1.0, 2.0, 4.5
Loaded, c01, P10, 1.0, 2.0, 4.0
"""


@pytest.mark.parametrize("mark", ["", "// "])
@pytest.mark.parametrize("point", ["Point", "Target"])
@pytest.mark.parametrize(("unit", "factor"), [("mm", 1.0), ("Inches", 25.4)])
def test_spatial_analyzers_header(mark, point, unit, factor):
    imported = read(("a.txt", SA.format(unit, mark, point)))
    assert imported.units == {"length": "mm"}
    assert points_of(imported)["c01", "P10", "unloaded"] == tuple(factor * x for x in (1.0, 2.0, 4.5))
    assert any("'A::R0'" in note for note in imported.preview.files[0].assumptions)


def test_contradictions_of_spatial_analyzers_header():
    file = ("a.txt", SA.format("Inches", "", "Point"))
    assert refused(file, units={"length": "mm"}) == [
        "position x is in inches by the file's comment, but in mm by `units`"
    ]
    assert "'furlongs' of x, y, z is not known" in refused(("a.txt", SA.format("furlongs", "", "Point")))[0]
    assert "polar" in refused(("a.txt", SA.format("mm", "", "Point").replace("CARTESIAN", "POLAR")))[0]
    other = ("b.txt", SA.format("mm", "", "Point").replace("A::R0", "B").replace("c01", "c02"))
    reasons = refused(("a.txt", SA.format("mm", "", "Point")), other)
    assert reasons == ["the frame is B, but A::R0 in other files"]


LEICA = """"Time","Name","X  [mm]","Y  [mm]","Z  [mm]","U(95)  [mm]",
"2026-11-20 10:00:01","c01_P10_u",1.5,2.25,3.5,0.03,
"2026-11-20 10:00:09","c01_P10_l",1.5,2.25,3.1,0.04,
"""


def test_leicas_uncertainties_are_the_noise_of_each_reading():
    options = {"encoders": "motor", "load_point": (0.0, 0.0, 0.0)}
    joints = SourceFile("joints.csv", "\n".join(JOINTS.splitlines()[:2]).encode())
    files = [joints, SourceFile("leica.csv", LEICA.encode())]
    answer = import_files(files, ImportRequest(**options))
    reading = answer.measurement_set.observations[0].readings[0]
    sigmas = [0.03 / (1.96 * 3**0.5), 0.04 / (1.96 * 3**0.5)]  # U(95) is the point's
    assert reading.sigma == pytest.approx(((sigmas[0] ** 2 + sigmas[1] ** 2) / 2) ** 0.5, rel=1e-12)
    assert any("σ = U/(1.96 √3)" in note for note in answer.preview.assumptions)
    assert answer.preview.uncertainty == "point"
    request = ImportRequest(**options, noise={"sigma": 0.01}, show_faults=True)
    assert "`noise` gives another" in import_files(files, request).faults[0].reason
    assert refused(("a.csv", LEICA.replace("0.04", "")))  # every reading, or none
    assert refused(("a.csv", LEICA.replace("0.04", "-0.04"))) == ["an uncertainty must be positive"]
    assert points_of(read(("a.csv", LEICA), ignore=["U(95) [mm]"]))


def test_rows_are_matched_by_their_order_only_if_asked_for():
    rows = {"u": "1.5,2,3\n1.5,2,4\n", "l": "1.5,2,2.5\n1.5,2,3.5\n"}
    files = [(f"P10_{state}.csv", "X [mm],Y [mm],Z [mm]\n" + text) for state, text in rows.items()]
    reasons = refused(("joints.csv", JOINTS), *files)
    assert reasons == ["no column names the observations or points"] * 2
    unnamed = "\n".join(line.partition(",")[2] for line in JOINTS.splitlines()) + "\n"
    imported = read(("joints.csv", unnamed), *files, by_order=True)
    assert points_of(imported)["2", "P10", "loaded"] == (1.5, 2.0, 3.5)
    assert any("numbered" in note for note in imported.preview.files[1].assumptions)
    alone = read(*[(name, text.split("\n", 1)[1]) for name, text in files], by_order=True, units=MM)
    assert points_of(alone)["2", "P10", "unloaded"] == (1.5, 2.0, 4.0)
    shorter = (files[0][0], files[0][1].rsplit("\n", 2)[0])
    assert "2: target P10 was read only loaded" in refused(shorter, files[1], by_order=True)
    assert "'c01'" in refused(("joints.csv", JOINTS), *files, by_order=True)[0], "names are not numbers"


def test_columns_are_stated_by_the_caller():
    content = CAMPAIGN.replace("J1 [deg]", "Winkel  A [deg]").replace("label", "Nr")
    stated = {"Winkel A [deg]": "J1", "Nr": "label"}
    assert values_of(read(("a.csv", content), columns=stated)) == values_of(read(("a.csv", CAMPAIGN)))
    for wrong in ("J1 [rad]", "Fx"):
        reasons = refused(("a.csv", content), columns=stated | {"Winkel A [deg]": wrong})
        assert "is in deg, but" in reasons[0]
    pounds = CAMPAIGN.replace("Fx [N]", "Pull [lbf]")
    assert "'lbf' is not a known unit" in refused(("a.csv", pounds), columns={"Pull [lbf]": "Fx [N]"})[0]


def test_all_faults_are_in_one_answer():
    content = CAMPAIGN.replace("J1 [deg]", "elbow").replace("Fx [N]", "Fx [kg]").replace("10.5;", "x;")
    other = CAMPAIGN.replace("c0", "d0").replace("-20.25", "1.2.3").replace("42.75", "?")
    understood = understand_files(
        [SourceFile("a.csv", content.encode()), SourceFile("b.csv", other.encode())]
    )
    places = [(at.file, at.line, at.column) for at in (fault.place for fault in understood.faults)]
    assert places == [("a.csv", 2, 2), ("a.csv", 2, 5), ("b.csv", 3, 3), ("b.csv", 4, 4)]
    meanings = [column.meaning for column in understood.preview.files[0].columns]
    assert (meanings[1], meanings[2], meanings[4]) == ("unknown", "joint 2", "unknown")
    many = "\n".join(["name;J1 [deg]", *(f"c{row};x" for row in range(100))])
    assert len(refused(("joints.csv", many))) == 20
    one = "\n".join(["x [mm];y [mm];z [mm];name", *(f"1;2;3;P{row}" for row in range(100))])
    assert len(refused(("day1_a_b.csv", one))) == 1  # one mistake, not one for each row


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


def archive(*names):
    output = io.BytesIO()
    with zipfile.ZipFile(output, "w") as file:
        for name in names:
            file.writestr(name, b"x")
    return output.getvalue()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"%PDF-1.7", "a PDF document"),
        (b"\xff\xd8\xff\xe0", "a picture (JPEG)"),
        (b"\x89PNG\r\n\x1a\n", "a picture (PNG)"),
        (b"\0\0\0\x18ftypheic", "a picture (HEIC)"),
        (b"\xd0\xcf\x11\xe0\xa1", "an old Office document (such as .xls)"),
        (archive("mimetype", "content.xml"), "an OpenDocument file (such as .ods)"),
        (archive("xl/workbook.bin"), "a binary Excel workbook (.xlsb)"),
        (archive("word/document.xml"), "a Word document"),
        (archive("a.csv"), "a ZIP archive"),
        (b"  <!DOCTYPE html><html>", "a web page (HTML)"),
    ],
)
def test_what_is_no_table_is_named(content, words):
    assert words in refused(("a.csv", content))[0]
