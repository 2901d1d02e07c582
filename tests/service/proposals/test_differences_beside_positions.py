"""Differences beside positions without and under load, as spreadsheets compute them: they state no load."""

import io

import numpy as np
import openpyxl
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on
from support.importing_samples import CAMPAIGN, CAMPAIGN_NUMBERS, answered, numbers_of, refusals

import jointstiff as js

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=25, configurations=12)
UNLOADED = np.round(1e3 * READINGS.position[:, 0], 3)
LOADED = np.round(UNLOADED + [0.01, 0.02, -0.5] + 0.02 * np.sin(UNLOADED), 3)
DIFFERENCES = LOADED - UNLOADED
DEGREES = np.round(np.rad2deg(READINGS.joints), 3)
JOINTS = [f"J{number} [deg]" for number in range(1, 7)]
STATED = {"encoders": "motor", "load_point": [0, 0, 100], "force": [0, 0, -50], "units": {"force": "N"}}
FORMULAS = [[f"={new}{row}-{old}{row}" for old, new in ("HK", "IL", "JM")] for row in range(2, 14)]
WITHOUT = ("X free", "Y free", "Z free")
UNDER = ("X 5kg", "Y 5kg", "Z 5kg")


def workbook(differences, *, without=WITHOUT, under=UNDER, moved=("dX", "dY", "dZ")):
    book = openpyxl.Workbook()
    book.active.append(["P", *JOINTS, *without, *under, *moved])
    for number, row in enumerate(np.hstack([DEGREES, UNLOADED, LOADED]).tolist(), 1):
        book.active.append([number, *row, *differences[number - 1]])
    output = io.BytesIO()
    book.save(output)
    return output.getvalue()


def read(folder, content, **options):
    (folder / "a.xlsx").write_bytes(content)
    proposal = js.read(folder / "a.xlsx", robot=ARM, length_unit="mm", **STATED, **options)
    answer = proposal.accept() if hasattr(proposal, "accept") else proposal
    return str(proposal), [each for own in answer.measurement_set.observations for each in own.readings]


def assert_has_one_load(readings):
    shifts = [np.subtract(each.loaded, each.unloaded) for each in readings]
    assert np.allclose(shifts, DIFFERENCES, atol=1e-9)


@pytest.mark.parametrize(
    ("differences", "moved"),
    [
        (DIFFERENCES, ("dX", "dY", "dZ")),
        (np.round(DIFFERENCES, 2), ("dX", "dY", "dZ")),
        (-DIFFERENCES, ("dX", "dY", "dZ")),
        (np.round(1e3 * DIFFERENCES), ("dX [µm]", "dY [µm]", "dZ [µm]")),
    ],
    ids=["exact", "rounded", "other sign", "µm"],
)
def test_differences_of_positions_are_ignored_with_a_remark(differences, moved, tmp_path):
    text, readings = read(tmp_path, workbook(differences.tolist(), moved=moved))
    assert (
        f"{', '.join(moved)} ignored, the difference of X free, Y free, Z free and X 5kg, Y 5kg, Z 5kg"
        in text
    )
    assert_has_one_load(readings)


@pytest.mark.parametrize(
    "differences",
    [DIFFERENCES, DIFFERENCES[:, [0, 2, 1]] * [1, -1, 1]],
    ids=["axes of the positions", "Y up"],
)
def test_differences_beside_positions_of_unknown_headers_are_no_third_position(differences, tmp_path):
    without, under = ([f"{axis}{number} [mm]" for axis in "XYZ"] for number in (0, 1))
    text, readings = read(tmp_path, workbook(differences.tolist(), without=without, under=under))
    assert "dX, dY, dZ ignored, the difference of X0 [mm]" in text
    assert_has_one_load(readings)


def test_formulas_without_stored_values_are_ignored_with_a_remark(tmp_path):
    text, readings = read(tmp_path, workbook(FORMULAS))
    assert "dX, dY, dZ ignored, which have no numbers" in text
    assert_has_one_load(readings)


NAMED = {
    "without": [f"P1 unloaded {axis} [mm]" for axis in "xyz"],
    "under": [f"P1 loaded {axis} [mm]" for axis in "xyz"],
    "moved": [f"P1 d{axis} [mm]" for axis in "xyz"],
}


def test_formulas_without_values_beside_named_positions_are_not_read(tmp_path):
    text, readings = read(tmp_path, workbook(FORMULAS, **NAMED))
    assert "P1 dx [mm], P1 dy [mm], P1 dz [mm] ignored, which have no numbers" in text
    assert_has_one_load(readings)


def test_displacements_that_are_no_differences_are_never_left_out(tmp_path):
    """Only one of the three axes states more than the positions: another load may have moved the target."""
    without, under = ([f"{axis}{number} [mm]" for axis in "XYZ"] for number in (0, 1))
    other = DIFFERENCES - [0.0, 0.0, 0.3]
    content = workbook(other.tolist(), without=without, under=under)
    with pytest.raises(js.CampaignError, match="third positions") as refused:
        read(tmp_path, content)
    assert r"with `ignore`, in which * is any text, such as `d*`" in str(refused.value)
    _, readings = read(tmp_path, content, ignore=["d*"])
    assert_has_one_load(readings)


def named(change=0.0):
    """Return a table whose names explain its positions and their differences, with a change of the first."""
    header, *rows = CAMPAIGN.splitlines()[1:]
    lines = [f"{header};P10 dx [mm];P10 dy [mm];P10 dz [mm]"]
    for number, row in enumerate(rows):
        numbers = np.array(row.split(";")[-6:], float)
        shift = numbers[3:] - numbers[:3] + (change if number == 0 else 0.0)
        lines.append(row + "".join(f";{each:.4f}" for each in shift))
    return "\n".join(lines) + "\n"


def test_differences_of_positions_by_their_names_are_ignored_with_a_remark():
    answer = answered(("a.csv", named()))
    assert "P10: the deflection is the difference of the positions, and is ignored" in answer.assumptions
    assert numbers_of(answer) == CAMPAIGN_NUMBERS


def test_differences_that_contradict_the_positions_are_refused():
    refused = refusals(("a.csv", named(change=0.01)))
    assert all("has both positions and a deflection" in each for each in refused)
    assert len(refused) == 3
