"""`measure` at the terminal: what it says of each reading, and what the person is asked."""

import io
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import typer
from support.command_lines import assert_said, typed
from support.springs import robot_of
from support.terminal import terminal

from jointstiff.service.cli.at_terminal import AtTerminal
from jointstiff.service.live.sources import draw_plausible_stiffness
from jointstiff.simulator import default_arm, simulate_campaign


@pytest.fixture(autouse=True)
def inside(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    document = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    Path("pull.json").write_text(json.dumps(document))


def test_a_goal_takes_five_readings_and_one_that_is_held_out():
    assert_said(
        typed("measure pull.json --goal '25 %' --source simulated:1 --yes --save closed.json --most 6"),
        "Use with care: 5 of 6 joints are known within a factor of 1.5",
        "│ joint_1 │ 7.07 │ 6.84 … 7.31 │ well determined │",
        "│ joint_6 │ 0.161 │ 0.112 … 0.221 │ use with care │",
        "┃ joint ┃ planted ┃ found ┃ 95 % interval ┃",
        "│ joint_6 │ 0.1645 │ 0.161 │ 0.112 … 0.221 │",
        "stiffnesses in 10⁶ N·m/rad; planted by the simulated source",
        "goal: every joint that the load can twist is known to ± 25 %",
        "m01: joint_6 ± 233 %, the number of readings still needed is not known",
        "m02: uncertainty 1.62 times that of the goal, joint_6 ± 41 %, agrees with its prediction (p "
        "0.039), about 9 more readings",
        "m04: uncertainty 0.95 times that of the goal, joint_6 ± 24 %, agrees with its prediction (p "
        "0.95), about 2 "
        "more readings",
        "the measurement continues: 4 readings: the goal needs 5 readings and then a held-out reading; "
        "about 2 more",
        "m05: uncertainty 0.94 times that of the goal, joint_6 ± 24 %, agrees with its prediction (p "
        "0.85), about 1 "
        "more reading",
        "the measurement continues: the goal is met; one held-out reading checks it",
        "m06: uncertainty 0.92 times that of the goal, joint_6 ± 23 %, agrees with its prediction (p 0.98), "
        "held-out reading: as near to its prediction as 90 % of good readings, goal reached",
        "reached after 6 readings; without the assumed errors of load point and force (± 35 % with these "
        "errors); "
        "the held-out reading is as near to its prediction as 90 % of good readings",
        "wrote closed.json",
    )
    assert len(json.loads(Path("closed.json").read_text())["measurement_set"]["observations"]) == 6


def test_a_campaign_that_ends_early_says_what_it_knows():
    line = ["measure", "pull.json", "--goal", "30 %", "--source", "simulated:1", "--json", "--most", "3"]
    answer = json.loads(terminal(*line).stdout)
    assert (answer["readings"], answer["state"], answer["stopped"]) == (3, "measuring", None)
    assert answer["message"] == (
        "3 readings: the goal needs 5 readings and then a held-out reading; about 3 more"
    )
    assert answer["share"] == pytest.approx(0.79906, rel=1e-4)
    first = answer["joints"][0]
    assert first["stiffness"] == pytest.approx(6.8124e6, rel=1e-4)
    assert first["interval"] == pytest.approx([5.9906e6, 7.8954e6], rel=1e-4)
    assert first["relative"] == pytest.approx(0.13550, rel=1e-4)
    planted = [joint["planted"] for joint in answer["planted"]]
    assert [joint["found"] for joint in answer["planted"]] == [
        each["stiffness"] for each in answer["result"]["joints"]
    ]
    assert planted == draw_plausible_stiffness(robot_of(default_arm()), np.random.default_rng(1)).tolist()
    assert [each["label"] for each in answer["record"]] == ["m01", "m02", "m03"]
    assert [each["state"] for each in answer["record"]] == ["counts"] * 3
    second = answer["record"][1]
    assert second["p_value"] == pytest.approx(0.038604, rel=1e-3)
    assert second["distance"] == pytest.approx(2.6057e-3, rel=1e-3)
    assert (second["doubtful"], second["causes"], second["message"]) == (
        False,
        [],
        "the reading agrees with the other readings",
    )
    assert answer["result"]["budget"]["missing"] == ["model_error"]
    assert answer["result"]["compensation"] == pytest.approx(0.98761, rel=1e-4)


@pytest.fixture
def asked(monkeypatch):
    """A function that asks a question, answered with lines of keys, and returns what is decided."""

    def ask(question, keys, **options):
        monkeypatch.setattr("sys.stdin", io.StringIO(keys))
        return decided(question, **options)

    return ask


def decided(question, asks=True, force=(0, 60, -80), anchor=1):
    campaign = SimpleNamespace(source=None, joint_names=["a", "b"], joint_kinds=["revolute", "prismatic"])
    following = SimpleNamespace(label="m01", joints=[0.5, 0.2], force=force, anchor=anchor, reason="first")
    person = AtTerminal(campaign, asks=asks, confirmed=False)
    questions = {
        "unloaded": lambda: person.ready(following, loaded=False),
        "loaded": lambda: person.ready(following, loaded=True),
        "doubt": lambda: person.doubts(None, again=False),
        "earlier": lambda: person.doubts_earlier(None, again=True),
        "missed": lambda: person.missed(OSError("no"), again=False),
        "confirms": lambda: person.confirms("lines"),
    }
    return questions[question]()


QUESTIONS = ("unloaded", "loaded", "doubt", "earlier", "missed")


@pytest.mark.parametrize(
    ("keys", "decisions"),
    [
        ("\n", ["read", "read", "keep", "keep", "stop"]),
        ("r", ["stop", "stop", "again", "keep", "again"]),
        ("K", ["stop", "stop", "keep", "keep", "stop"]),
        ("x\nw", ["stop", "stop", "keep", "withdraw", "stop"]),
        ("s", ["skip", "skip", "keep", "keep", "skip"]),
        ("", ["stop", "stop", "keep", "keep", "stop"]),
    ],
    ids=["Enter", "r", "K", "x, then w", "s", "the end"],
)
def test_the_answer_of_the_person_decides_and_without_one_it_ends(keys, decisions, asked):
    assert [asked(question, keys) for question in QUESTIONS] == decisions


def test_nobody_is_asked_where_nobody_answers(asked):
    assert [asked(question, "", asks=False) for question in QUESTIONS] == [
        "read",
        "read",
        "again",
        "keep",
        "again",
    ]


def test_lines_that_nobody_confirms_are_not_read(asked, capsys):
    with pytest.raises(typer.Exit):
        asked("confirms", "")
    assert capsys.readouterr().err == (
        "lines\ndid the program read the lines correctly? y or n: nobody confirmed that the lines of the "
        "source are read correctly\n  remedy: answer y if the lines are read correctly, or use --yes\n"
    )


@pytest.mark.parametrize(
    ("force", "anchor", "said"),
    [
        ((0, 0, -300), None, "300 N down"),
        ((0, 60, -80), 1, "100 N x +0.00, y +0.60, z -0.80 to anchor 2"),
        ((0, 0, 200), None, "200 N x +0.00, y +0.00, z +1.00"),
        ((0, 0, 0), 0, "no load"),
    ],
)
def test_posture_and_force_are_shown_before_they_are_asked_for(force, anchor, said, asked, capsys):
    for question, words in [
        (
            "unloaded",
            f"\nm01: a 28.65°, b 200.0 mm\n  {said}; first\n  Enter: read without load; s: skip this "
            "posture; q: end: ",
        ),
        (
            "loaded",
            f"  hang the load: {said}\n  Enter: read with the load; s: skip this posture; q: end: ",
        ),
    ]:
        asked(question, "\n", force=force, anchor=anchor)
        assert capsys.readouterr().err == words
