"""Tables of LaTeX with text around them are read like the sheets of a workbook."""

import time
from contextlib import suppress

import pytest
from support.importing_samples import (
    CAMPAIGN,
    CAMPAIGN_NUMBERS,
    MM,
    answered,
    points_of,
    read,
    refusals,
    values_of,
)
from support.strange_files import JOINTS, Campaign, both, joint_rows, judge, points, simulate, wide

import jointstiff as js
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.formats.latex import read_latex

ARM = "KUKA KR 210 R2700 extra"
ASKED = {"encoders": "motor", "load_point": [0, 0, 120], "force": [0, 0, -981], "units": {"force": "N"}}
SIMULATED = simulate(ARM, seed=3, postures=10)


def tabular(rows: list[list[str]], environment: str = "tabular", options: str = "{lrr}") -> str:
    lines = [" & ".join(row) + r" \\" for row in rows]
    return (
        f"\\begin{{{environment}}}{options}\n\\toprule\n"
        + "\n".join(lines)
        + f"\n\\bottomrule\n\\end{{{environment}}}\n"
    )


def written(numbers: list[str]) -> list[str]:
    """Return numbers as a German or a Brazilian thesis has them: `-57.4` is `$-57{,}4$`."""
    return [f"${number.replace('.', '{,}')}$" for number in numbers]


def rows_of(text: str, content: str | None = None) -> list[list[str]]:
    return [list(row.cells) for row in read_latex("a.tex", text.encode(), content)[0].rows]


def judged(campaign: Campaign, path, **more) -> list[str]:
    proposal = js.read(path, robot=ARM, **{**ASKED, **more})
    return judge(campaign, proposal.accept().measurement_set.model_dump(mode="json"))


def test_an_appendix_with_merged_headers_and_decimal_commas_is_read(tmp_path):
    groups = (
        r" & \multicolumn{6}{c}{\^Angulos ($^\circ$)} & \multicolumn{3}{c}{Sem carga}"
        r" & \multicolumn{3}{c}{Com carga}\\"
    )
    rows = [["Conf.", *JOINTS, *2 * ["$x$", "$y$", "$z$"]]]
    rows += [[name, *written(numbers)] for name, *numbers in wide(SIMULATED, *both(SIMULATED))]
    path = tmp_path / "apendice.tex"
    path.write_text(
        "% appendix B\n\\begin{table}[htb]\n\\caption{Posi\\c{c}\\~oes (mm).}\n"
        "\\begin{tabular}{c rrrrrr rrr rrr}\n"
        + groups
        + "\n\\cmidrule(lr){2-7}\\cmidrule(lr){8-10}\n"
        + "\n".join(" & ".join(row) + r"\\[2pt]" for row in rows)
        + "\n\\end{tabular}\n\\end{table}\n"
    )
    assert judged(SIMULATED, path) == []


def test_several_tables_of_a_thesis_are_a_table_each(tmp_path):
    tables = {
        "Joint angles": [["pose", *JOINTS], *joint_rows(SIMULATED)],
        "Tracker, unloaded": [["pose", *"xyz"], *points(SIMULATED, 0)],
        "Tracker, loaded": [["pose", *"xyz"], *points(SIMULATED, 1)],
    }
    text = "\\documentclass{article}\n\\begin{document}\nWe hung a weight.\n"
    for title, rows in tables.items():
        text += f"\\begin{{table}}\n{tabular(rows)}\\caption{{\\textbf{{{title}}}}}\n\\end{{table}}\n"
    path = tmp_path / "thesis.tex"
    path.write_text(text + "\\end{document}\n")
    assert judged(SIMULATED, path) == []


@pytest.mark.parametrize(
    ("cells", "plain"),
    [
        (r"\textbf{1} & $-57{,}4$ & \num{1.5e-3}", ["1", "-57,4", "1.5e-3"]),
        (r"\textcolor{red}{2.5} & \phantom{-}3.5 & --4.5", ["2.5", "3.5", "-4.5"]),
        (r"\multirow{2}{*}{Pose} & $q_1$ [$^\circ$] & $x_{\mathrm{loaded}}$", ["Pose", "q1 [°]", "x loaded"]),
        ("R\\'eflecteur & Gr\\\"o\\ss{}e & {\\'A}ngulo", ["Réflecteur", "Größe", "Ángulo"]),
        (r"\makecell{J1 \\ (deg)} & a~\% \& b & \SI{50}{\newton}", ["J1 (deg)", "a % & b", "50 N"]),
        ("12.5 % & 3.5\n & \\sout{4.5} & 5", ["12.5", "", "5"]),
        (r"\begin{tabular}{c}J1\\deg\end{tabular} & \multicolumn{2}{c}{x}", ["J1 deg", "x", ""]),
    ],
)
def test_commands_of_print_leave_the_text(cells, plain):
    assert rows_of(tabular([["1", "2", "3"]]).replace("1 & 2 & 3", cells + r" \\ 1 & 2 & 3"))[0] == plain


@pytest.mark.parametrize("cell", [r"\unknown{12.5}", "12.5$^a$", "1$_2$", r"12\foo5", "5$^{2}$", "$--5$"])
def test_another_command_makes_no_number_of_a_cell(cell):
    (found,) = [row[0] for row in rows_of(tabular([[cell, "2", "3"], ["4", "5", "6"]]))[:1]]
    assert not found.replace(".", "").isdigit()


def test_the_head_of_a_long_table_is_read_once():
    text = r"""
\begin{longtable}{lrr}
\caption{Angles}\\
\hline Pose & J1 & J2 \\ \hline \endfirsthead
Pose (continued) & J1 & J2 \\ \hline \endhead
\multicolumn{3}{r}{next page} \\ \endfoot
\hline \endlastfoot
c01 & 1.5 & 2.5 \\
c02 & 3.5 & 4.5
\end{longtable}
"""
    (table,) = read_latex("a.tex", text.replace("c01 &", "7 &").replace("c02 &", "8 &").encode(), None)
    assert [row.cells for row in table.rows] == [
        ("Pose", "J1", "J2"),
        ("7", "1.5", "2.5"),
        ("8", "3.5", "4.5"),
    ]
    assert table.preview.sheet == "Angles"


def test_numbers_in_a_repeated_head_are_refused():
    text = tabular([["1", "2", "3"], ["4", "5", "6"]], "longtable").replace(
        "6 \\\\", "6 \\\\ \\endfoot\n7 & 8 & 9 \\\\"
    )
    with pytest.raises(ImportFileError, match="a head or foot that is printed on each page has numbers"):
        rows_of(text)


def test_places_are_those_of_the_file_and_comments_are_remarks():
    text = "% load of 50\\,N\nText $x$.\n" + tabular([["1", "2", "3"], ["4", "5", "6"]])
    (table,) = read_latex("a.tex", text.encode(), None)
    assert [row.line for row in table.rows] == [5, 6]
    assert [tuple(remark) for remark in table.comments] == [(1, "load of 50\\,N"), (2, "Text x.")]


def test_numbers_outside_of_tables_are_named():
    (table,) = read_latex("a.tex", b"1.5 2.5 3.5\n" + tabular([["1", "2", "3"]]).encode(), None)
    assert table.preview.assumptions == [
        "1 line outside the tables have numbers, and were not read; the first: '1.5 2.5 3.5'"
    ]


def test_a_table_is_read_like_delimited_text():
    rows = [line.split(";") for line in CAMPAIGN.splitlines()[1:]]
    imported = read(("a.tex", tabular(rows)), units=MM)
    expected = {}
    for label, joints, force, targets in CAMPAIGN_NUMBERS:
        expected[label, "joint"] = tuple(joints)
        expected[label, "force"] = force
        assert points_of(imported)[label, "P10", "unloaded"] == targets["P10"][0]
    assert values_of(imported) == expected


def test_a_missing_cell_is_refused_and_not_shifted():
    rows = [line.split(";") for line in CAMPAIGN.splitlines()[1:]]
    del rows[2][9]
    assert any("the row has 12 cells" in said for said in refusals(("a.tex", tabular(rows)), units=MM))


@pytest.mark.parametrize(
    "text",
    [
        tabular([["word", "1", "2"]]),
        "\\begin{tabular}{l}\nwords \\\\\n\\end{tabular}\n",
    ],
)
def test_a_text_without_a_table_of_numbers_is_told_what_it_is(text):
    (said,) = refusals(("a.tex", text), units=MM)
    assert said.startswith("a.tex: the file is a text in LaTeX, not a table")


def test_a_script_that_prints_a_table_is_no_latex():
    script = "fprintf('\\\\begin{tabular}{lr}\\n');\n" + CAMPAIGN
    assert not any("LaTeX" in fault.reason for fault in answered(("a.m", script), show_faults=True).faults)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("\\begin{tabular}{ll}\n1 & 2", "the table has no end"),
        ("\\begin{tabular}{ll}\n1 } & 2 \\\\\n\\end{tabular}", "a brace has no beginning"),
        ("\\begin{tabular}{ll}\n{1 & 2 \\\\\n\\end{tabular}", "a cell ends within braces"),
        ("\\begin{tabular}{ll}\n1 & {2 \\\\\n\\end{tabular}", "a brace has no end"),
        ("\\begin{tabular}{ll\n1 & 2", "an argument in braces has no end"),
        ("\\begin{tabular}{ll}\n\\multicolumn{x}{c}{2} \\\\\n\\end{tabular}", "how many columns it covers"),
        ("\\begin{tabular}{ll}\n\\multicolumn{9999}{c}{2} \\\\\n\\end{tabular}", "more than 256 columns"),
        ("\\begin{tabular}{ll}\n" + "a" * 300 + " & 2 \\\\\n\\end{tabular}", "a cell has more than 256"),
    ],
)
def test_a_damaged_table_is_refused(text, reason):
    with pytest.raises(ImportFileError, match=reason):
        rows_of(text)


@pytest.mark.parametrize("before", ["", "\\begin{tabular}{l}"])
@pytest.mark.parametrize(
    "piece",
    ["{", "}", "\\caption{", "\\multirow{", "$", "_", "\\begin{tabular}", " ", "[", "\\", "a\n", "\\'", "x_{",
     "\\multicolumn{256}{c}{}\\\\", "\\cite[", "\\verb(", "%"],
)  # fmt: skip
def test_a_hostile_text_is_read_or_refused_in_linear_time(piece, before):
    start = time.perf_counter()
    with suppress(ImportFileError):
        read_latex("a.tex", (before + piece * (190_000 // len(piece))).encode(), None)
    assert time.perf_counter() - start < 20.0
