"""Matrices in a text, as MATLAB writes them: the numbers are those of MATLAB, or the text is refused."""

import time

import numpy as np
import pytest

from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.formats.matrices import find_matrices

A = "[1 2 3; 4 5 6; 7 8 9]"
OTHER = "[1 1 1; 2 2 2; 3 3 3]"


def found(text):
    return {matrix.name: np.array(matrix.rows) for matrix in find_matrices("a.m", text)}


@pytest.mark.parametrize(
    "text", [f"A = {A};", f"A={A}", "A = [1,2,3\n4,5,6\n7,8,9];", f"x = 3;\nA = {A}; % [mm]"]
)
def test_a_matrix_is_read_with_its_name(text):
    assert (found(text)["A"] == np.arange(1, 10).reshape(3, 3)).all()


def test_a_transposed_matrix_is_read_transposed():
    assert (found(f"A = {A}';")["A"] == np.arange(1, 10).reshape(3, 3).T).all()


def test_a_matrix_in_a_block_of_comments_is_none():
    text = f"%{{\nA = {OTHER};\n  %{{\nB = {OTHER};\n  %}}\n%}}\nA = {A};\n"
    assert found(text).keys() == {"A"}
    assert (found(text)["A"] == found(f"A = {A}")["A"]).all()


def test_the_last_of_two_matrices_with_one_name_counts():
    assert (found(f"A = {OTHER};\nA = {A};")["A"] == found(f"A = {A}")["A"]).all()


@pytest.mark.parametrize(
    "text",
    [
        f"A = {A} * 25.4;",
        f"A = {A}/1000;",
        f"A = {A}'*1e-3;",
        f"B = A + {A};",
        f"A = {A};\nA = A + 5;",
        f"A = {A};\nA(:,3) = A(:,3) + 5;",
        f"A = {A}.^2;",
    ],
)
def test_a_text_that_computes_with_a_matrix_is_refused(text):
    with pytest.raises(ImportFileError, match="the text computes with matrix"):
        found(text)


@pytest.mark.parametrize("text", [f"A = {A};\nif A == 3", f"A = {A};\nBA = 3;", f"A = {A};\nB.A = 4;"])
def test_a_comparison_or_another_name_changes_no_matrix(text):
    assert found(text).keys() == {"A"}


@pytest.mark.parametrize("cell", ["1" * 4_000_000 + "x", "." * 4_000_000, "1e" + "1" * 4_000_000])
def test_a_cell_of_millions_of_characters_is_no_number(cell):
    """The pattern of a number once took the square of a cell's length: 20 kB took 10 s."""
    assert found(f"A = [{cell}]") == {}


def test_thousands_of_matrices_are_read_in_linear_time():
    """The text was once searched for each matrix: 8000 matrices in 0.2 MB took 98 s."""
    text = "".join(f"A{n} = {A};\n" for n in range(8000))
    start = time.perf_counter()
    assert len(found(text)) == 8000
    assert time.perf_counter() - start < 5.0


@pytest.mark.parametrize(
    "text", ["A" + " " * 1_000_000, "A =" + " " * 1_000_000, "A" * 1_000_000, "A(" * 500_000]
)
def test_a_long_line_behind_a_matrix_is_read_in_linear_time(text):
    start = time.perf_counter()
    assert found(f"A = {A};\n{text}[]").keys() == {"A"}
    assert time.perf_counter() - start < 5.0
