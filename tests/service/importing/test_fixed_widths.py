"""Text in columns of a fixed width with decimal commas, titles and empty cells: blanks separate the cells."""

from jointstiff.service.importing.grid import find_delimiter

TITLES = ["Pomiar sztywności, robot 3", "Obciążenie: 220 N (na kołnierzu)", "Nr     J1     J2      X       Y"]
ROWS = [f"{n:4} {n},25  {-n},50   1{n}0,125   2{n}0,250" for n in range(1, 10)]
SHORT = "   9 9,25  -9,50"


def number(lines):
    return list(enumerate(lines, 1))


def test_numbers_with_decimal_commas_between_blanks_are_cells_although_a_row_is_short():
    assert find_delimiter("a.txt", number([*TITLES, *ROWS[:4], SHORT, *ROWS[4:]])) == "whitespace"


def test_a_short_row_of_cells_between_commas_leaves_the_comma():
    rows = [f"{n}, {n}.25, {-n}.50, 1{n}0.125" for n in range(1, 10)]
    assert find_delimiter("a.txt", number(["Nr, J1, J2, X", *rows[:4], "5, 5.25", *rows[4:]])) == "comma"
