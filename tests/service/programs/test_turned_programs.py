"""Processes: programs with turned tools, written and read back, beside exact springs."""

import re
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from multiprocessing import get_context

import numpy as np
import pytest
from support.process_paths import process_path
from support.programs import ARM, exact_run, loaded_poses, options, path, tool_poses, work_of

import jointstiff
from jointstiff.schemas.process import ProcessRequest
from jointstiff.service.kinds.process.kind import make_area_map
from jointstiff.service.kinds.process.tables import places_sheet, turns_sheet
from jointstiff.service.kinds.process.work import ProcessWork
from jointstiff.service.kinds.program.files import compress_file, decompress_file
from jointstiff.service.kinds.program.text import FaultsError
from jointstiff.service.kinds.program.work import points_sheet
from jointstiff.simulator import equilibrium, simulate_campaign
from jointstiff.simulator.programs import PROGRAM_FILES, program_text
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.process.candidates import list_candidates
from jointstiff.solver.process.cut import MATERIALS, Cut
from robotprograms.formats import read_program
from robotprograms.krl import POSE as KRL_POSE
from robotprograms.program import NUMBERS

ACROSS = [float(np.sin(np.pi / 4)), 0.0, float(np.cos(np.pi / 4))]
"""Spindle at 45° to the last axis."""
FORCE = [300.0, 400.0, -1400.0]


def work(kind, text, **changes):
    robot, run = exact_run()
    files = [compress_file(PROGRAM_FILES[kind], text.encode("latin-1"))]
    stated = options(kind, spindle=ACROSS, feed=50.0) | changes
    request = ProcessRequest.model_validate({"run_id": "r", "files": files, **stated})
    return ProcessWork(robot, "robot", run, request)


def processed(kind, text, **changes):
    return work(kind, text, **changes).conclude(())


def program(kind, count=8, digits=9):
    return program_text(kind, tool_poses(path(count)), digits)


def turns(result):
    return {
        name: np.asarray(values)
        for name, values in turns_sheet(decompress_file(result.choice)).columns.items()
    }


def commanded(result):
    table = turns(result)
    return np.radians(np.column_stack([table[f"J{j}, command [deg]"] for j in range(1, 7)]))


@pytest.mark.parametrize("kind", PROGRAM_FILES)
def test_the_written_program_reads_back_as_it_was_meant_and_the_loaded_tool_is_on_its_targets(kind):
    result = processed(kind, program(kind))
    assert result.gain in {"less", "no_order"}
    assert result.turned.value < result.before.value
    written = read_program([(PROGRAM_FILES[kind], decompress_file(result.files[0]))])
    (notation,) = written.targets.notations
    goal = tool_poses(path(8))
    joints = commanded(result)
    if notation.has_pose:
        tool = notation.to_poses(written.targets.values[:, : 3 + notation.count])
        to_tool = np.eye(4)
        to_tool[:3, 3] = [0.01, -0.02, 0.2155]
        inverse = InverseKinematics(exact_run()[0])
        joints, reached = inverse.refine(tool @ np.linalg.inv(to_tool), joints)
        assert reached.all()
        np.testing.assert_allclose(joints, commanded(result), rtol=0, atol=1e-5)
        # The spindle points where it did, and the loaded tool is on its target.
        loaded = loaded_poses(joints, FORCE)
        np.testing.assert_allclose(loaded[:, :3, 3], goal[:, :3, 3], rtol=0, atol=1e-7)
        np.testing.assert_allclose(loaded[:, :3, :3] @ ACROSS, goal[:, :3, :3] @ ACROSS, rtol=0, atol=1e-6)
        assert result.corrected == 8
    else:
        assert not any(np.isfinite(turns(result)["turn [deg]"])), "targets in joint angles have no turn"


@pytest.mark.parametrize("kind", [*PROGRAM_FILES, "own base"])
def test_a_placed_program_reads_back_with_the_base_that_is_stated(kind):
    """The written program needs the base frames of the result, or none if it has their numbers itself."""
    own_base, kind = kind == "own base", "krl" if kind == "own base" else kind
    text, stated = program(kind), {}
    if own_base:
        stated["bases"] = []
        text = text.replace("$BASE=BASE_DATA[1]", "$BASE={X 0,Y 0,Z 0,A 0,B 0,C 0}")
    middle = tool_poses(path(8))[:, :3, 3]
    middle = 1e3 * 0.5 * (middle.min(axis=0) + middle.max(axis=0))
    half = np.array([100.0, 100.0, 0.0])
    box = [(middle - half).tolist(), (middle + half).tolist()]
    search = {"place": box, "grid": [2, 2, 1], "place_turns": 3, "turns": 12}
    result = processed(kind, text, **search, **stated)
    assert result.turned.value == result.places[0].deflection.value < result.before.value
    best = result.places[0]
    np.testing.assert_allclose(np.subtract(best.centre, best.shift), 1e-3 * middle, atol=1e-6)
    if own_base or kind == "ur":
        assert result.frames == []
        assert result.remarks[0].startswith("targets are written in the new place")
    else:
        assert len(result.frames) == 1
        stated["bases"] = [{"values": each.values} for each in result.frames]
    files = [compress_file(PROGRAM_FILES[kind], decompress_file(result.files[0]))]
    stated["start"] = np.degrees(commanded(result)[0]).tolist()
    again = ProcessRequest.model_validate(
        {"run_id": "r", "files": files, **options(kind, **stated), "turn": "keep"}
    )
    robot, run = exact_run()
    reread = ProcessWork(robot, "robot", run, again)._path
    np.testing.assert_allclose(reread.cases.joints, commanded(result), rtol=0, atol=1e-5)


@lru_cache
def turned():
    return processed("krl", program("krl"))


def test_the_deflection_before_and_after_is_that_of_exact_springs():
    result = turned()
    table = turns(result)

    def exact(joints):
        force = np.tile(FORCE, (len(joints), 1))
        zero, place = 0.0 * force, np.tile([0.01, -0.02, 0.2155], (len(joints), 1))
        bent = joints + equilibrium(ARM, joints, force, zero, place)
        ends = [ARM.posture(each).point_to_base(place) for each in (joints, bent)]
        return np.linalg.norm(ends[1] - ends[0], axis=1)

    wanted = np.radians(np.column_stack([table[f"J{j} [deg]"] for j in range(1, 7)]))
    np.testing.assert_allclose(1e-3 * table["turned [mm]"], exact(wanted), rtol=0, atol=1e-8)
    np.testing.assert_allclose(1e-3 * table["before [mm]"], exact(path(8)), rtol=0, atol=1e-8)
    # Half of the lines to and from a point count for the point.
    lines = np.linalg.norm(np.diff(tool_poses(path(8))[:, :3, 3], axis=0), axis=1)
    weights = np.append(lines, 0.0) + np.append(0.0, lines)
    for value, joints in ((result.before.value, path(8)), (result.turned.value, wanted)):
        assert value == pytest.approx(np.sqrt(np.average(exact(joints) ** 2, weights=weights)), abs=1e-8)
    assert result.difference.value == pytest.approx(result.turned.value - result.before.value)


def test_a_turn_that_is_kept_is_the_program_of_compensate():
    """One path, one model: the same numbers, and the same bytes."""
    kept = processed("krl", program("krl"), turn="keep")
    compensated = work_of("krl", program("krl"), load={"force": FORCE}).conclude(())
    assert decompress_file(kept.files[0]) == decompress_file(compensated.files[0])
    assert kept.deflection == compensated.deflection
    assert kept.before == kept.turned
    table, expected = (points_sheet(decompress_file(each.table)).columns for each in (kept, compensated))
    for name, column in expected.items():
        np.testing.assert_array_equal(table[name], column)


def test_without_a_correction_only_orientations_change():
    result = processed("krl", program("krl"), correct=False)
    written = read_program([("part.src", decompress_file(result.files[0]))])
    sent = read_program([("part.src", program("krl").encode())])
    np.testing.assert_allclose(written.targets.values[:, :3], sent.targets.values[:, :3], rtol=0, atol=1e-5)
    assert np.abs(written.targets.values[:, 3:6] - sent.targets.values[:, 3:6]).max() > 1.0
    assert result.remaining == result.turned
    assert b"Jointstiff run" not in decompress_file(result.files[0])


def with_words(text, joints):
    """KUKA's program whose targets state S and T by hand, but for shoulder and elbow."""
    lines, rows = [], iter(joints)
    for line in text.split("\r\n"):
        if line.startswith("LIN {"):
            s, t = words_of(next(rows))
            line = line.replace("LIN {", "PTP {").replace("}", f",S {s | 2},T {t}}}")
        lines.append(line)
    return "\r\n".join(lines)


def words_of(joints):
    """S without shoulder and elbow, and T, of joints (6,) [rad]."""
    return 4 * int(joints[4] < 0.0), sum(int(angle < 0.0) << j for j, angle in enumerate(joints))


@pytest.mark.parametrize("kind", ["krl", "rapid", "ur", "csv"])
def test_free_branches_are_written_where_the_words_or_the_nearest_posture_state_them(kind):
    """With a narrow range, the arm turns its wrist to the other side, or stays: both are written."""
    result = processed(kind, program(kind), branches="free", turn=[-20.0, 20.0])
    (file,) = result.files
    written = read_program([(PROGRAM_FILES[kind], decompress_file(file))])
    (notation,) = written.targets.notations
    to_tool = np.eye(4)
    to_tool[:3, 3] = [0.01, -0.02, 0.2155]
    tool = notation.to_poses(written.targets.values[:, : 3 + notation.count])
    joints, reached = InverseKinematics(exact_run()[0]).refine(
        tool @ np.linalg.inv(to_tool), commanded(result)
    )
    assert reached.all()
    np.testing.assert_allclose(joints, commanded(result), rtol=0, atol=1e-5)
    names = [name for name, _ in written.targets.literals[0].words]
    assert ("bring the arm to the first joints" in result.remarks[0]) == (not names)
    sent = read_program([(PROGRAM_FILES[kind], program(kind).encode())])
    if kind == "rapid":
        numbers = written.targets.values[:, NUMBERS : NUMBERS + len(names)]
        for column, name in enumerate(names):
            if name != "cfx":
                before, after = (
                    np.floor(each[:, int(name[2:]) - 1] / (np.pi / 2)) for each in (path(8), joints)
                )
                right = sent.targets.values[:, NUMBERS + column] == before  # others are left as they were
                np.testing.assert_array_equal(numbers[right, column], after[right])


@pytest.fixture
def other_side(monkeypatch):
    """The wrist cannot stay on the side of the program, as if the limits of axis 5 excluded it."""

    def list_others(*arguments):
        found = list_candidates(*arguments)
        return found.select(np.sign(found.joints[:, 4]) != np.sign(path(8)[found.point, 4]))

    monkeypatch.setattr("jointstiff.solver.process.turning.list_candidates", list_others)


@pytest.mark.usefixtures("other_side")
def test_words_of_a_free_branch_are_those_of_the_joints_that_are_meant():
    text = with_words(program("krl"), path(8))
    result = processed("krl", text, branches="free", turn=[-20.0, 20.0])
    joints = commanded(result)
    assert (np.sign(joints[:, 4]) != np.sign(path(8)[:, 4])).all(), "a wrist is on its other side"
    content = decompress_file(result.files[0]).decode()
    found = [tuple(map(int, each)) for each in re.findall(r"S (\d+),T (\d+)", content)]
    assert found == [(words_of(each)[0] | 2, words_of(each)[1]) for each in joints]


@pytest.mark.usefixtures("other_side")
def test_branches_that_the_words_cannot_state_are_not_written(monkeypatch):
    """FANUC's letters stay as they are, and so do KUKA's bits of shoulder and elbow."""
    refused = processed("fanuc", program("fanuc"), branches="free", turn=[-20.0, 20.0])
    assert (refused.files, refused.corrected) == ([], 0)
    assert refused.remarks[0].startswith(
        "no program is written, so move the robot to the joints in turns.csv: line 14:"
    )
    assert len(turns(refused)["turn [deg]"]) == 8
    elbow = iter([np.zeros(8, dtype=np.intp), np.full(8, 2, dtype=np.intp)])
    monkeypatch.setattr("jointstiff.service.kinds.process.work.find_branches", lambda *_: next(elbow))
    text = with_words(program("krl"), path(8))
    other_elbow = processed("krl", text, branches="free", turn=[-20.0, 20.0])
    assert other_elbow.files == []
    assert "cannot be rewritten for the chosen side of shoulder, elbow or wrist" in other_elbow.remarks[0]


def test_a_range_of_turns_is_kept():
    result = processed("krl", program("krl"), turn=[-20.0, 30.0])
    angles = turns(result)["turn [deg]"]
    assert angles.min() >= -20.0 - 1e-4
    assert angles.max() <= 30.0 + 1e-4
    assert result.turned.value >= turned().turned.value


def test_a_force_along_the_feed_and_a_cut_are_those_of_the_solver():
    """Both are one load along the path, which compensate takes, too."""
    cut = {
        "material": "aluminium",
        "diameter": 0.016,
        "teeth": 3,
        "speed": 200.0,
        "feed": 0.06,
        "depth": 0.004,
        "width": 0.016,
    }
    fields = {name: value for name, value in cut.items() if name != "material"}
    force = Cut(MATERIALS["aluminium"], **fields).mean_force().tolist()
    by_cut = processed("krl", program("krl"), load=None, cut=cut)
    by_feed = processed("krl", program("krl"), load={"force": force}, axes="feed", force_uncertainty=0.25)
    assert by_cut.before == by_feed.before
    assert by_cut.turned == by_feed.turned
    exact = processed("krl", program("krl"), load={"force": force}, axes="feed")
    assert exact.before.value == by_feed.before.value
    half = [each.before.readings[1] - each.before.value for each in (by_cut, exact)]
    assert half[0] > 0.2 * by_cut.before.value > half[1]
    compensated = work_of("krl", program("krl"), load=None, cut=cut, spindle=ACROSS).conclude(())
    kept = processed("krl", program("krl"), load=None, cut=cut, turn="keep")
    assert compensated.deflection == kept.deflection


@pytest.fixture(scope="module")
def run():
    document = simulate_campaign(ARM, load="pull", configurations=16, seed=1)
    return jointstiff.identify(document)


def tools_of(p):
    """Poses (m, 4, 4) of the tool, axes of the flange."""
    poses = p.poses.copy()
    poses[:, :3, 3] = p.centres
    return poses


def array_options(p):
    return {
        "axes": "feed",
        "spindle": p.spindle[0].tolist(),
        "tools": [{"values": [*p.place[0].tolist(), 0.0, 0.0, 0.0]}],
        "units": "m, deg, N",
    }


def test_a_run_places_and_turns_an_array_of_poses(run):
    p = process_path("trim", np.array([1.7, 0.0, 0.8]), count=12)
    stated = array_options(p)
    turned_only = run.process(tools_of(p), forces=[-150.0, -300.0, -120.0], **stated)
    half = np.array([0.2, 0.2, 0.0])
    low, high = p.middle - half, p.middle + half
    placed = run.process(
        tools_of(p),
        forces=np.tile([-150.0, -300.0, -120.0], (12, 1)),
        turn="free",
        place=[low.tolist(), high.tolist()],
        grid=(3, 3, 1),
        place_turns=4,
        **stated,
    )
    assert turned_only.error is placed.error is None
    best = placed.result.places[0]
    assert placed.result.turned.value == best.deflection.value < turned_only.result.turned.value
    assert placed.result.before == turned_only.result.before
    assert (np.array(best.centre) >= low - 1e-9).all()
    assert (np.array(best.centre) <= high + 1e-9).all()
    np.testing.assert_allclose(np.array(best.centre) - best.shift, p.middle, atol=1e-9)
    assert placed.result.places_tried == 36
    assert len(placed.table("csv").splitlines()) == 13
    sheet = places_sheet(decompress_file(placed.result.choice))
    assert sheet.columns["of grid"].sum() == 36
    assert sheet.columns["legal, or why not"].count("legal") == 3
    for other in placed.result.places[1:]:
        assert other.behind_best.value >= 0.0
        interval = other.behind_best.with_model_error or other.behind_best.readings
        assert other.is_worse == (interval[0] > 0.0)
    assert "Best places" in str(placed)
    area = make_area_map(sheet)
    least = np.nanmin(np.reshape(sheet.columns["deflection [m]"][:36], (9, 4)), axis=1)
    np.testing.assert_allclose(area.values, least)
    assert make_area_map(places_sheet(decompress_file(turned_only.result.choice))) is None


def test_places_are_steps_of_workers_with_progress_and_cancel(run):
    p = process_path("trim", np.array([1.7, 0.0, 0.8]), count=6)
    half = np.array([0.1, 0.1, 0.0])
    low, high = p.middle - half, p.middle + half
    search = {"place": [low.tolist(), high.tolist()], "grid": (2, 2, 1), "place_turns": 6, "turns": 12}
    stated = array_options(p) | search | {"forces": [-150.0, -300.0, -120.0]}
    progress = {"here": [], "elsewhere": []}
    found = [run.process(tools_of(p), **stated, on_progress=progress["here"].append)]
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        found.append(
            run.process(tools_of(p), **stated, executor=pool, on_progress=progress["elsewhere"].append)
        )
    assert sorted({each.done for each in progress["here"]}) == [8, 16, 24]
    assert progress["here"] == progress["elsewhere"]
    assert found[0].result.model_dump_json() == found[1].result.model_dump_json()
    seen = []
    cancelled = run.process(tools_of(p), **stated, on_progress=seen.append, cancel=lambda: bool(seen))
    assert (cancelled.state, len(seen)) == ("cancelled", 1)
    assert cancelled.result is None


def test_forces_of_the_points_are_the_force_of_all(run):
    p = process_path("blade", np.array([1.7, 0.0, 0.8]), count=8)
    stated = array_options(p)
    one = run.process(tools_of(p), forces=[-150.0, -300.0, -120.0], **stated)
    each = run.process(tools_of(p), forces=np.tile([-150.0, -300.0, -120.0], (8, 1)), **stated)
    assert one.result.turned == each.result.turned
    whole = np.linalg.norm(np.diff(p.centres, axis=0), axis=1).sum()
    by_length = [[0.0, -150.0, -300.0, -120.0], [whole, -150.0, -300.0, -120.0]]
    along = run.process(tools_of(p), forces=by_length, **stated)
    assert along.result.turned.value == pytest.approx(one.result.turned.value, rel=1e-12)
    with pytest.raises(jointstiff.CampaignError, match="`path` has shape"):
        run.process(np.zeros((8, 5)), forces=[1.0, 0.0, 0.0])


def test_an_arm_of_the_catalogue_is_answered_before_it_is_measured():
    p = process_path("trim", np.array([1.9, 0.0, 0.9]), count=8)
    stated = array_options(p)
    prior = jointstiff.process(
        "KUKA KR 210 R2700 extra", tools_of(p), forces=[-150.0, -300.0, -120.0], **stated
    )
    assert prior.error is None
    codes = [reason.code for reason in prior.result.assessment.reasons]
    assert "prior_stiffness" in codes
    assert prior.result.assessment.verdict == "use_with_care"
    low, high = prior.result.before.readings
    assert low < 0.75 * prior.result.before.value < 1.25 * prior.result.before.value < high


def test_another_payload_of_an_arm_that_is_not_measured_is_another_input():
    p = process_path("trim", np.array([1.9, 0.0, 0.9]), count=3)
    robots = [jointstiff.robot("KUKA KR 210 R2700 extra", payload=each) for each in (210.0, 210.0, 150.0)]
    forces = [-150.0, -300.0, -120.0]
    one, same, other = (
        jointstiff.process(each, tools_of(p), forces=forces, **array_options(p)) for each in robots
    )
    assert one.provenance.input_hash == same.provenance.input_hash
    assert one.provenance.input_hash != other.provenance.input_hash
    assert other.result.before.value == pytest.approx(210.0 / 150.0 * one.result.before.value, rel=1e-3)


def test_a_spindle_along_the_last_axis_gains_nothing(run):
    p = process_path("trim", np.array([1.7, 0.0, 0.8]), count=8, angle=0.0, offset=(0.0, 0.0, 0.3))
    result = run.process(tools_of(p), forces=[-150.0, -300.0, -120.0], **array_options(p))
    assert result.result.gain == "no_gain"
    assert str(result).splitlines()[1].startswith("no gain")


def test_a_run_that_cannot_rank_says_so_first(run):
    p = process_path("trim", np.array([1.7, 0.0, 0.8]), count=8)
    weak = run.process(
        tools_of(p),
        forces=[-150.0, -300.0, -120.0],
        turn=[-120.0, 120.0],
        force_uncertainty=1.0,
        **array_options(p),
    )
    assert weak.result.gain == "no_order"
    reason = weak.result.assessment.reasons[0]
    assert reason.code == "no_order"
    assert "measure the force of the process" in reason.remedy


def test_an_error_of_the_force_goes_with_the_workpiece():
    """Along the axes of the tool or of R0, it is that of the same forces along the feed, in any place."""
    half = np.array([0.05, 0.05, 0.0])
    middle = tool_poses(path(4))[:, :3, 3]
    middle = 0.5 * (middle.min(axis=0) + middle.max(axis=0))
    box = 1e3 * np.array([middle - half, middle + half])
    search = {"place": box.tolist(), "grid": [1, 1, 1], "place_turns": 4, "turns": 12}
    placed = processed("krl", program("krl", 4), force_uncertainty=0.3, **search)
    assert abs(np.sin(placed.places[0].turn)) > 0.5, "the workpiece is turned by a quarter"
    ways = work("krl", program("krl", 4), force_uncertainty=0.3, **search)
    ways.conclude(())
    moved, force = ways._placed.program, ways._placed.program.path.force[ways._visits.first]
    parts = ways._split_forces(moved, force)
    turn = moved.load_axes[0]
    np.testing.assert_allclose(turn @ np.array(FORCE), force[0], atol=1e-9)
    np.testing.assert_allclose(parts[0] / 0.3, turn * np.array(FORCE), atol=1e-9)
    along_tool = work("krl", program("krl", 4), axes="tool", force_uncertainty=0.3)
    sent = along_tool._as_sent
    parts = along_tool._split_forces(sent, sent.path.force)
    tool = tool_poses(path(4))[:, :3, :3]
    np.testing.assert_allclose(parts / 0.3, tool * np.array(FORCE), atol=1e-5)


def test_a_workpiece_out_of_reach_is_placed_and_compared_with_nothing():
    far = tool_poses(path(6))
    far[:, 0, 3] += 9.0
    middle = tool_poses(path(6))[:, :3, 3]
    middle = 1e3 * 0.5 * (middle.min(axis=0) + middle.max(axis=0))
    search = {"place": [(middle - 50.0).tolist(), (middle + 50.0).tolist()], "grid": [2, 2, 1]}
    text = program_text("csv", far, 6)
    result = processed("csv", text, branches="free", place_turns=2, turns=12, **search)
    assert result.before is result.difference is None
    assert result.gain == "no_order"
    assert result.assessment.reasons[0].message.startswith("the robot cannot follow the path")
    assert result.turned.value == result.places[0].deflection.value > 0.0
    assert np.isnan(turns(result)["before [mm]"]).all()
    with pytest.raises(FaultsError, match="or `branches: free`"):
        processed("csv", text, place_turns=2, turns=12, **search)


def test_another_branch_may_gain_where_no_turn_does():
    """The spindle along the last axis: turns change nothing, but the program's branch was not the best."""
    stated = {"spindle": [0.0, 0.0, 1.0], "tools": [{"values": [0.0, 0.0, 215.5, 0.0, 0.0, 0.0]}]}
    kept = processed("krl", program("krl", 4), **stated)
    assert kept.gain == "no_gain"
    free = processed("krl", program("krl", 4), branches="free", **stated)
    assert (free.gain == "no_gain") == (free.turned.value >= 0.98 * free.before.value)


def test_each_point_has_its_bands_before_as_chosen_and_corrected():
    result = processed("krl", program("krl"), force_uncertainty=0.2)
    table = turns(result)
    for name in ("before", "turned", "remaining"):
        low, high = (table[f"{name} {end}, readings [mm]"] for end in ("low", "high"))
        assert (low <= table[f"{name} [mm]"]).all()
        assert (table[f"{name} [mm]"] < high).all()
    # A force that may be 40 % stronger along each axis: what is corrected was foretold as uncertain before.
    half = table["turned high, readings [mm]"] - table["turned [mm]"]
    assert (table["remaining high, readings [mm]"] >= 0.9 * half).all()
    np.testing.assert_array_equal(table["remaining low, readings [mm]"], 0.0)


@pytest.mark.parametrize(
    ("stated", "reason"),
    [
        ({"turn": [-1e12, 1e12]}, "the range of turns exceeds a full turn"),
        ({"turn": [0.0, 361.0]}, "the range of turns exceeds a full turn"),
        ({"clearance": 10.0}, "too near a singularity"),
        ({"spindle": [0.0, 0.0, 0.0]}, "spindle axis is the zero vector"),
    ],
)
def test_what_cannot_be_chosen_is_refused(stated, reason):
    with pytest.raises(RequestError, match=reason):
        processed("krl", program("krl", 3), **stated)


def test_a_table_of_positions_cannot_be_turned():
    text = "x [mm],y [mm],z [mm]\n" + "\n".join(
        ",".join(f"{1e3 * each:.3f}" for each in pose[:3, 3]) for pose in tool_poses(path(4))
    )
    with pytest.raises(RequestError, match="no angle about the tool's axis"):
        processed("csv", text, tool_x=[1.0, 0.0, 0.0])


def test_a_name_that_comes_back_in_a_turned_program_is_read_back_as_the_same_target():
    """XP2 is turned in base 2 alone: there it gets numbers, in base 1 its name comes back."""
    places = re.findall(r"LIN (\{.*?\})", program("krl", 8))
    numbers = [[float(x) for x in re.findall(r"[XYZABC] (-?[\d.]+)", each)] for each in places]
    poses = KRL_POSE.to_poses(np.array(numbers))
    base = KRL_POSE.from_poses((poses[0] @ np.linalg.inv(poses[2]))[None], np.zeros((1, 6)))[0]
    declared = "".join(f"DECL E6POS XP{i}\nXP{i}={each}\n" for i, each in enumerate(places))
    moves = [
        "$BASE=BASE_DATA[2]",
        "LIN XP2",
        "$BASE=BASE_DATA[1]",
        "PTP XP1",  # a motion of the joints: the turn behind it is free
        *(f"LIN XP{i}" for i in (2, 3, 4, 2, 5)),
    ]
    text = "\n".join(["DEF path()", declared + "$TOOL=TOOL_DATA[1]", *moves, "END\n"])
    bases = [{"name": f"BASE_DATA[{i}]", "values": each} for i, each in ((1, [0.0] * 6), (2, base.tolist()))]
    result = processed("krl", text, turn=[-10.0, 0.0], bases=bases, correct=False)
    written = decompress_file(result.files[0]).decode().split("\n")
    turned = [line for line in written if line.startswith(("LIN", "PTP"))]
    assert turned[0].startswith("LIN {X")
    assert turned[1:] == ["PTP XP1", *(f"LIN XP{i}" for i in (2, 3, 4, 2, 5))]


def test_if_no_place_can_be_followed_the_workpiece_stays_and_the_table_says_why():
    far = {"place": [[9e4, 0.0, 0.0], [9e4, 0.0, 0.0]], "grid": [1, 1, 1]}
    result = processed("krl", program("krl", 3), **far)
    assert result.places == []
    assert result.assessment.reasons[0].code == "place_kept"
    assert len(places_sheet(decompress_file(result.choice)).columns["x [m]"]) == 8
    assert result.turned.value <= result.before.value


def test_the_evaluation_of_places_in_full_has_progress_and_can_be_cancelled(run):
    p = process_path("trim", np.array([1.7, 0.0, 0.8]), count=12)
    box = {
        "place": [(p.middle - 0.1).tolist(), (p.middle + 0.1).tolist()],
        "grid": (2, 2, 2),
        "place_turns": 2,
        "forces": [-150.0, -300.0, -120.0],
    }
    seen = []
    done = run.process(
        tools_of(p), on_progress=lambda each: seen.append(each.activity), **box, **array_options(p)
    )
    assert done.state == "succeeded"
    assert [each for each in seen if each.startswith("turning at place")] == [
        f"turning at place {k} of 3" for k in (1, 2, 3)
    ]
    stopped = run.process(
        tools_of(p),
        on_progress=lambda each: seen.append(each.activity),
        cancel=lambda: seen.count("turning at place 1 of 3") == 2,
        **box,
        **array_options(p),
    )
    assert stopped.state == "cancelled"
