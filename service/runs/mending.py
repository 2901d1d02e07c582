"""Corrected campaigns: an action that an assessment advises, applied to robot, readings or options."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import log
from typing import Any, Final

import numpy as np

from jointstiff.schemas.fields import GREATEST_PAYLOAD, LEAST_PAYLOAD, Vector3
from jointstiff.schemas.finding import AdvisedAction, Assessment
from jointstiff.schemas.measurement import MeasurementSetDocument, Noise, Observation, Reading, Units
from jointstiff.schemas.robot import JointMap, RobotDocument
from jointstiff.schemas.run import Campaign
from jointstiff.service.conversion.catalogue import find_arm, nominal_robot
from jointstiff.service.conversion.prepared import leave_out_observations, prepare_robot
from jointstiff.service.conversion.units import FORCE, LENGTH
from jointstiff.solver.errors import RequestError

_Set = MeasurementSetDocument
_OPTION_CHANGES: Final[Mapping[str, Mapping[str, str]]] = {
    "use_huber": {"loss": "huber"},
    "include_complementary_stiffness": {"complementary_stiffness": "included"},
    "choose_model": {"elasticity": "automatic", "loss": "automatic"},
}
"""Options of the run that an action changes, by the action's kind."""


_USUAL_DISTANCE, _USUAL_SIGMA = 0.2, 2e-5
"""Usual distance of a load point or target from the flange, and uncertainty of a tracker's reading [m]."""
_MAX_NAME_LENGTH: Final = 200


def find_advised_action(assessment: Assessment, kind: str, payload: float | None = None) -> AdvisedAction:
    """Return the first action of a kind that the reasons of an assessment recommend.

    Args:
        assessment: assessment of the run.
        kind: kind of the action.
        payload: payload of the robot [kg], for `state_payload`; None for other actions.

    Raises:
        RequestError: no reason recommends an action of this kind that changes a campaign, or the action needs
            a payload, or no payload.
    """
    findings = [*assessment.reasons, *assessment.questions]
    actions = [finding.action for finding in findings if finding.action is not None]
    # `show_posture` only shows something: it cannot be applied to a campaign.
    applicable = {action.kind: action for action in reversed(actions) if action.kind != "show_posture"}
    if kind not in applicable:
        raise _explain_unadvised(kind, actions)
    if kind == "state_payload":
        return fill_in_payload(applicable[kind], payload)
    if payload is not None:
        raise RequestError(f"the action '{kind}' needs no payload", where="payload", remedy="omit `payload`")
    return applicable[kind]


def _explain_unadvised(kind: str, actions: Sequence[AdvisedAction]) -> RequestError:
    """Return the error for an action that cannot be applied; `actions` are those of the reasons."""
    reason = f"the assessment does not recommend '{kind}'"
    if any(action.kind == kind for action in actions):
        reason = f"'{kind}' names readings to look at, and changes no campaign"
    others = list(dict.fromkeys(action.kind for action in actions if action.kind != "show_posture"))
    remedy = "no reason offers an action: follow the remedies"
    if others:
        remedy = f"give one of: {', '.join(others)}"
    return RequestError(reason, where="apply", remedy=remedy)


def fill_in_payload(action: AdvisedAction, payload: float | None) -> AdvisedAction:
    """Return the action `state_payload` with the payload of the robot [kg].

    Raises:
        RequestError: the payload is missing or implausible.
    """
    if payload is None or not LEAST_PAYLOAD <= payload <= GREATEST_PAYLOAD:
        given = "no payload is stated" if payload is None else f"a payload of {payload:g} kg is not plausible"
        raise RequestError(
            given,
            where="payload",
            remedy="state `payload`, the largest payload of the robot by its maker, from "
            f"{LEAST_PAYLOAD:g} to {GREATEST_PAYLOAD:g} kg",
        )
    return action.model_copy(update={"payload": float(payload)})


def apply_action_to_campaign(campaign: Campaign, action: AdvisedAction) -> Campaign:
    """Return a campaign after an action; the name of the changed robot or set states the action.

    An action changes the options of the run, the robot, or the measurement set: `exchange_columns` exchanges
    two joints in all observations, and the set "arm 7" becomes "arm 7 (exchange columns)".

    Raises:
        RequestError: actions of this kind change no campaign, or the set lacks data that the action changes.
    """
    kind = action.kind
    if kind in _OPTION_CHANGES:
        run = campaign.run.model_copy(update=_OPTION_CHANGES[kind])
        return campaign.model_copy(update={"run": run})
    if kind == "fit_causes":
        return _fit_causes(campaign, action)
    if kind in _ROBOT_CHANGES:
        robot = _ROBOT_CHANGES[kind](campaign.robot, action)
        return campaign.model_copy(update={"robot": robot})
    if kind == "choose_robot":
        return _choose_robot(campaign, action)
    changed_set = _change_set(campaign, action)
    label = f"in {action.unit}" if action.unit else kind.replace("_", " ")
    return campaign.model_copy(update={"measurement_set": _label_set(changed_set, label)})


def _fit_causes(campaign: Campaign, action: AdvisedAction) -> Campaign:
    """Return a campaign whose run fits the causes of the action, too, such as a turn of the tracker.

    Readings of the postures that the action names are wrong, and are left out of the set.
    """
    causes = [*campaign.run.causes, *action.causes]
    run = campaign.run.model_copy(update={"causes": causes})
    measurement_set = campaign.measurement_set
    if action.observations:
        remaining = _SET_CHANGES["leave_out_readings"](measurement_set, action)
        measurement_set = _label_set(remaining, "leave out readings")
    return campaign.model_copy(update={"run": run, "measurement_set": measurement_set})


def _choose_robot(campaign: Campaign, action: AdvisedAction) -> Campaign:
    """Return a campaign with the arm of the catalogue that the action names.

    With the id of a stored robot the campaign keeps its own: the caller reads the chosen one from the store.
    """
    name = action.robot or ""
    robot = campaign.robot if action.robot_id is not None else nominal_robot(find_arm(name, "apply"))
    measurement_set = _label_set(campaign.measurement_set, name)
    return campaign.model_copy(update={"robot": robot, "measurement_set": measurement_set})


def _change_set(campaign: Campaign, action: AdvisedAction) -> _Set:
    """Return the measurement set of a campaign after an action that changes its readings or its loads.

    Raises:
        RequestError: actions of this kind do not change sets, or the set lacks data that the action changes.
    """
    if action.kind == "exchange_columns":
        names = prepare_robot(campaign.robot).robot.joint_names
        columns = [names.index(name) for name in action.joints]
        return _exchange_joint_columns(campaign.measurement_set, columns)
    if action.kind not in _SET_CHANGES:
        raise RequestError(
            f"the action '{action.kind}' cannot be applied to a campaign",
            where="apply",
            remedy="follow the remedy of the reason",
        )
    return _SET_CHANGES[action.kind](campaign.measurement_set, action)


def _label_set(measured: _Set, label: str) -> _Set:
    """Return the set with a label behind its name."""
    return measured.model_copy(update={"name": _append_label(measured.name, label)})


def _correct_joint_map(robot: RobotDocument, action: AdvisedAction) -> RobotDocument:
    """Return the robot with the action's joint map, under a name that states the change."""
    joint_map = JointMap(matrix=action.joint_map, offset=action.offset)
    name = _append_label(robot.name, "joint map corrected")
    return robot.model_copy(update={"joint_map": joint_map, "name": name})


def _state_payload(robot: RobotDocument, action: AdvisedAction) -> RobotDocument:
    """Return the robot with the action's payload."""
    return robot.model_copy(update={"payload": fill_in_payload(action, action.payload).payload})


def _append_label(name: str, label: str) -> str:
    """Return `NAME (LABEL)`, with the name cut so that the whole is not too long."""
    return f"{name[: _MAX_NAME_LENGTH - len(label) - 3]} ({label})"


def _change_observations(
    measured: _Set, new_fields: Callable[[Observation], Mapping[str, object]]
) -> list[Observation]:
    """Return the observations of a set, with the fields changed that `new_fields` returns for each."""
    return [
        observation.model_copy(update=dict(new_fields(observation))) for observation in measured.observations
    ]


def _mark_noise_as_refuted(measured: _Set, _action: AdvisedAction) -> _Set:
    """Return the set with its noise marked as refuted: it remains stored, but sigma is estimated."""
    noise = measured.noise or Noise(refuted=True)
    return measured.model_copy(update={"noise": noise.model_copy(update={"refuted": True})})


def _exchange_joint_columns(measured: _Set, columns: Sequence[int]) -> _Set:
    """Return the set with the positions of two joints, given by their indices, exchanged."""
    first, second = columns

    def exchange_positions(observation: Observation) -> dict[str, object]:
        joints = list(observation.joints)
        joints[first], joints[second] = joints[second], joints[first]
        return {"joints": joints}

    return measured.model_copy(update={"observations": _change_observations(measured, exchange_positions)})


def _exchange_load_point_and_target(measurement_set: _Set, action: AdvisedAction) -> _Set:
    """Return the set with its load point and the place of the action's target exchanged.

    Raises:
        RequestError: the set does not state both points, or states several load points.
    """
    target, target_places = action.target or "", measurement_set.flange_targets
    if target not in target_places:
        raise RequestError(
            f"the set does not state where target '{target}' is on the flange",
            where="measurement_set.flange_targets",
            remedy="check and correct the load point in the set",
        )
    load_point = _require_one_load_point(measurement_set)
    return measurement_set.model_copy(
        update={
            "load_point": target_places[target],
            "flange_targets": {**target_places, target: load_point},
            "observations": _change_observations(measurement_set, lambda _: {"load_point": None}),
        }
    )


def _require_one_load_point(measurement_set: _Set) -> Vector3:
    """Return the load point that a set states for all observations, in the flange frame.

    Raises:
        RequestError: readings of a target give the load point, or observations have different points.
    """
    if measurement_set.load_point_target is not None:
        raise RequestError(
            "the load point cannot be exchanged with a target, because the reading of target "
            f"'{measurement_set.load_point_target}' gives the load point",
            where="measurement_set.load_point_target",
            remedy="check which target was on the hook, and correct its name in the set",
        )
    # Observations without a load point of their own use the load point of the set.
    set_load_point = measurement_set.load_point or (0.0, 0.0, 0.0)
    load_point, *other_points = dict.fromkeys(
        observation.load_point or set_load_point for observation in measurement_set.observations
    )
    if other_points:
        raise RequestError(
            f"the set has {1 + len(other_points)} different load points; "
            "only one can be exchanged with a target",
            where="measurement_set.observations",
            remedy="check and correct the load points in the set",
        )
    return load_point


def _omit_load_point(measured: _Set, _action: AdvisedAction) -> _Set:
    """Return the set without stated load points, so that the reading of the hook gives the load point."""
    observations = _change_observations(measured, lambda _: {"load_point": None})
    return measured.model_copy(update={"load_point": None, "observations": observations})


def _exchange_unloaded_and_loaded(measurement_set: _Set, action: AdvisedAction) -> _Set:
    """Return the set with unloaded and loaded readings exchanged; deflections change their sign.

    Readings of the action's targets are exchanged; readings of all targets if the action names no target.
    """

    def exchange_states(observation: Observation) -> dict[str, object]:
        readings = list[Reading]()
        for reading in observation.readings:
            is_meant = not action.targets or reading.target in action.targets
            readings.append(_exchange_reading(reading) if is_meant else reading)
        return {"readings": readings}

    return measurement_set.model_copy(
        update={"observations": _change_observations(measurement_set, exchange_states)}
    )


def _exchange_reading(reading: Reading) -> Reading:
    """Return a reading of a target with its unloaded and its loaded place exchanged."""
    deflection, displacement = reading.deflection, reading.displacement
    return reading.model_copy(
        update={
            "unloaded": reading.loaded,
            "loaded": reading.unloaded,
            "unloaded_after": None,  # it belongs to the order of readings before the exchange
            "unloaded_covariance": reading.loaded_covariance,
            "loaded_covariance": reading.unloaded_covariance,
            "deflection": deflection and tuple(-component for component in deflection),
            "displacement": None if displacement is None else -displacement,
        }
    )


def _declare_unit(measurement_set: _Set, action: AdvisedAction) -> _Set:
    """Return the set with the action's unit declared as its unit; the readings keep their numbers.

    Load points, places of targets and the noise are often typed by hand in the right unit. Where such a
    length is more usual in the old unit, it is converted, so that the length itself stays the same.
    """
    units, unit = measurement_set.units, action.unit
    if unit in {"deg", "rad"}:
        return measurement_set.model_copy(update={"units": units.model_copy(update={"angle": unit})})
    # Without a stated unit, moments are in the unit of force times m: this must not change with the length.
    force = "kgf" if units.force == "kg" else units.force
    moment = units.moment or (f"{force}.m" if units.length == "m" else None)
    if unit in FORCE:
        changed_units = {"force": unit, "moment": units.moment}
        return measurement_set.model_copy(update={"units": units.model_copy(update=changed_units)})
    new_units = Units.model_validate({**units.model_dump(), "length": unit, "moment": moment})
    change = _UnitChange(old=LENGTH[units.length], new=LENGTH[new_units.length])
    return _convert_typed_lengths(measurement_set.model_copy(update={"units": new_units}), change)


@dataclass(frozen=True)
class _UnitChange:
    """Change of a set's unit of length, with the lengths that people typed in the old unit."""

    old: float  #: old unit [m]
    new: float  #: new unit [m]

    def find_factor(self, number: float, usual_size: float) -> float:
        """Return the factor for a number: old / new if it was typed in the old unit, else 1.

        A number was typed in the unit in which its length is nearer to the usual one, on a logarithmic scale.

        Args:
            number: length as typed, at least 0.
            usual_size: usual size of such a length [m].
        """
        if number == 0.0:
            return self.old / self.new
        distance_in_old = abs(log(self.old * number / usual_size))
        distance_in_new = abs(log(self.new * number / usual_size))
        return self.old / self.new if distance_in_old <= distance_in_new else 1.0

    def convert_place(self, place: Vector3 | None) -> Vector3 | None:
        """Return a place on the flange with its coordinates in the new unit."""
        if place is None:
            return None
        factor = self.find_factor(float(np.linalg.norm(place)), _USUAL_DISTANCE)
        x, y, z = place
        return factor * x, factor * y, factor * z

    def convert_noise(self, noise: Noise | None) -> Noise | None:
        """Return a noise with its lengths in the new unit; its sigma shows in which unit they were typed."""
        if noise is None or noise.sigma is None:
            return noise
        factor = self.find_factor(noise.sigma, _USUAL_SIGMA)
        lengths = {name: getattr(noise, name) for name in ("sigma", "load_point", "target_places", "drift")}
        converted = {name: None if length is None else factor * length for name, length in lengths.items()}
        return noise.model_copy(update=converted)

    def convert_sigma(self, reading: Reading) -> Reading:
        """Return a reading with its own sigma in the new unit."""
        if not reading.sigma:
            return reading
        sigma = self.find_factor(reading.sigma, _USUAL_SIGMA) * reading.sigma
        return reading.model_copy(update={"sigma": sigma})


def _convert_typed_lengths(measurement_set: _Set, change: _UnitChange) -> _Set:
    """Return the set with its typed lengths converted, where they are more usual in the old unit."""
    targets = {name: change.convert_place(place) for name, place in measurement_set.flange_targets.items()}
    observations = _change_observations(
        measurement_set,
        lambda observation: {
            "load_point": change.convert_place(observation.load_point),
            "readings": [change.convert_sigma(reading) for reading in observation.readings],
        },
    )
    changes: dict[str, Any] = {
        "noise": change.convert_noise(measurement_set.noise),
        "load_point": change.convert_place(measurement_set.load_point),
        "flange_targets": targets,
        "observations": observations,
    }
    return measurement_set.model_copy(update=changes)


_ROBOT_CHANGES: Final[Mapping[str, Callable[[RobotDocument, AdvisedAction], RobotDocument]]] = {
    "apply_joint_map": _correct_joint_map,
    "state_payload": _state_payload,
}
"""Kind of an action → function that returns a robot after this action."""
_SET_CHANGES: Final[Mapping[str, Callable[[_Set, AdvisedAction], _Set]]] = {
    "leave_out_readings": lambda measured, action: measured.model_copy(
        update={"observations": leave_out_observations(measured.observations, action.observations)}
    ),
    "omit_noise": _mark_noise_as_refuted,
    "exchange_load_and_target": _exchange_load_point_and_target,
    "omit_load_point": _omit_load_point,
    "exchange_readings": _exchange_unloaded_and_loaded,
    "convert_units": _declare_unit,
}
"""Kind of an action → function that returns a measurement set after this action."""
