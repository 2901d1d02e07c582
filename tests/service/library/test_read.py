"""`jointstiff.read`: what the robot proposes for files without names, and what its acceptance gives."""

import h5py
import numpy as np
import pytest
from scipy.io import savemat
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


def test_names_that_say_everything_leave_the_frame_to_the_robot(known, tmp_path):
    joints, points = measure(known)
    seen = (points[:, 0] - [900.0, 2000.0, 0.0]) @ TRACKER.T
    numbers = wide(np.arange(16)[:, None], joints, seen, seen + LOADED @ TRACKER.T)
    header = ["label", *(f"J{n} [deg]" for n in range(1, 7))]
    header += [f"P10 {state} {axis} [mm]" for state in ("unloaded", "loaded") for axis in "xyz"]
    file = tmp_path / "named.csv"
    np.savetxt(file, numbers, fmt="%.4f", delimiter=";", header=";".join(header), comments="")
    force = {"force": (0, 0, -900), "units": {"force": "N"}}
    proposal = jointstiff.read(file, robot=ARM, **force, **STATED)
    assert "in a frame of the instrument fit the KUKA KR 210" in str(proposal)
    reading = proposal.campaign.measurement_set.observations[0].readings[0]
    assert reading.target == "P10"
    assert np.subtract(reading.loaded, reading.unloaded) == pytest.approx(LOADED, abs=0.01)


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


def write_mat(path, arrays):
    savemat(path, arrays)
    return path


def write_mat_7_3(path, arrays):
    """Write a file as MATLAB writes it since version 7.3: HDF5 behind a header, arrays transposed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in arrays.items():
            dataset = file.create_dataset(name, data=np.transpose(values))
            dataset.attrs["MATLAB_class"] = np.bytes_("double")
    content = bytearray(path.read_bytes())
    content[:19], content[124:128] = b"MATLAB 7.3 MAT-file", b"\x00\x02IM"
    path.write_bytes(content)
    return path


def write_pasted(path, arrays):
    """Write matrices as MATLAB shows them in a program."""
    texts = []
    for name, values in arrays.items():
        rows = (" ".join(f"{number:.4f}" for number in row) for row in values)
        texts.append(f"{name} = [" + ";\n ".join(rows) + "]; % pasted\n")
    path.write_text("".join(texts))
    return path


STACKED = {
    "in turn": lambda points: points.reshape(-1, 3),
    "in blocks": lambda points: points.swapaxes(0, 1).reshape(-1, 3),
    "transposed": lambda points: points.reshape(-1, 3).T,
    "side by side": lambda points: points.reshape(len(points), -1),
    "(n, T, 3)": lambda points: points,
    "(n, 3, T)": lambda points: points.swapaxes(1, 2),
}


@pytest.mark.parametrize(
    ("write", "name", "form"),
    [pytest.param(write_mat, "day1.mat", form, marks=pytest.mark.process) for form in STACKED]
    + [
        pytest.param(write_mat_7_3, "day1.mat", form, marks=pytest.mark.process)
        for form in ("in turn", "in blocks", "transposed", "side by side")
    ]
    + [(write_pasted, "day1.m", form) for form in ("in turn", "in blocks", "side by side")],
)
def test_matrices_of_matlab_with_stacked_targets_become_targets(write, name, form, known, tmp_path):
    joints, points = measure(known)
    points = points[:, :2]  # so that only one axis of a stack has three elements
    arrays = {"Q": joints, "first": STACKED[form](points), "second": STACKED[form](points + LOADED)}
    proposal = jointstiff.read(
        write(tmp_path / name, arrays), robot=ARM, force=(0, 0, -900), units={"force": "N"}, **STATED
    )
    observations = proposal.campaign.measurement_set.observations
    assert len(observations) == len(joints)
    for observation, own, own_points in zip(observations, joints, points, strict=True):
        assert observation.joints == pytest.approx(own, abs=1e-4)
        assert [each.unloaded for each in observation.readings] == [
            pytest.approx(each, abs=1e-3) for each in own_points
        ]
        for reading in observation.readings:
            assert np.subtract(reading.loaded, reading.unloaded) == pytest.approx(LOADED, abs=1e-3)


def test_one_pasted_matrix_needs_no_name(known, tmp_path):
    joints, points = measure(known)
    rows = (", ".join(f"{number:.4f}" for number in row) for row in wide(joints, points.reshape(16, -1)))
    (tmp_path / "day1.txt").write_text("[" + "\n".join(rows) + "]")
    text = str(jointstiff.read(tmp_path / "day1.txt", robot=ARM))
    assert text.startswith("columns 1–6 as J1…J6 [deg], 7–9 as T1 unloaded [mm], 10–12 as T2")
