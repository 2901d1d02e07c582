"""Labels that end with the state of their row, such as `1u` and `1m`, as a legend explains them."""

import io

import numpy as np
import openpyxl
import pytest
from support.strange_files import both, digits, judge, simulate

import jointstiff as js

ARM = "Yaskawa GP180"
CAMPAIGN = simulate(ARM, seed=6, postures=12)
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm"}
STATED |= {"force": [0, 0, -100], "units": {"force": "kgf"}}
LEGEND = ["Lastprøve", None, "u = uden last", "m = med last (100 kg, 160 mm foran flangen)"]
DEGREES = {
    "Danish, Norwegian, Swedish": "grader",
    "German": "Grad",
    "Italian": "gradi",
    "Spanish": "grados",
    "Portuguese": "graus",
    "Polish": "stopnie",
    "Czech": "stupně",
    "Hungarian": "fok",
    "Turkish": "derece",
    "Dutch": "graden",
    "Finnish": "astetta",
    "Slovene": "stopinje",
    "Croatian": "stupnjeva",
    "Greek": "μοίρες",
    "Ukrainian": "градуси",
}


def write_workbook(endings, *, legend=LEGEND, unit="grader", is_loaded_first=False):
    """Return a workbook whose postures have two rows, with the joints in the first one only."""
    targets = [both(CAMPAIGN, target) for target in range(3)]
    header = ["Nr", *"SLURBT", *(f"Refl {n}" for n in (1, 2, 3) for _ in range(3))]
    units = [None, *[unit] * 6, *["X mm", "Y mm", "Z mm"] * 3]
    book = openpyxl.Workbook()
    for row in (legend, [], header, units):
        book.active.append(row)
    for number, angles in enumerate(np.round(CAMPAIGN.joints, 4).tolist()):
        states = (1, 0) if is_loaded_first else (0, 1)
        for place, (ending, state) in enumerate(zip(endings, states, strict=True)):
            position = [float(cell) for target in targets for cell in digits(target[state][number])]
            book.active.append([f"{number + 1}{ending}", *([None] * 6 if place else angles), *position])
    output = io.BytesIO()
    book.save(output)
    return output.getvalue()


def propose(content, folder):
    (folder / "a.xlsx").write_bytes(content)
    return js.read(folder / "a.xlsx", robot=ARM, **STATED)


@pytest.mark.parametrize("is_loaded_first", [False, True])
def test_a_legend_states_the_endings_of_labels(is_loaded_first, tmp_path):
    endings = ["m", "u"] if is_loaded_first else ["u", "m"]
    proposed = propose(write_workbook(endings, is_loaded_first=is_loaded_first), tmp_path)
    answer = proposed.accept()
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []
    assert "according to row 1 of the sheet 'Sheet' of 'a.xlsx'" in " ".join(answer.assumptions)


def test_a_legend_comes_before_a_known_letter(tmp_path):
    legend = ["Versuch", None, "u = unter Last", "o = ohne Last"]
    content = write_workbook(["u", "o"], legend=legend, is_loaded_first=True)
    answer = propose(content, tmp_path).accept()
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


def test_known_endings_of_labels_are_states_in_any_order(tmp_path):
    content = write_workbook(["-loaded", "-unloaded"], legend=["Test"], is_loaded_first=True)
    answer = propose(content, tmp_path).accept()
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


def test_a_number_with_m_in_a_name_is_no_length(tmp_path):
    answer = propose(write_workbook(["m", "v"], legend=["Test"]), tmp_path).accept()
    assert answer.files[0].columns[0].header == "Nr"
    assert [each.label for each in answer.measurement_set.observations][:2] == ["1", "2"]


@pytest.mark.parametrize("unit", DEGREES.values(), ids=DEGREES)
def test_words_for_degrees_are_units_of_headers(unit, tmp_path):
    answer = propose(write_workbook(["u", "m"], unit=unit), tmp_path).accept()
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []
    assert {column.unit for column in answer.files[0].columns[1:7]} == {"deg"}
