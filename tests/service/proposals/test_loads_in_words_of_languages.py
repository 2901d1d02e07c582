"""Loads and states in abbreviations and words of several languages, and single numbers of arrays and JSON."""

import io
import json

import numpy as np
import pytest
from support.strange_files import JOINTS, both, simulate, table, wide

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=12)
UNLOADED, LOADED = both(CAMPAIGN)
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm"}


def accept(name, content, folder):
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    proposed = js.read(folder / name, robot=ARM, **STATED)
    return proposed.accept() if hasattr(proposed, "accept") else proposed


def list_places(free, hung):
    return [f"{axis} {word} (mm)" for word in (free, hung) for axis in "XYZ"]


@pytest.mark.parametrize(
    ("free", "hung"),
    [
        ("s/ carga", "c/ carga"), ("w/o load", "w/ load"), ("o. Last", "m. Last"),
        ("s/ charge", "av. charge"), ("u/ last", "m/ last"), ("bez obc.", "z obc."), ("без нагр.", "с нагр."),
    ],
)  # fmt: skip
def test_abbreviated_states_need_no_statement(free, hung, tmp_path):
    header = ["Pose", *(f"{joint} [deg]" for joint in JOINTS), *list_places(hung, free)]
    readings = accept("a.csv", table(header, wide(CAMPAIGN, LOADED, UNLOADED)), tmp_path)
    assert readings.states == ["unloaded", "loaded"]
    assert readings.missing_fields == ["force"]
    assert [each.meaning for each in readings.files[0].columns][7].endswith("loaded x")
    assert "unloaded" not in readings.files[0].columns[7].meaning


@pytest.mark.parametrize(
    "header",
    ["추 무게(kg)", "Груз, кг", "Masa colgada (kg)", "负载质量 [公斤]", "Prüfgewicht [kg]", "Load, kg"],
)
def test_masses_in_words_of_languages_hang_at_the_load_point(header, tmp_path):
    headers = ["Pose", *(f"{joint} [deg]" for joint in JOINTS), header, *list_places("unloaded", "loaded")]
    rows = [[*row[:7], "45", *row[7:]] for row in wide(CAMPAIGN, UNLOADED, LOADED)]
    document = accept("a.csv", table(headers, rows), tmp_path).measurement_set
    assert document.units.force == "kgf"
    assert document.observations[0].force == (0.0, 0.0, -45.0)


@pytest.mark.process
def test_a_mass_among_arrays_answers_the_question_of_the_force(tmp_path):
    stream = io.BytesIO()
    np.savez(stream, q=np.radians(CAMPAIGN.joints), free=UNLOADED, loaded=LOADED, weight_kg=6.0, run=2)
    (missing,) = accept("a.npz", stream.getvalue(), tmp_path).missing
    assert 'says "weight_kg: 6" in its arrays: if this load hangs, `force` is 0,0,-6kgf' in missing


def test_a_mass_in_a_line_of_json_answers_the_question_of_the_force(tmp_path):
    arrays = {"q": CAMPAIGN.joints.tolist(), "free": UNLOADED.tolist(), "loaded": LOADED.tolist()}
    (missing,) = accept("a.json", json.dumps({"payload_kg": 6.5, **arrays}), tmp_path).missing
    assert "if this load hangs, `force` is 0,0,-6.5kgf" in missing


def test_a_mass_that_is_stated_twice_with_other_digits_is_one_mass(tmp_path):
    header = ["Pose", *(f"{joint} [deg]" for joint in JOINTS), *list_places("unloaded", "loaded")]
    notes = "# disc, load 5 kg\n# weighed afterwards: 5.00 kg\n"
    (missing,) = accept("a.csv", notes + table(header, wide(CAMPAIGN, UNLOADED, LOADED)), tmp_path).missing
    assert missing.endswith("if this load hangs, `force` is 0,0,-5kgf")
