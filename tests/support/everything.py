"""A database of everything that the page can show: results of every verdict, live campaigns, 2,000 runs."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from copy import deepcopy
from functools import cache, partial
from pathlib import Path
from time import sleep
from typing import Any, Final, Literal

import sqlalchemy as sa
from support import live
from support.api import CANCEL, DELETE, job_at, made, post
from support.copied_rows import Copies, Names, Template, insert_rows, make_engine, make_id
from support.programs import path, small_program_options, tool_poses

from jointstiff.service.store.tables import jobs
from jointstiff.simulator import TARGETS, default_arm, robot_document, simulate_campaign
from jointstiff.simulator.programs import program_text

CASES: Final = Path(__file__).parents[1] / "cases" / "campaigns"
EXAMPLES: Final = Path(__file__).parents[2] / "examples"
ROBOTS, RUNS = 60, 2_000
"""Numbers of copied robots and runs."""
ALIKE: Final = 30
"""Number of robots of one kind with long names."""
LONG: Final = (
    "an arm of the third cell beside the paint shop, refitted in the spring, its gear of axis 2 exchanged"
)
LONG_WORD: Final = LONG.replace(" ", "_").replace(",", "")[:96].ljust(100, "x")
assert len(LONG) == len(LONG_WORD) == 100
LINKS: Final[dict[str, Any]] = {"elasticity": "diagonal_links", "link_penalty": 0.01}
QUICK: Final[dict[str, Any]] = {"cross_validation": {"folds": 2, "draws": 1}, "loss": "squared"}
"""Options of a competition of models in a second."""


@cache
def campaign(name: str) -> dict[str, Any]:
    """Return a campaign of the cases; nobody may change it."""
    document: dict[str, Any] = json.loads((CASES / f"{name}.json").read_text(encoding="utf-8"))
    return document


STORED_AT_ONCE = {"robots", "measurement-sets"}
"""Collections whose items need no work, so that there is nothing to wait for."""


class Filling:
    """What a service is asked for, one thing after the other."""

    def __init__(self, client: Any) -> None:
        self.client = client

    def add(self, collection: str, body: Any) -> str:
        """Post a body, and wait for what is made of it; return its id."""
        address = f"/v1/{collection}" if collection in STORED_AT_ONCE else f"/v1/{collection}?wait=60"
        return made(self.client, partial(self.client.post, address, json=body))

    def measure(self, document: Mapping[str, Any], robot: str | None = None, **changes: object) -> str:
        """Store the set of a campaign, of its own robot or of another; return its id."""
        robot = robot or self.add("robots", document["robot"])
        return self.add("measurement-sets", document["measurement_set"] | {"robot_id": robot} | changes)

    def identify(self, document: Mapping[str, Any], robot: str | None = None, **options: object) -> str:
        """Store a campaign, and identify it; return the id of the run."""
        return self.run(self.measure(document, robot), **(document.get("run", {}) | options))

    def run(self, measured: str, **options: object) -> str:
        return self.add("runs", {"measurement_set_id": measured} | options)

    def program(self, run: str, points: int, name: str = "corner.src") -> str:
        """Post a program of a smooth path; return the id of its job."""
        options = {"run_id": run} | small_program_options()
        files = {"files": (name, program_text("krl", tool_poses(path(points)), 4).encode())}
        data = {"options": json.dumps(options)}
        return made(self.client, partial(self.client.post, "/v1/corrections?wait=60", data=data, files=files))

    def live(self, name: str, readings: int, change: Callable[[dict[str, Any]], Any] = dict) -> str:
        """Open a campaign, and send some readings, the last one of them changed; return its id."""
        robot = self.add("robots", robot_document(live.ARM) | {"name": f"arm of {name}"})
        body = live.described(robot, live.OPEN, noise=live.EXACT, load_point=list(live.LOAD_POINT))
        address = f"/v1/measurement-sets/{self.add('measurement-sets', body | {'name': name})}"
        if readings > 1:
            live.measured(self.client, address, readings - 1)
        if readings > 0:
            live.measured(self.client, address, 1, change)
        return address.rpartition("/")[2]


def fill(client: Any, url: str) -> dict[str, str]:
    """Fill the database at `url` through its service; return names of what the page shows → ids."""
    filling = Filling(client)
    stored = many(filling, url) | of_one_arm(filling) | verdicts(filling) | campaigns_of_a_robot(filling)
    stored |= measured_live(filling) | with_long_names(filling)
    # The last: the service is stopped while these runs go on.
    return stored | in_motion(filling, url, stored["few"])


def many(filling: Filling, url: str) -> dict[str, str]:
    """Add many runs of many robots, older than all others."""
    document = campaign("few")
    robot = filling.add("robots", document["robot"])
    measured = filling.measure(document, robot)
    template = Template(robot, measured, filling.run(measured))
    copies = Copies([template], ROBOTS, RUNS, names=Names(set="check {:04}", first_serial_number=5_100))
    engine = make_engine(url)
    copies.add_robots_and_sets(engine)
    copies.add_runs(engine)
    engine.dispose()
    return {"few": template.run}


def of_one_arm(filling: Filling) -> dict[str, str]:
    """One of each job, of one arm that was measured twice."""
    robot = filling.add("robots", robot_document(default_arm()))
    places = {name: list(place) for name, place in TARGETS.items()}

    def measure(encoders: Literal["motor", "secondary"], seed: int) -> str:
        document = simulate_campaign(
            default_arm(encoders), configurations=12, load="dead_weight", encoders=encoders, seed=seed
        )
        return filling.measure(document, robot, flange_targets=places)

    first, second = measure("motor", 3), measure("secondary", 4)
    run, other = filling.run(first), filling.run(second)
    runs = [run, filling.run(first, method="decoupled_partial_pose")]
    sweeps = json.loads((EXAMPLES / "sweeps.json").read_text(encoding="utf-8"))
    plan = {
        "measurement_set_id": first,
        "readings": 4,
        "joints": [f"joint_{j}" for j in range(2, 7)],  # a weight never twists the first
    }
    step = {
        "robot_id": robot,
        "weight_step": {"mass": 100.0, "mass_uncertainty": 0.1},
        "load_point": [0.0, 0.0, 0.15],
        "joints": ["joint_2", "joint_3"],
        "readings": 12,
        "candidates": 100,
    }
    return {
        "robot": robot,
        "set": first,
        "other_set": second,
        "run": run,
        "comparison": filling.add("comparisons", {"run_ids": runs}),
        "pair": filling.add("comparisons", {"run_ids": [run, other], "ordered": True}),
        "plan": filling.add("plans", plan),
        "step_plan": filling.add("plans", step),
        "program": filling.program(run, 6),
        "long_program": filling.program(run, 400, "pocket.src"),
        "geometry": filling.add("geometries", sweeps | {"name": "sweeps"}),
    } | maps(filling, run)


def maps(filling: Filling, run: str) -> dict[str, str]:
    """Maps: whole, with cells out of reach, and without any."""
    tool = {"run_id": run, "place": [0.0, 0.0, 0.25], "turns": 4, "force": [0.0, 0.0, -900.0]}
    areas = {
        "map": [[1.2, -0.3, 0.6], [1.6, 0.3, 0.9]],
        "map_out_of_reach": [[1.2, -0.6, 0.6], [3.4, 0.6, 1.0]],
        "empty_map": [[9.0, 9.0, 9.0], [9.5, 9.5, 9.5]],
    }
    return {
        name: filling.add("maps", tool | {"area": area, "grid": [7, 5, 2]}) for name, area in areas.items()
    }


def verdicts(filling: Filling) -> dict[str, str]:
    """Runs of every verdict and of every kind of model, one cancelled and one deleted."""
    plain = campaign("stated_plain")
    another = robot_document(default_arm()) | {"name": "another arm"}
    runs = {
        "use": filling.identify(plain),
        "base": filling.identify(campaign("pedestal"), **QUICK),
        "links": filling.identify(campaign("beam_small"), **LINKS),
        "weight": filling.identify(campaign("weight_1")),
        "stiff": filling.identify(campaign("stiff_joint")),
        "two_postures": filling.identify(campaign("too_few")),
        "bounds": filling.identify(
            simulate_campaign(default_arm(), load="pull", configurations=12, sigma=3e-3, seed=2)
        ),
        "nothing": filling.identify(campaign("one_reading")),
        "exchanged": filling.identify(campaign("slip_swapped_both")),
        "opposite": filling.identify(campaign("slip_exchanged_states")),
        "millimetres": filling.identify(campaign("slip_millimetres")),
        "wrong_robot": filling.identify(plain, filling.add("robots", wrong(another))),
        "rail": filling.identify(campaign("rail")),
        "huber": filling.identify(plain, loss="huber", positive=False),
    }
    deleted = filling.identify(plain)
    assert filling.client.patch(job_at(deleted), json=DELETE).status_code == 200
    long = {"measurement_set_id": filling.measure(campaign("beam_small")), "elasticity": "joints_and_links"}
    cancelled = str(filling.client.post("/v1/runs?wait=0", json=long).json()["id"])
    assert filling.client.patch(job_at(cancelled), json=CANCEL).status_code == 200
    return runs | {"deleted": deleted, "cancelled": cancelled}


def wrong(robot: dict[str, Any]) -> dict[str, Any]:
    """Return the robot with its second joint turned round."""
    robot = deepcopy(robot)
    signs = [1.0, -1.0, 1.0, 1.0, 1.0, 1.0]
    matrix = [[sign if i == j else 0.0 for j in range(6)] for i, sign in enumerate(signs)]
    return robot | {"joint_map": {"matrix": matrix, "offset": [0.0] * 6}}


def campaigns_of_a_robot(filling: Filling) -> dict[str, str]:
    """Seven campaigns of a robot that wears, with a trend."""
    documents = [campaign(f"worn_{number}") for number in range(1, 8)]
    robot = filling.add("robots", documents[0]["robot"])
    sets = [filling.measure(document, robot) for document in documents]
    for measured in sets:
        filling.run(measured)
    return {
        "worn": robot,
    }


def measured_live(filling: Filling) -> dict[str, str]:
    """Live campaigns: without readings, with some, in doubt of one, and closed."""

    def turned_round(reading: dict[str, Any]) -> dict[str, Any]:
        return reading | {"force": [-part for part in reading["force"]]}

    closed = filling.live("closed campaign", 5)
    post(filling.client, f"/v1/measurement-sets/{closed}/close", None, 200)
    return {
        "live_fresh": filling.live("fresh campaign", 0),
        "live": filling.live("campaign under way", 5),
        "live_doubtful": filling.live("doubtful campaign", 6, turned_round),
        "live_closed": closed,
    }


def with_long_names(filling: Filling) -> dict[str, str]:
    """A run of which robot, set and program have names of 100 characters; thirty robots of one kind."""
    document = campaign("stated_plain")
    robot = filling.add("robots", document["robot"] | {"name": LONG})
    measured = filling.measure(
        document, robot, name=LONG_WORD, serial_number=LONG, operator=LONG, instrument=LONG
    )
    run = filling.run(measured)
    for number in range(ALIKE):
        filling.add("robots", document["robot"] | {"name": f"{LONG}, number {number}"})
    return {
        "long_robot": robot,
        "long_set": measured,
        "long_run": run,
        "long_names": filling.program(run, 6, f"{LONG_WORD[:96]}.src"),
    }


def in_motion(filling: Filling, url: str, template: str) -> dict[str, str]:
    """A run that computes and one that waits, until a service with workers comes; a copy that has failed."""
    long = {"measurement_set_id": filling.measure(campaign("beam_small")), "elasticity": "joints_and_links"}
    running, queued = (str(filling.client.post("/v1/runs?wait=0", json=long).json()["id"]) for _ in range(2))
    while filling.client.get(job_at(running)).json()["state"] != "running":
        sleep(0.1)
    failed = make_id(4, 0)
    engine = make_engine(url)
    copy = Copies([Template("", "", template)], 1, 1, names=Names(set="check {:04}")).run(0)
    insert_rows(engine, jobs, [copy | {"id": failed, "measurement_set_id": make_id(2, 0), "verdict": None}])
    with engine.begin() as connection:
        connection.execute(sa.update(jobs).where(jobs.c.id == failed).values(state="failed"))
    engine.dispose()
    return {"running": running, "queued": queued, "failed": failed}
