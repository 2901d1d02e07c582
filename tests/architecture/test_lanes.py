"""The lanes of the suite: no test can forget its marker."""

import subprocess
import sys

import pytest


def test_a_process_of_an_unmarked_test_is_refused():
    with pytest.raises(pytest.fail.Exception, match=r"mark it @pytest\.mark\.process"):
        subprocess.run([sys.executable, "-c", ""], check=True)


@pytest.mark.process
def test_a_process_of_a_marked_test_is_not():
    subprocess.run([sys.executable, "-c", ""], check=True)


@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_a_test_on_postgresql_is_marked(request, kind):
    expected = {"sqlite": set(), "postgresql": {"postgresql", "process"}}[kind]
    assert {mark.name for mark in request.node.iter_markers()} - {"parametrize"} == expected
