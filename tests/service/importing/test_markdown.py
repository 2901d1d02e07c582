"""Tables of Markdown with prose around them are read like other tables."""

import time

import pytest
from support.strange_files import JOINTS, both, in_turn, joint_rows, judge, points, simulate

import jointstiff as js
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.texts.markdown import write_tables_plainly

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=10)


def test_a_lab_book_is_read(tmp_path):
    rows = [["pose", *JOINTS, "state", *"xyz"], *in_turn(CAMPAIGN, ("before", "loaded"), both(CAMPAIGN))]
    lines = [f"| {' | '.join(row)} |" for row in rows]
    lines.insert(1, f"|{'---|' * len(rows[0])}")
    path = tmp_path / "book.md"
    path.write_text(
        "# Check of cell 4\n\nWeight of 10 kg, hung; x, y, z in mm.\n\n" + "\n".join([*lines, "", "Windy."])
    )
    proposal = js.read(
        path,
        robot=ARM,
        encoders="motor",
        load_point=[0, 0, 120],
        force=[0, 0, -981],
        units={"force": "N"},
        length_unit="mm",
    )
    assert judge(CAMPAIGN, proposal.accept().measurement_set.model_dump(mode="json")) == []


def test_headings_of_sections_are_names_of_postures_and_no_comments(tmp_path):
    """The proposal writes a table with these names; a name with `##` would make a comment of its row."""
    lines = ["# Laborbuch", "", "Messtag: 12.3.2024, Raum K014"]
    for posture, joints in enumerate(CAMPAIGN.joints):
        angles = " / ".join(f"{each:.4f}" for each in joints)
        lines += ["", f"## Stellung {posture + 1}", "", f"Gelenke: {angles} Grad", ""]
        for words, places in (("ohne Gewicht", CAMPAIGN.unloaded), ("mit Gewicht", CAMPAIGN.loaded)):
            lines.append(f"- {words}:")
            for target, name in enumerate(("oben", "rechts")):
                place = "  ".join(f"{1e3 * each:.4f}" for each in places[posture, target])
                lines.append(f"  - {name}: {place}")
    path = tmp_path / "laborbuch.md"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    stated = {"encoders": "motor", "load_point": [0, 0, 120], "force": [0, 0, -981], "units": {"force": "N"}}
    document = js.read(path, robot=ARM, length_unit="mm", **stated).accept().measurement_set
    assert judge(CAMPAIGN, document.model_dump(mode="json")) == []
    assert [each.label for each in document.observations][:2] == ["Stellung 1", "Stellung 2"]


def test_tables_of_different_width_are_a_table_each(tmp_path):
    """The headers of the first table are known, but say nothing of positions: the robot is asked."""
    tables = {
        "Robot poses": [["pose", *JOINTS], *joint_rows(CAMPAIGN)],
        "Tracker, unloaded": [["pose", *"xyz"], *points(CAMPAIGN, 0)],
        "Tracker, loaded": [["pose", *"xyz"], *points(CAMPAIGN, 1)],
    }
    text = ""
    for title, (header, *rows) in tables.items():
        lines = [f"| {' | '.join(row)} |" for row in (header, ["---"] * len(header), *rows)]
        text += f"## {title}\n\n" + "\n".join(lines) + "\n\n"
    path = tmp_path / "record.md"
    path.write_text(text)
    options = {"encoders": "motor", "load_point": [0, 0, 120], "force": [0, 0, -981], "units": {"force": "N"}}
    proposal = js.read(path, robot=ARM, **options)
    assert judge(CAMPAIGN, proposal.accept().measurement_set.model_dump(mode="json")) == []


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("words\n\n| a | b |\n|:-:|---|\n| 1 | x\\|y |\n", "# words\n\na\tb\n\n1\tx|y\n"),
        ("| a | b |\r\n| --- | --- |\r\n|  | 2 |", "a\tb\r\n\r\n\t2"),
        ("|a|b|\n|-|-|\n1 | 2\n3|4|\n|5|6\n> | 7 | 8 |\n", "a\tb\n\n1\t2\n3\t4\n5\t6\n7\t8\n"),
        ("> |a|b|\n> |-|-|\n> |1|2|\n> words\n", "a\tb\n\n1\t2\n# words\n"),
        ("5 | 6\n|a|b|\n|-|-|\n|1|2|\nno | number | here\n", "# 5 | 6\na\tb\n\n1\t2\n# no | number | here\n"),
        ("| a | b |\n| 1 | 2 |\n", None),
        ("a;b\n|---|\n1;2\n", None),
    ],
)
def test_lines_keep_their_numbers_and_other_texts_are_unchanged(text, plain):
    assert write_tables_plainly("a.md", text) == (text if plain is None else plain)


@pytest.mark.parametrize("line", ["1 | 2", "> 1 | 2 |", "1 | 2 | 3 | 4", "- | 1 | 2 | 3"])
def test_numbers_between_upright_lines_are_no_comment(line):
    with pytest.raises(ImportFileError, match=r"line 4: .* not the 3 cells of the table above"):
        write_tables_plainly("a.md", f"|a|b|c|\n|-|-|-|\n|1|2|3|\n{line}\n")


@pytest.mark.parametrize(
    "line", ["|" + "-" * 1_000_000 + "x", "|" * 1_000_000, ">" * 1_000_000, "|" + "- " * 500_000 + "x"]
)
def test_a_long_line_is_read_in_linear_time(line):
    start = time.perf_counter()
    write_tables_plainly("a.md", f"| a | b |\n|---|---|\n{line}\n")
    assert time.perf_counter() - start < 5.0
