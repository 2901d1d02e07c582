"""Repeated rows of a posture, target and state: their mean, where nothing else can be meant."""

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=26, configurations=12)
DEGREES = np.rad2deg(READINGS.joints)
PLACES = {"A": 1e3 * READINGS.position[:, 0], "B": 1e3 * READINGS.position[:, 1]}
SAG = {"unloaded": np.zeros(3), "loaded": np.array([0.01, 0.02, -0.5])}
NOISE = (-0.02, 0.0, 0.02)
STATED = {"encoders": "motor", "load_point": [0, 0, 100], "force": [0, 0, -100], "units": {"force": "N"}}
HEADER = ["pose", *(f"J{i}" for i in range(1, 7)), "state"]


def rows_of(number, state, target, column_of_run):
    """Yield the rows of a reading, whose numbers of runs `column_of_run` gives."""
    for run, noise in enumerate(NOISE, 1):
        joints = [f"{each:.3f}" for each in DEGREES[number]]
        place = [f"{each:.3f}" for each in PLACES[target][number] + SAG[state] + noise]
        yield [str(number + 1), *joints, state, column_of_run(run), target, *place]


def write(path, column="run", column_of_run=str, spread=1.0, targets=("A",)):
    rows = [[*HEADER, column, "target", *"XYZ"]]
    for number in range(len(DEGREES)):
        for state in SAG:
            for target in targets:
                rows += rows_of(number, state, target, column_of_run)
    if spread != 1.0:
        for row in rows[1:]:
            row[-1] = f"{float(row[-1]) + spread * (row[-5] == '3'):.3f}"
    path.write_text("".join(",".join(row) + "\n" for row in rows))


@pytest.mark.parametrize("column", ["run", "Lauf", "messung", "scan", "Durchgang"])
@pytest.mark.parametrize("targets", ["A", "AB"])
def test_runs_of_a_state_are_read_as_their_mean_without_an_option(tmp_path, column, targets):
    write(tmp_path / "runs.csv", column, targets=targets)
    proposal = js.read(tmp_path / "runs.csv", robot=ARM, **STATED)
    assert "the mean of repeated readings" in str(proposal)
    observations = proposal.accept().campaign.measurement_set.observations
    assert len(observations) == len(DEGREES)
    for own in observations:
        assert len(own.readings) == len(targets)
        for each in own.readings:
            assert np.allclose(np.subtract(each.loaded, each.unloaded), SAG["loaded"], atol=2e-3)


def test_a_number_of_each_row_is_no_coordinate_of_repeats(tmp_path):
    path = tmp_path / "tidy.csv"
    write(path, "rep", targets="AB")
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([f"run,{head}", *(f"{n},{row}" for n, row in enumerate(rows, 1))]) + "\n")
    proposal = js.read(path, robot=ARM, **STATED)
    assert len(proposal.accept().campaign.measurement_set.observations) == len(DEGREES)


@pytest.mark.parametrize(
    ("column", "column_of_run", "spread"),
    [
        ("run", str, 0.5),
        ("weight no", lambda run: str(20 * run), 1.0),
        ("hook", lambda run: f"hook {'abc'[run - 1]}", 1.0),
    ],
    ids=["far apart", "numbers of loads", "words"],
)
def test_rows_are_no_repeats_without_an_option_where(tmp_path, column, column_of_run, spread):
    path = tmp_path / "runs.csv"
    write(path, column, column_of_run, spread)
    with pytest.raises(js.CampaignError) as refused:
        js.read(path, robot=ARM, **STATED)
    assert "=target" not in str(refused.value)
