"""Data frames as arguments: columns and rows are matched by their names, or refused with the name."""

import numpy as np
import pandas
import polars
import pyarrow
import pytest
from support.documents import campaign

import jointstiff as js
from jointstiff.simulator import TARGETS

DOCUMENT = campaign(configurations=8, units={"length": "mm", "angle": "deg", "force": "N"})
OBSERVATIONS = DOCUMENT["measurement_set"]["observations"]
LABELS = [each["label"] for each in OBSERVATIONS]
NAMES = list(TARGETS)


def positions(state):
    return np.array([[reading[state] for reading in each["readings"]] for each in OBSERVATIONS])


def wide(state):
    columns = [f"{name} {axis}" for name in NAMES for axis in "xyz"]
    return pandas.DataFrame(positions(state).reshape(len(OBSERVATIONS), -1), columns=columns)


JOINTS = pandas.DataFrame(
    [each["joints"] for each in OBSERVATIONS], columns=[f"J{j}" for j in range(1, 7)], dtype=float
)
FORCES = pandas.DataFrame([each["force"] for each in OBSERVATIONS], columns=["Fx", "Fy", "Fz"], dtype=float)
UNLOADED, LOADED = wide("unloaded"), wide("loaded")
FRAMES = {"joints": JOINTS, "forces": FORCES, "unloaded": UNLOADED, "loaded": LOADED}

LIBRARIES = {
    "pandas": lambda frame: frame,
    "polars": lambda frame: polars.DataFrame({name: frame[name].to_numpy() for name in frame.columns}),
    "Arrow": lambda frame: pyarrow.Table.from_pandas(frame, preserve_index=False),
    "records": lambda frame: frame.to_records(index=False),
    "a dictionary": lambda frame: {name: frame[name].to_numpy() for name in frame.columns},
}


def read(**changes):
    arguments = {
        "robot": DOCUMENT["robot"],
        "joints": JOINTS.to_numpy(),
        "forces": FORCES.to_numpy(),
        "unloaded": positions("unloaded"),
        "loaded": positions("loaded"),
        "targets": NAMES,
        "load_point": DOCUMENT["measurement_set"]["load_point"],
    } | changes
    stated = {name: value for name, value in arguments.items() if value is not None}
    return js.Campaign.from_arrays(**stated).measurement_set


def refusal(**changes):
    with pytest.raises(js.CampaignError) as caught:
        read(**changes)
    return str(caught.value)


@pytest.mark.parametrize("convert", LIBRARIES.values(), ids=LIBRARIES)
@pytest.mark.parametrize(
    ("argument", "frame"),
    [
        ("joints", JOINTS[["J3", "J1", "J2", "J6", "J5", "J4"]]),
        (
            "joints",
            JOINTS.set_axis([f"joint_{j}" for j in range(1, 7)], axis=1)[
                [f"joint_{j}" for j in (2, 1, 3, 6, 5, 4)]
            ],
        ),
        (
            "joints",
            JOINTS.set_axis([f"q{j}" for j in range(6)], axis=1)[["q5", "q0", "q1", "q2", "q3", "q4"]],
        ),
        ("joints", JOINTS.set_axis([f"A{j} [deg]" for j in range(1, 7)], axis=1).assign(temperature=21.0)),
        ("forces", FORCES[["Fz", "Fx", "Fy"]]),
        ("forces", FORCES.set_axis(list("xyz"), axis=1)[["y", "x", "z"]]),
        ("unloaded", UNLOADED[UNLOADED.columns[::-1]]),
        ("loaded", LOADED.add_suffix(" loaded")[[f"{name} loaded" for name in LOADED.columns[::-1]]]),
    ],
)
def test_columns_in_another_order_are_matched_by_their_names(argument, frame, convert):
    assert read(**{argument: convert(frame)}) == read()


@pytest.mark.parametrize("convert", LIBRARIES.values(), ids=LIBRARIES)
@pytest.mark.parametrize(
    ("argument", "frame", "fault"),
    [
        (
            "joints",
            JOINTS.rename(columns={"J2": "shoulder"}),
            "the column 'shoulder' of `joints` is not understood",
        ),
        ("joints", JOINTS.assign(x=0.0), "the column 'x' of `joints` is of another quantity (position)"),
        ("joints", JOINTS.drop(columns="J3"), "`joints` has columns with names, but no column of joint_3"),
        ("joints", JOINTS.assign(A2=0.0), "the column 'A2' of `joints` means the same as 'J2'"),
        ("joints", JOINTS.assign(J7=0.0), "the column 'J7' of `joints` is beyond the last, joint_6"),
        (
            "joints",
            JOINTS.add_suffix(" [rad]"),
            "the column 'J1 [rad]' of `joints` is in rad, but `units` states deg for the angle",
        ),
        (
            "forces",
            FORCES.set_axis(["Mx", "My", "Mz"], axis=1),
            "the column 'Mx' of `forces` is of another quantity (moment)",
        ),
        (
            "unloaded",
            LOADED.add_suffix(" loaded"),
            "the column 'P10 x loaded' of `unloaded` has the state 'loaded'",
        ),
        (
            "unloaded",
            UNLOADED.drop(columns="P11 y"),
            "`unloaded` has columns with names, but no column of P11 y",
        ),
    ],
)
def test_columns_that_do_not_match_are_refused_by_name(argument, frame, fault, convert):
    assert refusal(**{argument: convert(frame)}).startswith(fault)


def test_the_remedy_for_unknown_names_works_as_written():
    unknown = JOINTS.set_axis(["base", "shoulder", "elbow", "w1", "w2", "w3"], axis=1)
    text = refusal(joints=unknown)
    assert text.endswith(
        "remedy: name the columns J1 to J6, or joint_1, joint_2, joint_3, joint_4, joint_5, joint_6; "
        "an array without names is used in the order of its columns"
    )
    assert read(joints=unknown.to_numpy()) == read()


def test_numbered_columns_are_used_in_their_order_alone():
    numbered = JOINTS.set_axis(range(2, 8), axis=1)
    assert read(joints=numbered) == read(joints=polars.DataFrame(JOINTS.to_numpy())) == read()
    assert "are numbered, but not in order: 3, 2, 4" in refusal(joints=numbered[[3, 2, 4, 5, 6, 7]])


def test_targets_of_frames_and_dictionaries_are_matched_by_name():
    levels = pandas.MultiIndex.from_tuples([tuple(name.split()) for name in UNLOADED.columns])
    by_level = UNLOADED.set_axis(levels, axis=1)[[NAMES[2], NAMES[0], NAMES[1]]]
    by_target = {name: positions("loaded")[:, t] for t, name in enumerate(NAMES)}
    assert read(unloaded=by_level, loaded=by_target) == read()
    named = read(unloaded=UNLOADED, loaded=LOADED[LOADED.columns[::-1]], targets=None)
    assert named.observations == read().observations
    fewer = LOADED[[name for name in LOADED.columns if not name.startswith("P12")]]
    assert "target 'P12' has no readings" in refusal(unloaded=UNLOADED, loaded=fewer, targets=None)
    more = fewer.to_dict("list"), LOADED.to_dict("list")
    assert "target 'P12' has readings only in `loaded`" in refusal(
        unloaded=more[0], loaded=more[1], targets=None
    )


def test_a_row_of_a_frame_is_one_vector():
    force = pandas.Series({"Fz": -500.0, "Fx": 10.0, "Fy": 20.0})
    assert read(forces=force).observations[3].force == (10.0, 20.0, -500.0)
    assert read(forces={"z": -500.0, "x": 10.0, "y": 20.0}).observations[3].force == (10.0, 20.0, -500.0)


def test_columns_in_a_list_are_matched_by_name():
    assert read(forces=[FORCES["Fy"], FORCES["Fx"], FORCES["Fz"]]) == read()
    assert "some columns of `forces` have no name" in refusal(
        forces=[FORCES["Fy"], FORCES["Fx"], pandas.Series(FORCES["Fz"].to_numpy())]
    )


def test_rows_of_pandas_are_aligned_by_their_index():
    shuffled = {
        name: frame.sample(frac=1.0, random_state=seed) for seed, (name, frame) in enumerate(FRAMES.items())
    }
    aligned = read(**(shuffled | {"joints": JOINTS}))
    assert aligned == read()
    by_label = {name: frame.set_axis(LABELS) for name, frame in FRAMES.items()}
    assert read(**(by_label | {"loaded": by_label["loaded"].iloc[::-1]})) == read()


@pytest.mark.parametrize("convert", [LIBRARIES["pandas"], LIBRARIES["polars"]], ids=["pandas", "polars"])
def test_rows_are_aligned_by_a_column_of_labels(convert):
    labelled = {name: convert(frame.assign(label=LABELS)) for name, frame in FRAMES.items()}
    backwards = convert(LOADED.assign(label=LABELS).iloc[::-1])
    assert read(**(labelled | {"loaded": backwards})) == read()
    assert read(labels=LABELS, loaded=backwards) == read()


def test_an_index_that_does_not_match_is_refused():
    other = LOADED.set_axis(range(1, 9))
    assert refusal(unloaded=UNLOADED, loaded=other).startswith(
        "the rows of `loaded` have other names than those of `unloaded`: 8"
    )
    odd_rows = pandas.concat([UNLOADED, LOADED]).sort_index(kind="stable").reset_index(drop=True).iloc[1::2]
    even_rows = UNLOADED.set_axis(range(0, 16, 2))
    assert "have other names than those of `unloaded`: 1, 3, 5" in refusal(
        unloaded=even_rows, loaded=odd_rows
    )
    assert read(unloaded=even_rows.to_numpy(), loaded=odd_rows.to_numpy()) == read()
    assert refusal(unloaded=UNLOADED, loaded=LOADED.iloc[::-1]) == (
        "the rows of `loaded` are in another order than the rows of `unloaded`, and the rows of "
        "`joints` have "
        "no names that show their order; remedy: give `joints` the same index, or sort the rows of `loaded`"
    )


def test_numbered_rows_are_aligned_also_next_to_names_in_words():
    named = FORCES.set_axis(LABELS)
    assert read(forces=named, unloaded=UNLOADED, loaded=LOADED) == read(labels=LABELS)
    assert refusal(forces=named, unloaded=UNLOADED, loaded=LOADED.iloc[::-1]) == (
        "the rows of `loaded` are numbered, but not in order (7, 6, 5, …), and the rows of "
        "`forces` have names "
        "in words; remedy: give both the same index, or sort the rows of `loaded` by their numbers"
    )
    other = LOADED.set_axis(range(1, 9))
    assert "the rows of `loaded` have other names than those of `unloaded`: 8" in refusal(
        forces=named, unloaded=UNLOADED, loaded=other
    )


@pytest.mark.parametrize("count", [3, 6, 8])
@pytest.mark.parametrize("names", [range(8), LABELS], ids=["numbers", "labels"])
def test_rows_in_a_list_are_rows(count, names):
    def rows(frame):
        return [frame.set_axis(names).iloc[i][frame.columns[::-1]] for i in range(count)]

    found = read(**{name: rows(frame) for name, frame in FRAMES.items()})
    whole = read(**{name: frame.iloc[:count] for name, frame in FRAMES.items()})
    assert found.observations == whole.observations


def test_rows_of_different_frames_in_a_list_are_refused():
    rows = [FORCES.iloc[i] for i in range(7)] + [JOINTS.iloc[7]]
    assert refusal(forces=rows).startswith(
        "row 7 of the list `forces` has the elements J1, J2, J3, J4, J5, J6, but row 0 has the "
        "elements Fx, Fy, Fz"
    )


def test_columns_in_a_list_may_have_rows_with_names():
    named = FORCES.set_axis(LABELS)
    assert read(forces=[named["Fy"], named["Fx"], named["Fz"]]) == read(labels=LABELS)


def test_an_axis_in_a_unit_of_another_quantity_is_refused():
    in_millimetres = FORCES.set_axis(["x [mm]", "y [mm]", "z [mm]"], axis=1)
    assert refusal(forces=in_millimetres).startswith(
        "the column 'x [mm]' of `forces` is in mm, which is no unit of a force; remedy: name the columns Fx"
    )
    assert read(forces=FORCES.set_axis(list("xyz"), axis=1)) == read()


def test_labels_name_the_observations():
    named = [f"day 1, {label}" for label in LABELS]
    found = read(unloaded=UNLOADED.set_axis(named), loaded=LOADED.set_axis(named))
    assert [each.label for each in found.observations] == named


@pytest.mark.parametrize("library", ["numpy", "pandas", "polars"])
def test_a_row_without_readings_is_a_posture_that_was_not_read(library):
    convert = {"numpy": lambda frame: frame.to_numpy()} | LIBRARIES
    unread = {name: frame.copy() for name, frame in FRAMES.items()}
    for frame in unread.values():
        frame.iloc[4] = np.nan
    found = read(**{name: convert[library](frame) for name, frame in unread.items()})
    assert [each.label for each in found.observations] == [label for label in LABELS if label != "c05"]
    assert list(found.observations) == [each for each in read().observations if each.label != "c05"]


def test_a_posture_that_was_read_needs_its_joints_and_its_force():
    for name in ("joints", "forces"):
        unknown = FRAMES[name].copy()
        unknown.iloc[4, 1] = np.nan
        assert f"`{name}` lacks numbers in observation 5" in refusal(**{name: unknown})


MASKED = np.ma.MaskedArray(positions("loaded"), mask=np.zeros(positions("loaded").shape, bool))
MASKED[2, 1] = np.ma.masked


@pytest.mark.parametrize(
    ("values", "fault"),
    [
        (JOINTS.to_numpy() > 0.0, "truth values"),
        (JOINTS > 0.0, "truth values"),
        (polars.DataFrame(JOINTS.to_numpy() > 0.0), "truth values"),
        ((JOINTS > 0.0).astype(object), "truth values"),
        (JOINTS.to_numpy() + 1j, "complex numbers"),
        (JOINTS.astype(complex), "complex numbers"),
        (JOINTS.astype(np.float16), "numbers of half precision, of three digits"),
        (JOINTS.to_numpy().astype("M8[s]"), "times"),
        (np.where(JOINTS.to_numpy() > 50.0, np.inf, JOINTS.to_numpy()), "infinite values"),
    ],
)
def test_values_that_are_no_numbers_are_refused(values, fault):
    assert f"has {fault}" in refusal(joints=values)


def test_masked_and_missing_values_were_not_read():
    missing = LOADED.astype("Float64")
    missing.loc[2, [f"P11 {axis}" for axis in "xyz"]] = pandas.NA
    nulls = polars.DataFrame({name: missing[name].to_list() for name in missing.columns}, strict=False)
    for loaded in (MASKED, missing, missing.astype(object), nulls):
        found = read(loaded=loaded).observations
        assert [len(each.readings) for each in found] == [3, 3, 2, 3, 3, 3, 3, 3]


def test_forgotten_forces_are_named():
    assert refusal(forces=None).startswith("forces: the readings under load have no force and no moment")


@pytest.mark.parametrize(
    ("loaded", "cause"),
    [
        (np.roll(positions("loaded"), 1, axis=0), "are at the unloaded positions of the row before"),
        (np.roll(positions("loaded"), -1, axis=0), "are at the unloaded positions of the row after"),
        (positions("loaded")[[3, 0, 6, 1, 7, 2, 4, 5]], "are at the unloaded positions of other rows"),
        (positions("loaded") - positions("unloaded"), "the loaded readings seem to be deflections"),
        (
            positions("loaded")[..., [1, 2, 0]],
            "give z, x, y of all loaded readings as x, y, z, and leave all other readings as they are",
        ),
        (
            positions("loaded") @ np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]),
            "check that unloaded and loaded readings are of the same posture",
        ),
    ],
)
def test_loaded_readings_that_are_too_far_away_are_refused_with_the_cause(loaded, cause):
    text = refusal(loaded=loaded)
    assert cause in text
    assert "unit" not in text


@pytest.mark.parametrize("convert", [LIBRARIES["pandas"], LIBRARIES["polars"]], ids=["pandas", "polars"])
def test_postures_and_loads_of_a_prediction_are_matched_by_name(convert):
    run = js.identify(js.Campaign.model_validate(DOCUMENT | {"run": {}}))
    point = DOCUMENT["measurement_set"]["load_point"]
    plain = run.predict(JOINTS.to_numpy(), forces=FORCES.to_numpy(), at=point)
    named = run.predict(
        convert(JOINTS[JOINTS.columns[::-1]]), forces=convert(FORCES[["Fz", "Fx", "Fy"]]), at=point
    )
    np.testing.assert_array_equal(named.displacement, plain.displacement)
    one = run.predict(JOINTS.iloc[2][::-1], forces=FORCES.iloc[2], at=point)
    np.testing.assert_array_equal(one.displacement, plain.displacement[2:3])
    with pytest.raises(js.CampaignError, match="the column 'J1 \\[rad\\]' of `postures` is in rad"):
        run.predict(convert(JOINTS.add_suffix(" [rad]")), forces=(0, 0, -100), at=point)
    with pytest.raises(
        js.CampaignError, match="the rows of `forces` have other names than those of `postures`"
    ):
        run.predict(JOINTS, forces=FORCES.set_axis(range(1, 9)), at=point)
