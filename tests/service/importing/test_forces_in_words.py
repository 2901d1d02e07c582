"""Forces as people name and write them: in words of several languages, as a size, in lists and in arrays."""

import numpy as np
import pytest
from support.strange_files import JOINTS, both, digits, joint_rows, judge, simulate, table, wide

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=14)
UNLOADED, LOADED = both(CAMPAIGN)
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm"}
POINTS = [f"{axis} {word} [mm]" for word in ("unloaded", "loaded") for axis in "xyz"]


def propose(files, folder, **stated):
    for name, content in files.items():
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return js.read(*(folder / name for name in files), robot=ARM, **(STATED | stated))


def accept(files, folder, **stated):
    proposed = propose(files, folder, **stated)
    return proposed.accept() if hasattr(proposed, "accept") else proposed


def read_force(files, folder, **stated):
    """Return the force of the first observation [N]; the readings are those of the campaign."""
    document = accept(files, folder, **stated).measurement_set.model_dump(mode="json")
    newtons = {"N": 1.0, "kN": 1e3, "kgf": 9.80665}[document["units"]["force"]]
    force = [newtons * each for each in document["observations"][0]["force"]]
    document["units"]["force"] = "N"
    assert judge(CAMPAIGN, document) == []
    return force


def with_columns(headers, cells, loaded=LOADED):
    rows = [[*row[:7], *cells, *row[7:]] for row in wide(CAMPAIGN, UNLOADED, loaded)]
    return {"a.csv": table(["Pose", *(f"{joint} [deg]" for joint in JOINTS), *headers, *POINTS], rows)}


@pytest.mark.parametrize(
    ("form", "newtons"),
    [
        ("Fuerza {} (N)", 1),
        ("Forza {} [N]", 1),
        ("Força {} (N)", 1),
        ("Force en {} (N)", 1),
        ("Kracht {} [N]", 1),
        ("力{}[N]", 1),
        ("Kraft {} [kN]", 1e3),
        ("Kraft in {} [kN]", 1e3),
        ("Applied load {} [N]", 1),
        ("F.{} [N]", 1),
    ],
)
def test_parts_of_a_force_are_known_by_its_word_and_an_axis(form, newtons, tmp_path):
    headers = [form.format(axis) for axis in "XYZ"]
    files = with_columns(headers, ["0", "0", f"{-981 / newtons}"])
    assert read_force(files, tmp_path) == pytest.approx([0.0, 0.0, -981.0])


@pytest.mark.parametrize("header", ["Carga [kg]", "Last [kg]", "Load (kg)", "Carico [kg]"])
def test_a_load_in_kg_hangs_at_the_load_point(header, tmp_path):
    assert read_force(with_columns([header], ["100"]), tmp_path) == pytest.approx([0.0, 0.0, -980.665])


@pytest.mark.parametrize(
    ("header", "cell"),
    [("Kraft [kN]", "0.981"), ("Fuerza (N)", "-981"), ("F [N]", "981"), ("Last [N]", "981")],
)
def test_a_force_without_an_axis_is_a_weight_if_the_targets_move_down(header, cell, tmp_path):
    files = with_columns([header], [cell])
    assert f"{header!r} as the size of a force along −z of R0" in str(propose(files, tmp_path))
    assert read_force(files, tmp_path) == pytest.approx([0.0, 0.0, -981.0])


def test_a_force_without_an_axis_is_no_weight_if_the_targets_move_aside(tmp_path):
    files = with_columns(["Kraft [N]"], ["981"], UNLOADED + np.array([0.0, 0.7, -0.2]))
    answer = accept(files, tmp_path)
    assert answer.measurement_set is None
    assert "the force of each observation" in answer.missing[0]


def test_a_stated_force_of_another_size_than_that_of_the_file_is_refused(tmp_path):
    files = with_columns(["Kraft [kN]"], ["0.981"])
    with pytest.raises(js.CampaignError, match="`force` is 500 N, but 'Kraft \\[kN\\]' has 981 N"):
        propose(files, tmp_path, force=[0, 0, -500], units={"force": "N"})
    aside = read_force(files, tmp_path, force=[0, -981, 0], units={"force": "N"})
    assert aside == pytest.approx([0.0, -981.0, 0.0])


def test_sizes_of_several_forces_in_turn_are_loads_of_a_posture(tmp_path):
    rows = [
        [*row, str(size), *digits(UNLOADED[n] + size / 1000 * (LOADED[n] - UNLOADED[n]))]
        for n, row in enumerate(joint_rows(CAMPAIGN))
        for size in (0, 500, 1000)
    ]
    header = ["Pose", *(f"{joint} [deg]" for joint in JOINTS), "Kraft [N]", *"XYZ"]
    observations = accept({"a.csv": table(header, rows)}, tmp_path).measurement_set.observations
    assert [each.force[2] for each in observations] == [-500.0] * 14 + [-1000.0] * 14
