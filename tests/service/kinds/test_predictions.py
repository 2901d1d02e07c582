"""Predictions and plans, beside exact springs: deflections, budgets, lists of postures."""

import csv
import io

import numpy as np
import pytest
from support.api import post, posted

from jointstiff import identify
from jointstiff.schemas.deflection import DeflectionResult
from jointstiff.schemas.imports import ImportRequest, Mapping
from jointstiff.schemas.plan import Plan, PlanRequest, Surroundings
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.imports.answer import import_files
from jointstiff.service.imports.formats import SourceFile
from jointstiff.service.kinds.plan.kind import _readings_table, readings_sheet
from jointstiff.service.kinds.plan.work import _order_reflector_directions
from jointstiff.service.tables.files import csv_text
from jointstiff.simulator import TARGETS, default_arm, equilibrium, robot_document, simulate_campaign
from jointstiff.simulator.equilibrium import deflections
from jointstiff.solver.errors import RequestError

ARM = default_arm()
JOINTS = [10.0, -20.0, 30.0, 5.0, 45.0, 0.0]
FORCE = [200.0, 300.0, -800.0]
POINT = [0.0, 0.0, 0.12]


def request(run_id, **changes):
    units = {"length": "mm", "angle": "deg", "force": "N"}
    case = {"label": "drill", "joints": JOINTS, "force": FORCE}
    return {"run_id": run_id, "units": units, "load_point": [0, 0, 120.0], "cases": [case]} | changes


def truth():
    q = np.radians(JOINTS)
    loaded = q + equilibrium(ARM, q, FORCE, np.zeros(3), POINT)
    before, after = (ARM.posture(angles).point_to_base(POINT) for angles in (q, loaded))
    return after - before


def test_the_answer_holds_the_truth(client):
    campaign = simulate_campaign(ARM, load="pull", configurations=24, seed=1)
    asked = request(posted(client, campaign, complementary_stiffness="included")["id"], confidence=0.95)
    answer = post(client, "/v1/deflections", asked, status=200)
    result = DeflectionResult.model_validate(answer)
    (case,) = result.cases
    assert result.model_error_postures == 24
    assert np.linalg.norm(case.displacement - truth()) <= case.with_model_error.radius
    for k in range(3):
        low, high = case.readings_only[k]
        assert low < case.displacement[k] < high
        wide = case.with_model_error.displacement[k]
        assert wide[0] <= low
        assert high <= wide[1]
    assert case.compliance.along.lateral_free <= case.compliance.along.lateral_blocked
    assert case.compliance.symmetric
    assert result.remarks == ["own weight is not included, because no masses are given"]
    again = post(client, "/v1/deflections", asked, status=200)
    assert again == answer


def test_the_budget_of_a_displacement_adds_up_and_carries_the_force(client):
    """An error of the force's scale moves every compliance, and so the displacement, in proportion."""
    campaign = simulate_campaign(ARM, load="pull", configurations=24, seed=1)
    campaign["measurement_set"]["noise"]["force"] = {"scale": 0.05}
    run_id = posted(client, campaign)["id"]
    (case,) = post(client, "/v1/deflections", request(run_id), status=200)["cases"]
    parts = case["budget"]["contributions"]
    assert parts["force_scale"] == pytest.approx(0.05 * np.linalg.norm(truth()), rel=0.02)
    assert parts["model_error"] * case["budget"]["coverage_factor"] == pytest.approx(
        case["with_model_error"]["radius"]
    )
    included = [size for source, size in parts.items() if source != "model_error"]
    assert case["budget"]["standard_uncertainty"] == pytest.approx(np.linalg.norm(included))
    assert case["budget"]["expanded_uncertainty"] == pytest.approx(1.959964 * np.linalg.norm(included))


BEGIN = {
    "readings": 10,
    "candidates": 300,
    "load_point": [-0.06, 0.02, 0.18],
    "load": {"kind": "any_direction", "force": 1500.0},
    "targets": {name: list(place) for name, place in TARGETS.items()},
}


@pytest.fixture(scope="module")
def robot(parts):
    return parts.robots.create(RobotDocument.model_validate(robot_document(default_arm())), None).id


def plan_of(parts, **options) -> Plan:
    record = parts.jobs["plan"].create(PlanRequest.model_validate(options), None)
    return Plan.model_validate_json(record.document)


def test_the_list_is_filled_in_and_dropped_back(parts, robot):
    """A weight and all joints, as the form has it: joint_1 is left out, and the CSV is imported."""
    load = {"kind": "dead_weight", "force": 900.0}
    plan = plan_of(parts, robot_id=robot, **BEGIN | {"load": load, "readings": 12})
    assert plan.state == "succeeded", plan.error
    assert plan.result.left_out == ["joint_1"]
    rows = list(csv.DictReader(io.StringIO(csv_text(readings_sheet(plan)))))
    columns = [name for name in rows[0] if "loaded" in name]
    assert len(columns) == 18
    assert all(row[name] == "" for row in rows for name in columns)
    joints = np.radians([[float(row[f"joint_{j} [deg]"]) for j in range(1, 7)] for row in rows])
    force = np.array([[float(row[f"F{axis} [N]"]) for axis in "xyz"] for row in rows])
    points = np.broadcast_to(np.array(BEGIN["load_point"]), force.shape)
    places = np.array(list(TARGETS.values()))
    exact = np.stack(deflections(default_arm(), joints, force, np.zeros_like(force), points, places))
    read = exact + 1e-5 * np.random.default_rng(0).standard_normal(exact.shape)
    for i, row in enumerate(rows):
        for t, target in enumerate(TARGETS):
            for state, name in enumerate(("unloaded", "loaded")):
                for x, axis in enumerate("xyz"):
                    row[f"{target} {name} {axis} [mm]"] = f"{1e3 * read[state][i, t, x]:.4f}"
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0])
    writer.writeheader()
    writer.writerows(rows)
    file = SourceFile("readings.csv", text.getvalue().encode())
    answer = import_files([file], ImportRequest(mapping=Mapping(encoders="motor")), None)
    assert answer.questions == []
    held_out = [each.label for each in plan.result.readings if each.held_out]
    assert [row["label"] for row in rows if row["label"].startswith("v")] == held_out != []
    campaign = {"robot": robot_document(default_arm()), "measurement_set": answer.measurement_set}
    campaign["measurement_set"] = answer.measurement_set.model_dump(mode="json", exclude_unset=True)
    run = identify(campaign | {"run": {"leave_out": held_out}}, elasticity="joints")
    assert run.request.leave_out == held_out
    assert not {each.observation for each in run.result.residuals} & set(held_out)
    truth = dict(zip(default_arm().joint_names, default_arm().stiffnesses, strict=True))
    for joint in run.result.joints[1:]:
        low, high = joint.stiffness_interval
        assert 0.9 * low < truth[joint.name] < 1.1 * (high or np.inf)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("goal", "changes"),
    [
        ({"kind": "joints", "relative": 0.02}, {}),
        ({"kind": "deflection", "uncertainty": 3e-5}, {"work_area": ((0.8, -0.6, 0.4), (1.9, 0.6, 1.6))}),
    ],
)
def test_a_goal_gives_the_least_list_that_meets_it(parts, robot, goal, changes):
    """One reading less leaves more uncertainty than the goal, by the uncertainties that plans promise."""
    options = BEGIN | changes | {"robot_id": robot, "candidates": 200, "validation": 0.0}
    options["stiffness"] = {f"joint_{j}": k for j, k in enumerate(default_arm().stiffnesses.tolist(), 1)}
    options.pop("readings", None)

    def uncertainty(result):
        if goal["kind"] == "deflection":
            return 1.96 * result.deflection_uncertainty / goal["uncertainty"]
        return 1.96 * max(joint.relative for joint in result.joints) / goal["relative"]

    plan = plan_of(parts, **options, goal=goal)
    assert plan.state == "succeeded", plan.error
    assert uncertainty(plan.result) <= 1.001
    assert plan.result.goal_share == pytest.approx(uncertainty(plan.result), rel=1e-4)
    fewer = plan_of(parts, **options, readings=len(plan.result.readings) - 1)
    assert fewer.result is None or uncertainty(fewer.result) > 1.0


def test_each_block_of_four_is_a_good_plan_by_itself(parts, robot):
    """Of each block's postures alone the uncertainty is near that of the whole list, as the root has it."""
    options = BEGIN | {"robot_id": robot, "candidates": 400}
    options["stiffness"] = {f"joint_{j}": k for j, k in enumerate(default_arm().stiffnesses.tolist(), 1)}
    plan = plan_of(parts, **options | {"readings": 20, "validation": 0.2})
    whole = plan.result
    blocks = [each.block for each in whole.readings]
    assert ["block", list(map(str, blocks))] in [
        [each.name, each.values] for each in _readings_table(plan, whole, has_tick_boxes=False).columns
    ]
    assert blocks == sorted(blocks)
    assert max(blocks) == 4

    def mean(result):
        return np.sqrt(np.mean([joint.relative**2 for joint in result.joints]))

    for block in range(1, 5):
        own = [each for each in whole.readings if each.block == block]
        assert [each.held_out for each in own].count(False) == 4
        postures = [each.joints for each in own if not each.held_out]
        alone = plan_of(parts, **options | {"readings": 4, "validation": 0.0, "postures": postures}).result
        assert mean(alone) <= 1.5 * 2.0 * mean(whole)


def test_what_is_known_beforehand_counts(parts, robot):
    """Independent information adds: 1/u² of the plan is at least that of the prior and of the list."""
    prior = {"joint_4": {"stiffness": 5e5, "standard_uncertainty": 5e3}}
    with_prior, without = (
        plan_of(parts, robot_id=robot, **BEGIN, priors=each).result for each in (prior, {})
    )
    known = 5e3 / 5e5**2
    joint = with_prior.joints[3]
    assert joint.before == pytest.approx(known)  # though no reading is there
    assert joint.standard_uncertainty <= known
    assert joint.standard_uncertainty < without.joints[3].standard_uncertainty
    assert joint.relative == pytest.approx(joint.standard_uncertainty * 5e5)


@pytest.mark.parametrize("second", [{}, {"P11": (0.0, 0.0, 0.0)}, {"P12": (0.0, 0.0, 1.0)}])
def test_each_target_faces_somewhere_or_none_does(second):
    facing = Surroundings.model_construct(facing={"P10": (0.0, 0.0, 1.0)} | second)
    with pytest.raises(RequestError, match="`facing` has directions for P10"):
        _order_reflector_directions(facing, ("P10", "P11"))
