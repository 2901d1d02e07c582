"""Geometries over HTTP and in a terminal: sweeps and poses, robots and measurement sets made of them.

The truth is that of the shared data and of `simulator.sweeps`, which shares no code with the solver.
"""

import json
from functools import lru_cache

import numpy as np
import pytest
from support.shared_data import shared

from jointstiff.schemas.geometry import GeometryRequest
from jointstiff.schemas.measurement import MeasurementSetRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import RunRequest
from jointstiff.service.jobs import Parts
from jointstiff.service.kinds.geometry.kind import GEOMETRY
from jointstiff.service.problems import DeletedError
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.document import robot_document
from jointstiff.simulator.sweeps import HOME, SWEEPS, TrackedArm, imperfect_arm, rotation_by
from jointstiff.solver.errors import MeasurementError, RequestError
from jointstiff.solver.mechanics.postures import Postures

SIGMA = 15e-6
FANUC = np.diag([1.0, 1.0, -1.0, -1.0, -1.0, -1.0])
FANUC[2, 1] = -1.0
BASE_TARGETS = {"B1": [0.5, 0.6, 0.1], "B2": [-0.5, 0.5, 0.0], "B3": [0.1, -0.6, 0.2], "B4": [0.6, -0.4, 0.4]}
UNITS = {"length": "m", "angle": "rad"}


@lru_cache
def robot_id(parts, matrix=None):
    """The nominal robot, stored once a store: a process of its own vets each URDF."""
    document = robot_document(default_arm())
    if matrix is not None:
        document["joint_map"] = {"matrix": [list(row) for row in matrix], "offset": [0.0] * 6}
    return parts.robots.create(RobotDocument.model_validate(document), None).id


def positions(cell, angles, rng, sigma=SIGMA, names=("P10", "P11", "P12")):
    """Positions as they are posted."""
    points = cell.readings(angles)
    points = points + rng.normal(0.0, sigma, points.shape)
    return [
        {"joints": q.tolist(), "targets": dict(zip(names, p.tolist(), strict=True))}
        for q, p in zip(angles, points, strict=True)
    ]


def sweeps(cell, seed=0, count=15, sigma=SIGMA):
    rng = np.random.default_rng([seed, 51])
    return {
        "units": UNITS,
        "noise": {"sigma": sigma},
        "sweeps": [
            {
                "joint": f"joint_{j + 1}",
                "observations": positions(cell, cell.sweep(j, np.linspace(*SWEEPS[j], count)), rng, sigma),
            }
            for j in range(6)
        ],
    }


def poses(cell, seed=0, count=30, still=None):
    rng = np.random.default_rng([seed, 52])
    limits = default_arm().limits
    angles = 0.6 * rng.uniform(limits[:, 0], limits[:, 1], (count, 6)) @ np.linalg.inv(cell.matrix).T
    if still is not None:
        angles[:, still] = 0.3
    return {"units": UNITS, "noise": {"sigma": SIGMA}, "poses": positions(cell, angles, rng)}


MADE = {}
"""Geometries of each store, by their requests: none is changed, and equal ones are equal."""


def made(parts, document, **changes):
    request = GeometryRequest.model_validate(document | changes)
    geometries = MADE.setdefault(id(parts), {})
    key = request.model_dump_json()
    if key not in geometries:
        record = parts.jobs["geometry"].create(request, None)
        geometries[key] = parts.jobs["geometry"].current(record.id)
    return geometries[key]


def base_readings(cell, rng, moved=None):
    """Base targets as the tracker reads them, after a motion (R, t) in its frame."""
    R, t = moved or (np.eye(3), np.zeros(3))
    out = {}
    for name, place in BASE_TARGETS.items():
        point = cell.rotation @ place + cell.translation
        out[name] = (R @ point + t + rng.normal(0.0, SIGMA, 3)).tolist()
    return out


class TestSharedSweeps:
    """Issue 5: within 4 of their own standard uncertainties of truth.json, over HTTP."""

    def test_stiffness_as_with_the_nominal_model(self, parts):
        """The same readings, once in R0 with the nominal robot, once in the tracker's frame as identified."""
        campaign = shared("simulated/dead_weight_motor")
        truth = shared("simulated/truth")["sweeps"]["tracker_from_base"]
        nominal = parts.robots.create(RobotDocument.model_validate(campaign["robot"]), None).id
        geometry = made(parts, shared("simulated/sweeps"), robot_id=nominal)
        identified = parts.robots.create(from_geometry(geometry.id), None).id
        tracked = in_tracker(campaign["measurement_set"], np.array(truth["rotation"]), truth["translation"])
        frame = {"geometry_id": geometry.id}
        expected = run(parts, stored(parts, campaign["measurement_set"], nominal))
        found = run(parts, stored(parts, tracked | {"frame": frame}, identified))
        assert [joint.status for joint in found] == [joint.status for joint in expected]
        for one, other in zip(found, expected, strict=True):
            if other.compliance is not None:
                assert abs(one.compliance - other.compliance) < 0.02 * other.standard_uncertainty
                assert one.standard_uncertainty == pytest.approx(other.standard_uncertainty, rel=0.01)


@pytest.mark.parametrize("way", ["sweeps", "poses"])
def test_an_identified_robot_has_the_payload_of_the_nominal_one(parts, way):
    document = {"sweeps": sweeps, "poses": poses}[way](TrackedArm(default_arm()))
    nominal = robot_document(default_arm()) | {"payload": 210.0}
    kept = parts.robots.create(RobotDocument.model_validate(nominal), None).id
    geometry = made(parts, document, robot_id=kept)
    assert geometry.result.robot.payload == 210.0
    assert made(parts, document, robot=nominal).result.robot.payload == 210.0
    assert parts.robots.load(parts.robots.create(from_geometry(geometry.id), None).id)[0].payload == 210.0


def from_geometry(geometry_id):
    model = {"format": "geometry", "geometry_id": geometry_id}
    return RobotDocument.model_validate({"name": "as measured", "model": model})


def in_tracker(document, R, t):
    """A set of positions in R0, as a tracker would have read it."""
    observations = []
    for observation in document["observations"]:
        readings = [
            reading | {state: (R @ reading[state] + t).tolist() for state in ("unloaded", "loaded")}
            for reading in observation["readings"]
        ]
        observations.append(observation | {"readings": readings})
    return document | {"observations": observations}


def stored(parts, document, robot):
    request = MeasurementSetRequest.model_validate(document | {"robot_id": robot})
    return parts.sets.create(request, None).id


def run(parts, set_id, **options):
    record = parts.jobs["run"].create(RunRequest(measurement_set_id=set_id, **options), None)
    return parts.jobs["run"].current(record.id).result.joints


class TestRobots:
    def test_coupled_axes_give_a_robot_that_predicts_the_tracker(self, parts):
        """A FANUC's joint map; the stored robot, asked elsewhere than it was measured, is where it is."""
        cell = TrackedArm(imperfect_arm(3), matrix=FANUC)
        nominal = robot_id(parts, tuple(map(tuple, FANUC)))
        geometry = made(parts, sweeps(cell), robot_id=nominal)
        result = geometry.result
        assert [sweep.turned for sweep in result.sweeps][1] == ["joint_2", "joint_3"]
        record = parts.robots.create(from_geometry(geometry.id), None)
        robot = parts.robots.load(record.id)[0]
        assert json.loads(record.document)["geometry_id"] == geometry.id
        assert robot.joint_map.matrix == pytest.approx(FANUC)
        assert parts.robots.create(RobotDocument.model_validate(result.robot.model_dump()), None)
        angles = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 6))
        read = cell.readings(angles)
        T = result.transform_tracker_to_base
        flange = np.array([target.position for target in result.targets])
        configurations = Postures(robot, robot.joint_map.model_angles(angles))
        turned = np.einsum("nij,tj->nti", configurations.flange_rotation, flange)
        predicted = turned + configurations.flange_translation[:, None]
        gap = predicted - (read @ np.array(T.rotation).T + T.translation)
        assert np.abs(gap).max() < 150e-6
        assert np.sqrt(np.mean(gap**2)) < 40e-6


class TestFindings:
    def test_bumps_of_other_sweeps_do_not_hide_one(self, parts):
        """A millimetre in four of six sweeps; their residuals are not those of the model."""
        document, rng = sweeps(TrackedArm(), seed=4), np.random.default_rng(1)
        for j in (0, 1, 2, 4):
            step = rng.normal(size=3)
            step *= 1e-3 / np.linalg.norm(step)
            for position in document["sweeps"][j]["observations"][7:]:
                position["targets"] = {name: list(p + step) for name, p in position["targets"].items()}
        found = made(parts, document).result.findings
        bumps = [finding for finding in found if finding.code == "tracker_bumped"]
        places = [f"sweep of joint_{j + 1}, position 8" for j in (0, 1, 2, 4)]
        assert [(bump.weight, bump.where) for bump in bumps] == [("do_not_use", place) for place in places]

    def test_joints_that_do_not_repeat_make_sweeps_disagree(self, parts):
        cell, rng = TrackedArm(), np.random.default_rng(5)
        document = sweeps(cell, seed=5)
        for j, sweep in enumerate(document["sweeps"]):
            real = cell.sweep(j, np.linspace(*SWEEPS[j], 15), HOME + rng.normal(0.0, 3e-4, 6))
            sweep["observations"] = [
                one | {"joints": shown["joints"]}
                for one, shown in zip(positions(cell, real, rng), sweep["observations"], strict=True)
            ]
        together = made(parts, document).result
        assert "sweeps_disagree" in {finding.code for finding in together.findings}
        assert together.agreement_probability < 1e-6
        assert together.fit == "one_by_one"
        alone = made(parts, document, fit="one_by_one").result
        assert alone.agreement_probability is None
        assert {finding.code for finding in alone.findings} == {"wrist_centres_disagree"}
        assert together.axes == alone.axes
        assert together.transform_tracker_to_base == alone.transform_tracker_to_base

    def test_an_instruments_sheet_weighs_readings(self, parts):
        """Noise across the line of sight four times that along it: χ² is right, and the axes are better."""
        cell, rng = TrackedArm(), np.random.default_rng(8)
        document = sweeps(cell, seed=8, sigma=1e-12)
        for sweep in document["sweeps"]:
            for position in sweep["observations"]:
                for name, point in position["targets"].items():
                    sight = np.array(point) / np.linalg.norm(point)
                    noise = rng.normal(0.0, 40e-6, 3)
                    along = rng.normal(0.0, 10e-6)
                    position["targets"][name] = (
                        point + noise - sight * (sight @ noise) + sight * along
                    ).tolist()
        sheet = {
            "station": [0.0, 0.0, 0.0],
            "range": {"constant": 10e-6, "per_distance": 0.0},
            "transverse": {"constant": 40e-6, "per_distance": 0.0},
        }
        result = made(parts, document, noise={"instrument": sheet}).result
        assert result.variance_factor == pytest.approx(1.0, abs=0.2)
        assert result.sigma == pytest.approx(np.sqrt((2 * 40**2 + 10**2) / 3) * 1e-6, rel=1e-6)


def test_a_joint_that_never_turned_is_named(parts):
    result = made(parts, poses(TrackedArm(), still=3), robot_id=robot_id(parts)).result
    assert result.poses.determined == 29
    assert all(names[0].startswith("axis 4") for names in result.poses.only_together)
    assert {finding.code for finding in result.findings} == {"parameters_not_identified"}
    assert result.axes[3].position_uncertainty is None
    assert result.axes[1].position_uncertainty < 100e-6
    assert result.transform_covariance is not None
    assert result.wrist is None
    assert result.no_wrist
    unknown = {(link.quantity, link.joint) for link in result.links if link.standard_uncertainty is None}
    assert ("a", "joint_4") in unknown
    assert ("a", "joint_2") not in unknown


class TestDrift:
    MOTION = rotation_by([0.3, 0.2, 1.0], 120e-6), np.array([0.0, 4e-4, -2e-4])

    def test_within_the_sweeps(self, parts):
        cell, rng = TrackedArm(), np.random.default_rng(2)
        before = base_readings(cell, rng)
        still = made(
            parts, sweeps(cell), base_targets_before=before, base_targets_after=base_readings(cell, rng)
        )
        assert not still.result.drift.significant
        moved = base_readings(cell, rng, self.MOTION)
        moved["B4"] = [moved["B4"][0] + 1e-3, *moved["B4"][1:]]
        drift = made(parts, sweeps(cell), base_targets_before=before, base_targets_after=moved).result
        assert drift.drift.significant
        assert drift.drift.moved_targets == ["B4"]
        codes = {finding.code: finding.where for finding in drift.findings}
        assert codes == {"base_drifted": "base_targets_after", "base_target_moved": "base_targets_after.B4"}

    def test_is_removed_from_a_later_set(self, parts):
        cell, rng = TrackedArm(), np.random.default_rng(3)
        nominal = robot_id(parts)
        geometry = made(parts, sweeps(cell), robot_id=nominal, base_targets_before=base_readings(cell, rng))
        assert geometry.result.drift is None
        document = simulate_campaign(default_arm(), load="pull", sigma=1e-9, seed=3)["measurement_set"]
        R, t = self.MOTION
        tracked = in_tracker(document, R @ cell.rotation, R @ cell.translation + t)
        tracked["units"] = {"length": "m", "angle": "rad", "force": "N"} | document["units"]
        later = base_readings(cell, rng, self.MOTION)
        frame = {"geometry_id": geometry.id, "base_targets": later}
        sets = [
            stored(parts, tracked | {"frame": frame | kept}, nominal) for kept in ({}, {"base_targets": None})
        ]
        truth = parts.sets.prepared(stored(parts, document, nominal)).measurements.position
        gaps = [np.abs(parts.sets.prepared(one).measurements.position - truth).max() for one in sets]
        assert gaps[0] < 120e-6 < 250e-6 < gaps[1]
        warnings = parts.sets.document(sets[0]).warnings
        assert ("base_drifted", "frame.base_targets") in {(each.code, each.where) for each in warnings}


class TestFrames:
    R, T = rotation_by([0.4, -1.0, 0.7], 2.3), np.array([1.3, -2.1, 0.4])

    def prepared(self, parts, document):
        return parts.sets.prepared(stored(parts, document, robot_id(parts))).measurements

    @pytest.mark.parametrize("kind", ["positions", "deflections"])
    @pytest.mark.parametrize("length", ["m", "mm"])
    @pytest.mark.parametrize("noise", ["sigma", "covariance", "instrument"])
    def test_the_same_set_in_another_frame(self, parts, kind, length, noise):
        """Everything that the solver is given is as if it had been posted in R0."""
        units = {"length": length, "angle": "deg", "force": "N"}
        document = simulate_campaign(
            default_arm(), load="pull", seed=1, configurations=4, units=units, readings=kind
        )["measurement_set"]
        unit = {"m": 1.0, "mm": 1e3}[length]
        with_noise(document, noise, unit)
        tracked = self.turned(document, unit, noise)
        expected, found = self.prepared(parts, document), self.prepared(parts, tracked)
        assert found.sigma == pytest.approx(expected.sigma, rel=1e-9)
        for name in ("position", "deflection", "force", "moment", "load_point"):
            assert getattr(found, name) == pytest.approx(getattr(expected, name), abs=1e-9)
        assert found.covariance == pytest.approx(expected.covariance, abs=1e-9)

    def turned(self, document, unit, noise):
        """The document as the tracker says it: x = Rᵀ (y − T)."""
        R, t = self.R, unit * self.T
        out = json.loads(json.dumps(document))
        out["frame"] = {"rotation": R.tolist(), "translation": t.tolist(), "forces": "tracker"}
        ways = {
            "unloaded": lambda place: R.T @ (np.array(place) - t),
            "loaded": lambda place: R.T @ (np.array(place) - t),
            "deflection": lambda vector: R.T @ vector,
            "unloaded_covariance": lambda C: symmetric(R.T @ C @ R),
            "loaded_covariance": lambda C: symmetric(R.T @ C @ R),
        }
        for observation in out["observations"]:
            observation["force"] = (R.T @ observation["force"]).tolist()
            for reading in observation["readings"]:
                said = {name: way(reading[name]).tolist() for name, way in ways.items() if name in reading}
                reading.update(said)
        if noise == "instrument":
            station = np.array(document["noise"]["instrument"]["station"])
            out["noise"]["instrument"]["station"] = (R.T @ (station - t)).tolist()
        return out

    def test_forces_stay_in_r0_unless_said_otherwise(self, parts):
        document = simulate_campaign(default_arm(), seed=1, configurations=4)["measurement_set"]
        frame = {"rotation": self.R.tolist(), "translation": self.T.tolist()}
        plain, turned = (
            self.prepared(parts, document | {"frame": frame | more}) for more in ({}, {"forces": "tracker"})
        )
        assert plain.force == pytest.approx(self.prepared(parts, document).force)
        assert turned.force == pytest.approx(plain.force @ self.R.T)

    def test_targets_of_the_geometry_stand_in(self, parts):
        """Deflections of targets that the set does not place; not where the flange frame is another."""
        cell = TrackedArm()
        geometry = made(parts, sweeps(cell), robot_id=robot_id(parts))
        document = simulate_campaign(
            default_arm(), load="pull", seed=1, configurations=4, readings="deflections"
        )["measurement_set"]
        del document["flange_targets"]
        for observation in document["observations"]:
            for name, reading in zip(("P10", "P11", "P12"), observation["readings"], strict=False):
                reading["target"] = name
        framed = document | {"frame": {"geometry_id": geometry.id}}
        identified = parts.robots.create(from_geometry(geometry.id), None).id
        for robot in (robot_id(parts), identified):
            set_id = stored(parts, framed, robot)
            places = parts.sets.prepared(set_id).measurements.position[0]
            assert places == pytest.approx(cell.targets[: len(places)], abs=30e-6)
        other = parts.robots.create(RobotDocument.model_validate(robot_document(default_arm())), None).id
        with pytest.raises(MeasurementError, match="no position in the flange frame"):
            stored(parts, framed, other)

    def test_a_set_outlives_its_geometry(self, parts):
        cell = TrackedArm()
        geometry = made(parts, sweeps(cell), robot_id=robot_id(parts), name="to be deleted")
        document = simulate_campaign(default_arm(), seed=2, configurations=4)["measurement_set"]
        tracked = in_tracker(document, cell.rotation, cell.translation)
        frame = {"geometry_id": geometry.id}
        set_id = stored(parts, tracked | {"frame": frame}, robot_id(parts))
        parts.jobs["geometry"].records.delete(geometry.id)
        with pytest.raises(DeletedError):
            parts.jobs["geometry"].current(geometry.id)
        assert Parts(parts.store).sets.prepared(set_id).measurements.position == pytest.approx(
            self.prepared(parts, document).position, abs=200e-6
        )
        with pytest.raises(RequestError) as caught:
            stored(parts, tracked | {"frame": frame}, robot_id(parts))
        assert caught.value.where == "frame.geometry_id"


@pytest.mark.slow
def test_a_thousand_circle_points_with_sweeps_of_the_first_axes(parts):
    """As the paper measured: within the limits of a body, of memory and of the time of a request."""
    arm, rng, counts = TrackedArm(), np.random.default_rng(1), (100, 100, 100, 15, 500, 500)
    document = sweeps(arm)
    for j, (sweep, count) in enumerate(zip(document["sweeps"], counts, strict=True)):
        angles = arm.sweep(j, np.linspace(*SWEEPS[j], count))
        sweep["observations"] = positions(arm, angles, rng, SIGMA)
    assert len(json.dumps(document)) < GEOMETRY.max_bytes
    estimates = made(parts, document).result.wrist.estimates
    assert {estimate.way for estimate in estimates} == {"sphere", "axes", "trilateration"}


def symmetric(C):
    return 0.5 * (C + C.T)


def with_noise(document, kind, unit):
    """State noise in one of the ways, in the units of the document."""
    document.pop("noise", None)
    if kind == "sigma":
        document["noise"] = {"sigma": 2e-5 * unit}
    elif kind == "instrument":
        document["noise"] = {
            "instrument": {
                "station": [-3.0 * unit, 1.0 * unit, 0.5 * unit],
                "range": {"constant": 1e-5 * unit, "per_distance": 1e-6},
                "transverse": {"constant": 2e-5 * unit, "per_distance": 6e-6},
            }
        }
    else:
        rng = np.random.default_rng(9)
        for observation in document["observations"]:
            for reading in observation["readings"]:
                for name in ("unloaded_covariance", "loaded_covariance"):
                    factor = 1e-5 * unit * (np.eye(3) + 0.5 * rng.normal(size=(3, 3)))
                    reading[name] = (factor @ factor.T).tolist()
