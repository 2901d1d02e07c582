"""Documents of earlier versions: raised step by step, with every number as it was."""

import copy
import hashlib
import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter
from pydantic_core import to_json
from support import kept
from support.kept import count_numbers

import jointstiff as js
from jointstiff.schemas.live import MeasurementSetPost
from jointstiff.schemas.measurement import StoredMeasurementSet
from jointstiff.schemas.robot import LastCampaign, Robot, StoredRobot
from jointstiff.service.archive.form import RESTORED
from jointstiff.service.archive.reading import read_archive
from jointstiff.service.archive.writing import write_archive
from jointstiff.service.history.paths import find_values, remove
from jointstiff.service.history.raising import raise_document
from jointstiff.service.history.steps import JOBS, KINDS, NEWEST, OLDEST, STEPS
from jointstiff.service.kinds.registry import KINDS as KINDS_OF_WORK
from jointstiff.service.kinds.retired import RETIRED
from jointstiff.service.kinds.rooms import ROOMS
from jointstiff.service.library.client import parse_resource
from jointstiff.service.live.campaign import Entry
from jointstiff.service.runs.trend import ReadRun

HERE = Path(__file__).parent
EXAMPLES = json.loads((HERE / "examples.json").read_text(encoding="utf-8"))
NAMES = {"robots": "robot", "measurement_sets": "measurement_set", "open_sets": "open_set"}
MESSAGES: dict[str, Any] = {kind.name: kind.message for kind in (*KINDS_OF_WORK, *RETIRED.values())} | {
    "robot": Robot,
    "measurement_set": StoredMeasurementSet,
    "open_set": MeasurementSetPost,
    "live_entry": Entry,
}
BEGUN = {"gearbox", "correction"}
"""Kinds that no earlier layout stores."""
DIGESTS = {23: "75c7a35a0edd62fe", 24: "9d9a62cd054d9058"}
"""Version → digest of the shapes of its documents. A released version keeps its digest."""
Document = dict[str, Any]


def kind_in(table: str, line: Document) -> str:
    return line["kind"] if table == "jobs" else NAMES.get(table, "live_entry")


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[int, str, Document]]:
    """Version, kind and document of all that databases of earlier layouts store."""
    folder = tmp_path_factory.mktemp("old")
    found = []
    for number in kept.kept_numbers():
        path = folder / f"{number}.zip"
        write_archive(kept.make_database(number, folder / f"{number}.db"), path)
        with read_archive(path) as archive:
            for table in RESTORED[:5]:
                lines = archive.lines(table)
                found += [(line["schema"], kind_in(table, line), line["document"]) for line in lines]
    return found


def test_every_stored_document_is_raised_to_todays_shape(stored: list[tuple[int, str, Document]]) -> None:
    for version, kind, document in stored:
        raised = raise_document(kind, document, version).document
        TypeAdapter(MESSAGES[kind]).validate_json(to_json(raised))
    assert {kind for _, kind, _ in stored} >= set(MESSAGES) - BEGUN
    assert len(stored) > 150


def test_no_step_changes_or_computes_a_number(stored: list[tuple[int, str, Document]]) -> None:
    """What a step drops is named, and what it adds is a definition."""
    total = 0
    for version, kind, document in stored:
        moved = copy.deepcopy(document)
        dropped = count_numbers({})
        for step in STEPS:
            if kind in step.kinds and step.after > version:
                step.change(moved)
                for path in step.dropped:
                    dropped += count_numbers(list(find_values(moved, path)))
                    remove(moved, path)
        raised = raise_document(kind, document, version).document
        assert count_numbers(raised) + dropped == count_numbers(document), kind
        total += sum(count_numbers(raised).values())
    assert total > 50_000


def test_a_document_is_left_alone_by_the_steps_behind_it(stored: list[tuple[int, str, Document]]) -> None:
    """So files and answers that state no version are raised from the oldest one."""
    for version, kind, document in stored:
        raised = raise_document(kind, document, version).document
        again = raise_document(kind, raised, None)
        assert again.document == raised
        assert again.dropped == ()


def test_raising_changes_no_document_in_place(stored: list[tuple[int, str, Document]]) -> None:
    _, kind, document = stored[-1]
    before = copy.deepcopy(document)
    raise_document(kind, document, OLDEST)
    assert document == before


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda each: f"{each['from']} {each['kind']}")
def test_each_step_has_an_example(example: Document) -> None:
    (step,) = [step for step in STEPS if step.before == example["from"] and example["kind"] in step.kinds]
    document = copy.deepcopy(example["before"])
    step.change(document)
    for path in step.dropped:
        remove(document, path)
    assert document == example["after"]


def test_no_step_is_without_an_example_and_each_begins_where_one_ended() -> None:
    assert {example["from"] for example in EXAMPLES} == {step.before for step in STEPS}
    versions = sorted({step.before for step in STEPS})
    for kind in KINDS:
        own = [step for step in STEPS if kind in step.kinds]
        assert [step.before for step in own] == sorted({step.before for step in own}), kind
    assert {step.after for step in STEPS} == {*versions[1:], NEWEST}


def shape(schema: Any) -> Any:
    """A JSON schema without its words: what a stored document must look like to be read."""
    if isinstance(schema, list):
        return [shape(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    words = {"title", "description", "examples", "unit"}
    return {
        name: {field: shape(each) for field, each in value.items()}  # names of fields are no words
        if name in {"properties", "$defs"}
        else sorted(value)
        if name == "required" and isinstance(value, list)  # in any order
        else shape(value)
        for name, value in schema.items()
        if name not in words
    }


def test_documents_of_another_shape_are_another_version() -> None:
    """Another shape needs a layout, a step to its number in `history/steps.py`, and its hash here.

    Databases, archives, saved files and answers of the version before are then raised by the step.
    """
    documents = [
        StoredRobot,
        StoredMeasurementSet,
        MeasurementSetPost,
        Entry,
        ReadRun,
        LastCampaign,
        *(kind.message for kind in KINDS_OF_WORK),
    ]
    shapes = [shape(TypeAdapter(each).json_schema(mode="serialization")) for each in documents]
    digest = hashlib.sha256(json.dumps(shapes, sort_keys=True).encode()).hexdigest()[:16]
    assert digest == DIGESTS[NEWEST]


class TestRecordedVersion:
    def test_a_job_that_has_ended_states_the_version_that_recorded_it(
        self, stored: list[tuple[int, str, Document]]
    ) -> None:
        for version, kind, document in stored:
            if kind not in JOBS:
                continue
            versions = raise_document(kind, document, version).document["provenance"]["versions"]
            has_ended = document["provenance"]["ended_at"] is not None
            assert versions.get("document") == (str(version) if has_ended else None)

    def test_a_job_of_today_does_not(self) -> None:
        job = {"kind": "run", "provenance": {"ended_at": "2026-11-27T12:00:00Z", "versions": {}}}
        assert raise_document("run", job, NEWEST).document is job
        assert raise_document("run", job, None).document == job


class TestLoad:
    def test_jobs_of_every_version_are_loaded_as_files(
        self, stored: list[tuple[int, str, Document]], tmp_path: Path
    ) -> None:
        """As `identify --json` printed them."""
        path = tmp_path / "saved.json"
        seen = set()
        for version, kind, document in stored:
            if kind not in ROOMS:
                continue
            seen.add(version)
            path.write_text(json.dumps(document))
            loaded = js.load(path)
            assert (loaded.kind, loaded.id) == (kind, document["id"])
            assert str(loaded)
        assert seen == {OLDEST, 19, 21, 22, 23}

    def test_a_saved_file_states_its_version(
        self, stored: list[tuple[int, str, Document]], tmp_path: Path
    ) -> None:
        document = next(document for version, kind, document in stored if (version, kind) == (OLDEST, "run"))
        path = tmp_path / "run.json"
        path.write_text(json.dumps(document))
        js.load(path).save(tmp_path / "again.json")
        saved = json.loads((tmp_path / "again.json").read_text())
        assert saved["schema"] == NEWEST
        assert js.load(tmp_path / "again.json").model_dump() == js.load(path).model_dump()


class Answer:
    """An answer of a service."""

    def __init__(self, document: Document) -> None:
        self.content = json.dumps(document).encode()


def test_answers_of_older_services_are_read(stored: list[tuple[int, str, Document]]) -> None:
    for _, kind, document in stored:
        if kind in (*JOBS, "robot"):
            answer = parse_resource(Answer(document), MESSAGES[kind])  # type: ignore[arg-type]
            assert answer.id == document["id"]
