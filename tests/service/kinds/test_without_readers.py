"""Without `robotprograms`, a program file is answered with the extra that brings it: Python and HTTP."""

import json
import sys

import pytest
from support.api import posted
from support.kinds import TEXT
from support.programs import options

import jointstiff as js
from jointstiff.service.problems import MissingExtraError
from jointstiff.simulator import default_arm, simulate_campaign

CAMPAIGN = simulate_campaign(default_arm(), load="pull", configurations=6, seed=1)
REASON = "a program file needs the extra `programs`, which is not installed"
REMEDY = 'pip install "jointstiff[programs]"'


@pytest.fixture
def without_readers(monkeypatch):
    """Let each import of the readers fail, and forget the modules that have imported them."""
    importing = tuple(
        f"jointstiff.service.kinds.correction.{name}" for name in ("loads", "path", "programs", "text")
    )
    for name in [name for name in sys.modules if name.startswith((*importing, "robotprograms"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "robotprograms", None)


@pytest.mark.usefixtures("without_readers")
def test_python_names_the_extra(tmp_path):
    program = tmp_path / "a.src"
    program.write_bytes(TEXT.encode("latin-1"))
    with pytest.raises(MissingExtraError) as missing:
        js.correct(js.identify(CAMPAIGN), program, accuracy_option="off", force=(0.0, 0.0, -500.0))
    assert str(missing.value) == f"{REASON}: {REMEDY}"


@pytest.mark.usefixtures("without_readers")
def test_the_api_names_the_extra(client):
    run = posted(client, CAMPAIGN)
    stated = json.dumps(options("krl") | {"run_id": run["id"]})
    files = [("files", ("a.src", TEXT.encode("latin-1")))]
    answer = client.post("/v1/corrections", data={"options": stated}, files=files)
    problem = answer.json()
    assert (answer.status_code, problem["detail"], problem["remedy"]) == (501, REASON, REMEDY)
