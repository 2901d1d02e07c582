"""Elastic links as a user asks for them: as a run, as a durable job, on the command line."""

import json

import numpy as np
import pytest
from pydantic import ValidationError
from support.jobs import set_of
from support.programs import path, request, tool_poses
from support.terminal import terminal

from jointstiff.schemas.deflection import DeflectionOptions
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Run, RunRequest
from jointstiff.service.jobs import Parts
from jointstiff.service.kinds.deflection import predict_by_run
from jointstiff.service.kinds.program_work import ProgramWork
from jointstiff.service.kinds.run import RUN
from jointstiff.service.kinds.work import carry_out, new_job, pack
from jointstiff.service.reports.job import job_parts
from jointstiff.service.resources.stored import Resources
from jointstiff.service.tables.report import View
from jointstiff.service.tables.stiffness import UNITS
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.base import pedestal_campaign
from jointstiff.simulator.elastic_links import beam_arm, elastic_campaign
from jointstiff.simulator.programs import program_text
from jointstiff.solver.errors import RequestError, UnsupportedMethodError
from jointstiff.solver.predict.answers import forward_model

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
    assert (links.model, links.penalty, links.penalty_source) == ("joints_and_links", 1e-3, "given")
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
    for (low, high), value in zip(case.readings_only.displacement, case.displacement, strict=True):
        assert low < value < high
    assert found.model_error_postures == 24
    assert case.with_model_error is not None
    np.testing.assert_allclose(
        np.array(case.compliance.translation_by_force) @ observation["force"], case.displacement, atol=1e-9
    )
    masses = options | {"masses": [{"joint": "joint_2", "mass": 1.0, "centre": [0.0, 0.0, 0.0]}]}
    with pytest.raises(RequestError, match="own weight"):
        predict_by_run(robot, run, DeflectionOptions.model_validate(masses))
    assert forward_model(robot, run.result.model)[0].first_order


def test_a_program_is_compensated_by_links(memory, set_id, given):
    robot = Parts(memory).sets.prepared(set_id).robot
    text = program_text("krl", tool_poses(path(12)), 5)
    result = ProgramWork(robot, "robot", given, request("krl", text)).conclude(())
    assert result.corrected == 12
    assert result.residual.greatest < 1e-6 < 1e-3 < result.deflection.median  # five digits of mm and degrees
    for point in result.worst:
        (low, high), (wide_low, wide_high) = point.interval, point.interval_with_model_error
        assert wide_low <= low < point.deflection < high <= wide_high
    assert any("first order" in remark for remark in result.remarks)
    masses = [{"joint": "joint_2", "mass": 1.0, "centre": [0.0, 0.0, 0.0]}]
    with pytest.raises(RequestError, match="own weight"):
        ProgramWork(robot, "robot", given, request("krl", text, masses=masses))


def test_the_selection_compares_all_models(given):
    selection = given.result.selection
    names = [scored.model for scored in selection.models]
    assert names == ["joints", "coupled_joints", "diagonal_links", "joints_and_links"]
    assert selection.best in names
    assert (selection.chosen, selection.chosen_loss) == ("joints_and_links", "squared")
    assert given.result.links.loss_source == "given"
    for scored in selection.models:
        assert scored.compensation == pytest.approx(np.mean(scored.by_fold))
        assert scored.standard_error == pytest.approx(np.std(scored.by_fold, ddof=1) / np.sqrt(3))
    by_name = {scored.model: scored.compensation for scored in selection.models}
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
            "cross_validation": {"folds": 2, "seed": 1},
        }
    )
    record = jobs.create(request, None)
    assert enqueued == [record.id]
    queued = jobs.current(record.id)
    assert (queued.state, queued.progress.unit) == ("queued", "penalties")
    assert queued.progress.total == 4 * 2 * 7
    worker = Parts(memory).jobs["run"]
    worker.start(record.id)
    work = worker.work(record.id)
    steps = work.steps()
    assert [start for start, _ in steps[1:]] == [stop for _, stop in steps[:-1]]
    computed = {span: pack(work.compute(span)) for span in reversed(steps)}
    worker.conclude(record.id, [computed[span] for span in steps])
    durable = jobs.current(record.id)
    told = []
    work = RUN.compute(Resources(memory), request)
    same = carry_out(new_job(Run, request, work), work, told.append)
    assert durable.state == same.state == "succeeded"
    assert durable.result == same.result
    assert durable.result.links.penalty_source == "cross_validation"
    assert [link.joint for link in durable.result.links.links] == ["joint_2"]
    assert told[-1].done == queued.progress.total
    assert told[-1].activity == "cross-validating"


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"method": "complete_pose"}, "method"),
        ({"resampling": {"size": 5}}, "resampling"),
    ],
)
def test_what_does_not_go_with_links_is_refused_with_its_remedy(memory, set_id, options, where):
    with pytest.raises(UnsupportedMethodError) as refused:
        carried_out(memory, set_id, **options)
    assert refused.value.where == where
    assert refused.value.remedy


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"elasticity": "joints", "links": ["joint_2"]}, "needs an elasticity"),
        ({"link_penalty": 0.1}, "needs an elasticity"),
        ({"elasticity": "coupled_joints", "links": ["joint_2"]}, "needs an elasticity"),
        ({"loss": "absolute"}, "huber"),
        ({"elasticity": "automatic", "loss": "absolute"}, "huber"),
        ({"elasticity": "automatic", "link_penalty": 0.1}, "automatic"),
    ],
)
def test_options_go_with_what_takes_them(options, text):
    with pytest.raises(ValidationError, match=text):
        RunOptions.model_validate(options)


@pytest.mark.slow
def test_automatic_takes_the_simplest_model_that_is_good_enough(memory, set_id):
    parts = Parts(memory)
    rigid = json.loads(json.dumps(simulate_campaign(default_arm(), load="pull", configurations=12, seed=2)))
    rigid_id = set_of(parts, rigid)
    options = {"elasticity": "automatic", "link_penalty": None, "links": ["joint_2"]}
    options["cross_validation"] = {"folds": 2, "draws": 2}
    joints = carried_out(memory, rigid_id, **options).result
    assert joints.links is None
    assert joints.selection is None
    assert (joints.choice.elasticity, joints.choice.loss, joints.choice.source) == (
        "joints",
        "squared",
        "screening",
    )
    assert joints.choice.links_p_value > 3e-3
    assert joints.model is not None
    jobs, worker = parts.jobs["run"], Parts(memory, lambda *_: None).jobs["run"]
    record = worker.create(RunRequest.model_validate({"measurement_set_id": set_id} | options), None)
    jobs.start(record.id)
    work = jobs.work(record.id)
    jobs.conclude(record.id, [pack(work.compute(span)) for span in work.steps()])
    listed = jobs.current(record.id)
    bends = listed.result
    assert listed.elasticity == bends.links.model != "automatic"  # it is listed by what bends
    assert (bends.choice.elasticity, bends.choice.source) == (bends.links.model, "cross_validation")
    assert bends.choice.links_p_value < 1e-5
    assert bends.selection.gain.error < bends.selection.gain.error_of_joints
    plain = carried_out(memory, set_id, elasticity="joints", link_penalty=None).result
    assert bends.choice.plain.joints == plain.joints
    assert bends.choice.plain.rms_residual == plain.rms_residual
    said = {reason.code: reason.message for reason in bends.assessment.reasons}["links_bend_with_joints"]
    assert "held-out postures are predicted to" in said
    assert bends.links.model == bends.selection.simplest != "joints"
    assert bends.links.model_source == "cross_validation"


@pytest.mark.slow
def test_a_pedestal_is_recognised_and_shown(tmp_path):
    """By default: the base comes as a block of its own, and joint 2 without it."""
    path = tmp_path / "pedestal.json"
    path.write_text(json.dumps(pedestal_campaign(default_arm(), 8e6, configurations=24, seed=3)))
    command = ["identify", str(path), "--loss", "squared"]
    printed = terminal(*command, "--json")
    result = Run.model_validate_json(printed.stdout).result
    assert (result.choice.elasticity, result.choice.source) == ("joints_and_base", "cross_validation")
    assert [each.value for each in result.links.base.rotation[:2]] == pytest.approx([1.25e-7] * 2, rel=0.2)
    assert result.joints[1].compliance == pytest.approx(default_arm().compliances[1], rel=0.03)
    assert "the base's rotation" in result.joints[0].reason
    assert [reason.code for reason in result.assessment.reasons] == ["base_bends"]
    shown = terminal(*command, "--details", width=120)
    for text in ("Base below joint 1", "joints and base", "N·m/rad", "µrad/(kN·m)"):
        assert text in shown.stdout
