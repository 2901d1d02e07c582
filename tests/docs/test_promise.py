"""The page of promises lists the public names, and each of them has a docstring."""

import re
from pathlib import Path

import pytest

import jointstiff
import jointstiff.solver

DOCS = Path(__file__).parents[2] / "docs"
TEXT = (DOCS / "promise.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("package", [jointstiff, jointstiff.solver])
def test_the_page_lists_the_public_names_of_a_package(package):
    section = TEXT.partition(f"## Names of `{package.__name__}`\n")[2].partition("\n## ")[0]
    assert re.findall(r"^\* `(\w+)`: \S", section, re.MULTILINE) == sorted(package.__all__)


@pytest.mark.parametrize("package", [jointstiff, jointstiff.solver])
def test_a_public_name_is_there_and_explained(package):
    for name in package.__all__:
        assert (getattr(package, name).__doc__ or "").strip(), name


def test_the_client_in_c_sharp_is_the_one_that_the_tests_compile():
    text = (DOCS / "hmi.md").read_text(encoding="utf-8")
    name = re.search(r"examples/clients/(\w+\.cs)\)", text)[1]
    program = (DOCS.parent / "examples" / "clients" / name).read_text(encoding="utf-8")
    for part in ("/v1/campaigns?wait=60", "/files/joints.csv"):
        assert part in text
        assert part in program
