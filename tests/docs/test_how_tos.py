"""The commands and the code of the guides, run as a reader would run them, in the order of the page,
from an empty folder at 80 columns.

Plain `jointstiff` commands run in this process, which has imported everything; the shell runs the rest.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import httpx2
import pytest
from support.browsing import post
from support.guide_files import ROOT, blocks_of
from typer.testing import CliRunner

from jointstiff.service.cli.app import app
from jointstiff.simulator.files import example_files

GUIDES = (
    "README.md",
    "docs/first-campaign.md",
    "docs/robots.md",
    "docs/two-encoders.md",
    "docs/without-a-load.md",
    "docs/import.md",
    "docs/predict.md",
    "docs/exports.md",
    "docs/report.md",
    "docs/maps.md",
    "docs/elastic-links.md",
    "docs/geometry.md",
    "docs/plan.md",
    "docs/live.md",
    "docs/compensate.md",
    "docs/python.md",
    "docs/webhooks.md",
)
PLACEHOLDERS = {"set": '"measurement_set_id": "…"', "run": '"run_ids": ["…", "…"]'}
"""What a guide writes for the ids of stored sets and runs."""

NOT_RUN = {
    "scripts/run ": "sets an environment up; test_demo.py runs its program, jointstiff demo",
    "scripts/test ": "would run this test again",
    "jointstiff webhooks ": "needs an admin's key; test_webhooks.py runs them",
    "jointstiff serve": "does not end; the service of this test is one",
}
"""Beginnings of lines that are left out, with the reason."""


@pytest.fixture(scope="module")
def service(services):
    return services("sqlite")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / ".venv").symlink_to(sys.prefix)
    (tmp_path / ".curlrc").write_text("fail-with-body\nnoproxy = *\n")
    return tmp_path


def run(language: str, text: str, folder: Path, url: str) -> None:
    environment = {
        "PATH": f"{Path(sys.prefix, 'bin')}:{os.environ['PATH']}",
        "CURL_HOME": str(folder),
        "JOINTSTIFF_SERVER": url,
        "NO_PROXY": "*",
        "COLUMNS": "80",
    }
    for command in parts_of(text) if language == "sh" else [[sys.executable, "-c", text]]:
        if command[0] == "jointstiff":
            with contextlib.chdir(folder):
                shown = CliRunner().invoke(app, command[1:], env=environment)
            assert shown.exit_code == 0, f"{command}\n{shown.output}"
            continue
        done = subprocess.run(
            command,
            cwd=folder,
            env=os.environ | environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=240,
        )
        assert done.returncode == 0, f"{text}\n{done.stdout}\n{done.stderr}"


def parts_of(text: str) -> list[list[str]]:
    """Split a block of shell into arguments of `jointstiff` and programs of the shell, in their order."""
    parts: list[list[str]] = []
    for line in re.split(r"\n(?=jointstiff )", text):
        first, _, rest = re.sub(r"\\\n", " ", line).partition("\n")
        plain = shlex.split(first, comments=True) if first.startswith("jointstiff ") else []
        if not plain or set("|<>$;&*?`(~").intersection("".join(plain)):
            rest, plain = line, []
        parts += [each for each in (plain, ["bash", "-euo", "pipefail", "-c", rest]) if each and each[-1]]
    return parts


def runnable(text: str, url: str, runs: list[dict[str, Any]]) -> str:
    """Return a block with this service's address and ids, without the lines that are not run."""
    lines = [line for line in text.splitlines() if not line.startswith(tuple(NOT_RUN))]
    text = "\n".join(lines)
    for address in ("http://127.0.0.1:8000", "http://localhost:8000", "localhost:8000"):
        text = text.replace(address, url)
    for run in runs:
        set_id = run["request"]["measurement_set_id"]
        text = text.replace(PLACEHOLDERS["set"], f'"measurement_set_id": "{set_id}"', 1)
    return text.replace(PLACEHOLDERS["run"], f'"run_ids": {json.dumps([run["id"] for run in runs])}')


def post_campaigns(url: str) -> list[dict[str, Any]]:
    texts = dict(example_files())
    with httpx2.Client(base_url=url, timeout=60.0) as client:
        documents = [json.loads(texts[f"{name}.json"]) for name in ("motor", "secondary")]
        return [post(client, "/v1/campaigns", document) for document in documents]


@pytest.mark.timeout(1200)  # each command is a process of its own
@pytest.mark.parametrize("guide", GUIDES)
def test_commands_and_code_of_a_guide_work(guide, folder, service):
    blocks = blocks_of(guide)
    assert blocks, "a guide without commands needs no test"
    needs_ids = any(each in text for _, text in blocks for each in PLACEHOLDERS.values())
    runs = post_campaigns(service.url) if needs_ids else []
    for language, text in blocks:
        run(language, runnable(text, service.url, runs), folder, service.url)


def test_lines_that_are_not_run_are_still_there():
    texts = "\n".join(text for guide in GUIDES for _, text in blocks_of(guide))
    assert [start for start in NOT_RUN if f"\n{start}" not in f"\n{texts}"] == []
    assert (ROOT / "scripts" / "run").is_file()


def test_the_notebook_of_the_guide_runs(folder, monkeypatch):
    monkeypatch.chdir(folder)
    for target in (".", "examples"):
        assert CliRunner().invoke(app, ["examples", target]).exit_code == 0
    notebook = json.loads((ROOT / "examples" / "jointstiff.ipynb").read_text(encoding="utf-8"))
    assert (
        CliRunner().invoke(app, ["simulate", "campaign.json", "--load", "pull", "--overwrite"]).exit_code == 0
    )
    names = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), "notebook", "exec"), names)  # noqa: S102
    assert names["run"].state == names["area"].state == names["program"].state == "succeeded"
