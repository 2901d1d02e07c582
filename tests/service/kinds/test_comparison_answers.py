"""What comparisons answer or refuse: two campaigns, methods on one, and how the terminal shows them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from support.documents import campaign, changed
from support.kinds import posted_job
from support.refusals import refused, told
from support.terminal import terminal

import jointstiff as js
from jointstiff.schemas.comparison import CampaignComparison
from jointstiff.service.kinds.comparison.kind import COMPARISON, entries_sheet
from jointstiff.service.reports.job import lay_out_job
from jointstiff.service.tables.files import csv_text
from jointstiff.service.tables.table import Sheet
from jointstiff.simulator import default_arm, simulate_campaign

NAMES = [f"joint_{i}" for i in range(1, 7)]
URDF = "robot.model.urdf"
THREE_TARGETS = (
    "the pose of the flange needs 3 targets, but observations[0] 'c01' has 1 "
    "(12 of 12 observations have too few)"
)


def with_elbow(document):
    return changed(document, (URDF, document["robot"]["model"]["urdf"].replace("joint_3", "elbow")))


@pytest.fixture(scope="module")
def pull():
    return campaign(seed=3)


@pytest.fixture(scope="module")
def second():
    return js.identify(campaign(configurations=8, seed=6), elasticity="joints")


@pytest.fixture(scope="module")
def few():
    """As many readings as joints, and no stated noise."""
    read = campaign(configurations=2, seed=5, targets={"P0": (0.1, 0.05, 0.1)})
    return js.identify(changed(read, ("measurement_set.noise", None)), elasticity="joints")


@pytest.fixture(scope="module")
def posted(local):
    def post(document, **options):
        answer = local.request("POST", "/v1/campaigns", json=document | {"run": options})
        assert answer.status_code == 201, answer.text
        return answer.json()

    return post


@pytest.fixture(scope="module")
def run(posted, pull):
    return posted(pull)


class TestTwoCampaigns:
    def test_bounds_that_contradict_the_order_are_refused(self):
        bounds = {5: [1e7, None], 6: [1.0, 5e6]}
        runs = [
            js.identify(
                campaign(configurations=8, seed=seed),
                elasticity="joints",
                stiffness_bounds={"joint_3": limits},
            )
            for seed, limits in bounds.items()
        ]
        assert refused(js.compare, *runs, methods=[], ordered=True) == (
            "comparison.stiffness_order | the stiffness bounds contradict `stiffness_order` | widen the "
            "bounds, or omit `stiffness_order`"
        )

    def test_a_set_of_unknown_noise_cannot_be_weighted_with_another(self, few, second):
        assert refused(js.compare, few, second, methods=[], ordered=True) == (
            "comparison.ordered | sigma is neither stated nor determined by the residuals, so the two sets "
            "cannot be weighted against each other | state `noise.sigma`, or add observations"
        )

    def test_one_load_point_narrows_the_ratios_and_other_points_are_refused(self):
        """The load of both campaigns hung at one point: 10 mm are assumed of the point, once."""
        first, second = (
            js.identify(campaign(configurations=16, seed=seed, load="pull"), elasticity="joints")
            for seed in (5, 6)
        )

        def widths(**options):
            joints = js.compare(first, second, methods=[], **options).result.joints
            return np.array([high - low for low, high in (joint.ratio_interval for joint in joints)])

        narrowed = widths(same_load=True) / widths()
        assert narrowed.max() < 1.01
        assert narrowed.min() < 0.97
        elsewhere = campaign(configurations=16, seed=6, load="pull")
        elsewhere["measurement_set"]["load_point"] = [0.0, 0.0, 0.15]
        assert refused(js.compare, first, elsewhere, methods=[], same_load=True).startswith(
            "comparison.same_load | two sets state load points"
        )

    def test_a_set_of_unknown_noise_gives_no_ratio_and_a_prediction_alone(self, few, second):
        found = js.compare(few, second, methods=[]).result
        assert found.assessment.verdict == "do_not_use"
        assert [(each.code, each.weight, each.where) for each in found.assessment.reasons] == [
            ("no_residual_freedom", "do_not_use", "first"),
            ("no_common_configuration", "use_with_care", None),
            ("numbers_missing", "use_with_care", None),
            ("few_postures", "use_with_care", "first"),
            ("joint_poorly_known", "use_with_care", "second.joint_6"),
        ]
        headline = "Do not use this comparison: 2 reasons of its own, 3 reasons of its run"
        assert found.assessment.headline == headline
        unknown = (
            "the uncertainty of the joint is unknown in one of the sets: state `noise`, or add observations"
        )
        assert [(each.name, each.ratio, each.reason) for each in found.joints] == [
            (name, None, unknown) for name in NAMES
        ]
        one, two = found.entries
        assert {joint.verdict for joint in one.joints} == {"do_not_use"}
        assert [joint.verdict for joint in two.joints] == ["use"] * 5 + ["use_with_care"]
        stiffness = [[joint.stiffness for joint in each.joints[:3]] for each in (one, two)]
        assert stiffness[0] == pytest.approx([3.1530e6, 3.1429e6, 2.2761e6], rel=1e-4)
        assert stiffness[1] == pytest.approx([3.83131e6, 3.08548e6, 2.53770e6], rel=1e-4)
        assert one.rms_residual == pytest.approx(0.0, abs=1e-12)
        assert [two.compensation, two.condition_number] == pytest.approx([0.98255, 3.28734], rel=1e-4)
        assert one.condition_number == pytest.approx(12945, rel=1e-4)
        assert (found.avoided.matching, found.avoided.measured) == (0, None)
        assert found.avoided.predicted == pytest.approx(0.030180, rel=1e-3)
        shares = [(each.side, each.predicted) for each in found.avoided.configurations[:3]]
        assert shares == [
            ("first", pytest.approx(0.017531, rel=1e-3)),
            ("first", pytest.approx(0.013646, rel=1e-3)),
            ("second", pytest.approx(-0.0016102, rel=1e-2)),
        ]
        (warning,) = found.warnings
        assert warning.code == "configurations_differ"
        assert warning.message == (
            "2 observations have the same label but different postures or loads, or no common target; "
            "the first of these observations is 'c01'"
        )

    def test_robots_with_other_joints_are_not_compared(self, local, posted, run, pull):
        first = js.identify(campaign(configurations=8, seed=5), elasticity="joints")
        other = js.identify(with_elbow(campaign(configurations=8, seed=6)), elasticity="joints")
        elbow = "joint_1, joint_2, elbow, joint_4, joint_5, joint_6"
        said = (
            f"the robots have different joints: {', '.join(NAMES)} in the first set, {elbow} in the second "
            "| both robots have the same axes: rename the joints in the second robot's URDF, elbow to "
            "joint_3; and identify its set again"
        )
        assert refused(js.compare, first, other, methods=[]) == f"comparison.run_ids | {said}"
        stored = posted(with_elbow(pull), elasticity="joints")
        assert told(posted_job(local, "comparison", run, stored["id"])) == f"422 | run_ids | {said}"

    def test_an_observation_left_out_has_no_residual_but_its_deflection(self, local, run):
        of_set = {"measurement_set_id": run["request"]["measurement_set_id"]}
        options = {"elasticity": "joints", "leave_out": ["c03"]}
        less = local.request("POST", "/v1/runs", json=of_set | options).json()
        made = posted_job(local, "comparison", less, run["id"]).json()["result"]
        assert [entry["left"].count(None) for entry in made["entries"]] == [1, 0]
        assert [entry["left"].index(None) for entry in made["entries"][:1]] == [2]
        assert [None in side["deflection"] for side in made["sides"]] == [False]
        assert len(made["sides"][0]["deflection"]) == 12

    @pytest.mark.parametrize(
        ("other", "verdict", "said"),
        [
            (lambda pull: changed(pull, ("robot.name", "another")), "use", []),
            (
                lambda _: simulate_campaign(
                    default_arm(wrist_offset=0.005), load="pull", configurations=12, seed=3
                ),
                "use",
                [("robot_models_differ", None, "the robots differ in their kinematics or joint map")],
            ),
            (
                lambda pull: changed(pull, ("measurement_set.observations.4.force", [0.0, 0.0, 0.0])),
                "do_not_use",
                [
                    (
                        "zero_load",
                        "second.observations[4] 'c05'",
                        "force and moment are zero, so the observation carries no information on stiffness",
                    ),
                    (
                        "configurations_differ",
                        None,
                        "1 observations have the same label but different postures or loads, or no common "
                        "target; the first of these observations is 'c05'",
                    ),
                    (
                        "residuals_exceed_sigma",
                        "second",
                        "the residuals are 14.2 times as large as the stated noise allows, so the "
                        "uncertainties are too small; how much too small depends on the deflections that "
                        "the model "
                        "does not explain. Targets of one posture agree to within 18.7 µm, so the flange "
                        "moves differently from the model",
                    ),
                ],
            ),
        ],
        ids=["another name", "another wrist", "no load"],
    )
    def test_a_fault_is_said_of_its_side(self, local, posted, run, pull, other, verdict, said):
        made = posted_job(local, "comparison", run, posted(other(pull), elasticity="joints")["id"]).json()
        result = made["result"]
        assert result["assessment"]["verdict"] == verdict
        reasons = result["warnings"] + result["assessment"]["reasons"]
        assert [(each["code"], each["where"], each["message"]) for each in reasons] == said

    def test_ratios_of_robots_of_different_models_are_not_to_be_used(self, local, posted, run, pull):
        """The remedy, the same robot for both campaigns, works over HTTP and in Python."""
        longer = default_arm()
        longer = replace(longer, axis_points=longer.axis_points + np.outer([0, 0, 0, 0, 1, 1], [0.2, 0, 0]))
        other = simulate_campaign(longer, load="pull", configurations=12, seed=3)
        other = changed(other, ("robot.name", "longer"))
        made = posted_job(local, "comparison", run, posted(other, elasticity="joints")["id"]).json()["result"]
        first, *_ = made["assessment"]["reasons"]
        assert made["assessment"]["verdict"] == "do_not_use"
        assert (first["code"], first["message"], first["remedy"]) == (
            "robot_models_differ",
            "the robots are of different models, so that ratios of their joints mean nothing: 'simulated 6R' "
            "and 'longer': the length along the axis of joint_4 is 1310 mm and 1510 mm",
            "compare two campaigns of one robot, or of two robots of one model; if both arms are of one "
            "model, give the second campaign the `robot` of the first, and identify it again",
        )
        assert "robot_models_differ" not in [each["code"] for each in made["warnings"]]
        in_python = js.compare(js.identify(pull, elasticity="joints"), other, methods=[])
        assert in_python.result.assessment.verdict == "do_not_use"
        assert "'longer'" in str(in_python)
        mended = other | {"robot": pull["robot"]}
        compared = posted_job(local, "comparison", run, posted(mended, elasticity="joints")["id"]).json()
        codes = [each["code"] for each in compared["result"]["assessment"]["reasons"]]
        assert "robot_models_differ" not in codes
        compared = js.compare(pull, mended, methods=[]).result
        assert "robot_models_differ" not in [each.code for each in compared.assessment.reasons]

    def test_runs_are_of_two_sets_by_loads_of_their_own_and_of_joints(self, local, posted, run):
        def compared(*ids):
            return local.request("POST", "/v1/comparisons", json={"run_ids": [run["id"], *ids]})

        three = [posted(campaign(seed=seed))["id"] for seed in (4, 5)]
        assert told(compared(*three)) == (
            "422 | run_ids | the runs belong to 3 measurement sets, but at most two sets can be compared | "
            "give runs of one set or of two; the trend of the robot shows all sets"
        )
        read = campaign(configurations=8, seed=7)
        priors = {"joint_2": {"stiffness": 3e6, "standard_uncertainty": 3e5}}
        with_priors = posted(read, priors=priors)["id"]
        assert told(compared(with_priors)) == (
            f"422 | run_ids | the run '{with_priors}' uses priors, so the errors of both sets may be common, "
            "but the sets must be independent | identify the measurement set under external loads and "
            "without `priors`, and give the new run"
        )
        bent = {"elasticity": "coupled_joints", "link_penalty": 0.1, "loss": "squared"}
        coupled = posted(read, **bent, cross_validation={"folds": 2})["id"]
        assert told(compared(coupled)) == (
            "422 | run_ids | two measurement sets can be compared only if joints alone are elastic in the "
            f"runs, but the run '{coupled}' has elasticity coupled_joints | identify the measurement set "
            "with elasticity `joints`, and give the new run"
        )

    def test_a_joint_at_its_bound_takes_its_ratio_from_the_run_without_constraints(self, local, posted):
        bound = {"stiffness_bounds": {"joint_3": [3e6, None]}}
        pair = [campaign(seed=seed) for seed in (1, 2)]
        with_bound = [each | {"run": bound} for each in pair]
        held = js.compare(*with_bound, methods=[], ordered=True).result
        free = js.compare(*with_bound, methods=[], run={"positive": False}).result
        one, two = (posted(each, **bound) for each in pair)
        unbound = [posted(each, positive=False)["id"] for each in pair]
        ids = [one["id"], unbound[0], two["id"], unbound[1]]
        stored = posted_job(local, "comparison", one, run_ids=ids).json()["result"]
        alone = posted_job(local, "comparison", one, two["id"]).json()["result"]
        assert [entry.positive for entry in held.entries] == [True, False, True, False]
        assert 1.0 / held.ordered.joints[2].compliance_first == pytest.approx(3e6)
        ratios = [0.9992, 0.99543, 1.0063, 0.97085, 1.0069, 0.89693]
        assert [joint.ratio for joint in free.joints] == pytest.approx(ratios, rel=1e-3)
        p_values = [0.95789, 0.78576, 0.77683, 0.75662, 0.85472, 0.47711]
        assert [joint.p_value for joint in free.joints] == pytest.approx(p_values, rel=2e-3)
        for name in ("ratio", "p_value"):
            of_free = [getattr(joint, name) for joint in free.joints]
            assert [getattr(joint, name) for joint in held.joints] == pytest.approx(of_free, rel=1e-6)
        assert [joint["ratio"] for joint in stored["joints"]] == pytest.approx(ratios, rel=1e-3)
        near_bound = [0.9989, 0.9955, 1.006, 0.9776, 1.008, 0.8609]  # of runs at the bound alone
        assert [joint["ratio"] for joint in alone["joints"]] == pytest.approx(near_bound, rel=1e-3)


@pytest.fixture(scope="module")
def of_one_target():
    return js.compare(campaign(seed=3, targets={"P10": (0.1, 0.1, 0.0)}))


def shown(comparison, width=200):
    """Return the words of a comparison in a terminal."""
    console = Console(width=width, highlight=False)
    with console.capture() as caught:
        console.print(lay_out_job(COMPARISON, comparison))
    return " ".join(caught.get().split())


class TestMethods:
    def test_one_target_has_no_pose(self, of_one_target):
        assert [
            (entry.method, entry.error and entry.error.detail, len(entry.joints), len(entry.left))
            for entry in of_one_target.result.entries
        ] == [
            *[("complete_pose", THREE_TARGETS, 0, 0)] * 4,
            *[("partial_pose", None, 6, 12)] * 2,
            *[("decoupled_partial_pose", THREE_TARGETS, 0, 0)] * 2,
        ]
        compensations = [entry.compensation for entry in of_one_target.result.entries]
        assert [number is None for number in compensations] == [True] * 4 + [False] * 2 + [True] * 2

    def test_the_table_has_a_row_for_each_joint_and_one_for_a_method_without(self, of_one_target):
        head, *rows = (line for line in csv_text(entries_sheet(of_one_target)).splitlines())
        assert head.startswith(
            "side,method,weighting,constraint,characteristic_length [m],error,compensation [1],"
            "rms_residual [m],condition_number [1],joint,status,verdict,stiffness [N.m/rad],"
            "stiffness_low [N.m/rad],stiffness_high [N.m/rad],compliance [rad/(N.m)],"
        )
        assert rows[0].startswith(
            f'first,complete_pose,characteristic_length,unconstrained,,"{THREE_TARGETS}",,,'
        )
        assert len(rows) == 4 + 2 * 6 + 2
        cells = rows[4].split(",")
        assert cells[:5] == ["first", "partial_pose", "covariance", "unconstrained", ""]
        assert cells[9:12] == ["joint_1", "identified", "use"]
        numbers = [0.983614, 4.04183e-5, 2.65753, 3.84221e6, 3.71551e6, 3.97767e6, 2.60267e-7, 4.51760e-9]
        assert [float(cell) for cell in cells[6:9] + cells[12:17]] == pytest.approx(numbers, rel=1e-4)

    def test_the_terminal_shows_the_method_that_was_possible(self, of_one_target):
        words = shown(of_one_target)
        for line in [
            "Use this comparison with care: 2 reasons of its run",
            "joint_1 free 3.842 (3.716 … 3.977)",
            "joint_6 free 0.093 (",
            "PP: partial pose; free: unconstrained; in brackets: the interval; "
            "≥ 0 gives the same numbers as free: no constraint is active",
            "PP free 98.4 % 40 2.66",
            f"no complete pose, decoupled partial pose: {THREE_TARGETS}",
        ]:
            assert line in words
        cancelled = of_one_target.model_copy(update={"result": None, "state": "cancelled"})
        assert shown(cancelled, 80) == "the comparison is cancelled"

    def test_names_of_joints_are_no_markup(self, pull):
        text = json.dumps(pull)
        for name, odd in zip(NAMES[2:], ["[red]x", ":smile:", "[/]", "[link=a]"], strict=True):
            text = text.replace(name, odd)
        words = shown(js.compare(json.loads(text), resampling={"size": 8, "repetitions": 200}), 140)
        for line in [
            "mean & standard deviation of 200 fits of 8 configurations drawn at random (seed 0)",
            "joint_1 free 3.788 & 0.016 3.770 & 0.017 3.770 & 0.017 3.731 & 0.030",
            "[red]x free 2.483 & 0.029",
            ":smile: free 0.459 & 0.045",
            "[/] free 0.2506 & 0.0031",
            "[link=a] free 0.0878 & 0.0028",
            "translations divided by a length of 0.522 m",
            "No fit gave a joint a negative, infinite or undetermined stiffness.",
            "CP/L free 98.1 % 49 2.79 98.1 % & 0.087 0.0 %",
            "DPP free 98.1 % 51 1.92 98.0 % & 0.085 0.0 %",
        ]:
            assert line in words

    @pytest.mark.parametrize(
        ("options", "place", "said"),
        [
            (
                {
                    "methods": [
                        {"method": "partial_pose"},
                        {"method": "partial_pose", "weighting": "covariance"},
                    ]
                },
                "methods",
                "must not contain duplicates",
            ),
            (
                {"methods": [{"method": "partial_pose", "characteristic_length": 500.0}]},
                "methods[0].characteristic_length",
                "needs the weighting `characteristic_length`, not `covariance`",
            ),
            ({"constraints": ["positive", "positive"]}, "constraints", "must not contain duplicates"),
            ({"constraints": []}, "constraints", "must have at least 1 items, but has 0"),
            (
                {"run": {"resampling": {"size": 5, "repetitions": 5}}},
                "run",
                "must have neither `priors` nor `resampling`",
            ),
            (
                {"run": {"priors": {"joint_2": {"stiffness": 1e6, "standard_uncertainty": 1e5}}}},
                "run",
                "must have neither `priors` nor `resampling`",
            ),
        ],
    )
    def test_options_of_no_sense_are_refused(self, pull, options, place, said):
        where, reason, _ = refused(js.compare, pull, **options).split(" | ")
        assert (where, reason) == (place, f"1 fault; first: {place}: {said}")

    def test_methods_by_default(self):
        assert [(each.method, each.weighting) for each in CampaignComparison().methods] == [
            ("complete_pose", "characteristic_length"),
            ("complete_pose", "covariance"),
            ("partial_pose", "covariance"),
            ("decoupled_partial_pose", "covariance"),
        ]


@pytest.mark.parametrize(
    ("name", "cell"),
    [
        ("=1+1", "'=1+1"),
        ("+1", "'+1"),
        ("-1", "'-1"),
        ("@SUM(A1)", "'@SUM(A1)"),
        ('=HYPERLINK("x","y")', '"\'=HYPERLINK(""x"",""y"")"'),
        ("a,b", '"a,b"'),
        ('a"b', '"a""b"'),
    ],
)
def test_a_name_is_no_formula_of_a_spreadsheet(name, cell):
    assert csv_text(Sheet({"joint": [name]})).splitlines()[1] == cell


def test_a_fault_of_a_file_is_said_with_its_side(tmp_path: Path, pull):
    files = [tmp_path / name for name in ("motor.json", "secondary.json")]
    for file, document in zip(
        files, (pull, changed(pull, ("measurement_set.load_point", None))), strict=True
    ):
        file.write_text(json.dumps(document))
    result = terminal("compare", *files)
    assert (result.exit_code, result.stdout) == (2, "")
    assert " ".join(result.stderr.split()) == (
        "second.measurement_set.observations[0].load_point: observation 'c01': the load point is missing "
        "remedy: give `load_point`, in the flange frame, for the set or for each observation"
    )


def test_deflections_of_sides_are_numbers(few, second):
    """Each side shows the deflection of each configuration, whatever the fit says of it."""
    sides = js.compare(few, second, methods=[]).result.sides
    assert sides[0].configurations == ["c01", "c02"]
    assert sides[0].deflection == pytest.approx([0.0028512, 0.0040548], rel=1e-4)
    assert np.sum(sides[1].deflection) == pytest.approx(0.0089587 + 0.0121634, rel=1e-4)
