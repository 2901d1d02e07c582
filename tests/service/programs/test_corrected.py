"""Corrected programs: their points, what is certain, patterns of moves, and other solvers' answers."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.examples import examples
from support.programs import (
    FORCE,
    corrected,
    corrected_with_table,
    exact_run,
    loaded_poses,
    path,
    request,
    tool_poses,
    work_of,
)

import robotprograms
from jointstiff import schemas, service, solver
from jointstiff.service.kinds.correction.files import compress_file, decompress_file
from jointstiff.service.kinds.correction.programs import ProgramWork
from jointstiff.service.kinds.correction.text import FaultsError
from jointstiff.service.kinds.correction.text import read_program as read_unmarked
from jointstiff.service.kinds.work import pack_arrays, unpack_arrays
from jointstiff.service.problems import FilesError
from jointstiff.service.security import admission
from jointstiff.simulator.programs import PROGRAM_FILES, program_text
from robotprograms import fanuc, krl, rapid, ur
from robotprograms.formats import FORMATS, read_program
from robotprograms.notation import Numerals

KINDS = list(PROGRAM_FILES)
FULL = 13
"""Digits behind a millimetre's point, with which rounding is no matter."""


def commanded_poses(kind, result):
    """Poses of the tool that the corrected file states, and the posture before rounding."""
    file = result.files[0]
    program = read_program([(file.name, decompress_file(file))])
    (notation,) = program.targets.notations
    return notation.to_poses(program.targets.values[:, : 3 + notation.count])


def inverse(poses, near):
    """Angles that bring the tool to poses, by Newton's method on the simulator's kinematics."""
    q = near.copy()
    for _ in range(6):
        here = tool_poses(q)
        step = twist(here, poses)
        columns = [twist(here, tool_poses(q + 1e-6 * unit)) / 1e-6 for unit in np.eye(6)]
        q = q + np.linalg.solve(np.stack(columns, axis=2), step[..., None])[..., 0]
    return q


def twist(from_, to):
    turn = to[:, :3, :3] @ from_[:, :3, :3].transpose(0, 2, 1)
    skew = 0.5 * np.stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], 1
    )
    return np.concatenate([to[:, :3, 3] - from_[:, :3, 3], skew], axis=1)


@pytest.mark.parametrize("kind", ["krl", "fanuc", "rapid", "ur", "csv"])
def test_the_loaded_tool_is_where_the_program_says(kind):
    joints = path(25)
    goal = tool_poses(joints)
    result = corrected(kind, program_text(kind, goal, FULL))
    reached = loaded_poses(inverse(commanded_poses(kind, result), joints))
    assert np.linalg.norm(reached[:, :3, 3] - goal[:, :3, 3], axis=1).max() < 1e-9
    np.testing.assert_allclose(reached, goal, atol=1e-9)
    assert result.residual.greatest < 1e-9
    assert result.corrected == 25
    mirror = 2.0 * goal[:, :3, 3] - loaded_poses(joints)[:, :3, 3]
    assert np.linalg.norm(mirror - commanded_poses(kind, result)[:, :3, 3], axis=1).max() > 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_the_certificate_knows_the_rounding(kind):
    joints = path(25)
    result = corrected(kind, program_text(kind, tool_poses(joints), 3))
    exact = np.linalg.norm(loaded_poses(joints)[:, :3, 3] - tool_poses(joints)[:, :3, 3], axis=1)
    assert result.deflection.greatest == pytest.approx(exact.max(), rel=1e-4)
    assert 0.0 < result.rounding.greatest <= result.residual.greatest < 3e-6


@pytest.mark.parametrize("kind", KINDS)
def test_no_force_gives_identical_bytes(kind):
    text = program_text(kind, tool_poses(path(20)), 4)
    result = corrected(kind, text, force=(0.0, 0.0, 0.0))
    assert decompress_file(result.files[0]) == text.encode()
    assert result.corrected == 0


def test_joint_targets_are_commanded_exactly():
    joints = path(10)
    rows = ["j1 [rad],j2 [rad],j3 [rad],j4 [rad],j5 [rad],j6 [rad]"]
    rows += [",".join(f"{v:.15f}" for v in row) for row in joints]
    result = corrected("csv", "\n".join(rows) + "\n", bases=[], start=None)
    program = read_program([("path.csv", decompress_file(result.files[0]))])
    commanded = program.targets.values[:, :6]
    np.testing.assert_allclose(loaded_poses(commanded), tool_poses(joints), atol=1e-9)


def test_loads_by_lines_and_by_points():
    text = program_text("krl", tool_poses(path(10)), 4)
    segments = [{"first_line": 9, "last_line": 12, "force": FORCE}]
    by_lines = corrected("krl", text, force=None, segments=segments)
    assert by_lines.left_alone == {"no_load": 6}
    assert by_lines.corrected == 4
    before, after = text.encode().split(b"\r\n"), decompress_file(by_lines.files[0]).split(b"\r\n")
    assert [i + 1 for i in range(len(before)) if before[i] != after[i]] == [9, 10, 11, 12]
    of_load = corrected("krl", text, force=None, segments=segments[:1])
    assert decompress_file(of_load.files[0]) == decompress_file(by_lines.files[0])
    to_the_end = corrected("krl", text, force=None, segments=[{"force": FORCE, "first_line": 9}])
    assert to_the_end.left_alone == {"no_load": 2}
    table = "point,Fx [N],Fy [N],Fz [kN]\n" + "".join(f"{i},300,400,-1.4\n" for i in range(3, 7))
    by_points = corrected_with_table(text, table)
    assert decompress_file(by_points.files[0]) == decompress_file(by_lines.files[0])


def test_the_frames_of_the_controller():
    """Base, world, tool and flange in other places give the same correction."""
    joints = path(5)
    goal = tool_poses(joints)
    turned = np.eye(4)
    turned[:3, :3], turned[:3, 3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.5, -0.2, 0.1]
    plain = corrected("krl", program_text("krl", goal, FULL))
    base = [500.0, -200.0, 100.0, 90.0, 0.0, 0.0]
    moved = program_text("krl", np.linalg.inv(turned) @ goal, FULL)
    for frames in ({"bases": [{"name": "base_data[1]", "values": base}]}, {"world": base}):
        result = corrected("krl", moved, **frames)
        np.testing.assert_allclose(
            turned @ commanded_poses("krl", result), commanded_poses("krl", plain), atol=1e-9
        )
    half = {"tools": [{"values": [0, 0, 115.5, 0, 0, 0]}], "flange": [10.0, -20.0, 100.0, 0, 0, 0]}
    other = corrected("krl", program_text("krl", goal, FULL), **half)
    np.testing.assert_allclose(commanded_poses("krl", other), commanded_poses("krl", plain), atol=1e-9)


def test_steps_give_the_same_program():
    text = program_text("krl", tool_poses(path(30)), 4)
    work = work_of("krl", text, ramp_length=20.0)
    whole = work.conclude(())
    parts = [unpack_arrays(pack_arrays(work.compute(span))) for span in ((0, 7), (7, 9), (9, 30))]
    assert work.conclude(parts) == whole


@pytest.mark.parametrize("rest", ["\n" * 2_000, "," * 20_000])
def test_a_table_of_loads_has_no_more_lines_and_cells_than_points_need(rest):
    table = compress_file("loads.csv", f"point,Fx [N],Fy [N],Fz [N]\n1,0,0,9\n{rest}".encode())
    asked = request("krl", program_text("krl", tool_poses(path(2)), 4), force=None, loads="loads.csv")
    robot, run = exact_run()
    request_with_table = asked.model_copy(update={"files": [*asked.files, table]})
    with pytest.raises(FilesError, match="too many lines or cells"):
        ProgramWork(robot, "robot", run, request_with_table)


@pytest.mark.parametrize("kind", KINDS)
def test_a_corrected_program_carries_its_mark_and_nothing_else_differs(kind):
    text = program_text(kind, tool_poses(path(5)), 4)
    plain = decompress_file(corrected(kind, text).files[0])
    marked = decompress_file(corrected(kind, text, mark=True).files[0])
    lines, more = plain.splitlines(keepends=True), marked.splitlines(keepends=True)
    added = [line for line in more if line not in lines]
    assert [line for line in more if line not in added] == lines
    assert b"Jointstiff run " in added[0]
    assert b"verdict: use" in b"".join(added)
    assert len(added) == (3 if kind == "fanuc" else 1)
    with pytest.raises(FaultsError, match="corrected already"):
        read_unmarked([(PROGRAM_FILES[kind], marked)])
    still = corrected(kind, text, mark=True, force=(0.0, 0.0, 0.0))
    assert decompress_file(still.files[0]) == text.encode()


def texts(*parts):
    return st.lists(st.sampled_from(parts), max_size=14).map("".join)


NUMBER = r"(?<!\w)[+-]?(?:[0-9]{1,15}(?:\.[0-9]{0,20})?|\.[0-9]{1,20})(?:[eE][+-]?[0-9]{1,3})?"
PATTERNS = {
    "krl": (krl.LANGUAGE.numbers, rf"'B ?[01]{{1,16}}'|{NUMBER}"),
    "rapid": (rapid.LANGUAGE.numbers, NUMBER),
    "fanuc": (fanuc.LANGUAGE.numbers, NUMBER),
    "ur": (ur.LANGUAGE.numbers, NUMBER),
    "rapid comments": (
        re.compile(rapid.LANGUAGE.comment),
        r"(?<![^\r\n])%%%\s*(?:(?:VERSION|LANGUAGE)\s*:\s*\w+\b\s*)*%%%|![^\r\n]*",
    ),
    "rapid statements": (rapid._ENDS, r'"[^"\r\n]*"|![^\r\n]*|;'),
    "fanuc positions": (fanuc._POSITION, r"P[\s\S]*?\};|\S[^P]*"),
    "json strings": (admission._STRING, r'"(?:\\[\s\S]|[^"\\])*(?:"\s*:?)?'),
}
TEXTS = {
    "rapid comments": (
        "%%%",
        "\n",
        "% ",
        "VERSION",
        "LANGUAGE",
        ":",
        "1",
        "E_1",
        "!",
        "\r\n",
        "\n%%%\nVERSION:1",
    ),
    "rapid statements": (*'";!\n\r a', '"a"', '";"', "!;", "x := 1;"),
    "fanuc positions": (*"P{}; \na", "};", "P[1]{", "GP1: }"),
    "json strings": (*'"\\: a\n', '\\"', "\\\\", '"a":', '""', '" :'),
}
DIGITS = (*"0179.+-eE' B_a\n", "7E", "1e5", "+E+", "'B01'", "1" * 14, "²", ".5", "e1234")


@pytest.mark.parametrize("name", PATTERNS)
def test_patterns_find_what_plain_ones_find(name):
    """Those of the service give nothing back, which takes no time; the plain ones here may."""
    pattern, plain = PATTERNS[name]

    @examples(1500)
    @given(texts(*TEXTS.get(name, DIGITS)))
    def alike(text):
        found = pattern.finditer(text.encode() if isinstance(pattern.pattern, bytes) else text)
        spans = [match.span() for match in found]
        assert spans == [match.span() for match in re.finditer(plain, text)]
        if name in FORMATS:
            numerals = Numerals.from_text(text, FORMATS[name].number)
            assert [*zip(numerals.starts.tolist(), numerals.ends.tolist(), strict=True)] == spans
            words = (text[start:end] for start, end in spans)
            assert numerals.values.tolist() == [int(t[2:-1], 2) if t[0] == "'" else float(t) for t in words]

    alike()


def test_no_group_is_possessive():
    """But for one whose text is compared above: nothing in it fails behind its first character and a run."""
    possessive = re.compile(r"(?<!\\)\)(?:[?*+]|\{[\d,]+\})\+")
    found = [
        f"{path.relative_to(folder)}: {line.strip()}"
        for package in (schemas, solver, service, robotprograms)
        for folder in map(Path, package.__path__)
        for path in folder.rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if possessive.search(line)
    ]
    assert [line.split(":")[0] for line in found] == ["security/admission.py"]
