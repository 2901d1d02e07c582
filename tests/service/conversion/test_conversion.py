"""Messages to the solver's data and back: readings along directions, encoders, places."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from support.campaigns import estimate, prepare
from support.examples import examples
from support.readings import by_gauges, triads
from support.refusals import refused

from jointstiff import identify, plan
from jointstiff.schemas.finding import AdvisedAction
from jointstiff.schemas.measurement import MeasurementSetDocument, Noise, Observation, Reading
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import Campaign
from jointstiff.service.conversion.measurements import to_common_uncertainty, to_measurements
from jointstiff.service.conversion.prepared import prepare_robot, prepare_set
from jointstiff.service.conversion.readings import ReadingArrays, compute_content_hash
from jointstiff.service.kinds.plan.kind import make_campaign_to_fill_in, readings_sheet
from jointstiff.service.resources.inputs import InMemoryInputs
from jointstiff.service.runs.mending import apply_action_to_campaign
from jointstiff.service.tables.files import csv_text
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.errors import MeasurementError

ARM = default_arm()
HASH_BEFORE = "5973c1d49acca54a0670cb27f8c7f7f5675208331793afe20a8afe026cba8604"
"""Hash of eight simulated postures with the ground `tracker`, before grounds had other fields."""


def gauges(count=20, **options):
    document = simulate_campaign(ARM, **{"load": "pull", "readings": "deflections", "seed": 3} | options)
    return document, by_gauges(document, triads(count))


def measured(document, **changes):
    return document | {"measurement_set": document["measurement_set"] | changes}


@pytest.mark.parametrize(
    "fields",
    [
        {"displacement": 1.0},
        {"direction": (0.0, 0.0, 1.0)},
        {"displacement": 1.0, "direction": (0.0, 0.0, 0.0)},
        {"displacement": 1.0, "direction": (0.0, 0.0, 1.0), "flange_direction": (0.0, 0.0, 1.0)},
        {"displacement": 1.0, "direction": (0.0, 0.0, 1.0), "deflection": (0.0, 0.0, 1.0)},
        {"displacement": 1.0, "direction": (0.0, 0.0, 1.0), "unloaded": (0.0, 0.0, 1.0)},
    ],
)
def test_a_reading_is_of_one_kind(fields):
    with pytest.raises(ValidationError, match="displacement"):
        Reading(target="tip", **fields)


def test_directions_turn_with_the_tracker_frame():
    """All in the frame of a tracker that stands askew gives the same as in R0."""
    document = gauges()[1]
    R = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    R = R * np.linalg.det(R)
    turned = json.loads(json.dumps(document))
    for observation in turned["measurement_set"]["observations"]:
        for reading in observation["readings"]:
            reading["direction"] = (R.T @ np.array(reading["direction"])).tolist()
    frame = {"rotation": R.tolist(), "translation": [1.0, 2.0, 3.0]}
    turned = measured(turned, frame=frame)
    found = [identify(each, elasticity="joints").result.joints for each in (document, turned)]
    for one, other in zip(*found, strict=True):
        assert other.compliance == pytest.approx(one.compliance, rel=1e-9)


ASKEW = {"rotation": [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], "translation": [1.0, 2.0, 3.0]}


def content_hash(**changes):
    document = simulate_campaign(ARM, load="pull", configurations=3, seed=1)
    parts = Campaign.model_validate(measured(document, **{"frame": ASKEW} | changes))
    return prepare_set(parts.measurement_set, prepare_robot(parts.robot), "robot", ()).content_hash


@pytest.mark.parametrize(
    "changes",
    [
        {"units": {"length": "m", "angle": "rad", "force": "kgf"}},
        {"encoders": "secondary"},
        {"noise": {"sigma": 3e-5}},
        {"load_point": [0.0, 0.0, 0.1]},
        {"flange_targets": {"P10": [0.1, 0.0, 0.1]}},
        {"frame": ASKEW | {"forces": "tracker"}},
        {"frame": ASKEW | {"translation": [1.0, 2.0, 4.0]}},
        {"frame": ASKEW | {"rotation": np.eye(3).tolist()}},
        {"frame": None},
    ],
    ids=str,
)
def test_the_hash_of_a_set_changes_with_each_statement_that_moves_a_number(changes):
    assert content_hash(**changes) != content_hash()


def test_the_hash_of_a_set_does_not_depend_on_its_name():
    assert content_hash(name="another name") == content_hash()


def test_gauges_along_the_axes_are_the_deflections_themselves():
    """Directions with zeros in them are directions: the same stiffnesses as of whole vectors."""
    document, _ = gauges(configurations=12, sigma=0.0)
    axes = by_gauges(document, np.tile(2.0 * np.eye(3), (12, 1, 1)))
    whole, taken_apart = (
        identify(measured(each, noise=None), elasticity="joints").result.joints for each in (document, axes)
    )
    for one, other in zip(whole, taken_apart, strict=True):
        assert other.compliance == pytest.approx(one.compliance, rel=1e-6)
    posted = MeasurementSetDocument.model_validate_json(json.dumps(axes["measurement_set"]))
    assert ReadingArrays.from_observations(posted.observations).directions.has_direction.all()


ENCODER = {"joint": "joint_1", "unloaded": 0.1, "loaded": 0.2}
OTHER, UNKNOWN = ENCODER | {"joint": "joint_2"}, ENCODER | {"joint": "elbow"}
TIP = {"target": "tip", "deflection": [0.0, 0.0, 1e-4]}
STATED = {"target": "P10", "deflection": [0.0, 0.0, 1e-4], "sigma": 1e-5}
ANGLES, NOWHERE = {"sigma": 1e-5, "encoder_sigma": 1e-5}, {"load_point": None, "force": [0, 0, -9]}
ALONG = {"target": "P11", "displacement": 1e-4, "direction": [0.0, 0.0, 1.0]}


@pytest.mark.parametrize(
    ("of_set", "each", "faulty", "where"),
    [
        ({"load_point": None}, {"load_point": [0, 0, 0.1]}, NOWHERE, "observations[2].load_point"),
        ({"encoders": "secondary"}, {}, {"encoder_readings": [ENCODER]}, "observations[2].encoder_readings"),
        ({"noise": ANGLES}, {}, {"encoder_readings": [UNKNOWN]}, "observations[2].encoder_readings"),
        ({}, {}, {"encoder_readings": [OTHER, ENCODER, OTHER]}, "observations[2].encoder_readings[2].joint"),
        ({}, {}, {"readings": [TIP, STATED, TIP]}, "observations[2].readings[2].target"),
        ({}, {}, {"readings": [TIP]}, "observations[2].readings"),
        (
            {"noise": None},
            {"readings": [STATED]},
            {"readings": [STATED | {"sigma": None}]},
            "observations[2].readings",
        ),
        ({"noise": None}, {"readings": [STATED]}, {"readings": [STATED, ALONG]}, "observations[2].readings"),
        (
            {"units": {"length": "mm", "angle": "deg", "force": "N"}},
            {},
            {"moment": [0, 0, 1]},
            "the unit of the moment in observation 'c03' is ambiguous",
        ),
    ],
)
def test_the_observation_that_is_refused_is_named(of_set, each, faulty, where):
    """The first of five is sound, without a load; the third has the fault, and the last has it, too."""
    document = simulate_campaign(ARM, load="pull", readings="deflections", configurations=5, seed=1)
    observations = [one | {"moment": None} | each for one in document["measurement_set"]["observations"]]
    observations[0] |= {"force": [0, 0, 0], "load_point": None}
    observations[2] |= faulty
    observations[4] |= {"encoder_readings": [ENCODER, OTHER]} if "encoders" in of_set else faulty
    with pytest.raises(MeasurementError) as refused:
        prepare(measured(document, observations=observations, **of_set))
    assert where in str(refused.value)


class TestNoise:
    """A gauge has noise of its own, beside the tracker's in any form."""

    def mixed(self, noise, sigma):
        document, of_gauges = gauges(targets={"P0": (0.1, 0.0, 0.1), "P1": (0.0, 0.1, 0.1)})
        both = [
            tracker
            | {"readings": [tracker["readings"][0], *({**r, **sigma} for r in gauge["readings"][3:4])]}
            for tracker, gauge in zip(
                document["measurement_set"]["observations"],
                of_gauges["measurement_set"]["observations"],
                strict=True,
            )
        ]
        places = {"P0": (0.1, 0.0, 0.1), "P1 0": (0.0, 0.1, 0.1)}
        return prepare(measured(document, observations=both, flange_targets=places, noise=noise))[1]

    def test_of_a_tracker_is_not_that_of_a_gauge(self):
        sheet = {
            "station": [3.0, 0.0, 0.0],
            "range": {"constant": 2e-5, "per_distance": 0.0},
            "transverse": {"constant": 2e-5, "per_distance": 0.0},
        }
        with pytest.raises(MeasurementError, match="does not apply"):
            self.mixed({"instrument": sheet}, {})

    def test_of_the_tracker_is_needed_beside_that_of_a_gauge(self):
        with pytest.raises(MeasurementError, match="does not apply"):
            self.mixed(None, {"sigma": 2e-6})

    def test_of_each_kind_is_weighed_by_its_own(self):
        for noise in (
            {"sigma": 2e-5},
            {
                "instrument": {
                    "station": [3.0, 0.0, 0.0],
                    "range": {"constant": 2e-5, "per_distance": 0.0},
                    "transverse": {"constant": 2e-5, "per_distance": 0.0},
                }
            },
        ):
            readings = self.mixed(noise, {"sigma": 2e-6})
            variance = readings.sigma**2 * np.trace(readings.covariance, axis1=-2, axis2=-1) / 6.0
            np.testing.assert_allclose(variance[:, 0], 4e-10, rtol=1e-12)
            np.testing.assert_allclose(variance[:, 1], 2e-12, rtol=1e-12)  # half of the displacement's


def test_a_clean_campaign_of_gauges_is_used_and_holds_the_truth():
    """Twenty campaigns of 20 postures with three gauges: no false alarm, intervals about the truth."""
    inside, joints = 0, 0
    for seed in range(20):
        document = simulate_campaign(
            ARM,
            load="pull",
            readings="deflections",
            seed=seed,
            configurations=20,
            targets={"tip": (0.1, 0.0, 0.1)},
        )
        noise = {"sigma": 2e-5, "load_point": 1e-9}
        run = identify(measured(by_gauges(document, triads(20, seed)), noise=noise))
        assert {reason.code for reason in run.reasons} <= {"joint_poorly_known"}, run.reasons
        assert not [w for w in run.result.warnings if w.weight != "use"]
        for joint, k in zip(run.result.joints, ARM.stiffnesses, strict=True):
            joints += joint.stiffness_interval is not None
            low, high = joint.stiffness_interval
            inside += low <= k <= (high or np.inf)
    assert inside >= 0.88 * joints  # 114 of 120 are expected, 106 at p = 0.001


def test_a_minute_direction_is_refused_before_its_square_is_zero():
    with pytest.raises(ValidationError, match="1e-06"):
        Reading(target="tip", displacement=1.0, direction=(0.0, 0.0, 1e-200))


def test_exchanged_readings_turn_gauges_too():
    document = gauges()[1]
    read = Campaign.model_validate_json(json.dumps(document))
    turned = apply_action_to_campaign(
        read, AdvisedAction.model_construct(kind="exchange_readings", unit=None)
    ).measurement_set
    before = document["measurement_set"]["observations"][0]["readings"][0]["displacement"]
    assert turned.observations[0].readings[0].displacement == -before


def test_the_sigma_of_a_gauge_keeps_its_size_in_another_unit():
    document = gauges()[1]
    for observation in document["measurement_set"]["observations"]:
        for reading in observation["readings"]:
            reading["sigma"] = 2e-6
    document["measurement_set"].pop("noise")
    read = Campaign.model_validate_json(json.dumps(document))
    changed = apply_action_to_campaign(
        read, AdvisedAction.model_construct(kind="convert_units", unit="mm")
    ).measurement_set
    assert changed.units.length == "mm"
    assert changed.observations[0].readings[0].sigma == pytest.approx(2e-3)


def test_repeated_gauges_are_not_taken_for_noise_of_the_tracker():
    """One target at 20 µm, six gauges at 2 µm, each posture three times: the noise is as stated."""
    document, of_gauges = gauges(targets={"P0": (0.1, 0.0, 0.1), "P1": (0.0, 0.1, 0.1)}, sigma=0.0)
    random, observations = np.random.default_rng(5), []
    for tracker, gauge in zip(
        document["measurement_set"]["observations"], of_gauges["measurement_set"]["observations"], strict=True
    ):
        for turn in range(3):
            moved = np.array(tracker["readings"][0]["deflection"])
            read = moved + np.sqrt(2) * 2e-5 * random.standard_normal(3)
            readings = [tracker["readings"][0] | {"deflection": read.tolist()}]
            for one in gauge["readings"]:
                off = np.sqrt(2) * 2e-6 * random.standard_normal()
                readings.append(one | {"displacement": one["displacement"] + off, "sigma": 2e-6})
            observations.append(tracker | {"label": f"{tracker['label']} {turn}", "readings": readings})
    places = of_gauges["measurement_set"]["flange_targets"] | {"P0": (0.1, 0.0, 0.1)}
    changes = {"observations": observations, "flange_targets": places, "noise": {"sigma": 2e-5}}
    run = identify(measured(document, **changes), elasticity="joints")
    (repeated,) = [each for each in run.result.warnings if each.code == "repeated_readings"]
    assert repeated.weight == "use", repeated.message


def test_the_list_of_a_plan_is_filled_in_and_read_back():
    """The campaign and the table to fill in have the plan's load point, places and directions."""
    document = gauges(configurations=20)[1]
    found = plan(document, readings=6, candidates=200, directions=[(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
    source = Campaign.model_validate_json(json.dumps(document))
    filled = make_campaign_to_fill_in(source, found)["measurement_set"]
    assert list(filled["load_point"]) == pytest.approx(source.measurement_set.load_point)
    targets = {reading["target"] for each in filled["observations"] for reading in each["readings"]}
    assert targets == set(filled["flange_targets"])
    for observation in filled["observations"]:
        for reading in observation["readings"]:
            reading["displacement"] = 1e-4
    assert MeasurementSetDocument.model_validate_json(json.dumps(filled))
    sheet = csv_text(readings_sheet(found)).splitlines()
    assert "along y [mm]" in sheet[0] or "along z [mm]" in sheet[0]
    assert all("read along" in line for line in sheet[1:])


@pytest.mark.parametrize(
    ("units", "length", "angle"), [(("m", "rad", "N"), 1.0, 1.0), (("mm", "deg", "N"), 1e-3, np.pi / 180.0)]
)
def test_planned_readings_have_the_noise_of_their_campaign_in_m_and_rad(units, length, angle):
    document = simulate_campaign(ARM, configurations=12)
    document["measurement_set"] |= {
        "units": dict(zip(("length", "angle", "force"), units, strict=True)),
        "noise": {"sigma": 2e-5 / length, "repeatability": 1e-5 / angle, "load_point": 1e-3 / length},
    }
    source = Campaign.model_validate_json(json.dumps(document))
    found = plan(simulate_campaign(ARM, configurations=12), readings=4, candidates=100)
    noise = make_campaign_to_fill_in(source, found)["measurement_set"]["noise"]
    assert noise == pytest.approx({"sigma": 2e-5, "repeatability": 1e-5, "load_point": 1e-3})


@pytest.mark.parametrize(
    "directions",
    [
        pytest.param([(0.0, 0.0, 1.0), (0.0, 1.0, 0.0)], marks=pytest.mark.slow),
        [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)],
    ],
)
def test_no_order_of_directions_hides_a_joint_from_a_plan(directions):
    """Read along z alone, joint 1 of an upright arm is not determined: both directions are looked at."""
    robot = RobotDocument.model_validate(simulate_campaign(ARM, configurations=3)["robot"])
    options = {"targets": {"tip": (0.1, 0.0, 0.1)}, "load_point": (0.0, 0.1, 0.1), "readings": 12}
    load = {"kind": "any_direction", "force": 1000.0}
    found = plan(robot, load=load, candidates=700, directions=directions, **options)
    assert found.error is None
    assert "joint_1" not in found.result.left_out


coordinate = st.floats(-1e12, 1e12, allow_nan=False)
vector = st.lists(coordinate, min_size=3, max_size=3)
square = [[4e-10, 1e-10, 0.0], [1e-10, 4e-10, 0.0], [0.0, 0.0, 9e-10]]
noise = st.sampled_from([{}, {"sigma": 1e-5}, {"unloaded_covariance": square, "loaded_covariance": square}])
OPTIONAL = {"moment": vector, "load_point": vector, "encoder_readings": st.just([OTHER, ENCODER])}
text = st.text(st.characters(categories=["L", "N", "P", "S"]), min_size=1, max_size=12)
reading = st.one_of(
    st.fixed_dictionaries({"unloaded": vector, "loaded": vector}),
    st.fixed_dictionaries({"deflection": vector}),
    st.fixed_dictionaries({"unloaded": vector}),
    st.fixed_dictionaries({"displacement": coordinate, "direction": st.just([0.6, 0.0, -0.8])}),
    st.fixed_dictionaries({"displacement": coordinate, "flange_direction": st.just([0.0, 1.0, 0.0])}),
)


def with_noise(read, stated):
    """The reading with what is stated of it: a gauge has no covariance."""
    return read | (stated if "sigma" in stated or "displacement" not in read else {})


@st.composite
def observations(draw):
    labels = draw(st.lists(text, min_size=1, max_size=4, unique=True))
    joints, stated = draw(st.integers(1, 5)), draw(noise)
    return [
        {
            "label": label,
            "joints": draw(st.lists(coordinate, min_size=joints, max_size=joints)),
            "force": draw(vector),
            **draw(st.fixed_dictionaries({}, optional=OPTIONAL)),
            "readings": [
                {"target": target} | with_noise(read, stated)
                for target, read in draw(st.dictionaries(text, reading, min_size=1, max_size=3)).items()
            ],
        }
        for label in labels
    ]


@examples(100)
@given(observations())
def test_what_is_stored_comes_back_bit_for_bit(sent):
    arrays = ReadingArrays.from_observations([Observation.model_validate(o) for o in sent])
    restored = ReadingArrays.unpack(arrays.pack())
    assert restored.digest() == arrays.digest()
    assert restored.observations() == arrays.observations()
    for given_, kept in zip(sent, restored.observations(), strict=True):
        dumped = json.loads(kept.model_dump_json(exclude_none=True))
        by_target = {reading["target"]: reading for reading in dumped.pop("readings")}
        assert by_target == {reading["target"]: reading for reading in given_["readings"]}
        assert dumped == {k: v for k, v in given_.items() if k != "readings"}


@pytest.mark.parametrize("length", ["m", "mm"])
@pytest.mark.parametrize("angle", ["rad", "deg"])
@pytest.mark.parametrize("force", ["N", "kN", "kgf", "lbf"])
@pytest.mark.parametrize("readings", ["positions", "deflections"])
def test_units_do_not_matter(length, angle, force, readings):
    options = {
        "load": "pull",
        "configurations": 8,
        "seed": 1,
        "moment": 50.0,
        "readings": readings,
        "sigma": 1e-6,
    }
    expected = estimate(*prepare(simulate_campaign(default_arm(), **options)))
    units = {"length": length, "angle": angle, "force": force, "moment": "N.mm"}
    found = estimate(*prepare(simulate_campaign(default_arm(), **options, units=units)))
    # Readings are rounded in their own unit when the campaign is written, to a hundredth of sigma.
    np.testing.assert_allclose(found.compliance, expected.compliance, rtol=1e-3)
    assert found.sigma == pytest.approx(expected.sigma)


def read_again(document, *, remains=0.0, rows=4):
    """Return a campaign whose first rows were read again after unloading, with a part of the deflection."""
    again = json.loads(json.dumps(document))
    for observation in again["measurement_set"]["observations"][:rows]:
        for reading in observation["readings"]:
            unloaded, loaded = np.array(reading["unloaded"]), np.array(reading["loaded"])
            reading["unloaded_after"] = (unloaded + remains * (loaded - unloaded)).tolist()
    return again


def test_positions_after_unloading_are_stored_and_returned_as_posted():
    posted = read_again(simulate_campaign(ARM, configurations=6, seed=3), remains=0.1)
    measured_set = MeasurementSetDocument.model_validate(posted["measurement_set"])
    stored = ReadingArrays.unpack(ReadingArrays.from_observations(measured_set.observations).pack())
    assert [each.model_dump() for each in stored.observations()] == [
        each.model_dump() for each in measured_set.observations
    ]


def test_the_deflection_counts_from_the_mean_of_both_unloaded_positions():
    plain = simulate_campaign(ARM, configurations=12, seed=3, sigma=0.0)
    posted = read_again(plain, remains=0.1, rows=12)
    first, again = prepare(plain)[1], prepare(posted)[1]
    np.testing.assert_allclose(again.deflection, 0.95 * first.deflection, atol=1e-12)
    np.testing.assert_allclose(again.returned.remaining, 0.1 * first.deflection, atol=1e-12)


def test_positions_after_unloading_turn_with_the_tracker_frame():
    document = simulate_campaign(ARM, configurations=12, seed=3, load="pull")
    posted = read_again(document, remains=0.1, rows=12)
    R = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    R = R * np.linalg.det(R)
    turned = json.loads(json.dumps(posted))
    for observation in turned["measurement_set"]["observations"]:
        for reading in observation["readings"]:
            for state in ("unloaded", "loaded", "unloaded_after"):
                reading[state] = (R.T @ (np.array(reading[state]) - np.array([1.0, 2.0, 3.0]))).tolist()
    frame = {"rotation": R.tolist(), "translation": [1.0, 2.0, 3.0]}
    first, found = (
        identify(each, elasticity="joints").result for each in (posted, measured(turned, frame=frame))
    )
    assert [reason.code for reason in found.assessment.reasons] == ["deflection_remains"]
    for one, other in zip(first.joints, found.joints, strict=True):
        assert other.compliance == pytest.approx(one.compliance, rel=1e-6)


@pytest.mark.parametrize("fields", [{"unloaded": (0, 0, 1)}, {"deflection": (0, 0, 1)}, {"unloaded": None}])
def test_a_position_after_unloading_needs_both_other_positions(fields):
    with pytest.raises(ValidationError, match=r"unloaded_after|needs `unloaded` and `loaded`"):
        Reading(target="tip", unloaded_after=(0.0, 0.0, 1.0), **fields)


def test_observations_keep_their_numbers_if_others_are_left_out():
    """A drift grows with the order of reading, which leaving out does not change."""
    campaign = Campaign.model_validate(simulate_campaign(default_arm(), configurations=8, seed=1))
    robot, inputs = prepare_robot(campaign.robot), InMemoryInputs()
    inputs.add_robot(robot)
    set_id = inputs.add_set(campaign.measurement_set, robot)
    labels = inputs.measured(set_id, "set").measurements.labels
    shorter = inputs.measured(set_id, "set", labels[2:5]).measurements
    assert shorter.order.tolist() == [0.0, 1.0, 5.0, 6.0, 7.0]


@pytest.mark.parametrize(
    ("noise", "in_fit", "is_assumed", "doubtful"),
    [
        ({"sigma": 2e-2}, 0.01, True, None),  # nothing is stated: today's assumption
        ({"load_point": 0.1}, 0.01, True, 1e-4),
        ({"load_point": 25.0}, 0.025, False, None),
        ({"grounds": {"load_point": "tracker"}}, 1e-3, False, None),
        ({"load_point": 0.1, "grounds": {"load_point": "tracker"}}, 1e-3, False, None),
        ({"load_point": 2.0, "grounds": {"load_point": "tracker"}}, 2e-3, False, None),
        ({"load_point": 0.1, "grounds": {"load_point": "drawing"}}, 3e-3, False, None),
        ({"load_point": 0.1, "grounds": {"load_point": "hand"}}, 0.01, False, 1e-4),
    ],
)
def test_a_load_point_counts_with_at_least_the_uncertainty_of_its_ground(noise, in_fit, is_assumed, doubtful):
    common = to_common_uncertainty(Noise.model_validate(noise), 1e-3)
    assert common.load_point == pytest.approx(in_fit)
    assert ("load_point" in common.assumed) == is_assumed
    assert common.doubtful_load_point == (None if doubtful is None else pytest.approx(doubtful))


@pytest.mark.parametrize(
    ("noise", "scale", "zero", "is_assumed"),
    [
        ({"sigma": 2e-2}, 0.01, 0.0, True),  # nothing is stated: today's assumption
        ({"grounds": {"load_point": "hand"}}, 0.01, 0.0, True),
        ({"force": {"scale": 0.002}}, 0.002, 0.0, False),
        ({"grounds": {"force": "scales"}}, 0.01, 0.0, True),
        ({"force": {"scale": 0.002}, "grounds": {"force": "scales"}}, 0.002, 0.0, False),
        ({"force": {"scale": 0.002}, "grounds": {"force": "cell"}}, 0.002, 60.0 / 3.0**0.5, False),
        ({"grounds": {"force": "cell", "tared": False}}, 0.01, 60.0 / 3.0**0.5, True),
        ({"grounds": {"force": "cell", "tared": True}}, 0.01, 2.0, True),
        ({"grounds": {"force": "pulley"}}, 0.03 / 0.95, 0.0, False),
        (
            {"force": {"scale": 0.04}, "grounds": {"force": "pulley"}},
            (0.04**2 + (0.03 / 0.95) ** 2) ** 0.5,
            0.0,
            False,
        ),
        ({"grounds": {"force": "catalogue"}}, 0.03, 0.0, False),
        ({"force": {"scale": 0.002}, "grounds": {"force": "catalogue"}}, 0.03, 0.0, False),
        ({"force": {"scale": 0.05}, "grounds": {"force": "catalogue"}}, 0.05, 0.0, False),
    ],
)
def test_a_force_counts_with_the_uncertainty_of_its_ground(noise, scale, zero, is_assumed):
    common = to_common_uncertainty(Noise.model_validate(noise), 1e-3)
    assert (common.scale, common.rope_zero) == pytest.approx((scale, zero))
    assert ("force_scale" in common.assumed) == is_assumed


def test_the_force_at_the_hook_is_smaller_than_that_beyond_a_pulley():
    document = simulate_campaign(default_arm(), configurations=8, seed=1, load="pull")
    robot = prepare_robot(RobotDocument.model_validate(document["robot"])).robot

    def forces(**grounds):
        document["measurement_set"]["noise"]["grounds"] = grounds
        measured = MeasurementSetDocument.model_validate(document["measurement_set"])
        readings = ReadingArrays.from_observations(measured.observations)
        return to_measurements(measured, readings, robot).force

    assert forces(force="pulley") == pytest.approx(0.95 * forces(), rel=1e-12)
    assert (forces(force="scales") == forces()).all()


@pytest.mark.parametrize("between", ["payload_declared", "gravity_compensated"])
def test_readings_of_a_load_that_the_controller_knew_of_are_refused(between):
    document = simulate_campaign(default_arm(), configurations=8, seed=1)
    document["measurement_set"]["noise"]["grounds"] = {"between": between}
    said = refused(identify, document)
    assert said.startswith("noise.grounds.between | ") or "measurement_set.noise.grounds.between | " in said
    assert "wrong by a quarter" in said
    assert said.endswith("and state `between` as `still`")


def test_a_ground_that_is_not_stated_changes_no_hash():
    """Sets were hashed before these fields existed."""
    campaign = Campaign.model_validate(simulate_campaign(default_arm(), configurations=8, seed=1))
    header, readings = (
        campaign.measurement_set,
        ReadingArrays.from_observations(campaign.measurement_set.observations),
    )

    def content(**grounds):
        noise = Noise.model_validate({"sigma": 2e-5, "grounds": {"load_point": "tracker"} | grounds})
        return compute_content_hash(header.model_copy(update={"noise": noise}), readings)

    assert content() == HASH_BEFORE
    for stated in ({"between": "still"}, {"force": "scales"}, {"force": "cell"}):
        assert content(**stated) != content()
    assert content(force="cell", tared=False) != content(force="cell")
    named = header.model_copy(update={"load_point_target": "hook"})
    assert compute_content_hash(named, readings) != compute_content_hash(header, readings)
