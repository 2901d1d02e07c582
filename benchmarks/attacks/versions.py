"""Two versions of the service on one database: posts to both while the newer one adds a column.

By name only, on a quiet machine: ten minutes for each kind of database, or one kind with `--part` 1/2 or 2/2.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

import httpx2

import jointstiff
from benchmarks.report import Figure, Part, Section
from benchmarks.services import Service, databases, ended, numbers, post_campaign
from jointstiff.service.store.layouts import LAYOUT, number_of

__all__ = ["run"]

_SECONDS: Final = 600.0
_QUICK_SECONDS: Final = 30.0
_PAUSE_SECONDS: Final = 0.5
"""Time between two posts of a client: workers keep pace with them."""
_END_SECONDS: Final = 300.0
_CONFIGURATIONS: Final = 24
_REQUESTS: Final[tuple[dict[str, Any], ...]] = (
    {},
    {"positive": False},
    {"loss": "huber"},
    {"resampling": {"size": 12, "repetitions": 8_000}},  # in several steps, which other workers may take
)
_NUMBER: Final = number_of(LAYOUT) + 1
_NEXT: Final = f"{_NUMBER:04}_expand_trial"
_STEP: Final = f'''"""Trial of a step that old and new programs can use: a column that may be null."""

import sqlalchemy as sa
from alembic import op

revision = "{_NEXT}"
down_revision = "{LAYOUT}"


def upgrade() -> None:
    op.add_column("robots", sa.Column("trial", sa.Text, nullable=True))
'''


def run(*, quick: bool, part: Part) -> list[Section]:
    """Post to both versions, on an SQLite file and on a PostgreSQL server of our own."""
    with tempfile.TemporaryDirectory(prefix="jointstiff-versions-") as name, databases() as kinds:
        newer = _write_newer_version(Path(name))
        chosen = [list(kinds.items())[number] for number in part.of(len(kinds))]
        seconds = _QUICK_SECONDS if quick else _SECONDS
        return [_post_to_both(kind, database(), newer, seconds) for kind, database in chosen]


def _write_newer_version(folder: Path) -> Path:
    """Copy the package, with one more column and the step that adds the column; return the copy's folder."""
    package = folder / "jointstiff"
    shutil.copytree(Path(jointstiff.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    store = package / "service" / "store"
    (store / "migrations" / "versions" / f"layout_{_NUMBER:04}.py").write_text(_STEP, encoding="utf-8")
    _replace(store / "layouts.py", re.escape(f'"{LAYOUT}"'), f'"{_NEXT}"')
    _replace(store / "tables.py", r"(    RobotRecord,\n)", r'\1    sa.Column("trial", sa.Text),\n')
    return folder


def _replace(path: Path, pattern: str, by: str) -> None:
    text, count = re.subn(pattern, by, path.read_text(encoding="utf-8"), count=1)
    if not count:
        raise ValueError(f"{path.name} has no {pattern}")
    path.write_text(text, encoding="utf-8")


class _Posts:
    """Runs that are posted to services, each service in turn, until they are stopped."""

    def __init__(self, client: httpx2.Client, set_id: str) -> None:
        self.answers = Counter[int]()
        self.runs: dict[str, int] = {}  # address → number of the request
        self._urls = [str(client.base_url)]
        self._set_id = set_id
        self._stopping = threading.Event()

    def also_to(self, url: str) -> None:
        """Post to a further service, too."""
        self._urls = [*self._urls, url]

    @contextmanager
    def posted(self) -> Any:  # noqa: ANN401 - a generator
        """Post as long as the context lasts."""
        thread = threading.Thread(target=self._post)
        thread.start()
        try:
            yield
        finally:
            self._stopping.set()
            thread.join()

    def _post(self) -> None:
        with httpx2.Client(timeout=60) as client:
            number = 0
            while not self._stopping.wait(_PAUSE_SECONDS):
                url, request = self._urls[number % len(self._urls)], number // 2 % len(_REQUESTS)
                body = {"measurement_set_id": self._set_id} | _REQUESTS[request]
                answer = client.post(f"{url.rstrip('/')}/v1/runs?wait=0", json=body)
                self.answers[answer.status_code] += 1
                if answer.is_success:
                    self.runs[answer.headers["location"]] = request
                number += 1


def _post_to_both(kind: str, database: str, newer: Path, seconds: float) -> Section:
    """Post to a service, from a tenth of the time on also to its newer version, which upgrades the tables."""
    with ExitStack() as stack:
        old = stack.enter_context(Service(database, 1))
        client = stack.enter_context(httpx2.Client(base_url=old.url, timeout=60))
        posts = _Posts(client, post_campaign(client, _CONFIGURATIONS))
        begun = time.monotonic()
        with posts.posted():
            time.sleep(seconds / 10.0)
            environment = {"PYTHONPATH": os.pathsep.join([str(newer), os.environ.get("PYTHONPATH", "")])}
            new = stack.enter_context(Service(database, 1, environment=environment))
            posts.also_to(new.url)
            time.sleep(max(0.0, seconds - (time.monotonic() - begun)))
        layout = client.get("/health").raise_for_status().json()
        lost, different = _compare(client, new.url, posts.runs)
    refused = sum(count for status, count in posts.answers.items() if status >= 500)
    row = (kind, str(len(posts.runs)), str(refused), str(lost), str(different))
    return Section(
        f"Two versions on one database ({kind}), {seconds:.0f} s of posts",
        ("database", "runs", "answers 5xx", "lost", "different"),
        (row,),
        (
            Figure.none(f"{kind}: answers 5xx", refused),
            Figure.none(f"{kind}: runs that did not end, or that a version cannot read", lost),
            Figure.none(f"{kind}: runs of one request with different numbers", different),
        ),
        data={"answers": dict(posts.answers), "health": layout},
    )


def _compare(client: httpx2.Client, newer: str, runs: dict[str, int]) -> tuple[int, int]:
    """Return (runs that did not succeed or differ between the versions, runs that differ from the first)."""
    first: dict[int, dict[str, Any]] = {}
    lost = different = 0
    read: Callable[[str], httpx2.Response] = lambda address: client.get(f"{newer}{address}")  # noqa: E731
    for address, request in runs.items():
        found = ended(client, address, _END_SECONDS)
        if found["state"] != "succeeded" or read(address).json() != found:
            lost += 1
        elif first.setdefault(request, numbers(found)) != numbers(found):
            different += 1
    return lost, different
