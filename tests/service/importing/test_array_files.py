"""Files of arrays (MATLAB, HDF5, Parquet): tables with the numbers of the file, or refused in a sentence."""

import os
import random
import re
import struct
import sys
import zlib
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from support.importing_samples import CAMPAIGN_NUMBERS, answered, numbers_of, refusals
from support.workbooks import arrays, hdf5, parquet, rows_of_values

from jointstiff.service.importing import child
from jointstiff.service.importing.formats import arrays as room
from jointstiff.service.importing.formats.columns import NamedArray, tabulate
from jointstiff.service.limited import belongs_to_child

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
SKIPPED = ["variables that are no tables were skipped: 'note'"]


def of_matrices(group):
    group["label"] = LABELS
    for name, values in MATRICES.items():
        group[name] = values
    group["note"] = "cell 3"


def with_units(group):
    group["label"] = np.array(LABELS, dtype="S3")
    for name, values in MATRICES.items():
        base, _, unit = name.rpartition("_")
        group[base] = values
        group[base].attrs["units"] = unit


def packed(file):
    file["label"] = LABELS
    for name, values in MATRICES.items():
        file.create_dataset(
            name, data=values, chunks=(2, 3), compression="gzip", shuffle=True, fletcher32=True
        )


def of_records(file):
    import h5py

    kind = [("label", h5py.string_dtype()), *((name, "f8") for name in HEADER[1:])]
    file.create_dataset("day1", data=np.array([tuple(row) for row in RECORDS], dtype=kind))


def of_matlab(file, labels=tuple(LABELS), matrices=MappingProxyType(MATRICES)):
    """Fill a file as MATLAB 7.3 does: matrices by columns, texts as references to arrays of characters."""
    import h5py

    texts = file.create_group("#refs#")
    references = []
    for number, label in enumerate(labels):
        text = texts.create_dataset(str(number), data=np.array([list(map(ord, label))], dtype="u2").T)
        text.attrs["MATLAB_class"] = np.bytes_("char")
        references.append(text.ref)
    file.create_dataset("label", data=np.array([references], dtype=h5py.ref_dtype))
    file["label"].attrs["MATLAB_class"] = np.bytes_("cell")
    for name, values in matrices.items():
        file[name] = values.T
        file[name].attrs["MATLAB_class"] = np.bytes_("double")


def in_two_groups(file):
    joints, points = file.create_group("joints"), file.create_group("day1/points")
    for group in (joints, points):
        group["label"] = LABELS
    for name, values in MATRICES.items():
        (points if name.startswith("P10") else joints)[name] = values


def days(file):
    of_matrices(file.create_group("day1"))
    of_matrices(file.create_group("day2"))


def longer_log(file):
    of_matrices(file)
    file["temperature"] = np.full(1000, 21.5)


H5_FORMS = [of_matrices, with_units, packed, of_records, of_matlab]


@pytest.mark.parametrize("fill", H5_FORMS)
def test_arrays_and_records_of_hdf5_are_tables(fill):
    answer = answered(("a.h5", hdf5(fill)))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.files[0].format == "hdf5"
    assert answer.files[0].assumptions == (SKIPPED if fill is of_matrices else [])


def test_a_group_is_chosen_by_one_answer():
    file = "a.h5", hdf5(days)
    assert refusals(file) == [
        "a.h5: several groups or arrays have data: 'day1, day2'; give `sheet`; separate several names by "
        "semicolons [sheet]"
    ]
    answer = answered(file, sheet="day2")
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.files[0].sheet == "day2"


def test_two_groups_are_two_tables_of_one_campaign():
    answer = answered(("a.h5", hdf5(in_two_groups)), sheet="joints; day1/points")
    assert numbers_of(answer) == CAMPAIGN_NUMBERS


def test_an_array_of_another_length_is_left_out_and_named():
    answer = answered(("a.h5", hdf5(longer_log)))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.files[0].assumptions == ["variables that are no tables were skipped: 'note, temperature'"]


def test_nan_is_an_empty_cell_and_no_number():
    def fill(file):
        of_matrices(file)
        file["P10_loaded_mm"][1] = np.nan

    (said,) = refusals(("a.h5", hdf5(fill)))
    assert "target P10 was read only unloaded" in said
    answer = answered(("a.h5", hdf5(fill)), allow_missing=True)
    assert numbers_of(answer) == [CAMPAIGN_NUMBERS[0], CAMPAIGN_NUMBERS[2]]


def test_a_unit_of_an_attribute_may_not_contradict_the_name():
    def fill(file):
        of_matrices(file)
        file["J_deg"].attrs["units"] = "rad"

    assert refusals(("a.h5", hdf5(fill))) == [
        "a.h5: the array 'J_deg' has the unit 'rad' in its attribute; correct the name or the attribute"
    ]


def test_an_unknown_unit_of_an_attribute_is_not_ignored():
    def fill(file):
        with_units(file)
        file["J"].attrs["units"] = "furlong"

    assert "furlong" in refusals(("a.h5", hdf5(fill)))[0]


COLUMNS = {name: [row[k] for row in RECORDS] for k, name in enumerate(HEADER)}
LISTS = {"label": LABELS} | {name: values.tolist() for name, values in MATRICES.items()}


@pytest.mark.parametrize("packing", ["none", "snappy", "gzip", "zstd", "lz4", "brotli"])
@pytest.mark.parametrize("columns", [COLUMNS, LISTS], ids=["numbers", "lists"])
def test_columns_of_parquet_are_a_table(columns, packing):
    answer = answered(("a.parquet", parquet(columns, compression=packing)))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.files[0].format == "parquet"


def test_a_frame_of_pandas_with_labels_as_index_is_a_table(tmp_path):
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(COLUMNS).astype({"label": "category"})
    frame.set_index("label").to_parquet(tmp_path / "a.parquet")
    assert numbers_of(answered(("a.parquet", (tmp_path / "a.parquet").read_bytes()))) == CAMPAIGN_NUMBERS


def test_texts_of_parquet_with_decimal_commas_need_one_answer():
    texts = {name: [str(cell).replace(".", ",") for cell in cells] for name, cells in COLUMNS.items()}
    file = "a.parquet", parquet(texts)
    (said,) = refusals(file)
    assert said.endswith("[decimal_mark]")
    assert numbers_of(answered(file, decimal_mark="comma")) == CAMPAIGN_NUMBERS


def matlab(**more):
    return arrays(label=LABELS, **MATRICES, **more)


def test_variables_of_matlab_are_a_table():
    answer = answered(("a.mat", matlab(note="cell 3")))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.files[0].assumptions == SKIPPED


def test_vectors_of_matlab_may_stand_as_rows():
    vectors = {f"J{k + 1}_deg": NUMBERS[:, k] for k in range(3)}
    rest = {name: values for name, values in MATRICES.items() if name != "J_deg"}
    answer = answered(("a.mat", arrays(label=LABELS, **vectors, **rest)))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS


@pytest.mark.parametrize(("kind", "library"), [("hdf5", "h5py"), ("parquet", "pyarrow")])
def test_a_missing_library_is_named_with_the_extra_that_installs_it(kind, library, monkeypatch):
    monkeypatch.setattr(room, "find_spec", lambda name: None if name == library else name)
    start = {"hdf5": b"\x89HDF\r\n\x1a\n", "parquet": b"PAR1"}[kind]
    (said,) = refusals(("a.bin", start + b"\0" * 100))
    assert "needs the extra `tables`, which is not installed" in said
    assert 'pip install "jointstiff[tables]"' in said


# ---- files that mean harm


def huge(file):
    file.create_dataset("t", shape=(10**9,), dtype=[("x", "f8"), ("y", "f8")], chunks=(1000,))


def huge_chunk(file):
    of_matrices(file)
    file.create_dataset("z", data=np.zeros(3), maxshape=(None,), chunks=(10**8,), compression="gzip")


def bomb_of_deflate(file):
    of_matrices(file)
    array = file.create_dataset("z", (3,), "f8", chunks=(3,), compression="gzip")
    packer = zlib.compressobj(9)
    raw = b"".join(packer.compress(bytes(2**20)) for _ in range(1500)) + packer.flush()
    array.id.write_direct_chunk((0,), raw)


def elsewhere(tmp_path):
    def fill(file):
        of_matrices(file)
        (tmp_path / "raw").write_bytes(bytes(24))
        file.create_dataset("z", (3,), "f8", external=[(str(tmp_path / "raw"), 0, 24)])

    return fill


def virtual(file):
    import h5py

    of_matrices(file)
    layout = h5py.VirtualLayout((3,), "f8")
    layout[:] = h5py.VirtualSource("/etc/other.h5", "data", (3,))
    file.create_virtual_dataset("z", layout)


def links(file):
    import h5py

    of_matrices(file)
    file["secret"] = h5py.ExternalLink("/etc/passwd", "/secret")
    file["soft"] = h5py.SoftLink("/J_deg")
    file["circle"] = file["/"]


def packed_otherwise(file):
    of_matrices(file)
    file.create_dataset("z", data=np.zeros(3), compression="lzf")


def of_pandas(file):
    file.create_group("frame").attrs["pandas_type"] = np.bytes_("frame")


def long_unit(file):
    of_matrices(file)
    file["J_deg"].attrs["units"] = "y" * 60_000  # of variable length: 16 bytes are stored


def long_name(file):
    of_matrices(file)
    file["n" * 50_000] = np.zeros(3)


def long_path(file):
    of_matrices(file)
    file["/".join("g" * 100 for _ in range(3))] = np.zeros(3)


def long_field(file):
    file["r"] = np.zeros(3, [("n" * 300, "f8"), ("x", "f8")])


def long_log(file):
    file["J_deg"] = np.zeros((400_000, 2), "u1")
    file["calibration"] = np.zeros(6)


LARGE = "larger than 64 MiB, 320,000 rows, 256 columns or 1,000,000 cells"
HARM = [
    (huge, LARGE),
    (huge_chunk, LARGE),
    (bomb_of_deflate, "damaged|ended without a result"),
    (virtual, "is stored in other files; copy the array into one file"),
    (
        packed_otherwise,
        "is packed by a filter other than gzip; save the array with gzip, or without a filter",
    ),
    (of_pandas, "a frame of pandas, whose names and texts are pickled .* as Parquet or CSV"),
    (long_log, LARGE),
    (
        long_unit,
        "a name or unit of an array has more than 256 characters; give the array a shorter name or unit",
    ),
    (long_name, "a name or unit of an array has more than 256 characters"),
    (long_path, "a name or unit of an array has more than 256 characters"),
    (long_field, "a name or unit of an array has more than 256 characters"),
    (lambda _: None, "no arrays of numbers with rows"),
]


@pytest.mark.parametrize(("fill", "reason"), HARM)
def test_hdf5_that_means_harm_is_refused_in_a_sentence(fill, reason):
    (said,) = refusals(("a.h5", hdf5(fill)))
    assert len(said) < 250
    assert re.search(reason, said), said


def test_no_array_is_read_beyond_the_columns_of_a_table():
    read = []

    def arrays_of_file():
        for k in range(10_000):
            read.append(k)
            yield NamedArray(f"a{k}", np.zeros((100, 10)))

    with pytest.raises(MemoryError):
        tabulate(arrays_of_file())
    assert len(read) == 26


def test_many_short_arrays_are_refused_as_too_large():
    def fill(file):
        for k in range(1_900):
            file[f"a{k}"] = np.zeros(100)

    (said,) = refusals(("a.h5", hdf5(fill)))
    assert LARGE in said


def test_many_groups_are_refused_as_too_large():
    def fill(file):
        for k in range(2_001):
            file.create_group(f"g{k}")

    (said,) = refusals(("a.h5", hdf5(fill)))
    assert LARGE in said


def test_an_image_beside_a_table_is_left_out_and_named():
    def fill(file):
        of_matrices(file)
        file["image"] = np.zeros((480, 640), "u1")

    answer = answered(("a.h5", hdf5(fill)))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.files[0].assumptions == ["variables that are no tables were skipped: 'image, note'"]


def test_empty_variables_of_matlab_are_left_out_and_named():
    """MATLAB 7.3 stores the shape of an empty variable in its place: 0 × 3 as the numbers 0 and 3."""

    def fill(file):
        of_matlab(file)
        for name, kind in (("empty", "double"), ("no_text", "char"), ("no_cell", "cell")):
            file[name] = np.array([0, 3, 3], "u8")[: len(LABELS)]
            file[name].attrs["MATLAB_class"] = np.bytes_(kind)
            file[name].attrs["MATLAB_empty"] = np.uint8(1)

    answer = answered(("a.mat", hdf5(fill)))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.files[0].assumptions == [
        "variables that are no tables were skipped: 'empty, no_cell, no_text'"
    ]


def test_empty_variables_of_older_matlab_are_left_out_and_named():
    answer = answered(("a.mat", matlab(empty=np.zeros((0, 300)))))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.files[0].assumptions == ["variables that are no tables were skipped: 'empty'"]


@pytest.mark.slow
def test_labels_of_the_largest_campaign_are_read_in_time():
    """HDF5 searches the file for the name of each text: with names, 10,000 texts took over 60 s."""
    count = 10_000
    labels = [f"c{k:05d}" for k in range(count)]
    content = hdf5(lambda file: of_matlab(file, labels, {"J_deg": np.zeros((count, 2))}))
    (table,) = room.read_arrays("a.mat", content, "hdf5", [None])
    assert [row.cells[2] for row in table.rows[1:]] == labels


def test_arrays_without_a_space_are_left_out():
    """HDF5 arrays may have no shape at all, as an empty array of records that h5py saves."""

    def fill(file):
        import h5py

        of_matrices(file)
        file["nothing"] = h5py.Empty("f8")
        file["no_records"] = h5py.Empty(np.dtype([("x", "f8")]))
        file.create_group("alone")["nothing"] = h5py.Empty("f8")

    answer = answered(("a.h5", hdf5(fill)))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.files[0].assumptions == [
        "variables that are no tables were skipped: 'no_records, note, nothing'"
    ]


def test_storage_in_another_file_is_not_read(tmp_path):
    (said,) = refusals(("a.h5", hdf5(elsewhere(tmp_path))))
    assert "the array 'z' is stored in other files" in said


def test_links_to_other_files_and_in_circles_are_not_followed():
    assert numbers_of(answered(("a.h5", hdf5(links)))) == CAMPAIGN_NUMBERS


def test_one_long_text_that_all_rows_share_is_not_repeated():
    """Rows refer to texts of variable length: 3,000 references to one text of 2 MB are 6 GB."""

    def fill(file):
        import h5py

        of_matrices(file)
        file.create_dataset("t", (3000,), h5py.string_dtype())[0] = "x" * 2_000_000

    content = bytearray(hdf5(fill))
    at = content.find(struct.pack("<I", 2_000_000))
    reference = content[at : at + 16]
    for row in range(1, 3000):
        content[at + 16 * row : at + 16 * row + 16] = reference
    (said,) = refusals(("a.h5", bytes(content)))
    assert "a text has more than 256 characters" in said


def dictionary(text, rows):
    pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, "i4")), pa.array([text]))


@pytest.mark.parametrize(
    ("columns", "reason"),
    [
        (lambda: {"t": dictionary("x" * 2_000_000, 300_000)}, "a text has more than 256 characters"),
        (lambda: {k: dictionary("x" * 250, 300_000) for k in "abc"}, LARGE),
        (lambda: {"t": ["x" * 100_000_000]}, LARGE),
        (lambda: {"t": [[0.0] * 2_000_000] * 3}, LARGE),
        (lambda: {f"c{k}": [0.0] for k in range(300)}, LARGE),
        (lambda: {k: np.zeros(310_000) for k in "abcd"}, LARGE),
    ],
    ids=["long text", "many texts", "one text", "lists", "columns", "cells"],
)
def test_parquet_that_means_harm_is_refused_in_a_sentence(columns, reason):
    (said,) = refusals(("a.parquet", parquet(columns(), compression="zstd")))
    assert reason in said


def test_arrays_in_cells_of_matlab_are_not_unpacked_without_limit():
    cell = np.empty((1, 1), dtype=object)
    cell[0, 0] = np.zeros((12_000, 40_000), "i1")
    (said,) = refusals(("a.mat", arrays(c=cell)))
    assert LARGE in said or "ended without a result" in said


def test_a_file_that_takes_too_long_is_refused(monkeypatch):
    monkeypatch.setattr(child, "MAX_WAIT", 0.0)
    (said,) = refusals(("a.mat", matlab()))
    assert (
        "ended without a result: the file is damaged, or reading the file takes over 384 MiB or 60 s" in said
    )


def in_folder_with(names, folder, monkeypatch):
    """Work in a folder with such modules; return the file that a module writes when it runs."""
    for name in names:
        lines = f"open({str(folder / 'ran')!r}, 'w').close()", "raise SystemExit"
        (folder / f"{name}.py").write_text("\n".join(lines))
    paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(str(Path(path).resolve()) for path in paths if path))
    monkeypatch.chdir(folder)
    return folder / "ran"


@pytest.mark.parametrize("kind", ["mat", "hdf5", "parquet"])
def test_modules_in_the_working_folder_are_not_run(kind, tmp_path, monkeypatch):
    content = {"mat": matlab, "hdf5": lambda: hdf5(of_matrices), "parquet": lambda: parquet(COLUMNS)}[kind]()
    ran = in_folder_with(("h5py", "numpy", "pyarrow", "scipy"), tmp_path, monkeypatch)
    assert numbers_of(answered((f"a.{kind}", content))) == CAMPAIGN_NUMBERS
    assert not ran.exists()


@pytest.mark.parametrize("said_by_process", ["", "[1]", "not JSON", '{"arr'])
def test_a_process_that_ends_without_an_answer_is_no_fault_of_ours(said_by_process, monkeypatch):
    command = [sys.executable, "-c", f"print({said_by_process!r}, end='')"]
    monkeypatch.setattr(child, "build_own_command", lambda *_: command)
    (said,) = refusals(("a.mat", matlab()))
    assert "reading a MATLAB file ended without a result" in said


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["mat", "hdf5", "parquet"])
def test_damaged_arrays_are_refused_or_keep_what_is_not_damaged(kind, seed):
    """Bytes of numbers have no check sums, so the labels tell whether the table is the file's."""
    content = bytearray(
        {"mat": matlab, "hdf5": lambda: hdf5(of_matrices), "parquet": lambda: parquet(COLUMNS)}[kind]()
    )
    chance = random.Random(seed)  # noqa: S311
    for _ in range(chance.choice((1, 4, 40))):
        content[chance.randrange(16, len(content))] = chance.randrange(256)
    if seed % 2:
        del content[chance.randrange(len(content) // 2, len(content)) :]
    answer = answered((f"a.{kind}", bytes(content)), show_faults=True)
    assert answer.faults or answer.missing or len(answer.measurement_set.observations) <= len(LABELS)


@pytest.mark.parametrize("content", [b"MATLAB 5.0 MAT-file", b"\x89HDF\r\n\x1a\n", b"PAR1", b"PK\x03\x04"])
def test_the_service_reads_packed_files_of_any_size_in_its_limited_process(content):
    assert belongs_to_child("/v1/imports", b"--form\r\n" + content)
    assert not belongs_to_child("/v1/imports", b"--form\r\nlabel;J1")
