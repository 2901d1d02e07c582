"""Every command without the libraries of the extras: it works, or names the extra in two lines."""

import json
import subprocess
import sys

import pytest

from jointstiff.service.cli.app import _LATE_COMMANDS, app
from jointstiff.service.problems import EXTRAS

WITHOUT = {
    "simulate campaign.json --configurations 12": "",
    "simulate second.json --configurations 12 --encoders secondary": "",
    "examples": "",
    "robots": "",
    "rehearse campaign.json": "",
    "identify campaign.json": "",
    "compare campaign.json second.json --paper paper.html": "",
    "compare campaign.json second.json --paper paper.csv": "",
    "compare campaign.json second.json --paper paper.pdf": "reports",
    "compare campaign.json second.json --paper paper.svg": "plot",
    "plan campaign.json --readings 6": "",
    "map campaign.json --force 0,0,-500 --place 0,0,250 --options map.json": "",
    "geometry examples/sweeps.json --robot examples/nominal.json": "",
    "gearbox examples/weight_step.json": "",
    "predict campaign.json examples/postures.csv --load-point 0,0,120": "",
    "correct campaign.json examples/pocket.src -o new.src --accuracy-option off --force 0,0,9": "programs",
    "correct campaign.json examples/pocket.src --explain": "programs",
    "correct campaign.json examples/poses.csv --tool 0,0,200,0,0,0 --force 0,0,-500 -o corrected.csv": "",
    "import examples/readings.csv --encoders motor --load-point 0,0,120": "",
    "measure campaign.json --goal 15% --source simulated:1 --yes": "",
    "measure campaign.json --server http://127.0.0.1:9 --source simulated:1 --goal 15%": "client",
    "export campaign.json -o model.mjcf": "",
    "export campaign.json -o model.xlsx": "excel",
    "report campaign.json -o sheet.html": "",
    "report campaign.json -o sheet.pdf": "reports",
    "post campaign.json": "client",
    "serve": "service",
    "worker --database sqlite:///worked.db": "service",
    "demo --once": "service",
    "archive everything.zip --database sqlite:///worked.db": "service",
    "restore everything.zip --database sqlite:///worked.db": "service",
    "status": "service",
    "keys list": "service",
}
"""Commands in their order, and the extra that each one needs; empty for none."""
AREA = [[1.4, -0.2, 0.6], [1.8, 0.2, 0.6]]
SCRIPT = """
import json, sys, traceback
libraries, commands = json.loads(sys.argv[1])
for library in libraries:
    sys.modules[library] = None  # an import of the library fails, as if it were not installed
from typer.testing import CliRunner
from jointstiff.service.cli.app import app
found = {}
for command in commands:
    done = CliRunner().invoke(app, command.split())
    failure = done.exception
    unexpected = failure is not None and not isinstance(failure, SystemExit)
    text = "".join(traceback.format_exception(failure)) if unexpected else done.stderr
    found[command] = [done.exit_code, text]
json.dump(found, open("found.json", "w"))
"""


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    """Return exit status and standard error of each command, in a process without the libraries."""
    folder = tmp_path_factory.mktemp("bare")
    (folder / "map.json").write_text(json.dumps({"area": AREA, "grid": [2, 2, 1]}))
    argument = json.dumps([list(EXTRAS), list(WITHOUT)])
    command = [sys.executable, "-P", "-c", SCRIPT, argument]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "found.json").read_text())


def test_every_command_is_tried():
    plain = {each.name or each.callback.__name__ for each in app.registered_commands if each.callback}
    names = {*plain, *_LATE_COMMANDS, "keys"} - {"<lambda>"}
    assert names == {command.split()[0] for command in WITHOUT}


@pytest.mark.process
@pytest.mark.timeout(900)
@pytest.mark.parametrize("command", WITHOUT)
def test_a_command_without_its_extra_answers_in_two_lines(command, outcomes):
    status, text = outcomes[command]
    extra = WITHOUT[command]
    assert status == (2 if extra else 0), text
    if extra:
        reason, remedy = text.rstrip("\n").splitlines()[-2:]
        assert reason.endswith(f" needs the extra `{extra}`, which is not installed"), text
        assert remedy.startswith(f'  remedy: pip install "jointstiff[{extra}]"'), text
        assert "Traceback" not in text
