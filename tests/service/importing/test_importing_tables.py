"""Campaign tables: what is understood, and what is refused, where and with which remedy."""

import pytest
from support import importing_samples as samples
from support.importing_samples import CAMPAIGN, MM, answered, points_of, read, sources_of, values_of
from support.memory import peak_of

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.conversion.parsing import MAX_SET_BYTES
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.grid import (
    MAX_CELL_LENGTH,
    MAX_COLUMNS,
    MAX_FILE_BYTES,
    MAX_LINES,
    MAX_ROWS,
)
from jointstiff.service.resources.imports import import_files

ROWS = [line.split(";") for line in CAMPAIGN.splitlines()[1:]]


def refused(content, *, name="a.csv", **stated):
    return samples.refused((name, content), **stated)


def changed(old, new, count=1):
    assert old in CAMPAIGN
    return CAMPAIGN.replace(old, new, count)


def test_a_row_for_each_target():
    content = """label,J1 [rad],J2 [rad],Fx [kgf],Fy [kgf],Fz [kgf],Mx [Nm],My [Nm],Mz [Nm],\
load point x [m],load point y [m],load point z [m],target,dx [m],dy [m],dz [m],comment
c01,0.1,0.2,0,0,-150,1,2,3,0.1,0.2,0.3,P10,0.0001,0.0002,-0.0013,ok
c01,0.1,0.2,0,0,-150,1,2,3,0.1,0.2,0.3,P11,0.0002,0.0003,-0.0012,
"""
    imported = read(("a.csv", content))
    assert points_of(imported) == {
        ("c01", "P10", "deflection"): (0.0001, 0.0002, -0.0013),
        ("c01", "P11", "deflection"): (0.0002, 0.0003, -0.0012),
    }
    files = sources_of(("a.csv", content))
    assert "flange_targets" in import_files(files, ImportRequest()).missing[0]
    targets = {"P10": (0.0, 0.0, 0.1), "P11": (0.1, 0.0, 0.1)}
    request = ImportRequest(encoders="secondary", flange_targets=targets, accept_unusual=True)
    document = import_files(files, request).measurement_set
    assert (document.units.moment, document.units.force) == ("N.m", "kgf")
    assert document.observations[0].moment == (1.0, 2.0, 3.0)
    assert document.observations[0].load_point == (0.1, 0.2, 0.3)
    error = refused(content.replace("-150,1,2,3,0.1,0.2,0.3,P11", "-151,1,2,3,0.1,0.2,0.3,P11"),
                    reason="the force of 'c01' differs", line=3)  # fmt: skip
    assert "label" in error.remedy
    refused(content.replace("P11", "P10"), reason="P10 deflection of 'c01' occurs twice", line=3, column=14)


def test_a_row_for_each_target_and_state():
    content = """label target state x[mm] y[mm] z[mm]
c01 P10 unloaded 1 2 3.5
c01 P10 Loaded 1.5 2 3
"""
    imported = read(("a.txt", content))
    assert points_of(imported) == {
        ("c01", "P10", "unloaded"): (1, 2, 3.5),
        ("c01", "P10", "loaded"): (1.5, 2, 3),
    }
    refused(content.replace("Loaded", "warm"), reason="'warm' is not a known state",
            line=3, column=3, name="a.txt")  # fmt: skip
    assert read(("a.txt", content.replace("Loaded", "warm")), state_words={"Warm": "loaded"}).preview.states


def test_rows_that_are_commented_out_are_told():
    """A point may also be named #2: that it was not read must be seen."""
    imported = read(("a.csv", changed("c02;", "#2;")))
    assert imported.preview.observation_count == 2
    assert (
        imported.preview.files[0].assumptions[-1]
        == "1 of the comments look like rows of data; they were not read"
    )


def test_units_are_never_guessed():
    bare = CAMPAIGN.replace(" [deg]", "").replace(" [N]", "").replace(" [mm]", "")
    error = refused(bare, reason="joint 1 has no unit", line=2, column=2)
    assert "`units`" in error.remedy
    assert read(("a.csv", bare), units=MM).units == MM
    refused(CAMPAIGN, reason="in mm by its header, but in m by `units`", line=2, column=8,
            units=MM | {"length": "m"})  # fmt: skip
    refused(
        changed("P10 loaded z [mm]", "P10 loaded z [m]"),
        reason="P10 loaded z is in m, but",
        line=2,
        column=13,
    )


def hung(header="mass [kg]", mass="150"):
    """Write the campaign with a mass in place of three columns of force."""
    rows = [[*row[:4], header if index == 0 else mass, *row[7:]] for index, row in enumerate(ROWS)]
    return "\n".join(";".join(row) for row in rows) + "\n"


@pytest.mark.parametrize(
    "header", ["mass [kg]", "Payload (kg)", "hung_mass [kg]", "Gewicht [kg]", "weight [kgf]"]
)
def test_a_hung_mass_is_its_weight_in_kgf(header):
    imported = read(("a.csv", hung(header)), units={"length": "mm", "angle": "deg", "force": "N"})
    assert imported.units["force"] == "kgf"
    assert values_of(imported)["c01", "force"] == (0.0, 0.0, -150.0)
    document = answered(("a.csv", hung(header)), columns={header: "mass [kg]"}).measurement_set
    assert (document.units.force, document.observations[2].force) == ("kgf", (0.0, 0.0, -150.0))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (hung("mass"), "a hung mass is in kg"),
        (hung("mass [lb]"), "a hung mass is in kg"),
        (hung("weight [N]"), "a hung mass is in kg"),
        (hung(mass="-150"), "a hung mass is negative"),
        (CAMPAIGN.replace("P10 unloaded x [mm]", "mass [kg]"), "P10 unloaded x is missing"),
    ],
)
def test_a_mass_that_is_not_clear_is_refused(content, reason):
    assert reason in samples.faults(("a.csv", content))[0].reason


def test_a_mass_beside_forces_is_refused():
    content = CAMPAIGN.splitlines()[1:]
    lines = [f"{line};{'mass [kg]' if index == 0 else 150}" for index, line in enumerate(content)]
    refused("\n".join(lines) + "\n", reason="states the load, and forces state it, too", line=1, column=14)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("1.2.3", "not a number"),
        ("nan", "not a number"),
        ("inf", "not a number"),
        ("-Infinity", "not a number"),
        ("1e999", "is outside"),
        ("1e13", "is outside"),
        ("1_000", "not a number"),
        ("0x10", "not a number"),
        ("1 000.5", "not a number"),
        ("1\u00a0000.5", "not a number"),
        ("٣.٥", "not a number"),
        ("−1.5", "not a number"),
        ("--1", "not a number"),
        ("1.5mm", "not a number"),
        ("1.5 # bumped", "not a number"),
        ("1e", "not a number"),
        (".", "not a number"),
        ("", "cell is empty"),
        ("9" * 50, "not a number"),
        ("1245,7134", "decimal points and decimal commas"),
        ("1,102.5518", "decimal points and decimal commas"),
    ],
)
def test_faulty_numbers(text, reason):
    refused(changed("1102.5518", text), reason=reason, line=4, column=8)


@pytest.mark.parametrize(
    ("old", "new", "reason", "line", "column"),
    [
        ("c02;", "c01;", "the label 'c01' occurs twice", 4, None),
        ("c02;", ";", "name is empty", 4, 1),
        ("c02;-15", "c02;-15;0", "14 cells, but line 2 has 13", 4, 14),
        ("c02;-15;", "c02;", "12 cells, but line 2 has 13", 4, 13),
        (";J2 [deg]", ";J1 [deg]", "a second column for joint 1", 2, 3),
        (";J2 [deg]", ";J4 [deg]", "column joint 2 is missing", 2, 2),
        (";J2 [deg]", ";J0 [deg]", "numbered from 1", 2, 3),
        (";Fy [N]", ";Fx [N]", "a second column for force x", 2, 6),
        ("P10 loaded z", "P10 loaded x", "a second column for P10 loaded x", 2, 13),
        ("P10 loaded z", "P11 loaded z", "column P10 loaded z is missing", 2, 11),
        ("P10 loaded z", "P10 loded z", "column P10 loaded z is missing", 2, 11),
        ("P10 loaded z", "P10 loaded w", "unknown column header", 2, 13),
        ("label", "labl", "unknown column header", 2, 1),
        ("label", "comment", "no column names the observations", 2, None),
        ("label", "", "unknown column header", 2, 1),
        ("label", '"label', "quotation marks", 2, None),
        ("label", 'la"bel', "quotation mark occurs within", 2, 1),
        ("c02;", "c\x002;", "the control character", 4, None),
        ("c02;", "c\u20282;", "is not a valid name", 4, 1),
        ("c02;", "c" * 201 + ";", "is not a valid name", 4, 1),
        ("c02;", "c" * (MAX_CELL_LENGTH + 1) + ";", "a cell has more than", 4, 1),
    ],
)
def test_faulty_tables(old, new, reason, line, column):
    refused(changed(old, new), reason=reason, line=line, column=column)


@pytest.mark.parametrize(
    ("content", "reason", "line"),
    [
        (b"", "empty", None),
        (b" \n\n", "empty", None),
        (b"# only\n// comments\n", "no row of data", None),
        (b"label;x [mm]\n", "a header but no row of data", 1),
        (b"\xff\xfe\x00", "not valid UTF-16", None),
        ("pos\u00e9;1;2;3\n".encode() + b"b\xff;1;2;3", "not UTF-8 from byte", 2),
        (b"1.5 2.5 3.5\n", "3 cells, and there is no header", 1),
        (b"1.5;1.5;2.5;3.5\n", "'1.5' is where a point's name must be", 1),
        (b"a;1;2;3;4;5;6;7\n", "8 cells, and there is no header", 1),
    ],
)
def test_files_that_are_no_tables(content, reason, line):
    with pytest.raises(ImportFileError) as caught:
        read(("a.csv", content), units=MM)
    assert reason in caught.value.reason
    assert caught.value.place.line == line


def test_a_comma_of_thousands_or_decimals():
    """1,234 is both; the file decides, or it is refused."""
    table = "label;J1 [deg];Fx [N];Fy [N];Fz [N]\nc01;{};0;0;-1500\n"
    error = refused(table.format("1,234"), reason="decimal comma or a thousands separator", line=2, column=2)
    assert "decimal_mark" in error.remedy
    assert values_of(read(("a", table.format("1,234")), decimal_mark="comma"))["c01", "joint"] == (1.234,)
    refused(table.format("1,234"), reason="not a number with a decimal point", line=2, column=2,
            decimal_mark="point")  # fmt: skip
    decided = read(("a", table.format("1,234") + "c02;0,5;0;0;-1500\n"))
    assert values_of(decided)["c01", "joint"] == (1.234,)
    assert "the comma was used as the decimal mark" in decided.preview.files[0].assumptions
    assumed = read(("a", table.format("1.234")))
    assert values_of(assumed)["c01", "joint"] == (1.234,)
    assert "not a thousands separator" in assumed.preview.files[0].assumptions[0]


def test_readings_that_are_missing():
    content = changed("1102.5518;402.9017;318.4406", ";;")
    refused(content, reason="target P10 was read only loaded", line=4, column=8)
    imported = read(("a.csv", content), allow_missing=True)
    assert [one.label for one in imported.observations] == ["c01", "c03"]
    assert "c02: target P10 was read only loaded; skipped" in imported.preview.assumptions
    refused(changed("1102.5518;402.9017", ";402.9017"), reason="cell is empty", line=4, column=8,
            allow_missing=True)  # fmt: skip
    refused(changed("c02;-15;-35.125;42.75", "c02;;;"), reason="this row has no joint", line=4, column=2)


def test_readings_held_out_from_the_fit():
    words = iter(["validation", "1", "", "0"])
    content = "\n".join(
        line if line.startswith("#") else line.replace(";", f";{next(words)};", 1)
        for line in CAMPAIGN.splitlines()
    )
    answer = import_files(sources_of(("a.csv", content)), ImportRequest(encoders="motor"))
    assert answer.leave_out == ["c01"]
    assert points_of(read(("a.csv", content))) == points_of(read(("a.csv", CAMPAIGN)))
    refused(content.replace("c01;1;", "c01;yes;"), reason="'yes' is neither 0 nor 1", line=3, column=2)


def test_a_header_of_the_caller():
    body = "".join(CAMPAIGN.splitlines(keepends=True)[2:])
    assert points_of(read(("a.csv", body), header=ROWS[0])) == points_of(read(("a.csv", CAMPAIGN)))
    refused(CAMPAIGN, reason="not a number", line=2, column=2, header=ROWS[0])
    refused(body, reason="13 cells, but the header 12", line=1, column=13, header=ROWS[0][:-1])


def test_limits():
    assert MAX_FILE_BYTES == MAX_SET_BYTES
    big = [(str(index), b"a" * (MAX_FILE_BYTES // 2 + 1)) for index in range(2)]
    with pytest.raises(ImportFileError, match="exceed 8 MiB"):
        read(*big)
    for files in ([], [(str(index), b"a") for index in range(65)]):
        with pytest.raises(ImportFileError, match="1 to 64 files"):
            read(*files)
    with pytest.raises(ImportFileError, match="two files have this name"):
        read(*[("a", b"a")] * 2)
    refused(b"a\n" * (MAX_ROWS + 1), reason="more than 320000 rows", line=MAX_ROWS + 1)
    refused(";".join("a" * (MAX_COLUMNS + 1)), reason="more than 256 columns", line=1)
    refused(b"a" * 70_000, reason="a line has more than", line=1)
    refused(b'"' + b"a" * 20_000, reason="quotation marks", line=1)
    refused(b"\n" * MAX_LINES + b"a b\r\n", reason="more than 400000 lines together")
    read(("a.csv", (CAMPAIGN + "\n" * 201_000).replace("\n", "\r\n").encode("utf-16")))


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
        b"a;b\n" * 100_000,
        b"\r" * 10_000 + b"x",
    ],
)
def test_hostile_texts(content):
    with pytest.raises(ImportFileError):
        read(("a.csv", content))
