"""Reports: size, time beside an empty Typst document, and the bytes of two processes."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter

import jointstiff
from benchmarks.report import Figure, Section
from jointstiff.schemas.report import Laboratory
from jointstiff.schemas.run import Campaign, Run
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.exporting.model import ExportedModel
from jointstiff.service.reports.document import Document, draft
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.reports.rendering import report_page, report_pdf
from jointstiff.service.reports.run import RunSubject, run_document
from jointstiff.simulator import default_arm, simulate_campaign

__all__ = ["run"]

_TITLE = "A report beside an empty Typst document"
_ROUNDS = 9
_CHILD = """
import sys
from time import perf_counter
from pathlib import Path
from benchmarks.studies.reports import document_of, empty_pdf, measured
from jointstiff.service.reports.rendering import report_pdf
document = document_of(Path(sys.argv[1])) if sys.argv[2] == "report" else None
begin = perf_counter()
content = report_pdf(document) if document else empty_pdf()
print(perf_counter() - begin, measured(content))
"""


def run(*, quick: bool) -> list[Section]:
    """Set a report and an empty document in turns, each in a process of its own, and again in this one."""
    if find_spec("typst") is None:
        return [
            Section(_TITLE, (), (), notes=("skipped: Typst is not here: pip install jointstiff[reports]",))
        ]
    rounds = 1 if quick else _ROUNDS
    with TemporaryDirectory() as folder:
        _write(Path(folder))
        document = document_of(Path(folder))
        cold: dict[str, list[float]] = {"report": [], "empty": []}
        hashes = set()
        for _ in range(rounds):
            for name, times in cold.items():
                seconds, found = _child(folder, name)
                times.append(seconds)
                if name == "report":
                    hashes.add(found)
        warm: dict[str, list[float]] = {"report": [], "empty": []}
        for _ in range(rounds):
            for name, times in warm.items():
                begin = perf_counter()
                content = report_pdf(document) if name == "report" else empty_pdf()
                times.append(perf_counter() - begin)
                if name == "report":
                    hashes.add(measured(content))
    size = len(report_pdf(document))
    rows = [
        (
            name,
            f"{1e3 * median(times['report']):.0f}",
            f"{1e3 * median(times['empty']):.0f}",
            f"{_ratio(times):.1f}",
        )
        for name, times in (("first in a process", cold), ("again in one process", warm))
    ]
    return [
        Section(
            _TITLE,
            ("", "report [ms]", "empty document [ms]", "ratio"),
            tuple(rows),
            figures=(
                Figure(
                    "time of a first report over that of a first empty document", _ratio(cold), "at most", 5.0
                ),
                Figure("the same, again in one process", _ratio(warm), "at most", 5.0),
                Figure("size", size / 1e6, "at most", 1.0, "MB"),
                Figure("different bytes over all processes", len(hashes) - 1.0, "at most", 0.0),
            ),
            notes=(
                f"{rounds} rounds; the empty document by `typst.compile(b'')`, with the fonts that it finds",
                f"PDF {size:,} bytes, HTML {len(report_page(document)):,} bytes",
            ),
        )
    ]


def _ratio(times: dict[str, list[float]]) -> float:
    return median(times["report"]) / median(times["empty"])


def _write(folder: Path) -> None:
    document = simulate_campaign(default_arm(), load="pull", configurations=24, seed=1)
    campaign = Campaign.model_validate_json(json.dumps(document))
    (folder / "campaign.json").write_text(json.dumps(document), encoding="utf-8")
    found = jointstiff.identify(campaign, campaign.run)
    (folder / "run.json").write_text(found.model_dump_json(), encoding="utf-8")


def document_of(folder: Path) -> Document:
    """Return the report of the run in a folder."""
    campaign = Campaign.model_validate_json((folder / "campaign.json").read_bytes())
    found = Run.model_validate_json((folder / "run.json").read_bytes())
    robot = prepare_robot(campaign.robot).robot
    model = ExportedModel.of(found, robot, campaign.robot.name)
    settings = LaboratorySettings(Laboratory(name="Metrology Lab", address=["Nantes"]))
    return run_document(RunSubject(model, campaign.measurement_set, settings), draft())


def empty_pdf() -> bytes:
    """Return an empty document, as Typst sets it by default."""
    import typst

    return typst.compile(b"")


def measured(content: bytes) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(content).hexdigest()


def _child(folder: str, name: str) -> tuple[float, str]:
    """Return seconds and hash of a document that another process sets."""
    command = [sys.executable, "-c", _CHILD, folder, name]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    seconds, found = done.stdout.split()
    return float(seconds), found
