"""Requests of runs, plans, predictions and frames that cannot be carried out: place, reason and remedy."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.cases import campaign as recorded
from support.documents import campaign, changed, own_weight
from support.kinds import posted_job
from support.refusals import refused, told

import jointstiff as js
from jointstiff.schemas.deflection import DeflectionRequest
from jointstiff.schemas.robot import DhRow
from jointstiff.service.runs.deflection import convert_load_cases, read_load_cases
from jointstiff.simulator import TARGETS, default_arm, robot_document
from jointstiff.solver.mechanics.chain import chain_dh_rows
from jointstiff.solver.mechanics.robot import Robot

ROWS = Path(__file__).with_name("refused_requests.txt").read_text(encoding="utf-8").splitlines()
BENT = {"elasticity": "joints_and_links", "link_penalty": 1e-3, "loss": "squared"}
FOLDS = {"cross_validation": {"folds": 2, "draws": 1}}


@pytest.fixture(scope="module")
def robot_id(local):
    return local.request("POST", "/v1/robots", json=robot_document(default_arm())).json()["id"]


@pytest.fixture(scope="module")
def begin(robot_id):
    """A plan of the first readings of a robot."""
    return {
        "robot_id": robot_id,
        "readings": 10,
        "candidates": 300,
        "load_point": [-0.06, 0.02, 0.18],
        "load": {"kind": "any_direction", "force": 1500.0},
        "targets": {name: list(map(float, place)) for name, place in TARGETS.items()},
    }


@pytest.fixture(scope="module")
def bodies(local, robot_id, begin, run):
    """What is posted for each word: where, the body, and the place in it that the parts of a row change."""
    pull, own, swept = campaign(seed=3), own_weight(24, 1), recorded("sweeps_small")
    set_id = run["request"]["measurement_set_id"]
    return {
        "plan": ("/v1/plans", begin, ""),
        "links": ("/v1/runs", {"measurement_set_id": set_id} | BENT | FOLDS, ""),
        "run": ("/v1/campaigns", pull | {"run": {"elasticity": "joints"}}, "run."),
        "noise": ("/v1/campaigns", changed(pull, ("measurement_set.noise", {})), "measurement_set.noise."),
        "frame": (
            "/v1/measurement-sets",
            pull["measurement_set"] | {"robot_id": robot_id, "frame": {}},
            "frame.",
        ),
        "weight": ("/v1/campaigns", own | {"run": {}}, "run."),
        "own": ("/v1/campaigns", own, ""),
        "geometry": ("/v1/geometries", swept, ""),
    }


@pytest.fixture(scope="module")
def geometry_id(local):
    return local.request("POST", "/v1/geometries", json=recorded("sweeps_small")).json()["id"]


@pytest.mark.parametrize("row", ROWS)
def test_a_request_that_cannot_be_carried_out_says_where_and_why(local, bodies, geometry_id, row):
    asked, said = row.split(" -> ")
    word, change = asked.split(" ", 1)
    address, body, place = bodies[word]
    change = json.loads(change.replace("STORED", geometry_id))
    body = changed(body, *((f"{place}{path}", value) for path, value in change.items()))
    assert told(local.request("POST", address, json=body)) == f"422 | {said}"


def test_a_plan_by_cables_says_so_on_paper_and_counts_what_is_known(local, begin):
    cables = {"kind": "cable", "force": 500.0, "anchors": [[3.0, 0.0, 0.0], [0.0, 3.0, 0.5]]}
    plan = local.request("POST", "/v1/plans", json=begin | {"load": cables}).json()
    report = local.get(f"/v1/jobs/{plan['id']}/files/report.html").text
    assert "anchors" in report
    assert "cable" in report
    assert local.get(f"/v1/jobs/{plan['id']}/files/report.pdf").content[:4] == b"%PDF"
    prior = {"joint_4": {"stiffness": 5e5, "standard_uncertainty": 5e3}}
    known, unknown = (
        local.request("POST", "/v1/plans", json=begin | {"priors": each}).json()["result"]["joints"][3]
        for each in (prior, {})
    )
    numbers = {
        "standard_uncertainty": 1.9981e-8,
        "relative": 0.0099903,
        "before": 2e-8,
        "random": 1.9348e-8,
        "one_at_a_time": 1.9974e-8,
    }
    assert {name: known[name] for name in numbers} == pytest.approx(numbers, rel=1e-3)
    assert (unknown["relative"], unknown["before"]) == (None, None)
    assert unknown["standard_uncertainty"] == pytest.approx(5.7188e-8, rel=1e-3)
    assert unknown["random"] == pytest.approx(8.6624e-8, rel=1e-3)


class TestPredictions:
    def test_a_load_as_great_as_the_greatest_is_not_extrapolated(self, local):
        hung = campaign("dead_weight", 24, 1)
        options = {"complementary_stiffness": "included"}
        run = local.request("POST", "/v1/campaigns", json=hung | {"run": options}).json()
        measured = hung["measurement_set"]
        greatest = max((each["force"] for each in measured["observations"]), key=np.linalg.norm)
        answers = []
        for factor in (1471.0 / 1470.9975, 1.009, 1.02):
            force = (factor * np.array(greatest)).tolist()
            asked = {
                "run_id": run["id"],
                "units": measured["units"],
                "load_point": measured["load_point"],
                "cases": [{"joints": measured["observations"][0]["joints"], "force": force}],
            }
            found = local.request("POST", "/v1/deflections", json=asked).json()
            (case,) = found["cases"]
            codes = [reason["code"] for reason in found["assessment"]["reasons"]]
            answers.append((case["with_model_error"]["load_ratio"], case["remarks"], codes))
        said = "extrapolated: the load is 1.02 times the greatest measured load"
        ratios = [ratio for ratio, *_ in answers]
        assert ratios == pytest.approx([1.0, 1.009, 1.02], rel=1e-5)
        assert [others for _, *others in answers] == [[[], []], [[], []], [[said], ["beyond_campaign"]]]

    @pytest.mark.parametrize("load", ["pull", "dead_weight"])
    def test_no_measured_posture_under_its_own_load_is_extrapolated(self, load):
        measured = campaign(load, 24, 1)
        stated = measured["measurement_set"]
        answer = js.identify(measured).predict(
            [each["joints"] for each in stated["observations"]],
            [each["force"] for each in stated["observations"]],
            load_point=stated["load_point"],
            units=stated["units"],
        )
        assert [case.remarks for case in answer.cases] == [[]] * 24
        ratios = [case.with_model_error.leverage_ratio for case in answer.cases]
        assert max(ratios) == pytest.approx(1.0)
        assert "beyond_campaign" not in [reason.code for reason in answer.assessment.reasons]

    def test_cases_are_at_most_what_can_be_computed_at_once(self):
        joints = 32 * [DhRow(a=0.1, alpha=0.0, d=0.0, theta=0.0)]
        snake = Robot(chain_dh_rows(joints, "standard", "snake").model())

        def asked(count):
            case = {"joints": 32 * [0.0], "force": [200.0, 300.0, -800.0]}
            units = {"length": "mm", "angle": "deg", "force": "N"}
            of_run = {"run_id": "any", "units": units, "load_point": [0, 0, 120.0]}
            return convert_load_cases(
                DeflectionRequest.model_validate(of_run | {"cases": count * [case]}), snake
            )

        assert len(asked(146).joints) == 146
        assert refused(asked, 147) == (
            "cases | 147 cases for 32 joints are too many: cases × joints² may be at most 150,000 | send at "
            "most 146 cases in a request"
        )

    def test_cells_of_a_table_are_in_the_units_of_its_head_and_options_in_their_own(self, tmp_path):
        head = ["label", *(f"J{j} [deg]" for j in range(1, 7)), "Fx [N],Fy [N],Fz [N]"]
        head += [*(f"place {axis} [m]" for axis in "xyz"), *(f"M{axis} [N.m]" for axis in "xyz")]
        table = f"{','.join(head)}\ndrill,10,-20,30,5,45,0,200,300,-800,0,0,0.2,0,1,0\n"
        file = tmp_path / "places.csv"
        file.write_text(table)
        known, mass = js.identify(campaign("pull", 24, 1)), {"joint": "joint_3", "mass": 10.0}
        stated = known.predict(
            file,
            load_point=(0, 0, 120),
            masses=[mass | {"centre": (300, 0, 0)}],
            units={"length": "mm", "angle": "deg", "force": "kN", "moment": "N.mm"},
        )
        in_si = known.predict(
            file, load_point=(0, 0, 0.12), masses=[mass | {"centre": (0.3, 0, 0)}], units="m, rad, N"
        )
        place = [-0.000212208, 0.000163752, -0.00117863]
        assert in_si.cases[0].displacement == pytest.approx(place, rel=1e-3)
        assert stated.cases[0].displacement == pytest.approx(in_si.cases[0].displacement, rel=1e-12)
        revolute = dict.fromkeys(default_arm().joint_names, "revolute")
        millimetres = {"length": "mm"}
        short = read_load_cases(f"{table}\n\n", revolute, load_point=(0, 0, 120), units=millimetres)
        assert str(short.units) == "length='mm' angle='rad' force='N' moment='N.m'"
        assert short.cases[0].place == (0.0, 0.0, 200.0)
        assert read_load_cases(table, revolute, units=short.units).units == short.units


@pytest.fixture(scope="module")
def run(local):
    """A run with elastic links."""
    body = recorded("beam_small") | {"run": BENT | FOLDS}
    return local.request("POST", "/v1/campaigns", json=body).json()


MASSES = [{"joint": "joint_2", "mass": 1.0, "centre": [0.0, 0.0, 0.0]}]


def no_own_weight(run):
    return (
        f"422 | masses | run '{run['id']}' has elastic links or coupling, so own weight cannot be added | "
        "omit masses, or choose a run with elasticity joints"
    )


class TestElasticLinks:
    def test_tables_have_the_share_of_each_element_and_the_models_that_were_compared(self, local, run):
        address = f"/v1/jobs/{run['id']}/files/tables.json"
        tables = local.get(address, params={"details": "true"}).json()["tables"]
        (elements,) = (each["rows"] for each in tables if "element" in each["head"])
        assert elements[:2] == [
            ["joint_1", "25.8 %", "4.6 %", "52.8 %"],
            ["joint_2", "29.3 %", "3.0 %", "59.8 %"],
        ]
        assert elements[8] == ["link behind joint_3", "11.9 %", "4.4 %", "24.2 %"]
        assert elements[12] == ["unexplained", "0.6 %", "—", "—"]
        (models,) = (each for each in tables if "model" in each["head"][:1])
        assert models["head"] == ["model", "loss", "compensation [%]", "95 % interval", "penalty", ""]
        best = "simplest within one standard error, best"
        assert models["rows"] == [
            ["joints", "squared", "87.6", "85.1 … 90.1", "—", ""],
            ["coupled joints", "squared", "79.3", "75.9 … 82.7", "0.001", ""],
            ["diagonal links", "squared", "98.24", "98.00 … 98.47", "0.001", best],
            ["joints and links", "squared", "97.040", "96.975 … 97.104", "0.001", "this run"],
        ]

    def test_a_prediction_says_that_it_is_linear_and_how_many_postures_it_rests_on(self, local, run):
        asked = {
            "run_id": run["id"],
            "units": {"length": "m", "angle": "rad", "force": "N"},
            "load_point": [0.0, 0.0, 0.12],
            "cases": [{"joints": [0.3, -0.4, 0.5, 0.2, 0.6, -0.1], "force": [200.0, 100.0, -400.0]}],
        }
        found = local.request("POST", "/v1/deflections", json=asked).json()
        assert (found["assessment"]["verdict"], found["model_error_postures"]) == ("use_with_care", 12)
        assert found["assessment"]["headline"] == "Use this prediction with care: 1 reason of its run"
        assert found["remarks"] == [
            "the predictions are to first order in the load: links and joints bend linearly, own "
            "weight and complementary stiffness are left out",
            "no bound of the model error at 95 %: 19 postures are needed, but the campaign has only 12",
        ]
        (case,) = found["cases"]
        assert case["displacement"] == pytest.approx([1.05572e-4, 0.000129634, -0.000978943], rel=1e-3)
        assert case["rotation"][:2] == pytest.approx([-0.00022084, 0.00089771], rel=1e-3)
        intervals = [[6.4059e-5, 0.000147084], [9.1606e-5, 0.000167662], [-0.00102824, -0.000929645]]
        for interval, expected in zip(case["readings_only"], intervals, strict=True):
            assert interval == pytest.approx(expected, rel=1e-3)
        assert (case["with_model_error"], case["budget"]) == (None, None)
        along, worst = case["compliance"]["along"], case["compliance"]["worst"]
        assert along["compliance"] == pytest.approx(2.02693e-6, rel=1e-3)
        assert along["lateral_free"] == pytest.approx(4.93357e5, rel=1e-3)
        assert along["lateral_blocked"] == pytest.approx(6.82973e5, rel=1e-3)
        assert along["rotation_blocked"] == pytest.approx(8.2325e5, rel=1e-3)
        assert worst["compliance"] == pytest.approx(2.46047e-6, rel=1e-3)
        answer = local.request("POST", "/v1/deflections", json=asked | {"masses": MASSES})
        assert told(answer) == no_own_weight(run)

    def test_a_program_is_corrected_by_links_without_own_weight(self, local, run):
        accepted = {"accept_verdict": "do_not_use"}
        made = posted_job(local, "correction", run, **accepted).json()["result"]["program"]
        counts = {"points": 3, "moves": 3, "moves_left": 0, "corrected": 3, "capped": 0}
        assert {name: made[name] for name in counts} == counts
        deflection = {"median": 0.00340861, "p95": 0.00430067, "greatest": 0.00439979}
        correction = {"median": 0.00341509, "p95": 0.00431046, "greatest": 0.00440994}
        assert made["deflection"] == pytest.approx(deflection, rel=1e-3)
        assert made["correction"] == pytest.approx(correction, rel=1e-3)
        assert 0.0 < made["residual"]["greatest"] < 1e-7
        worst = [(each["number"], each["line"], each["share"]) for each in made["worst"]]
        assert worst == [(1, 7, 1.0), (3, 9, 1.0), (2, 8, 1.0)]
        assert made["worst"][0]["place"] == pytest.approx([1.8096, 0.26928, 1.4897], rel=1e-3)
        assert made["worst"][0]["interval"] == pytest.approx([0.00426244, 0.00453714], rel=1e-3)
        assert made["worst"][0]["standard_uncertainty"] == pytest.approx(7.00785e-5, rel=1e-3)
        assert told(posted_job(local, "correction", run, **accepted, masses=MASSES)) == no_own_weight(run)


def test_deflections_of_another_unit_are_no_measurement():
    wrong = campaign("pull", 19, 2)
    for observation in wrong["measurement_set"]["observations"]:
        for reading in observation["readings"]:
            moved = np.subtract(reading["loaded"], reading["unloaded"])
            reading["loaded"] = (reading["unloaded"] + 1e3 * moved).tolist()
    found = js.identify(wrong, elasticity="joints").result.assessment
    assert found.verdict == "do_not_use"
    assert [(reason.code, reason.action) for reason in found.reasons] == [
        ("deflection_implausibly_large", None),
        ("targets_not_rigid", None),
        *[("stiffness_implausible", None)] * 3,
        ("sigma_suspect", None),
        ("complementary_stiffness_matters", None),
    ]
    messages = [reason.message for reason in found.reasons]
    others = ", ".join(f"'c{number:02d}'" for number in range(2, 11))
    assert messages[0] == (
        f"target 'P11' moved by 2.14 m; up to 20 mm is plausible (and 9 more of this kind: {others})"
    )
    assert messages[1] == (
        "the distance between 'P10' and 'P12' (loaded) differs by 500 mm from its median (limit 188 mm): "
        "'P10' or 'P12' moved (and 9 more of this kind: 'c02', 'c03', 'c04', 'c05', 'c06', 'c07', 'c08', "
        "'c09', 'c11')"
    )
    assert messages[2] == (
        "the stiffness of joint_4 is 430.6 N·m/rad; for joints of industrial robots, 1000 N·m/rad to 1 · "
        "10⁹ N·m/rad is "
        "plausible"
    )
    assert messages[5] == "distances between targets scatter by 43.6 mm, but the stated noise gives 28.3 µm"
    assert found.reasons[0].remedy == (
        "check `units.length`, and that unloaded and loaded readings belong together; if the numbers are "
        "right, state `accept_verdict` in each map, program, plan or export of the run"
    )


def test_a_robot_is_of_a_geometry_that_is_there(local):
    model = {"format": "geometry", "geometry_id": "nobody"}
    answer = local.request("POST", "/v1/robots", json={"name": "as measured", "model": model})
    assert told(answer) == (
        "422 | model.geometry_id | there is no geometry 'nobody' | check the id; list the existing ids "
        "with GET /v1/jobs?kind=geometry"
    )
