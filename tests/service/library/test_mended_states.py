"""Mistakes of one state, of some rows and of the loads: the cause is named, and its remedy works."""

import numpy as np
import pytest

import jointstiff as js
from jointstiff.service.library.robots import prepare_once, robot
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.mechanics.postures import Postures

LOAD_POINT = (0.05, 0.02, 0.12)


@pytest.fixture(scope="module")
def document():
    return simulate_campaign(default_arm(), load="pull", configurations=14, seed=3)


@pytest.fixture(scope="module")
def arrays(document):
    observations = document["measurement_set"]["observations"]
    read = [[[r["unloaded"], r["loaded"]] for r in each["readings"]] for each in observations]
    positions = np.array(read)
    return {
        "joints": np.array([each["joints"] for each in observations]),
        "forces": np.array([each["force"] for each in observations]),
        "unloaded": positions[:, :, 0],
        "loaded": positions[:, :, 1],
        "load_point": document["measurement_set"]["load_point"],
        "units": "m, rad, N",
    }


@pytest.fixture(scope="module")
def flange(document, arrays):
    """Return rotation (N, 3, 3) and place (N, 3) of the flange in R0, and the hook (N, 3) in R0."""
    model = prepare_once(robot(document["robot"])).robot
    postures = Postures(model, model.joint_map.model_angles(arrays["joints"]))
    rotation, place = postures.flange_rotation, postures.flange_translation
    return rotation, place + rotation @ arrays["load_point"]


def answer(document, arrays, **changes):
    """Return the first reason of a run, or of its refusal, with its remedy."""
    try:
        run = js.identify(js.Campaign.from_arrays(document["robot"], **(arrays | changes)))
    except js.CampaignError as error:
        return str(error)
    (reason, *_) = run.result.assessment.reasons
    return f"{reason.message}; remedy: {reason.remedy}"


def is_used(document, arrays, **changes):
    run = js.identify(js.Campaign.from_arrays(document["robot"], **(arrays | changes)))
    return run.result.assessment.verdict == "use"


def test_the_right_campaign_is_used(document, arrays):
    assert is_used(document, arrays)


@pytest.mark.parametrize("state", ["unloaded", "loaded"])
@pytest.mark.parametrize(
    ("factor", "words"), [(1000, "in m"), (100, "in m"), (10, "in cm"), (25.4, "in inch")]
)
def test_another_unit_of_one_state_is_named_and_multiplied(document, arrays, state, factor, words):
    given = arrays[state] / factor
    found = answer(document, arrays, **{state: given})
    assert f"all {state} readings disagree with the others" in found
    assert f"they seem to be {words} where the others are in " in found
    assert f"remedy: convert all {state} readings from " in found
    assert f": multiply them by {factor}" in found
    assert is_used(document, arrays, **{state: factor * given})


@pytest.mark.parametrize("state", ["unloaded", "loaded"])
def test_smaller_units_of_one_state_are_divided(document, arrays, state):
    given = 10.0 * arrays[state]
    found = answer(document, arrays, **{state: given})
    assert f"remedy: convert all {state} readings from mm to cm: multiply them by 0.1" in found
    assert is_used(document, arrays, **{state: given / 10.0})


@pytest.mark.parametrize("state", ["unloaded", "loaded"])
@pytest.mark.parametrize(
    ("order", "signs", "back"),
    [
        ((0, 2, 1), (1, 1, 1), "x, z, y"),
        ((0, 1, 2), (1, 1, -1), "x, y, −z"),
        ((1, 2, 0), (1, 1, 1), "z, x, y"),
    ],
)
def test_axes_of_one_state_are_exchanged_back_in_this_state_alone(
    document, arrays, state, order, signs, back
):
    given = arrays[state][..., list(order)] * signs
    found = answer(document, arrays, **{state: given})
    assert found.startswith(f"all {state} readings disagree with the others")
    assert f"give {back} of all {state} readings as x, y, z, and leave the others as they are" in found
    taken = np.stack(
        [(-1 if "−" in name else 1) * given[..., "xyz".index(name[-1])] for name in back.split(", ")],
        axis=-1,
    )
    assert is_used(document, arrays, **{state: taken})


@pytest.mark.parametrize("states", [("loaded",), ("unloaded",), ("unloaded", "loaded")])
@pytest.mark.parametrize("places", [[(4, 1)], [(4, 1), (5, 1), (6, 1), (9, 0)], [(4, 0), (4, 1), (4, 2)]])
def test_zeros_of_a_missed_reading_are_named_and_left_out(document, arrays, states, places):
    given = {state: arrays[state].copy() for state in ("unloaded", "loaded")}
    for row, target in places:
        for state in states:
            given[state][row, target] = 0.0
    found = answer(document, arrays, **given)
    assert "are 0, 0, 0, as instruments store a point that they did not read" in found
    assert f"the {' and '.join(states)} readings of " in found
    assert "in an array give NaN" in found
    for row, target in places:
        for state in ("unloaded", "loaded"):
            given[state][row, target] = np.nan
    kept = np.isfinite(given["loaded"]).any(axis=(1, 2))
    rest = {name: (given | arrays)[name][kept] for name in ("joints", "forces")}
    assert is_used(document, arrays, **rest, **{name: each[kept] for name, each in given.items()})


@pytest.mark.parametrize("rows", [slice(8, None), slice(1, 2), slice(3, None), slice(None, None, 2)])
def test_rows_of_angles_in_another_unit_are_named_and_converted(document, arrays, rows):
    given = arrays["joints"].copy()
    given[rows] = np.degrees(given[rows])
    found = answer(document, arrays, joints=given)
    count = len(given[rows])
    assert found.startswith(f"the angles of {count} of 14 observations ('c")
    assert "seem to be in deg, and those of all others in rad" in found
    assert found.endswith("correct these observations alone: all angles taken as degrees")
    given[rows] = np.radians(given[rows])
    assert is_used(document, arrays, joints=given)


def test_rows_of_readings_in_another_unit_are_named(document, arrays):
    given = {state: arrays[state].copy() for state in ("unloaded", "loaded")}
    for each in given.values():
        each[5:8] /= 25.4
    found = answer(document, arrays, **given)
    assert "in 3 of 14 observations ('c06' to 'c08'), the lengths seem to be in inch" in found


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("is_turned_twice", [False, True])
def test_forces_in_the_axes_of_the_flange_are_turned_to_r0(document, arrays, flange, is_turned_twice, sign):
    rotation, _ = flange
    to_given = rotation if is_turned_twice else rotation.transpose(0, 2, 1)
    given = sign * np.einsum("nij,nj->ni", to_given, arrays["forces"])
    found = answer(document, arrays, forces=given)
    cause = "the forces are in the axes of"
    if is_turned_twice:
        cause = "the forces seem to be turned the wrong way"
    assert found.startswith(cause)
    assert ("and change the sign of every force" in found) == (sign < 0.0)
    back = rotation if not is_turned_twice else rotation.transpose(0, 2, 1)
    assert is_used(document, arrays, forces=sign * np.einsum("nij,nj->ni", back, given))


@pytest.mark.parametrize("noise", [0.0, 0.002])
@pytest.mark.parametrize("origin", ["R0", "the flange frame"])
def test_moments_of_the_forces_about_an_origin_are_left_out(document, arrays, flange, origin, noise):
    rotation, hook = flange
    point = hook if origin == "R0" else rotation @ np.array(arrays["load_point"])
    moments = np.cross(point, arrays["forces"])
    moments += noise * np.abs(moments).max() * np.random.default_rng(1).uniform(-1, 1, moments.shape)
    found = answer(document, arrays, moments=moments)
    assert found.startswith(f"the moments are about the origin of {origin}, not about the load point")
    assert "here they are zero, so leave out the moments" in found


def test_no_absurd_cause_is_named(document, arrays, flange):
    """Moments that nothing explains would need a force of hundreds of kilonewtons in the rope."""
    moments = np.cross(flange[1], arrays["forces"])
    moments += 200.0 * np.random.default_rng(1).standard_normal(moments.shape)
    found = answer(document, arrays, moments=moments)
    assert "along the rope" not in found
    assert "every load point moved" not in found


def test_places_of_the_hook_in_r0_are_no_load_points(document, arrays, flange):
    found = answer(document, arrays, load_point=flange[1])
    assert found.startswith("the load points are places in R0, not in the flange frame")
    place = found.partition("give the load point in the flange frame: (")[2].partition(")")[0]
    load_point = [1e-3 * float(part) for part in place.split(",")]
    assert load_point == pytest.approx(arrays["load_point"], abs=1e-4)
    assert is_used(document, arrays, load_point=load_point)


def test_one_place_of_the_hook_in_r0_is_recognised(document, arrays, flange):
    found = answer(document, arrays, load_point=flange[1][0])
    assert "the stated load point seems to be a place in R0, that of the hook in 'c01'" in found
    assert "remedy: give the load point in the flange frame, not its place in R0" in found


def test_a_load_point_in_metres_is_named_without_words_of_files(document, arrays):
    given = {name: 1e3 * arrays[name] for name in ("unloaded", "loaded")}
    found = answer(document, arrays, **given, units="mm, rad, N")
    assert "the load points are up to" in found
    assert "units.length" not in found
    assert "multiply them by 1000 if they are in m" in found
    load_point = 1e3 * np.array(arrays["load_point"])
    assert is_used(document, arrays, **given, units="mm, rad, N", load_point=load_point)


def test_all_rows_with_exchanged_states_are_listed(document, arrays):
    unloaded, loaded = arrays["unloaded"].copy(), arrays["loaded"].copy()
    unloaded[9:], loaded[9:] = arrays["loaded"][9:], arrays["unloaded"][9:]
    run = js.identify(
        js.Campaign.from_arrays(document["robot"], **(arrays | {"unloaded": unloaded, "loaded": loaded}))
    )
    assert "(and 4 more of this kind: 'c11', 'c12', 'c13', 'c14')" in " ".join(str(run.details()).split())
    assert "typing error" not in str(run)
