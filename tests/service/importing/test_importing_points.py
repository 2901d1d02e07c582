"""Lists of points as tracker software writes them, matched to observations by names of points and files."""

import pytest
from support.importing_samples import MM, POINTS, READ_POINTS, points_of, read, refused

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
