"""Runs of one campaign, in tables of their own or in rows: each of their postures is an observation."""

import io

import numpy as np
import openpyxl
import pytest
from support.strange_files import JOINTS, both, digits, simulate, table

import jointstiff as js

ARM = "Yaskawa GP180"
CAMPAIGN = simulate(ARM, seed=8, postures=12)
UNLOADED, LOADED = both(CAMPAIGN)
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm"}
STATED |= {"force": [0, 0, -981], "units": {"force": "N"}}
HEADER = ["Pos", *JOINTS, "X0", "Y0", "Z0", "X1", "Y1", "Z1"]


def write_run(shift, joint_shift=0.0):
    """Return the rows of a run whose positions are moved [mm], and its joints [deg]."""
    return [
        [number, *digits(joints + joint_shift), *digits(unloaded + shift), *digits(loaded + shift)]
        for number, joints, unloaded, loaded in zip(
            range(1, 13), CAMPAIGN.joints, UNLOADED, LOADED, strict=True
        )
    ]


def write_book(path, runs):
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows in runs.items():
        sheet = book.create_sheet(title)
        sheet.append(HEADER)
        for row in rows:
            sheet.append([float(cell) for cell in row])
    output = io.BytesIO()
    book.save(output)
    path.write_bytes(output.getvalue())
    return path


def positions_of(proposal, state):
    observations = proposal.accept().measurement_set.model_dump(mode="json")["observations"]
    return np.array([each["readings"][0][state] for each in observations])


def assert_runs_are_observations(proposal, count):
    shifts = positions_of(proposal, "loaded") - positions_of(proposal, "unloaded")
    sizes = np.repeat(np.linalg.norm(LOADED - UNLOADED, axis=1), count)
    assert np.allclose(np.sort(np.linalg.norm(shifts, axis=1)), np.sort(sizes), atol=2e-3)


@pytest.mark.parametrize("title", ["Run {}", "{} Durchgang", "essai{}", "Messreihe_{}"])
def test_the_postures_of_runs_in_sheets_are_observations(title, tmp_path):
    """Also if the arm comes back 0.3 mm aside: both readings of a posture then move alike."""
    runs = {title.format(number): write_run(shift) for number, shift in enumerate((-0.03, 0.01, 0.3), 1)}
    proposal = js.read(write_book(tmp_path / "runs.xlsx", runs), robot=ARM, **STATED)
    assert "are one table" in str(proposal)
    assert_runs_are_observations(proposal, 3)


def test_runs_in_files_are_one_table(tmp_path):
    paths = []
    for number, shift in enumerate((-0.02, 0.02), 1):
        paths.append(tmp_path / f"run{number}.csv")
        paths[-1].write_text(table(HEADER, write_run(shift)), encoding="utf-8")
    proposal = js.read(*paths, robot=ARM, **STATED)
    assert "the rows of 'run1' and 'run2' are one table" in str(proposal)
    assert_runs_are_observations(proposal, 2)


def test_steps_are_no_runs(tmp_path):
    runs = {f"Step {number}": write_run(0.02 * number) for number in (1, 2)}
    with pytest.raises(js.CampaignError):
        js.read(write_book(tmp_path / "runs.xlsx", runs), robot=ARM, **STATED)


def write_repeats(order, noise, form):
    """Return a table with three rows a posture, in runs or in turn, whose positions have noise [mm]."""
    generator = np.random.default_rng(5)
    rows = [
        (
            row[0],
            run,
            [*row[1:7], *digits(np.array(row[7:], float) + np.tile(generator.normal(0.0, noise, 3), 2))],
        )
        for run in (1, 2, 3)
        for row in write_run(0.0)
    ]
    if order == "in turn":
        rows.sort(key=lambda row: row[0])
    joints, places = [f"J{axis}" for axis in range(1, 7)], HEADER[7:]
    header, write = {
        "run and posture": (["Run", "Pos", *joints, *places], lambda pos, run, cells: [run, pos, *cells]),
        "names": (["Punkt", *joints, *places], lambda pos, _, cells: [f"P{pos:02}", *cells]),
        "states in words": (
            ["Pos", *joints, *(f"{state} {axis}" for state in ("ohne Last", "mit Last") for axis in "XYZ")],
            lambda pos, _, cells: [pos, *cells],
        ),
        "bare": ([], lambda _, __, cells: cells),
    }[form]
    return table(header, [write(*row) for row in rows])


@pytest.mark.parametrize("form", ["run and posture", "names", "states in words", "bare"])
@pytest.mark.parametrize("noise", [0.02, 0.2], ids=["repeats", "visits"])
@pytest.mark.parametrize("order", ["in runs", "in turn"])
def test_rows_with_both_states_are_observations_however_often_a_posture_occurs(order, noise, form, tmp_path):
    (tmp_path / "a.csv").write_text(write_repeats(order, noise, form), encoding="utf-8")
    proposal = js.read(tmp_path / "a.csv", robot=ARM, **STATED)
    assert_runs_are_observations(proposal, 3)


def test_rows_that_are_the_states_of_two_instruments_are_no_observations(tmp_path):
    """Two trackers read a target alike; the rows of a posture are farther apart than their readings."""
    rows = [
        [*digits(joints), *digits(place), *digits(place + 0.01)]
        for joints, *places in zip(CAMPAIGN.joints, UNLOADED, LOADED, strict=True)
        for place in places
    ]
    header = [
        *(f"J{axis}" for axis in range(1, 7)),
        *(f"{name} {axis}" for name in ("Faro", "Leica") for axis in "XYZ"),
    ]
    (tmp_path / "a.csv").write_text(table(header, rows), encoding="utf-8")
    with pytest.raises(js.CampaignError):
        js.read(tmp_path / "a.csv", robot=ARM, **STATED)
