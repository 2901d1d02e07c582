"""Comparisons of stored runs: methods side by side, two sets; as a job, as CSV and in a terminal."""

import csv
import io
import json

import pytest
from pydantic import ValidationError
from rich.console import Console
from support.jobs import set_of
from support.shared_data import shared
from support.terminal import terminal

import jointstiff
from jointstiff.schemas.comparison import CampaignComparison, ComparedMethod, ComparisonRequest
from jointstiff.schemas.run import RunRequest
from jointstiff.service.kinds.comparison import COMPARISON, entries_sheet
from jointstiff.service.reports.job import job_report
from jointstiff.service.tables.files import csv_text
from jointstiff.service.tables.table import Sheet
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.errors import RequestError

PULL = {"load": "pull", "seed": 3}


def stored(parts, document, **options):
    """Store robot and set of a campaign, and a run; return the run's id."""
    return identified(parts, set_of(parts, document), **options)


def identified(parts, set_id, **options):
    body = {"measurement_set_id": set_id, "elasticity": "joints", **options}
    return parts.jobs["run"].create(RunRequest.model_validate(body), None).id


def set_of_run(parts, run_id):
    return parts.jobs["run"].current(run_id).request.measurement_set_id


def two_encoders(parts, **options):
    documents = [
        simulate_campaign(
            default_arm(encoders), load="pull", encoders=encoders, seed=7, sigma=2e-5 * (1 + k), **options
        )
        for k, encoders in enumerate(("motor", "secondary"))
    ]
    return [stored(parts, document) for document in documents]


def made(parts, *run_ids, **options):
    body = ComparisonRequest(run_ids=list(run_ids), **options)
    return parts.jobs["comparison"].current(parts.jobs["comparison"].create(body, None).id)


def test_a_configuration_that_a_run_leaves_out_has_no_rest(parts):
    run = stored(parts, simulate_campaign(default_arm(), **PULL))
    other = identified(parts, set_of_run(parts, run), leave_out=["c03"])
    result = made(parts, other, run).result
    assert [entry.left.count(None) for entry in result.entries] == [1, 0]
    assert None not in result.sides[0].deflection


class TestTwoSets:
    def test_a_joint_at_its_bound_takes_its_ratio_from_the_run_without_constraints(self, parts):
        """The door makes that run; without it the estimate that the run's model keeps is nearly the same."""
        documents = [simulate_campaign(default_arm(), load="pull", seed=seed) for seed in (1, 2)]
        for document in documents:
            document["run"] = {"stiffness_bounds": {"joint_3": [3e6, None]}}
        pair = jointstiff.compare(*documents, methods=[], ordered=True)
        assert [entry.positive for entry in pair.result.entries] == [True, False] * 2
        free = jointstiff.compare(*documents, methods=[], run={"positive": False}).result
        for joint, other in zip(pair.result.joints, free.joints, strict=True):
            assert joint.ratio == pytest.approx(other.ratio)
            assert joint.p_value == pytest.approx(other.p_value)
        runs = [stored(parts, document, **document["run"]) for document in documents]
        held = made(parts, *runs).result
        for joint, other in zip(held.joints, free.joints, strict=True):
            assert joint.ratio == pytest.approx(other.ratio, rel=1e-3)
        assert 1 / pair.result.ordered.joints[2].compliance_first == pytest.approx(3e6)

    def test_units_a_and_b_are_two_robots(self, parts):
        document = simulate_campaign(default_arm(), **PULL)
        first = stored(parts, document)
        document["robot"]["name"] = "another"
        assert not made(parts, first, stored(parts, document)).result.warnings
        other = stored(parts, simulate_campaign(default_arm(wrist_offset=0.02), **PULL))
        (warning,) = made(parts, first, other).result.warnings
        assert warning.code == "robot_models_differ"

    def test_warnings_say_which_side(self, parts):
        document = simulate_campaign(default_arm(), **PULL)
        first = stored(parts, document)
        document["measurement_set"]["observations"][4]["force"] = [0.0, 0.0, 0.0]
        result = made(parts, first, stored(parts, document)).result
        places = {(warning.code, warning.where[:23]) for warning in result.warnings if warning.where}
        assert ("zero_load", "second.observations[4]."[:23]) in places or any(
            code == "zero_load" and where.startswith("second.observations[4]") for code, where in places
        )
        assert {reason.where.split(".")[0] for reason in result.assessment.reasons} == {"second"}


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"priors": {"joint_2": {"stiffness": 3e6, "standard_uncertainty": 3e5}}}, "not independent"),
        ({"elasticity": "coupled_joints", "link_penalty": 0.1, "loss": "squared"}, "joints only"),
    ],
)
def test_runs_that_cannot_be_two_sides_are_refused(parts, options, reason):
    first, second = two_encoders(parts, configurations=8)
    options["cross_validation"] = {"folds": 2}
    other = identified(parts, set_of_run(parts, first), **options)
    with pytest.raises(RequestError, match=reason):
        made(parts, other, second)


def test_what_cannot_be_compared_is_refused_with_its_place(parts):
    document = simulate_campaign(default_arm(), **PULL)
    first = stored(parts, document)
    with pytest.raises(RequestError) as refused:
        made(parts, first, "nobody")
    assert refused.value.where == "run_ids[1]"
    others = [stored(parts, simulate_campaign(default_arm(), load="pull", seed=seed)) for seed in (4, 5)]
    with pytest.raises(RequestError, match="3 measurement sets"):
        made(parts, first, *others)
    document["robot"]["model"]["urdf"] = document["robot"]["model"]["urdf"].replace("joint_3", "elbow")
    with pytest.raises(RequestError, match="have different joints"):
        made(parts, first, stored(parts, document))


@pytest.mark.parametrize(
    "options",
    [
        {"methods": [{"method": "partial_pose"}, {"method": "partial_pose", "weighting": "covariance"}]},
        {"methods": [{"method": "partial_pose", "characteristic_length": 0.5}]},
        {"constraints": ["positive", "positive"]},
        {"constraints": []},
        {"run": {"resampling": {"size": 5, "repetitions": 5}}},
        {"run": {"priors": {"joint_2": {"stiffness": 1e6, "standard_uncertainty": 1e5}}}},
    ],
)
def test_options_that_make_no_sense(options):
    with pytest.raises(ValidationError):
        CampaignComparison.model_validate(options)


def test_a_method_that_the_readings_cannot_support_is_an_entry_without_numbers():
    document = simulate_campaign(default_arm(), **PULL, targets={"P10": (0.1, 0.1, 0.0)})
    found = jointstiff.compare(document)
    for entry in found.result.entries:
        if entry.method == "partial_pose":
            assert entry.error is None
        else:
            assert "needs 3 targets" in entry.error.detail
            assert (entry.joints, entry.compensation, entry.left) == ([], None, [])
    rows = read(csv_text(entries_sheet(found)))
    assert [row["joint"] != "" for row in rows] == [False] * 4 + [True] * 12 + [False] * 2
    assert all(("needs 3 targets" in row["error"]) == (row["joint"] == "") for row in rows)
    assert "no complete pose, decoupled partial pose" in shown(found, 200)


@pytest.fixture(scope="module")
def comparison():
    return jointstiff.compare(
        shared("simulated/dead_weight_motor"), resampling={"size": 10, "repetitions": 200}
    )


def read(text):
    return list(csv.DictReader(io.StringIO(text, newline="")))


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@SUM(A1)", '=HYPERLINK("x","y")', "a,b", 'a"b'])
def test_a_name_is_no_formula(name):
    (row,) = read(csv_text(Sheet({"joint": [name]})))
    assert row["joint"] == (name if name[0] == "a" else f"'{name}")


def shown(comparison, width=80):
    console = Console(width=width, file=io.StringIO(), highlight=False)
    console.print(job_report(COMPARISON, comparison))
    return console.file.getvalue()


def with_joints(comparison, names):
    """The same with that many joints, which all have the numbers of the sixth."""
    entries = []
    for entry in comparison.result.entries:
        joints = [entry.joints[5].model_copy(update={"name": name}) for name in names]
        drawn = [entry.resampling.joints[5].model_copy(update={"name": name}) for name in names]
        resampling = entry.resampling.model_copy(update={"joints": drawn})
        entries.append(entry.model_copy(update={"joints": joints, "resampling": resampling}))
    result = comparison.result.model_copy(update={"entries": entries})
    return comparison.model_copy(update={"result": result})


def test_a_name_is_no_markup(comparison):
    names = ["[/]", "[red]x", ":smile:", "[link=a]"]
    text = shown(with_joints(comparison, names), 200)
    rows = [line.split()[0] for line in text.splitlines() if " free " in line]
    assert rows[:4] == names


def test_a_comparison_without_result_says_how_it_stands(comparison):
    ended = comparison.model_copy(update={"result": None, "state": "cancelled"})
    assert shown(ended).strip() == "the comparison is cancelled"


def test_the_default_methods_are_the_papers_and_the_complete_pose_by_covariance():
    methods = [(each.method, each.weighting) for each in CampaignComparison().methods]
    assert methods == [
        ("complete_pose", "characteristic_length"),
        ("complete_pose", "covariance"),
        ("partial_pose", "covariance"),
        ("decoupled_partial_pose", "covariance"),
    ]
    assert ComparedMethod(method="partial_pose").weighting == "covariance"


def test_a_file_that_is_refused_says_which(tmp_path):
    for encoders in ("motor", "secondary"):
        document = simulate_campaign(default_arm(encoders), encoders=encoders, seed=7)
        if encoders == "secondary":
            document["measurement_set"]["load_point"] = None
        (tmp_path / f"{encoders}.json").write_text(json.dumps(document))
    shown = terminal("compare", tmp_path / "motor.json", tmp_path / "secondary.json")
    assert shown.exit_code == 2
    assert "second.measurement_set.observations[0].load_point" in shown.output
