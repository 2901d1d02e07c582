"""Nothing names what has left: schemas, API, help, page and documentation."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WORDS = (
    "turn and place",
    "/v1/processes",
    "processes/",
    "turns.csv",
    "places.csv",
    "js.process",
    "client.process",
    "jointstiff process",
    "ProcessOptions",
    "ProcessRequest",
    "solver/process",
    "solver.process",
    "kinds/process",
    "kinds.process",
    "prior_joint",
    "place_kept",
    "no_order",
    "too_fast",
)
"""Words of the kind `process`: rotations of a tool and places of a workpiece."""
KEEPING = {"docs/upgrade.md", "schemas/retired.py"}
"""Files that tell users what became of stored jobs."""
SEARCHED = ("schemas", "service", "solver", "dashboard/src", "docs", "examples", "benchmarks")
ENDINGS = {".py", ".md", ".ts", ".tsx", ".toml", ".json", ".ipynb"}


@pytest.fixture(scope="module")
def texts() -> dict[str, str]:
    """Text of each file by its name; what scripts generate is left out."""
    paths = [path for folder in SEARCHED for path in (ROOT / folder).rglob("*") if path.suffix in ENDINGS]
    names = {path: str(path.relative_to(ROOT)) for path in paths if "_build" not in path.parts}
    return {name: path.read_text(encoding="utf-8") for path, name in names.items() if name not in KEEPING}


@pytest.mark.parametrize("word", WORDS)
def test_no_text_names_what_has_left(word: str, texts: dict[str, str]) -> None:
    pattern = re.compile(rf"(?<![\w-]){re.escape(word)}", re.IGNORECASE)
    assert [name for name, text in texts.items() if pattern.search(text)] == []
