"""Arms, loads and readings that make no sense are refused, each with its place, its reason and a remedy."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError
from support.campaigns import ARM, SIGMA, estimate, first_target, prepare, simulated
from support.documents import campaign, changed
from support.readings import by_gauges, triads, with_encoders
from support.refusals import refused

from jointstiff.simulator import SpringArm, simulate_campaign
from jointstiff.simulator.equilibrium import equilibrium
from jointstiff.solver.mechanics.block import regressor_blocks
from jointstiff.solver.mechanics.measurements import EncoderReadings, Instrument, refuse_invalid_covariance

NOISE = "measurement_set.noise"
OBSERVATIONS = "measurement_set.observations"
FIRST = f"{OBSERVATIONS}.0.readings.0"
ONE = np.eye(3).tolist()
SHEET = {
    "station": [0, 0, 0],
    "range": {"constant": 3e-6, "per_distance": 1e-6},
    "transverse": {"constant": 2e-5, "per_distance": 2e-5},
}


@pytest.fixture(scope="module")
def document():
    return campaign(configurations=5, seed=3)


@pytest.fixture(scope="module")
def with_angles(document):
    return with_encoders(ARM, document, joints=None, sigma=5e-6, noise=5e-6)


def flat_arm(**changes):
    """Return an arm of two parallel axes in the plane."""
    arm = {
        "axis_points": np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        "axis_directions": np.tile([0.0, 0.0, 1.0], (2, 1)),
        "flange_rotation": np.eye(3),
        "flange_translation": np.array([2.0, 0.0, 0.0]),
        "stiffnesses": np.array([1e4, 2e4]),
    }
    return SpringArm(**arm | changes)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"stiffnesses": np.array([1.0, 0.0])}, "stiffnesses must be positive"),
        ({"stiffnesses": np.array([1.0, np.nan])}, "stiffnesses must be positive"),
        ({"axis_points": np.full((2, 3), np.nan)}, "axes and flange must be finite"),
        ({"axis_directions": np.ones((2, 3))}, "axis_directions must be unit vectors"),
        ({"flange_rotation": -np.eye(3)}, "flange_rotation must be a rotation matrix"),
        ({"flange_translation": np.zeros(2)}, "flange_translation has shape (2,); expected (3,)"),
        ({"limits": np.array([1.0, -1.0])}, "limits must be finite and in ascending order"),
    ],
)
def test_an_arm_that_is_none_is_refused(changes, said):
    with pytest.raises(ValueError) as caught:
        flat_arm(**changes)
    assert str(caught.value) == said


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"configurations": 0}, "0 configurations; expected at least one"),
        ({"targets": {}}, "0 targets; expected at least one"),
        ({"force": -1.0}, "force is -1.0; expected a finite number, not negative"),
        ({"sigma": np.nan}, "sigma is nan; expected a finite number, not negative"),
        ({"load": "push"}, "load is 'push'; expected one of dead_weight, pull"),
        ({"readings": "angles"}, "readings is 'angles'; expected one of positions, deflections"),
        ({"encoders": "both"}, "encoders is 'both'; expected one of motor, secondary"),
        (
            {"units": {"length": "inch", "angle": "rad", "force": "N"}},
            "length in 'inch'; expected one of m, mm",
        ),
        (
            {"units": {"length": "m"}},
            "units name ['length']; expected length, angle, force and optionally moment",
        ),
    ],
)
def test_a_simulated_campaign_of_no_sense_is_refused(changes, said):
    with pytest.raises(ValueError) as caught:
        simulate_campaign(ARM, **changes)
    assert str(caught.value) == said


def test_a_load_without_a_balance_is_refused():
    at = np.zeros(6), (0.0, 0.0, 0.0), (0.0, 0.0, 0.1)
    with pytest.raises(RuntimeError, match=r"^no balance after 30 Newton steps; reduce the load or stiffen"):
        equilibrium(ARM, at[0], (0.0, 0.0, -1e9), *at[1:])
    with pytest.raises(ValueError, match=r"^joint angles, force, moment and load point must be finite$"):
        equilibrium(ARM, at[0], (0.0, np.nan, 0.0), *at[1:])


def test_joints_too_soft_to_balance_the_load_are_refused_with_its_complementary_stiffness():
    robot, readings = simulated(load="pull", configurations=2, sigma=0.0, seed=3)
    assert refused(lambda: next(regressor_blocks(robot, readings, 1e3 * ARM.compliances))) == (
        "complementary_stiffness | with such soft joints, the loaded arm has no "
        "equilibrium near the unloaded posture | neglect the complementary stiffness, or check the units of "
        "force and length"
    )
    one_reading = replace(first_target(readings), sigma=None)
    assert estimate(robot, one_reading).complementary_stiffness.largest_shift is None


@pytest.mark.parametrize(
    ("method", "weighting"),
    [("partial_pose", "uniform"), ("complete_pose", "characteristic_length"), ("complete_pose", "uniform")],
)
def test_angles_and_lengths_are_not_added_without_their_covariance(with_angles, method, weighting):
    assert refused(estimate, *prepare(with_angles), method=method, weighting=weighting) == (
        f"weighting | weighting {weighting} cannot combine encoder readings (angles) with positions "
        "(lengths) | use weighting covariance, or omit the encoder readings"
    )


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        (
            ["elbow"],
            "observations[2].encoder_readings | the robot has no revolute joint 'elbow' | use one of "
            "joint_1, joint_2, joint_3, joint_4, joint_5, joint_6",
        ),
        (
            ["joint_2", "joint_2"],
            "observations[2].encoder_readings[1].joint | encoder 'joint_2' has two readings in "
            "observation 'c03' | give each encoder at most once per observation",
        ),
    ],
)
def test_an_encoder_is_of_a_joint_and_read_once(with_angles, joints, said):
    readings = [{"joint": joint, "unloaded": 0.0, "loaded": 0.0} for joint in joints]
    assert refused(prepare, changed(with_angles, (f"{OBSERVATIONS}.2.encoder_readings", readings))) == said


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan, np.inf])
def test_the_sigma_of_encoders_is_positive(sigma):
    assert refused(EncoderReadings, np.zeros((1, 2)), np.ones((1, 2), dtype=bool), sigma) == (
        f"noise.encoder_sigma | the encoders' sigma must be positive, but is {sigma} | give a positive angle"
    )


def test_angles_of_encoders_are_finite_and_of_each_joint(with_angles):
    present = np.ones((4, 2), dtype=bool)
    assert (
        refused(EncoderReadings, np.full((4, 2), np.nan), present, 1e-6)
        == "encoder_readings | a number is not finite | omit or repeat the reading"
    )
    readings = prepare(with_angles)[1]
    encoders = replace(readings.encoders, deflection=np.zeros((4, 2)), present=present)
    assert refused(replace, readings, encoders=encoders) == (
        "encoder_readings | the shape is (4, 2) instead of (5, 6) | give one entry for each "
        "observation and target"
    )


def test_gauges_give_neither_poses_nor_lengths_of_residuals():
    spread = {"P0": (0.15, 0.0, 0.1), "P1": (-0.1, 0.12, 0.1), "P2": (-0.1, -0.12, 0.05)}
    read = campaign(configurations=20, seed=3, readings="deflections", targets=spread)
    gauges = prepare(by_gauges(read, triads(20)))
    assert refused(estimate, *gauges, method="complete_pose") == (
        "observations[0].readings | the pose of the flange needs 3 targets, but observations[0] "
        "'c01' has 0 (20 of 20 observations have too few) | use method partial_pose, or read three "
        "targets in every observation"
    )
    assert refused(estimate, *gauges, loss="huber") == (
        "loss | loss huber needs the length of each residual, but a reading along one direction has no "
        "such length | use loss squared, or omit the readings along a direction"
    )


@pytest.mark.parametrize(
    ("station", "range_constant", "transverse_constant", "said"),
    [
        (
            (0.0, 0.001, 0.0),
            1e-5,
            1e-5,
            "noise.instrument.station | a target is only 1 mm away from the tracker | give the tracker's "
            "station in R0, in `units.length`",
        ),
        (
            (3.5, -2.0, 0.8),
            1e-5,
            1e-16,
            "noise.instrument | the standard uncertainties of 1e-05 m along and 1e-16 m across the line "
            "of sight are not those of a tracker: at least 1e-12 m, and a ratio of at most 1e+06, is "
            "plausible | "
            "check the constants (in `units.length`) and the terms per distance; or state "
            "`noise.sigma` in place of the instrument",
        ),
        (
            (3.5, -2.0, 0.8),
            1e2,
            1e-6,
            "noise.instrument | the standard uncertainties of 100 m along and 1e-06 m across the line of "
            "sight are not those of a tracker: at least 1e-12 m, and a ratio of at most 1e+06, is "
            "plausible | "
            "check the constants (in `units.length`) and the terms per distance; or state "
            "`noise.sigma` in place of the instrument",
        ),
    ],
)
def test_a_tracker_as_no_tracker_is_is_refused(station, range_constant, transverse_constant, said):
    sheet = Instrument(station, range_constant, 0.0, transverse_constant, 0.0)
    assert refused(sheet.covariance, np.zeros((1, 3))) == said


OWN = [(f"{OBSERVATIONS}.{i}.readings.{k}.sigma", (1 + k) * 1e-5) for i in range(5) for k in range(3)]


@pytest.mark.parametrize(
    ("changes", "place", "said"),
    [
        ([(NOISE, {})], NOISE, "give `sigma`, `instrument` or `force` in `noise`, or omit `noise`"),
        (
            [(NOISE, {"sigma": 2e-5, "instrument": SHEET})],
            NOISE,
            "give either `sigma` or `instrument`, not both",
        ),
        (
            [(NOISE, {"instrument": SHEET | {"range": {"constant": 0.0, "per_distance": 0.0}}})],
            f"{NOISE}.instrument.range",
            "give a positive `constant` or `per_distance`; omit this field if all are zero",
        ),
        (
            [(NOISE, None), (f"{FIRST}.unloaded_covariance", ONE)],
            FIRST,
            "give both `unloaded_covariance` and `loaded_covariance`, or neither",
        ),
        (
            [
                (NOISE, None),
                (f"{FIRST}.unloaded_covariance", ONE),
                (f"{FIRST}.loaded_covariance", ONE),
                (f"{FIRST}.sigma", 1e-5),
            ],
            FIRST,
            "give either `sigma` or the two covariances, not both",
        ),
    ],
)
def test_noise_is_stated_once(document, changes, place, said):
    with pytest.raises(ValidationError) as caught:
        prepare(changed(document, *changes))
    (fault,) = caught.value.errors()
    assert (".".join(map(str, fault["loc"])), fault["msg"]) == (place, f"Value error, {said}")


def test_noise_is_of_every_reading_or_of_the_set(document):
    assert refused(prepare, changed(document, *OWN)) == (
        "noise.sigma | both the readings and noise.sigma state the noise | state the noise once: omit "
        "noise.sigma, or omit the noise in every reading"
    )
    missing = changed(document, (NOISE, None), *OWN, (f"{OBSERVATIONS}.3.readings.1.sigma", None))
    assert refused(prepare, missing) == (
        "observations[3].readings | some readings state their own noise, but a reading of this observation "
        "states no noise | give every reading its `sigma` or its covariances, or give only "
        "`noise` for the set"
    )


SMALL, ABOVE = 1e-10 * np.eye(3), np.eye(3, k=1)


@pytest.mark.parametrize(
    ("matrix", "is_refused"),
    [
        (np.diag([1.0, 1.0, -1.0]), True),
        (np.diag([1.0, 1.0, 0.0]), True),
        (np.eye(3) + 0.1 * ABOVE, True),
        (SMALL + 1e-13 * ABOVE, True),
        (SMALL + 1e-22 * ABOVE, False),  # symmetric within rounding
        (1e6 * np.eye(3) + 1e-4 * ABOVE, False),
    ],
)
def test_a_covariance_is_symmetric_and_positive_definite_where_a_target_was_read(matrix, is_refused):
    covariance = np.broadcast_to(np.eye(3), (2, 2, 3, 3)).copy()
    covariance[1, 1] = matrix
    hidden, read = (np.array([[True, True], [False, present]]) for present in (False, True))
    refuse_invalid_covariance(covariance, hidden, "loaded_covariance")
    if not is_refused:
        refuse_invalid_covariance(covariance, read, "loaded_covariance")
        return
    assert refused(refuse_invalid_covariance, covariance, read, "loaded_covariance") == (
        "observations[1].readings[0].loaded_covariance | the covariance matrix is not symmetric and "
        "positive definite | give the covariance of the three coordinates, axes of R0, in "
        "`units.length` squared"
    )


def test_a_simulated_campaign_in_other_units_says_the_same():
    points = np.full((3, 3), 0.1)
    points[1] = 0.2
    options = {"configurations": 3, "moment": 120.0, "load_point": points}
    small = {"length": "mm", "angle": "deg", "force": "kN", "moment": "N.mm"}
    si, other = (campaign(**options, **units) for units in ({}, {"units": small}))
    assert si["robot"] == other["robot"]
    si, other = si["measurement_set"], other["measurement_set"]
    assert si["units"] == {"moment": "N.m", "length": "m", "angle": "rad", "force": "N"}
    assert other["units"] == small
    assert (si["noise"], other["noise"]) == ({"sigma": SIGMA}, {"sigma": pytest.approx(1e3 * SIGMA)})
    assert si["observations"][1]["load_point"] == [0.2, 0.2, 0.2]
    factors = {"joints": 57.29577951308232, "force": 1e-3, "moment": 1e3, "load_point": 1e3}
    for one, two in zip(si["observations"], other["observations"], strict=True):
        for name, factor in factors.items():
            assert two[name] == pytest.approx(np.multiply(factor, one[name]), rel=1e-12), name
        for read, again in zip(one["readings"], two["readings"], strict=True):
            for state in ("unloaded", "loaded"):
                assert again[state] == pytest.approx(np.multiply(1e3, read[state]), rel=1e-12)
    assert si["observations"][0]["force"] == pytest.approx([586.5, 1366.0, 200.0], rel=1e-3)
    assert np.linalg.norm(si["observations"][0]["moment"]) == pytest.approx(120.0)
