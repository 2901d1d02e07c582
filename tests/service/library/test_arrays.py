"""Campaigns of arrays: what is taken over as it is, and what each refusal says."""

import numpy as np
import pytest
from support.documents import campaign

import jointstiff as js
from jointstiff.simulator import TARGETS, default_arm, simulate_campaign

UNITS = {"length": "mm", "angle": "deg", "force": "kN", "moment": "N.mm"}
DOCUMENT = campaign(configurations=6, units=UNITS)
ROWS = DOCUMENT["measurement_set"]["observations"]


ENCODERS = {"encoders": "motor"}


def column(name):
    return np.array([one[name] for one in ROWS], dtype=float)


def read(state):
    return np.array([[r[state] for r in one["readings"]] for one in ROWS], dtype=float)


MOVED = read("loaded") - read("unloaded")
FREE = {"unloaded": None, "loaded": None, "deflections": MOVED}


def of_arrays(**changes):
    arrays = {
        "robot": DOCUMENT["robot"],
        "joints": column("joints"),
        "forces": column("force"),
        "moments": column("moment"),
        "unloaded": read("unloaded"),
        "loaded": read("loaded"),
        "targets": list(TARGETS),
        "load_point": DOCUMENT["measurement_set"]["load_point"],
        "sigma": 0.02,
        "units": "mm, deg, kN, N·mm",
    }
    stated = {key: value for key, value in (arrays | changes).items() if value is not None}
    return js.Campaign.from_arrays(**stated).measurement_set


def test_numbers_are_those_of_the_arrays_in_the_units_that_are_stated():
    found = of_arrays()
    assert (found.name, found.units.model_dump(mode="json")) == ("readings from arrays", UNITS)
    assert (found.noise.sigma, tuple(found.load_point), found.flange_targets) == (0.02, (-60, 20, 180), {})
    assert [each.label for each in found.observations] == [f"c{i:02}" for i in range(1, 7)]
    for one, row in zip(found.observations, ROWS, strict=True):
        assert list(one.joints) == row["joints"]
        assert (list(one.force), list(one.moment)) == (row["force"], [0.0, 0.0, 0.0])
        for reading, stated in zip(one.readings, row["readings"], strict=True):
            assert reading.target == stated["target"]
            assert list(reading.unloaded) == stated["unloaded"]
            assert list(reading.loaded) == stated["loaded"]


def test_what_is_not_stated_is_left_out_and_one_row_stands_for_all():
    assert of_arrays(units="mm, deg, kN").units.model_dump(mode="json", exclude_none=True) == {
        "length": "mm",
        "angle": "deg",
        "force": "kN",
    }
    assert {each.moment for each in of_arrays(moments=None).observations} <= {None, (0.0, 0.0, 0.0)}
    assert "moment" not in of_arrays(moments=None).observations[0].model_fields_set
    assert [each.force for each in of_arrays(forces=[0, 0, 1]).observations] == [(0.0, 0.0, 1.0)] * 6
    assert [each.label for each in of_arrays(labels=list("abcdef")).observations] == list("abcdef")
    zero = of_arrays(load_point=np.zeros((6, 3)))
    assert tuple(zero.load_point) == (0.0, 0.0, 0.0)
    flat = of_arrays(loaded=read("loaded").reshape(6, -1))
    assert flat.observations == of_arrays().observations


def test_deflections_stand_at_the_places_of_their_targets():
    found = of_arrays(**FREE, targets={name: np.array(place) * 1e3 for name, place in TARGETS.items()})
    assert found.flange_targets["P11"] == pytest.approx((-128.0, 84.0, 85.0))
    reading = found.observations[0].readings[0]
    assert (reading.unloaded, reading.loaded) == (None, None)
    assert reading.deflection == pytest.approx([-0.0469, 2.8761, -0.0979], rel=1e-3)


KNOWN = (
    "length m, mm; angle rad, deg; force N, kN, kgf, lbf, kg; moment N.m, N.mm, kN.m, kgf.m, lbf.m, lbf.ft, "
    "lbf.in"
)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"units": "mm"},
            "units: the unit of angle is missing; remedy: use one unit for each quantity, as in "
            f"'mm, deg, N': {KNOWN}",
        ),
        (
            {"targets": ["P10"]},
            "`unloaded` has the shape (6, 3, 3), not (6, 1, 3), observation by target; remedy: give "
            "`unloaded` in the shape (6, 1, 3), observation by target",
        ),
        (
            {"joints": column("joints")[:, :5]},
            "measurement_set.observations[0].joints: observation 'c01': there are 5 joint angles, but the "
            "robot has 6 joints; remedy: give the 6 controller angles of joint_1, joint_2, joint_3, joint_4, "
            "joint_5, joint_6",
        ),
        (
            {"forces": column("force")[:3]},
            "`forces` has the shape (3, 3), not (3,) or (6, 3); remedy: give `forces` in the "
            "shape (3,) or (6, 3)",
        ),
        (
            {"forces": [0, 0, np.nan]},
            "forces[0]: `forces` lacks numbers in row 1; remedy: give these numbers, or leave out such rows "
            "of all arrays",
        ),
        (
            {"sigma": -1},
            "`sigma` is -1, but must be a positive number; remedy: give the standard uncertainty of one "
            "coordinate, such as 0.02 in mm, or leave it out: it is then estimated from the residuals",
        ),
        (
            {"labels": ["a"]},
            "`labels` has the shape (1,), not (6,); remedy: give `labels` in the shape (6,)",
        ),
        (
            {"unloaded": None},
            "unloaded: `loaded` and `forces` and `moments` alone cannot be used as readings and their load; "
            "remedy: give `unloaded` and `loaded`, or `deflections`, with `forces` or `moments`; give "
            "`unloaded` alone, without forces, only to identify by the own weight",
        ),
        (
            FREE,
            "measurement_set.observations[0].readings: observation 'c01': target 'P10' has a deflection but "
            "no position in the flange frame; remedy: add 'P10' to `flange_targets`, in the flange frame",
        ),
        (
            {"load_point": None},
            "measurement_set.observations[0].load_point: observation 'c01': the load point is missing; "
            "remedy: give `load_point`, in the flange frame, for the set or for each observation",
        ),
        (
            {"unloaded": read("unloaded") * np.nan},
            "unloaded: all readings are NaN; remedy: write NaN only where a target was not read",
        ),
        (
            {"joints": "x"},
            "`joints` is not an array of numbers: could not convert string to float: 'x'; remedy: give an "
            "array of numbers, or lists of equal lengths",
        ),
        (
            {"joints": np.zeros((0, 6))},
            "`joints` has the shape (0, 6), not (N, n), a row for each observation; remedy: give `joints` in "
            "the shape (N, n), a row for each observation",
        ),
    ],
)
def test_what_does_not_fit_is_said_with_its_remedy(changes, said):
    with pytest.raises(js.CampaignError) as caught:
        of_arrays(**changes)
    assert str(caught.value) == said


@pytest.mark.parametrize("missing", [None, np.nan, [None, None, None]])
def test_a_missing_value_in_place_of_a_reading_is_a_target_that_was_not_read(missing):
    of_nan = read("loaded")
    of_nan[2, 1] = np.nan
    loaded = read("loaded").tolist()
    loaded[2][1] = missing
    assert of_arrays(loaded=loaded) == of_arrays(loaded=of_nan)
    by_target = {name: [row[t] for row in loaded] for t, name in enumerate(TARGETS)}
    assert of_arrays(loaded=by_target) == of_arrays(loaded=of_nan)
    of_nan[2] = np.nan
    loaded[2] = missing
    assert of_arrays(loaded=loaded) == of_arrays(loaded=of_nan)


@pytest.mark.parametrize("wrong", [7.5, [7.5, 1.0], []])
def test_a_reading_of_another_shape_is_refused(wrong):
    loaded = read("loaded").tolist()
    loaded[2][1] = wrong
    with pytest.raises(
        js.CampaignError, match=r"`loaded` is not an array of numbers: .* inhomogeneous shape"
    ):
        of_arrays(loaded=loaded)


@pytest.mark.parametrize(
    "wrong", [np.ones((6, 6), dtype=bool), np.ones((6, 6), dtype=np.float16), np.ones((6, 6)) * 1j]
)
def test_values_that_are_no_numbers_of_enough_digits_are_refused(wrong):
    with pytest.raises(js.CampaignError, match=f"`joints` .*{wrong.dtype}"):
        of_arrays(joints=wrong)


def test_the_run_refuses_a_load_point_in_another_unit():
    document = simulate_campaign(default_arm(), load="pull", configurations=8, seed=1)
    document["measurement_set"]["load_point"] = [
        1e3 * each for each in document["measurement_set"]["load_point"]
    ]
    (reason, *_) = js.identify(document).result.assessment.reasons
    assert (reason.code, reason.weight) == ("length_unit_suspect", "do_not_use")


def test_positions_after_unloading_reach_the_run_and_may_be_missing():
    after = read("unloaded")
    after[2:] = np.nan
    found = of_arrays(unloaded_after=after)
    stated = [[r.unloaded_after is not None for r in one.readings] for one in found.observations]
    assert stated == [[i < 2] * len(TARGETS) for i in range(6)]
    with pytest.raises(js.CampaignError, match="alone cannot be used as readings"):
        of_arrays(unloaded=None, loaded=None, deflections=MOVED, unloaded_after=after, targets=dict(TARGETS))


@pytest.mark.parametrize(
    ("stated", "assumed"), [({}, "motor encoders, load point"), (ENCODERS, "load point")]
)
def test_a_run_says_once_that_motor_encoders_were_assumed(stated, assumed):
    document = simulate_campaign(default_arm(), load="pull", configurations=8, seed=1)
    measured = document["measurement_set"]
    rows = measured["observations"]
    campaign = js.Campaign.from_arrays(
        document["robot"],
        [row["joints"] for row in rows],
        [row["force"] for row in rows],
        unloaded=[[reading["unloaded"] for reading in row["readings"]] for row in rows],
        loaded=[[reading["loaded"] for reading in row["readings"]] for row in rows],
        load_point=measured["load_point"],
        units="m, rad, N",
        **stated,
    )
    run = js.identify(campaign)
    assert run.summary().count("encoders") == len(ENCODERS) - len(stated)
    assert f"assumed: {assumed} ± 10 mm" in run.summary()
    assert ("assumed: motor encoders" in run.details()) == (not stated)


def test_an_array_of_many_axes_or_of_no_observation_is_refused_at_once():
    """Twelve axes have 479 million orders."""
    stated = {"robot": "KUKA KR 6 R900 sixx", "encoders": "motor", "load_point": (0, 0, 120)}
    for unloaded in (np.zeros((1,) * 12), np.zeros((0, 3)), np.zeros((7, 2)), 5.0):
        with pytest.raises(js.CampaignError, match=r"`unloaded` has the shape .* not \(4, "):
            js.Campaign.from_arrays(
                **stated, joints=np.zeros((4, 6)), unloaded=unloaded, loaded=unloaded, forces=(0, 0, -500)
            )
