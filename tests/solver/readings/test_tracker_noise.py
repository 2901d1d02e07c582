"""What readings are worth: the tracker's sheet against geometry done by hand, and against many campaigns."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import ARM, METHODS, SIGMA, estimate, prepare
from support.springs import SpringCampaign, robot_of

from jointstiff.schemas.measurement import MeasurementSetDocument
from jointstiff.service.conversion.readings import ReadingArrays, content_hash
from jointstiff.simulator import simulate_campaign
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.readings.measurements import EncoderReadings
from jointstiff.solver.readings.tracker_noise import DifferenceNoise, Instrument, refuse_no_covariance

STATION = (3.5, -2.0, 0.8)
SHEET = {
    "range": {"constant": 3e-6, "per_distance": 1e-6},
    "transverse": {"constant": 2e-5, "per_distance": 2e-5},
}
TRACKER = {"instrument": {"station": list(STATION), **SHEET}}


def campaign(noise, **options):
    document = simulate_campaign(ARM, load="pull", seed=4, **options)
    document["measurement_set"]["noise"] = noise
    return document


def readings_of(document):
    return [r for o in document["measurement_set"]["observations"] for r in o["readings"]]


def estimate_of(document, **options):
    return estimate(*prepare(document), **options)


def same_estimates(one, other):
    np.testing.assert_allclose(one.compliance, other.compliance, rtol=1e-9)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-9)
    assert one.chi_square == pytest.approx(other.chi_square, rel=1e-9)
    assert one.degrees_of_freedom == pytest.approx(other.degrees_of_freedom)
    for a, b in zip(one.joints, other.joints, strict=True):
        np.testing.assert_allclose(a.compliance_interval, b.compliance_interval, rtol=1e-6)


class TestInstrument:
    @pytest.mark.parametrize(
        ("instrument", "place", "covariance"),
        [
            # Along and across the line of sight, at 5 m and at 10 m.
            (((1, 0, 0), 1e-5, 2e-6, 3e-5, 4e-6), (6, 0, 0), np.diag([2e-5, 5e-5, 5e-5]) ** 2),
            (((1, 0, 0), 1e-5, 2e-6, 3e-5, 4e-6), (1, -10, 0), np.diag([7e-5, 3e-5, 7e-5]) ** 2),
            # In the direction (3, 4, 0)/5, by hand: σ_r = 1, σ_t = 2 give Σ = 4 I − 3 u uᵀ.
            (
                ((0, 0, 0), 1.0, 0.0, 2.0, 0.0),
                (3, 4, 0),
                [[2.92, -1.44, 0.0], [-1.44, 2.08, 0.0], [0.0, 0.0, 4.0]],
            ),
        ],
    )
    def test_covariance_by_hand(self, instrument, place, covariance):
        found = Instrument(*instrument).covariance(np.array([place], dtype=float))
        np.testing.assert_allclose(found[0], covariance, rtol=1e-12, atol=1e-15 * np.max(covariance))

    def test_both_readings_count(self):
        """Isotropic 1 and 2 make a difference of variance 5; sigma is its unit, √(5/2)."""
        unloaded, loaded = np.eye(3)[None, None], 4.0 * np.eye(3)[None, None]
        noise = DifferenceNoise.of(unloaded, loaded, np.full((1, 1), 3))
        assert noise.sigma == pytest.approx(np.sqrt(2.5))
        np.testing.assert_allclose(noise.sigma**2 * noise.covariance[0, 0], 5.0 * np.eye(3))

    @pytest.mark.parametrize(
        ("instrument", "reason"),
        [
            (((0.0, 0.001, 0.0), 1e-5, 0.0, 1e-5, 0.0), "from the tracker"),
            ((STATION, 1e-5, 0.0, 1e-16, 0.0), "implausible"),
            ((STATION, 1e2, 0.0, 1e-6, 0.0), "implausible"),
        ],
    )
    def test_impossible_sheets_and_places_are_refused(self, instrument, reason):
        with pytest.raises(MeasurementError, match=reason):
            Instrument(*instrument).covariance(np.zeros((1, 3)))

    @pytest.mark.parametrize(
        "matrix", [np.diag([1.0, 1.0, -1.0]), np.diag([1.0, 1.0, 0.0]), np.eye(3) + np.eye(3, k=1) * 0.1]
    )
    def test_matrices_that_are_no_covariance(self, matrix):
        covariance = np.broadcast_to(np.eye(3), (2, 2, 3, 3)).copy()
        covariance[1, 1] = matrix
        present = np.array([[True, True], [False, True]])
        with pytest.raises(MeasurementError) as caught:
            refuse_no_covariance(covariance, present, "loaded_covariance")
        assert caught.value.where == "observations[1].readings[0].loaded_covariance"
        present[1, 1] = False
        refuse_no_covariance(covariance, present, "loaded_covariance")


class TestKindsAgree:
    """The same noise said in three ways is one noise, in every method and unit."""

    @pytest.mark.parametrize("method", METHODS)
    @pytest.mark.parametrize("readings", ["positions", "deflections"])
    def test_an_isotropic_instrument_equals_sigma(self, method, readings):
        flat = {"constant": SIGMA, "per_distance": 0.0}
        stated = {"instrument": {"station": list(STATION), "range": flat, "transverse": flat}}
        one, other = (
            estimate_of(campaign(noise, readings=readings), method=method)
            for noise in ({"sigma": SIGMA}, stated)
        )
        same_estimates(one, other)

    @pytest.mark.parametrize("matrices", [False, True])
    def test_readings_of_their_own(self, matrices):
        document = campaign(None)
        square = (SIGMA**2 * np.eye(3)).tolist()
        fields = (
            {"unloaded_covariance": square, "loaded_covariance": square} if matrices else {"sigma": SIGMA}
        )
        for reading in readings_of(document):
            reading |= fields
        same_estimates(estimate_of(campaign({"sigma": SIGMA})), estimate_of(document))

    def test_units_do_not_matter(self):
        in_mm = {k: v | {"constant": 1e3 * v["constant"]} for k, v in SHEET.items()}
        in_mm["station"] = [1e3 * x for x in STATION]
        units = {"length": "mm", "angle": "rad", "force": "N"}
        other = estimate_of(campaign({"instrument": in_mm}, units=units))
        same_estimates(estimate_of(campaign(TRACKER)), other)

    def test_equal_per_reading_and_by_instrument(self):
        """Covariances worked out here, reading by reading, are those of the instrument."""
        by_hand = campaign(None)
        for reading in readings_of(by_hand):
            for state in ("unloaded", "loaded"):
                reading[f"{state}_covariance"] = covariance_at(reading[state])
        same_estimates(estimate_of(campaign(TRACKER)), estimate_of(by_hand))

    def test_encoders_weigh_the_same_whatever_the_unit_sigma_is(self):
        """Their rows are weighted against the targets' in absolute terms."""
        robot, measured = prepare(campaign(TRACKER))
        generator = np.random.default_rng(8)
        present = np.zeros((len(measured), 6), dtype=bool)
        present[:, 1:3] = True
        read = np.where(present, 1e-4 * generator.standard_normal(present.shape), 0.0)
        one = replace(measured, encoders=EncoderReadings(read, present, 5e-6))
        other = replace(one, sigma=1.0, covariance=measured.sigma**2 * measured.covariance)
        same_estimates(estimate(robot, one), estimate(robot, other))


def covariance_at(place):
    """By rotation into the line of sight, unlike the projection under test."""
    sight = np.subtract(place, STATION)
    d = np.linalg.norm(sight)
    axes = np.linalg.qr(np.column_stack([sight, np.eye(3)[:, :2]]))[0]
    r, t = (SHEET[k]["constant"] + SHEET[k]["per_distance"] * d for k in ("range", "transverse"))
    matrix = axes @ np.diag([r**2, t**2, t**2]) @ axes.T
    return (0.5 * (matrix + matrix.T)).tolist()


class TestKindsExclude:
    @pytest.mark.parametrize(
        "noise",
        [
            {},
            {"sigma": 2e-5, "instrument": {"station": [0, 0, 0], **SHEET}},
            {"instrument": {"station": [0, 0, 0], **SHEET, "range": {"constant": 0.0, "per_distance": 0.0}}},
        ],
    )
    def test_of_the_set(self, noise):
        with pytest.raises(ValueError, match="give"):
            prepare(campaign(noise))

    def test_of_a_reading(self):
        document = campaign(None)
        reading = readings_of(document)[0]
        reading["unloaded_covariance"] = np.eye(3).tolist()
        with pytest.raises(ValueError, match="give both"):
            prepare(document)
        reading["loaded_covariance"], reading["sigma"] = np.eye(3).tolist(), 1e-5
        with pytest.raises(ValueError, match="not both"):
            prepare(document)

    @pytest.mark.parametrize(
        ("noise", "where"), [({"sigma": 2e-5}, "noise.sigma"), (None, "observations[3].readings")]
    )
    def test_of_set_and_some_readings(self, noise, where):
        document = with_own_sigma(campaign(noise))
        if noise is None:
            del document["measurement_set"]["observations"][3]["readings"][1]["sigma"]
        with pytest.raises(MeasurementError) as caught:
            prepare(document)
        assert caught.value.where == where


def with_own_sigma(document):
    for observation in document["measurement_set"]["observations"]:
        for k, reading in enumerate(observation["readings"]):
            reading["sigma"] = (1 + k) * 1e-5
    return document


class TestStored:
    def packed(self, document):
        stored = MeasurementSetDocument.model_validate_json(json.dumps(document["measurement_set"]))
        return stored, ReadingArrays.from_observations(stored.observations)

    @pytest.mark.parametrize("matrices", [False, True])
    def test_noise_of_readings_comes_back_as_it_was_posted(self, matrices):
        document = with_own_sigma(campaign(None, configurations=3))
        if matrices:
            reading = document["measurement_set"]["observations"][1]["readings"][2]
            del reading["sigma"]
            reading["unloaded_covariance"] = covariance_at(reading["unloaded"])
            reading["loaded_covariance"] = covariance_at(reading["loaded"])
        stored, readings = self.packed(document)
        back = ReadingArrays.unpack(readings.pack())
        assert back.observations() == stored.observations
        assert back.digest() == readings.digest()

    def test_hashes_tell_noises_apart(self):
        documents = [
            campaign({"sigma": 2e-5}),
            campaign(None),
            campaign({"instrument": {"station": [0, 0, 0], **SHEET}}),
            campaign({"instrument": {"station": [0, 0, 1], **SHEET}}),
            with_own_sigma(campaign(None)),
        ]
        assert len({content_hash(*self.packed(document)) for document in documents}) == len(documents)


@pytest.fixture(scope="module")
def replicated():
    """One design measured 150 times by a tracker that is worse across its line of sight than along it."""
    springs = SpringCampaign.of(ARM, configurations=15, seed=11)
    states = np.stack([springs.unloaded, springs.loaded])
    covariance = np.array([[[covariance_at(p) for p in row] for row in state] for state in states])
    root = np.linalg.cholesky(covariance)
    noise = DifferenceNoise.of(*covariance, np.full(states.shape[1:3], 3))
    generator = np.random.default_rng(12)
    sets = []
    for _ in range(150):
        read = states + (root @ generator.standard_normal((*states.shape, 1)))[..., 0]
        measurements = springs.measurements(*read, sigma=noise.sigma)
        sets.append(replace(measurements, covariance=noise.covariance))
    return robot_of(ARM), sets


def identified(robot, sets, **options):
    options |= {"positive": False, "complementary_stiffness": "included"}
    return [estimate(robot, measurements, **options) for measurements in sets]


def test_coverage_and_efficiency_with_anisotropic_noise(replicated):
    """Intervals cover as they say, χ² is that of the stated noise, and equal weights are worse."""
    robot, sets = replicated
    truth = ARM.compliances
    found = identified(robot, sets)
    compliance = np.array([e.compliance for e in found])
    bounds = np.array([[joint.compliance_interval for joint in e.joints] for e in found])
    covered = (bounds[..., 0] <= truth) & (truth <= bounds[..., 1])
    # 900 intervals of 95 %, standard error of the share 0.7 % if independent: 90 % is seen by 99 % power.
    assert 0.93 < covered.mean() < 0.97
    ratio = np.mean([e.chi_square / e.degrees_of_freedom for e in found])
    assert ratio == pytest.approx(1.0, abs=0.02)
    stated = np.sqrt(np.diag(found[0].covariance))
    np.testing.assert_allclose(compliance.std(axis=0), stated, rtol=0.15)
    isotropic = [replace(m, covariance=2.0 * np.eye(3)) for m in sets]
    worse = np.array([e.compliance for e in identified(robot, isotropic)])
    assert (worse.std(axis=0) > 1.1 * compliance.std(axis=0)).sum() >= 4
    assert (worse.std(axis=0) > 0.98 * compliance.std(axis=0)).all()


def test_decoupled_covariance_with_anisotropic_noise(replicated):
    robot, sets = replicated
    found = identified(robot, sets[:75], method="decoupled_partial_pose")
    spread = np.array([e.compliance for e in found]).std(axis=0)
    np.testing.assert_allclose(spread, np.sqrt(np.diag(found[0].covariance)), rtol=0.25)
