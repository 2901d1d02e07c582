"""The page of promises lists the public names, each of them explained; the answer for an HMI is today's."""

import csv
import json
import re
from pathlib import Path

import pytest
from support.api import file_at, post
from support.in_process import Client

import jointstiff
import jointstiff.solver
from jointstiff.service.store.store import Store
from jointstiff.simulator.files import example_files

DOCS = Path(__file__).parents[2] / "docs"
TEXT = (DOCS / "promise.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("package", [jointstiff, jointstiff.solver])
def test_the_page_lists_the_public_names_of_a_package(package):
    section = TEXT.partition(f"## Names of `{package.__name__}`\n")[2].partition("\n## ")[0]
    assert re.findall(r"`(\w+)`", section) == sorted(package.__all__)


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


def test_the_answer_that_an_hmi_gets_is_that_of_the_service():
    """Each row that the page shows is a row of the file; the last digits differ from machine to machine."""
    text = (DOCS / "hmi.md").read_text(encoding="utf-8")
    block = re.search(r"```text\n(joint,verdict.*?)```", text, re.DOTALL)[1]
    shown = list(csv.DictReader(block.splitlines()))
    with Store.open("sqlite://") as store:
        client = Client(store)
        run = post(client, "/v1/campaigns?wait=60", json.loads(dict(example_files())["motor.json"]))
        answer = client.get(file_at(run, "joints.csv")).text
    rows = {row["joint"]: row for row in csv.DictReader(answer.splitlines())}
    assert [row["joint"] for row in shown] == ["joint_1", "joint_2", "joint_6"]
    for row in shown:
        found = rows[row["joint"]]
        for column, cell in row.items():
            if column.startswith("stiffness") and cell:
                assert float(cell) == pytest.approx(float(found[column]), rel=1e-6)
            else:
                assert found[column] == cell, (row["joint"], column)
