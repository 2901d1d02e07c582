"""Lists of points as tracker software writes them, matched to observations by names of points and files."""

import pytest
from support.importing_samples import JOINTS, MM, POINTS, READ_POINTS, points_of, read, refused

from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.rows import Template

LINES = [line.split(";") for line in POINTS.splitlines()]


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


def test_positions_and_a_deflection():
    more = POINTS + "c01_P10_deflection;0.1;0.2;0.3\n"
    refused(("a", more), units=MM, reason="positions and a deflection", file="a", line=5, column=2)


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
