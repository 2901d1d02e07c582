"""Messages of joints and of points in one stream: a table for each kind."""

import json

import numpy as np
import pytest
from support.importing_samples import refusals
from support.strange_files import JOINTS, STATES, in_turn, judge, simulate, table

import jointstiff as js
from jointstiff.service.importing.formats.json_rows import read_json_rows

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=32, postures=12)
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "units": {"force": "N"}, "length_unit": "mm"}
STATED |= {"force": [0, 0, -981], "robot": ARM}


def list_messages():
    """Return topic and content of each message: the joints of a posture, then its points."""
    for number, joints in enumerate(CAMPAIGN.joints, 1):
        yield "arm/joints", {"pose": number, "deg": [round(float(each), 5) for each in joints]}
        for is_loaded, positions in enumerate((CAMPAIGN.unloaded, CAMPAIGN.loaded)):
            for target, place in zip("ABC", positions[number - 1], strict=True):
                xyz = [round(1e3 * float(each), 4) for each in place]
                yield "tracker", {"pose": number, "load": bool(is_loaded), "smr": target, "xyz_mm": xyz}


MESSAGES = list(list_messages())
FORMS = {
    "payload": [{"topic": topic, "payload": own} for topic, own in MESSAGES],
    "field of another name": [{"ts": 1.5 * n, "ev": t, "value": own} for n, (t, own) in enumerate(MESSAGES)],
    "no container": [{"topic": topic, **own} for topic, own in MESSAGES],
    "no topic": [own for _, own in MESSAGES],
}


def lines(objects):
    return "\n".join(map(json.dumps, objects)) + "\n"


@pytest.mark.parametrize("write", [lines, json.dumps], ids=["lines", "array"])
@pytest.mark.parametrize("form", FORMS)
def test_each_kind_of_messages_is_a_table_joined_by_the_posture(form, write, tmp_path):
    (tmp_path / "log.json").write_text(write(FORMS[form]))
    accepted = js.read(tmp_path / "log.json", **STATED).accept()
    assert accepted.missing == []
    assert judge(CAMPAIGN, accepted.measurement_set.model_dump(mode="json")) == []


def test_rows_of_one_table_with_other_columns_are_no_kinds_of_messages():
    rows = [{"pose": n, "state": s, "q": [1, 2, 3, 4], f"{s} x": 1.0} for n in range(4) for s in STATES]
    assert len(read_json_rows("a.jsonl", lines(rows).encode())) == 1


def test_sheet_chooses_among_the_kinds_of_messages():
    log = "log.jsonl", lines(FORMS["payload"]).encode()
    (refused,) = refusals(log, sheet="camera")
    assert "the file has no messages 'camera'" in refused
    assert "'arm/joints, tracker'" in refused


@pytest.mark.parametrize("words", [("false", "true"), ("true", "false"), ("ja", "nein")])
def test_the_negative_word_of_two_is_proposed_as_unloaded(words, tmp_path):
    rows = in_turn(CAMPAIGN, words, (CAMPAIGN.unloaded[:, 0], CAMPAIGN.loaded[:, 0]))
    (tmp_path / "a.csv").write_text(table(["Pose", *JOINTS, "blob", *"XYZ"], rows))
    with pytest.raises(js.CampaignError, match=r"'(false|nein)' as `unloaded`"):
        js.read(tmp_path / "a.csv", **STATED | {"force": None}).accept()


def test_a_row_of_joints_without_a_position_warns_of_nothing(tmp_path):
    """The tests make errors of warnings."""
    rows = []
    for joints, *places in zip(CAMPAIGN.joints, *np.moveaxis(CAMPAIGN.unloaded, 1, 0), strict=True):
        cells = [f"{each:.4f}" for each in joints]
        rows += [[*cells, "", "", ""], *([*cells, *(f"{1e3 * each:.3f}" for each in own)] for own in places)]
    (tmp_path / "a.csv").write_text(table([*JOINTS, *"XYZ"], rows))
    with pytest.raises(js.CampaignError):
        js.read(tmp_path / "a.csv", **STATED).accept()
