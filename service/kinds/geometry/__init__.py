"""Axes, frames and links from sweeps or poses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from jointstiff.schemas.geometry import Geometry, GeometryRequest, GeometrySummary
from jointstiff.service.kinds.kind import READINGS_BYTES, Kind

if TYPE_CHECKING:
    from jointstiff.schemas.geometry import GeometryResult
    from jointstiff.service.inputs import Inputs
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.tables.report import Report, View

_EXAMPLES: Final[dict[str, Any]] = {
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


def _compute(inputs: Inputs, request: GeometryRequest) -> Work:
    from jointstiff.service.kinds.geometry.work import work

    return work(inputs, request)


def _report(job: Geometry, result: GeometryResult, view: View) -> Report:
    from jointstiff.service.kinds.geometry.tables import report

    return report(job, result, view)


GEOMETRY: Final = Kind[Geometry, GeometryRequest, GeometrySummary](
    message=Geometry,
    request=GeometryRequest,
    options=GeometryRequest,
    compute=_compute,
    report=_report,
    sources=("readings",),
    summary=GeometrySummary,
    title="Geometry of a robot",
    max_bytes=READINGS_BYTES,
    reported=False,
    filters={"name": "name (exact)", "robot_id": "the robot of the nominal model"},
    examples=_EXAMPLES,
    description="""Identify a robot's geometry from sweeps of single joints, or from unloaded poses.

Axes, base frame, wrist centre and targets have uncertainties; links are listed with their nominal values,
and the identified model is a robot document that can be posted as `"model": {"format": "geometry", …}`.
Suspicious readings (a bumped tracker, a short arc, a joint map that does not fit, …) are reported as findings
with their figures; readings that do not determine the geometry are refused.""",
)
