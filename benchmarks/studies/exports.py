"""Exports in MuJoCo: it loads them, and its statics come near C·τ in proportion to the load."""

from __future__ import annotations

import json
from importlib.util import find_spec
from typing import Any

import numpy as np

import jointstiff
from benchmarks.report import Figure, Section
from jointstiff.schemas.run import Campaign
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.exporting.formats import FORMATS, export_model
from jointstiff.service.exporting.model import ExportedModel
from jointstiff.simulator import default_arm, random_configurations, simulate_campaign
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.robot.configuration import Configurations

__all__ = ["run"]

FORCE = np.array([600.0, 800.0, -1118.0])
"""1500 N."""
SHARES = (1.0, 0.1, 0.01)
_TITLE = "An export in MuJoCo beside C·τ"
_BALANCED = 1e-9  # [N·m]


def run(*, quick: bool) -> list[Section]:
    """Bend the exported arm by shares of a load, in random postures, by MuJoCo and to first order."""
    if find_spec("mujoco") is None:
        return [Section(_TITLE, (), (), notes=("skipped: there is no MuJoCo here (pip install mujoco)",))]
    import mujoco

    model = _identified()
    q = random_configurations(default_arm(), 3 if quick else 100, seed=5)
    worst = np.array([_differences(mujoco, model, posture) for posture in np.asarray(q)])
    medians = np.median(worst, axis=0)
    rows = [
        (f"{share * np.linalg.norm(FORCE):.0f}", f"{100 * median:.4f}", f"{100 * greatest:.4f}")
        for share, median, greatest in zip(SHARES, medians, worst.max(axis=0), strict=True)
    ]
    ratios = worst[:, 1] / worst[:, 2]
    sizes = {name: len(export_model(model, name)) for name in FORMATS}
    return [
        Section(
            _TITLE,
            ("force [N]", "median difference [%]", "greatest [%]"),
            tuple(rows),
            figures=(
                Figure("difference at a tenth over a hundredth, least", ratios.min(), "at least", 9.5),
                Figure("the same, greatest", ratios.max(), "at most", 10.5),
            ),
            notes=(
                f"MuJoCo {mujoco.__version__}, {len(worst)} postures of six joints, force at the flange",
                "bytes: " + ", ".join(f"{name} {size:,}" for name, size in sizes.items()),
            ),
            data={"differences": worst.tolist()},
        )
    ]


def _identified() -> ExportedModel:
    document = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    campaign = Campaign.model_validate_json(json.dumps(document))
    found = jointstiff.identify(campaign, campaign.run)
    return ExportedModel.of(found, prepare_robot(campaign.robot).robot, campaign.robot.name)


def _differences(mujoco: Any, model: ExportedModel, q: FloatArray) -> list[float]:  # noqa: ANN401
    """Return the relative difference of the flange's displacements at each share of the load."""
    posture = Configurations(model.robot, q[None])
    J = posture.jacobian_at(posture.flange_translation[:, None])[0, 0]
    compliance = np.diag([joint.compliance or 0.0 for joint in model.result.joints])
    found = []
    for share in SHARES:
        linear = J @ compliance @ J.T @ (share * FORCE)
        bent = _bent(mujoco, model, q, share * FORCE)
        found.append(float(np.linalg.norm(bent - linear) / np.linalg.norm(linear)))
    return found


def _bent(mujoco: Any, model: ExportedModel, q: FloatArray, force: FloatArray) -> FloatArray:  # noqa: ANN401
    """Return how far the flange moves [m] until MuJoCo's own forces are in balance."""
    arm = mujoco.MjModel.from_xml_string(export_model(model, "mjcf").decode())
    data = mujoco.MjData(arm)
    flange = data.site(model.chain.flange)
    body = arm.site(model.chain.flange).bodyid[0]
    data.qpos[:] = data.ctrl[:] = q
    mujoco.mj_forward(arm, data)
    start = np.array(flange.xpos)
    for _ in range(100):
        data.qfrc_applied[:] = 0.0
        mujoco.mj_applyFT(arm, data, force, np.zeros(3), flange.xpos, body, data.qfrc_applied)
        mujoco.mj_forward(arm, data)
        rest = data.qfrc_applied + data.qfrc_actuator
        if np.abs(rest).max() < _BALANCED:
            break
        data.qpos[:] += rest / arm.actuator_gainprm[:, 0]
    moved: FloatArray = np.array(flange.xpos) - start
    return moved
