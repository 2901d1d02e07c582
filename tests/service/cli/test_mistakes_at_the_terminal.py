"""Mistakes at the terminal: the answer names the cause, and its remedy, carried out, works."""

import json

import pytest
from support.documents import campaign
from support.terminal import terminal

POSTURES = """\
label,J1 [deg],J2 [deg],J3 [deg],J4 [deg],J5 [deg],J6 [deg],Fx [N],Fy [N],Fz [N]
a,0,0,0,0,30,0,0,0,-500
"""


AREA = {
    "area": [[1.4, -0.2, 0.6], [1.8, 0.2, 0.6]],
    "grid": [2, 2, 1],
    "place": [0, 0, 0.25],
    "force": [0, 0, -500],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mistakes")
    (folder / "pull.json").write_text(json.dumps(campaign("pull", 8, 2)))
    (folder / "postures.csv").write_text(POSTURES)
    (folder / "bounds.json").write_text(json.dumps({"stiffness_bounds": {"joint_2": [1e6, None]}}))
    (folder / "map.json").write_text(json.dumps(AREA))
    return folder


@pytest.mark.parametrize(
    ("mistake", "answer", "correction"),
    [
        ("identify pul.json", "does not exist", "identify pull.json"),
        ("identify pull.json --method magic", "'partial_pose'", "identify pull.json --method partial_pose"),
        ("identify pull.json --unit furlong", "'Nm/arcmin'", "identify pull.json --unit Nm/arcmin"),
        ("identify pull.json --cause moon", "give one of: constant_force", "identify pull.json --cause play"),
        (
            "identify pull.json --confidence 95",
            "less than or equal to",
            "identify pull.json --confidence 0.95",
        ),
        ("identify pull.json --leave-out c99", "no observation 'c99'", "identify pull.json --leave-out c08"),
        (
            "identify pull.json --confidence 95%",
            "'95%' must be a number",
            "identify pull.json --confidence 0.95",
        ),
        ("identify pull.json --alpha 0.05", "--confidence", "identify pull.json --confidence 0.95"),
        (
            "identify pull.json --bounds joint_2=1e6",
            "State `stiffness_bounds` in a JSON file, and give the file by --options",
            "identify pull.json --options bounds.json",
        ),
        (
            "map pull.json --area 1400,-200,600",
            "State `area` in a JSON file, and give the file by --options",
            "map pull.json --options map.json",
        ),
        (
            "plan pull.json --readings many --candidates 50",
            "'many' must be a whole number",
            "plan pull.json --readings 1 --candidates 50",
        ),
        ("identify pull.json --resample many", "many", "identify pull.json --resample 6:10"),
        ("identify pull.json --weight 3", "No such option", "identify pull.json --weighting uniform"),
        (
            "predict pull.json postures.csv",
            "--load-point",
            "predict pull.json postures.csv --load-point 0,0,120",
        ),
        (
            "predict pull.json postures.csv --load-point 0,0,99999",
            "check the unit of the point",
            "predict pull.json postures.csv --load-point 0,0,99.999",
        ),
        ("plan pull.json --readings 0 --candidates 50", "1", "plan pull.json --readings 1 --candidates 50"),
    ],
)
def test_a_mistake_is_answered_with_a_remedy_that_works(folder, monkeypatch, mistake, answer, correction):
    monkeypatch.chdir(folder)
    refused = terminal(*mistake.split(), width=200)
    assert refused.exit_code != 0
    said = " ".join((refused.stdout + refused.stderr).split())
    assert answer in said
    assert "openapi" not in said
    assert terminal(*correction.split(), width=200).exit_code == 0
