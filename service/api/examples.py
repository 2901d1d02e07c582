"""Examples for the OpenAPI description, small enough to read and complete enough to send."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from fastapi import Body
from fastapi.openapi.models import Example


def shown(examples: Mapping[str, Any]) -> Any:  # noqa: ANN401 - as FastAPI has it
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
    "restored": {"deleted": False},
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

CAMPAIGNS: Final[dict[str, Any]] = {
    "positions": {
        "robot": ROBOTS["modified DH"],
        "measurement_set": {
            name: value for name, value in MEASUREMENT_SETS["positions"].items() if name != "robot_id"
        },
        "run": {"method": "partial_pose"},
    }
}

JOB_CHANGES: Final[dict[str, Any]] = {
    "cancelled": {"cancelled": True},
    "restored": {"deleted": False},
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
