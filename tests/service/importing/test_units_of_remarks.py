"""Units of forces in comments, in titles of blocks and in scripts: no question for what a file states."""

import pytest
from support.strange_files import JOINTS, both, joint_rows, judge, simulate, table, wide

import jointstiff as js
from jointstiff.service.importing.grid import Remark
from jointstiff.service.importing.unit_remarks import find_unit_of_forces

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=13, postures=12)
STATED = {"robot": ARM, "encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm"}
POINTS = [f"{axis} {word} [mm]" for word in ("unloaded", "loaded") for axis in "xyz"]
FORCE = ["0", "0", "-0.981"]


def write_table(label):
    rows = [[*row, *FORCE] for row in wide(CAMPAIGN, *both(CAMPAIGN))]
    return table([label, *(f"{joint} [deg]" for joint in JOINTS), *POINTS, "Fx", "Fy", "Fz"], rows)


def assert_kilonewtons(text, folder, name="a.csv"):
    (folder / name).write_text(text)
    imported = js.read(folder / name, **STATED)
    accepted = imported.accept() if hasattr(imported, "accept") else imported
    assert accepted.missing == []
    document = accepted.measurement_set.model_dump(mode="json")
    assert document["units"]["force"] == "kN"
    assert {tuple(each["force"]) for each in document["observations"]} == {(0.0, 0.0, -0.981)}
    document["units"]["force"] = "N"
    for each in document["observations"]:
        each["force"] = [0.0, 0.0, -981.0]
    assert judge(CAMPAIGN, document) == []
    return str(accepted.model_dump())


@pytest.mark.parametrize("label", ["label", "Stellg"], ids=["known header", "proposal"])
@pytest.mark.parametrize(
    "remark",
    [
        "# forces in kN",
        "# Kräfte am Flansch [kN]",
        "# Length mm, angle deg, force kN (load cell + cable direction)",
        "# positions en mm, efforts en kN (peson 6 axes)",
        "# Siły działające na robota [kN]",
    ],
)
def test_a_remark_states_the_unit_of_forces(remark, label, tmp_path):
    shown = assert_kilonewtons(f"{remark}\n{write_table(label)}", tmp_path)
    assert "forces are in kN, as the file states" in shown


def test_a_comment_of_a_script_states_the_unit_of_forces(tmp_path):
    def matrix(name, rows):
        return f"{name} = [\n" + "\n".join(" ".join(row) + ";" for row in rows) + "\n];\n"

    rows = wide(CAMPAIGN, *both(CAMPAIGN))
    parts = {
        "q": [row[1:7] for row in joint_rows(CAMPAIGN)],
        "unloaded": [row[7:10] for row in rows],
        "loaded": [row[10:13] for row in rows],
        "F": [FORCE for _ in rows],
    }
    script = "% q en deg, positions en mm, efforts en kN (peson)\n"
    script += "".join(matrix(name, own) for name, own in parts.items())
    assert_kilonewtons(script, tmp_path, "a.m")


def test_another_stated_unit_of_forces_contradicts_the_remark(tmp_path):
    (tmp_path / "a.csv").write_text(f"# forces in kN\n{write_table('label')}")
    with pytest.raises(js.CampaignError, match="in kN according to the file's comment, but in N according"):
        js.read(tmp_path / "a.csv", **STATED, units={"force": "N"})


@pytest.mark.parametrize(
    "remarks",
    [
        ["forces in kN", "Kraft [N]"],
        ["force sensor 5 kN"],
        ["moments of the force in kN.m"],
        ["force n"],
        ["the force is on the robot"],
        ["load cell, 5 kN"],
    ],
)
def test_other_remarks_state_no_unit_of_forces(remarks):
    assert find_unit_of_forces([Remark(number, text) for number, text in enumerate(remarks)]) is None
