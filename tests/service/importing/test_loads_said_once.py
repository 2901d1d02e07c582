"""Loads that files of all kinds state once: which are quoted, with which force; numbers of other things."""

import io
import json
import time
import zipfile

import openpyxl
import pytest
import scipy.io

from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.importing.stated_loads import describe_stated_loads, find_stated_loads

HANGS = "if this load hangs, `force` is "
ACTS = "if this force acts on the robot in axes of R0, `force` is "


def describe(name, content):
    content = content.encode() if isinstance(content, str) else content
    return describe_stated_loads(find_stated_loads([SourceFile(name=name, content=content)]))


def write_workbook(*rows):
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    stream = io.BytesIO()
    book.save(stream)
    return stream.getvalue()


def write_spreadsheet(*rows):
    names = {
        name: f"urn:oasis:names:tc:opendocument:xmlns:{name}:1.0" for name in ("office", "table", "text")
    }
    cells = "".join(
        "<table:table-row>"
        + "".join(
            f'<table:table-cell office:value-type="string"><text:p>{cell}</text:p></table:table-cell>'
            for cell in row
        )
        + "</table:table-row>"
        for row in rows
    )
    spaces = " ".join(f'xmlns:{name}="{address}"' for name, address in names.items())
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        archive.writestr(
            "content.xml",
            f"<office:document-content {spaces}><office:body><office:spreadsheet>"
            f'<table:table table:name="Infos">{cells}</table:table>'
            "</office:spreadsheet></office:body></office:document-content>",
        )
    return stream.getvalue()


@pytest.mark.parametrize("write", [write_workbook, write_spreadsheet])
@pytest.mark.parametrize(
    ("row", "said", "force"),
    [
        (["Tracker", "AT960", "Last", "150", "kg am Flansch"], "Last 150 kg", "0,0,-150kgf"),
        (["Massa", "130", "kg"], "Massa 130 kg", "0,0,-130kgf"),
        (["Charge", "1,5 kN (verticale)"], "Charge 1,5 kN", "0,0,-1.5kN"),
        (["Carico (kg)", "180"], "Carico (kg) 180", "0,0,-180kgf"),
        (["负载150公斤"], "负载150公斤", "0,0,-150kgf"),
        (["Load: 400 lbs at the plate"], "Load 400 lbs", "0,0,-400lbf"),
    ],
)
def test_a_load_in_one_cell_or_in_cells_side_by_side_is_quoted(write, row, said, force):
    sentence = describe("a.xlsx" if write is write_workbook else "a.ods", write(row, ["Pose", "X"]))
    assert f'says "{said}"' in sentence
    assert sentence.endswith(HANGS + force)


@pytest.mark.parametrize(
    ("name", "text", "said", "end"),
    [
        ("a.csv", "負荷[kg],25,,\n", "負荷[kg],25", f"{HANGS}0,0,-25kgf"),
        ("a.csv", "Gewicht;150;kg\n", "Gewicht 150 kg", f"{HANGS}0,0,-150kgf"),
        ("a.csv", "负荷,100kg,,\n", "负荷 100kg", f"{HANGS}0,0,-100kgf"),
        ("a.csv", "WITH 100 KG\n", "WITH 100 KG", f"{HANGS}0,0,-100kgf"),
        ("a.csv", "p[0]_50N;1;2;3\n", "p[0]_50N", f"{HANGS}0,0,-50N"),
        ("a.csv", "груз 150 кг\n", "груз 150 кг", f"{HANGS}0,0,-150kgf"),
        ("a.csv", "# 150 ± 0.5 kg\n", "150 ± 0.5 kg", f"{HANGS}0,0,-150kgf"),
        ("a.csv", "# load 150 kg (1471.5 N)\n", "load 150 kg", f"{HANGS}0,0,-150kgf"),
        ("a.m", "m = 200;      % kg\n", "m = 200; % kg", f"{HANGS}0,0,-200kgf"),
        ("a.m", "data.load.mass_kg = 5;\n", "data.load.mass_kg = 5", f"{HANGS}0,0,-5kgf"),
        ("a.m", "F = [0 0 -1962]; % N\n", "F = [0 0 -1962]; % N", f"{ACTS}0,0,-1962N"),
        (
            "a.yaml",
            "robot: {mass: 1078}\npayload_mass: 5.0\nsamples: []\n",
            "payload_mass: 5.0",
            "if this mass is in kg and hangs, `force` is 0,0,-5.0kgf",
        ),
        ("a.yaml", "load:\n  mass: 5\n  unit: kg\n", "load.mass 5 kg", f"{HANGS}0,0,-5kgf"),
        ("a.yaml", "a: 1\n# disc of 5 kg\n", "disc of 5 kg", f"{HANGS}0,0,-5kgf"),
        (
            "a.json",
            json.dumps({"units": {"force": "N"}, "load": {"force": [0, 0, -120.5]}}, indent=1),
            "load.force: [0, 0, -120.5] N",
            f"{ACTS}0,0,-120.5N",
        ),
        ("a.json", '{"load": {"value": 12, "unit": "kg"}}', "load.value 12 kg", f"{HANGS}0,0,-12kgf"),
        ("a.jsonl", '{"payload_kg": 2.5}\n{"q": [1]}\n', "payload_kg: 2.5", f"{HANGS}0,0,-2.5kgf"),
    ],
)
def test_a_load_in_a_text_a_script_or_a_document_is_quoted(name, text, said, end):
    sentence = describe(name, text)
    assert f'says "{said}"' in sentence
    assert sentence.endswith(end)


@pytest.mark.process
def test_a_load_in_a_struct_of_matlab_is_quoted():
    stream = io.BytesIO()
    scipy.io.savemat(stream, {"data": {"q": [[1.0, 2.0]] * 4, "load": {"mass_kg": 6.0}}})
    assert describe("a.mat", stream.getvalue()).endswith(f"{HANGS}0,0,-6kgf")


@pytest.mark.parametrize(
    "text",
    [
        "robot mass: 1078 kg", "Robot: 1078 kg", "mass of the robot 1078 kg", "Robotergewicht 1078 kg",
        "SMR 0.3 kg", "payload rating 210 kg", "rated payload: 210 kg", "210 kg max payload",
        "max_payload_kg: 210", "force gauge, capacity 500 N", "最大可搬質量 210 kg", "torque 120 N m",
        "120 N·m", "5 kg/m", "5 kg m2", "% N = 12", "poses N: 12", "Pose;12;N", "P1,12,N", "Temp;20;°C",
        "offset = [0, 0, 120]", "payload: 1", "Last [kg];5;10;15",
    ],
)  # fmt: skip
def test_numbers_of_other_things_are_no_loads(text):
    assert describe("a.csv", text + "\n") == ""


@pytest.mark.parametrize(
    "text",
    [
        "pull, horizontal, 500 N", "Traction horizontale: 500 N", "水平 500 N", "F = 60 N in Z", "1,200 N",
        "1.200 N", "1 200 N", "load 60/120 kg", "60, 120 und 180 kg", "100–200 N",
    ],
)  # fmt: skip
def test_a_load_whose_direction_or_size_is_not_clear_is_quoted_without_a_force(text):
    sentence = describe("a.csv", text + "\n")
    assert "says" in sentence
    assert "`force` is" not in sentence


@pytest.mark.parametrize("direction", ["suivant -Y base robot", "-Y", "Richtung −Y", "-y方向"])
def test_a_direction_in_the_row_of_a_force_is_that_of_the_force(direction):
    row = ["Traction horizontale (treuil + peson)", "500 N", direction]
    assert describe("a.xlsx", write_workbook(row)).endswith(f"{ACTS}0,-500,0N")


def test_different_loads_of_postures_are_named_without_a_force():
    rows = [["Massa", "100", "kg"], ["Massa", "130", "kg"]]
    sentence = describe("a.xlsx", write_workbook(*rows))
    assert '"Massa 100 kg"' in sentence
    assert '"Massa 130 kg"' in sentence
    assert "`force` is" not in sentence


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("a.csv", "5" + " " * 399), ("a.csv", "5;" * 200), ("a.csv", "a " * 200),
        ("a.csv", "F = [ " + "1 " * 190), ("a.csv", "5±" * 200), ("a.csv", "0 kg " * 80),
        ("a.csv", "1" * 400), ("a.json", "[" * 400),
        ("a.yaml", "- a: 0"), ("a.log", '{"a": 0}'),
    ],
)  # fmt: skip
def test_hostile_texts_are_searched_in_a_time_that_grows_with_their_length(name, line):
    def measure(count):
        start = time.process_time()
        assert describe(name, f"{line}\n" * count) == ""
        return time.process_time() - start

    count = 200_000 // len(line)
    assert measure(4 * count) < 8 * measure(count) + 0.5


@pytest.mark.parametrize(
    "text",
    ["load: 1\n", "load_N: 1\n", "payload_mass: 1\n", "force [N] = 1\n", "force: [0, 0, -1]\n", "load 1 N\n"],
)
def test_a_flag_of_a_load_is_not_quoted_as_a_load(text):
    assert not describe("a.txt", text)


PULLS = "if this load pulls down, `force` is "


@pytest.mark.parametrize(
    ("row", "said", "force"),
    [
        (["Forza:", "450", "N", "verso il basso, con paranco"], "Forza: 450 N", "0,0,-450N"),
        (["Kraft", "0.8", "kN", "nach unten"], "Kraft 0.8 kN", "0,0,-0.8kN"),
        (["Effort :", "300", "N", "vers le bas"], "Effort : 300 N", "0,0,-300N"),
        (["Fuerza", "30", "daN", "hacia abajo"], "Fuerza 30 daN", "0,0,-30daN"),
        (["Força", "250", "N", "para baixo"], "Força 250 N", "0,0,-250N"),
        (["Siła", "200", "N", "w dół"], "Siła 200 N", "0,0,-200N"),
        (["Сила", "20", "кгс", "вниз"], "Сила 20 кгс", "0,0,-20kgf"),
        (["力", "100", "N", "向下"], "力 100 N", "0,0,-100N"),
        (["荷重", "98", "N", "下向き"], "荷重 98 N", "0,0,-98N"),
        (["힘", "98", "N", "아래로"], "힘 98 N", "0,0,-98N"),
        (["Force", "60", "lbf", "downwards"], "Force 60 lbf", "0,0,-60lbf"),
    ],
)
def test_word_number_unit_and_direction_in_cells_side_by_side_are_a_load_that_pulls_down(row, said, force):
    sentence = describe("a.xlsx", write_workbook(row, ["Pose", "X"]))
    assert f'says "{said}"' in sentence
    assert sentence.endswith(PULLS + force)


@pytest.mark.parametrize(
    ("text", "is_certain"),
    [
        ("40 kg hung at the flange", True),
        ("Massa appesa: 40 kg", True),
        ("Kraft 400 N nach unten", True),
        ("悬挂 40 kg 砝码", True),
        ("Load: 40 kg", False),
        ("40 kg not hung, pushed", False),
        ("hung mass 30-40 kg", False),
        ("payload download 40 kg", False),
        ("hung mass max 40 kg", False),
    ],
)
def test_only_a_clear_load_that_hangs_or_pulls_down_by_its_words_is_certain(text, is_certain):
    loads = find_stated_loads([SourceFile(name="a.txt", content=f"# {text}\n".encode())])
    assert [each.is_certain for each in loads if each.is_certain] == [True] * is_certain
