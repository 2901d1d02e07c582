"""The measured logs of a KUKA KR 300, as a request for its gearboxes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.shared_data import MISSING, SHARED

import jointstiff as js

FOLDER = SHARED / "kr300"


def read_kr300(logs: tuple[str, ...] = ("log_A", "log_B"), payload: float = 150.0) -> dict[str, Any]:
    """Return the fields of `gearbox` for logs of the arm; skip the test where the data are absent."""
    if not FOLDER.is_dir():
        pytest.skip(MISSING)
    arm = json.loads((FOLDER / "robot.json").read_text())
    rows = [
        {
            "theta": float(np.radians(link["theta_offset_deg"])),
            "d": link["d_m"],
            "a": link["a_m"],
            "alpha": link["alpha_rad"],
        }
        for link in arm["links"]
    ]
    robot = js.robot(rows, convention="standard", name="KR 300", units="m, rad, N", payload=300.0)
    bodies = [_body(link) for link in arm["links"] if link["mass_kg"]]
    tool = arm["tool_and_payload"]
    last = _place(arm["links"][-1], tool["centre_of_link_6_mm"])
    bodies.append({"name": "link 6", "joint": "joint_6", "mass": tool["link_6_kg"], "centre": last})
    return {
        "robot": robot,
        "units": {"length": "m", "angle": "deg"},
        "gravity": [0.0, 0.0, 9.80665],  # the table's base points down
        "motion": {
            "logs": [js.read_log(Path(FOLDER / f"{name}.csv"), robot) for name in logs],
            "payload": {"mass": payload, "point": [1e-3 * part for part in tool["centre_of_payload_mm"]]},
            "bodies": bodies,
            "gas_springs": [_spring(arm["balancer"])],
            "start": arm["start_posture_deg"],
        },
    }


def _turn(link: dict[str, Any]) -> np.ndarray:
    """Return the rotation (3, 3) from a link's frame to the frame that moves with its joint."""
    cosine, sine = np.cos(link["alpha_rad"]), np.sin(link["alpha_rad"])
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])


def _place(link: dict[str, Any], point: list[float]) -> list[float]:
    """Return a point of a link's frame [mm] in the frame that moves with its joint [m]."""
    origin = np.array([link["a_m"], 0.0, link["d_m"]])
    return [float(part) for part in _turn(link) @ (1e-3 * np.array(point)) + origin]


def _body(link: dict[str, Any]) -> dict[str, Any]:
    """Return a link as a body, with its inertia turned into the frame of its joint."""
    xx, yy, zz, xy, yz, xz = 1e-6 * np.array(link["inertia_kgmm2_xx_yy_zz_xy_yz_xz"])
    turn = _turn(link)
    inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    return {
        "name": f"link {link['joint']}",
        "joint": f"joint_{link['joint']}",
        "mass": link["mass_kg"],
        "centre": _place(link, link["centre_of_mass_mm"]),
        "inertia": inertia[np.triu_indices(3)].tolist(),
    }


def _spring(balancer: dict[str, Any]) -> dict[str, Any]:
    """Return the gas spring of joint 2; its pressure by the law of gases."""
    area = 0.25 * np.pi * (balancer["piston_diameter_m"] ** 2 - balancer["rod_diameter_m"] ** 2)
    energy = (
        balancer["compressibility_at_176_bar"]
        * balancer["gas_constant_J_per_kgK"]
        * balancer["temperature_K"]
        * balancer["gas_mass_kg"]
    )
    return {
        "joint": "joint_2",
        "radius_before": balancer["lever_points_m"]["D"],
        "radius_behind": balancer["lever_points_m"]["k"],
        "angle": float(balancer["angle_offset_deg"]),
        "area": area,
        "pressure": energy / balancer["largest_volume_m3"],
        "volume": balancer["largest_volume_m3"],
    }
