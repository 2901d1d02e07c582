"""One rule for units: every function takes mm, deg, N and N·m, or the units of `units=`."""

import inspect
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import jointstiff as js
from jointstiff.schemas.live import LiveOptions
from jointstiff.schemas.measurement import Units
from jointstiff.service.conversion.arguments import convert_to_si
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, MOMENT, complete_units
from jointstiff.service.kinds.rooms import ROOMS, import_kind
from jointstiff.service.kinds.verb import import_verb
from jointstiff.service.library.cases import PredictFields, make_load_cases
from jointstiff.simulator import default_arm, simulate_campaign

MM, DEG, KN = 1e3, 180.0 / np.pi, 1e-3
OTHER = "m, rad, kN, kN.m"
KINDS_OF_JOINTS = {"rail": "prismatic", "joint_1": "revolute", "joint_2": "revolute"}


class Backend:
    """A backend that returns the request of a verb instead of computing it."""

    def start_call(self, _):
        return self

    def prepare_set(self, *_):
        return "set", None

    def prepare_run(self, *_):
        return "run"

    def prepare_robot(self, _):
        return "robot"

    def joint_kinds(self, _):
        return KINDS_OF_JOINTS

    def carry_out_request(self, kind, request, files, _):
        return SimpleNamespace(kind=kind, request=request, files=files)


def requested(command, *arguments, **fields):
    """Return what a verb requests."""
    kind = next(kind for kind, room in ROOMS.items() if room.command == command)
    return import_verb(kind)(Backend(), *arguments, **fields)


ROBOT = js.RobotDocument.model_validate(simulate_campaign(default_arm())["robot"])
PLAN = {
    "load": {"kind": "any_direction", "force": 1500.0},
    "targets": {"P1": [0.0, 0.0, 100.0]},
    "sigma": 0.02,
    "postures": np.array([[500.0, 90.0, -45.0]]),
    "distinct_angle": 10.0,
    "goal": {"kind": "deflection", "uncertainty": 0.05, "force": [0.0, 0.0, -500.0]},
    "tracker": {
        "station": [3000.0, 0.0, 0.0],
        "range": {"constant": 0.01, "per_distance": 1e-6},
        "transverse": {"constant": 0.01, "per_distance": 6e-6},
    },
    "torque_limits": {"joint_1": 2000.0, "rail": 3000.0},
    "surroundings": {"floor": 100.0, "obstacles": [[[0, 0, 0], [1000, 500, 200]]], "acceptance": 60.0},
}
PLAN_IN_OTHER = {
    "load": {"kind": "any_direction", "force": 1.5},
    "targets": {"P1": [0.0, 0.0, 0.1]},
    "sigma": 2e-5,
    "postures": [[0.5, np.pi / 2, -np.pi / 4]],
    "distinct_angle": np.pi / 18,
    "goal": {"kind": "deflection", "uncertainty": 5e-5, "force": [0.0, 0.0, -0.5]},
    "tracker": {
        "station": [3.0, 0.0, 0.0],
        "range": {"constant": 1e-5, "per_distance": 1e-6},
        "transverse": {"constant": 1e-5, "per_distance": 6e-6},
    },
    "torque_limits": {"joint_1": 2.0, "rail": 3.0},
    "surroundings": {"floor": 0.1, "obstacles": [[[0, 0, 0], [1.0, 0.5, 0.2]]], "acceptance": np.pi / 3},
}
MAP = {
    "area": np.array([[1400.0, -200.0, 600.0], [1800.0, 200.0, 600.0]]),
    "place": (0, 0, 250),
    "force": (0, 300, -500),
    "moment": (0, 0, 20),
    "limits": {"rail": (0, 4000), "joint_1": (-90, 90)},
    "near": [500, 90, -45],
    "tool_axis": (0, 0, 1),
}
MAP_IN_OTHER = {
    "area": [[1.4, -0.2, 0.6], [1.8, 0.2, 0.6]],
    "place": (0, 0, 0.25),
    "force": (0, 0.3, -0.5),
    "moment": (0, 0, 0.02),
    "limits": {"rail": (0, 4), "joint_1": (-np.pi / 2, np.pi / 2)},
    "near": [0.5, np.pi / 2, -np.pi / 4],
    "tool_axis": (0, 0, 1),
}
LENGTHS = {"methods": [{"method": "complete_pose", "characteristic_length": 500.0}]}
LENGTHS_IN_OTHER = {"methods": [{"method": "complete_pose", "characteristic_length": 0.5}]}
IN_SI = {
    "identify": ((None,), {"characteristic_length": 500.0}, {"characteristic_length": 0.5}),
    "plan": ((ROBOT,), PLAN, PLAN_IN_OTHER),
    "map": ((None,), MAP, MAP_IN_OTHER),
}
"""Of each verb whose message is in SI units: its source, arguments in the default units, and in others."""


def flat(value, path=""):
    """Return the leaves of nested mappings and sequences by their path."""
    if isinstance(value, dict):
        return {key: leaf for name in value for key, leaf in flat(value[name], f"{path}.{name}").items()}
    if isinstance(value, list | tuple):
        return {key: leaf for i, each in enumerate(value) for key, leaf in flat(each, f"{path}.{i}").items()}
    return {path: value}


@pytest.mark.parametrize("command", IN_SI)
def test_a_verb_of_si_messages_takes_the_units_of_the_call(command):
    source, default, other = IN_SI[command]
    (one, two) = (
        flat(requested(command, *source, **fields).request) for fields in (default, {"units": OTHER, **other})
    )
    assert one.keys() == two.keys()
    for path, value in one.items():
        assert value == (pytest.approx(two[path]) if isinstance(value, float) else two[path]), path


def test_the_message_of_a_plan_and_of_a_map_is_in_si_units():
    plan = requested("plan", ROBOT, **PLAN).request
    assert (plan["sigma"], plan["load"]["force"]) == (pytest.approx(2e-5), 1500.0)
    assert plan["postures"] == [[0.5, pytest.approx(np.pi / 2), pytest.approx(-np.pi / 4)]]
    assert plan["tracker"]["range"] == {"constant": pytest.approx(1e-5), "per_distance": 1e-6}
    area = requested("map", None, **MAP).request
    assert area["area"] == [[1.4, -0.2, 0.6], [1.8, 0.2, 0.6]]
    assert area["limits"]["rail"] == [0.0, 4.0]
    assert area["tool_axis"] == [0, 0, 1]


def test_messages_keep_their_units():
    options = import_kind("map").options(
        area=[[1, 0, 0], [2, 0, 0]], grid=(1, 1, 1), place=(0, 0, 0.2), force=(0, 0, 1)
    )
    request = requested("map", None, options, place=(0, 0, 250)).request
    assert request["area"] == [[1, 0, 0], [2, 0, 0]]
    assert request["place"] == [0.0, 0.0, 0.25]
    prior = js.RunOptions.model_validate({"characteristic_length": 0.5, "weighting": "characteristic_length"})
    assert requested("identify", None, prior).request["characteristic_length"] == 0.5


def test_a_verb_of_programs_sends_the_units_of_the_call(tmp_path):
    (tmp_path / "path.src").write_text("DEF p()\nEND\n")
    file = tmp_path / "path.src"
    fields = {"load_point": (0, 0, 120), "force": (0, 0, -500), "cut": {"diameter": 20.0}}
    one = requested("correct", ROBOT, file, **fields).request
    assert one["units"] == {"length": "mm", "angle": "deg", "force": "N", "moment": "N.m"}
    assert one["load_point"] == [0, 0, 120]
    assert one["cut"]["diameter"] == 0.02  # a cut is in SI units in the message
    other = requested("correct", ROBOT, file, units="m, rad, kN", load_point=(0, 0, 0.12)).request
    assert other["units"] == {"length": "m", "angle": "rad", "force": "kN", "moment": "kN.m"}


@pytest.mark.parametrize("units", [None, OTHER])
def test_predictions_of_arrays_cases_and_tables_are_in_the_units_of_the_call(units, tmp_path):
    joints = dict.fromkeys(default_arm().joint_names, "revolute")
    size = complete_units(units)
    options = {} if units is None else {"units": units}
    point = np.array([0.0, 0.0, 0.12]) / LENGTH[size["length"]]
    q, force = np.full(6, 0.1) / ANGLE[size["angle"]], np.array([0.0, 0.0, -500.0]) / FORCE[size["force"]]
    table = tmp_path / "cases.csv"
    table.write_text(
        ",".join(f"J{j} [rad]" for j in range(1, 7)) + ",Fx [N],Fy [N],Fz [N]\n" + "0.1," * 6 + "0,0,-500\n"
    )
    case = {"joints": q.tolist(), "force": force.tolist()}
    for postures, forces in (([q], force), ([case], None), (table, None)):
        message = make_load_cases(postures, joints, forces, options | {"at": point})
        (row,), sizes = message.cases, message.units
        assert np.multiply(row.joints, ANGLE[sizes.angle]) == pytest.approx([0.1] * 6)
        assert np.multiply(row.force, FORCE[sizes.force]) == pytest.approx([0, 0, -500])
        assert np.multiply(message.load_point, LENGTH[sizes.length]) == pytest.approx([0, 0, 0.12])


def test_a_live_reading_is_in_the_units_of_the_call():
    """The same reading in mm and deg, and in m and rad, gives the same state."""
    document = simulate_campaign(default_arm(), load="dead_weight", configurations=8, seed=1)
    states = []
    for units, length, angle, force in ((None, MM, DEG, 1.0), (OTHER, 1.0, 1.0, KN)):
        with js.measure(document, goal="15 %", units=units) as live:
            planned, targets = live.next, live._options.targets
            posture = np.array([[1.5, 0.1 * i, 1.0] for i in range(len(targets))])
            moved = posture - np.array([0.0, 0.0, 1e-3])
            live.observe(
                length * posture,
                length * moved,
                joints=angle * np.array(planned.joints),
                force=force * np.array(planned.force),
            )
            states.append(flat(live.state.model_dump(mode="json")))
    for path, value in states[0].items():
        assert states[1][path] == (pytest.approx(value, rel=1e-6) if isinstance(value, float) else value), (
            path
        )
    options = convert_to_si(LiveOptions, {"sigma": 0.02, "load_point": [0, 0, 120]}, complete_units(None))
    assert options == {"sigma": pytest.approx(2e-5), "load_point": [0.0, 0.0, 0.12]}


def test_every_function_with_numbers_takes_units():
    verbs = [import_verb(kind) for kind in ROOMS]
    for verb in verbs:
        assert "    units: Units of the numbers of this call" in verb.__doc__, verb
    for function in (js.robot, js.measure, js.Campaign.from_arrays):
        assert inspect.signature(function).parameters["units"].default is None, function
    assert "units" in PredictFields.__annotations__


def test_units_that_are_not_known_or_not_stated_are_refused():
    with pytest.raises(js.CampaignError, match="'cm' is not a known unit of length"):
        requested("map", None, units={"length": "cm"}, place=(0, 0, 1))
    with pytest.raises(js.CampaignError, match="the unit of moments is missing"):
        requested("map", None, units="mm, deg, kN", moment=(0, 0, 1))
    units = Units(length="m", angle="rad", force="N")
    load = (0.0, 0.0, -500.0)
    options = import_kind("correction").options(units=units, accuracy_option="off", force=load)
    with pytest.raises(TypeError, match="already state units"):
        requested("correct", "run", __file__, options=options, units="mm, deg, N")
    assert complete_units("m, rad, kg")["moment"] == "kgf.m"
    assert set(complete_units(None)) == {"length", "angle", "force", "moment"}
    assert complete_units({"length": "m"})["moment"] in MOMENT


def test_the_factors_of_units_stand_in_one_file_of_the_service():
    """A live source still has an inch of its own."""
    service = Path(js.__file__).parent / "service"
    places = {
        str(path.relative_to(service))
        for path in service.rglob("*.py")
        for factor in ("9.80665", "0.0254", "0.3048", "4.448")
        if factor in path.read_text(encoding="utf-8")
    }
    assert places == {"conversion/units.py", "live/sources.py"}
