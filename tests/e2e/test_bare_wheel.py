"""The wheel without an extra: the command for files, `import jointstiff`, and what names a missing extra."""

import json
import re
import subprocess
import sys
from importlib.metadata import Distribution
from pathlib import Path

import pytest
from support.wheel import install_bare, newest_python

pytestmark = [pytest.mark.process, pytest.mark.timeout(600)]

DIRECT = {"numpy", "scipy", "pin", "cvxpy-base", "clarabel", "pydantic", "typer", "rich", "eaik"} | {
    "threadpoolctl"
}
"""The tenth is threadpoolctl: without it the last digits depend on the threads of the user's program. None of
the other nine can go for it: our code imports each of them, and none limits the threads of linear algebra."""
OF_EXTRAS = [
    "anyio",
    "distributed",
    "fastapi",
    "h5py",
    "httpx2",
    "matplotlib",
    "openpyxl",
    "psycopg",
    "segno",
]
OF_EXTRAS += ["pyarrow", "robotprograms", "sqlalchemy"]
LIBRARY = """
import json
import jointstiff as js

run = js.identify("campaign.json")
jobs = [
    run,
    js.compare("campaign.json", "second.json"),
    js.plan("campaign.json", readings=6),
]
cases = js.predict(run, "examples/postures.csv", load_point=(0.0, 0.0, 120.0)).cases
imported = js.read("examples/readings.csv", encoders="motor", load_point=(0.0, 0.0, 120.0))
for name in ("model.mjcf", "model.csv", "report.html"):
    run.save(name)
print(json.dumps([[job.state for job in jobs], len(cases) > 0, imported.answer.tables[0].name]))
"""
EXTRAS = {
    "serve": "service",
    "worker --database sqlite:///worked.db": "service",
    "demo --once": "service",
    "keys create tablet --role viewer": "service",
    "keys list": "service",
    "post campaign.json": "client",
    "measure campaign.json --server http://127.0.0.1:9 --source simulated:1 --goal 15%": "client",
    "export campaign.json -o model.xlsx": "excel",
    "correct campaign.json examples/pocket.src -o new.src --accuracy-option off --force 0,0,9": "programs",
}
"""Commands that need an extra, and the extra."""


@pytest.fixture(scope="module", params=["this", pytest.param("newest", marks=pytest.mark.slow)])
def bare(request, built_wheel, tmp_path_factory):
    """The folder `bin` of an environment with the wheel and its own dependencies alone."""
    folder = tmp_path_factory.mktemp("bare")
    install_bare(built_wheel, folder, sys.executable if request.param == "this" else newest_python())
    return folder / "bin"


@pytest.fixture(scope="module")
def place(bare, tmp_path_factory):
    """A folder with two campaigns and the example files."""
    folder = tmp_path_factory.mktemp("place")
    for command in ("simulate campaign.json", "simulate second.json --encoders secondary", "examples"):
        carried_out(bare, folder, command)
    return folder


def ran(folder: Path, *command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=240)


def carried_out(bare: Path, folder: Path, command: str, status: int = 0) -> subprocess.CompletedProcess[str]:
    done = ran(folder, str(bare / "jointstiff"), *command.split())
    assert done.returncode == status, done.stdout + done.stderr
    return done


def test_the_wheel_has_ten_direct_dependencies(bare):
    (metadata,) = bare.parent.glob("lib/python3*/site-packages/jointstiff-*.dist-info")
    required = [each for each in Distribution.at(metadata).requires or [] if "extra ==" not in each]
    assert {re.match(r"[\w-]+", each)[0].lower() for each in required} == DIRECT


def test_no_library_of_an_extra_is_there(bare):
    program = (
        f"from importlib.util import find_spec; print([each for each in {OF_EXTRAS} if find_spec(each)])"
    )
    assert ran(bare, str(bare / "python"), "-c", program).stdout == "[]\n"


@pytest.mark.parametrize(
    "command",
    [
        "identify campaign.json",
        "compare campaign.json second.json",
        "plan campaign.json --readings 6",
        "predict campaign.json examples/postures.csv --load-point 0,0,120",
        "import examples/readings.csv --encoders motor --load-point 0,0,120",
        "geometry examples/sweeps.json --robot examples/nominal.json",
        "measure campaign.json --goal 15% --source simulated:1 --yes",
        "export campaign.json -o exported.mjcf",
        "report campaign.json -o sheet.html",
        "robots",
    ],
    ids=lambda command: command.split()[0],
)
def test_commands_on_files_need_no_extra(command, bare, place):
    done = carried_out(bare, place, command)
    assert done.stdout + done.stderr


def test_the_library_needs_no_extra(bare, place):
    done = ran(place, str(bare / "python"), "-c", LIBRARY)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == [["succeeded"] * 3, True, "readings.csv"]


@pytest.mark.parametrize("command", EXTRAS)
def test_a_command_without_its_extra_names_it(command, bare, place):
    lines = carried_out(bare, place, command, status=2).stderr.splitlines()
    assert lines[-2].endswith(f" needs the extra `{EXTRAS[command]}`, which is not installed")
    assert lines[-1] == f'  remedy: pip install "jointstiff[{EXTRAS[command]}]"'
    assert not any("Traceback" in line for line in lines)


NAMES = {
    "js.Client": ("Client", "client"),
    "run.plot()": ("plot", "plot"),
    "run.to_frame()": ("to_frame", "frames"),
    "run.save('model.xlsx')": ("an Excel workbook", "excel"),
    "js.correct(run, 'examples/pocket.src', accuracy_option='off', force=(0, 0, -500))": (
        "a program file",
        "programs",
    ),
}
"""Names of the library that need an extra: how the message calls them, and the extra."""
REFUSALS = f"""
import json
import jointstiff as js

run, refusals = js.identify("campaign.json"), []
for statement in {list(NAMES)}:
    try:
        eval(statement)
    except ImportError as error:
        refusals.append(str(error))
print(json.dumps(refusals))
"""


def test_a_name_of_the_library_without_its_extra_names_it(bare, place):
    done = ran(place, str(bare / "python"), "-c", REFUSALS)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == [
        f'{what} needs the extra `{extra}`, which is not installed: pip install "jointstiff[{extra}]"'
        for what, extra in NAMES.values()
    ]
