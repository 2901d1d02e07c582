"""A long program through the service and its workers, by the client of notebooks."""

from __future__ import annotations

import numpy as np
import pytest
from support.programs import options, path, tool_poses

from jointstiff.service.library.client import Client
from jointstiff.service.programs.formats import read_program
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.programs import program_text

POINTS = 10_050
"""A few more than are corrected at once."""


@pytest.mark.process
def test_a_long_program_is_corrected_in_steps_by_workers(services):
    text = program_text("csv", tool_poses(path(POINTS)), 4).encode()
    seen = []
    with Client(services("sqlite").url) as client:
        campaign = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
        run = client.identify(campaign)
        stored = client.measurement_sets.get(run.request.measurement_set_id)
        stated = options("csv") | {"run_id": run.id}
        found = client.programs.wait(client.programs.create(stated, files={"path.csv": text}), seen.append)
        assert found.state == "succeeded", found.error
        assert (found.progress.done, found.progress.total) == (POINTS, POINTS)
        assert found.result.corrected == POINTS
        assert all(step.unit == "points" for step in seen)
        (corrected,) = client.programs.files(found).values()
        program = read_program([("path.csv", corrected)])
        old = read_program([("path.csv", text)])
        moved = program.targets.values[:, :3] - old.targets.values[:, :3]
        assert 0.1 < np.linalg.norm(moved, axis=1).max() < 5.0  # mm
        assert client.file(found, "points.csv").count(b"\n") == POINTS + 1
        assert found.id in {listed.id for listed in client.programs.list(robot_id=stored.robot_id)}
