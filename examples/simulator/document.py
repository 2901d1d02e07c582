"""Campaign documents as the service takes them, written from arrays in SI units and read back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from jointstiff.simulator.arm import Encoders, FloatArray, SpringArm
from jointstiff.simulator.experiment import Experiment, Targets
from jointstiff.simulator.units import Scales, in_unit
from jointstiff.simulator.urdf import BASE_LINK, FLANGE_LINK, urdf_text

__all__ = ["Document", "Readings", "experiment_of", "measurement_set", "robot_document"]

Document = dict[str, Any]
Readings = Literal["positions", "deflections"]

DEFLECTION_DECIMALS = 14  # [m]: drops what subtracting positions of metres leaves of their rounding


def robot_document(arm: SpringArm) -> Document:
    """The robot as `POST /v1/robots` takes it, with its kinematics as URDF.

    Args:
        arm: The arm.
    """
    name = "simulated " + ("robot with slides" if arm.prismatic else f"{len(arm.stiffnesses)}R")
    model = {
        "format": "urdf",
        "urdf": urdf_text(arm, name),
        "base": BASE_LINK,
        "flange": FLANGE_LINK,
    }
    payload = {} if arm.payload is None else {"payload": arm.payload}
    return {"name": name, "model": model, **payload}


def measurement_set(
    experiment: Experiment,
    targets: Targets,
    unloaded: FloatArray,
    loaded: FloatArray,
    *,
    name: str,
    units: Mapping[str, str],
    encoders: Encoders,
    readings: Readings,
    sigma: float | None,
) -> Document:
    """The measurement set as `POST /v1/measurement-sets` takes it, but for the robot's id.

    Args:
        experiment: Configurations and loads of the N observations.
        targets: The T targets in the flange frame [m].
        unloaded: Positions read without load, in R0 [m], (N, T, 3).
        loaded: Positions read with load, in R0 [m], (N, T, 3).
        name: Name of the set.
        units: Units to write in.
        encoders: Which encoders close the position loop.
        readings: Positions, or deflections together with the targets in the flange frame.
        sigma: Standard deviation to state [m]; None to state none.
    """
    scales = Scales.of(units)
    document: Document = {"name": name, "units": dict(units), "encoders": encoders}
    if sigma is not None:
        document["noise"] = {"sigma": in_unit(sigma, scales.length)}
    if readings == "deflections":
        document["flange_targets"] = {
            target: in_unit(point, scales.length) for target, point in targets.items()
        }
    observations = _observations(experiment, scales, scales.of_joints(experiment.slides))
    for i, observation in enumerate(observations):
        observation["readings"] = [
            {"target": target, **_reading(unloaded[i, t], loaded[i, t], readings, scales.length)}
            for t, target in enumerate(targets)
        ]
    if np.all(experiment.load_points == experiment.load_points[0]):
        document["load_point"] = observations[0]["load_point"]
        for observation in observations:
            del observation["load_point"]
    return {**document, "observations": observations}


def experiment_of(document: Document) -> Experiment:
    """Configurations and loads of a campaign document, back in SI units.

    Args:
        document: A campaign of `simulate_campaign`.
    """
    measured = document["measurement_set"]
    scales = Scales.of(measured["units"])
    observations = measured["observations"]
    load_points = [o.get("load_point", measured.get("load_point")) for o in observations]
    kinds = [text.split('"')[0] for text in document["robot"]["model"]["urdf"].split(' type="')[1:]]
    slides = np.array([kind == "prismatic" for kind in kinds if kind != "fixed"])
    return Experiment(
        joints=scales.of_joints(slides) * np.array([o["joints"] for o in observations]),
        forces=scales.force * np.array([o["force"] for o in observations]),
        moments=scales.moment * np.array([o["moment"] for o in observations]),
        load_points=scales.length * np.array(load_points),
        slides=slides,
    )


def _observations(experiment: Experiment, scales: Scales, of_joints: FloatArray) -> list[Document]:
    """The observations without their readings; joints in units worth so many rad or m, (n,)."""
    return [
        {
            "label": f"c{i + 1:02d}",
            "joints": in_unit(experiment.joints[i], of_joints),
            "force": in_unit(experiment.forces[i], scales.force),
            "moment": in_unit(experiment.moments[i], scales.moment),
            "load_point": in_unit(experiment.load_points[i], scales.length),
        }
        for i in range(len(experiment.joints))
    ]


def _reading(unloaded: FloatArray, loaded: FloatArray, readings: Readings, length: float) -> Document:
    """One target's reading, in a unit of length worth so many metres."""
    if readings == "positions":
        return {"unloaded": in_unit(unloaded, length), "loaded": in_unit(loaded, length)}
    deflection = np.round(loaded - unloaded, DEFLECTION_DECIMALS)
    return {"deflection": in_unit(deflection, length)}
