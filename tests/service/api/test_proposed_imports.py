"""POST /v1/imports: the robot proposes a mapping, a choice answers a question, a mapping is applied."""

import json

import numpy as np
import pytest
from support.api import post
from support.importing_samples import arm
from support.measured_arms import TRACKER, measure

ARM = "KUKA KR 6 R900 sixx"
STATED = {"encoders": "motor", "load_point": [0, 0, 100], "force": [0, 0, -30]}
DEFLECTION = np.array([0.05, -0.02, -0.4])


def text_of(numbers):
    return "\n".join(" ".join(f"{each:.4f}" for each in row) for row in numbers).encode() + b"\n"


@pytest.fixture(scope="module")
def files():
    joints, points = measure(arm(ARM))
    seen = points[:, 0] @ TRACKER + [300.0, -200.0, 800.0]
    tables = {"j.txt": joints, "u.txt": seen, "l.txt": seen + DEFLECTION @ TRACKER}
    return [("files", (name, text_of(numbers))) for name, numbers in tables.items()]


@pytest.fixture(scope="module")
def robot_id(local):
    robot = {"name": "cell 3", "model": {"format": "catalogue", "arm": ARM}}
    return post(local, "/v1/robots", robot)["id"]


def imported(local, files, **options):
    answer = local.request("POST", "/v1/imports", files=files, data={"options": json.dumps(options)})
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_a_proposal_is_a_mapping_that_reads_the_files_again(local, files, robot_id):
    shown = imported(local, files, robot_id=robot_id, mapping=STATED)
    while shown["questions"]:
        shown = imported(
            local, files, robot_id=robot_id, mapping=shown["questions"][0]["choices"][0]["mapping"]
        )
    assert "in a frame of the instrument" not in shown["faults"]
    assert len(shown["measurement_set"]["observations"]) == 16
    assert [table["name"] for table in shown["tables"]] == ["j.txt", "u.txt", "l.txt"]
    assert {column["role"] for column in shown["tables"][1]["columns"]} == {"T1 unloaded [mm]"}
    again = imported(local, files, mapping=shown["mapping"])
    assert again["measurement_set"] == shown["measurement_set"]


def test_an_edited_mapping_is_checked_as_a_proposal_is(local, files, robot_id):
    shown = imported(local, files, robot_id=robot_id, mapping=STATED)
    mapping = shown["questions"][0]["choices"][0]["mapping"] if shown["questions"] else shown["mapping"]
    mapping["tables"][0]["roles"][0]["unit"] = "rad"
    edited = imported(local, files, robot_id=robot_id, mapping=mapping)
    assert "mm away from the positions: look at the joints, their unit and the frame" in edited["faults"][0]


def test_a_mapping_that_names_no_column_of_the_files_asks_for_roles(local, files, robot_id):
    mapping = {**STATED, "tables": [{"table": ["*"], "roles": [{"columns": "Z", "role": "label"}]}]}
    shown = imported(local, files, robot_id=robot_id, mapping=mapping)
    assert shown["questions"][0]["field"] == "tables"


@pytest.mark.parametrize(
    ("mapping", "reason"),
    [
        ({"tables": [{"table": ["a"], "roles": [{"columns": "A", "role": "weight"}]}]}, "role"),
        ({"tables": [{"table": ["a"], "roles": [{"columns": "A", "role": "force", "unit": "mm"}]}]}, "force"),
        ({"template": True}, "template"),
    ],
)
def test_a_mapping_of_another_vocabulary_is_refused_with_its_place(local, files, mapping, reason):
    options = json.dumps({"mapping": mapping})
    answer = local.request("POST", "/v1/imports", files=files, data={"options": options})
    assert answer.status_code == 422
    assert reason in answer.text
