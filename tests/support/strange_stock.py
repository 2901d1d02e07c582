"""A stock of somebody who does not know the page: odd but legal robots and campaigns, by the API alone."""

from __future__ import annotations

import json
from time import sleep
from typing import Any, Final

import numpy as np
from support.api import CANCEL, job_at
from support.everything import EXAMPLES, LINKS, Filling, campaign
from support.slides import scara

from jointstiff.simulator import SpringArm, default_arm, robot_document, simulate_campaign

ROBOTS: Final = 60
"""Number of robots of equal names."""
EMOJI: Final = (
    "🦾 Zelle 7 ▸ Roboter „Große Berta“ – geprüft ✅, 倉庫の溶接ロボット 第三号機 (Ersatz für № 12)"
)
RIGHT_TO_LEFT: Final = "ذراع اللحام رقم ٣ في الورشة الجنوبية بعد الصيانة السنوية"
JOINT_NAMES: Final = (
    *("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint_with_the_new_gearbox"),
    *("מפרק_חמישי", "关节六", "ausgang_z_drehung"),
)
"""Names that people give to joints."""

_UP, _ACROSS = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])


def chain(count: int, length: float, stiffness: float) -> SpringArm:
    """Return an arm of joints that turn in turns about its axis and across it, `length` [m] apart."""
    heights = length * np.arange(1, count + 1)
    lean = 0.3 * length * (np.arange(count) % 3)
    return SpringArm(
        axis_points=np.column_stack([lean, 0.0 * heights, heights]),
        axis_directions=np.array([_ACROSS if joint % 2 else _UP for joint in range(count)]),
        flange_rotation=np.eye(3),
        flange_translation=np.array([0.2, 0.0, length * (count + 1)]),
        stiffnesses=np.full(count, stiffness),
        limits=np.tile([-2.0, 2.0], (count, 1)),
    )


def swing() -> SpringArm:
    """Return an arm of one joint, which turns across its axis."""
    return SpringArm(
        axis_points=np.array([[0.0, 0.0, 0.5]]),
        axis_directions=np.array([_ACROSS]),
        flange_rotation=np.eye(3),
        flange_translation=np.array([1.1, 0.0, 0.5]),
        stiffnesses=np.array([0.8e6]),
        limits=np.array([[-2.0, 2.0]]),
    )


def measured(arm: SpringArm, name: str, names: tuple[str, ...] = (), **options: Any) -> dict[str, Any]:
    """Return a campaign of an arm with a name, whose joints have names of their own."""
    chosen: dict[str, Any] = {"load": "pull", "configurations": 12, "seed": 5}
    document = simulate_campaign(arm, **chosen | options)
    robot = robot_document(arm) | {"name": name}
    urdf = robot["model"]["urdf"]
    for number, joint in enumerate(names, 1):
        urdf = urdf.replace(f'"joint_{number}"', f'"{joint}"')
    robot["model"] = robot["model"] | {"urdf": urdf}
    document["robot"] = robot
    document["measurement_set"]["name"] = f"{name}, {document['measurement_set']['name']}"
    return document


def fill(client: Any) -> dict[str, str]:
    """Fill a service; return names of what is stored → ids."""
    filling = Filling(client)
    stored = odd_arms(filling) | equal_names(filling)
    # The last: the service is stopped while these runs go on.
    return stored | unfinished(filling)


def odd_arms(filling: Filling) -> dict[str, str]:
    """Arms of one joint, of 7, of 32 and with a slide; results of them, of which one is of no use."""
    cobot = measured(
        chain(7, 0.18, 2.5e4),
        EMOJI,
        JOINT_NAMES,
        force=90.0,
        targets={"👁 links": (0.0, 0.1, 0.05), "هدف": (0.1, 0.0, 0.1)},
    )
    robot = filling.add("robots", cobot["robot"])
    of_cobot = filling.measure(cobot, robot, serial_number=RIGHT_TO_LEFT, operator="Łukasz O’Neill 🧑‍🏭"[:14])
    run = filling.run(of_cobot)
    six = measured(default_arm(), RIGHT_TO_LEFT, JOINT_NAMES[:6])
    arm = filling.add("robots", six["robot"])
    of_six = filling.measure(six, arm)
    of_arm = filling.run(of_six)
    millimetres = campaign("slip_millimetres")["measurement_set"] | {"name": f"{EMOJI} (mm?)"}
    unusable = filling.run(filling.add("measurement-sets", millimetres | {"robot_id": arm}))
    step = json.loads((EXAMPLES / "weight_step.json").read_text(encoding="utf-8"))
    tool = {"run_id": of_arm, "place": [0.0, 0.0, 0.25], "turns": 4, "force": [0.0, 0.0, -900.0]}
    return {
        "cobot": robot,
        "cobot_set": of_cobot,
        "cobot_run": run,
        "arm": arm,
        "arm_run": of_arm,
        "unusable": unusable,
        "one": filling.identify(measured(swing(), "1")),
        "many": filling.identify(measured(chain(32, 0.12, 4e5), "❄" * 40, force=60.0, configurations=40)),
        "scara": filling.identify(measured(scara(), "SCARA z↓", ("φ₁", "φ₂", "z", "φ₄"), force=200.0)),
        "pair": filling.add("comparisons", {"run_ids": [of_arm, unusable]}),
        "map": filling.add("maps", tool | {"area": [[1.2, -0.3, 0.6], [1.6, 0.3, 0.9]], "grid": [5, 3, 1]}),
        "gearbox": filling.add("gearboxes", step | {"name": EMOJI}),
    }


def equal_names(filling: Filling) -> dict[str, str]:
    """Many robots of one name, and of one alone a campaign that nobody identified."""
    document = robot_document(default_arm()) | {"name": "Robot"}
    robots = [filling.add("robots", document | {"payload": 10.0 + number}) for number in range(ROBOTS)]
    few = campaign("few")["measurement_set"] | {"robot_id": robots[7], "name": "Robot"}
    return {"bare": robots[8], "unidentified": filling.add("measurement-sets", few)}


def unfinished(filling: Filling) -> dict[str, str]:
    """A run that was cancelled, one that computes and one that waits, until a service with workers comes."""
    long = {"measurement_set_id": filling.measure(campaign("beam_small")), "elasticity": "joints_and_links"}
    long |= LINKS | {"elasticity": "joints_and_links"}
    post = filling.client.post
    cancelled, running, queued = (str(post("/v1/runs?wait=0", json=long).json()["id"]) for _ in range(3))
    assert filling.client.patch(job_at(cancelled), json=CANCEL).status_code == 200
    while filling.client.get(job_at(running)).json()["state"] == "queued":
        sleep(0.1)
    return {"cancelled": cancelled, "running": running, "queued": queued}
