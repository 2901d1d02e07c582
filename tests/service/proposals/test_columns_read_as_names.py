"""Columns whose words are the states or targets of rows: they were read, and are not listed as not read."""

import pytest
from support.strange_files import JOINTS, digits, joint_rows, judge, places, simulate, table

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=14)
STATED = {
    "encoders": "motor", "load_point": [0, 0, 120], "force": [0, 0, -981], "units": {"force": "N"},
    "length_unit": "mm",
}  # fmt: skip


def propose(folder, header, words, remarks=("gut", "gut"), **stated):
    """Propose a table of rows without and under load, with the words of a column and a remark."""
    rows = [
        [*row, words[state], remarks[state], *digits(places(CAMPAIGN, 0, state)[number])]
        for number, row in enumerate(joint_rows(CAMPAIGN))
        for state in (0, 1)
    ]
    (folder / "a.csv").write_text(table(["Pose", *JOINTS, header, "Bem", *"XYZ"], rows), encoding="utf-8")
    return js.read(folder / "a.csv", robot=ARM, **(STATED | stated))


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("Fall", ("leer", "belastet")),
        ("Fall", ("0 kg", "100 kg")),
        ("Fall", ("ohne Last", "mit Last")),
        ("Last", ("0", "1")),
        ("Last", ("nein", "ja")),
    ],
)
def test_a_column_of_states_was_read(header, words, tmp_path):
    force = {"force": None, "units": None} if "kg" in words[0] else {}
    proposal = propose(tmp_path, header, words, **force)
    answer = proposal.accept()
    assert [len(each.readings) for each in answer.measurement_set.observations] == [1] * 14
    assert str(proposal).partition("not read: ")[2].startswith("Bem")
    assert header not in str(proposal).partition("not read: ")[2]
    meanings = {each.header: each.meaning for each in answer.files[0].columns}
    assert (meanings[header], meanings["Bem"]) == ("state", "ignored")


def test_a_column_of_the_callers_words_was_read(tmp_path):
    proposal = propose(tmp_path, "Fall", ("ab", "dran"), state_words={"ab": "unloaded", "dran": "loaded"})
    assert judge(CAMPAIGN, proposal.accept().measurement_set.model_dump(mode="json")) == []
    assert str(proposal).partition("not read: ")[2] == "Bem."


@pytest.mark.parametrize("remarks", [("-", "+X"), ("Max", "Eva"), ("20.1", "20.4")])
def test_a_column_that_only_changes_with_the_states_is_listed_as_not_read(remarks, tmp_path):
    proposal = propose(tmp_path, "Fall", ("leer", "belastet"), remarks)
    assert str(proposal).partition("not read: ")[2] == "Bem."
