"""Campaigns with one mistake each, as people make them, and the action or the cause that mends it."""

import math
from collections.abc import Callable
from copy import deepcopy
from functools import cache
from typing import Any

import numpy as np

from jointstiff.simulator import TARGETS, default_arm, simulate_campaign


@cache
def clean_campaign() -> dict[str, Any]:
    """Return pulls of 1500 N in 19 postures, with the places of the targets; nobody may change it."""
    document = simulate_campaign(default_arm(), load="pull", configurations=19, seed=8)
    places = {name: list(place) for name, place in TARGETS.items()}
    return document | {"measurement_set": document["measurement_set"] | {"flange_targets": places}}


def positions(measured: dict[str, Any], change: Callable[..., Any]) -> None:
    """Change the positions without and with the load of each reading."""
    for observation in measured["observations"]:
        for reading in observation["readings"]:
            reading["unloaded"], reading["loaded"] = change(reading["unloaded"], reading["loaded"])


def millimetres_as_metres(measured: dict[str, Any]) -> None:
    """All that a tracker's software writes; what people state is in metres, as the set says."""
    positions(measured, lambda *both: [[1e3 * part for part in place] for place in both])


def whole_set_in_millimetres(measured: dict[str, Any]) -> None:
    """Load point, places and sigma, too."""
    millimetres_as_metres(measured)
    measured["load_point"] = [1e3 * part for part in measured["load_point"]]
    measured["noise"]["sigma"] *= 1e3
    measured["flange_targets"] = {
        name: [1e3 * part for part in place] for name, place in measured["flange_targets"].items()
    }


def degrees_as_radians(measured: dict[str, Any]) -> None:
    for observation in measured["observations"]:
        observation["joints"] = [math.degrees(angle) for angle in observation["joints"]]


def kilonewtons_as_newtons(measured: dict[str, Any]) -> None:
    for observation in measured["observations"]:
        observation["force"] = [1e-3 * part for part in observation["force"]]


def readings_exchanged(measured: dict[str, Any]) -> None:
    positions(measured, lambda unloaded, loaded: (loaded, unloaded))


def readings_of_one_target_exchanged(measured: dict[str, Any]) -> None:
    """Two columns of a table, as of a target whose columns are in the other order."""
    for observation in measured["observations"]:
        reading = next(each for each in observation["readings"] if each["target"] == "P10")
        reading["unloaded"], reading["loaded"] = reading["loaded"], reading["unloaded"]


def columns_exchanged(measured: dict[str, Any]) -> None:
    for observation in measured["observations"]:
        joints = observation["joints"]
        joints[1], joints[2] = joints[2], joints[1]


def zero_elsewhere(measured: dict[str, Any]) -> None:
    for observation in measured["observations"]:
        observation["joints"][2] += math.pi / 2


def load_and_target_exchanged(measured: dict[str, Any]) -> None:
    places, load = measured["flange_targets"], measured["load_point"]
    measured["load_point"], places["P11"] = places["P11"], load


def load_and_target_exchanged_by_observation(measured: dict[str, Any]) -> None:
    """Each observation states the same load point itself."""
    load_and_target_exchanged(measured)
    load = measured.pop("load_point")
    for observation in measured["observations"]:
        observation["load_point"] = load


def half_a_turn_elsewhere(measured: dict[str, Any]) -> None:
    """A whole turn more brings the angles within the limits."""
    for observation in measured["observations"]:
        observation["joints"][2] += math.pi


def load_point_elsewhere(measured: dict[str, Any]) -> None:
    measured["load_point"] = np.add(measured["load_point"], (0.03, -0.02, 0.04)).tolist()


def load_point_far_elsewhere(measured: dict[str, Any]) -> None:
    """By 141 mm: another joint map would explain something of it, too."""
    measured["load_point"] = np.add(measured["load_point"], (0.08, -0.06, 0.1)).tolist()


def load_point_at_the_flange(measured: dict[str, Any]) -> None:
    """By 191 mm, to the axis of joint 6: as stated, no pull twists it."""
    measured["load_point"] = [0.0, 0.0, 0.0]


def load_point_stated_too_well(measured: dict[str, Any]) -> None:
    """By 16 mm, which an assumed load point would contain, and one that a tracker measured does not."""
    measured["load_point"] = np.add(measured["load_point"], (-0.007, -0.01, 0.01)).tolist()
    measured["noise"] |= {"load_point": 0.001, "grounds": {"load_point": "tracker"}}


def weight_forgotten(measured: dict[str, Any]) -> None:
    """The robot also carried 300 N, which the forces leave out."""
    for observation in measured["observations"]:
        observation["force"][2] += 300.0


MISTAKES = {
    millimetres_as_metres: "convert_units",
    whole_set_in_millimetres: "convert_units",
    degrees_as_radians: "convert_units",
    kilonewtons_as_newtons: "convert_units",
    readings_exchanged: "exchange_readings",
    readings_of_one_target_exchanged: "exchange_readings",
    columns_exchanged: "exchange_columns",
    zero_elsewhere: "apply_joint_map",
    load_and_target_exchanged: "exchange_load_and_target",
    load_and_target_exchanged_by_observation: "exchange_load_and_target",
    half_a_turn_elsewhere: "apply_joint_map",
}


CAUSES = {
    load_point_elsewhere: "load_point",
    load_point_far_elsewhere: "load_point",
    load_point_at_the_flange: "load_point",
    load_point_stated_too_well: "load_point",
    weight_forgotten: "hook_weight",
}


def planted(clean: dict[str, Any], mistake: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """Return a campaign with a mistake."""
    document = deepcopy(clean)
    mistake(document["measurement_set"])
    return document
