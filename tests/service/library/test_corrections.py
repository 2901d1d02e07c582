"""Correction in Python, at the terminal and over HTTP: the same numbers, and refusals with their remedies."""

import json
import re

import httpx2
import numpy as np
import pandas
import pytest
from scipy.spatial.transform import Rotation
from support.api import post, posted
from support.programs import FORCE, TOOL, exact_run, loaded_poses, path, tool_poses
from support.terminal import terminal

import jointstiff as js
from jointstiff.service.library.robots import prepare_once
from jointstiff.simulator import default_arm, robot_document, simulate_campaign
from jointstiff.solver.mechanics.postures import flange_poses

ARM = default_arm()
CAMPAIGN = simulate_campaign(ARM, load="pull", configurations=12, seed=1)
JOINTS = path(20)
POSES = tool_poses(JOINTS)
IN_MM = POSES.copy()
IN_MM[:, :3, 3] *= 1e3
TOOL_IN_MM = [*(1e3 * TOOL), 0.0, 0.0, 0.0]
DEGREES = np.degrees(JOINTS)


def test_the_arrays_of_a_run_bring_the_loaded_tool_to_its_poses():
    _, run = exact_run()
    done = run.correct(IN_MM, DEGREES, tool=TOOL_IN_MM, forces=FORCE, feed=50)
    assert done.status == ["corrected"] * 20
    np.testing.assert_allclose(loaded_poses(done.joints), POSES, atol=1e-9)
    np.testing.assert_allclose(done.poses, tool_poses(done.joints), atol=1e-9)
    assert np.isfinite(done.joint_speed[1:]).all()
    in_metres = run.correct(POSES, JOINTS, tool=[*TOOL, 0, 0, 0], forces=FORCE, units="m, rad, N")
    np.testing.assert_allclose(in_metres.joints, done.joints, atol=1e-12)


def test_results_in_m_and_rad_given_back_name_both_units():
    _, run = exact_run()
    done = run.correct(IN_MM, DEGREES, tool=TOOL_IN_MM, forces=FORCE)
    with pytest.raises(js.CampaignError) as answer:
        run.correct(done.poses, done.joints, tool=TOOL_IN_MM, forces=FORCE)
    assert str(answer.value).endswith(
        "remedy: correct the units of lengths and joints: the numbers are m where mm are stated, and radians "
        "where degrees are stated; state `tool` and `base` in m, too"
    )
    in_metres = run.correct(done.poses, done.joints, tool=[*TOOL, 0, 0, 0], forces=FORCE, units="m, rad, N")
    assert in_metres.status == ["corrected"] * 20


@pytest.mark.parametrize(
    ("order", "named"), [("ZYX", "KUKA"), ("xyz", "FANUC"), ("XYZ", "Stäubli"), ("ZYZ", "Kawasaki")]
)
@pytest.mark.parametrize("turned", [0.0, 360.0])
def test_angles_of_a_controller_read_as_a_rotation_vector_are_named_by_their_order(order, named, turned):
    _, run = exact_run()
    angles = Rotation.from_matrix(POSES[:, :3, :3]).as_euler(order, degrees=True)
    six = np.concatenate(
        [IN_MM[:, :3, 3], np.round(np.where(angles < 0.0, angles + turned, angles), 4)], axis=1
    )
    with pytest.raises(js.CampaignError, match="20 of 20 rows") as caught:
        run.correct(six, DEGREES, tool=TOOL_IN_MM, forces=FORCE)
    remedy = caught.value.problem.remedy
    assert named in remedy
    assert f"Euler angles in the order {order};" in remedy
    others = {"KUKA", "FANUC", "Stäubli", "Kawasaki"} - {named}
    assert not [other for other in others if other in remedy]
    assert ("`a`, `b`, `c`" in remedy) == (order == "ZYX")
    as_matrices = IN_MM.copy()
    as_matrices[:, :3, :3] = Rotation.from_euler(order, six[:, 3:], degrees=True).as_matrix()
    assert run.correct(as_matrices, DEGREES, tool=TOOL_IN_MM, forces=FORCE).counts == {"corrected": 20}


@pytest.mark.parametrize("make", [dict, pandas.DataFrame])
@pytest.mark.parametrize(
    "headers", [list("xyzabc"), list("CBAXYZ"), [f"{name} [mm]" for name in "xyz"] + list("ABC")]
)
def test_named_columns_with_angles_of_kuka_are_read_by_their_names(make, headers):
    _, run = exact_run()
    angles = Rotation.from_matrix(POSES[:, :3, :3]).as_euler("ZYX", degrees=True)
    column_of = dict(zip("xyzabc", [*IN_MM[:, :3, 3].T, *angles.T], strict=True))
    poses = make({header: column_of[header[0].lower()] for header in headers})
    done = run.correct(poses, DEGREES, tool=TOOL_IN_MM, forces=FORCE)
    np.testing.assert_allclose(loaded_poses(done.joints), POSES, atol=1e-8)


def test_columns_whose_names_are_not_those_of_poses_are_refused_and_their_array_is_read():
    _, run = exact_run()
    vectors = Rotation.from_matrix(POSES[:, :3, :3]).as_rotvec(degrees=True)
    six = np.concatenate([IN_MM[:, :3, 3], vectors], axis=1)
    frame = pandas.DataFrame(six, columns=[*"XYZ", "roll", "pitch", "yaw"])
    with pytest.raises(js.CampaignError, match="roll, pitch, yaw, not those of poses"):
        run.correct(frame, DEGREES, tool=TOOL_IN_MM, forces=FORCE)
    for read in (frame.to_numpy(), pandas.DataFrame(six)):
        assert run.correct(read, DEGREES, tool=TOOL_IN_MM, forces=FORCE).counts == {"corrected": 20}


def test_forces_may_change_from_row_to_row_or_along_the_path():
    _, run = exact_run()
    rows = np.tile(FORCE, (20, 1))
    rows[:5] = 0.0
    done = run.correct(IN_MM, DEGREES, tool=TOOL_IN_MM, forces=rows)
    assert done.counts == {"corrected": 15, "no_load": 5}
    assert done.first == {"corrected": 6, "no_load": 1}
    length = np.linalg.norm(np.diff(IN_MM[:, :3, 3], axis=0), axis=1).sum()
    along = [[0.0, *FORCE], [length, *FORCE]]
    whole = run.correct(IN_MM, DEGREES, tool=TOOL_IN_MM, forces=along)
    same = run.correct(IN_MM, DEGREES, tool=TOOL_IN_MM, forces=FORCE)
    np.testing.assert_allclose(whole.joints, same.joints, atol=1e-12)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_file_that_was_written_is_read_again(tmp_path, ending):
    _, run = exact_run()
    done = run.correct(IN_MM, DEGREES, tool=TOOL_IN_MM, forces=FORCE)
    file = tmp_path / f"rows.{ending}"
    done.save(file)
    if ending == "parquet":
        frame = done.to_frame()[[f"{axis} [mm]" for axis in "xyz"] + [f"r{axis} [deg]" for axis in "xyz"]]
        frame.reset_index(drop=True).to_parquet(file)
    else:
        lines = file.read_text().splitlines()
        kept = [lines[0].split(",").index(name) for name in ("x [mm]", "y [mm]", "z [mm]")]
        kept += [lines[0].split(",").index(f"r{axis} [deg]") for axis in "xyz"]
        cells = [line.split(",") for line in lines]
        file.write_text("\n".join(",".join(row[i] for i in kept) for row in cells))
    start = np.degrees(done.joints[0])
    again = run.correct(file, tool=TOOL_IN_MM, forces=(0, 0, 0), start=start)
    np.testing.assert_allclose(again.poses, done.poses, atol=1e-9)
    assert again.counts == {"no_load": 20}


def test_a_moment_has_the_unit_of_its_header(tmp_path):
    _, run = exact_run()
    frame = run.correct(IN_MM, DEGREES, tool=TOOL_IN_MM, forces=FORCE).to_frame()
    poses = [f"{axis} [mm]" for axis in "xyz"] + [f"r{axis} [deg]" for axis in "xyz"]
    joints = [f"J{number} [deg]" for number in range(1, 7)]
    done = {}
    for unit, moment in {"N.m": 40.0, "N.mm": 40_000.0}.items():
        loaded = frame[poses + joints].copy()
        for axis, force in zip("xyz", FORCE, strict=True):
            loaded[f"F{axis} [N]"] = force
            loaded[f"M{axis} [{unit}]"] = moment
        file = tmp_path / f"{unit}.csv"
        loaded.to_csv(file, index=False)
        done[unit] = run.correct(file, tool=TOOL_IN_MM)
    np.testing.assert_allclose(done["N.mm"].joints, done["N.m"].joints, atol=1e-12)
    file.write_text(file.read_text().replace("Mx [N.mm]", "Mx"))
    with pytest.raises(js.CampaignError, match="has no unit"):
        run.correct(file, tool=TOOL_IN_MM)


@pytest.mark.parametrize("shown", [str, str.upper])
def test_joints_have_the_robots_own_names_in_any_order(tmp_path, shown):
    _, run = exact_run()
    frame = run.correct(IN_MM, DEGREES, tool=TOOL_IN_MM, forces=FORCE).to_frame().iloc[:, 1:13]
    named = frame.rename(columns=lambda name: name.replace("J", shown("joint_")))
    numbered, own = tmp_path / "numbered.csv", tmp_path / "own.csv"
    frame.to_csv(numbered, index=False)
    named.iloc[:, ::-1].to_csv(own, index=False)
    expected, done = (run.correct(file, tool=TOOL_IN_MM, forces=FORCE) for file in (numbered, own))
    np.testing.assert_array_equal(done.joints, expected.joints)
    named["J2 [deg]"] = frame["J2 [deg]"]
    named.to_csv(own, index=False)
    with pytest.raises(
        js.CampaignError, match="'joint_2' and 'j2' state the same joint; remedy: give each joint once"
    ):
        run.correct(own, tool=TOOL_IN_MM, forces=FORCE)


class TestFiles:
    """Files with headers that are wrong are refused by name; labels are repeated."""

    HEADER = "label,x [mm],y [mm],z [mm],rx [deg],ry [deg],rz [deg]"

    def rows(self, count=20):
        rows = np.column_stack([IN_MM[:, :3, 3], _rotation_vectors()])[:count]
        return [f"P{i}," + ",".join(map(repr, row)) for i, row in enumerate(rows.tolist(), 1)]

    def corrected(self, tmp_path, header, rows):
        file = tmp_path / "poses.csv"
        file.write_text("\n".join([header, *rows]))
        return exact_run()[1].correct(file, DEGREES, tool=TOOL_IN_MM, forces=FORCE)

    def test_labels_are_repeated(self, tmp_path):
        done = self.corrected(tmp_path, self.HEADER, self.rows())
        done.save(tmp_path / "out.csv")
        lines = (tmp_path / "out.csv").read_text().splitlines()
        assert lines[0].startswith("label,status,x [mm]")
        assert [line.split(",")[0] for line in lines[1:]] == [f"P{i}" for i in range(1, 21)]
        done.save(tmp_path / "out.parquet")
        assert list(pandas.read_parquet(tmp_path / "out.parquet")["label"])[:2] == ["P1", "P2"]

    def test_a_label_that_is_a_formula_has_an_apostrophe_in_csv(self, tmp_path):
        rows = [
            label + row[row.index(",") :]
            for label, row in zip(["-1", "+2", "@x"] * 7, self.rows(), strict=False)
        ]
        done = self.corrected(tmp_path, self.HEADER, rows)
        done.save(tmp_path / "out.csv")
        done.save(tmp_path / "out.parquet")
        lines = (tmp_path / "out.csv").read_text().splitlines()
        assert [line.split(",")[0] for line in lines[1:4]] == ["'-1", "'+2", "'@x"]
        assert list(pandas.read_parquet(tmp_path / "out.parquet")["label"])[:3] == ["-1", "+2", "@x"]

    def test_semicolons_come_with_decimal_commas(self, tmp_path):
        rows = [row.replace(",", ";").replace(".", ",") for row in self.rows()]
        done = self.corrected(tmp_path, self.HEADER.replace(",", ";"), rows)
        assert done.counts == {"corrected": 20}

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (("rz [deg]", "rx [rad]"), "line 1.*'rx \\[rad\\]' occurs twice"),
            (("rz [deg]", "RX [deg]"), "line 1.*'RX \\[deg\\]' occurs twice"),
            (("rz [deg]", ""), "line 1.*column 7 has no header"),
            (("rz [deg]", "colour"), "columns.*'colour' is not known"),
            (("rz [deg]", "rz"), "line 1.*'rz' has no unit"),
            ((",rz [deg]", ""), "line 2.*the row has 7 cells, but the header has 6"),
        ],
    )
    def test_a_wrong_header_is_refused_by_name(self, tmp_path, change, words):
        with pytest.raises(js.CampaignError) as caught:
            self.corrected(tmp_path, self.HEADER.replace(*change), self.rows())
        assert re.search(words, f"{caught.value.problem.where}: {caught.value}")

    def test_a_cell_that_is_no_number_is_named(self, tmp_path):
        rows = self.rows()
        rows[3] = rows[3].replace(",", ",much ", 1)
        with pytest.raises(js.CampaignError, match=r"the cell 'much .*' of the column 'x \[mm\]'"):
            self.corrected(tmp_path, self.HEADER, rows)

    def test_a_text_in_parquet_is_named(self, tmp_path):
        file = tmp_path / "poses.parquet"
        pandas.DataFrame({"x [mm]": [1.0], "y [mm]": ["far"]}).to_parquet(file)
        with pytest.raises(js.CampaignError, match=r"the column 'y \[mm\]' has cells that are not numbers"):
            exact_run()[1].correct(file, forces=FORCE)

    def test_names_that_differ_in_capitals_are_refused(self, client, run):
        body = TestService().body(run)
        body["columns"]["X"] = body["columns"]["x"]
        answer = client.request("POST", "/v1/corrections", json=body)
        assert answer.status_code == 422
        assert "'X' occurs twice" in answer.text


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_a_number_that_is_not_finite_names_its_row(number):
    _, run = exact_run()
    poses, joints = IN_MM.copy(), DEGREES.copy()
    poses[2, 0, 3] = number
    with pytest.raises(js.CampaignError, match="row 3 of column x contains a missing or infinite number"):
        run.correct(poses, DEGREES, tool=TOOL_IN_MM, forces=FORCE)
    poses = IN_MM.copy()
    poses[3, 0, 0] = number
    with pytest.raises(js.CampaignError, match="the matrix of row 4 has a missing or infinite number"):
        run.correct(poses, DEGREES, tool=TOOL_IN_MM, forces=FORCE)
    joints[4, 1] = number
    with pytest.raises(js.CampaignError, match="row 5 of column j2 contains a missing or infinite number"):
        run.correct(IN_MM, joints, tool=TOOL_IN_MM, forces=FORCE)


def test_an_arm_without_a_campaign_is_corrected_by_its_prior():
    robot = js.robot(robot_document(ARM), payload=210)
    done = robot.correct(IN_MM, DEGREES, tool=TOOL_IN_MM, forces=FORCE)
    assert done.counts == {"corrected": 20}
    assert (done.joints == js.correct(robot, IN_MM, DEGREES, tool=TOOL_IN_MM, forces=FORCE).joints).all()
    assert done.assessment.verdict == "use_with_care"
    assert "not measured, but guessed" in done.summary()


def with_rotation(rotation, row=2):
    """The poses, with another rotation in a row (from 0)."""
    poses = IN_MM.copy()
    poses[row, :3, :3] = rotation
    return poses


ROTATION = POSES[2, :3, :3]
TOOL_MATRIX = np.eye(4)
TOOL_MATRIX[:3, 3] = 1e3 * TOOL
NO_POSES = {
    "each element too large": (
        IN_MM + 0.05,
        "the matrix of row 1 has another last row than 0, 0, 0, 1",
    ),
    "rotations too large": (with_rotation(ROTATION + 0.05), "the matrix of row 3 is not a rotation"),
    "a scale": (with_rotation(1.01 * ROTATION), "differs from the identity by 0.02"),
    "mirrored": (with_rotation(-ROTATION), "its determinant is -1"),
    "zero": (with_rotation(0.0 * ROTATION), "the matrix of row 3 is not a rotation"),
    "transposed": (IN_MM.transpose(0, 2, 1), "others may be transposed"),
    "another last row": (
        np.where(np.arange(16).reshape(4, 4) == 15, 2.0, IN_MM),
        "has another last row than 0, 0, 0, 1",
    ),
    "ragged": ([[1, 2], [3]], "`poses` is not an array of numbers: .* inhomogeneous shape"),
    "words": ([["x"] * 6], "`poses` is not an array of numbers"),
    "of another shape": (IN_MM[0], r"`poses` has shape \(4, 4\)"),
}


@pytest.mark.parametrize("case", NO_POSES)
def test_matrices_that_are_no_poses_are_refused_by_their_row(case):
    poses, words = NO_POSES[case]
    with pytest.raises(js.CampaignError, match=words) as caught:
        exact_run()[1].correct(poses, DEGREES, tool=TOOL_IN_MM, forces=FORCE)
    assert caught.value.problem.where == "correction.poses"


def test_matrices_may_be_rounded_to_four_decimals():
    rounded = np.round(IN_MM, 4)
    done = exact_run()[1].correct(rounded, DEGREES, tool=np.round(TOOL_MATRIX, 4), forces=FORCE)
    assert done.counts == {"corrected": 20}


NO_NUMBERS = {
    "forces": ("x", [[1, 2, 3], [1]], [1j, 0, 0]),
    "joints": ("x", [[1, 2], [3]]),
    "tool": ("x", [[1, 0], [0, 1]], -np.eye(4)),
    "base": ("x", [1, 2, 3]),
    "start": ("x",),
    "load_point": ("x",),
    "force": ("x",),
}


@pytest.mark.parametrize("name", NO_NUMBERS)
def test_arguments_that_are_no_numbers_are_refused_by_their_names(name):
    for value in NO_NUMBERS[name]:
        call = {"joints": DEGREES, "tool": TOOL_IN_MM, "forces": FORCE} | {name: value}
        with pytest.raises(js.CampaignError) as caught:
            exact_run()[1].correct(IN_MM, call.pop("joints"), **call)
        assert caught.value.problem.where == f"correction.{name}"


@pytest.mark.parametrize("forces", [FORCE, np.tile(FORCE, (20, 1)), [[0.0, *FORCE], [9e3, *FORCE]]])
def test_a_force_in_both_ways_is_refused(forces):
    with pytest.raises(js.CampaignError, match="the load is stated twice: by `forces` and by `force`"):
        exact_run()[1].correct(IN_MM, DEGREES, tool=TOOL_IN_MM, forces=forces, force=[0, 0, -1])


@pytest.mark.parametrize("column", ["Fx [N],Fy [N],Fz [N]", "J1 [deg],J2 [deg],J3 [deg]"])
def test_an_argument_does_not_replace_the_columns_of_a_file(tmp_path, column):
    rows = np.column_stack([IN_MM[:, :3, 3], _rotation_vectors(), np.ones((20, 3))])
    file = tmp_path / "poses.csv"
    header = f"x [mm],y [mm],z [mm],rx [deg],ry [deg],rz [deg],{column}"
    np.savetxt(file, rows, delimiter=",", header=header, comments="")
    with pytest.raises(js.CampaignError, match=r"stated twice: by `(forces|joints)` and by the column"):
        exact_run()[1].correct(file, DEGREES, tool=TOOL_IN_MM, forces=FORCE)


REFUSED = {
    "a wrong tool": ({}, "joints", "all rows agree with `tool` 10, -20, 215.5 mm"),
    "radians": ({"joints": JOINTS, "tool": TOOL_IN_MM}, "joints", "the numbers are radians where degrees"),
    "no load": ({"tool": TOOL_IN_MM, "forces": None}, "force", "give `force`"),
    "forces of another shape": ({"forces": [[1, 2], [3, 4]]}, "forces", "give one force"),
    "joints of another shape": ({"joints": DEGREES[:3]}, "joints", "(20, 6)"),
    "twice": ({"accuracy_option": "compensates_load"}, "accuracy_option", "switch"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_refusal_names_place_and_remedy(case):
    changes, where, remedy = REFUSED[case]
    _, run = exact_run()
    call = {"joints": DEGREES, "forces": FORCE} | changes
    with pytest.raises(js.CampaignError) as caught:
        run.correct(IN_MM, call.pop("joints"), **call)
    assert caught.value.problem.where == f"correction.{where}"
    assert remedy in caught.value.problem.remedy


def test_the_terminal_writes_the_rows_of_python(tmp_path):
    _, run = exact_run()
    run.save(tmp_path / "run.json")
    sent = run.correct(IN_MM, DEGREES, tool=TOOL_IN_MM, forces=(0, 0, 0))
    frame = sent.to_frame().reset_index(drop=True)
    names = [
        name for name in frame.columns if name[0] == "J" or name[:2] in {"x ", "y ", "z ", "rx", "ry", "rz"}
    ]
    frame[names].to_csv(tmp_path / "poses.csv", index=False)
    tool = ",".join(f"{each:.6f}" for each in TOOL_IN_MM)
    options = ["--tool", tool, "--force", "300,400,-1400", "-o", tmp_path / "out.csv"]
    answer = terminal("correct", tmp_path / "run.json", tmp_path / "poses.csv", *options)
    assert answer.exit_code == 0, answer.output
    assert "rows: 20 corrected" in answer.stdout
    done = run.correct(IN_MM, DEGREES, tool=TOOL_IN_MM, forces=FORCE)
    rows = [line.split(",") for line in (tmp_path / "out.csv").read_text().splitlines()]
    joints = np.array([[float(each) for each in row[7:13]] for row in rows[1:]])
    np.testing.assert_allclose(np.radians(joints), done.joints, atol=1e-9)
    wrong = terminal("correct", tmp_path / "run.json", tmp_path / "poses.csv", "--force", "0,0,-500")
    assert wrong.exit_code == 2
    assert "poses and joints differ" in wrong.output


@pytest.fixture(scope="module")
def run(service):
    with httpx2.Client(base_url=service.url, timeout=60.0) as client:
        return posted(client, CAMPAIGN)


class TestService:
    """Correction by a service."""

    def body(self, run, **changes):
        columns = dict(zip(("x", "y", "z"), IN_MM[:, :3, 3].T.tolist(), strict=True))
        columns |= dict(zip(("rx", "ry", "rz"), _rotation_vectors().T.tolist(), strict=True))
        columns |= {f"j{number}": column.tolist() for number, column in enumerate(DEGREES.T, 1)}
        return {
            "run_id": run["id"],
            "units": {"length": "mm", "angle": "deg", "force": "N"},
            "tool": TOOL_IN_MM,
            "force": list(FORCE),
            "columns": columns,
        } | changes

    def test_the_columns_come_back_corrected(self, client, run):
        answer = post(client, "/v1/corrections", self.body(run), status=200)
        here = js.correct(CAMPAIGN, IN_MM, DEGREES, tool=TOOL_IN_MM, forces=FORCE)
        joints = np.stack([answer["columns"][f"j{number}"] for number in range(1, 7)], axis=1)
        np.testing.assert_allclose(np.radians(joints), here.joints, atol=1e-9)
        assert answer["counts"] == {"corrected": 20}
        assert answer["columns"]["status"] == ["corrected"] * 20

    def test_a_raw_table_is_sent_in_a_form(self, client, run):
        body = self.body(run)
        columns = body.pop("columns")
        units = dict.fromkeys(("x", "y", "z"), "mm")
        header = ",".join(f"{name} [{units.get(name, 'deg')}]" for name in columns)
        rows = [",".join(map(repr, row)) for row in zip(*columns.values(), strict=True)]
        table = "\n".join([header, *rows, ""]).encode()
        raw = client.request("POST", "/v1/corrections", content=table, headers={"Content-Type": "text/csv"})
        words = "send a file in a form of the fields `files` and `options`, as curl -F does"
        assert raw.status_code == 415
        assert words in raw.text
        assert "or send columns as JSON" in raw.text
        files = {"files": ("poses.csv", table)}
        sent = client.request("POST", "/v1/corrections", files=files, data={"options": json.dumps(body)})
        assert sent.status_code in {201, 202}, sent.text

    def test_columns_of_joints_may_have_their_own_names(self, client, run):
        body = self.body(run)
        expected = post(client, "/v1/corrections", body, status=200)
        body["columns"] = {name.replace("j", "joint_"): column for name, column in body["columns"].items()}
        assert post(client, "/v1/corrections", body, status=200) == expected

    def test_a_row_without_numbers_is_null_and_says_why(self, client, run):
        body = self.body(run)
        body["columns"]["j1"][4] += 5.0
        answer = post(client, "/v1/corrections", body, status=200)
        assert answer["columns"]["status"][4] == "contradictory"
        assert answer["columns"]["x"][4] is None
        assert answer["first"]["contradictory"] == 5
        assert any("row 5: pose and joints differ" in each for each in answer["remarks"])

    @pytest.mark.parametrize(
        ("changes", "where"),
        [
            ({"run_id": "nobody"}, "run_id"),
            ({"run_id": None}, ""),
            ({"run_id": None, "robot_id": "nobody"}, "robot_id"),
            ({"force": None}, "force"),
            ({"tool": [0.0] * 6}, "joints"),
            ({"start": [0.0]}, "start"),
        ],
    )
    def test_a_refusal_names_its_field(self, client, run, changes, where):
        answer = client.request("POST", "/v1/corrections", json=self.body(run, **changes))
        assert answer.status_code == 422, answer.text
        assert where in (answer.json()["where"] or "")

    def test_more_rows_than_a_job_may_have_are_refused(self, client, run):
        zeros = ",".join(["0"] * 160_000)
        columns = ",".join(f'"{name}":[{zeros}]' for name in ("x", "y", "z", "rx", "ry", "rz"))
        units = '{"length":"mm","angle":"deg","force":"N"}'
        content = f'{{"units":{units},"run_id":"{run["id"]}","columns":{{{columns}}}}}'
        answer = client.post("/v1/corrections", content=content, headers={"Content-Type": "application/json"})
        assert answer.status_code == 413
        assert answer.json()["detail"] == "the table has more than 100,000 rows"
        assert "send parts of the path" in answer.json()["remedy"]

    def test_columns_are_checked(self, client, run):
        for change in ({"x": [1.0]}, {"colour": [0.0] * 20}, {"q1": [1.0] * 20}):
            body = self.body(run)
            body["columns"] |= change
            answer = client.request("POST", "/v1/corrections", json=body)
            assert answer.status_code == 422, change
            assert answer.json()["where"].startswith("columns")


def _rotation_vectors():
    """Rotation vectors (20, 3) of the poses [deg]."""
    return Rotation.from_matrix(POSES[:, :3, :3]).as_rotvec(degrees=True)


def test_a_client_corrects_as_this_process_does(service):
    with js.Client(service.url) as client:
        run = client.identify(CAMPAIGN)
        there = run.correct(IN_MM, DEGREES, tool=TOOL_IN_MM, forces=FORCE)
        here = js.correct(CAMPAIGN, IN_MM, DEGREES, tool=TOOL_IN_MM, forces=FORCE)
        np.testing.assert_allclose(there.joints, here.joints, atol=1e-9)
        np.testing.assert_allclose(there.poses, here.poses, atol=1e-9)
        assert there.counts == here.counts
        assert json.dumps(there.first) == json.dumps(here.first)


def test_a_correction_at_a_corner_says_over_which_length_it_changes():
    """A pocket with points 1 mm apart, at a feed with which the joints cannot follow the force's turns."""
    arm = js.robot("ABB IRB 6640-185/2.8")
    prepared = prepare_once(arm).robot
    start = np.array([10.0, 35.0, 10.0, 20.0, 60.0, 30.0])
    angles = prepared.joint_map.model_angles(np.radians(start)[None])
    corners = np.array([(0, 0), (40, 0), (40, 12), (0, 12), (0, 24), (40, 24)], dtype=np.float64)
    lengths = np.append(0.0, np.cumsum(np.abs(np.diff(corners, axis=0)).sum(axis=1)))
    at = np.arange(lengths[-1] + 1.0)
    places = np.stack(
        [np.interp(at, lengths, corners[:, 0]), np.interp(at, lengths, corners[:, 1]), 0.0 * at], 1
    )
    poses = np.tile(flange_poses(prepared, angles)[0], (len(places), 1, 1))
    poses[:, :3, 3] = 1e3 * poses[:, :3, 3] + places @ poses[0, :3, :3].T
    stated = {"forces": (-300, 700, -240), "axes": "feed", "start": start}
    at_once, blended = arm.correct(poses, **stated), arm.correct(poses, feed=1000, **stated)
    assert not [each for each in at_once.remarks if "the correction changes over" in each]
    (remark,) = (each for each in blended.remarks if "the correction changes over" in each)
    assert "mm of the deflection remain there" in remark
    assert blended.residual.max() > 1e-6 > at_once.residual.max()
