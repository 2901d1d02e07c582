"""`jointstiff.read`: what the robot proposes for files without names, and what its acceptance gives."""

import numpy as np
import pytest
from support.measured_arms import PLACES, TRACKER, measure, wide, write_bare

import jointstiff
from jointstiff.service.resources.known_robots import catalogue_robots
from jointstiff.solver.errors import RequestError

ARM = "KUKA KR 210 R2700 extra"
LOADED = np.array([0.0, 0.0, -0.9])  # [mm]
STATED = {"encoders": "motor", "load_point": (0.0, 0.0, 120.0)}


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


def test_three_files_without_a_header_become_a_campaign_in_the_frame_of_the_base(known, three_files):
    proposal = jointstiff.read(*three_files, robot=ARM, force=(0, 0, -900), units={"force": "N"}, **STATED)
    campaign = proposal.campaign
    first = campaign.measurement_set.observations[0]
    joints, points = measure(known)
    assert first.joints == pytest.approx(joints[0], abs=1e-4)
    reading = first.readings[0]
    assert reading.unloaded == pytest.approx(points[0, 0], abs=25.0)
    assert np.subtract(reading.loaded, reading.unloaded) == pytest.approx(LOADED, abs=0.01)


def test_a_proposal_says_columns_residual_and_next_best(three_files):
    proposal = jointstiff.read(*three_files, robot=ARM)
    text = str(proposal)
    assert text.startswith("j.txt columns 1–6 as J1…J6 [deg], s1.txt 1–3 as T1 unloaded [mm] and ")
    assert "s1_loaded.txt 1–3 as T1 loaded [mm] in a frame of the instrument fit the KUKA KR 210" in text
    assert proposal.residual < 2.5
    assert proposal.next_residual > 4 * proposal.residual


def test_without_a_robot_the_catalogue_is_searched(three_files):
    assert jointstiff.read(*three_files).robot.name == f"{ARM} (nominal)"


def test_unknown_headers_keep_the_columns_of_forces_that_names_explain(known, tmp_path):
    joints, points = measure(known)
    force = np.tile([0.0, 0.0, -900.0], (16, 1))
    table = wide(joints, force, points[:, 0] + LOADED, points[:, 0])
    header = "a1q;a2q;a3q;a4q;a5q;a6q;Fx [N];Fy [N];Fz [N];m1;m2;m3;n1;n2;n3"
    np.savetxt(tmp_path / "day1.csv", table, fmt="%.4f", delimiter=";", header=header, comments="")
    readings = jointstiff.read(tmp_path / "day1.csv", robot=ARM, **STATED).accept()
    assert readings.missing == []
    first = readings.measurement_set.observations[0]
    assert first.force == (0.0, 0.0, -900.0)
    # The force moves the target along itself, so that the second triple is the one without a load.
    assert first.readings[0].unloaded == pytest.approx(points[0, 0], abs=1e-3)


def test_files_that_names_explain_need_no_proposal(known, tmp_path):
    joints, points = measure(known)
    names = [*(f"J{j} [deg]" for j in range(1, 7)), *(f"P1 unloaded {axis} [mm]" for axis in "xyz")]
    rows = wide(np.arange(16)[:, None], joints, points[:, 0])
    header = ";".join(["label", *names])
    np.savetxt(tmp_path / "day1.csv", rows, fmt="%.4f", delimiter=";", header=header, comments="")
    readings = jointstiff.read(tmp_path / "day1.csv", robot=ARM)
    assert readings.accept() is readings
    assert readings.targets == ["P1"]


def test_a_doubt_must_be_accepted_by_name(known, tmp_path):
    joints, points = measure(known)
    file = write_bare(tmp_path / "a.txt", wide(joints * [-1, 1, 1, -1, 1, -1], points))
    proposal = jointstiff.read(file, robot=ARM)
    with pytest.raises(RequestError, match="two of x, y and z may be exchanged"):
        proposal.accept()
    first = proposal.accept(despite_doubt=True, encoders="motor").geometry.poses[0]
    assert first.joints == pytest.approx(joints[0], abs=1e-4)


def test_another_arm_explains_nothing_and_the_refusal_says_both_reasons(three_files):
    with pytest.raises(jointstiff.CampaignError, match="the robot explains no columns either") as refused:
        jointstiff.read(*three_files, robot="Yaskawa GP25")
    assert "no columns fit the robot" in str(refused.value)


def test_a_stated_unit_that_the_robot_contradicts_is_no_proposal(three_files):
    with pytest.raises(
        jointstiff.CampaignError, match="by the robot the lengths are in mm, but `units` states in"
    ):
        jointstiff.read(*three_files, robot=ARM, units={"length": "in"})


def test_a_list_of_three_targets_in_turn_becomes_three_targets(known, tmp_path):
    joints, points = measure(known)
    files = [write_bare(tmp_path / "j.txt", joints), write_bare(tmp_path / "p.txt", points.reshape(-1, 3))]
    answer = jointstiff.read(*files, robot=ARM).accept()
    assert answer.targets == ["T1", "T2", "T3"]
    assert len(PLACES) == len(answer.geometry.poses[0].targets)
