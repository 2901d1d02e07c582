"""The guides: commands, code and recipes work as a reader runs them, files exist, retired terms are gone."""

import json
import os
import re
import shlex
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from textwrap import dedent
from typing import Any

import httpx2
import numpy as np
import pytest
from support import guide_runner
from support.api import post
from support.campaigns import prepare
from support.guide_files import ROOT, blocks_of, guides
from support.processes import LONGEST_SECONDS, Service

from jointstiff.schemas.finding import Finding
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.files import example_files
from jointstiff.solver.integrity.values import View
from jointstiff.solver.text import figure

GUIDES = guides()
SLOW = {"docs/elastic-links.md"}  # two comparisons of models, which the recorded answers hold by day
COLUMNS = 80
PLACEHOLDERS = {"set": '"measurement_set_id": "…"', "run": '"run_ids": ["…", "…"]'}
"""What a guide writes for the ids of stored sets and runs."""

NOT_RUN = {
    "scripts/run ": "sets an environment up; test_start.py runs its program, jointstiff demo",
    "scripts/test ": "would run this test again",
    "sqlite3 ": "is of another package; test_database.py copies a file as it does",
    "pg_dump ": "needs a server of databases",
    "pg_restore ": "needs a server of databases",
    "jointstiff serve": "does not end; the service of this test is one",
    "jointstiff worker": "does not end, and needs a server of databases; test_long_runs.py runs it",
    "jointstiff keys revoke": "needs the id of a key; tests/service/cli/test_keys.py runs it",
    "jointstiff keys link": "needs the id of a key; tests/service/cli/test_keys.py runs it",
}
"""Beginnings of lines that are left out, with the reason."""


class Reader:
    """Someone with the wheel's environment, an empty folder and a terminal of 80 columns."""

    def __init__(self, installed: Path, place: Path) -> None:
        self.database, self._log = f"sqlite:///{place / 'jointstiff.db'}", place / "log"
        self._installed = installed
        self._service = Service(self.database, python=str(installed / "python"))
        self.url = self._service.url
        command = [str(installed / "python"), "-P", guide_runner.__file__]
        self._runner = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def run(self, language: str, text: str, folder: Path) -> None:
        """Run a block."""
        environment = {
            "PATH": f"{self._installed}:{os.environ['PATH']}",
            "CURL_HOME": str(folder),
            "JOINTSTIFF_SERVER": self.url,
            "NO_PROXY": "*",
            "COLUMNS": str(COLUMNS),
        }
        tasks = [{"code": text}] if language == "python" else parts_of(text)
        for task in tasks:
            self._log.write_text("")
            task |= {"folder": str(folder), "environment": environment, "log": str(self._log)}
            self._runner.stdin.write(json.dumps(task) + "\n")
            self._runner.stdin.flush()
            status = int(self._runner.stdout.readline())
            shown = self._log.read_text()
            assert status == 0, f"{text}\n{shown}"
            cut = [line for line in shown.splitlines() if "│" in line and len(line) > COLUMNS]
            assert not cut, f"tables that are wider than the terminal: {cut}"

    def close(self) -> None:
        """End runner and service."""
        self._runner.stdin.close()
        self._runner.wait(LONGEST_SECONDS)
        self._runner.stdout.close()
        self._service.stop()


@pytest.fixture(scope="module")
def reader(installed, tmp_path_factory):
    someone = Reader(installed, tmp_path_factory.mktemp("reader"))
    try:
        yield someone
    finally:
        someone.close()


@pytest.fixture
def folder(tmp_path, installed):
    (tmp_path / ".venv").symlink_to(installed.parent)
    (tmp_path / ".curlrc").write_text("fail-with-body\nnoproxy = *\n")
    return tmp_path


def parts_of(text: str) -> list[dict[str, Any]]:
    """Split a block of shell into arguments of `jointstiff` and programs of the shell, in their order."""
    parts: list[dict[str, Any]] = []
    for line in re.split(r"\n(?=jointstiff )", text):
        first, _, rest = re.sub(r"\\\n", " ", line).partition("\n")
        plain = shlex.split(first, comments=True) if first.startswith("jointstiff ") else []
        if not plain or set("|<>$;&*?`(~").intersection("".join(plain)):
            rest, plain = line, []
        if plain:
            parts.append({"command": plain[1:]})
        if rest.strip():
            parts.append({"shell": rest})
    return parts


def runnable(text: str, reader: Reader, runs: list[dict[str, Any]]) -> str:
    """Return a block with this service's address, database and ids, without the lines that are not run."""
    lines = [line for line in text.splitlines() if not line.startswith(tuple(NOT_RUN))]
    text = "\n".join(lines)
    for address in ("http://127.0.0.1:8000", "http://localhost:8000", "localhost:8000"):
        text = text.replace(address, reader.url)
    text = text.replace("sqlite:///jointstiff.db", reader.database)
    for run in runs:
        set_id = run["request"]["measurement_set_id"]
        text = text.replace(PLACEHOLDERS["set"], f'"measurement_set_id": "{set_id}"', 1)
    return text.replace(PLACEHOLDERS["run"], f'"run_ids": {json.dumps([run["id"] for run in runs])}')


@pytest.mark.timeout(1200)  # each command is a process of its own
@pytest.mark.parametrize(
    "guide", [pytest.param(guide, marks=[pytest.mark.slow] if guide in SLOW else []) for guide in GUIDES]
)
def test_commands_and_code_of_a_guide_work(guide, folder, reader):
    blocks = blocks_of(guide)
    needs_ids = any(each in text for _, text in blocks for each in PLACEHOLDERS.values())
    runs, texts = [], dict(example_files())
    if needs_ids:
        with httpx2.Client(base_url=reader.url, timeout=60.0) as client:
            documents = [json.loads(texts[f"{name}.json"]) for name in ("motor", "secondary")]
            runs = [post(client, "/v1/campaigns", document) for document in documents]
    for language, text in blocks:
        reader.run(language, runnable(text, reader, runs), folder)


def test_lines_that_are_not_run_are_still_there():
    texts = "\n".join(text for guide in GUIDES for _, text in blocks_of(guide))
    assert [start for start in NOT_RUN if f"\n{start}" not in f"\n{texts}"] == []
    assert (ROOT / "scripts" / "run").is_file()


def test_the_notebook_of_the_guide_runs(folder, reader):
    notebook = json.loads((ROOT / "examples" / "jointstiff.ipynb").read_text(encoding="utf-8"))
    cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    states = "assert {run.state, area.state, program.state} == {'succeeded'}"
    simulate = "jointstiff simulate campaign.json --load pull --overwrite"
    made = ["jointstiff examples .", "jointstiff examples", simulate]
    reader.run("sh", "\n".join(made), folder)
    reader.run("python", "\n".join([*cells, states]), folder)


GLOSSARY = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
ENTRIES = re.findall(r"^(\S.*)\n: (.*(?:\n  .*)*)", GLOSSARY, re.MULTILINE)
RETIRED = [term for _, text in ENTRIES for term in re.findall(r"`([^`]+)`", text.partition("Not: ")[2])]
READ = {
    "guides": [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), ROOT / "docker" / "README.md"],
    "page": [
        ROOT / "dashboard" / "src" / "words" / "shared.ts",
        *(ROOT / "dashboard" / "src").rglob("words.ts"),
    ],
    "messages": [
        path for folder in ("schemas", "service", "solver") for path in (ROOT / folder).rglob("*.py")
    ],
}
"""Files by what they hold; messages and help are strings of the code."""


def words_of(path: Path) -> str:
    """Return the text of a file with strings joined and single blanks, without what the glossary retires."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        text = re.sub(r'"\s*\n\s*f?"', "", text)
    return " ".join(re.sub(r"Not: .*", "", text).split()).lower()


def test_the_glossary_retires_terms_and_is_short():
    assert len(RETIRED) >= 10
    names = {name for name, _ in ENTRIES}
    assert {"correct a program", "held-out postures", "well determined"} <= names
    assert "work area" in names
    assert [name for name, text in ENTRIES if len(text) > 360] == []


@pytest.mark.parametrize("kind", READ)
def test_retired_terms_are_gone(kind):
    retired = re.compile("|".join(rf"\b{re.escape(term)}\b" for term in RETIRED))
    files = [path for path in READ[kind] if path.name != "CHANGELOG.md"]
    found = {
        f"{path.relative_to(ROOT)}: {one[0]}" for path in files for one in retired.finditer(words_of(path))
    }
    assert len(files) >= 1
    assert sorted(found) == []


TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def recipe(title: str) -> str:
    """Return the section of a title."""
    return TEXT.split(f"## {title}\n")[1].split("\n## ")[0]


def defined(title: str, name: str):
    """Return the function that the code of a recipe defines."""
    (code,) = re.findall(r"^   ```python\n(.*?)^   ```$", recipe(title), re.MULTILINE | re.DOTALL)
    names = {each.__name__: each for each in (Finding, Iterator, View, figure)}
    names |= {"np": np, "json": json}
    exec(compile(dedent(code), title, "exec"), names)  # noqa: S102
    return names[name]


@pytest.mark.parametrize(
    "title", ["Add a kind of work", "Add a finding of the integrity checks", "Add an import format"]
)
def test_a_recipe_has_at_most_ten_steps(title):
    assert 5 <= len(re.findall(r"^\d+\. ", recipe(title), re.MULTILINE)) <= 10


def test_the_finding_of_the_recipe_is_found():
    check = defined("Add a finding of the integrity checks", "light_loads")
    robot, measurements = prepare(simulate_campaign(default_arm(), load="pull", configurations=4, seed=5))
    weak = replace(measurements, force=measurements.force * np.array([1.0, 0.01, 1.0, 0.01])[:, None])
    findings = list(check(View(robot, weak)))
    assert [(finding.observation, finding.weight) for finding in findings] == [("c02", "use"), ("c04", "use")]


NAMED = re.compile(r"`((?:solver|service|schemas|tests|examples|benchmarks|scripts|docker|docs)/[\w./-]+)`")


@pytest.mark.parametrize("guide", READ["guides"], ids=lambda path: path.name)
def test_what_a_guide_names_is_there(guide):
    named = set(NAMED.findall(guide.read_text(encoding="utf-8")))
    assert not sorted(name for name in named if not (ROOT / name).exists())


@pytest.mark.parametrize(
    "guide", [*(ROOT / "docs").glob("*.md"), ROOT / "README.md"], ids=lambda path: path.name
)
def test_no_paragraph_has_more_than_five_lines(guide):
    text = re.sub(r"^ *```.*?^ *```", "", guide.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    parts = re.split(r"\n\s*\n|\n(?=\s*(?:[*-]|\d+\.) |[|:])", text)
    assert [
        part for part in parts if len(part) > 5 * 120 and not part.lstrip().startswith(("|", "    "))
    ] == []
