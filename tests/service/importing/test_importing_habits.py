"""Habits of people and of measuring software: read to the written numbers, or refused with all faults."""

import pytest
from support.importing_samples import CAMPAIGN, JOINTS, faults, points_of, read

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
