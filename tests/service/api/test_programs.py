"""Compensated programs over HTTP: a form with files, a small answer, files and a table beside it."""

from __future__ import annotations

import json

import pytest
from support.api import file_at, posted
from support.programs import options, path, tool_poses

from jointstiff.schemas.program import Program
from jointstiff.service.programs.formats import read_program
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.programs import program_text

TEXT = program_text("krl", tool_poses(path(8)), 4)


@pytest.fixture(scope="module")
def run_id(local):
    campaign = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    return posted(local, campaign)["id"]


def post(local, run_id, text=TEXT, name="cell.src", headers=None, kind="krl", **changes):
    stated = options(kind, **changes) | {"run_id": run_id}
    return local.request(
        "POST",
        "/v1/programs",
        files=[("files", (name, text.encode("latin-1")))],
        data={"options": json.dumps(stated)},
        headers=headers,
    )


def test_a_program_is_corrected_and_handed_back(local, run_id):
    answer = post(local, run_id)
    assert answer.status_code == 201, answer.text
    assert len(answer.content) < 20_000
    program = Program.model_validate(answer.json())
    assert program.state == "succeeded"
    assert (program.result.points, program.result.corrected) == (8, 8)
    assert {file.content for file in [*program.result.files, *program.request.files]} == {None}
    address = answer.headers["location"]
    file = local.get(file_at(address, "program"))
    assert file.headers["content-disposition"] == "attachment; filename*=UTF-8''cell-corrected.src"
    assert len(read_program([("cell.src", file.content)]).targets) == 8
    assert local.get(file_at(address, "program"), params={"file": "cell.src"}).content == file.content
    assert local.get(file_at(address, "program"), params={"file": "cell.dat"}).status_code == 422
    table = local.get(file_at(address, "points.csv"))
    assert table.headers["content-type"].startswith("text/csv")
    assert len(table.text.splitlines()) == 9


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"run_id": "nothing"}, "run_id"),
        ({"accuracy_option": "compensates_load"}, "accuracy_option"),
        ({"load": None}, "options"),
        ({"limits": {"displacement": -1.0}}, "options.limits.displacement"),
        ({"units": None}, "options.units"),
    ],
)
def test_requests_that_cannot_be(local, run_id, changes, where):
    answer = post(local, changes.pop("run_id", run_id), **changes)
    assert answer.status_code == 422
    assert answer.json()["where"] == where, answer.text


def test_two_files_of_one_name_are_refused(local, run_id):
    files = [("files", ("a.src", TEXT.encode()))] * 2
    stated = {"options": json.dumps(options("krl") | {"run_id": run_id})}
    assert local.request("POST", "/v1/programs", files=files, data=stated).json()["where"] == "files"


@pytest.mark.parametrize("mark", [True, False])
def test_a_corrected_program_is_not_corrected_again(local, run_id, mark):
    answer = post(local, run_id, mark=mark)
    corrected = local.get(file_at(answer.json(), "program")).content.decode("latin-1")
    assert ("; Jointstiff run " in corrected) == mark
    again = post(local, run_id, corrected, mark=mark)
    assert again.status_code == 422
    assert "the original program" in json.dumps(again.json())
    assert post(local, run_id, mark=mark).status_code == 201  # the program itself may be corrected anew
