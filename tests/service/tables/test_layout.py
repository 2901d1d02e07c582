"""Tables in a terminal: with lines where they fit, without them, and in parts."""

import pytest
from rich.console import Console

from jointstiff.service.tables.table import Column, Table
from jointstiff.service.tables.terminal import lay_out_parts


def lines_of(count, **named):
    """Lines of a table of joints and some columns of numbers, in a terminal of 40 characters."""
    numbers = [Column(f"u {i} [mm]", [0.5 * i, None]) for i in range(count)]
    console = Console(width=40, record=True)
    console.print(lay_out_parts([Table([Column("joint", ["a", "b"], text=True), *numbers], **named)]))
    return [line.rstrip() for line in console.export_text().splitlines()]


def test_a_table_that_fits_has_lines():
    assert lines_of(2) == [
        "┏━━━━━━━┳━━━━━━━━━━┳━━━━━━━━━━┓",
        "┃ joint ┃ u 0 [mm] ┃ u 1 [mm] ┃",
        "┡━━━━━━━╇━━━━━━━━━━╇━━━━━━━━━━┩",
        "│ a     │      0.0 │      0.5 │",
        "│ b     │        — │        — │",
        "└───────┴──────────┴──────────┘",
    ]


WIDE = [
    "       u 0  u 1  u 2  u 3  u 4  u 5  u 6",
    "joint [mm] [mm] [mm] [mm] [mm] [mm] [mm]",
    "────────────────────────────────────────",
    "a      0.0  0.5  1.0  1.5  2.0  2.5  3.0",
    "b        —    —    —    —    —    —    —",
    "       u 7  u 8",
    "joint [mm] [mm]",
    "───────────────",
    "a      3.5  4.0",
    "b        —    —",
]


def test_a_wider_table_is_printed_in_parts_that_each_begin_with_the_first_column():
    assert lines_of(9) == WIDE


@pytest.mark.parametrize("count", [2, 9])
def test_a_title_stands_once_above_and_a_caption_once_below(count):
    plain = lines_of(count)
    title, *rest = lines_of(count, title="Title")
    assert (title.strip(), rest) == ("Title", plain)
    assert lines_of(count, caption="caption") == [*plain, "caption"]
