"""Predictions and plans as jobs, tables and downloads: deflections, maps, lists of postures."""

import csv
import io

import numpy as np
import pypdf
import pytest
from pydantic import ValidationError
from support.api import file_at, post, posted

import jointstiff
from jointstiff import identify
from jointstiff.schemas.deflection import DeflectionRequest, DeflectionResult
from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.plan import MAX_CANDIDATES, Plan, PlanRequest
from jointstiff.schemas.robot import DhRow, RobotDocument
from jointstiff.schemas.run import Campaign
from jointstiff.service.importing.reading import SourceFile
from jointstiff.service.kinds.deflection import load_cases, read_load_cases
from jointstiff.service.kinds.plan import PLAN, readings_sheet
from jointstiff.service.reports.job import job_document
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.reports.rendering import report_page, report_pdf
from jointstiff.service.resources.imports import import_files
from jointstiff.service.tables.files import csv_text
from jointstiff.simulator import TARGETS, default_arm, equilibrium, robot_document, simulate_campaign
from jointstiff.simulator.equilibrium import deflections
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.robot import Robot, dh_chain

ARM = default_arm()
KINDS = dict.fromkeys((f"joint_{j}" for j in range(1, 7)), "revolute")
JOINTS = [10.0, -20.0, 30.0, 5.0, 45.0, 0.0]
FORCE = [200.0, 300.0, -800.0]
POINT = [0.0, 0.0, 0.12]
HEADER = "label,J1 [deg],J2 [deg],J3 [deg],J4 [deg],J5 [deg],J6 [deg],Fx [N],Fy [N],Fz [N]"
TABLE = f"{HEADER}\ndrill,{','.join(map(str, JOINTS + FORCE))}\n"


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
    assert (result.model_error_postures, result.postures_needed) == (24, 19)
    assert np.linalg.norm(case.displacement - truth()) <= case.with_model_error.radius
    for k in range(3):
        low, high = case.readings_only.displacement[k]
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
    parts = {part["source"]: part for part in case["budget"]["components"]}
    assert parts["force_scale"]["contribution"] == pytest.approx(0.05 * np.linalg.norm(truth()), rel=0.02)
    assert parts["model_error"]["contribution"] * case["budget"]["coverage_factor"] == pytest.approx(
        case["with_model_error"]["radius"]
    )
    included = [part["contribution"] for part in parts.values() if part["included"]]
    assert case["budget"]["standard_uncertainty"] == pytest.approx(np.linalg.norm(included))
    assert case["budget"]["expanded_uncertainty"] == pytest.approx(1.959964 * np.linalg.norm(included))


@pytest.mark.parametrize(("factor", "said"), [(1471.0 / 1470.9975, False), (1.009, False), (1.02, True)])
def test_a_load_as_great_as_the_greatest_is_not_extrapolated(client, factor, said):
    """1471 N beside 150 kg, which weigh 1470.9975 N, is the same load; 2 % more is another."""
    campaign = simulate_campaign(ARM, load="dead_weight", configurations=24, seed=1)
    run_id = posted(client, campaign, complementary_stiffness="included")["id"]
    first = campaign["measurement_set"]["observations"][0]
    units = campaign["measurement_set"]["units"]
    greatest = max(
        (each["force"] for each in campaign["measurement_set"]["observations"]), key=np.linalg.norm
    )
    case = {"joints": first["joints"], "force": (factor * np.array(greatest)).tolist()}
    point = campaign["measurement_set"]["load_point"]
    asked = {"run_id": run_id, "units": units, "load_point": point, "cases": [case]}
    answer = post(client, "/v1/deflections", asked, status=200)
    (found,) = answer["cases"]
    assert found["with_model_error"]["load_ratio"] == pytest.approx(factor, rel=1e-9)
    assert any("the load is" in remark for remark in found["remarks"]) == said
    assert not any("is 1 times" in remark for remark in found["remarks"])
    beyond = [each for each in answer["assessment"]["reasons"] if each["code"] == "beyond_campaign"]
    assert bool(beyond) == said


def test_cases_are_bounded_by_the_joints():
    robot = Robot(dh_chain(32 * [DhRow(a=0.1, alpha=0.0, d=0.0, theta=0.0)], "standard", "snake"))
    case = {"joints": 32 * [0.0], "force": FORCE}
    largest, larger = (
        DeflectionRequest.model_validate(request("any", cases=count * [case])) for count in (146, 147)
    )
    assert len(load_cases(largest, robot).joints) == 146
    with pytest.raises(RequestError, match="147 cases for 32 joints") as caught:
        load_cases(larger, robot)
    assert caught.value.where == "cases"
    assert "at most 146" in caught.value.remedy


def test_options_and_cells_each_have_their_units(tmp_path):
    """Cells those of their headers, options those of `units`, which SI completes."""
    masses = [{"joint": "joint_3", "mass": 10.0, "centre": (300, 0, 0)}]
    campaign = Campaign.model_validate(simulate_campaign(ARM, load="pull", configurations=24, seed=1))
    columns = (
        ",".join(f"place {axis} [m]" for axis in "xyz") + "," + ",".join(f"M{axis} [N.m]" for axis in "xyz")
    )
    table = tmp_path / "table.csv"
    cells = TABLE.replace("Fz [N]\n", f"Fz [N],{columns}\n").replace("-800.0\n", "-800.0,0,0,0.2,0,1,0\n")
    table.write_text(cells)
    stated, si = (
        jointstiff.predict(campaign, table, **options)
        for options in (
            {
                "load_point": (0, 0, 120),
                "masses": masses,
                "units": {"length": "mm", "angle": "deg", "force": "kN", "moment": "N.mm"},
            },
            {"load_point": (0, 0, 0.12), "masses": [masses[0] | {"centre": (0.3, 0, 0)}]},
        )
    )
    for case, other in zip(stated.cases, si.cases, strict=True):
        np.testing.assert_allclose(case.displacement, other.displacement, rtol=1e-12)
    short = read_load_cases(f"{cells}\n\n", KINDS, load_point=(0, 0, 120), units={"length": "mm"})
    assert short.units == Units(length="mm", angle="rad", force="N", moment="N.m")
    assert short.cases[0].place == (0.0, 0.0, 200.0)
    assert read_load_cases(cells, KINDS, units=short.units).units == short.units


CAMPAIGN = simulate_campaign(default_arm(), configurations=20, load="pull", seed=2)
AREA = {
    "area": [[1.2, -0.6, 0.4], [2.0, 0.6, 0.9]],
    "grid": [3, 3, 2],
    "place": [0.0, 0.0, 0.25],
    "turns": 2,
    "force": [0.0, 500.0, -800.0],
}


@pytest.fixture(scope="module")
def run_id(local):
    return posted(local, CAMPAIGN, method="partial_pose")["id"]


def test_npz_has_the_same_numbers(local, run_id):
    made = post(local, "/v1/maps", AREA | {"run_id": run_id, "name": "plate"})
    answer = local.get(file_at(made, "map.npz"))
    with np.load(io.BytesIO(answer.content), allow_pickle=False) as found:
        headers, table, status = list(found["headers"]), found["table"], found["status"]
        assert set(found["overall verdict"]) == {made["result"]["assessment"]["verdict"]}
    rows = list(csv.DictReader(io.StringIO(local.get(file_at(made, "map.csv")).text)))
    assert ["status", *headers, "overall verdict"] == list(rows[0])
    assert status.tolist() == [row["status"] for row in rows]
    for row, numbers in zip(rows, table, strict=True):
        read = [float(row[header] or "nan") for header in headers]
        np.testing.assert_allclose(read, numbers, rtol=1e-9)
    assert table[1, 2] != table[0, 2]  # z runs fastest


@pytest.mark.slow
def test_a_run_of_elastic_links_maps_as_it_predicts(local, run_id):
    asked = local.get(f"/v1/runs/{run_id}").json()["request"]["measurement_set_id"]
    options = {"measurement_set_id": asked, "elasticity": "joints_and_links", "link_penalty": 1e-3}
    elastic = post(local, "/v1/runs", options)["id"]
    made = post(local, "/v1/maps", AREA | {"run_id": elastic})
    assert "first order" in made["result"]["remarks"][0]
    worst = made["result"]["worst"]
    cases = [{"joints": worst["joints"], "force": AREA["force"]}]
    units = {"length": "m", "angle": "rad", "force": "N"}
    stated = {"run_id": elastic, "units": units, "load_point": AREA["place"], "cases": cases}
    case = local.request("POST", "/v1/deflections", json=stated).json()["cases"][0]
    assert worst["displacement"] == pytest.approx(case["displacement"], rel=1e-9)
    assert worst["compliance_along"] == pytest.approx(case["compliance"]["along"]["compliance"])
    radius = worst["with_model_error"][1] - worst["deflection"]
    assert radius == pytest.approx(case["with_model_error"]["radius"], rel=1e-6)
    low, high = worst["readings_only"]
    assert low < worst["deflection"] < high < worst["with_model_error"][1]


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
    answer = import_files([file], ImportRequest(encoders="motor"))
    assert answer.missing == []
    held_out = [each.label for each in plan.result.readings if each.validation]
    assert answer.leave_out == held_out != []
    assert f"held out from the fit, to judge it: {', '.join(held_out)}" in answer.preview.assumptions
    campaign = {"robot": robot_document(default_arm()), "measurement_set": answer.measurement_set}
    campaign["measurement_set"] = answer.measurement_set.model_dump(mode="json", exclude_unset=True)
    run = identify(campaign | {"run": {"leave_out": answer.leave_out}}, elasticity="joints")
    assert run.request.leave_out == held_out
    assert not {each.observation for each in run.result.residuals} & set(held_out)
    truth = dict(zip(default_arm().joint_names, default_arm().stiffnesses, strict=True))
    for joint in run.result.joints[1:]:
        low, high = joint.stiffness_interval
        assert 0.9 * low < truth[joint.name] < 1.1 * (high or np.inf)


def test_on_paper_each_posture_has_its_row(parts, robot):
    load = {"kind": "cable", "force": 500.0, "anchors": [[3.0, 0.0, 0.0], [0.0, 3.0, 0.5]]}
    plan = plan_of(parts, robot_id=robot, **BEGIN | {"load": load})
    assert plan.state == "succeeded", plan.error
    report = job_document(PLAN, plan, plan.model_dump_json(), LaboratorySettings())
    page = report_page(report).decode()
    for words in (
        "joint_1 [°]",
        "force [N]",
        "to anchor 1, 3000, 0, 0 mm",
        "to anchor 2, 0, 3000, 500 mm",
        "[   ]",
    ):
        assert words in page
    assert all(f">{each.label}<" in page for each in plan.result.readings)
    assert len(pypdf.PdfReader(io.BytesIO(report_pdf(report))).pages) > 0


class TestPlans:
    def test_what_is_known_beforehand_counts(self, parts, robot):
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

    @pytest.mark.parametrize(
        ("changes", "where", "message"),
        [
            ({"load": None}, "load", "loads are missing"),
            ({"targets": {}}, "targets", "positions of the targets"),
            ({"joints": ["joint_9"]}, "joints", "no joint 'joint_9'"),
            ({"stiffness": {"joint_9": 1e6}}, "stiffness.joint_9", "no joint"),
            (
                {"priors": {"joint_9": {"stiffness": 1e6, "standard_uncertainty": 1e4}}},
                "priors.joint_9",
                "no joint",
            ),
            ({"readings": 1, "targets": {"P1": [0.1, 0.0, 0.0]}}, "readings", "do not determine 6 joints"),
            (
                {"load": {"kind": "dead_weight", "force": 900.0}, "joints": ["joint_1", "joint_2"]},
                "joints",
                "twists joint_1",
            ),
            ({"surroundings": {"floor": 20.0}}, "candidates", "none of 300 readings is feasible"),
            ({"readings": 200, "distinct_angle": 3.0}, "distinct_angle", "are in postures"),
            ({"postures": [[0.0, 1.0]]}, "postures[0]", "2 joint angles"),
            ({"load_point": [0, 0, 120.0]}, "load_point", "120 m from the flange"),
            ({"surroundings": {"facing": {"P10": [0, 0, 0]}}}, "surroundings.facing", "facing"),
            ({"criterion": "work_area"}, "work_area", "needs a work area"),
        ],
    )
    def test_refused_with_place_and_remedy(self, parts, robot, changes, where, message):
        with pytest.raises(RequestError, match=message) as refused:
            plan_of(parts, robot_id=robot, **(BEGIN | changes))
        assert refused.value.where == where
        assert refused.value.remedy

    def test_too_many_candidates_are_refused_before_any_work(self):
        with pytest.raises(ValidationError, match=str(MAX_CANDIDATES)):
            PlanRequest(robot_id="r", candidates=10_000_000)


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


def test_a_goal_that_no_plan_meets_is_refused(parts, robot):
    options = BEGIN | {"robot_id": robot, "candidates": 400, "goal": {"kind": "joints", "relative": 0.001}}
    options.pop("readings", None)
    with pytest.raises(RequestError, match="times the uncertainty of the goal"):
        plan_of(parts, **options)


def test_each_block_of_four_is_a_good_plan_by_itself(parts, robot):
    """Of each block's postures alone the uncertainty is near that of the whole list, as the root has it."""
    options = BEGIN | {"robot_id": robot, "candidates": 400}
    options["stiffness"] = {f"joint_{j}": k for j, k in enumerate(default_arm().stiffnesses.tolist(), 1)}
    whole = plan_of(parts, **options | {"readings": 20, "validation": 0.2}).result
    blocks = [each.block for each in whole.readings]
    assert blocks == sorted(blocks)
    assert max(blocks) == 4

    def mean(result):
        return np.sqrt(np.mean([joint.relative**2 for joint in result.joints]))

    for block in range(1, 5):
        own = [each for each in whole.readings if each.block == block]
        assert [each.validation for each in own].count(False) == 4
        postures = [each.joints for each in own if not each.validation]
        alone = plan_of(parts, **options | {"readings": 4, "validation": 0.0, "postures": postures}).result
        assert mean(alone) <= 1.5 * 2.0 * mean(whole)
