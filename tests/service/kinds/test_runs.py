"""Runs as users ask for them: options, elastic links, long ones that workers compute."""

import json
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from support.documents import changed
from support.jobs import run_request, runs_of, set_of, stored_set
from support.programs import exact_run, flat, path, request, tool_poses
from support.terminal import terminal

import jointstiff
from jointstiff.schemas.deflection import DeflectionOptions
from jointstiff.schemas.run import Run, RunRequest
from jointstiff.service import jobs as module
from jointstiff.service.jobs import Parts
from jointstiff.service.kinds.correction import path as program_path
from jointstiff.service.kinds.correction.programs import ProgramWork
from jointstiff.service.kinds.correction.text import FaultsError
from jointstiff.service.kinds.run import kind as run_module
from jointstiff.service.kinds.run.kind import RUN
from jointstiff.service.kinds.work import carry_out, new_job, pack_arrays
from jointstiff.service.problems import TooManyJobsError
from jointstiff.service.reports.job import job_parts
from jointstiff.service.resources.stored import Resources
from jointstiff.service.runs.deflection import predict_by_run
from jointstiff.service.store.store import Store
from jointstiff.service.tables.report import View
from jointstiff.service.tables.stiffness import UNITS
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.base import pedestal_campaign
from jointstiff.simulator.elastic_links import beam_arm, elastic_campaign
from jointstiff.simulator.programs import program_text
from jointstiff.solver.choice import competition
from jointstiff.solver.choice.competition import Competition, Winner
from jointstiff.solver.choice.held_out import LIMITS, LINKS_ALONE, WEIGHTS, HeldOut, Selection
from jointstiff.solver.errors import RequestError, UnsupportedMethodError
from jointstiff.solver.fit.effective import EffectiveCompliances
from jointstiff.solver.fit.estimate import Prediction
from jointstiff.solver.outcome.found import describe_choice_by_comparison
from jointstiff.solver.outcome.rules import _report_links
from jointstiff.solver.predict.answers import build_forward_model

VIEW = View(True, UNITS["MNm/rad"])
OPTIONS = {"elasticity": "joints_and_links", "link_penalty": 1e-3, "cross_validation": {"folds": 3}}


@pytest.fixture(scope="module")
def document():
    return elastic_campaign(beam_arm(default_arm()), configurations=24, seed=5)


@pytest.fixture(scope="module")
def set_id(memory, document):
    return set_of(Parts(memory), document)


def carried_out(memory, set_id, **options):
    jobs = Parts(memory).jobs["run"]
    request = RunRequest.model_validate({"measurement_set_id": set_id} | OPTIONS | options)
    return jobs.current(jobs.create(request, None).id)


@pytest.fixture(scope="module")
def given(memory, set_id):
    return carried_out(memory, set_id)


def test_a_given_penalty_is_quick_and_reports_all(given, document):
    assert given.state == "succeeded", given.error
    assert given.progress is None
    result, links = given.result, given.result.links
    assert (result.choice.elasticity, result.choice.source) == ("joints_and_links", "given")
    assert (links.penalty, links.penalty_source) == (1e-3, "given")
    assert [link.joint for link in links.links] == [f"joint_{j + 1}" for j in range(6)]
    for link in links.links:
        matrix = np.array(link.matrix)
        np.testing.assert_array_equal(matrix, matrix.T)
        assert np.linalg.eigvalsh(matrix).min() >= 0.0
        for principal, block in ((link.translation, matrix[:3, :3]), (link.rotation, matrix[3:, 3:])):
            for each in principal:
                direction = np.array(each.direction)
                np.testing.assert_allclose(
                    block @ direction, each.value * direction, atol=1e-6 * abs(matrix).max()
                )
    shares = sum(element.share for element in links.elements)
    assert shares + links.unexplained == pytest.approx(1.0)
    assert len(links.elements[0].by_observation) == len(document["measurement_set"]["observations"])
    assert links.certificate.gap <= 1e-2
    assert links.certificate.least_eigenvalue >= 0.0
    assert links.effective_freedom <= links.parameters == 132
    assert result.compensation > 0.95
    assert result.rms_residual == pytest.approx(
        np.sqrt(np.mean([np.square(each.residual).sum() for each in result.residuals]))
    )


def test_the_table_of_elements_has_the_least_and_the_greatest_share_of_an_observation(given):
    elements = given.result.links.elements
    table = next(part for part in job_parts(RUN, given, VIEW) if "element" in getattr(part, "head", list)())
    columns = {column.name: list(column.values)[:-1] for column in table.columns}
    assert columns["least"] == [min(each.by_observation) for each in elements]
    assert columns["greatest"] == [max(each.by_observation) for each in elements]
    assert columns["least"] < columns["overall"] < columns["greatest"]


def test_joints_have_their_number_and_its_spread(given):
    for joint in given.result.joints:
        assert joint.compliance >= 0.0
        assert joint.status == ("identified" if joint.compliance else "at_bound")
        assert joint.compliance == 0.0 or "link's rotation" in joint.reason
        assert joint.standard_uncertainty >= 0.0
        assert joint.compliance_interval is None


def test_deflections_are_predicted_by_the_stored_model(memory, given, document):
    """As the message travels, at a target that was read: what the run itself predicts there."""
    parts = Parts(memory)
    run = Run.model_validate_json(given.model_dump_json())
    readings = document["measurement_set"]
    observation = readings["observations"][3]
    robot = parts.sets.prepared(run.request.measurement_set_id).robot
    options = {
        "units": readings["units"],
        "load_point": readings["load_point"],
        "cases": [{"joints": observation["joints"], "force": observation["force"]}],
    }
    found = predict_by_run(robot, run, DeflectionOptions.model_validate(options))
    (case,) = found.cases
    for (low, high), value in zip(case.readings_only, case.displacement, strict=True):
        assert low < value < high
    assert found.model_error_postures == 24
    assert case.with_model_error is not None
    np.testing.assert_allclose(
        np.array(case.compliance.translation_by_force) @ observation["force"], case.displacement, atol=1e-9
    )
    masses = options | {"masses": [{"joint": "joint_2", "mass": 1.0, "centre": [0.0, 0.0, 0.0]}]}
    with pytest.raises(RequestError, match="own weight"):
        predict_by_run(robot, run, DeflectionOptions.model_validate(masses))
    assert build_forward_model(robot, run.result.model, run.result.joints)[0].first_order


def turned_by(matrix, rotation, lever, force):
    """Motion of a point by a spring: a force at a lever acts, in the axes of a frame."""
    axes = np.kron(np.eye(2), rotation)
    turn = axes @ np.array(matrix) @ axes.T @ np.r_[force, np.cross(lever, force)]
    return turn[:3] + np.cross(turn[3:], lever)


def predict_by_hand(robot, result, q, point, force):
    """Predict by the published numbers: own compliances, links and base; Pinocchio places the frames."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    place = data.oMf[robot.model.getFrameId(robot.flange)].act(np.array(point))
    springs = [(result.links.base.matrix, pin.SE3.Identity())] if result.links.base else []
    for index, joint in enumerate(result.joints):
        axis = np.r_[np.zeros(3), robot.axes[index]]
        springs.append((joint.own_compliance * np.outer(axis, axis), data.oMi[index + 1]))
    frame_of = dict(zip(robot.joint_names, data.oMi[1:], strict=False))
    springs += [(link.matrix, frame_of[link.joint]) for link in result.links.links]
    return sum(turned_by(matrix, at.rotation, place - at.translation, force) for matrix, at in springs)


@pytest.mark.parametrize("model", ["diagonal_links", "joints_and_links", "joints_and_base", "links_and_base"])
def test_the_published_numbers_predict_as_predict_does(memory, set_id, document, model):
    readings = document["measurement_set"]
    robot = Parts(memory).sets.prepared(set_id).robot
    run = carried_out(memory, set_id, elasticity=model)
    cases = [{"joints": each["joints"], "force": each["force"]} for each in readings["observations"]]
    options = {"units": readings["units"], "load_point": readings["load_point"], "cases": cases}
    found = predict_by_run(robot, run, DeflectionOptions.model_validate(options))
    for case, answer in zip(cases, found.cases, strict=True):
        by_hand = predict_by_hand(
            robot, run.result, np.array(case["joints"]), readings["load_point"], case["force"]
        )
        assert np.linalg.norm(by_hand - answer.displacement) <= 1e-9 * np.linalg.norm(by_hand)


def test_effective_compliances_are_the_own_ones_with_their_links(given, memory, set_id):
    """Where an interval is open the effective one may be zero; the own one never exceeds it."""
    robot = Parts(memory).sets.prepared(set_id).robot
    links = {link.joint: np.array(link.matrix)[3:, 3:] for link in given.result.links.links}
    for joint, axis in zip(given.result.joints, robot.axes, strict=True):
        effective = joint.own_compliance + axis @ links[joint.name] @ axis
        assert joint.compliance == pytest.approx(effective, rel=1e-9)


def test_joints_alone_are_another_fit_with_its_own_score(given):
    result = given.result
    scores = {each.model: each.compensation for each in result.choice.models}
    assert result.alone.compensation == scores["joints"] < scores["joints_and_links"]
    assert [joint.name for joint in result.alone.joints] == [joint.name for joint in result.joints]
    assert [each.stiffness for each in result.alone.joints] != [each.stiffness for each in result.joints]


def test_a_program_is_corrected_by_links(memory, set_id, given):
    robot = Parts(memory).sets.prepared(set_id).robot
    text = program_text("krl", tool_poses(path(12)), 5)
    result = flat(ProgramWork(robot, "robot", given, request("krl", text)).conclude(()))
    assert result.corrected == 12
    assert result.residual.greatest < 1e-6 < 1e-3 < result.deflection.median  # five digits of mm and degrees
    for point in result.worst:
        (low, high), (wide_low, wide_high) = point.interval, point.interval_with_model_error
        assert wide_low <= low < point.deflection < high <= wide_high
    assert any("first order" in remark for remark in result.remarks)
    masses = [{"joint": "joint_2", "mass": 1.0, "centre": [0.0, 0.0, 0.0]}]
    with pytest.raises(RequestError, match="own weight"):
        ProgramWork(robot, "robot", given, request("krl", text, masses=masses))


@pytest.mark.parametrize(("apart", "refused"), [(0.0, False), (1e-7, False), (1e-5, True), (-0.5, True)])
def test_a_target_is_visited_again_with_full_turns_between_alone(apart, refused, monkeypatch):
    """The posture of its second visit, two turns of a joint further, and a difference."""
    robot, run = exact_run()
    place = program_text("krl", tool_poses(path(1)), 5).partition("{")[2].partition("}")[0]
    moves = "$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\nLIN XP1\nLIN XP1"
    text = f"DEF a()\nDECL E6POS XP1={{{place}}}\n{moves}\nEND"
    work = ProgramWork(robot, "robot", run, request("krl", text))
    again = path(1) + np.eye(6)[5] * (4.0 * np.pi + apart)
    both = np.concatenate([path(1), again])
    monkeypatch.setattr(program_path, "choose_postures", lambda *_: (both, np.zeros(2)))
    with pytest.raises(FaultsError, match="two different configurations") if refused else nullcontext():
        np.testing.assert_array_equal(work._path.cases.joints, path(1))


def parts(*values):
    return [SimpleNamespace(value=value, direction=(0.0, 0.0, 1.0)) for value in values]


def test_a_compliance_that_is_rounding_is_shown_as_rigid():
    """2 nm/N are 2 µm/kN, or 500 N/µm; a 10⁻⁹th of it is nothing."""
    bends = SimpleNamespace(
        translation=parts(2e-9, 1e-9, 1e-18),
        rotation=parts(5e-7, 4e-7, 4e-16),
        effective_freedom=5.0,
        parameters=21,
    )
    assert run_module._principal_compliances(bends, "translation").text == "2, 1, 0"
    assert run_module._principal_compliances(bends, "rotation").text == "500, 400, 0"
    *_, compliance, stiffness = run_module._base_table(bends).columns
    assert [cell.text for cell in compliance.values[:3]] == ["2 µm/kN", "1 µm/kN", "0 µm/kN"]
    assert [cell.text for cell in stiffness.values[:3]] == ["500 N/µm", "1000 N/µm", "rigid"]


@pytest.mark.parametrize(("targets", "visits"), [(10_000, 10_000), (10_001, 1), (1, 10_001)])
def test_a_program_is_cut_by_its_points_or_by_its_visits(targets, visits):
    program = SimpleNamespace(targets=range(targets), moves=SimpleNamespace(visits=range(visits)))
    work = SimpleNamespace(_program=program, _spans=lambda: [(0, 9)])
    assert ProgramWork.steps(work) == ([(0, 9)] if max(targets, visits) > 10_000 else ())


def test_the_choice_compares_all_models(given):
    choice = given.result.choice
    names = [scored.model for scored in choice.models]
    assert names == ["joints", "coupled_joints", "diagonal_links", "joints_and_links"]
    assert choice.best in names
    assert (choice.elasticity, choice.loss) == ("joints_and_links", "squared")
    assert given.result.links.loss_source == "given"
    for scored in choice.models:
        assert scored.compensation == pytest.approx(np.mean(scored.by_fold))
        assert scored.standard_error == pytest.approx(np.std(scored.by_fold, ddof=1) / np.sqrt(3))
    by_name = {scored.model: scored.compensation for scored in choice.models}
    assert by_name["joints_and_links"] > by_name["joints"] + 0.1


def test_cross_validation_is_a_durable_job_with_the_numbers_of_one_go(memory, set_id):
    """A worker computes each step from the stored request, and its result travels as bytes."""
    enqueued = []
    parts = Parts(memory, lambda _, job_id: enqueued.append(job_id))
    jobs = parts.jobs["run"]
    request = RunRequest.model_validate(
        {
            "measurement_set_id": set_id,
            "elasticity": "diagonal_links",
            "links": ["joint_2"],
            "loss": "squared",
            "cross_validation": {"folds": 2, "draws": 4, "seed": 1},
        }
    )
    record = jobs.create(request, None)
    assert enqueued == [record.id]
    queued = jobs.current(record.id)
    assert (queued.state, queued.progress.unit) == ("queued", "penalties")
    assert queued.progress.total == 4 * 2 * len(WEIGHTS)
    worker = Parts(memory).jobs["run"]
    worker.mark_running(record.id)
    work = worker.work(record.id)
    steps = work.steps()
    assert [start for start, _ in steps[1:]] == [stop for _, stop in steps[:-1]]
    computed = {span: pack_arrays(work.compute(span)) for span in reversed(steps)}
    worker.conclude(record.id, [computed[span] for span in steps])
    durable = jobs.current(record.id)
    told = []
    work = RUN.prepare_work(Resources(memory), request)
    same = carry_out(new_job(Run, request, work), work, told.append)
    assert durable.state == same.state == "succeeded"
    assert durable.result == same.result
    assert durable.result.links.penalty_source == "cross_validation"
    assert [link.joint for link in durable.result.links.links] == ["joint_2"]
    assert told[-1].done == queued.progress.total
    assert told[-1].activity == "cross-validating"


@pytest.mark.slow
def test_automatic_takes_the_simplest_model_that_is_good_enough(memory, set_id):
    parts = Parts(memory)
    rigid = json.loads(json.dumps(simulate_campaign(default_arm(), load="pull", configurations=12, seed=2)))
    rigid_id = set_of(parts, rigid)
    options = {"elasticity": "automatic", "link_penalty": None, "links": ["joint_2"]}
    options["cross_validation"] = {"folds": 2, "draws": 2}
    joints = carried_out(memory, rigid_id, **options).result
    assert joints.links is None
    assert joints.choice.models == []
    assert (joints.choice.elasticity, joints.choice.loss, joints.choice.source) == (
        "joints",
        "squared",
        "screening",
    )
    assert joints.choice.links_p_value > 3e-3
    assert joints.model is not None
    jobs, worker = parts.jobs["run"], Parts(memory, lambda *_: None).jobs["run"]
    record = worker.create(RunRequest.model_validate({"measurement_set_id": set_id} | options), None)
    jobs.mark_running(record.id)
    work = jobs.work(record.id)
    jobs.conclude(record.id, [pack_arrays(work.compute(span)) for span in work.steps()])
    listed = jobs.current(record.id)
    bends = listed.result
    assert listed.elasticity == bends.choice.elasticity != "automatic"  # it is listed by what bends
    assert bends.choice.source == "cross_validation"
    assert bends.choice.links_p_value < 1e-5
    residuals = {scored.model: scored.mean_residual for scored in bends.choice.models}
    assert residuals[bends.choice.elasticity] < residuals["joints"]
    said = {reason.code: reason.message for reason in bends.assessment.reasons}["links_bend_with_joints"]
    assert "predicts held-out postures to" in said
    assert bends.choice.elasticity == bends.choice.simplest != "joints"


TIE = Selection(
    models=tuple(
        HeldOut(name, "squared", 5e-5, None, np.full(5, 0.98), np.full(16, 5e-5), 5)
        for name in ("joints", "joints_and_base", "diagonal_links", "joints_and_links")
    ),
    best="joints_and_base",
    simplest="joints_and_base",
    largest="joints_and_base",
    gain=None,
    tied="diagonal_links",
)


@pytest.mark.parametrize(
    ("uncertified", "intervals"),
    [
        ((), "joints_and_links"),
        (("joints_and_links",), "diagonal_links"),
        (("diagonal_links",), None),
        (("diagonal_links", "joints_and_links"), None),
    ],
)
def test_a_tied_model_without_a_certified_optimum_fails_no_run(monkeypatch, document, uncertified, intervals):
    """The chosen model keeps its own intervals, and the run says so."""
    places = {
        "joints_and_base": [[1.0, 3.0]],
        "diagonal_links": [[2.0, 4.0]],
        "joints_and_links": [[2.0, 6.0]],
    }

    none = Prediction(np.zeros((1, 1, 3)), np.zeros((1, 1, 3)), None, 0.0, bending="base")
    model = SimpleNamespace(name="joints_and_base")
    base = replace_in(SimpleNamespace(model=model), prediction=none)

    class Tied(Competition):
        _requested = None
        penalty_is_given = False

        def _fit_whole_set_by_squares(self, name, _):
            return None if name in uncertified else base if name == "joints_and_base" else name

        def _fit_with_chosen_penalty(self, chosen, _):
            if chosen.model in uncertified:
                raise UnsupportedMethodError("no certified optimum", where="link_penalty", remedy="")
            return base if chosen.model == "joints_and_base" else chosen.model

        def _compute_effective(self, _, widest):
            name = widest if isinstance(widest, str) else "joints_and_base"
            return EffectiveCompliances(np.array([2.0]), np.array([2.0]), np.array(places[name]), 2.0)

    monkeypatch.setattr(competition, "replace", replace_in)
    elastic = object.__new__(Tied)._fit_whole_set(TIE.models[1], TIE, {})
    high = 3.0 if intervals is None else places[intervals][0][1]
    assert (elastic.effective.ends.tolist(), elastic.intervals) == ([[1.0, high]], "joints_and_base")
    prediction = elastic.estimate.prediction
    assert (prediction.bending, prediction.joined) == ("links_or_base", intervals is not None)
    (finding,) = _report_links(prediction, None)
    assert finding.code == "links_or_base"
    assert finding.weight == "use_with_care"
    assert ("contain the values of both" in finding.message) == (intervals is not None)
    screening = SimpleNamespace(links_p_value=1e-9)
    choice = describe_choice_by_comparison(Winner(TIE, TIE.models[1], elastic, given=False), screening)
    assert ("contain both models' values" in choice.message) == (intervals is not None)
    assert ("are computed with joints and base alone" in choice.message) == (intervals is None)


def replace_in(part, **changes):
    """Replace fields of a data class, or of a namespace."""
    if isinstance(part, SimpleNamespace):
        return SimpleNamespace(**(vars(part) | changes))
    return replace(part, **changes)


@pytest.mark.slow
@pytest.mark.parametrize("certified", [True, False])
def test_a_base_or_links_that_predict_alike_are_a_tie(monkeypatch, certified):
    """Intervals contain the values of both, if a model with links alone has a certified optimum."""
    pedestal = pedestal_campaign(default_arm(), 2e7, configurations=12, sigma=6e-5, seed=2)
    options = {"loss": "squared", "cross_validation": {"folds": 3, "draws": 1}}
    fit = competition.fit_first_certified

    def only_of_a_base(folds, candidate, weights):
        if candidate.model.name in LINKS_ALONE:
            raise UnsupportedMethodError("no certified optimum", where="link_penalty", remedy="")
        return fit(folds, candidate, weights)

    alone = {
        name: jointstiff.identify(pedestal, elasticity=name, **options).result
        for name in ("joints_and_base", "diagonal_links")
    }
    if not certified:
        monkeypatch.setattr(competition, "fit_first_certified", only_of_a_base)
    result = jointstiff.identify(pedestal, **options).result
    assert (result.choice.elasticity, result.assessment.verdict) == ("joints_and_base", "use_with_care")
    (reason,) = (each for each in result.assessment.reasons if each.code == "links_or_base")
    assert reason.weight == "use_with_care"
    assert "turn joint 1" in reason.remedy
    assert ("contain the values of both" in reason.message) == certified
    assert ("contain both models' values" in result.choice.message) == certified
    for name in alone if certified else ("joints_and_base",):
        for joint, other in zip(result.joints, alone[name].joints, strict=True):
            low, high = joint.compliance_interval
            assert 0.98 * low <= other.compliance <= 1.02 * high, (name, joint.name)
            assert joint.standard_uncertainty > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3, 5])
def test_a_pedestal_that_moves_targets_as_link_1_does_is_a_tie(seed):
    """Equally stiff about x and y: the intervals have the truth, though links predict a little better."""
    arm = default_arm()
    pedestal = pedestal_campaign(arm, 8e6, configurations=24, seed=seed)
    result = jointstiff.identify(pedestal, loss="squared").result
    assert result.choice.elasticity == "diagonal_links"
    assert [reason.code for reason in result.assessment.reasons] == ["links_or_base"]
    assert "use the model with links; the intervals" in result.assessment.reasons[0].message
    for joint, truth in list(zip(result.joints, arm.compliances, strict=True))[1:]:
        if joint.name == "joint_6" and joint.compliance_interval is None:
            assert joint.reason.startswith("the load hangs too near this joint's axis")
            continue
        low, high = joint.compliance_interval
        assert low <= truth <= high, joint.name


@pytest.mark.slow
def test_a_pedestal_is_recognised_and_shown(tmp_path):
    """By default: the base comes as a block of its own, and joint 2 without it.

    The pedestal is half as stiff about x as about y: link 1, which turns with joint 1, cannot do that.
    """
    path = tmp_path / "pedestal.json"
    path.write_text(json.dumps(pedestal_campaign(default_arm(), [8e6, 1.6e7], configurations=24, seed=3)))
    command = ["identify", str(path), "--loss", "squared"]
    printed = terminal(*command, "--json")
    result = Run.model_validate_json(printed.stdout).result
    assert (result.choice.elasticity, result.choice.source) == ("joints_and_base", "cross_validation")
    assert [each.value for each in result.links.base.rotation[:2]] == pytest.approx(
        [1.25e-7, 6.25e-8], rel=0.2
    )
    assert result.joints[1].compliance == pytest.approx(default_arm().compliances[1], rel=0.03)
    assert "the base's rotation" in result.joints[0].reason
    assert [reason.code for reason in result.assessment.reasons] == ["base_bends"]
    shown = terminal(*command, "--details", width=120)
    for text in ("Base below joint 1", "joints and base", "N·m/rad", "µrad/(kN·m)"):
        assert text in shown.stdout


def test_readings_without_a_balance_are_identified_without_it():
    """Deflections a thousand times too large: joints as soft as they say would not carry the load."""
    wrong = simulate_campaign(default_arm(), load="pull", seed=2)
    for observation in wrong["measurement_set"]["observations"]:
        for reading in observation["readings"]:
            moved = np.subtract(reading["loaded"], reading["unloaded"])
            reading["loaded"] = (reading["unloaded"] + 1e3 * moved).tolist()
    found = jointstiff.identify(wrong, elasticity="joints").result
    size = found.complementary_stiffness
    assert (size.included, size.iterations) == (False, 0)
    (reason,) = (each for each in found.assessment.reasons if each.code == "complementary_stiffness_matters")
    assert "had to be neglected: with such soft joints, the loaded arm has no equilibrium" in reason.message
    assert "units" in reason.remedy
    assert found.assessment.verdict == "do_not_use"
    assert "include_complementary_stiffness" not in {
        reason.action.kind for reason in found.assessment.reasons if reason.action
    }


def identified(noise, **options):
    document = simulate_campaign(default_arm(), configurations=8, load="pull", **options)
    document["measurement_set"]["noise"] = noise
    return jointstiff.identify(document)


ALL = {
    "sigma": 2e-5,
    "force": {"scale": 0.01, "direction": 0.002},
    "load_point": 5e-4,
    "grounds": {"load_point": "tracker"},
    "target_places": 5e-4,
    "axes": {"position": 1e-4, "direction": 1e-4},
}


def test_each_source_is_named_and_all_add_up():
    result = identified(ALL).result
    budget = result.budget
    assert [(part.source, part.evaluation) for part in budget.components if part.included] == [
        ("readings", "B"),
        ("force_scale", "B"),
        ("force_direction", "B"),
        ("load_point", "B"),
        ("target_places", "B"),
        ("axes", "B"),
    ]
    assert budget.missing == []
    beyond = {part.source: part for part in budget.components if not part.included}
    assert set(beyond) == {"model_error"}
    assert beyond["model_error"].degrees_of_freedom == 7
    for j, joint in enumerate(result.joints):
        parts = [part.contributions[j] ** 2 for part in budget.components if part.included]
        assert sum(parts) == pytest.approx(joint.standard_uncertainty**2, rel=1e-9)
        assert budget.expanded_uncertainty[j] == pytest.approx(
            1.959964 * joint.standard_uncertainty, rel=1e-6
        )
        own = budget.contributions_to(joint.name).values()
        assert sum(value**2 for value in own) == pytest.approx(joint.standard_uncertainty**2, rel=1e-9)


def test_a_stated_direction_of_the_force_says_nothing_of_its_size():
    sources = {part.source for part in identified({"force": {"direction": 0.002}}).result.budget.components}
    assert sources >= {"assumed_force_scale", "force_direction"}


def test_lengths_are_in_the_units_of_the_set():
    places = {"load_point": 0.5, "target_places": 0.5, "axes": {"position": 0.1, "direction": 1e-4}}
    metres = identified(ALL).result.budget
    in_mm = {"length": "mm", "angle": "rad", "force": "N"}
    millimetres = identified(ALL | {"sigma": 0.02} | places, units=in_mm).result.budget
    for one, other in zip(metres.components, millimetres.components, strict=True):
        assert one.contributions == pytest.approx(other.contributions, rel=1e-6)


def test_intervals_hold_the_truth_where_the_load_point_is_10_mm_off():
    """In each of twelve directions at random; a statement that a tracker read it would miss many truths."""
    arm, generator = default_arm(), np.random.default_rng(6)
    inside = with_exact_point = count = 0
    for seed in range(12):
        document = simulate_campaign(arm, configurations=19, load="pull", seed=seed)
        moved = document["measurement_set"]["load_point"] + 0.01 * generator.standard_normal(3)
        document["measurement_set"]["load_point"] = moved.tolist()
        result = jointstiff.identify(document, elasticity="joints").result
        exact = changed(document, ("measurement_set.noise.grounds", {"load_point": "tracker"}))
        others = jointstiff.identify(exact, elasticity="joints").result.joints
        for joint, other, truth in zip(result.joints, others, arm.compliances, strict=True):
            low, high = joint.compliance_interval
            count += 1
            inside += low <= truth <= high
            low, high = other.compliance_interval
            with_exact_point += low <= truth <= high
    assert inside >= 0.93 * count
    assert with_exact_point < 0.85 * count


@pytest.fixture
def store(either_database_url):
    with Store.open(either_database_url) as opened:
        yield opened


@pytest.fixture
def enqueued():
    return []


@pytest.fixture
def runs(store, enqueued):
    """Runs whose long ones are left to workers, and listed."""

    return runs_of(store, lambda _connection, run_id: enqueued.append(run_id))


def test_steps_in_any_order_make_the_run_that_one_process_makes(store, runs, enqueued):
    set_id = stored_set(store)
    run = runs.create(run_request(set_id), None)
    work = runs.work(run.id)
    spans = [(0, 1), (1, 170), (170, 300)]
    computed = {span: pack_arrays(work.compute(span)) for span in reversed(spans)}
    for _ in range(2):  # as two workers may
        runs.mark_running(run.id)
    for span in [*reversed(spans), spans[1]]:  # one of them twice, as workers may
        store.steps.store_result(run.id, span, computed[span])
    assert runs.current(run.id).state == "running"
    assert runs.current(run.id).progress.done == 300
    runs.conclude(run.id, store.steps.results(run.id))
    at_once = runs_of(store).create(run_request(set_id), None)
    assert runs.current(run.id).result == runs.current(at_once.id).result
    assert runs.current(run.id).result.resampling.repetitions == 300
    assert runs.current(run.id).provenance.ended_at is not None


def test_a_run_ends_once(store, runs):
    run = runs.create(run_request(stored_set(store)), None)
    store.steps.store_result(run.id, (0, 120), b"")
    cancelled = runs.cancel(run.id)
    assert (cancelled.state, cancelled.progress.done) == ("cancelled", 120)
    work = runs.work(run.id)
    runs.conclude(run.id, [pack_arrays(work.compute((0, 300)))])
    runs.fail(run.id, RuntimeError("late"))
    assert runs.current(run.id) == cancelled
    assert runs.cancel(run.id) == cancelled


def test_refused_before_anything_is_stored(store, runs, enqueued):
    set_id = stored_set(store, targets={"P10": (0.1, 0.1, 0.0)})
    with pytest.raises(UnsupportedMethodError, match="needs 3 targets"):
        runs.create(run_request(set_id, method="complete_pose"), None)
    larger = "a draw of 13 configurations is larger than the measurement set with 12 configurations"
    with pytest.raises(RequestError, match=larger) as refused:
        runs.create(run_request(set_id, resampling={"size": 13}), None)
    assert refused.value.where == "resampling.size"
    for option in (
        {"loss": "huber"},
        {"priors": {"joint_2": {"stiffness": 1e6, "standard_uncertainty": 1e5}}},
        {"stiffness_order": [["joint_2", "joint_5"]]},
    ):
        with pytest.raises(UnsupportedMethodError, match="resampling") as refused:
            runs.create(run_request(set_id, **option), None)
        assert refused.value.where == "resampling"
    assert enqueued == []


def test_as_many_as_may_wait_and_no_more(store, runs, enqueued, monkeypatch):
    monkeypatch.setattr(module, "MAX_OPEN", 2)
    set_id = stored_set(store)
    first, _ = (runs.create(run_request(set_id), None) for _ in range(2))
    with pytest.raises(TooManyJobsError, match="are queued or running"):
        runs.create(run_request(set_id), None)
    runs.cancel(first.id)
    runs.create(run_request(set_id), None)
    assert len(enqueued) == 3


def test_progress_does_not_go_back_when_a_run_ends_while_it_is_read(store, runs, monkeypatch):
    """Its steps are gone then: the answer is that of the run as it ended, not one without progress."""
    run = runs.create(run_request(stored_set(store)), None)
    store.steps.store_result(run.id, (0, 120), b"")
    before = runs.records.status

    def end_first(job_id):
        monkeypatch.setattr(runs.records, "status", before)
        runs.cancel(job_id)
        return before(job_id)

    monkeypatch.setattr(runs.records, "status", end_first)
    read = runs.current(run.id)
    assert (read.state, read.progress.done) == ("cancelled", 120)


@pytest.mark.slow
def test_a_penalty_under_which_no_link_bends_is_noted():
    document = simulate_campaign(default_arm(), load="pull", seed=5, readings="deflections")
    del document["measurement_set"]["observations"][12:]
    result = jointstiff.identify(document, elasticity="coupled_joints", loss="huber").result
    assert max(WEIGHTS) < result.links.penalty <= max(LIMITS)
    assert "link_penalty_at_end" in {warning.code for warning in result.warnings}
