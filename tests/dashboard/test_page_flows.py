"""Flows on the page that need no more than its own words: those of flows.txt."""

import csv
import io
import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import httpx2
import numpy as np
import openpyxl
import pytest
from support.api import post, posted
from support.browsing import ROOT, campaign
from support.page_flows import Flow, flows_of
from support.processes import Service
from support.programs import START, path, tool_poses

from jointstiff.simulator import TARGETS, default_arm, simulate_campaign
from jointstiff.simulator.document import robot_document
from jointstiff.simulator.programs import program_text
from jointstiff.simulator.urdf import urdf_text

FLOWS = flows_of(Path(__file__).with_name("flows.txt"))
ARMS = ("arm of the table", "arm of the spreadsheet", "older of two arms", "newer of two arms")
TREND = "from a robot to a trend"
FEW_ROBOTS = (
    "from a table to its result in five taps and a field, and the next one in four taps",
    "from a spreadsheet to its report as PDF in six taps and a field",
    "six taps among several robots that fit, of which the page chooses none",
)
"""Flows where at most three robots fit: of more, the page makes a list."""
SIZES = [pytest.param("tablet", marks=pytest.mark.slow), "phone"]
WEIGHT_STEP = """\
label;J1 [deg];J2 [deg];J3 [deg];J4 [deg];J5 [deg];J6 [deg];joint;state;motor [deg];link [deg]
p1;0;-60;90;0;30;0;joint_2;unloaded;-60.0000;-60.0002
p1;0;-60;90;0;30;0;joint_2;loaded;-60.0001;-59.9803
"""
OPTIONS = {"positive": False, "stiffness_order": [["joint_2", "joint_4"]], "confidence": 0.9}


def workbook(text):
    """Return a workbook with the cells of a table, numbers as numbers."""
    book = openpyxl.Workbook()
    for row in csv.reader(io.StringIO(text), delimiter=";", quoting=csv.QUOTE_NONE):
        book.active.append([float(cell) if cell[-1].isdigit() and "c" not in cell else cell for cell in row])
    output = io.BytesIO()
    book.save(output)
    return output.getvalue()


def contents():
    """Files by the names that flows have for them."""
    two, wrong = campaign(load="dead_weight", seed=41), campaign(load="dead_weight", seed=42)
    two["measurement_set"]["observations"][3]["joints"] = [0.1, 0.2]
    for observation in wrong["measurement_set"]["observations"]:
        observation["force"] = [0, 0, -observation["force"][2]]
    readings = (ROOT / "examples" / "readings.csv").read_text(encoding="utf-8")
    first, *rows = readings.splitlines()
    spoiled = rows[7].replace(";", ";1.2.3;", 1).rpartition(";")[0]
    head, _, tail = program_text("krl", tool_poses(path(6)), 4).rpartition("END")
    return {
        "two of six joints": two,
        "forces the wrong way round": wrong,
        "options": campaign(load="pull", seed=32) | {"run": OPTIONS},
        "pull": campaign(load="pull", seed=31),
        "readings": readings,
        "workbook": workbook(readings),
        "with a bad number": "\n".join([first, *rows[:7], spoiled, *rows[8:]]),
        "degrees called radians": readings.replace("[deg]", "[rad]"),
        "two postures without names": "\n".join(row.partition(";")[2] for row in rows[:2]),
        "weight step": WEIGHT_STEP,
        "before and after": readings.replace("unloaded", "before").replace("loaded", "after"),
        "pre and post": readings.replace("unloaded", "pre").replace("loaded", "post"),
        "relative move": f"{head}LIN_REL {{X 5}}\nEND{tail}",
        "targets in mm": "\n".join(
            f"{name} {1e3 * x:g} {1e3 * y:g} {1e3 * z:g}" for name, (x, y, z) in TARGETS.items()
        ),
        "two lines": "before\nthe repair",
    }


def a_run(api, stored, **options):
    """Return a run of the first set."""
    return post(api, "/v1/runs", {"measurement_set_id": stored.set, **options})["id"]


def robot(api, name, **changes):
    """Return a robot of a name."""
    return post(api, "/v1/robots", {**robot_document(default_arm()), "name": name} | changes)["id"]


def twice(api, name):
    """Return a robot without a joint map, whose name another one with a map has, too."""
    first = robot(api, name, joint_map=None)
    robot(api, name)
    return first


def deleted(api, collection, body):
    """Return what was made and deleted."""
    made = post(api, f"/v1/{collection}", body)["id"]
    api.patch(f"/v1/jobs/{made}", json={"deleted": True})
    return made


def compared(api, stored):
    """Return the runs of the pair that is stored."""
    return api.get(f"/v1/jobs/{stored.pair}").json()["request"]["run_ids"]


def worst(api, stored):
    """Return the greatest deflection of the map that is stored [m]."""
    return api.get(f"/v1/jobs/{stored.map}").json()["result"]["worst"]["deflection"]


def unusable(api):
    """Return a run whose columns of two joints are exchanged, on a robot of its own."""
    document = campaign(load="pull", configurations=12, seed=8)
    for observation in document["measurement_set"]["observations"]:
        joints = observation["joints"]
        joints[1], joints[2] = joints[2], joints[1]
    return posted(api, document)["id"]


def noted(api):
    """Return a set on a robot of its own."""
    document = campaign(load="pull", seed=31)
    robot = post(api, "/v1/robots", document["robot"] | {"name": "noted arm"})["id"]
    readings = document["measurement_set"] | {"robot_id": robot, "name": "noted set"}
    return post(api, "/v1/measurement-sets", readings)["id"]


def worn(api):
    """Return a robot that is softer in the last of its four campaigns."""
    arm = default_arm()
    soft = replace(arm, stiffnesses=arm.stiffnesses * np.array([1.0, 1.0, 0.85, 1.0, 1.0, 1.0]))
    documents = [
        simulate_campaign(each, load="pull", configurations=10, seed=seed)
        for seed, each in enumerate([arm, arm, arm, soft])
    ]
    robot = post(api, "/v1/robots", documents[0]["robot"] | {"name": "worn robot"})["id"]
    for month, document in enumerate(documents, start=1):
        stated = {"robot_id": robot, "measured_at": f"2026-{month:02d}-10T08:00:00Z", "serial_number": "W-1"}
        made = post(api, "/v1/measurement-sets", document["measurement_set"] | stated)
        post(api, "/v1/runs", {"measurement_set_id": made["id"]})
    return robot


@pytest.mark.parametrize("flow", [name for name in FLOWS if name not in {TREND, *FEW_ROBOTS}])
def test_flow(visit, api, stored, flow):
    start = " ".join(f"{math.degrees(angle):.3f}" for angle in START)
    made = {
        "spare": partial(a_run, api, stored, method="complete_pose"),
        "omitting": partial(a_run, api, stored, leave_out=["c03"]),
        "worst": lambda: f"{1e6 * worst(api, stored):.4g}"[:4],
        "deleted run": lambda: deleted(api, "runs", {"measurement_set_id": stored.other_set}),
        "deleted comparison": lambda: deleted(api, "comparisons", {"run_ids": compared(api, stored)}),
        "arm of the six taps": partial(twice, api, "arm of the six taps"),
        "newest run": lambda: api.get("/v1/jobs?kind=run").json()["items"][0]["id"],
        **{each.__name__: partial(each, api) for each in (unusable, noted, worn)},
    }
    Flow(visit, api, contents(), {**vars(stored), "start": start, **made}).carry_out(FLOWS[flow])


@pytest.mark.parametrize("flow", FEW_ROBOTS)
def test_flow_where_few_robots_fit(visit, bundle, tmp_path, flow):
    """In a service of its own, where no other test adds robots."""
    service = Service(f"sqlite:///{tmp_path / 'jointstiff.db'}")
    try:
        with httpx2.Client(base_url=service.url, timeout=None) as api:
            made = {name: partial(robot, api, name) for name in ARMS}
            made["newest run"] = lambda: api.get("/v1/jobs?kind=run").json()["items"][0]["id"]
            Flow(partial(visit, service=service), api, contents(), made).carry_out(FLOWS[flow])
    finally:
        service.stop()


@pytest.mark.parametrize("size", SIZES)
def test_from_a_robot_to_a_trend(visit, api, size):
    """Add a robot, drop readings, identify, look at all parts, compare methods and sets, see the trend."""
    files = {"urdf": urdf_text(default_arm())}
    for encoders, seed in (("motor", 21), ("secondary", 22)):
        document = campaign(load="dead_weight", encoders=encoders, seed=seed)["measurement_set"]
        files[encoders] = document | {"name": f"{size} {encoders}"}
    Flow(visit, api, files, {"size": size}).carry_out(FLOWS[TREND])
