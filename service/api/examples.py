"""Examples for the OpenAPI description, small enough to read and complete enough to send."""

from __future__ import annotations

from typing import Any, Final

from fastapi import Body
from fastapi.openapi.models import Example


def shown(examples: dict[str, Any]) -> Any:  # noqa: ANN401 - as FastAPI has it
    """Return the declaration of a JSON body with its examples."""
    return Body(openapi_examples={name: Example(value=value) for name, value in examples.items()})


_QUARTER: Final = 1.5707963267948966

ROBOTS: Final[dict[str, Any]] = {
    "modified DH": {
        "name": "six-axis arm, cell 3",
        "model": {
            "format": "dh",
            "convention": "modified",
            "rows": [
                {"a": 0.0, "alpha": 0.0, "d": 0.675, "theta": 0.0},
                {"a": 0.35, "alpha": -_QUARTER, "d": 0.0, "theta": -_QUARTER},
                {"a": 1.15, "alpha": 0.0, "d": 0.0, "theta": 0.0},
                {"a": 0.041, "alpha": -_QUARTER, "d": 1.2, "theta": 0.0},
                {"a": 0.0, "alpha": _QUARTER, "d": 0.0, "theta": 0.0},
                {"a": 0.0, "alpha": -_QUARTER, "d": 0.215, "theta": 0.0},
            ],
        },
    },
    "URDF": {
        "name": "one joint",
        "model": {
            "format": "urdf",
            "urdf": '<robot name="lever"><link name="base_link"/><link name="flange"/>'
            '<joint name="joint_1" type="continuous"><parent link="base_link"/>'
            '<child link="flange"/><axis xyz="0 0 1"/></joint></robot>',
            "base": "base_link",
            "flange": "flange",
        },
    },
    "nominal": {
        "name": "KR 210 cell 3",
        "model": {"format": "catalogue", "arm": "KUKA KR 210 R2700 extra"},
    },
    "identified": {
        "name": "six-axis arm, cell 3, as measured",
        "model": {"format": "geometry", "geometry_id": "ID_OF_A_STORED_GEOMETRY"},
    },
}

ROBOT_CHANGES: Final[dict[str, Any]] = {
    "another name": {"name": "six-axis arm, cell 4"},
    "archived": {"archived": True},
}

SET_CHANGES: Final[dict[str, Any]] = {
    "metadata": {
        "measured_at": "2026-11-20T14:30:00+01:00",
        "operator": "M. Keller",
        "instrument": "Leica AT960, 750123",
        "serial_number": "F-211034",
        "conditions": "21 °C, warmed up for 30 min",
        "notes": "before the gearbox of axis 2 was replaced",
    },
    "archived": {"archived": True},
}

_GEOMETRIES: Final[dict[str, Any]] = {
    "two joints": {
        "name": "pan and tilt",
        "units": {"length": "mm", "angle": "deg"},
        "noise": {"sigma": 0.01},
        "sweeps": [
            {
                "joint": "joint_1",
                "observations": [
                    {
                        "joints": [-60.0, 0.0],
                        "targets": {
                            "P10": [3374.935, -1874.21, 100.004],
                            "P11": [3238.992, -2020.908, 149.998],
                        },
                    },
                    {
                        "joints": [-20.0, 0.0],
                        "targets": {
                            "P10": [3603.561, -1154.073, 99.991],
                            "P11": [3593.805, -1353.828, 149.996],
                        },
                    },
                    {
                        "joints": [20.0, 0.0],
                        "targets": {
                            "P10": [3315.867, -455.455, 99.989],
                            "P11": [3436.754, -614.773, 149.998],
                        },
                    },
                    {
                        "joints": [60.0, 0.0],
                        "targets": {
                            "P10": [2646.413, -105.212, 100.0],
                            "P11": [2841.44, -149.552, 149.995],
                        },
                    },
                ],
            },
            {
                "joint": "joint_2",
                "observations": [
                    {
                        "joints": [0.0, -60.0],
                        "targets": {
                            "P10": [3139.182, -897.597, 792.84],
                            "P11": [3156.918, -1101.468, 817.83],
                        },
                    },
                    {
                        "joints": [0.0, -20.0],
                        "targets": {
                            "P10": [3475.218, -793.655, 373.625],
                            "P11": [3518.0, -989.772, 420.607],
                        },
                    },
                    {
                        "joints": [0.0, 20.0],
                        "targets": {
                            "P10": [3475.199, -793.642, -173.626],
                            "P11": [3550.652, -979.663, -126.624],
                        },
                    },
                    {
                        "joints": [0.0, 60.0],
                        "targets": {
                            "P10": [3139.179, -897.613, -592.82],
                            "P11": [3239.654, -1075.859, -567.813],
                        },
                    },
                ],
            },
        ],
    },
    "configurations of a stored robot": {
        "units": {"length": "mm", "angle": "deg"},
        "robot_id": "ID_OF_A_STORED_ROBOT",
        "poses": [
            {"joints": [0.0, -30.0, 45.0, 0.0, 60.0, 0.0], "targets": {"P10": [1562.104, 151.336, 1120.48]}}
        ],
    },
}

MEASUREMENT_SETS: Final[dict[str, Any]] = {
    "positions": {
        "robot_id": "ID_OF_A_STORED_ROBOT",
        "name": "cell 3, dead weight",
        "units": {"length": "mm", "angle": "deg", "force": "kgf"},
        "encoders": "motor",
        "noise": {"sigma": 0.02},
        "load_point": [0.0, 0.0, 120.0],
        "observations": [
            {
                "label": "c01",
                "joints": [0.0, -30.0, 45.0, 0.0, 60.0, 0.0],
                "force": [0.0, 0.0, -150.0],
                "readings": [
                    {
                        "target": "P10",
                        "unloaded": [1562.104, 151.336, 1120.48],
                        "loaded": [1561.871, 151.339, 1119.012],
                    }
                ],
            }
        ],
    },
    "deflections": {
        "robot_id": "ID_OF_A_STORED_ROBOT",
        "name": "cable pulls",
        "units": {"length": "m", "angle": "rad", "force": "N"},
        "encoders": "secondary",
        "flange_targets": {"tcp": [0.0, 0.1, 0.3]},
        "load_point": [0.0, 0.1, 0.3],
        "observations": [
            {
                "label": "1",
                "joints": [0.1, -0.4, 0.5, 0.0, 1.0, 0.0],
                "force": [-120.2, -78.2, -14.7],
                "readings": [{"target": "tcp", "deflection": [-0.000686, -0.000396, -0.000025]}],
            }
        ],
    },
}

_RUNS: Final[dict[str, Any]] = {
    "default": {"measurement_set_id": "ID_OF_A_STORED_SET"},
    "decoupled, bounded": {
        "measurement_set_id": "ID_OF_A_STORED_SET",
        "method": "decoupled_partial_pose",
        "weighting": "covariance",
        "stiffness_bounds": {"joint_2": [1e6, None]},
    },
}

_COMPARISONS: Final[dict[str, Any]] = {
    "default": {"measurement_set_id": "ID_OF_A_STORED_SET"},
    "two methods, 10 configurations drawn 1000 times": {
        "measurement_set_id": "ID_OF_A_STORED_SET",
        "methods": [
            {"method": "complete_pose", "weighting": "characteristic_length", "characteristic_length": 0.6},
            {"method": "partial_pose"},
        ],
        "constraints": ["positive"],
        "resampling": {"size": 10, "repetitions": 1000, "seed": 1},
    },
}

_PAIRS: Final[dict[str, Any]] = {
    "two encoders": {
        "first": {"measurement_set_id": "ID_OF_THE_SET_WITH_MOTOR_ENCODERS"},
        "second": {"measurement_set_id": "ID_OF_THE_SET_WITH_SECONDARY_ENCODERS"},
        "ordered": True,
    },
    "two runs": {"first": {"run_id": "ID_OF_A_RUN"}, "second": {"run_id": "ID_OF_ANOTHER"}},
}

IMPORTS: Final[dict[str, Any]] = {
    "one table": {
        "files": [
            "label;J1 [deg];J2 [deg];Fx [N];Fy [N];Fz [N];P10 unloaded x [mm];P10 unloaded y [mm];"
            "P10 unloaded z [mm];P10 loaded x [mm];P10 loaded y [mm];P10 loaded z [mm]\n"
            "c01;10.5;-20.25;0;0;-1471.5;1245.7134;-310.1127;239.2014;1245.6021;-310.1098;237.9853\n"
        ],
        "options": {"encoders": "motor", "load_point": [0.0, 0.0, 120.0]},
    }
}

DEFLECTIONS: Final[dict[str, Any]] = {
    "milling at the tool": {
        "run_id": "ID_OF_A_RUN",
        "units": {"length": "mm", "angle": "deg", "force": "N"},
        "load_point": [0.0, 0.0, 120.0],
        "cases": [
            {"label": "p1", "joints": [0.0, -30.0, 45.0, 0.0, 60.0, 0.0], "force": [0.0, 300.0, -500.0]},
            {
                "label": "p2",
                "joints": [20.0, -25.0, 40.0, 10.0, 60.0, 0.0],
                "force": [0.0, 300.0, -500.0],
                "place": [10.0, 0.0, 180.0],
                "direction": [0.0, 0.0, 1.0],
            },
        ],
    }
}

PROGRAMS: Final[dict[str, Any]] = {
    "milling": {
        "files": [
            "DEF part()\n$TOOL=TOOL_DATA[1]\n$BASE=$NULLFRAME\n"
            "LIN {X 1803.0,Y 290.3,Z 1505.4,A 18.5,B 140.5,C 9.0}\nEND\n"
        ],
        "options": {
            "run_id": "ID_OF_A_RUN",
            "units": {"length": "mm", "angle": "deg", "force": "N"},
            "accuracy_option": "off",
            "load": {"force": [0.0, 300.0, -500.0]},
            "axes": "tool",
            "tools": [{"name": "TOOL_DATA[1]", "values": [0.0, 0.0, 200.0, 0.0, 0.0, 0.0]}],
            "start": [10.0, -5.0, 10.0, 5.0, 45.0, 3.0],
            "format": "krl",
        },
    }
}

_PLANS: Final[dict[str, Any]] = {
    "begin a campaign": {
        "robot_id": "ID_OF_A_STORED_ROBOT",
        "readings": 15,
        "load": {"kind": "any_direction", "force": 1500.0},
        "targets": {"P10": [0.147, 0.055, 0.05], "P11": [-0.137, 0.087, 0.085], "P12": [-0.007, -0.14, 0.12]},
        "load_point": [-0.06, 0.02, 0.18],
        "surroundings": {"floor": 0.1},
    },
    "go on with a campaign": {
        "measurement_set_id": "ID_OF_A_STORED_SET",
        "readings": 8,
        "criterion": "d",
        "load": {"kind": "any_direction", "force": 1500.0},
    },
}

_MAPS: Final[dict[str, Any]] = {
    "milling a plate": {
        "run_id": "ID_OF_A_RUN",
        "area": [[1.2, -0.6, 0.4], [2.0, 0.6, 0.4]],
        "grid": [9, 13, 1],
        "place": [0.0, 0.0, 0.25],
        "turns": 8,
        "force": [0.0, 300.0, -500.0],
    },
    "the same posture throughout, force along with the tool": {
        "run_id": "ID_OF_A_RUN",
        "area": [[1.2, -0.6, 0.4], [2.0, 0.6, 1.2]],
        "grid": [9, 13, 5],
        "place": [0.0, 0.0, 0.25],
        "directions": [[0.0, 0.0, -1.0], [0.5, 0.0, -0.8660254]],
        "force": [100.0, 0.0, -400.0],
        "axes": "flange",
        "near": [0.0, -0.5, 0.8, 0.0, 1.0, 0.0],
    },
}

JOBS: Final = {
    "run": _RUNS,
    "comparison": _COMPARISONS,
    "pair": _PAIRS,
    "geometry": _GEOMETRIES,
    "plan": _PLANS,
    "map": _MAPS,
}
"""Examples of requests, by the name of the kind of job."""
