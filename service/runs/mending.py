"""Mended campaigns: the action of a reason applied to robot, readings or options."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import log
from typing import Any, Final

import numpy as np

from jointstiff.schemas.fields import Vector3
from jointstiff.schemas.finding import Action, Assessment
from jointstiff.schemas.measurement import MeasurementSetDocument, Noise, Observation, Reading, Units
from jointstiff.schemas.robot import JointMap
from jointstiff.schemas.run import Campaign
from jointstiff.service.conversion.catalogue import find_arm, nominal_robot
from jointstiff.service.conversion.prepared import prepare_robot, without
from jointstiff.service.conversion.units import LENGTH
from jointstiff.solver.errors import RequestError

_Set = MeasurementSetDocument
_OPTIONS: Final[Mapping[str, Mapping[str, str]]] = {
    "use_huber": {"loss": "huber"},
    "include_complementary_stiffness": {"complementary_stiffness": "included"},
    "choose_model": {"elasticity": "automatic", "loss": "automatic"},
}
"""Options of the run that an action changes."""


_PLACE, _SIGMA = 0.2, 2e-5
"""Usual distance of a load point or target from the flange, and uncertainty of a tracker's reading [m]."""
_LONGEST_NAME: Final = 200


def advised(assessment: Assessment, kind: str) -> Action:
    """Return the first action of a kind that the reasons of an assessment advise.

    Raises:
        RequestError: there is none.
    """
    actions = [reason.action for reason in assessment.reasons if reason.action is not None]
    kinds = list(dict.fromkeys(action.kind for action in actions if action.kind != "show_posture"))
    advised_action = next((action for action in actions if action.kind == kind and kind in kinds), None)
    if advised_action is None:
        remedy = f"give one of: {', '.join(kinds)}" if kinds else "no reason has an action: read the remedies"
        raise RequestError(f"the assessment does not advise '{kind}'", where="apply", remedy=remedy)
    return advised_action


def mended(campaign: Campaign, action: Action) -> Campaign:
    """Return a campaign after an action, its changed parts under names that say so.

    A robot that is chosen by its id is the store's to fetch, and the campaign keeps its own.

    Raises:
        RequestError: the action changes nothing, or the set does not state what it changes.
    """
    measured = campaign.measurement_set
    if action.kind in _OPTIONS:
        return campaign.model_copy(update={"run": campaign.run.model_copy(update=_OPTIONS[action.kind])})
    if action.kind == "fit_causes":
        causes = [*campaign.run.causes, *action.causes]
        return campaign.model_copy(update={"run": campaign.run.model_copy(update={"causes": causes})})
    if action.kind == "apply_joint_map":
        joint_map = JointMap(matrix=action.joint_map, offset=action.offset)
        changes = {"joint_map": joint_map, "name": _rename_target(campaign.robot.name, "joint map corrected")}
        return campaign.model_copy(update={"robot": campaign.robot.model_copy(update=changes)})
    if action.kind == "choose_robot":
        name = action.robot or ""
        robot = campaign.robot if action.robot_id is not None else nominal_robot(find_arm(name, "apply"))
        measured = measured.model_copy(update={"name": _rename_target(measured.name, name)})
        return campaign.model_copy(update={"robot": robot, "measurement_set": measured})
    if action.kind == "exchange_columns":
        names = prepare_robot(campaign.robot).robot.joint_names
        measured = _with_columns_exchanged(measured, [names.index(name) for name in action.joints])
    elif action.kind in _SETS:
        measured = _SETS[action.kind](measured, action)
    else:
        raise RequestError(
            f"'{action.kind}' changes nothing", where="apply", remedy="follow the remedy of the reason"
        )
    label = f"in {action.unit}" if action.unit else action.kind.replace("_", " ")
    measured = measured.model_copy(update={"name": _rename_target(measured.name, label)})
    return campaign.model_copy(update={"measurement_set": measured})


def _rename_target(name: str, label: str) -> str:
    return f"{name[: _LONGEST_NAME - len(label) - 3]} ({label})"


def _change_each(measured: _Set, change: Callable[[Observation], Mapping[str, object]]) -> list[Observation]:
    return [each.model_copy(update=dict(change(each))) for each in measured.observations]


def _with_refuted_noise(measured: _Set, _action: Action) -> _Set:
    """Keep the tracker's noise on record, of the set or of its readings, as refuted."""
    noise = measured.noise or Noise(refuted=True)
    return measured.model_copy(update={"noise": noise.model_copy(update={"refuted": True})})


def _with_columns_exchanged(measured: _Set, places: Sequence[int]) -> _Set:
    first, second = places

    def exchanged(each: Observation) -> dict[str, object]:
        joints = list(each.joints)
        joints[first], joints[second] = joints[second], joints[first]
        return {"joints": joints}

    return measured.model_copy(update={"observations": _change_each(measured, exchanged)})


def _with_target_exchanged(measured: _Set, action: Action) -> _Set:
    target, places = action.target or "", measured.flange_targets
    if target not in places:
        raise RequestError(
            f"the set does not state where target '{target}' is on the flange",
            where="measurement_set.flange_targets",
            remedy="check the load point, and correct it in the set",
        )
    own = measured.load_point or (0.0, 0.0, 0.0)
    load, *others = dict.fromkeys(each.load_point or own for each in measured.observations)
    if others:
        raise RequestError(
            f"the load has {1 + len(others)} places, and only one can be that of a target",
            where="measurement_set.observations",
            remedy="check the load points, and correct them in the set",
        )
    return measured.model_copy(
        update={
            "load_point": places[target],
            "flange_targets": {**places, target: load},
            "observations": _change_each(measured, lambda _: {"load_point": None}),
        }
    )


def _with_readings_exchanged(measured: _Set, _action: Action) -> _Set:
    def exchanged(each: Observation) -> dict[str, object]:
        return {
            "readings": [
                one.model_copy(
                    update={
                        "unloaded": one.loaded,
                        "loaded": one.unloaded,
                        "unloaded_covariance": one.loaded_covariance,
                        "loaded_covariance": one.unloaded_covariance,
                        "deflection": one.deflection and tuple(-part for part in one.deflection),
                        "displacement": None if one.displacement is None else -one.displacement,
                    }
                )
                for one in each.readings
            ]
        }

    return measured.model_copy(update={"observations": _change_each(measured, exchanged)})


def _with_units(measured: _Set, action: Action) -> _Set:
    """Declare another unit for the numbers as they are.

    Load points, places of targets and the noise are often stated by hand, in the unit that the set declares:
    they keep their size where that is nearer to the usual one.
    """
    units, unit = measured.units, action.unit
    if unit in {"deg", "rad"}:
        return measured.model_copy(update={"units": units.model_copy(update={"angle": unit})})
    force = "kgf" if units.force == "kg" else units.force
    moment = units.moment or (f"{force}.m" if units.length == "m" else None)
    if unit in {"N", "kN"}:
        changed = {"force": unit, "moment": units.moment}
        return measured.model_copy(update={"units": units.model_copy(update=changed)})
    new_units = Units.model_validate({**units.model_dump(), "length": unit, "moment": moment})
    old, new = LENGTH[units.length], LENGTH[new_units.length]
    return _with_lengths(measured.model_copy(update={"units": new_units}), old, new)


def _with_lengths(measured: _Set, old: float, new: float) -> _Set:
    def factor(size: float, usual: float) -> float:
        """Return what a number is multiplied by to keep its size; 1 if it is in the new unit, too."""
        kept = size == 0.0 or abs(log(old * size / usual)) <= abs(log(new * size / usual))
        return old / new if kept else 1.0

    def placed(place: Vector3 | None) -> Vector3 | None:
        if place is None:
            return None
        x, y, z = (factor(float(np.linalg.norm(place)), _PLACE) * part for part in place)
        return x, y, z

    noise = measured.noise
    if noise is not None and noise.sigma is not None:
        scale = factor(noise.sigma, _SIGMA)
        lengths = {name: getattr(noise, name) for name in ("sigma", "load_point", "target_places")}
        noise = noise.model_copy(
            update={name: None if size is None else scale * size for name, size in lengths.items()}
        )

    def scaled(one: Reading) -> Reading:
        sigma = one.sigma and factor(one.sigma, _SIGMA) * one.sigma
        return one.model_copy(update={"sigma": sigma})

    changes: dict[str, Any] = {
        "noise": noise,
        "load_point": placed(measured.load_point),
        "flange_targets": {name: placed(place) for name, place in measured.flange_targets.items()},
        "observations": _change_each(
            measured,
            lambda each: {
                "load_point": placed(each.load_point),
                "readings": [scaled(one) for one in each.readings],
            },
        ),
    }
    return measured.model_copy(update=changes)


_SETS: Final[Mapping[str, Callable[[_Set, Action], _Set]]] = {
    "leave_out_readings": lambda measured, action: measured.model_copy(
        update={"observations": without(measured.observations, action.observations)}
    ),
    "omit_noise": _with_refuted_noise,
    "exchange_load_and_target": _with_target_exchanged,
    "exchange_readings": _with_readings_exchanged,
    "convert_units": _with_units,
}
"""Measurement sets after an action."""
