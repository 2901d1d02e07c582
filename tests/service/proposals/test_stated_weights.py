"""A load that a file states once, and that hangs by its words, is the force if the deflections confirm it."""

import json

import numpy as np
import pytest
from support.sprung_arm import ARM, STATED, in_tracker, measure
from support.strange_files import JOINTS, digits, table

import jointstiff as js

DOWN = np.array([0.0, 0.0, -1.0])
SIZE = 90.0 * 9.80665
WORDS = "# 90 kg hung at the flange\n"
HEADERS = [*(f"{joint} [deg]" for joint in JOINTS), *(f"{axis}{state}" for state in (1, 2) for axis in "xyz")]


def write(direction=DOWN, count=14, seen=in_tracker, error=1e-5, extra=()):
    """Return a table of an arm under a force of 90 kgf along a direction, in the frame of a tracker."""
    joints, positions = measure(np.tile(SIZE * np.asarray(direction), (count, 1)), error=error)
    rows = 1e3 * seen(positions).reshape(count, 6)
    return table(
        [*HEADERS, *extra],
        [
            [*digits(angles), *digits(row), *("12" for _ in extra)]
            for angles, row in zip(joints, rows, strict=True)
        ],
    )


def propose(text, folder, **stated):
    (folder / "a.csv").write_text(text)
    return js.read(folder / "a.csv", robot=ARM, **(STATED | stated))


@pytest.mark.parametrize(
    "words",
    [
        WORDS,
        "Massa appesa;90;kg\n",
        "# Last 90 kg, angehängt\n",
        "吊重 90 kg\n",
        "Kraft;882.6;N;nach unten\n",
        "# load.force: [0, 0, -882.6] N\n",
        "# 882.6 N pulling downwards\n",
    ],
)
def test_a_load_that_hangs_or_pulls_down_by_its_words_is_taken_with_a_remark(words, tmp_path):
    proposed = propose(words + write(), tmp_path)
    remark = str(proposed)
    assert "force 0,0,-882.6 N along −z of R0, as 'a.csv' says \"" in remark
    assert "in line 1, and the targets move along it in 14 of 14 postures" in remark
    forces = [each.force for each in proposed.accept().measurement_set.observations]
    assert forces == pytest.approx(np.tile(SIZE * DOWN, (14, 1)), abs=0.1)


def test_a_force_down_in_a_vector_of_a_document_is_taken_in_the_unit_of_its_object(tmp_path):
    joints, positions = measure(np.tile(SIZE * DOWN, (14, 1)))
    moved = (1e3 * in_tracker(positions)).round(4)
    poses = [
        {"pose": n + 1, "joints": q, "unloaded": {"smr": pair[0]}, "loaded": {"smr": pair[1]}}
        for n, (q, pair) in enumerate(zip(joints.tolist(), moved.tolist(), strict=True))
    ]
    document = {"load": {"force": [0.0, 0.0, -SIZE], "unit": "N"}, "measurements": poses}
    (tmp_path / "a.json").write_text(json.dumps(document))
    proposed = js.read(tmp_path / "a.json", robot=ARM, **STATED)
    assert "in its fields, and the targets move along it in 14 of 14 postures" in str(proposed)
    forces = [each.force for each in proposed.accept().measurement_set.observations]
    assert forces == pytest.approx(np.tile(SIZE * DOWN, (14, 1)), abs=0.1)


def is_asked(proposed):
    return proposed.accept().missing_fields == ["force"]


@pytest.mark.parametrize("direction", [-DOWN, [0.9, 0.0, -0.1], [0.0, 1.0, 0.0]])
def test_a_load_that_the_deflections_contradict_is_asked(direction, tmp_path):
    assert is_asked(propose(WORDS + write(direction), tmp_path))


def test_a_load_in_few_postures_or_within_the_noise_is_asked(tmp_path):
    assert is_asked(propose(WORDS + write(count=7), tmp_path))
    assert is_asked(propose(WORDS + write(error=6e-4), tmp_path))


@pytest.mark.parametrize(
    "words",
    [
        "# load 90 kg\n",
        "# 90 kg not hung, pushed\n",
        "# 90 kg hung, 45 kg hung\n",
        "# hung: 80-90 kg\n",
        "# max 90 kg hung\n",
        "# robot hangs: 90\n",
        "# load.force: [0, 0, -882.6]\n",
        "# load.force: [0, 0, 882.6] N\n",
        "# load.force: [0, 30, -882.6] N\n",
    ],
)
def test_a_load_that_may_not_hang_or_not_be_this_one_is_asked(words, tmp_path):
    assert is_asked(propose(words + write(), tmp_path))


def test_a_load_next_to_a_column_that_may_be_another_load_is_asked(tmp_path):
    assert is_asked(propose(WORDS + write(extra=["payload"]), tmp_path))


def test_a_stated_force_comes_before_the_load_of_the_words(tmp_path):
    proposed = propose(WORDS + write(), tmp_path, force=[0, 0, -500], units={"force": "N"})
    assert "says" not in str(proposed)
    forces = [each.force for each in proposed.accept().measurement_set.observations]
    assert forces == [(0.0, 0.0, -500.0)] * 14
