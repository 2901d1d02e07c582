"""A run in process, beside the bare call of the numerical core, and beside a script of eighteen lines."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.optimize import nnls

import jointstiff
from benchmarks.campaigns import default_settings, small_campaign
from benchmarks.report import Figure, Section, times_table
from benchmarks.timing import interleaved
from jointstiff.schemas.run import Campaign
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.rows import Rows

__all__ = ["run"]

MESSAGE = "campaign → run, with checks, residuals and provenance"
BARE = "arrays → estimate"
SCRIPT = "a script: readings → stiffness ± u"


def run(*, quick: bool) -> list[Section]:
    """Compare the library's `identify` with the solver's and with a script, on the same readings."""
    return [_beside_solver(quick=quick), _beside_script(quick=quick)]


def _beside_solver(*, quick: bool) -> Section:
    simulated = small_campaign(configurations=40)
    campaign = Campaign.model_validate(simulated.document)
    robot, measurements = simulated.robot, simulated.measurements
    settings = default_settings(robot)
    times = interleaved(
        {
            MESSAGE: partial(jointstiff.identify, campaign, campaign.run),
            # A set keeps its regressors, so each fit has a set of its own.
            BARE: lambda: identify(Rows(robot, replace(measurements)), settings),
        },
        rounds=3 if quick else 200,
        warm_up=3,
    )
    columns, rows = times_table(times, MESSAGE)
    what = "a run of 40 configurations in process: time / the bare call of the solver"
    return Section(
        title="A run of 40 configurations × 3 targets in process, without a store",
        columns=columns,
        rows=rows,
        figures=(Figure(what, times.ratio(MESSAGE, BARE), "at most", 5.0, "×"),),
        notes=("the robot is read once; the readings are checked for the usual mistakes in every call",),
        data={"seconds": times.seconds},
    )


def _beside_script(*, quick: bool) -> Section:
    document = small_campaign().document
    campaign = Campaign.model_validate(document)
    times = interleaved(
        {
            MESSAGE: partial(jointstiff.identify, campaign, campaign.run),
            SCRIPT: partial(_run_script, document),
        },
        rounds=3 if quick else 200,
        warm_up=3,
    )
    columns, rows = times_table(times, MESSAGE)
    what = "a run of 19 configurations in process: time / a script of eighteen lines"
    return Section(
        title="A run of 19 configurations × 3 targets in process, beside a script",
        columns=columns,
        rows=rows,
        figures=(Figure(what, times.ratio(MESSAGE, SCRIPT), "at most", 22.0, "×"),),
        notes=("the script neglects K_c, scatter and stated errors, and checks nothing",),
        data={"seconds": times.seconds},
    )


def _run_script(document: dict[str, Any]) -> tuple[FloatArray, FloatArray]:
    """Return stiffnesses [N·m/rad] and relative uncertainties by Pinocchio, NumPy and SciPy, as users do."""
    model = pin.buildModelFromXML(document["robot"]["model"]["urdf"])
    data, flange = model.createData(), model.nframes - 1
    load_point = np.array(document["measurement_set"]["load_point"])
    A, d = [], []
    for observation in document["measurement_set"]["observations"]:
        J = pin.computeJointJacobians(model, data, np.array(observation["joints"]))
        hook = pin.updateFramePlacement(model, data, flange).act(load_point)
        torque = (J[:3] + np.cross(J[3:].T, hook).T).T @ np.array(observation["force"])
        for reading in observation["readings"]:
            unloaded = np.array(reading["unloaded"])
            A.append((J[:3] + np.cross(J[3:].T, unloaded).T) * torque)
            d.append(np.array(reading["loaded"]) - unloaded)
    rows, readings = np.concatenate(A), np.concatenate(d)
    compliance, residual = nnls(rows, readings)
    sigma = residual / np.sqrt(len(readings) - len(compliance))
    uncertainty = sigma * np.sqrt(np.diagonal(np.linalg.inv(rows.T @ rows)))
    return 1.0 / compliance, uncertainty / compliance
