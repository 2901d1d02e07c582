"""What a user reads of a run by own weight: terminal, report, sag, maps, plans, and faults of bodies."""

import json

import pytest
from support.documents import own_weight
from support.kinds import MAP, posted_job
from support.pages import lines_of_page
from support.terminal import terminal


@pytest.fixture(scope="module")
def own():
    return own_weight(24, 1)


@pytest.fixture(scope="module")
def run(local, own):
    return local.request("POST", "/v1/campaigns", json=own).json()


def test_the_terminal_says_what_masses_make_up_of_each_interval(tmp_path, own):
    file = tmp_path / "own.json"
    file.write_text(json.dumps(own))
    words = " ".join(terminal("identify", file, "--details", width=100).stdout.split())
    for line in [
        "Use 5 of 6 joints: no number of the other joints passed the checks",
        "Joint stiffness, by the robot's own weight, compliance ≥ 0",
        "│ joint_1 │ — │ — │ not observable │",
        "│ joint_2 │ 3.05 │ 2.34 … 3.59 │ roughly known │",
        "│ joint_6 │ 0.101 │ 0.072 … 0.159 │ roughly known │",
        "joint_1: gravity does not load the joint in any of the postures: apply a known force that twists "
        "the joint",
        "explains 98.9 % of the mean deflection, residual 42.5 µm rms (3-D), sigma of a reading "
        "30 µm (given)",
        "fraction of each interval's width due to uncertain masses: joint_2 35 %, joint_3 68 %, joint_4 18 "
        "%, joint_5 42 %, joint_6 27 %",
        "without sag, the best geometry leaves 249 µm rms of a coordinate; with sag, 26.9 µm",
        "warning: the readings do not check the mass of link 2, link 3, link 4, link 5, link 6: twice the "
        "stated mass might not be noticed, and would change a "
        "compliance by up to 1.1e+02 %; check these "
        "masses, or hang a "
        "known payload in half of the postures",
        "χ²/dof 0.85: consistent with sigma (1 if model and sigma are right; 165 degrees of freedom)",
        "complementary stiffness included (4 refits); it changes a compliance (K_c/k at most 0.0026)",
        "│ Weight: gravity │ (0, 0, -9.80665) │",
        "│ Weight: rigid base │ no │",
    ]:
        assert line in words


def test_the_report_states_masses_with_their_bounds_and_shares_of_intervals(local, run):
    lines = lines_of_page(local.get(f"/v1/jobs/{run['id']}/files/report.html").text)
    for line in [
        "joint_1 | — | — | not observable |",
        "joint_2 | 3.05 | 2.34 … 3.59 | use |",
        "– joint_1: no number: gravity does not load the joint in any of the postures: apply a known force "
        "that twists the joint.",
        "Z | -0.00101 (-0.00145 … -0.00057) | -0.0000479 (-0.0000652 … -0.0000307) | "
        "0.00254 (0.00157 … 0.00351) | unknown |",
        "– the load or own weight twists joint_1, which the readings of the run do not determine: the "
        "prediction is not valid",
        "joint_2 | 65 % | 35 % |",
        "joint_3 | 32 % | 68 % |",
        "Fractions of each interval's width: from the readings, and from the bounds of the masses.",
        "– Deviations: none.",
        "link 1 380 kg (342 to 418); link 2 230 kg (207 to 253); link 3 260 kg (234 to 286); link 4 95 kg "
        "(85.5 to 104.5); link 5 55 kg (49.5 to 60.5); link 6 48 kg (43.2 to 52.8)",
        "3.582 mm",
        "0.03857 mm",
        "σ = 30 µm of a coordinate of a reading.",
        "3: P10, P11, P12",
    ]:
        assert line in lines
    after = {"Force on the robot": "0 N", "Observations": "24", "Verdict on the result": "use"}
    assert {line: lines[lines.index(line) + 1] for line in after} == after


def test_sag_is_in_a_prediction_that_is_absolute_and_only_there(local, run):
    asked = {
        "run_id": run["id"],
        "units": {"length": "m", "angle": "deg", "force": "N"},
        "load_point": [-0.06, 0.02, 0.18],
        "cases": [
            {"joints": [0, -20, 30, 0, 45, 0], "force": [0, 0, 0]},
            {"joints": [40, -10, 5, 7, 30, 2], "force": [0, 0, -800]},
        ],
    }

    def predicted(absolute):
        return local.request("POST", "/v1/deflections", json=asked | {"absolute": absolute}).json()

    bent, relative = predicted(True), predicted(False)
    headline = "Use this prediction: no fault was found; 5 of 6 joints of its run passed the checks"
    no_bound = (
        "no bound of the model error: the stiffnesses come from the robot's own weight, not from postures "
        "under load"
    )
    for found, said in (
        (
            bent,
            "the predictions are absolute (relative to an arm that does not bend), and include the sag "
            "under own weight",
        ),
        (relative, "own weight is not included, because `absolute` is not requested"),
    ):
        assert found["assessment"]["headline"] == headline
        assert found["remarks"] == [said, no_bound]
        assert found["model_error_postures"] == 0
    still, pulled = (case["displacement"] for case in bent["cases"])
    assert still == pytest.approx([-0.00060686, -1.4207e-5, -0.0017588], rel=1e-3)
    assert pulled == pytest.approx([0.00061927, 0.00042348, -0.0045275], rel=1e-3)
    assert bent["cases"][0]["readings_only"][2] == pytest.approx([-0.0019803, -0.0015373], rel=1e-3)
    still, pulled = (case["displacement"] for case in relative["cases"])
    assert still == [0.0, 0.0, 0.0]
    assert pulled == pytest.approx([0.00028591, 0.00018234, -0.0020004], rel=1e-3)
    along = relative["cases"][1]["compliance"]["along"]
    numbers = {"compliance": 2.5001e-6, "standard_uncertainty": 4.2031e-7, "lateral_free": 3.9999e5}
    assert {name: along[name] for name in numbers} == pytest.approx(numbers, rel=1e-3)
    assert along["lateral_blocked"] == pytest.approx(4.7821e5, rel=1e-3)


def test_a_map_of_loads_that_twist_an_unseen_joint_has_no_number(local, run):
    made = posted_job(local, "map", run, absolute=True).json()
    assert made["request"]["force"] == MAP["force"]
    result = made["result"]
    assert result["counts"] == {
        "reached": 0,
        "out_of_reach": 0,
        "joint_limits": 0,
        "unseen_joint": 4,
        "overloaded": 0,
        "not_followed": 0,
    }
    assert (result["worst"], result["percentiles"]) == (None, {})
    assert result["assessment"]["headline"] == "Do not use this map: 1 reason of its own"
    (reason,) = result["assessment"]["reasons"]
    assert (reason["code"], reason["message"]) == ("numbers_missing", "none of the 4 places have a number")


def test_a_plan_goes_on_with_the_joints_that_gravity_twists(local, run):
    set_id = run["request"]["measurement_set_id"]
    asked = {"measurement_set_id": set_id, "readings": 2, "candidates": 100, "load": {"kind": "own_weight"}}
    result = local.request("POST", "/v1/plans", json=asked).json()["result"]
    (reason,) = result["assessment"]["reasons"]
    assert (reason["code"], reason["message"]) == ("joint_left_out", "no load of this plan twists joint_1")
    assert result["left_out"] == ["joint_1"]
    assert [each["label"] for each in result["readings"]] == ["p1", "p2"]
    assert [each["force"] for each in result["readings"]] == [[0.0, 0.0, 0.0]] * 2
    joints = {each["name"]: each for each in result["joints"]}
    assert list(joints) == [f"joint_{i}" for i in range(2, 7)]
    numbers = {"standard_uncertainty": 2.826e-8, "relative": 0.086153, "before": 3.0183e-8}
    assert {name: joints["joint_2"][name] for name in numbers} == pytest.approx(numbers, rel=1e-2)
    assert (result["considered"], result["feasible"], result["struck_out"]) == (100, 100, {})
    assert result["efficiency"] == pytest.approx(0.83068, rel=1e-2)
