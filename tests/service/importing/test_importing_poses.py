"""Unloaded poses from tables: deviations added to coordinates, and what a geometry takes."""

import numpy as np
import pytest
from support.importing_samples import sources_of
from support.shared_data import MISSING, SHARED

import jointstiff
from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.resources.imports import import_files

TABLE = """name,J1 [deg],J2 [deg],P1 unloaded x [mm],P1 unloaded y [mm],P1 unloaded z [mm],dx,dy,dz
c01,10,20,1000,200,300,0.5,-0.25,0.125
c02,30,40,900,400,350,-0.5,0.75,0
"""
UR = {
    "ur5": ((0, 0.089159), (-0.425, 0), (-0.39225, 0), (0, 0.10915), (0, 0.09465), (0, 0.0823)),
    "ur10": ((0, 0.1273), (-0.612, 0), (-0.5723, 0), (0, 0.163941), (0, 0.1157), (0, 0.0922)),
}
"""The maker's a and d, in m."""
TWISTS = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)


def answered(table, **options):
    request = ImportRequest.model_validate(options)
    return import_files(sources_of(("poses.csv", table)), request)


def robot_of(name):
    rows = [
        {"a": a, "alpha": alpha, "d": d, "theta": 0.0} for (a, d), alpha in zip(UR[name], TWISTS, strict=True)
    ]
    model = {"format": "dh", "convention": "standard", "rows": rows}
    return RobotDocument.model_validate({"name": name, "model": model})


def test_uncertainties_in_the_files_become_one_sigma():
    expanded = TABLE.replace(
        "dx,dy,dz", "P1 unloaded U95 x [mm],P1 unloaded U95 y [mm],P1 unloaded U95 z [mm]"
    )
    answer = answered(expanded.replace("-0.", "0."))
    squares = (np.array([0.5, 0.25, 0.125, 0.5, 0.75, 5e-4]) / 1.96) ** 2
    assert answer.poses.noise.sigma == pytest.approx(np.sqrt(squares.mean()), rel=1e-12)


@pytest.mark.slow  # those of a UR10 by day
@pytest.mark.skipif(not SHARED.is_dir(), reason=MISSING)
def test_the_poses_of_a_real_ur5_give_its_geometry():
    """1,000 poses, read as target plus deviation: residuals as small as the best published, 0.15 mm."""
    columns = {"step_order": "label", **{f"joint_{number}": f"J{number} [deg]" for number in range(1, 7)}}
    for axis in "xyz":
        columns |= {f"{axis}_t": f"tool unloaded {axis} [mm]"}
        columns |= {f"{axis}_dif": f"tool unloaded plus {axis} [mm]"}
    file = SHARED / "ur5_grid" / "3D_UR5_uncalibrated_grid_cleaned.csv"
    poses = jointstiff.import_files(file, columns=columns).poses
    assert len(poses.poses) == 1_000
    few = poses.model_copy(update={"poses": poses.poses[::5]})
    found = jointstiff.geometry(few.model_dump(mode="json"), robot=robot_of("ur5"))
    assert found.result.goodness.sigma < 0.15e-3


@pytest.mark.skipif(not SHARED.is_dir(), reason=MISSING)
def test_the_poses_of_a_real_ur10_give_its_geometry():
    """Decimal commas, no labels, uncertainties that are no U(95): 632 poses of a T-Mac."""
    joints = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    columns = {f"{name}_joint": f"J{number} [rad]" for number, name in enumerate(joints, 1)}
    columns |= {f"measurement_{axis}": f"TMAC unloaded {axis} [mm]" for axis in "xyz"}
    file = SHARED / "ur10_poses" / "measurements_iso_cubes.csv"
    ignore = [header for header in file.read_text().splitlines()[0].split(";") if header not in columns]
    poses = jointstiff.import_files(file, columns=columns, ignore=ignore, by_order=True).poses
    assert len(poses.poses) == 632
    few = poses.model_copy(update={"poses": poses.poses[::12]})
    found = jointstiff.geometry(few.model_dump(mode="json"), robot=robot_of("ur10"))
    assert found.result.goodness.sigma < 1e-3
