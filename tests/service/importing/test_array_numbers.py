"""Numbers of arrays that are stored otherwise than as plain numbers: read as the file states, or refused."""

import numpy as np
import pytest
from support.importing_samples import CAMPAIGN_NUMBERS, answered, numbers_of, refusals
from support.workbooks import arrays, hdf5, parquet, rows_of_values

pytestmark = pytest.mark.process

HEADER, *RECORDS = rows_of_values()
LABELS = [row[0] for row in RECORDS]
NUMBERS = np.array([row[1:] for row in RECORDS])
MATRICES = {
    "J_deg": NUMBERS[:, :3],
    "force_N": NUMBERS[:, 3:6],
    "P10_unloaded_mm": NUMBERS[:, 6:9],
    "P10_loaded_mm": NUMBERS[:, 9:],
}
COLUMNS = {name: [row[k] for row in RECORDS] for k, name in enumerate(HEADER)}
WITHOUT_SECOND = [CAMPAIGN_NUMBERS[0], CAMPAIGN_NUMBERS[2]]


def table(**changed):
    """Return a function that fills an HDF5 file; changed arrays are functions that fill their own."""

    def fill(file):
        file["label"] = LABELS
        for name, values in MATRICES.items():
            if name in changed:
                changed[name](file, name, values)
            else:
                file[name] = values

    return fill


def scaled(factor, offset, kind):
    def fill(file, name, values):
        stored = np.round((values - offset) / factor).astype(kind)
        file[name] = stored
        file[name].attrs["scale_factor"] = factor
        file[name].attrs["add_offset"] = np.array([offset])

    return fill


@pytest.mark.parametrize("kind", ["i4", "i8", "f8"])
def test_scaled_numbers_of_hdf5_are_read_as_their_attributes_state(kind):
    fill = table(J_deg=scaled(0.0625, 0.0, "i2"), P10_loaded_mm=scaled(1e-4, 500.0, kind))
    found = numbers_of(answered(("a.h5", hdf5(fill))))
    for (_, joints, _, points), (_, true_joints, _, true_points) in zip(found, CAMPAIGN_NUMBERS, strict=True):
        assert joints == true_joints  # multiples of 1/16
        assert points["P10"][1] == pytest.approx(true_points["P10"][1], abs=1e-9)


def missing(attribute, mark, kind="f8"):
    def fill(file, name, values):
        stored = values.copy().astype(kind)
        stored[1] = mark
        if attribute == "fillvalue":
            file.create_dataset(name, data=stored, fillvalue=mark)
        else:
            file[name] = stored
            file[name].attrs[attribute] = mark

    return fill


@pytest.mark.parametrize(
    ("attribute", "mark"),
    [("_FillValue", -9999.0), ("_FillValue", 0.0), ("missing_value", 1e20), ("fillvalue", -1e9)],
)
def test_the_fill_value_of_hdf5_is_no_reading(attribute, mark):
    content = hdf5(table(P10_loaded_mm=missing(attribute, mark)))
    (said,) = refusals(("a.h5", content))
    assert "target P10 was read only unloaded" in said
    assert numbers_of(answered(("a.h5", content), allow_missing=True)) == WITHOUT_SECOND


@pytest.mark.parametrize("attribute", ["_FillValue", "missing_value"])
def test_a_fill_value_of_more_digits_than_the_array_is_no_reading(attribute):
    content = hdf5(table(P10_loaded_mm=missing(attribute, 1e20 / 3.0, "f4")))
    (said,) = refusals(("a.h5", content))
    assert "target P10 was read only unloaded" in said


def test_numbers_outside_their_valid_range_are_no_readings():
    def fill(file, name, values):
        file[name] = np.where(np.arange(3)[:, None] == 1, 99999.0, values)
        file[name].attrs["valid_range"] = [-5000.0, 5000.0]

    content = hdf5(table(P10_loaded_mm=fill))
    assert numbers_of(answered(("a.h5", content), allow_missing=True)) == WITHOUT_SECOND


def test_an_attribute_that_is_not_understood_is_refused():
    def fill(file, name, values):
        file[name] = values
        file[name].attrs["scale_factor"] = "0.001"

    assert refusals(("a.h5", hdf5(table(J_deg=fill)))) == [
        "a.h5: the attribute 'scale_factor' of the array 'J_deg' is not understood; "
        "write 1 number into the attribute, or remove it"
    ]


def matlab_73(kind):
    """Fill an array as MATLAB 7.3 does."""

    def fill(file, name, values):
        if kind == "logical":
            file[name] = (values > 0).astype("u1").T
        else:
            parts = np.zeros(values.T.shape, [("real", "f8"), ("imag", "f8")])
            parts["real"], parts["imag"] = values.T, float(kind)
            file[name] = parts
        file[name].attrs["MATLAB_class"] = np.bytes_("logical" if kind == "logical" else "double")

    return fill


def as_type(kind):
    def fill(file, name, values):
        file[name] = values + 1j if kind == "c16" else values.astype(kind)

    return fill


def in_matlab(change):
    return lambda: arrays(label=LABELS, **MATRICES | {"P10_loaded_mm": change(MATRICES["P10_loaded_mm"])})


def in_parquet(change):
    numbers = change(np.array(COLUMNS["P10 loaded x [mm]"]))
    return lambda: parquet(COLUMNS | {"P10 loaded x [mm]": numbers})


def lists_in_parquet(kind):
    def write():
        pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
        rows = MATRICES["P10_loaded_mm"].astype(kind).tolist()
        element = {"?": pa.bool_(), "f2": pa.float16()}[kind]
        lists = {"label": LABELS} | {name: values.tolist() for name, values in MATRICES.items()}
        values = [[np.float16(each) if kind == "f2" else each for each in row] for row in rows]
        return parquet(lists | {"P10_loaded_mm": pa.array(values, pa.list_(element))})

    return write


@pytest.mark.parametrize(
    ("write", "kind", "way_out"),
    [
        (lambda: hdf5(table(P10_loaded_mm=as_type("?"))), "truth value", "enter a number"),
        (lambda: hdf5(table(P10_loaded_mm=as_type("c16"))), "complex number", "save the real part"),
        (
            lambda: hdf5(table(P10_loaded_mm=as_type("f2"))),
            "half-precision number",
            "in single or double precision",
        ),
        (lambda: hdf5(table(P10_loaded_mm=matlab_73("logical"))), "truth value", "enter a number"),
        (lambda: hdf5(table(P10_loaded_mm=matlab_73("1.5"))), "complex number", "save the real part"),
        (in_matlab(lambda values: values > 0.0), "truth value", "enter a number"),
        (in_matlab(lambda values: values + 2j), "complex number", "save the real part"),
        (in_parquet(lambda values: values > 0.0), "truth value", "enter a number"),
        (
            in_parquet(lambda values: values.astype("f2")),
            "half-precision number",
            "in single or double precision",
        ),
        (lists_in_parquet("?"), "truth value", "enter a number"),
        (lists_in_parquet("f2"), "half-precision number", "in single or double precision"),
    ],
)
def test_what_is_no_number_is_refused_with_the_way_out(write, kind, way_out):
    said = refusals(("a.bin", write()))
    assert said
    for fault in said:
        assert f"a number is needed, but the cell has type {kind}: " in fault
        assert way_out in fault


def test_complex_numbers_without_a_second_part_are_numbers():
    assert numbers_of(answered(("a.mat", in_matlab(lambda values: values + 0j)()))) == CAMPAIGN_NUMBERS
    assert numbers_of(answered(("a.mat", hdf5(table(P10_loaded_mm=matlab_73("0")))))) == CAMPAIGN_NUMBERS


def test_a_column_of_truth_values_may_mark_what_is_held_out():
    held_out = COLUMNS | {"validation": [False, True, False]}
    answer = answered(("a.parquet", parquet(held_out)))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.leave_out == ["c02"]


def test_single_precision_is_read():
    content = hdf5(table(J_deg=as_type("f4")))
    assert numbers_of(answered(("a.h5", content))) == CAMPAIGN_NUMBERS
