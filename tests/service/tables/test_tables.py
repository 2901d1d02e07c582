"""Tables: as files, in narrow terminals, of what was requested."""

import hashlib
import io
import json
import re
from copy import deepcopy
from pathlib import Path
from typing import get_args

import pytest
from rich.console import Console
from typer.testing import CliRunner

import jointstiff
from jointstiff.schemas.comparison import JointRatio
from jointstiff.schemas.fields import Message, Metres, Newtons
from jointstiff.schemas.geometry import GeometryRequest
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Campaign, JointResult
from jointstiff.service.cli.app import app
from jointstiff.service.cli.options import Units
from jointstiff.service.kinds.comparison.kind import _show_ratio
from jointstiff.service.kinds.run.kind import RUN
from jointstiff.service.reports.exports import explain_missing_stiffness
from jointstiff.service.reports.job import lay_out_job
from jointstiff.service.tables import terminal
from jointstiff.service.tables.report import list_request_fields
from jointstiff.service.tables.stiffness import UNITS
from jointstiff.service.tables.table import (
    Line,
    Sheet,
    build_text_table,
    format_rounded,
    number_formatter,
)
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.text import figure


def printed(report):
    console = Console(file=io.StringIO(), width=200)
    console.print(report)
    return console.file.getvalue()


def identified(document, **options):
    return jointstiff.identify(Campaign.model_validate_json(json.dumps(document)), RunOptions(**options))


@pytest.fixture(scope="module")
def document():
    return simulate_campaign(default_arm(), load="dead_weight", force=400.0, seed=1)


def test_the_terminal_offers_the_units_of_the_reports():
    assert list(get_args(Units)) == list(UNITS)


def test_at_most_three_things_to_do_and_nothing_twice(document):
    """Three readings of one target are wrong by 3 mm."""
    wrong = deepcopy(document)
    for observation in wrong["measurement_set"]["observations"][3:12:4]:
        observation["readings"][0]["loaded"][0] += 3e-3
    bumped = identified(wrong)
    assert len(bumped.result.warnings) > 3
    text = printed(lay_out_job(RUN, bumped))
    to_do = text.split("To do\n")[1].splitlines()
    assert 0 < len(to_do) <= 3
    assert text.startswith("Do not use") or text.startswith("Use with care")
    said = [line.strip() for line in text.splitlines() if line.strip()]
    assert len(said) == len(set(said))
    in_one_line = " ".join(text.split())
    for reason in bumped.result.assessment.reasons[:3]:
        assert in_one_line.count(reason.message) == 1
        assert in_one_line.count(reason.remedy) <= 1


def test_shares_of_the_budget_are_those_of_the_result(document):
    """In percent of each joint's compliance, the least and the greatest."""
    noise = document["measurement_set"]["noise"] | {"force": {"scale": 0.02}, "load_point": 0.001}
    found = identified(document | {"measurement_set": document["measurement_set"] | {"noise": noise}})
    budget = found.result.budget
    sizes = {joint.name: joint.compliance for joint in found.result.joints}
    lines = re.findall(
        r"uncertainty from .*?: ± ([\d.e-]+)(?: to ([\d.e-]+))? %",
        printed(lay_out_job(RUN, found, details=True)),
    )
    assert len(lines) == len(budget.components) > 2
    for part, ends in zip(budget.components, lines, strict=True):
        halves = [budget.coverage_factor * u for u in part.contributions]
        shares = [100.0 * half / sizes[name] for name, half in zip(budget.joints, halves, strict=True)]
        low, high = float(ends[0]), float(ends[1] or ends[0])
        assert [low, high] == pytest.approx([min(shares), max(shares)], rel=0.06)


@pytest.mark.parametrize("half", [3e-4, 0.0021, 0.014, 0.15, 0.96, 7.0])
def test_a_ratio_has_the_digits_that_its_interval_allows(half):
    """The last digit counts between 0.5 and 5 % of the half-width, of the ratio and of both ends."""
    ratio = 12.3456789
    joint = JointRatio(name="a", ratio=ratio, ratio_interval=(ratio - half, ratio + half))
    shown = _show_ratio(joint)
    low, high = shown.interval.split(" … ")
    for text, value in ((shown.value, ratio), (low, ratio - half), (high, ratio + half)):
        last = 10.0 ** -len(text.partition(".")[2])
        assert 0.005 * half < last <= 0.05 * half
        assert abs(float(text) - value) <= 0.5001 * last
    open_above = JointRatio(name="a", ratio=ratio, ratio_interval=(ratio, None))
    assert _show_ratio(open_above).cell.text == "12.3 (12.3 … no limit)"


EXAMPLES = Path(__file__).parents[3] / "examples"
WIDTH = 80
COMMANDS = (
    "identify campaign.json --details",
    "compare campaign.json",
    pytest.param("plan campaign.json", marks=pytest.mark.slow),
    "predict campaign.json EXAMPLES/postures.csv --load-point 0,0,120",
    "correct campaign.json EXAMPLES/pocket.src -o out.src --accuracy-option off --force 0,0,-500",
    "import EXAMPLES/readings.csv --encoders motor --load-point 0,0,120",
    "robots 'KUKA KR 210 R2700'",
    pytest.param("geometry EXAMPLES/sweeps.json", marks=pytest.mark.slow),
    pytest.param("compare campaign.json secondary.json", marks=pytest.mark.slow),
    "map campaign.json --options plate.json",
)
"""Commands of README and the guides that print tables."""


PLATE = {
    "area": [[1.2, -0.2, 0.6], [1.6, 0.2, 0.9]],
    "grid": [2, 2, 2],
    "place": [0, 0, 0.25],
    "directions": [[0, 0, -1]],
    "force": [0, 300, -500],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaigns")
    (folder / "plate.json").write_text(json.dumps(PLATE))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for command in ("campaign.json", "secondary.json --encoders secondary --seed 2"):
            assert CliRunner().invoke(app, f"simulate {command}").exit_code == 0
    return folder


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_prints_no_column_of_letters(command, folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", str(WIDTH))
    done = CliRunner().invoke(app, command.replace("EXAMPLES", str(EXAMPLES)))
    assert done.exit_code == 0, done.output
    lines = done.output.splitlines()
    assert max(map(len, lines)) <= WIDTH
    assert [line for line in lines if len(line.strip()) == 1] == []


def sweeps(unit, count=4):
    return {
        "units": {"length": unit, "angle": "deg"},
        "noise": {"sigma": 0.01},
        "sweeps": [{"joint": "joint_1", "observations": [POSE] * count}],
        "base": "axes",
        "base_height": 300.0,
    }


POSE = {"joints": [10.0, -20.0], "targets": {"P10": (1500.25, 0.0, -0.0)}}


@pytest.mark.parametrize(
    ("value", "form", "text"),
    [
        (1037.4, ".4g", "1037"),
        (1037.4, ".3g", "1040"),
        (-0.0, ".3f", "0.000"),
        (-0.0001, ".2f", "0.00"),
        (-0.51, ".1f", "-0.5"),
        (2.5e7, ".3g", "2.5 · 10⁷"),
        (3e-9, ".3g", "3 · 10⁻⁹"),
        (0.0, ".4g", "0"),
    ],
)
def test_numbers_have_one_format(value, form, text):
    assert figure(value, form) == number_formatter(form)(value) == text


def test_a_number_has_two_digits_of_its_uncertainty():
    assert (format_rounded(0.26951, 0.0213), format_rounded(12.346, 1.0)) == ("0.270", "12.3")
    assert format_rounded(1234.56, float("inf")) == format_rounded(1234.56, None) == "1235"
    assert (format_rounded(-0.0004, 0.02), format_rounded(12345.6, 321.0)) == ("0.000", "12350")
    assert format_rounded(None) == "—"


def test_long_readings_are_counted_and_hashed():
    request = GeometryRequest.model_validate(sweeps("mm", 100))
    observations = json.dumps([POSE] * 100, separators=(",", ":"))
    digest = hashlib.sha256(observations.encode()).hexdigest()
    assert (
        dict(list_request_fields(request))["Sweeps"]
        == f"joint joint_1, observations 100 entries, SHA-256 {digest}"
    )


class Part(Message):
    """A part of a row."""

    ends: Metres[tuple[tuple[float, float], tuple[float, float]]]


class Row(Message):
    """A row."""

    name: str
    force: Newtons[tuple[float, float] | None]
    part: Part | None
    notes: list[str]


ROWS = [
    Row(name="a", force=(1.0, 2.0), part=Part(ends=((0.1, 0.2), (0.3, 0.4))), notes=["one", "two"]),
    Row(name="b", force=None, part=None, notes=[]),
]
COLUMNS = {"label": "name", "force {x y}": "force", "{x y} from {low high}": "part.ends", "notes": "notes"}


def test_components_have_columns_and_units_come_from_fields():
    assert Sheet.from_messages(ROWS, COLUMNS, {"m": (1e3, "mm")}).columns == {
        "label": ["a", "b"],
        "force x [N]": [1.0, None],
        "force y [N]": [2.0, None],
        "x from low [mm]": [100.0, None],
        "x from high [mm]": [200.0, None],
        "y from low [mm]": [300.0, None],
        "y from high [mm]": [400.0, None],
        "notes": ["one; two", None],
    }
    assert "x from low [m]" in Sheet.from_messages(ROWS, COLUMNS).columns
    assert Sheet.from_messages([], COLUMNS).columns == {}


@pytest.mark.parametrize("unit", sorted(UNITS))
@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_lower_limit_is_shown_but_of_a_result_that_is_not_to_be_used(unit, kind):
    """A refuted model gives none, in tables as in the joint's reason."""
    rigid = JointResult(
        name="joint_1",
        kind=kind,
        status="at_bound",
        verdict="use_with_care",
        reason=None,
        compliance=0.0,
        standard_uncertainty=1e-7,
        compliance_interval=(0.0, 2e-7),
        stiffness=None,
        stiffness_interval=(5e6, None),
        stiffness_at_least=6e6,
    )
    refuted = rigid.model_copy(update={"verdict": "do_not_use"})
    shown = UNITS[unit].show_joint(rigid)
    assert shown.value_cell.text.startswith(("< ", "> "))
    assert shown.interval_cell.text == "one-sided"
    assert UNITS[unit].show_joint(refuted).cell == Line("—", "dim")
    assert "at least" in explain_missing_stiffness(rigid)
    assert "at least" not in explain_missing_stiffness(refuted)


def test_a_column_without_a_name_and_without_a_cell_is_printed():
    """As of a trend in which no joint changed yet."""
    table = build_text_table(["joint", "", "p-value"], [["joint_1", "", "0.3"]], left_aligned=[0, 1])
    assert "joint_1" in printed(terminal.lay_out_parts([table]))
