"""Unit words of several languages mean the same in brackets, behind a comma, and in a row of units."""

import pytest

import jointstiff as js

LINES = [
    f"c{i};{10 * i};-20,5;30,5;{i};-50,5;60,5;1{i}00,5;200,5;300,5;1{i}00,6;200,6;299,5" for i in range(1, 5)
]
WORDS = [
    ("Grad", "mm"), ("degrés", "millimètres"), ("grados", "milímetros"), ("gradi", "millimetri"),
    ("graus", "mm"), ("度", "毫米"), ("град", "мм"), ("도", "mm"), ("°", "mm"),
]  # fmt: skip
FORMS = ["{} [{}]", "{} ({})", "{}（{}）", "{}, {}", "a row of units"]


def write_lines(form, angle, length):
    names = [
        *(f"J{i}" for i in range(1, 7)),
        *(f"P1 {state} {axis}" for state in ("unloaded", "loaded") for axis in "xyz"),
    ]
    units = [angle] * 6 + [length] * 6
    if form == "a row of units":
        return [";".join(["label", *names]), ";".join(["", *units]), *LINES]
    headers = [form.format(name, unit) for name, unit in zip(names, units, strict=True)]
    return [";".join(["label", *headers]), *LINES]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("angle", "length"), WORDS)
def test_unit_words_mean_the_same_in_each_place(form, angle, length, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("\n".join([*write_lines(form, angle, length), ""]), encoding="utf-8")
    answer = js.import_files(path, encoders="motor", show_faults=True)
    (file,) = answer.files
    assert [column.unit for column in file.columns] == [None, *["deg"] * 6, *["mm"] * 6]
    assert answer.faults == []


@pytest.mark.parametrize("word", ["grad", "gon"])
def test_gradians_are_no_degrees(word, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("\n".join([*write_lines("{} [{}]", word, "mm"), ""]), encoding="utf-8")
    answer = js.import_files(path, encoders="motor", show_faults=True)
    assert f"'{word}' is not a known unit of angle" in answer.faults[0].reason
