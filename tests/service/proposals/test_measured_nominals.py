"""Reports of nominal and measured positions, the nominal ones measured without load."""

import numpy as np
import pytest
from support.strange_files import both, digits, joints, names, simulate, table

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=14)
UNLOADED, LOADED = both(CAMPAIGN)
HEADER = ["Name", "Control", "Nominal", "Measured", "Deviation"]
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "force": [0, 0, -1313], "units": {"force": "N"}}


def write_report(title="", nominal=UNLOADED):
    rows = [
        [label, "XYZ"[axis], *digits([first[axis], second[axis], second[axis] - first[axis]])]
        for label, first, second in zip(names(CAMPAIGN), nominal, LOADED, strict=True)
        for axis in range(3)
    ]
    return title + table(HEADER, rows, ";")


def propose(report, folder, **stated):
    (folder / "joints.csv").write_text(joints(CAMPAIGN))
    (folder / "report.csv").write_text(report)
    files = (folder / "joints.csv", folder / "report.csv")
    return js.read(*files, robot=ARM, **STATED | {"length_unit": "mm"} | stated)


def accept(report, folder, **stated):
    return propose(report, folder, **stated).accept().measurement_set


def check_both_states(document):
    for own, unloaded, loaded in zip(document.observations, UNLOADED, LOADED, strict=True):
        (reading,) = own.readings
        np.testing.assert_allclose(reading.unloaded, unloaded, atol=1e-3)
        np.testing.assert_allclose(reading.loaded, loaded, atol=1e-3)


@pytest.mark.parametrize(
    "title",
    [
        "Nominal = measured without load, Measured = with 200 kg\n",
        "Nominal: unloaded; Measured: loaded\n",
        "Measured = under load | Nominal = no load\n",
    ],
)
def test_a_title_tells_the_states_of_nominal_and_measured_positions(title, tmp_path):
    check_both_states(accept(write_report(title), tmp_path))


@pytest.mark.parametrize(
    "title",
    [
        "",
        "Nominal = CAD, Measured = with 200 kg\n",
        "Nominal = unloaded, Nominal = loaded, Measured = loaded\n",
    ],
)
def test_nominal_positions_that_fit_like_readings_are_asked(title, tmp_path):
    with pytest.raises(js.CampaignError, match=r"may be the readings without load.*state_words"):
        accept(write_report(title), tmp_path)


@pytest.mark.parametrize("words", [{"Nominal": "unloaded"}, {"Nominal": "unloaded", "Measured": "loaded"}])
def test_the_caller_tells_the_states_of_nominal_and_measured_positions(words, tmp_path):
    check_both_states(accept(write_report(), tmp_path, state_words=words))


@pytest.mark.parametrize(
    "words", [None, {"nominal": "unloaded"}, {"nominal": "unloaded", "measured": "loaded"}]
)
def test_columns_of_nominal_positions_are_asked_and_read_as_stated(words, tmp_path):
    header = ["Name", *(f"{axis} {word}" for word in ("nominal", "measured") for axis in "XYZ")]
    pairs = zip(names(CAMPAIGN), UNLOADED, LOADED, strict=True)
    report = table(header, [[label, *digits([*first, *second])] for label, first, second in pairs], ";")
    if words is None:
        with pytest.raises(js.CampaignError, match="may be the readings without load"):
            accept(report, tmp_path)
    else:
        check_both_states(accept(report, tmp_path, state_words=words))


def test_planned_positions_in_whole_millimetres_are_no_question(tmp_path):
    assert "T1 unloaded" in str(propose(write_report(nominal=np.round(UNLOADED)), tmp_path))
