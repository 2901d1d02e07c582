"""POST /v1/imports of files without names: the robot proposes, and one more request accepts."""

import json

import numpy as np
import pytest
from support.api import post
from support.measured_arms import TRACKER, measure, wide

from jointstiff.service.resources.known_robots import catalogue_robots

ARM = "KUKA KR 6 R900 sixx"
STATED = {"encoders": "motor", "load_point": [0, 0, 100], "force": [0, 0, -30], "units": {"force": "N"}}


def text_of(numbers):
    return "\n".join(" ".join(f"{each:.4f}" for each in row) for row in numbers).encode() + b"\n"


@pytest.fixture(scope="module")
def files():
    known = next(each for each in catalogue_robots() if each.name == ARM)
    joints, points = measure(known)
    tables = {"j.txt": joints, "u.txt": points[:, 0], "l.txt": points[:, 0] - [0.0, 0.0, 0.4]}
    return [("files", (name, text_of(numbers))) for name, numbers in tables.items()]


@pytest.fixture(scope="module")
def robot_id(local):
    robot = {"name": "cell 3", "model": {"format": "catalogue", "arm": ARM}}
    return post(local, "/v1/robots", robot)["id"]


def imported(local, files, **options):
    return local.request("POST", "/v1/imports", files=files, data={"options": json.dumps(options)})


def test_a_proposal_is_shown_and_one_more_request_makes_the_set(local, files, robot_id):
    shown = imported(local, files, robot_id=robot_id, show_faults=True, **STATED).json()
    assert shown["proposal"].startswith(
        "j.txt columns 1–6 as J1…J6 [deg], u.txt 1–3 as T1 unloaded [mm] and "
    )
    assert shown["measurement_set"] is None
    taken = imported(local, files, robot_id=robot_id, accept_proposal=True, **STATED).json()
    assert taken["faults"] == taken["missing"] == []
    assert len(taken["measurement_set"]["observations"]) == 16


def test_a_template_of_an_accepted_proposal_reads_files_without_names(local, files, robot_id):
    template = imported(local, files, robot_id=robot_id, accept_proposal=True, **STATED).json()["template"]
    again = imported(local, files, **{**template, "robot_id": robot_id}).json()
    assert again["targets"] == ["T1"]


def test_without_acceptance_or_a_robot_the_files_are_refused_as_before(local, files, robot_id):
    assert imported(local, files, robot_id=robot_id, **STATED).status_code == 422
    assert imported(local, files, accept_proposal=True, **STATED).status_code == 422


def test_names_that_say_everything_leave_the_frame_to_the_robot(local, robot_id):
    joints, points = measure(next(each for each in catalogue_robots() if each.name == ARM))
    seen = points[:, 0] @ TRACKER + [300.0, -200.0, 800.0]
    states = [f"P10 {state} {axis} [mm]" for state in ("unloaded", "loaded") for axis in "xyz"]
    header = " ".join(f'"{each}"' for each in ["label", *(f"J{n} [deg]" for n in range(1, 7)), *states])
    rows = wide(np.arange(16)[:, None], joints, seen, seen - [0.0, 0.0, 0.4] @ TRACKER)
    files = [("files", ("named.txt", header.encode() + b"\n" + text_of(rows)))]
    shown = imported(local, files, robot_id=robot_id, **STATED).json()
    assert "as P10 loaded [mm] in a frame of the instrument fit" in shown["proposal"]
    assert "frame_mistaken" in {each["code"] for each in shown["findings"]}
    taken = imported(local, files, robot_id=robot_id, accept_proposal=True, **STATED).json()
    assert "frame_mistaken" not in {each["code"] for each in taken["findings"]}
    (reading,) = taken["measurement_set"]["observations"][0]["readings"]
    assert reading["target"] == "P10"
    assert np.subtract(reading["loaded"], reading["unloaded"]) == pytest.approx([0, 0, -0.4], abs=0.01)
