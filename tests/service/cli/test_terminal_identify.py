"""What `identify` and `compare` print: verdicts, numbers, reasons, what to do, and refusals."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from support.command_lines import answered, assert_said, refused, typed

import jointstiff
from jointstiff.simulator import default_arm, simulate_campaign

ARM = default_arm()
SOFT = replace(ARM, stiffnesses=ARM.stiffnesses * [1, 1, 0.8, 1, 1, 1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("identify")
    for name, arm, load, seed in [
        ("weight", ARM, "dead_weight", 2),
        ("pull", ARM, "pull", 1),
        ("soft", SOFT, "pull", 2),
    ]:
        document = simulate_campaign(arm, load=load, configurations=12, seed=seed)
        (folder / f"{name}.json").write_text(json.dumps(document))
    return folder


@pytest.fixture(autouse=True)
def inside(folder, monkeypatch):
    monkeypatch.chdir(folder)


def test_a_joint_that_the_load_never_twists_has_no_number_and_says_what_to_do():
    assert_said(
        typed("identify weight.json --details"),
        "Use 5 of 6 joints: no number of the other joints passed the checks",
        "Joint stiffness, partial pose, covariance weights, compliance ≥ 0",
        "┃ joint ┃ stiffness ┃ 95 % interval ┃ verdict ┃",
        "│ joint_1 │ — │ — │ not observable │",
        "│ joint_2 │ 3.112 │ 3.042 … 3.185 │ well determined │",
        "│ joint_5 │ 0.2550 │ 0.2425 … 0.2689 │ determined │",
        "│ joint_6 │ 0.0962 │ 0.0795 … 0.1155 │ determined │",
        "stiffness and its interval in 10⁶ N·m/rad",
        "joint_1: the load never twists this joint: add loads that twist the joint",
        "To do 1. joint_1: in posture c05 apply 1500 N along (0.50, 0.87, 0.00): the uncertainty of "
        "joint_1's compliance falls to 0.0019 µrad/(N·m)",
    )


def test_assumed_errors_are_said_with_every_result_and_explained_in_its_details():
    assert_said(typed("identify weight.json"), "assumed: load point ± 10 mm, force ± 1 %; --details")
    assert_said(
        typed("identify weight.json --details"),
        "Forces up to 1500 N (153 kgf), deflections up to 4.88 mm. If N and kgf were confused, every "
        "stiffness would be wrong by a factor of 9.81, and no reading would show it.",
        "The load point is assumed to be known to ±10 mm. State how you know it: by tracker ±1 mm, from a "
        "drawing ±3 mm, by hand ±10 mm (`noise.grounds.load_point`; on the page: Advanced, How the load "
        "point is known).",
        "The forces are assumed to be known to ±1 %. Enter the uncertainty of the load cell or of the weight "
        "(`noise.force.scale`; on the page: Advanced, Scale of the force).",
        "Each posture was read only once without load, so a deflection that remains after unloading is not "
        "detected. Read each posture again after unloading (`unloaded_after`).",
    )


def test_details_have_the_evidence_behind_the_numbers():
    assert_said(
        typed("identify weight.json --details"),
        "explains 98.9 % of the mean deflection, residual 43.7 µm rms (3-D), sigma of a reading 20 µm "
        "(given)",
        "The model has elastic joints alone: no test shows that other parts bend (F test of links added to "
        "the joints: p = 0.9).",
        "χ²/dof 0.84: consistent with sigma (1 if model and sigma are right; 103 degrees of freedom)",
        "uncertainty from readings (type B): ± 1 to 17 % of a compliance",
        "uncertainty from scale of the force, 1 % assumed (type B): ± 2 % of a compliance",
        "uncertainty from load point, 10 mm assumed (type B): ± 0.63 to 9.9 % of a compliance",
        "uncertainty from model error (type A, not in the intervals): ± 0.13 to 13 % of a compliance",
        "complementary stiffness included (4 refits); it changes a compliance by at most 0.51 std. "
        "uncertainties (K_c/k at most 0.0023)",
        "causes tested with the joints, p-value: play 0.5, curved springs 0.6, load zero 0.6, load point "
        "0.8, turn 0.9, constant force 1, shift 1, tool 1, growth 1, growth over time 1, shift since c06 1, "
        "turn since c06 1, load scale since c08 1, stiffness since c05 1",
        "observability O1 0.62, O2 0.3, O3 0.35, O4 0.1, O5 0.11; condition number 2.85",
        "│ Complementary stiffness │ included │",
        "│ Confidence │ 0.95 │",
        "│ Not stated │ characteristic length, stiffness bounds, huber threshold, causes, priors,",
    )


def test_resampled_fits_are_shown_in_the_unit_that_is_asked_for():
    assert_said(
        typed("identify pull.json --unit nm/arcmin --details --resample 8:200 --elasticity joints"),
        "│ joint_1 │ 1111 │ 1086 … 1136 │ well determined │",
        "│ joint_6 │ 26.9 │ 22.3 … 32.8 │ determined │",
        "stiffness and its interval in N·m/arcmin",
        "200 fits of 8 configurations drawn at random",
        "┃ joint ┃ mean ┃ deviation ┃ negative ┃ rigid ┃ undetermined ┃",
        "│ joint_1 │ 1109.9 │ 4.7 │ 0 % │ 0 % │ 0 % │",
        "│ joint_6 │ 27.0 │ 1.5 │ 0 % │ 0 % │ 0 % │",
        "│ compensation │ 98.7 % │ 0.0 % │ — │ — │ — │",
        "stiffness in N·m/arcmin: mean and standard deviation over the resampled fits; compensation: "
        "fraction of the deflection "
        "explained in all configurations",
        "│ Resampling: size │ 8 │ │ Resampling: repetitions │ 200 │ │ Resampling: seed │ 0 │",
    )


def test_a_thousand_fits_are_drawn_where_no_number_is_given():
    assert_said(
        typed("identify pull.json --resample 8"),
        "1000 fits of 8 configurations drawn at random",
        "│ joint_2 │ 3.1158 │ 0.0072 │ 0 % │",
    )


@pytest.mark.parametrize(
    ("options", "sentences"),
    [
        (
            "--method complete_pose --no-positive",
            [
                "Joint stiffness, complete pose, covariance weights, unconstrained",
                "│ joint_1 │ 3.818 │ 3.734 … 3.905 │ well determined │",
            ],
        ),
        (
            "--elasticity joints --method decoupled_partial_pose --weighting uniform",
            [
                "Joint stiffness, decoupled partial pose, uniform weights, compliance ≥ 0",
                "│ joint_3 │ 2.541 │ 2.400 … 2.701 │ determined │",
                "assumed: load point ± 10 mm, force ± 1 %; 1 warning; --details",
            ],
        ),
        (
            "--elasticity joints --loss huber --huber-threshold 2",
            ["│ joint_3 │ 2.483 │ 2.400 … 2.572 │", "│ joint_4 │ 0.446 │ 0.380 … 0.539 │"],
        ),
        (
            "--elasticity joints --prior joint_2=3e6:2e5",
            [
                "┃ 95 % interval ┃ prior/data ┃ verdict ┃",
                "│ joint_1 │ 3.818 │ 3.734 … 3.905 │ — │ well determined │",
                "│ joint_2 │ 3.115 │ 3.046 … 3.187 │ 0.0072 │ well determined │",
            ],
        ),
        (
            "--elasticity joints --confidence 0.9 --leave-out c01",
            [
                "┃ 90 % interval ┃",
                "│ joint_1 │ 3.792 │ 3.719 … 3.868 │",
                "1 warning; --details",
            ],
        ),
        (
            "--elasticity joints --cause load_point",
            [
                "Use with care: 1 reason every load point moved by (-9.17, 1.91, 9.42) mm ± (8.76, 4.52, "
                "31.1) mm in the flange frame (95 %) was fitted with the joints; the intervals include the "
                "uncertainty of this cause, and the readings contradict the stated value",
                "│ joint_1 │ 3.826 │ 3.737 … 3.919 │ use with care │",
                "To do 1. measure the load point on the flange",
            ],
        ),
        (
            "--elasticity joints --complementary-stiffness neglected",
            ["│ joint_1 │ 3.820 │ 3.736 … 3.908 │"],
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_an_option_changes_the_numbers_and_is_named_with_them(options, sentences):
    assert_said(typed(f"identify pull.json {options}"), *sentences)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--elasticity joints --method decoupled_partial_pose --weighting uniform", "residual 43.2 µm rms"),
        ("--elasticity joints --confidence 0.9 --leave-out c01", "residual 37.7 µm rms"),
        ("--elasticity joints --complementary-stiffness neglected", "residual 39.1 µm rms"),
        (
            "--method complete_pose --no-positive",
            "The model has elastic joints alone: elastic links cannot be combined with the option method (F "
            "test of links added to the joints: p = 0.07).",
        ),
        (
            "--resample 8:10",
            "The model has elastic joints alone: elastic links cannot be combined with the option resampling "
            "(F test of links added to the joints: p = 0.07).",
        ),
    ],
    ids=lambda value: value if value.startswith("-") else "",
)
def test_the_details_have_the_fit_with_an_option(options, sentence):
    assert_said(typed(f"identify pull.json {options} --details"), sentence)


def test_a_load_point_that_is_fitted_is_no_longer_assumed():
    fitted = typed("identify pull.json --elasticity joints --cause load_point")
    assert "assumed: force ± 1 %; " in fitted
    assert "load point ± 10 mm" not in fitted


def test_json_is_the_run_with_its_request_origin_and_numbers():
    run = answered("identify pull.json --elasticity joints")
    assert (run["kind"], run["state"], run["error"]) == ("run", "succeeded", None)
    assert (run["request"]["elasticity"], run["request"]["confidence"]) == ("joints", 0.95)
    assert run["provenance"]["versions"].keys() >= {"jointstiff", "pinocchio", "clarabel", "numpy"}
    assert len(run["provenance"]["input_hash"]) == 64
    result = run["result"]
    assert result["assessment"]["verdict"] == "use"
    assert result["assessment"]["joints_identified"] == 6
    third = result["joints"][2]
    assert third["stiffness"] == pytest.approx(2.4823e6, rel=1e-4)
    assert third["compliance"] == pytest.approx(4.0286e-7, rel=1e-4)
    assert third["standard_uncertainty"] == pytest.approx(6.2122e-9, rel=1e-4)
    assert third["stiffness_interval"] == pytest.approx([2.4094e6, 2.5598e6], rel=1e-4)
    assert third["stiffness_at_least"] == pytest.approx(2.4209e6, rel=1e-4)
    goodness = result["goodness"]
    assert goodness["chi_square"] == pytest.approx(68.194, rel=1e-4)
    assert (goodness["degrees_of_freedom"], goodness["sigma_source"]) == (102, "given")
    assert result["identifiability"]["condition_number"] == pytest.approx(2.87995, rel=1e-4)
    assert result["choice"]["message"] == (
        "The model has elastic joints alone, as requested (F test of links added to the joints: p = 0.07)."
    )
    shares = {each["joint"]: each["share"] for each in result["contributions"]}
    assert [shares[f"joint_{j}"] for j in (1, 2, 3)] == pytest.approx([0.26397, 0.35156, 0.21183], rel=1e-4)
    assert [each["source"] for each in result["budget"]["components"]] == [
        "readings",
        "assumed_force_scale",
        "assumed_load_point",
        "model_error",
    ]
    assert result["model"]["error"]["leverage"] == pytest.approx(6.2866e-5, rel=1e-4)


def test_methods_that_agree_are_compared_in_the_unit_that_is_asked_for():
    assert_said(
        typed("compare pull.json --unit Nm/arcmin"),
        "Use this comparison: no fault was found; all 6 joints of its run passed the checks",
        "Stiffness in N·m/arcmin joint sign CP/L CP",
        "joint_1 free 1110 (1082 … 1138) 1111 (1086 … 1136)",
        "joint_3 free 718 (691 … 748) 722 (701 … 745)",
        "joint_6 free 23.9 (17.0 … 40.3) 26.9 (22.3 … 32.8)",
        "translations divided by a length of 0.533 m; free: unconstrained; in brackets: the "
        "interval; ≥ 0 gives the same numbers as free: no constraint is active",
        "fit explained rms [µm] condition",
        "CP/L free 98.6 % 41 3.04",
        "DPP free 98.6 % 42 1.8",
        "1 warning; --details",
    )


def test_two_campaigns_are_compared_joint_by_joint():
    """The ratio of joint_1 is 0.999 ± 0.008 by one cell; two scales of 1 % each make that ± 0.016."""
    assert_said(
        typed("compare pull.json soft.json"),
        "│ joint_1 │ 3.818 (3.734 … 3.905) │ 3.814 (3.729 … 3.904) │ 0.999 (0.968 … 1.032) │ 0.96 │",
        "│ joint_3 │ 2.482 (2.410 … 2.560) │ 1.999 (1.945 … 2.056) │ 0.805 (0.773 … 0.839) │ < 0.0001 │",
    )
    assert_said(
        typed("compare pull.json soft.json --same-cell --details"),
        "First: pull.json. Second: soft.json. Use this comparison with care: 1 reason of its own",
        "no configuration was measured on both sides, so the avoided deflection is predicted, not measured",
        "│ joint_1 │ 3.818 (3.734 … 3.905) │ 3.814 (3.729 … 3.904) │ 0.9991 (0.9831 … 1.0154) │ 0.91 │",
        "│ joint_3 │ 2.482 (2.410 … 2.560) │ 1.999 (1.945 … 2.056) │ 0.805 (0.781 … 0.830) │ < 0.0001 │",
        "│ joint_4 │ 0.444 (0.382 … 0.531) │ 0.431 (0.399 … 0.470) │ 0.971 (0.801 … 1.153) │ 0.75 │",
        "ratio of the stiffnesses, second to first; in brackets: 95 % interval; p: p-value of equal",
        "deflection avoided by the second side: no observation is common to both sides; predicted -5.6 % "
        "in all",
        "joint_3 1 free 2.470 (",
        "CP/L 2 ≥ 0 98.2 % 47 2.68",
        "warning: 12 observations have the same label but different postures or loads, or no common "
        "target; the first of these observations is 'c01'; measure the same postures under the same load, "
        "or give different labels",
        "To do 1. measure some of the same postures under the same load on both sides",
        "│ Run ids │ 16 entries, SHA-256 ",
    )


@pytest.mark.parametrize(
    ("command", "content", "said"),
    [
        (
            "identify",
            "{",
            ": Invalid JSON: EOF while parsing an object at line 1 column 1 remedy: correct the JSON",
        ),
        (
            "identify",
            '{"a": 1, }',
            ": Invalid JSON: trailing comma at line 1 column 10 remedy: correct the JSON",
        ),
    ],
)
def test_a_broken_file_is_refused_with_its_line_and_column(command, content, said):
    Path("broken.json").write_text(content)
    assert refused(f"{command} broken.json").startswith(f"broken.json{said}")


def test_the_version_is_that_of_the_package():
    assert typed("--version") == f"jointstiff {jointstiff.__version__}"
