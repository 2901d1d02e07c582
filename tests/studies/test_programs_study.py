"""Programs of all formats on exact springs: a fast version of the benchmark `programs`."""

from __future__ import annotations

import pytest

from benchmarks.studies import programs


@pytest.fixture(scope="module")
def identified():
    return programs.exact_run()


def test_the_loaded_tool_is_on_its_target_in_every_format(identified):
    section = programs._formats(*identified, 5)
    assert [figure for figure in section.figures if not figure.met] == []


def test_hostile_programs_are_refused_in_few_words(identified):
    section = programs._hostile(*identified)
    assert {row[1] for row in section.rows} == {"refused"}
    assert all(figure.met for figure in section.figures)
