"""Lists of points as tracker software writes them, matched to observations by names of points and files."""

from __future__ import annotations

import pytest
from support.importing_samples import (
    JOINTS,
    MM,
    POINTS,
    READ_POINTS,
    answered,
    points_of,
    read,
    refused,
)

from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.rows import Template

LINES = [line.split(";") for line in POINTS.splitlines()]


def sa(separator):
    """As SpatialAnalyzer exports points: comments, then names in three parts."""
    rows = []
    for name, *xyz in LINES:
        label, target, state = name.split("_")
        names = [state.title(), label, target]
        rows.append(", ".join(["::".join(names)] if separator == "::" else names) + ", " + ", ".join(xyz))
    return "// SpatialAnalyzer: working frame A::R0\n// X, Y, Z in mm\n" + "\n".join(rows) + "\n"


@pytest.mark.parametrize(
    "content",
    [
        POINTS,
        "name;x [mm];y [mm];z [mm]\n" + POINTS,
        POINTS.replace(";", "   "),
        POINTS.replace(";", "\t").replace(".", ","),
        POINTS.replace(";", " ").replace(".", ","),
        "# name x[mm] y[mm] z[mm]\n" + POINTS.replace(";", " "),
        sa("::"),
        sa(","),
        "Collection, Group, Point, X, Y, Z\n" + sa(","),
        "Collection\tGroup\tPoint Name\tX (mm)\tY (mm)\tZ (mm)\n"
        + sa(",").replace(", ", "\t").split("mm\n")[1],
        "Name,X,Y,Z,I,J,K,RMS\n" + "".join(f'"{n}",{x},{y},{z},0,0,1,0.01\n' for n, x, y, z in LINES),
        "\n".join(f"{n:<20}{x:>14}{y:>14}{z:>14}" for n, x, y, z in LINES),
    ],
)
def test_lists_of_points(content):
    imported = read(("points.txt", content), units=MM)
    assert points_of(imported) == READ_POINTS


def test_columns_in_another_order():
    content = "y [mm];name;z [mm];x [mm]\n" + "".join(f"{y};{n};{z};{x}\n" for n, x, y, z in LINES)
    assert points_of(read(("a.txt", content))) == READ_POINTS
    commented = "# y[mm] name z[mm] x[mm]\n" + "".join(f"{y} {n} {z} {x}\n" for n, x, y, z in LINES)
    imported = read(("a.txt", commented))
    assert points_of(imported) == READ_POINTS
    assert "the comment in line 1 was used as the header" in imported.preview.files[0].assumptions


def test_a_list_without_header_needs_units():
    error = refused(("a.txt", POINTS), reason="position x has no unit", file="a.txt", column=2)
    assert "`units`" in error.remedy
    imported = read(("a.txt", POINTS), units=MM)
    assert "no header found; assumed columns: name, x, y, z" in imported.preview.files[0].assumptions
    assert imported.units == {"length": "mm"}


@pytest.mark.parametrize("row", ["c01 1 2 3.5 0.01", "A c01 1 2 3 0.01", "c01 1 2 3 1 0", "1 1 2 3.5 0.01"])
def test_more_numbers_than_three_need_a_header(row):
    """`name x y z rms` is not `group point x y z`, even if x is a whole number."""
    with pytest.raises(ImportFileError, match="where a point's name must be"):
        read(("loaded.txt", row), units=MM)


def by_target_and_state(name="{target}_{state}.txt"):
    files = {}
    for point, *xyz in LINES:
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


def test_a_file_for_each_state_or_observation():
    states, labels = {}, {}
    for point, *xyz in LINES:
        label, target, state = point.split("_")
        key = f"{state}.txt"
        states[key] = states.get(key, "") + " ".join([f"{label}_{target}", *xyz]) + "\n"
        key = f"{label}.asc"
        labels[key] = labels.get(key, "") + " ".join([f"{target}-{state}", *xyz]) + "\n"
    assert points_of(read(*states.items(), units=MM)) == READ_POINTS
    options = {"point_name": "{target}-{state}", "file_name": "{label}"}
    assert points_of(read(*labels.items(), units=MM, **options)) == READ_POINTS


def test_joints_and_points_in_different_files():
    imported = read(("joints.csv", JOINTS), ("points.txt", POINTS), units=MM)
    assert imported.preview.reading_count == 2
    document = answered(("joints.csv", JOINTS), ("points.txt", POINTS), units=MM).measurement_set
    assert [one.label for one in document.observations] == ["c01", "c02"]
    assert document.observations[1].joints == [-15.0, -35.125]
    assert document.observations[1].readings[0].loaded == READ_POINTS["c02", "P10", "loaded"]


def test_labels_must_agree():
    other = JOINTS.replace("c02", "c03")
    refused(("j.csv", other), ("p.txt", POINTS), units=MM,
            reason="'c02' has no joint, but other labels have", file="p.txt", line=3)  # fmt: skip
    fewer = "\n".join(JOINTS.splitlines()[:2])
    refused(("j.csv", fewer), ("p.txt", POINTS), units=MM, reason="'c02' has no joint", file="p.txt", line=3)
    more = JOINTS + "c04,1,2,0,0,-1471.5\n"
    refused(("j.csv", more), ("p.txt", POINTS), units=MM, reason="c04: target P10 has no reading",
            file="j.csv", line=4)  # fmt: skip
    imported = read(("j.csv", more), ("p.txt", POINTS), units=MM, allow_missing=True)
    assert imported.preview.observation_count == 2
    assert "c04: no reading is complete; the observation was skipped" in imported.preview.assumptions


@pytest.mark.parametrize(
    ("old", "new", "reason", "line", "column"),
    [
        ("c02_P10_loaded", "c01_P10_loaded", "P10 loaded of 'c01' occurs twice", 4, 2),
        ("c02_P10_loaded", "c02_P11_loaded", "c02: target P10 was read only unloaded", 3, 2),
        ("c02_P10_loaded", "c02_P10_laoded", "does not show which", 4, 1),
        ("c02_P10_loaded", "c02_P10_1_loaded", "does not show which", 4, 1),
        ("c02_P10_loaded", "c02__loaded", "given neither by the table nor", None, None),
        ("c02_P10_loaded", "c02", "given neither by the table nor", None, None),
        ("c02_P10_loaded", "loaded_u_P10", "does not show which", 4, 1),
        ("c02_P10_loaded", "2.5", "where a point's name must be", 4, 1),
        ("c02_P10_loaded", "name", "where a point's name must be", 4, 1),
        ("c02_P10_loaded", "", "name is empty", 4, 1),
        ("1102.4127", "1102.4.127", "not a number", 4, 2),
        (";1102.4127", "", "3 cells, but line 1 has 4", 4, 4),
    ],
)
def test_faulty_lists(old, new, reason, line, column):
    refused(("points.txt", POINTS.replace(old, new)), units=MM, reason=reason, file="points.txt",
            line=line, column=column)  # fmt: skip


def test_one_state_alone_is_incomplete():
    alone = "".join(line + "\n" for line in POINTS.splitlines() if "_unloaded" in line)
    answer = answered(("points.txt", alone), units=MM)
    assert "the positions under load" in answer.missing
    assert answer.preview.reading_count == 0


def test_positions_and_a_deflection():
    more = POINTS + "c01_P10_deflection;0.1;0.2;0.3\n"
    refused(("a", more), units=MM, reason="positions and a deflection", file="a", line=5, column=2)


@pytest.mark.parametrize(
    ("template", "name", "expected"),
    [
        ("{label}_{target}_{state}", "c01_P10_loaded", ("c01", "P10", "loaded")),
        ("{state}-{label}.{target}", "UNLOADED-c_01.P_10", ("c_01", "P_10", "unloaded")),
        ("A::{label}_{state}::{target}", "A::c01_l::P10", ("c01", "P10", "loaded")),
        ("{any}::{target} {label}", "x::P10 c01", ("c01", "P10", None)),
        ("{label}", "any_thing. [at] all", ("any_thing. [at] all", None, None)),
        ("c({label})+", "c(1)+", ("1", None, None)),
    ],
)
def test_templates(template, name, expected):
    naming = Template(template).parse(name, {})
    assert (naming.label, naming.target, naming.state) == expected


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


@pytest.mark.parametrize(
    "template", ["", "c01", "{any}", "{label}{target}", "{label}_{label}", "{x}", "{label}_{", "{}"]
)
def test_templates_that_are_refused(template):
    with pytest.raises(ImportFileError, match="is invalid"):
        Template(template)


def test_names_of_the_caller_for_states():
    content = POINTS.replace("unloaded", "0kg").replace("loaded", "150kg")
    words = {"0kg": "unloaded", "150kg": "loaded"}
    assert points_of(read(("a", content), units=MM, state_words=words)) == READ_POINTS
    refused(("a", content), units=MM, reason="does not show which", file="a", line=1, column=1)


def test_names_that_contradict():
    file = ("P11_loaded.txt", POINTS)
    options = {"units": MM, "point_name": "{label}_{target}_{state}", "file_name": "{target}_{state}"}
    refused(file, reason="the target is 'P10' in one name and 'P11' in another", file="P11_loaded.txt",
            line=1, column=1, **options)  # fmt: skip


def test_too_many_targets_show_a_wrong_template():
    content = "".join(f"P10_c{number:02}_{state} 1 2 3.5\n" for number in range(17) for state in "ul")
    error = refused(("a", content), units=MM, reason="more than 16 targets", file="a", line=33, column=2)
    assert "point_name" in error.remedy


def test_units_of_all_files_agree():
    files = [(name, f"name x[{unit}] y[{unit}] z[{unit}]\n{content}")
             for (name, content), unit in zip(by_target_and_state(), ("mm", "m"), strict=True)]  # fmt: skip
    refused(*files, reason="length is m, but mm in other files", file="P10_loaded.txt")
