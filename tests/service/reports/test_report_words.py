"""Reports of a service for a laboratory, as they are read: results, budgets, deviations, and origin."""

from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from support.api import file_at, post
from support.command_lines import assert_said
from support.in_process import description
from support.pages import words_of

from jointstiff.schemas.report import Laboratory
from jointstiff.service.app import create_app
from jointstiff.service.reports.laboratory import LaboratorySettings, SettingsError, read_laboratory
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign

LABORATORY = Laboratory(
    name="Metrology Lab",
    address=["1 Main Street", "44000 Nantes"],
    traceability="K-17",
    method="Procedure 4",
    conditions="warmed up",
    customer={"name": "Arms Inc.", "address": ["2 Side Street"]},
)
STATED = {
    "measured_at": "2021-11-20T14:30:00+01:00",
    "instrument": "Tracker 750123",
    "operator": "B",
    "conditions": "20 °C",
    "serial_number": "SN-1",
    "item_condition": "as found",
    "notes": "line one\nline two",
}


@pytest.fixture(scope="module")
def laboratory():
    """A client of the service of a laboratory."""
    with Store.open("sqlite://") as store:
        app = create_app(store, laboratory=LaboratorySettings(LABORATORY))
        app.openapi = description
        with TestClient(app, base_url="http://localhost:8000") as client:
            yield client


def identified(laboratory, load, seed, options, configurations=12, **stated):
    """Post a campaign; return its run."""
    document = simulate_campaign(default_arm(), load=load, configurations=configurations, seed=seed)
    document["measurement_set"]["noise"] |= stated.pop("noise", {})
    document["measurement_set"] |= STATED | stated
    return post(laboratory, "/v1/campaigns", document | {"run": options})


def file_of(laboratory, run, name="report.html", **query):
    answer = laboratory.get(file_at(run, name), params=query)
    assert answer.status_code == 200, answer.text
    return answer


def report_of(laboratory, run, **query):
    """The words of the report of a run."""
    return words_of(file_of(laboratory, run, **query).text)


@pytest.fixture(scope="module")
def pulled(laboratory):
    return identified(laboratory, "pull", 1, {})


@pytest.fixture(scope="module")
def weighed(laboratory):
    """A run under a dead weight, with stated errors of load and load point."""
    grounds = {"load_point": "tracker"}
    noise = {"load_point": 0.001, "grounds": grounds, "force": {"scale": 0.002, "direction": 0.001}}
    return identified(laboratory, "dead_weight", 2, {"elasticity": "joints"}, noise=noise)


def test_a_report_names_laboratory_customer_item_and_measurement(laboratory, pulled):
    assert_said(
        report_of(laboratory, pulled),
        "Metrology Lab 1 Main Street, 44000 Nantes",
        f"3 Identification Report {pulled['id']}",
        "Customer Arms Inc., 2 Side Street",
        "Location of the measurement 1 Main Street, 44000 Nantes",
        "Item Industrial robot simulated 6R, 6 joints: joint_1, joint_2, joint_3, joint_4, joint_5, joint_6",
        "Measured 2021-11-20 13:30 UTC",
        "Measurement set pull, 12 configurations, motor encoders",
        "line one",
        "line two",
        "Procedure of the laboratory Procedure 4",
        "Conditions 20 °C",
        f"End of report {pulled['id']}",
    )


def test_a_report_has_results_with_their_intervals(laboratory, pulled):
    assert_said(
        report_of(laboratory, pulled),
        "1 Results",
        "joint | stiffness [10⁶ N·m/rad] | 95 % interval | verdict |",
        "joint_1 | 3.818 | 3.734 … 3.905 | use |",
        "joint_4 | 0.444 | 0.382 … 0.531 | use |",
        "joint_6 | 0.0925 | 0.0768 … 0.1129 | use |",
        "Fraction of the mean deflection that the model explains 98.7 %",
        "Root mean square of the residuals' lengths 38.8 µm",
        "Standard uncertainty of a coordinate of a reading 20 µm (given)",
        "Stiffness of each joint with its interval 0.01 0.1 1 10 stiffness [10⁶ N·m/rad] joint_1",
        "Deflection before and after compensation, mean length over the targets 0 2.5 5 mm configurations "
        "1 to 12 of 12 measured residual",
        "The arm in the posture of the first observation x y z 1 2 3, 4 5, 6",
        "4 Predicted static compliance of the flange",
        "in brackets: 95 % interval",
        "X | 0.0005091 (0.0004977 … 0.0005206) | -0.0001956 (-0.0002016 … -0.0001897) | "
        "-0.000995 (-0.001016 … -0.000973) | unknown |",
        "Predicted from the identified stiffness, not measured",
        "Mean deflection, before: as measured 2.762 mm",
        "Mean deflection, after compensation by the model, computed 0.03569 mm",
    )


def test_a_report_has_the_budget_of_each_joint(laboratory, pulled):
    assert_said(
        report_of(laboratory, pulled),
        "5 Uncertainty budget Contributions to the standard uncertainty of each compliance "
        "[% of the compliance]",
        "readings | B | 0.52 | 0.56 | 1.0 | 8.2 | 1.6 | 10 |",
        "assumed force scale | B | 1.00 | 1.00 | 1.00 | 1.0 | 1.0 | 1.0 |",
        "assumed load point | B | 0.21 | 0.17 | 0.56 | 1.5 | 1.8 | 2.6 |",
        "model error (not included) | A | 0 | 0 | 0 | 0 | 0 | 0 |",
        "combined, only sources that the intervals include | | 1.1 | 1.2 | 1.5 | 8.3 | 2.6 | 11 |",
        "combined, all sources | | 1.1 | 1.2 | 1.5 | 8.3 | 2.6 | 11 |",
        "expanded, all sources, k = 2 | | 2.3 | 2.3 | 3.1 | 17 | 5.2 | 22 |",
        "expanded, of the stiffness [10⁶ N·m/rad] | | 0.087 | 0.072 | 0.077 | 0.074 | 0.013 | 0.020 |",
        "Greatest correlation coefficient between two joints: 0.81 (joint_1 and joint_2); all are in "
        "run.json.",
        "The interval of a joint in the results differs from y ± U: the interval contains all "
        "stiffnesses that the likelihood of the readings does not exclude, can be asymmetric, and omits the "
        "sources that are not included above.",
    )


def test_a_report_says_what_is_assumed_and_where_its_numbers_come_from(laboratory, pulled):
    assert_said(
        report_of(laboratory, pulled),
        "2 Assessment and warnings",
        "All 6 joints passed the checks.",
        "Verdict on the result use",
        "6 Method and deviations from it",
        "Deviations: none.",
        "Causes tested, p-value stiffness since c05 0.5, load point 0.6, tool 0.8, play 0.9, curved springs "
        "1, constant force 1, load zero 1, hook weight 1, shift 1, growth 1, growth over time 1, turn 1,",
        "Not stated characteristic length, stiffness bounds, huber threshold, causes,",
        "No adjustment or repair between the readings is stated: all results are as found. The mean "
        "deflection after compensation is computed from the same readings; it is not measured.",
        "σ = 20 µm of a coordinate of a reading. Size of the force: no uncertainty is stated; ±1 % is "
        "assumed. Load point: no uncertainty is stated; ±10 mm is assumed.",
        "Position loop closed by motor encoders Observations 12 Force on the robot 1500 N Load point in "
        "the flange frame (-60, 20, 180) mm Targets read 3: P10, P11, P12",
        "They are not a test of static compliance after ISO 9283:1998, clause 10, and do not replace one.",
        "No statement of conformity with a specification is made. The verdicts are opinions by the rules "
        "of the software, which are published with it; the verdicts state whether a number may be used, "
        "not whether the item is good.",
        f"Run {pulled['id']} SHA-256 of the input {pulled['provenance']['input_hash']}",
        "Geometry as described",
        "7.8.2.1 b | name and address of the laboratory | letterhead |",
        "7.8.4.1 d | results before and after adjustment or repair | Before and after adjustment |",
    )


def test_a_joint_without_a_number_has_none_in_results_prediction_and_budget(laboratory, weighed):
    assert_said(
        report_of(laboratory, weighed),
        "joint_1 | — | — | not observable |",
        "joint_2 | 3.110 | 3.078 … 3.143 | use |",
        "joint_6 | 0.0880 | 0.0804 … 0.0971 | use |",
        "joint_1: no number: the load never twists this joint: add loads that twist the joint.",
        "joint_1 no number: see the table joint_2",
        "5 of 6 joints passed the checks.",
        "X | — | — | — | — | Y | — | — | — | — | Z | -0.0002759",
        "the load or own weight twists joint_1, which the readings of the run do not determine: the "
        "prediction is not valid",
        "source | type | joint_2 | joint_3 | joint_4 | joint_5 | joint_6 |",
    )


def test_stated_errors_take_the_place_of_assumed_ones(laboratory, weighed):
    words = report_of(laboratory, weighed)
    assert_said(
        words,
        "readings | B | 0.49 | 0.74 | 4.9 | 1.2 | 4.5 |",
        "force scale | B | 0.20 | 0.20 | 0.20 | 0.20 | 0.20 |",
        "force direction | B | 0.042 | 0.023 | 0.23 | 0.059 | 0.054 |",
        "load point | B | 0.043 | 0.066 | 0.25 | 0.25 | 1.8 |",
        "model error (not included) | A | 0.069 | 0.046 | 6.7 | 0.26 | 0.78 |",
        "combined, all sources | | 0.53 | 0.77 | 8.3 | 1.3 | 4.9 |",
        "Greatest correlation coefficient between two joints: -0.58 (joint_2 and joint_3); all are in "
        "run.json.",
        "σ = 20 µm of a coordinate of a reading. Force: relative 0.002, direction 1 mrad. Load point: 1 mm "
        "a coordinate.",
    )
    assert "assumed" not in words


def test_a_report_has_the_units_of_reports_whatever_is_asked_for(laboratory, weighed):
    assert report_of(laboratory, weighed, unit="Nm/arcmin") == report_of(laboratory, weighed)


def test_the_tables_of_a_run_have_its_lines_and_its_evidence(laboratory, weighed):
    answer = file_of(laboratory, weighed, "tables.json", details="true").json()
    assert (answer["assessment"]["verdict"], answer["assessment"]["joints_identified"]) == ("use", 5)
    (table,) = answer["tables"]
    assert table["title"] == "Joint stiffness, partial pose, covariance weights, compliance ≥ 0"
    assert table["caption"] == "stiffness and its interval in 10⁶ N·m/rad"
    assert table["legend"] == f"{table['title']}; {table['caption']}"
    assert table["head"] == ["joint", "stiffness", "95 % interval", "verdict"]
    assert table["rows"][0] == ["joint_1", "—", "—", "not observable"]
    assert table["rows"][1] == ["joint_2", "3.110", "3.078 … 3.143", "well determined"]
    assert table["texts"] == [0, 3]
    assert answer["lines"] == [
        "joint_1: the load never twists this joint: add loads that twist the joint",
        "explains 98.8 % of the mean deflection, residual 44.2 µm rms (3-D), sigma of a reading 20 µm "
        "(given)",
    ]
    assert answer["evidence"][:3] == [
        "χ²/dof 0.85: consistent with sigma (1 if model and sigma are right; 103 degrees of freedom)",
        "uncertainty from readings (type B): ± 0.96 to 9.6 % of a compliance",
        "uncertainty from scale of the force (type B): ± 0.39 % of a compliance",
    ]


@pytest.mark.parametrize(
    ("seed", "options", "stated", "sentences"),
    [
        (
            3,
            {
                "method": "complete_pose",
                "positive": False,
                "resampling": {"size": 8, "repetitions": 200, "seed": 4},
            },
            {},
            [
                "joint_1 | 3.768 | 3.677 … 3.864 | use |",
                "X | 0.000903 (0.000881 … 0.000925) | 0.0001379 (0.0001330 … 0.0001428) |",
                "combined, all sources | | 1.3 | 1.2 | 1.6 | 6.0 | 2.6 | 8.9 |",
                "Deviation: negative compliances were allowed.",
                "complete pose, covariance weights, without constraints",
                "Resampling: size 8 Resampling: repetitions 200 Resampling: seed 4 Resampling: replacement "
                "no",
                "Mean deflection, before: as measured 2.457 mm",
                "computed 0.04337 mm",
            ],
        ),
        (
            4,
            {
                "priors": {"joint_1": {"stiffness": 3e6, "standard_uncertainty": 3e5}},
                "stiffness_bounds": {"joint_6": [5e4, 1e6]},
                "loss": "huber",
            },
            {"encoders": "secondary"},
            [
                "joint_1 | 3.804 | 3.712 … 3.900 | use |",
                "joint_6 | 0.099 | 0.071 … 0.159 | use with care |",
                "Deviation: loss huber: large residuals have less weight.",
                "Deviation: prior knowledge of joint_1 was used.",
                "Deviation: stiffness of joint_6 was bounded.",
                "Stiffness bounds joint_6 (0.05, 1) 10⁶ N·m/rad",
                "Priors joint_1 stiffness 3 10⁶ N·m/rad, standard uncertainty 0.3 10⁶ N·m/rad",
                "Mean deflection, before: as measured 2.378 mm",
                "Position loop closed by secondary encoders",
            ],
        ),
    ],
    ids=["unconstrained and resampled", "with prior, bounds and Huber's loss"],
)
def test_a_report_names_each_deviation_from_the_method(laboratory, seed, options, stated, sentences):
    run = identified(laboratory, "pull", seed, {"elasticity": "joints"} | options, **stated)
    assert_said(report_of(laboratory, run), *sentences)


@pytest.mark.parametrize(("moment", "said"), [(5.0, "1500 N, and moments"), (0.0, "1500 N")])
def test_a_moment_in_one_observation_is_said_and_none_is_not(laboratory, moment, said):
    document = simulate_campaign(default_arm(), load="pull", configurations=6, seed=3)
    document["measurement_set"]["observations"][2]["moment"] = [0.0, moment, 0.0]
    run = post(laboratory, "/v1/campaigns", document)
    assert f"Force on the robot {said} Load point" in report_of(laboratory, run)


def test_forces_of_several_sizes_are_said_from_the_least_to_the_greatest(laboratory):
    document = simulate_campaign(default_arm(), load="pull", configurations=6, seed=3)
    first = document["measurement_set"]["observations"][0]
    first["force"] = [0.8 * part for part in first["force"]]
    document["run"] = {"elasticity": "joints"}  # the wrong force would bring all models into competition
    words = report_of(laboratory, post(laboratory, "/v1/campaigns", document))
    assert "Force on the robot 1200 N to 1500 N Load point" in words


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name = ", "lab.toml is not TOML: Invalid value (at end of document): correct the file"),
        ("", "lab.toml: name: Field required: see docs/report.md for the fields"),
        (
            'name = "x"\ncolour = "red"\n',
            "lab.toml: colour: Extra inputs are not permitted: see docs/report.md for the fields",
        ),
        (
            'name = "a\\u0007b"\n',
            "lab.toml: name: Value error, must be printable text without leading or trailing blanks: see "
            "docs/report.md for the fields",
        ),
        (
            'name = "x"\nlogo = "../x"\n',
            "logo: '../x' is not the name of a file: put the logo into the folder of the settings",
        ),
        (
            'name = "x"\nlogo = "x.svg"\n',
            "cannot read x.svg: No such file or directory: give the name of an existing file",
        ),
        (
            'name = "x"\ncountry = "FR"\n',
            "lab.toml: country: Extra inputs are not permitted: see docs/report.md for the fields",
        ),
    ],
)
def test_settings_that_cannot_be_used_are_refused_by_field(text, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("lab.toml").write_text(text)
    with pytest.raises(SettingsError) as refused:
        read_laboratory(Path("lab.toml"))
    assert str(refused.value) == said
