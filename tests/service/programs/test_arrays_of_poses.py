"""Paths as arrays: the numbers of a table of the same poses, without a text in between."""

import io
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.programs import FORCE, KUKA_TOOL, START, exact_run, path, tool_poses

import jointstiff as js
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.program import ProgramRequest
from jointstiff.service.kinds.program.files import compress_file, decompress_file
from jointstiff.service.kinds.program.rows import PathRows
from jointstiff.service.kinds.program.work import ProgramWork
from jointstiff.service.tables.packed import pack_sheet, unpack_sheet
from jointstiff.service.tables.table import Sheet
from jointstiff.solver.errors import RequestError
from robotprograms import read_program

HEADERS = ("x [mm]", "y [mm]", "z [mm]", "rx [deg]", "ry [deg]", "rz [deg]")
STATED = {
    "tools": [{"values": KUKA_TOOL}],
    "start": np.degrees(START).tolist(),
    "mark": False,
    "turn": "keep",
}


@lru_cache
def matrices():
    """Poses (12, 4, 4) of the tool in R0 [mm]."""
    poses = tool_poses(path(12))
    poses[:, :3, 3] *= 1e3
    return poses


@lru_cache
def numbers():
    """The same poses (12, 6): X, Y, Z [mm] and rotation vector [deg]."""
    vectors = Rotation.from_matrix(matrices()[:, :3, :3]).as_rotvec(degrees=True)
    return np.column_stack([matrices()[:, :3, 3], vectors])


@lru_cache
def table(folder):
    """File with the poses, with all digits."""
    file = folder / "path.csv"
    rows = [",".join(map(repr, row)) for row in numbers().tolist()]
    file.write_text("\n".join([",".join(HEADERS), *rows, ""]))
    return file


def processed(source, **changes):
    _, run = exact_run()
    done = js.process(run, source, **(STATED | {"forces": FORCE} | changes))
    assert done.error is None, done.error
    return done


def written_numbers(done):
    return read_program([("path.csv", decompress_file(done.result.files[0]))]).targets.values[:, :6]


@pytest.mark.parametrize("turn", ["keep", "free"])
def test_an_array_has_the_numbers_of_a_table_of_the_same_poses(turn, tmp_path):
    in_file = {"bases": [{"values": [0.0] * 6}], "branches": "free"}
    by_file = processed(table(tmp_path), turn=turn, **in_file)
    for poses in (matrices(), numbers()):
        by_array = processed(poses, turn=turn)
        for name in ("before", "turned", "difference"):
            one, other = getattr(by_array.result, name), getattr(by_file.result, name)
            assert one.value == pytest.approx(other.value, rel=1e-9, abs=1e-12), name
        assert by_array.result.corrected == by_file.result.corrected == 12
        np.testing.assert_allclose(written_numbers(by_array), written_numbers(by_file), atol=2e-6)


def test_an_array_is_corrected_as_correct_corrects_it():
    _, run = exact_run()
    of_process = written_numbers(processed(matrices()))
    frame = [*KUKA_TOOL[:3], 0.0, 0.0, 0.0]
    corrected = run.correct(matrices(), tool=frame, force=FORCE, start=STATED["start"])
    np.testing.assert_allclose(of_process[:, :3], 1e3 * corrected.poses[:, :3, 3], atol=1e-6)


def test_an_array_is_written_without_rounding_in_any_unit():
    poses = matrices().copy()
    poses[:, :3, 3] *= 1e-3  # a table of metres has nine decimals
    meters = STATED | {"tools": [{"values": [1e-3 * each for each in KUKA_TOOL]}]}
    start = {"start": START.tolist()}
    done = processed(poses, units="m, rad, N", **(meters | start))
    assert done.result.rounding.greatest < 1e-12
    assert written_numbers(done)[0, 0] != round(written_numbers(done)[0, 0], 9)


def test_an_array_of_forces_fits_a_file_too(tmp_path):
    in_file = {"bases": [{"values": [0.0] * 6}], "branches": "free"}
    forces = np.outer(np.linspace(0.2, 1.0, 12), FORCE)
    lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(numbers()[:, :3], axis=0), axis=1)))
    by_point = processed(table(tmp_path), forces=forces, **in_file)
    by_length = processed(table(tmp_path), forces=np.column_stack([lengths, forces]), **in_file)
    for done in (by_point, by_length, processed(matrices(), forces=forces)):
        assert done.result.before.value == pytest.approx(by_point.result.before.value, rel=1e-9)
    (tmp_path / "loads.csv").write_text(
        "\n".join(
            ["point,Fx [N],Fy [N],Fz [N]"]
            + [",".join(map(repr, [k, *row])) for k, row in enumerate(forces.tolist(), 1)]
        )
    )
    by_table = processed(matrices(), forces=str(tmp_path / "loads.csv"))
    assert by_table.result.before.value == pytest.approx(by_point.result.before.value, rel=1e-9)


REFUSED = {
    "a force for too many points": (np.tile(FORCE, (13, 1)), "the table has 13 points, and the path 12"),
    "lengths that leave the path out": ([[0.0, *FORCE], [5.0, *FORCE]], "the table covers 0 to 5 mm, but"),
    "lengths that decrease": (
        [[0.0, *FORCE], [50.0, *FORCE], [40.0, *FORCE]],
        "the length 40 mm is less than that of the row before",
    ),
    "a number that is not finite": ([[0.0, *FORCE], [np.nan, *FORCE]], "a number is out of range"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_forces_that_do_not_fit_the_path_are_refused(case):
    forces, words = REFUSED[case]
    with pytest.raises(js.CampaignError, match=words):
        processed(matrices(), forces=forces)


def packed(**changes):
    columns = dict(zip(HEADERS, numbers().T, strict=True)) | changes
    return pack_sheet(Sheet({name: column for name, column in columns.items() if column is not None}))


def test_rows_with_other_columns_are_refused_by_their_names():
    robot, _ = exact_run()
    units = Units(length="mm", angle="deg", force="N")
    for changes, word in (({"rx [deg]": None}, "rx"), ({"J1 [deg]": np.zeros(12)}, "j1")):
        with pytest.raises(RequestError, match=f"the column {word} of the packed path"):
            PathRows.unpack(packed(**changes), units, robot)
    with pytest.raises(RequestError, match="row 2 of column y contains a missing or infinite number"):
        PathRows.unpack(packed(**{"y [mm]": np.array([0.0, np.inf] + [0.0] * 10)}), units, robot)


def test_two_paths_are_refused():
    robot, run = exact_run()
    request = {
        "run_id": "r",
        "units": {"length": "mm", "angle": "deg", "force": "N"},
        "accuracy_option": "off",
        "load": {"force": FORCE},
        "files": [compress_file(name, packed()) for name in ("one.npz", "two.npz")],
    }
    with pytest.raises(RequestError, match="a packed path was sent with further files"):
        ProgramWork(robot, "robot", run, ProgramRequest.model_validate(request))


def archive(**arrays):
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    return content.getvalue()


def spoiled():
    """Bytes that are damaged, or that something else wrote."""
    whole = packed()
    head = np.array('{"headers": ["x [mm]"], "texts": {}, "digits": ""}')
    yield whole[: len(whole) // 2]
    yield whole.replace(b"\x00" * 8, b"\xff" * 8)
    yield archive(head=head)
    yield archive(head=np.array("{"), numbers=np.zeros((1, 2)))
    yield archive(head=np.array("[" * 100_000), numbers=np.zeros((1, 2)))
    yield archive(head=head, numbers=np.zeros((0, 2)))
    yield archive(head=head, numbers=np.array([["text"]]))
    yield archive(head=head, numbers=np.zeros((40_000_000, 1), dtype=np.float64))  # 320 MB in 0.3 MB


def test_damaged_archives_are_refused_before_they_take_memory():
    for content in spoiled():
        with pytest.raises(RequestError, match="the stored table is damaged"):
            unpack_sheet(content)
