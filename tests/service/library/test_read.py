"""`jointstiff.read`: the mapping that the robot proposes for tables, and the campaign of their readings."""

from pathlib import Path

import numpy as np
import pandas
import pytest
from support.measured_arms import TRACKER, measure, wide, write_bare

import jointstiff as js
from jointstiff.service.resources.known_robots import catalogue_robots
from jointstiff.simulator import default_arm, simulate_campaign

EXAMPLES = Path(__file__).parents[3] / "examples"
ARM = "KUKA KR 210 R2700 extra"
LOADED = np.array([0.0, 0.0, -0.9])  # [mm]
STATED = {"encoders": "motor", "load_point": (0.0, 0.0, 120.0), "force": (0.0, 0.0, -900.0)}


@pytest.fixture(scope="module")
def known():
    return next(each for each in catalogue_robots() if each.name == ARM)


@pytest.fixture
def three_files(known, tmp_path):
    joints, points = measure(known)
    seen = (points - [900.0, 2000.0, 0.0]) @ TRACKER.T
    return [
        write_bare(tmp_path / "j.txt", joints),
        write_bare(tmp_path / "s1.txt", seen[:, 0]),
        write_bare(tmp_path / "s1_loaded.txt", seen[:, 0] + LOADED @ TRACKER.T),
    ]


def answer_yes(readings, files, **stated):
    """Return the readings after the first choice of each question."""
    while readings.questions:
        readings = js.read(*files, mapping=readings.questions[0].choices[0].mapping, **stated)
    return readings


def test_three_files_without_headers_become_a_campaign_in_the_frame_of_the_base(known, three_files):
    campaign = answer_yes(js.read(*three_files, robot=ARM, **STATED), three_files, robot=ARM).campaign
    first = campaign.measurement_set.observations[0]
    joints, points = measure(known)
    assert first.joints == pytest.approx(joints[0], abs=1e-4)
    reading = first.readings[0]
    assert campaign.measurement_set.frame is not None
    turn = np.array(campaign.measurement_set.frame.rotation)
    assert turn @ np.subtract(reading.loaded, reading.unloaded) == pytest.approx(LOADED, abs=0.01)
    in_base = turn @ reading.unloaded + campaign.measurement_set.frame.translation
    assert in_base == pytest.approx(points[0, 0], abs=25.0)


def test_readings_show_the_role_of_each_column_and_what_the_robot_says(three_files):
    lines = str(js.read(*three_files, robot=ARM, **STATED)).splitlines()
    assert lines[0] == "j.txt, 16 rows"
    assert lines[1].split()[:3] == ["A", "joints", "[deg]"]
    assert any("positions fit in a frame of the instrument" in line for line in lines)


def test_a_mapping_reads_the_next_files_of_the_form_without_a_robot(known, three_files, tmp_path):
    first = answer_yes(js.read(*three_files, robot=ARM, **STATED), three_files, robot=ARM)
    saved = tmp_path / "mapping.json"
    saved.write_text(first.mapping.model_dump_json(exclude_defaults=True))
    again = js.read(*three_files, mapping=saved)
    assert again.answer.measurement_set == first.answer.measurement_set
    with pytest.raises(js.CampaignError, match="the readings have no robot"):
        _ = again.campaign


def test_a_data_frame_is_read_by_its_columns(known):
    joints, points = measure(known)
    names = [f"J{number} [deg]" for number in range(1, 7)]
    names += [f"P10 {state} {axis} [mm]" for state in ("unloaded", "loaded") for axis in "xyz"]
    table = wide(joints, points[:, 0], points[:, 0] + LOADED)
    frame = pandas.DataFrame(table, columns=names).sample(frac=1.0, axis=1, random_state=3)
    readings = js.read(frame, robot=ARM, **STATED)
    first = readings.campaign.measurement_set.observations[0]
    assert first.joints == pytest.approx(joints[0])
    assert first.readings[0].unloaded == pytest.approx(points[0, 0])


@pytest.mark.parametrize("argument", ["joints", "forces", "unloaded", "loaded"])
def test_an_array_with_names_is_refused_because_its_order_is_not_known(known, argument):
    joints, points = measure(known)
    arrays = {
        "joints": joints,
        "forces": np.tile([0.0, 0.0, -900.0], (16, 1)),
        "unloaded": points[:, 0],
        "loaded": points[:, 0] + LOADED,
    }
    stated = {"load_point": (0.0, 0.0, 120.0), "encoders": "motor"}
    count = arrays[argument].shape[1]
    unnamed = pandas.DataFrame(arrays[argument])
    assert js.Campaign.from_arrays(ARM, **{**arrays, argument: unnamed}, **stated).measurement_set
    for named in (
        pandas.DataFrame(arrays[argument], columns=[f"c{n}" for n in range(count)]),
        pandas.DataFrame(arrays[argument], index=range(16, 0, -1)),
        {f"c{n}": arrays[argument][:, n] for n in range(count)} if argument in ("joints", "forces") else None,
    ):
        if named is not None:
            with pytest.raises(js.CampaignError, match="names, which may be in any order"):
                js.Campaign.from_arrays(ARM, **{**arrays, argument: named}, **stated)


def test_another_arm_explains_nothing_and_the_roles_are_asked(three_files):
    readings = js.read(*three_files, robot="Yaskawa GP25", **STATED)
    assert [each.field for each in readings.questions] == ["tables"]
    with pytest.raises(js.CampaignError, match="no columns fit the robot"):
        _ = readings.campaign


def test_imported_readings_are_identified():
    stated = {"encoders": "motor", "load_point": (0, 0, 120)}
    robot = simulate_campaign(default_arm(), configurations=4)["robot"]
    readings = js.read(EXAMPLES / "readings.csv", robot=robot, **stated)
    run = readings.identify(method="complete_pose")
    assert run.result == js.identify(readings.campaign, method="complete_pose").result
