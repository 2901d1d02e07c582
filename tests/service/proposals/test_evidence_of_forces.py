"""Deflections show which columns are forces, in whose axes, and whether a size acts along −z."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.sprung_arm import ARM, STATED, TURN, in_tracker, measure
from support.strange_files import JOINTS, digits, table

import jointstiff as js
from jointstiff.service.importing.grammar import looks_like_a_force

TILT = Rotation.from_euler("yx", [2.0, -1.5], degrees=True)


def pull(seed=2, count=14):
    return 900.0 * np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 3))


def write_rows(joints, positions, *others):
    columns = [*(1e3 * positions).reshape(len(joints), 6).T, *np.column_stack(others).T]
    return [
        [*digits(angles), *digits(row)] for angles, row in zip(joints, np.column_stack(columns), strict=True)
    ]


HEADERS = [
    *(f"{joint} [deg]" for joint in JOINTS),
    *(f"{axis}{n} [mm]" for n, axis in product((1, 2), "xyz")),
]


def propose(text, folder, **stated):
    (folder / "a.csv").write_text(text)
    return js.read(folder / "a.csv", robot=ARM, **(STATED | stated))


def read_forces(proposed, newtons=1.0):
    readings = proposed.accept()
    return newtons * np.array([each.force for each in readings.measurement_set.observations])


def test_forces_along_the_axes_of_the_tracker_are_turned_with_the_positions(tmp_path):
    forces = pull()
    joints, positions = measure(forces)
    rows = write_rows(joints, in_tracker(positions), TURN.inv().apply(forces))
    proposed = propose(table([*HEADERS, "Fx [N]", "Fy [N]", "Fz [N]"], rows), tmp_path)
    angle = np.degrees(TURN.magnitude())
    said = f"the forces of the file were turned by {angle:.1f}° from the instrument's axes into R0, as the "
    assert f"{said}deflections show" in str(proposed)
    assert read_forces(proposed) == pytest.approx(forces, abs=5.0)


def test_forces_in_axes_of_r0_stay_where_positions_are_turned(tmp_path):
    forces = pull()
    joints, positions = measure(forces)
    rows = write_rows(joints, in_tracker(positions), forces)
    proposed = propose(table([*HEADERS, "Fx [N]", "Fy [N]", "Fz [N]"], rows), tmp_path)
    assert "the forces of the file were turned" not in str(proposed)
    assert read_forces(proposed) == pytest.approx(forces, abs=1e-3)


HEADERS_OF_FORCE = ["Fx [N]", "Fy [N]", "Fz [N]"]


@pytest.mark.parametrize("axes", ["R0", "tracker"])
def test_a_weight_beside_positions_of_a_tilted_tracker_is_vertical_in_r0_and_the_axes_are_said(
    axes, tmp_path
):
    forces = np.tile([0.0, 0.0, -900.0], (14, 1))
    joints, positions = measure(forces, error=1e-4)
    written = forces if axes == "R0" else TILT.inv().apply(forces)
    rows = write_rows(joints, in_tracker(positions, TILT), written)
    proposed = propose(table([*HEADERS, *HEADERS_OF_FORCE], rows), tmp_path)
    said = "turned by 2.5° from the instrument's axes into R0"
    if axes == "R0":
        said = "read in axes of R0, from which the instrument's axes differ by 2.5°"
    assert f"the forces of the file were {said}, as they are then vertical, as a weight is" in str(proposed)
    assert read_forces(proposed) == pytest.approx(forces, abs=3.0)


def test_forces_in_the_table_of_a_tilted_tracker_are_never_taken_in_some_axes_silently(tmp_path):
    forces = np.tile([500.0, 300.0, -600.0], (14, 1))
    joints, positions = measure(forces, error=1e-4)
    rows = write_rows(joints, in_tracker(positions, TILT), TILT.inv().apply(forces))
    proposed = propose(table([*HEADERS, *HEADERS_OF_FORCE], rows), tmp_path)
    assert "the forces of the file were turned by 2.5° from the instrument's axes into R0, as " in str(
        proposed
    )
    assert read_forces(proposed) == pytest.approx(forces, abs=5.0)


@pytest.mark.parametrize("axes", ["R0", "tracker"])
def test_columns_without_headers_along_the_deflections_are_forces_whose_unit_is_the_only_question(
    axes, tmp_path
):
    forces = pull()
    joints, positions = measure(forces)
    written, seen = (forces, positions)
    if axes == "tracker":
        written, seen = TURN.inv().apply(forces), in_tracker(positions)
    text = table([], write_rows(joints, seen, written))
    said = r"columns 13–15 as the force, as the deflections show.*such as `units`: {\"force\": \"N\"}"
    with pytest.raises(js.CampaignError, match=said):
        propose(text, tmp_path)
    proposed = propose(text, tmp_path, units={"force": "N"})
    assert read_forces(proposed) == pytest.approx(forces, abs=5.0)


def test_numbers_that_do_not_explain_the_deflections_are_no_force(tmp_path):
    joints, positions = measure(pull())
    proposed = propose(table([], write_rows(joints, positions, pull(seed=9))), tmp_path)
    assert "not read: column 13, column 14, column 15" in str(proposed)


def test_one_force_is_refused_where_columns_are_the_force_of_each_row(tmp_path):
    forces = pull()
    joints, positions = measure(forces)
    along = np.sum(positions[:, 1] - positions[:, 0], axis=0)
    stated = {"force": (900.0 * along / np.linalg.norm(along)).tolist(), "units": {"force": "N"}}
    with pytest.raises(js.CampaignError, match="columns 13–15 are the force of each row"):
        propose(table([], write_rows(joints, positions, forces)), tmp_path, **stated)


def write_blocks(joints, positions, forces):
    """Return rows without load above those under load, which have forces in columns without headers."""
    texts = [[*JOINTS, "X", "Y", "Z", "", "", ""]]
    for state, others in enumerate((np.full_like(forces, np.nan), forces)):
        rows = np.column_stack([joints, 1e3 * positions[:, state], others])
        texts += [["" if np.isnan(each) else f"{each:.4f}" for each in row] for row in rows]
    names = [
        "pose",
        *(f"P{n}" for n in range(1, len(joints) + 1)),
        *(f"P{n}" for n in range(1, len(joints) + 1)),
    ]
    states = ["state", *("unloaded" for _ in joints), *("loaded" for _ in joints)]
    return (
        "\n".join(";".join(row) for row in zip(names, states, *zip(*texts, strict=True), strict=True)) + "\n"
    )


def test_the_force_of_rows_under_load_in_columns_without_headers_is_read(tmp_path):
    forces = pull()
    joints, positions = measure(forces)
    proposed = propose(write_blocks(joints, positions, forces), tmp_path, units={"force": "N"})
    assert "columns 12–14 as the force, as the deflections show" in str(proposed)
    assert read_forces(proposed) == pytest.approx(forces, abs=1e-3)


def test_one_force_is_refused_beside_columns_that_may_be_the_force_of_rows_under_load(tmp_path):
    forces = pull(count=5)
    joints, positions = measure(forces)
    joints, positions = np.vstack([joints] * 2), np.vstack([positions] * 2)
    forces = np.vstack([forces] * 2)
    joints[5:], positions[5:] = (each for each in measure(forces[:5], seed=8))
    stated = {"force": [0, 0, -900], "units": {"force": "N"}}
    with pytest.raises(js.CampaignError, match=r"columns 12–14.*(may be|are) the force of each row"):
        propose(write_blocks(joints, positions, forces), tmp_path, **stated)


def sizes(direction, count=14):
    size = np.random.default_rng(4).uniform(700.0, 1200.0, count)
    return size, size[:, None] * np.array(direction)


def test_sizes_of_a_force_are_weights_where_only_a_pull_down_explains_the_deflections(tmp_path):
    size, forces = sizes((0.0, 0.0, -1.0))
    joints, positions = measure(forces)
    proposed = propose(
        table([*HEADERS, "Load cell force [N]"], write_rows(joints, positions, size)), tmp_path
    )
    unknown = propose(table([*HEADERS, "Cell 3 [N]"], write_rows(joints, positions, size)), tmp_path)
    assert "as the size of a force along −z of R0, as the deflections show" not in str(unknown)
    proposed = propose(table([*HEADERS, "Kraft [N]"], write_rows(joints, positions, size)), tmp_path)
    assert "'Kraft [N]' as the size of a force along −z of R0" in str(proposed)
    assert read_forces(proposed) == pytest.approx(forces, abs=1e-3)


def write_log_of_load_cell(direction, header):
    """Return a log with two rows for each posture, whose load cell has its noise in rows without load."""
    size, forces = sizes(direction)
    joints, positions = measure(forces)
    rows = [
        [*digits(angles), *digits(1e3 * each), f"{number:.1f}"]
        for angles, pair, of_load in zip(joints, positions, size, strict=True)
        for each, number in zip(pair, (-0.3, of_load), strict=True)
    ]
    return table([*JOINTS, *"XYZ", header], rows), size


DEVICES = [
    "LoadCell_N",
    "load cell [N]",
    "Load_Cell_1_N",
    "Kraftmessdose (N)",
    "celda de carga, N",
    "appliedForce_N",
]


@pytest.mark.parametrize("header", DEVICES)
def test_a_load_cell_in_a_unit_of_force_has_the_sizes_of_weights_and_shows_the_states(header, tmp_path):
    text, size = write_log_of_load_cell((0.0, 0.0, -1.0), header)
    proposed = propose(text, tmp_path)
    assert f"{header!r} as the size of a force along −z of R0, as the deflections show" in str(proposed)
    assert read_forces(proposed) == pytest.approx(np.outer(size, [0.0, 0.0, -1.0]), abs=0.06)


def test_a_load_cell_is_compared_with_a_stated_force(tmp_path):
    text, size = write_log_of_load_cell((1.0, 0.0, 0.0), "LoadCell_N")
    stated = {"force": [np.median(size), 0, 0], "units": {"force": "N"}}
    assert read_forces(propose(text, tmp_path, **stated)) == pytest.approx(
        np.outer(size, [1.0, 0.0, 0.0]), abs=0.06
    )
    with pytest.raises(js.CampaignError, match="`force` is 400 N, but 'LoadCell_N' has"):
        propose(text, tmp_path, **stated | {"force": [400, 0, 0]})


def test_a_load_cell_that_pulls_along_another_direction_is_asked(tmp_path):
    text, _ = write_log_of_load_cell((0.0, -0.8, -0.6), "LoadCell_N")
    assert propose(text, tmp_path).accept().missing_fields == ["force"]


@pytest.mark.parametrize("header", ["LoadCell_V", "LoadCell_temp", "LoadCell", "load cell [mV]", "Cell_N"])
def test_a_load_cell_without_a_unit_of_force_is_no_force(header):
    assert not looks_like_a_force(header)


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, -0.8, -0.6)])
def test_sizes_of_a_force_along_another_direction_are_asked(direction, tmp_path):
    size, forces = sizes(direction)
    joints, positions = measure(forces)
    proposed = propose(table([*HEADERS, "Kraft [N]"], write_rows(joints, positions, size)), tmp_path)
    assert proposed.accept().missing_fields == ["force"]


VECTOR = ["force_mag [N]", "cable_dir x", "cable_dir y", "cable_dir z"]


def test_a_size_along_unit_vectors_is_the_force_that_the_deflections_show(tmp_path):
    forces = pull()
    sizes = np.linalg.norm(forces, axis=1, keepdims=True)
    joints, positions = measure(forces)
    vectors = TURN.inv().apply(forces / sizes)
    rows = write_rows(joints, in_tracker(positions), sizes, vectors)
    proposed = propose(table([*HEADERS, *VECTOR], rows), tmp_path)
    assert "'force_mag [N]' along the unit vectors of columns 14–16, as the deflections show" in str(proposed)
    assert read_forces(proposed) == pytest.approx(forces, abs=5.0)


def test_a_size_along_unit_vectors_that_the_deflections_contradict_is_no_force(tmp_path):
    forces = pull()
    sizes = np.linalg.norm(forces, axis=1, keepdims=True)
    joints, positions = measure(forces)
    rows = write_rows(joints, positions, sizes, np.roll(forces / sizes, 3, axis=0))
    assert "along the unit vectors" not in str(propose(table([*HEADERS, *VECTOR], rows), tmp_path))


def write_along(sense=1.0, digits_of_vector=2, contradicted=False):
    """Return a table of sizes along rounded unit vectors in the tracker's axes, with a remark, and forces."""
    forces = pull()
    sizes = np.linalg.norm(forces, axis=1, keepdims=True)
    joints, positions = measure(forces)
    vectors = np.round(sense * TURN.inv().apply(forces / sizes), digits_of_vector)
    vectors = np.roll(vectors, 3, axis=0) if contradicted else vectors
    rows = write_rows(joints, in_tracker(positions), sizes, vectors)
    headers = [*HEADERS, "Усилие, N", "nx", "ny", "nz", "Комментарий"]
    return table(headers, [[*row, f"трос {n}"] for n, row in enumerate(rows)]), forces


@pytest.mark.parametrize(("sense", "word"), [(1.0, "along"), (-1.0, "against")])
def test_sizes_are_the_force_along_rounded_unit_vectors_whatever_else_is_in_the_table(sense, word, tmp_path):
    text, forces = write_along(sense)
    proposed = propose(text, tmp_path)
    assert f"'Усилие, N' {word} the unit vectors of columns 14–16, as the deflections show" in str(proposed)
    assert read_forces(proposed) == pytest.approx(forces, abs=12.0)


def test_one_force_together_with_unit_vectors_that_differ_is_refused(tmp_path):
    text, forces = write_along()
    stated = {"force": forces[0].tolist(), "units": {"force": "N"}}
    with pytest.raises(js.CampaignError, match="one direction, but the unit vectors nx, ny, nz differ by"):
        propose(text, tmp_path, **stated)


def test_sizes_along_vectors_that_the_deflections_contradict_are_asked_and_not_offered_as_one_force(tmp_path):
    text, _ = write_along(contradicted=True)
    (question,) = propose(text, tmp_path).accept().missing
    assert "'Усилие, N' along nx, ny, nz does not explain the deflections: write the force of" in question
    assert "`force` is" not in question


def test_sizes_that_differ_by_posture_are_not_offered_as_one_force(tmp_path):
    size, forces = sizes((0.0, -0.8, -0.6))
    joints, positions = measure(forces)
    proposed = propose(table([*HEADERS, "Kraft [N]"], write_rows(joints, positions, size)), tmp_path)
    (question,) = proposed.accept().missing
    said = (
        f"'Kraft [N]' has {size.min():.4g} to {size.max():.4g} N under load, which differ by posture: write"
    )
    assert said in question
    assert "`force` is" not in question


def write_pulled(turned):
    joints, positions = measure(np.tile(turned, (14, 1)))
    return table(HEADERS, write_rows(joints, in_tracker(positions), np.zeros((14, 0))))


def carry_out(remedy, text, turned, folder):
    """Assert that the force in a remedy is the turned one, and that nothing is wrong with this force."""
    start = "if `force` is in axes of the positions of the files, `force` in axes of R0 is "
    assert remedy.startswith(start)
    stated = [float(each) for each in remedy.removeprefix(start).partition("N")[0].split(",")]
    assert stated == pytest.approx(turned, abs=5.0)
    answer = propose(text, folder, force=stated, units={"force": "N"}).accept()
    assert "frame_mistaken" not in [each.code for each in answer.findings]


def test_one_force_in_axes_of_the_tracker_is_found_with_the_force_to_state_in_axes_of_r0(tmp_path):
    force = np.array([300.0, 0.0, -900.0])  # in axes of the tracker
    turned = TURN.apply(force)
    text = write_pulled(turned)
    answer = propose(text, tmp_path, force=force.tolist(), units={"force": "N"}).accept()
    (remedy,) = [each.remedy for each in answer.findings if each.code == "frame_mistaken"]
    carry_out(remedy, text, turned, tmp_path)


def test_targets_that_move_against_a_force_in_axes_of_the_tracker_are_refused_with_that_of_r0(tmp_path):
    force = np.array([0.0, 900.0, 0.0])
    turned = TURN.apply(force)
    text = write_pulled(turned)
    with pytest.raises(js.CampaignError, match="the targets then move against `force`") as refused:
        propose(text, tmp_path, force=force.tolist(), units={"force": "N"})
    carry_out(refused.value.problem.remedy, text, turned, tmp_path)


CONTROLLER = [f"actual_TCP_force_{number}" for number in range(3)]


def write_log_of_controller(size, noise=2.0, headers=CONTROLLER):
    """Return a log of a weight of 900 N, with a row for each state and the estimate of a controller."""
    joints, positions = measure(np.tile([0.0, 0.0, -900.0], (14, 1)))
    generator = np.random.default_rng(6)
    rows = []
    for angles, pair in zip(joints, positions, strict=True):
        for word, each, force in zip(("no", "yes"), pair, (0.0, -size), strict=True):
            estimate = [0.0, 0.0, force] + noise * generator.uniform(-1.0, 1.0, 3)
            rows.append([*digits(angles), *digits(1e3 * each), word, *digits(estimate)])
    return table([*JOINTS, *"XYZ", "Load", *headers], rows)


WEIGHT = {"force": [0, 0, -900], "units": {"force": "N"}}


def test_a_vector_that_changes_by_a_stated_force_under_load_confirms_this_force(tmp_path):
    proposed = propose(write_log_of_controller(930.0), tmp_path, **WEIGHT)
    assert "'actual_TCP_force_*' changes by 93" in str(proposed)
    assert "N under load, if it is in N: `force` of 900 N was taken" in str(proposed)
    assert read_forces(proposed) == pytest.approx(np.tile([0.0, 0.0, -900.0], (14, 1)))


@pytest.mark.parametrize(("size", "noise"), [(700.0, 2.0), (-0.0, 300.0)])
def test_all_parts_of_a_vector_of_another_size_are_left_out_by_one_pattern(size, noise, tmp_path):
    text = write_log_of_controller(size, noise)
    if size == 700.0:
        listed = ", ".join(CONTROLLER)
        with pytest.raises(js.CampaignError, match=rf"{listed}; remedy: .*`ignore`: 'actual_TCP_force_\*'"):
            propose(text, tmp_path, **WEIGHT)
    proposed = propose(text, tmp_path, ignore=["actual_TCP_force_*"], **WEIGHT)
    assert read_forces(proposed) == pytest.approx(np.tile([0.0, 0.0, -900.0], (14, 1)))
