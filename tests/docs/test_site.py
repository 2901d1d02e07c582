"""The documentation site: its reference covers the API, and its pages hold no inline code."""

import importlib
import re
import sys
from collections import Counter
from pathlib import Path
from typing import get_args

import pytest

from jointstiff.schemas.finding import FindingCode

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs" / "extensions"))

from external_code import externalise, inline_code  # noqa: E402
from generated_pages import findings_page, python_pages  # noqa: E402
from http_reference import messages_page, operations_page  # noqa: E402
from llms import llms_text  # noqa: E402


def test_the_reference_has_every_operation_and_message(openapi):
    operations, messages = operations_page(openapi), messages_page(openapi)
    for path, verbs in openapi["paths"].items():
        for verb in verbs:
            assert f"### {verb.upper()} {path}\n" in operations
    for name in openapi["components"]["schemas"]:
        assert f"## {name}\n" in messages


def test_the_reference_gives_units_defaults_and_bounds(openapi):
    run = messages_page(openapi).split("## RunRequest\n")[-1].split("\n## ")[0]
    fields = {line.split("`")[1]: line for line in run.splitlines() if line.startswith("| `")}
    assert "| number (0.001 – 1000) or null | m |" in fields["characteristic_length"]
    assert '| `"partial_pose"` |' in fields["method"]


def test_the_reference_explains_every_finding_once():
    explained = Counter(re.findall(r"^\* `(\w+)`: \S", findings_page(), re.MULTILINE))
    assert explained == Counter(get_args(FindingCode))


def test_inline_code_of_a_page_becomes_files(tmp_path):
    page = tmp_path / "reference" / "page.html"
    page.parent.mkdir()
    page.write_text(
        "<html><head><style>p {color: red}</style></head><body>"
        '<svg style="opacity: 50%"></svg><script>go();</script></body></html>'
    )
    sheet = tmp_path / "_static" / "theme.css"
    sheet.parent.mkdir()
    sheet.write_text("""a{b:url('data:image/svg+xml;charset=utf-8,<svg fill="%23fff"/>')}""")
    externalise(tmp_path)
    html = page.read_text()
    assert list(inline_code(html)) == []
    files = {path.suffix: path.read_text() for path in (tmp_path / "_static" / "external").iterdir()}
    assert files[".js"] == "go();"
    assert files[".svg"] == '<svg fill="#fff"/>'
    assert 'src="../_static/external/' in html
    assert "data:" not in sheet.read_text()


def test_a_handler_in_a_page_fails_the_build(tmp_path):
    (tmp_path / "page.html").write_text('<html><head></head><body><a onclick="go()">x</a></body></html>')
    with pytest.raises(ValueError, match="onclick"):
        externalise(tmp_path)


def test_every_guide_is_on_the_map():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")} - {"index"}
    assert pages <= set(index.split())


def test_llms_txt_has_every_page_with_its_task():
    text = llms_text((ROOT / "docs" / "index.md").read_text(encoding="utf-8"))
    assert text.startswith("# Jointstiff\n\n> Jointstiff identifies")
    listed = {line.split("](")[1].split(")")[0] for line in text.splitlines() if line.startswith("- [")}
    pages = {f"{path.stem}.html" for path in (ROOT / "docs").glob("*.md")} - {"index.html", "changelog.html"}
    assert pages <= listed


@pytest.fixture(scope="module")
def pages():
    return python_pages()


def test_the_python_reference_has_every_public_module(pages):
    documented = {
        line.removeprefix(".. automodule:: ")
        for text in pages.values()
        for line in text.splitlines()
        if line.startswith(".. automodule:: ")
    }
    folders = {
        "jointstiff.solver": ROOT / "solver",
        "jointstiff.service.library": ROOT / "service" / "library",
        "jointstiff.schemas": ROOT / "schemas",
        "jointstiff.simulator": ROOT / "examples" / "simulator",
    }
    for package, folder in folders.items():
        for path in folder.rglob("*.py"):
            parts = [part for part in path.relative_to(folder).with_suffix("").parts if part != "__init__"]
            if not any(part.startswith("_") for part in parts):
                assert ".".join([package, *parts]) in documented
    assert ".. automodule:: jointstiff.solver.mechanics.robot" in pages["jointstiff.solver.mechanics"]


def test_a_name_that_a_backend_offers_is_documented_where_it_is_defined(pages):
    for name in ("jointstiff.solver", "jointstiff.simulator"):
        offered = ", ".join(sorted(importlib.import_module(name).__all__))
        assert f".. automodule:: {name}\n   :exclude-members: {offered}\n" in pages[name]
    assert ":exclude-members:" not in pages["jointstiff.solver.mechanics"]
