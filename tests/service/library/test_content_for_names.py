"""The text of a file in the place of the file's name is named as such, by every verb."""

import json
from pathlib import Path

import pytest
from support.programs import options, path, tool_poses
from support.terminal import terminal

import jointstiff as js
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.programs import program_text

PROGRAM = program_text("krl", tool_poses(path(4)), 4)
DOCUMENT = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
TABLE = "x [mm],y [mm],z [mm],rx [deg],ry [deg],rz [deg]\n1500,0,900,0,180,0\n"
TEXTS = {
    "program": PROGRAM,
    "short program": "PTP P1\nLIN P2\n",
    "table": TABLE,
    "indented JSON document": json.dumps(DOCUMENT, indent=1),
    "JSON document": json.dumps(DOCUMENT),
    "short JSON document": '{"a": 1}',
}
WORDS = r"is the text of .*; remedy: give the name of its file"
FORCE = {"force": (0, 0, -500)}


@pytest.fixture(scope="module")
def run():
    return js.identify(DOCUMENT)


CALLS = {
    "identify": lambda _, text: js.identify(text),
    "load": lambda _, text: js.load(text),
    "read": lambda _, text: js.read(text),
    "compensate": lambda run, text: js.compensate(run, text, accuracy_option="off", **FORCE),
    "loads": lambda run, text: js.compensate(run, "a.src", accuracy_option="off", loads=text),
    "correct": lambda run, text: js.correct(run, text, **FORCE),
    "predict": lambda run, text: run.predict(text),
    "plan": lambda _, text: js.plan(text),
    "compare": lambda _, text: js.compare(text, text),
    "geometry": lambda _, text: js.geometry(DOCUMENT, robot=text),
    "rehearse": lambda _, text: js.rehearse(text),
    "Campaign.read": lambda _, text: js.Campaign.read(text),
}


@pytest.mark.parametrize("verb", CALLS)
@pytest.mark.parametrize("kind", TEXTS)
def test_the_text_of_a_file_is_not_its_name(verb, kind, run):
    with pytest.raises(js.CampaignError, match=WORDS) as error:
        CALLS[verb](run, TEXTS[kind])
    assert len(str(error.value)) < 250
    assert ("JSON document" in str(error.value)) == ("JSON document" in kind)


def test_the_name_of_the_file_works(run, tmp_path):
    source = tmp_path / "drill.src"
    source.write_text(PROGRAM)
    assert js.compensate(run, str(source), **options("krl")).result.points == 4
    campaign = tmp_path / "{odd} name.json"
    campaign.write_text(json.dumps(DOCUMENT))
    assert js.identify(str(campaign)).result.joints == run.result.joints


@pytest.mark.parametrize("command", ["identify", "compensate", "correct", "plan", "import"])
@pytest.mark.parametrize("kind", TEXTS)
def test_the_terminal_names_the_text_of_a_file_too(command, kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("pull.json").write_text(json.dumps(DOCUMENT))
    before = ["pull.json"] if command in {"compensate", "correct"} else []
    shown = terminal(command, *before, TEXTS[kind], *(["-o", "a.src"] if command == "compensate" else []))
    assert shown.exit_code == 2
    assert "is the text of" in " ".join(shown.stderr.split())
    assert "give the name of its file" in " ".join(shown.stderr.split())
