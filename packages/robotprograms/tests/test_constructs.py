"""Statements of KRL, RAPID, FANUC, URScript and tables: which moves of a program they leave, and why.

Each is a line of `constructs/` with its outcome; `program_support/constructs.py` says how to read
them. What changed is printed, and written with `--write`, by

    PYTHONPATH=packages/robotprograms/tests .venv/bin/python -m program_support.constructs
"""

import re

import pytest
from program_support.constructs import FOLDER, Constructs

FILES = {path.stem: Constructs.read(path) for path in sorted(FOLDER.glob("*.txt"))}
SUBJECTS = [
    pytest.param(file, subject, id=f"{name}: {subject.title}")
    for name, file in FILES.items()
    for subject in file.subjects
]
OF_ACTING = [(name, file.subjects[0]) for name, file in FILES.items() if name != "tables"]


@pytest.mark.parametrize(("file", "subject"), SUBJECTS)
def test_statements_have_their_outcome(file, subject):
    found = [
        f"{statement}\n  - {wanted}\n  + {now}"
        for statement, wanted, now in file.answers(subject)
        if now != wanted
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(("name", "subject"), OF_ACTING, ids=[name for name, _ in OF_ACTING])
def test_each_statement_that_may_act_leaves_a_move_or_refuses_the_program(name, subject):
    assert subject.title == "Statements that may act"
    assert len(subject.statements) > 100
    passed = [
        statement for statement, outcome in subject.statements if not re.search("left|refused", outcome)
    ]
    assert passed == [""]  # the program around the statements, alone


@pytest.mark.parametrize(("name", "subject"), OF_ACTING, ids=[name for name, _ in OF_ACTING])
def test_no_move_behind_what_is_unknown_is_corrected(name, subject):
    found = [outcome for _, outcome in subject.statements if "unknown" in outcome]
    assert len(found) > 30
    for outcome in found:
        unknown = min(int(line) for line in re.findall(r"(\d+): unknown", outcome))
        moves = re.match(r"[\d ]*", outcome)[0].split()
        assert all(int(line) < unknown for line in moves), outcome


@pytest.mark.parametrize("name", [name for name, _ in OF_ACTING])
def test_a_statement_that_names_no_frame_costs_at_most_its_own_line(name):
    subject = FILES[name].subjects[-1]
    assert subject.title == "Statements that cost at most their own line"
    assert len(subject.statements) > 5
    for _, outcome in subject.statements:
        assert re.match(r"\d+ \d", outcome), outcome  # moves before it and behind it are corrected
        assert len(set(re.findall(r"\d+", re.search(r"left ([\d ]*)|$", outcome)[0]))) <= 1, outcome


@pytest.mark.parametrize("name", FILES)
def test_no_statement_stands_twice(name):
    for subject in FILES[name].subjects:
        statements = [statement for statement, _ in subject.statements]
        assert len(set(statements)) == len(statements)
