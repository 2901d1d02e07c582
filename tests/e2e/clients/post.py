"""Post every documented body with the generated Python client; types are checked before it runs."""

import json
import sys
from http import HTTPStatus
from io import BytesIO
from pathlib import Path
from typing import Any, TypeVar

from jointstiff_client import AuthenticatedClient
from jointstiff_client.api.comparisons import create_comparison
from jointstiff_client.api.geometries import create_geometry
from jointstiff_client.api.jobs import change_job
from jointstiff_client.api.maps import create_map
from jointstiff_client.api.measurement_sets import create_import, create_measurement_set
from jointstiff_client.api.plans import create_plan
from jointstiff_client.api.robots import compute_kinematics, create_robot
from jointstiff_client.api.runs import create_run
from jointstiff_client.models.body_create_import import BodyCreateImport
from jointstiff_client.models.comparison import Comparison
from jointstiff_client.models.comparison_request import ComparisonRequest
from jointstiff_client.models.dh_model import DhModel
from jointstiff_client.models.dh_model_convention import DhModelConvention
from jointstiff_client.models.dh_row import DhRow
from jointstiff_client.models.geometry import Geometry
from jointstiff_client.models.geometry_request import GeometryRequest
from jointstiff_client.models.import_answer import ImportAnswer
from jointstiff_client.models.job_change import JobChange
from jointstiff_client.models.kinematics_request import KinematicsRequest
from jointstiff_client.models.map_ import Map
from jointstiff_client.models.map_request import MapRequest
from jointstiff_client.models.measurement_set import MeasurementSet
from jointstiff_client.models.measurement_set_post import MeasurementSetPost
from jointstiff_client.models.plan import Plan
from jointstiff_client.models.plan_request import PlanRequest
from jointstiff_client.models.problem import Problem
from jointstiff_client.models.robot import Robot
from jointstiff_client.models.robot_document import RobotDocument
from jointstiff_client.models.run import Run
from jointstiff_client.models.run_request import RunRequest
from jointstiff_client.types import File, Response

Message = TypeVar("Message")
CLIENT = AuthenticatedClient(base_url=sys.argv[1], token="any")  # noqa: S106 - none is demanded
BODIES: dict[str, list[dict[str, Any]]] = json.loads(Path(sys.argv[2]).read_text(encoding="utf-8"))


def main() -> None:
    """Post them all, one address after the other."""
    for body in BODIES["/v1/robots"]:
        check(create_robot.sync_detailed(client=CLIENT, body=RobotDocument.from_dict(body)), Robot)
    for body in BODIES["/v1/kinematics"]:
        request = KinematicsRequest.from_dict(body)
        check(compute_kinematics.sync_detailed(client=CLIENT, body=request), list)
    for body in BODIES["/v1/measurement-sets"]:
        readings = MeasurementSetPost.from_dict(body)
        check(create_measurement_set.sync_detailed(client=CLIENT, body=readings), MeasurementSet)
    for body in BODIES["/v1/imports"]:
        files = [File(BytesIO(text.encode()), "table.csv") for text in body["files"]]
        form = BodyCreateImport(files=files, options=json.dumps(body["options"]))
        check(create_import.sync_detailed(client=CLIENT, body=form), ImportAnswer)
    jobs()
    typed()


def jobs() -> None:
    """Post a job of each kind."""
    for body in BODIES["/v1/runs"]:
        check(create_run.sync_detailed(client=CLIENT, body=RunRequest.from_dict(body)), Run)
    for body in BODIES["/v1/plans"]:
        check(create_plan.sync_detailed(client=CLIENT, body=PlanRequest.from_dict(body)), Plan)
    for body in BODIES["/v1/maps"]:
        check(create_map.sync_detailed(client=CLIENT, body=MapRequest.from_dict(body)), Map)
    for body in BODIES["/v1/geometries"]:
        answer = create_geometry.sync_detailed(client=CLIENT, body=GeometryRequest.from_dict(body))
        if isinstance(answer.parsed, Problem):  # the example that shows one pose, where more are needed
            assert answer.parsed.where == "poses", answer.content
        else:
            check(answer, Geometry)
    for body in BODIES["/v1/comparisons"]:
        request = ComparisonRequest.from_dict(body)
        asked = check(create_comparison.sync_detailed(client=CLIENT, body=request), Comparison)
        cancel = JobChange(cancelled=True)
        check(change_job.sync_detailed(asked.id, client=CLIENT, body=cancel), Comparison)


def typed() -> None:
    """Post a DH robot written in the client's own types."""
    model = DhModel(
        format_="dh",
        convention=DhModelConvention.MODIFIED,
        rows=[DhRow(a=0.35, alpha=-1.5708, d=0.675, theta=0.0)],
    )
    robot = check(
        create_robot.sync_detailed(client=CLIENT, body=RobotDocument(name="one axis", model=model)), Robot
    )
    assert robot.model.to_dict()["rows"][0]["d"] == 0.675


def check(answer: Response[Any], message: type[Message]) -> Message:
    """Return the message of an answer that accepts the body."""
    assert answer.status_code < HTTPStatus.BAD_REQUEST, answer.content
    assert isinstance(answer.parsed, message)
    return answer.parsed


if __name__ == "__main__":
    main()
