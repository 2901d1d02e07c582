"""The paper in one command: Tables I and II and figures 7 and 8 of two sets."""

import csv
import io
import json
import re
from pathlib import Path

import pypdf
import pytest
from support.command_lines import refused, typed

from jointstiff.service.reports.paper import build_paper
from jointstiff.simulator.files import example_files

HEADS = {
    "Measurement sets and explained deflection",
    "Table II: stiffness",
    "Figures 7 and 8",
}


@pytest.fixture(autouse=True)
def inside(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in example_files():
        if name in {"motor.json", "secondary.json", "sweeps.json", "nominal.json"}:
            Path(name).write_text(text)


def test_the_paper_has_its_tables_and_figures():
    typed("compare motor.json secondary.json --paper paper.html --save comparison.json")
    page = Path("paper.html").read_text()
    assert set(re.findall(r"<h2>(?:\d+ )?([^<]*)</h2>", page)) >= HEADS
    assert len(re.findall("<svg", page)) == 3  # both sides measured; what is left over on each
    assert "39.58" in page
    result = json.loads(Path("comparison.json").read_text())["result"]
    shares = [f"{100 * entry['compensation']:.1f} %" for entry in result["entries"]]
    assert all(share in page for share in shares)


def test_table_1_has_the_wrist_by_the_targets_of_a_geometry():
    typed("geometry sweeps.json --robot nominal.json --save geometry.json")
    typed("compare motor.json secondary.json --paper paper.html --geometry geometry.json")
    page = Path("paper.html").read_text()
    assert "Table I: wrist centre by three targets" in page
    wrist = json.loads(Path("geometry.json").read_text())["result"]["wrist"]
    assert len(wrist["targets"]) == 3
    for target in wrist["targets"]:
        assert all(f"{1e3 * part:.3f}" in page for part in target["offset"])


def test_table_1_needs_a_geometry_with_targets():
    typed("geometry sweeps.json --robot nominal.json --save geometry.json")
    saved = json.loads(Path("geometry.json").read_text())
    saved["result"]["wrist"]["targets"] = []
    Path("bare.json").write_text(json.dumps(saved))
    compare = "compare motor.json secondary.json"
    words = refused(f"{compare} --paper paper.html --geometry bare.json")
    assert "no wrist centre by three targets" in words
    assert refused(f"{compare} --paper paper.html --geometry motor.json") == (
        "motor.json is not a geometry remedy: give a file that `jointstiff geometry SWEEPS.json --save FILE` "
        "wrote"
    )
    assert "add --paper" in refused(f"{compare} --geometry geometry.json")
    typed(f"{compare} --paper paper.html")
    assert "Table I:" not in Path("paper.html").read_text()


def test_the_paper_is_written_in_each_format():
    typed("compare motor.json secondary.json --paper paper.pdf")
    pages = pypdf.PdfReader(io.BytesIO(Path("paper.pdf").read_bytes())).pages
    assert len(pages) <= 3
    assert "Table II: stiffness" in " ".join(page.extract_text() for page in pages)
    typed("compare motor.json secondary.json --paper paper.svg")
    assert Path("paper.svg").read_text().count('id="axes_') == 3
    typed("compare motor.json secondary.json --paper paper.csv")
    head, *rows = csv.reader(Path("paper.csv").read_text().splitlines())
    assert {"side", "method", "joint", "stiffness [N.m/rad]"} <= set(head)
    assert len(rows) >= 2 * 4 * 6
    assert "exists" in refused("compare motor.json secondary.json --paper paper.csv")
    assert ".pdf" in refused("compare motor.json secondary.json --paper paper.docx")


def test_each_part_of_a_table_has_its_heads_at_80_characters(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    words = typed("compare motor.json secondary.json --resample 8:20")
    assert "joint side CP/L CP PP DPP" in words
    assert words.count("joint side") == 1
    assert "1 free" in words
    assert "≥ 0 compliances" not in words
    assert " 1 ≥ 0 " not in words  # no constraint acts
    detailed = typed("compare motor.json secondary.json --resample 8:20 --details")
    assert " 1 ≥ 0 " in detailed


def test_a_comparison_without_a_result_has_no_paper():
    import jointstiff as js

    comparison = js.compare("motor.json")
    with pytest.raises(js.CampaignError, match="the comparison is cancelled"):
        build_paper(comparison.model_copy(update={"result": None, "state": "cancelled"}))
