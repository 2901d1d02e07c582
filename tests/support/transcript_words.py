# ruff: noqa: T201  # what is printed is compared
"""Words of transcripts: requests over HTTP, commands, files and campaigns; each prints all that is said."""

import io
import json
import re
import shlex
from collections.abc import Callable, Iterable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from fastapi.testclient import TestClient
from support import importing_samples, kinds, programs, workbooks
from support.in_process import Client, description
from support.terminal import terminal
from support.transcripts import (
    printed,
    shortened,
    text_of_arrays,
    text_of_page,
    text_of_table,
    text_of_workbook,
)

from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.api.files import names
from jointstiff.service.app import create_app
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.resources.imports import import_files
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.own_weight import unloaded_campaign

arm = default_arm()


def words(store: Store) -> dict[str, Any]:
    """Return the names that statements of a transcript see: all of this module, samples, and a service."""
    samples = vars(importing_samples) | vars(workbooks) | vars(programs) | vars(kinds)
    asking = Asking(store)
    methods = {name: getattr(asking, name) for name in vars(Asking) if name[0] != "_"}
    return samples | globals() | methods | {"client": asking.client, "store": store}


class Asking:
    """Requests of a service in process; each prints status, address and body."""

    def __init__(self, store: Store) -> None:
        self.client = Client(store)

    def ask(self, method: str, path: str, *, quiet: bool = False, brief: bool = False, **options: Any) -> Any:
        """Send a request, print the answer, briefly those of errors only, and return it."""
        answer = self.client.request(method, path, **options)
        if brief and answer.status_code < 300:
            print(answer.status_code)
        elif not quiet:
            headers = ("location", "content-disposition")
            print(answer.status_code, *(answer.headers[name] for name in headers if name in answer.headers))
            print(body_of(answer.content))
        is_json = "json" in answer.headers.get("content-type", "")
        return answer.json() if is_json and answer.content else answer.text

    def get(self, path: str, **query: Any) -> Any:
        """Read what is there."""
        return self.ask("GET", path, params=query) if query else self.ask("GET", path)

    def post(self, path: str, body: Any, *, quiet: bool = False, **headers: str) -> Any:
        """Post a document."""
        return self.ask("POST", path, json=body, quiet=quiet, headers=headers)

    def tried(self, path: str, body: Any) -> None:
        """Post what is perhaps refused."""
        self.ask("POST", path, json=body, brief=True)

    def patch(self, path: str, body: Any, *, brief: bool = False) -> Any:
        """Change what is there."""
        return self.ask("PATCH", path, json=body, brief=brief)

    def posted(self, document: Any, *, quiet: bool = True, **options: Any) -> Any:
        """Post a campaign; return its run."""
        body = document | {"run": document.get("run", {}) | options}
        return self.post("/v1/campaigns", body, quiet=quiet)

    def job(self, kind: str, run: Any, other: str = "", **changes: Any) -> Any:
        """Post a job of a kind; return it."""
        answer = kinds.posted_job(self.client, kind, run, other, **changes)
        print(answer.status_code)
        print(body_of(answer.content))
        return answer.json()

    def files(self, job: Any, name: str) -> None:
        """Print all files of a job of a kind, its tables and its report."""
        (kind,) = (each for each in KINDS if each.name == name)
        for file_name in names(kind):
            answer = self.client.get(f"/v1/jobs/{job['id']}/files/{file_name}")
            print(f"--- {file_name}: {answer.status_code} {answer.headers['content-type']}")
            print(body_of(answer.content))


def campaign(load: str = "pull", configurations: int = 12, seed: int = 1, **options: Any) -> dict[str, Any]:
    """Simulate a campaign on the arm of exact springs."""
    return simulate_campaign(arm, load=load, configurations=configurations, seed=seed, **options)


def own_weight(configurations: int = 30, seed: int = 4) -> dict[str, Any]:
    """Simulate a campaign of unloaded readings."""
    return unloaded_campaign(arm, configurations=configurations, seed=seed)


def service_of(store: Store, laboratory: LaboratorySettings) -> TestClient:
    """Return a client of the service of a laboratory."""
    app = create_app(store, laboratory=laboratory)
    app.openapi = description
    return TestClient(app, base_url="http://localhost:8000")


def jointstiff(line: str, width: int = 100, **options: Any) -> None:
    """Run a command line; print its exit status where it is not 0, and all that it writes."""
    result = terminal(*shlex.split(line), width=width, **options)
    if result.exit_code:
        print(f"exit status {result.exit_code}")
    print(body_of(result.stdout.encode()) if result.stdout.startswith("{") else result.stdout)
    print(result.stderr)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        print(f"{type(result.exception).__name__}: {result.exception}")


def hide(secret: str, do: Callable[[], object]) -> None:
    """Print what is said without a secret, tokens and QR codes, which differ each time."""
    with redirect_stdout(io.StringIO()) as output:
        do()
    text = re.sub(r"js[a-z]_[A-Za-z0-9_]+", "<token>", output.getvalue()).replace(secret, "<secret>")
    print("\n".join(line for line in text.splitlines() if not set(line) & set("█▀▄")))


def together(answers: Iterable[tuple[str, str]]) -> None:
    """Print answers, each once, with all that was asked for it."""
    asked: dict[str, list[str]] = {}
    for question, answer in answers:
        asked.setdefault(answer, []).append(question)
    for answer, questions in asked.items():
        print(f"{answer}\n    {'; '.join(questions)}")


def told(answer: Any) -> str:
    """Return the status of an answer, and of a problem the place, reason and remedy."""
    is_problem = answer.headers.get("content-type") == "application/problem+json"
    problem = answer.json() if is_problem and answer.content else {}
    words = [problem[name] for name in ("where", "detail", "remedy") if problem.get(name)]
    return " | ".join([str(answer.status_code), *map(shortened, words)])


def understood(*files: tuple[str, Any], robot: Any = None, **options: Any) -> None:
    """Import files; print faults, what was assumed and is missing, columns, and the readings."""
    prepared = None if robot is None else prepare_robot(RobotDocument.model_validate(robot)).robot
    stated = {"show_faults": True, "encoders": "motor", "load_point": (0, 0, 100)} | options
    request = ImportRequest.model_validate(stated)
    answer = import_files(importing_samples.sources_of(*files), request, prepared)
    for fault in answer.faults:
        print("fault:", *plain(fault).values(), sep=" | ")
    if answer.faults:
        return
    for each in answer.files:
        print(f"{each.file}: {each.format}; {', '.join(map(_meaning, each.columns))}")
        print(*(f"  {note}" for note in each.assumptions), sep="\n")
    rest = plain(answer)
    rest.pop("template", None)
    rest.pop("files")
    print(printed(rest))


def _meaning(column: Any) -> str:
    unit = f" [{column.unit}]" if column.unit else ""
    return f"{column.meaning}{unit}{'?' * column.guessed}"


def changed(document: Any, *changes: tuple[str, Any]) -> Any:
    """Return a document with other parts, by their paths (`observations.0.joints`); None takes one away."""
    document = json.loads(json.dumps(document))
    for path, value in changes:
        *way, last = [int(key) if key.isdigit() else key for key in path.split(".")]
        part = document
        for key in way:
            part = part[key]
        if value is None:
            part.pop(last, None)
        else:
            part[last] = value
    return document


def plain(value: Any) -> Any:
    """Return a message as JSON has it."""
    return value.model_dump(mode="json", exclude_none=True) if hasattr(value, "model_dump") else value


def show(value: Any) -> None:
    """Print a message or a value of JSON."""
    print(printed(plain(value)))


def file(name: str, content: Any) -> None:
    """Write a file: text, bytes, or a document."""
    text = content if isinstance(content, str | bytes) else json.dumps(content)
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())


def read_file(name: str) -> None:
    """Print a file."""
    print(body_of(Path(name).read_bytes()))


def body_of(content: bytes) -> str:
    """Return what a file or a body says as text."""
    if content[:2] == b"PK":
        return text_of_workbook(content) if b"xl/workbook.xml" in content else text_of_arrays(content)
    if content[:4] in {b"%PDF", b"\x89PNG"}:
        return content[:4].decode("latin-1")
    text = content.decode("utf-8", "replace")
    if text.lstrip()[:1] in {"{", "["}:
        try:
            return printed(json.loads(text))
        except ValueError:
            pass
    return text_of_page(text) if "<html" in text[:400].lower() else text_of_table(text)
