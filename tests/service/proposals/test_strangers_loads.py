"""Tables of strangers whose loads, states or postures are asked: the question says what to state."""

import io
import tomllib
from pathlib import Path

import numpy as np
import openpyxl
import pytest
from support.strange_files import JOINTS, both, digits, joint_rows, simulate, table, wide

import jointstiff as js
from jointstiff.service.importing import grammar as words

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=14)
UNLOADED, LOADED = both(CAMPAIGN)
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm"}


def propose(files, folder, **stated):
    for name, content in files.items():
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return js.read(*(folder / name for name in files), robot=ARM, **(STATED | stated))


def write_posture_blocks(missing):
    """Return a workbook with a block for each posture; one block has no row of the target `missing`."""
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Ensaio de rigidez"])
    sheet.append([])
    for number, joints in enumerate(CAMPAIGN.joints, 1):
        sheet.append([f"POSTURA {number}"])
        sheet.append([None, *JOINTS])
        sheet.append(["Eixos (graus)", *map(float, joints)])
        sheet.append([None, "SEM CARGA", None, None, "COM CARGA"])
        sheet.append([None, *"XYZXYZ"])
        for target in (1, 2, 3):
            positions = [each for p in both(CAMPAIGN, target - 1) for each in p[number - 1]]
            if number != 5 or target != missing:
                sheet.append([f"Alvo {target}", *map(float, positions)])
        sheet.append([])
    stream = io.BytesIO()
    book.save(stream)
    return stream.getvalue()


@pytest.mark.parametrize("missing", [None, 1, 2, 3])
def test_blocks_of_postures_in_a_workbook_are_read_also_without_a_target(missing, tmp_path):
    stated = {"force": [0, 0, -981], "units": {"force": "N"}, "allow_missing": missing is not None}
    answer = propose({"a.xlsx": write_posture_blocks(missing)}, tmp_path, **stated).accept()
    counts = [len(each.readings) for each in answer.measurement_set.observations]
    assert counts == [2 if missing and number == 5 else 3 for number in range(1, 15)]
    note = f"POSTURA 5: the cells of target Alvo {missing} are empty; skipped"
    assert any(note in each for each in answer.assumptions) is (missing is not None)


@pytest.mark.parametrize(("load", "mass"), [("(6 kg)", 6.0), ("13.2 lb", 5.987), ("[6 kg]", 6.0)])
def test_a_mass_in_the_header_of_a_block_is_the_load_of_its_columns_and_no_column_of_masses(
    load, mass, tmp_path
):
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append([None, "Eixos", *6 * [None], "Sem carga", None, None, None, f"Com carga {load}"])
    for first, last in ((2, 7), (9, 11), (13, 15)):
        sheet.merge_cells(start_row=1, start_column=first, end_row=1, end_column=last)
    sheet.append(["Pose", *JOINTS, None, *"XYZ", None, *"XYZ"])
    for number, joints in enumerate(CAMPAIGN.joints):
        blocks = [[None, *(positions[number] + 5000.0).tolist()] for positions in (UNLOADED, LOADED)]
        sheet.append([number + 1, *joints.tolist(), *blocks[0], *blocks[1]])
    stream = io.BytesIO()
    book.save(stream)
    read = propose({"a.xlsx": stream.getvalue()}, tmp_path).accept().measurement_set
    assert len(read.observations) == len(CAMPAIGN.joints)
    assert read.units.force == "kgf"
    assert all(each.force == pytest.approx((0.0, 0.0, -mass), abs=1e-3) for each in read.observations)
    deflections = [o.readings[0].loaded[2] - o.readings[0].unloaded[2] for o in read.observations]
    assert np.allclose(deflections, (LOADED - UNLOADED)[:, 2], atol=2e-3)


def write_numbered(without, under, header="Medición", noise=0.01):
    """Return rows of three repeats in both states, whose words have the numbers of the repeats behind.

    As with merged cells, the first row of a posture alone has its number and its joints.
    """
    generator = np.random.default_rng(5)
    rows = []
    for number, joints in enumerate(CAMPAIGN.joints):
        first = ["", str(number + 1), *digits(joints)]
        for word, positions in ((without, UNLOADED), (under, LOADED)):
            for repeat in range(1, 4):
                position = positions[number] + noise * generator.uniform(-1.0, 1.0, 3)
                rows.append([*first, f"{word} {repeat}", *digits(position)])
                first = [""] * len(first)
    return {"a.csv": table(["", "Punto", *JOINTS, header, *"XYZ"], rows)}


@pytest.mark.parametrize("header", ["Medición", "Estado"])
@pytest.mark.parametrize(
    ("without", "under", "stated"),
    [
        ("s/c", "c/c", {}),
        ("S/C", "C/C", {"s/c": "unloaded"}),
        ("s/ carga", "c/ carga", {}),
        ("sin carga", "con carga", {}),
        ("aa", "bb", {"aa": "unloaded", "bb": "loaded"}),
        ("aa", "bb", {"bb": "loaded"}),
    ],
)
def test_numbers_behind_words_for_states_count_repeats(without, under, stated, header, tmp_path):
    files = write_numbered(without, under, header)
    observations = (
        propose(files, tmp_path, state_words=stated, **NEWTONS).accept().measurement_set.observations
    )
    assert len(observations) == len(CAMPAIGN.joints)
    deflections = [o.readings[0].loaded[2] - o.readings[0].unloaded[2] for o in observations]
    assert np.allclose(deflections, (LOADED - UNLOADED)[:, 2], atol=0.05)


def test_words_that_a_number_alone_tells_apart_are_never_offered_as_two_states(tmp_path):
    """All words are stated, but the repeats are too far from each other to be taken without a question."""
    states = {
        f"{word} {repeat}": state
        for word, state in (("s/c", "unloaded"), ("c/c", "loaded"))
        for repeat in (1, 2, 3)
    }
    with pytest.raises(js.CampaignError) as error:
        propose(write_numbered("s/c", "c/c", noise=0.2), tmp_path, state_words=states, **NEWTONS)
    assert "'1' has this row twice of unloaded; remedy: " in str(error.value)
    assert "or use `mean_of_repeats`" in str(error.value)


STATES = [f"{state} {axis}" for state in ("unloaded", "loaded") for axis in "xyz"]
NEWTONS = {"force": [0, 0, -1313], "units": {"force": "N"}}
SIZES = np.linspace(1300.0, 1326.0, len(UNLOADED))


def accept(files, folder, **stated):
    return propose(files, folder, **stated).accept().measurement_set


def list_forces(document):
    unit = {"N": 1.0, "kN": 1e3}[document.units.force]
    return unit * np.array([each.force for each in document.observations])


def write_in_turn(sizes, header="Force_N"):
    """Return a table with two rows for each posture, of which the second is under a load of a size [N]."""
    rows = []
    for joints, unloaded, loaded, size in zip(joint_rows(CAMPAIGN), UNLOADED, LOADED, sizes, strict=True):
        rows += [[*joints, *digits(unloaded), "-0.6"], [*joints, *digits(loaded), f"{size:.1f}"]]
    return {"a.csv": table(["Pose", *JOINTS, *"XYZ", header], rows)}


def write_wide(sizes, header):
    rows = [[*row, size] for row, size in zip(wide(CAMPAIGN, UNLOADED, LOADED), sizes, strict=True)]
    return {"a.csv": table(["Pose", *JOINTS, *STATES, header], rows)}


@pytest.mark.parametrize("header", ["Force_N", "2024/06/03 荷重[N]", "Kraft [N]"])
def test_sizes_that_differ_take_the_direction_of_a_stated_force(header, tmp_path):
    files = write_in_turn(SIZES, header)
    assert f"{header!r} as the size of the force in each posture" in str(propose(files, tmp_path, **NEWTONS))
    expected = [[0.0, 0.0, -size] for size in SIZES]
    document = accept(files, tmp_path, **NEWTONS)
    np.testing.assert_allclose(list_forces(document), expected, atol=0.06)


def test_sizes_in_another_unit_than_the_stated_force_are_converted(tmp_path):
    files = write_wide([f"{size / 1e3:.4f}" for size in SIZES], "Zelle 3 Kraft [kN]")
    document = accept(files, tmp_path, **NEWTONS)
    np.testing.assert_allclose(list_forces(document), [[0.0, 0.0, -size] for size in SIZES], atol=0.06)


@pytest.mark.parametrize("header", ["Zelle 3 Kraft [kN]", "Kraft [kN]"])
def test_a_constant_size_confirms_a_stated_force(header, tmp_path):
    files = write_wide(["1.313"] * len(SIZES), header)
    assert f"{header!r} has 1313 N: `force` of 1313 N was taken" in str(propose(files, tmp_path, **NEWTONS))
    document = accept(files, tmp_path, **NEWTONS)
    np.testing.assert_allclose(list_forces(document), [[0.0, 0.0, -1313.0]] * len(SIZES))


def test_sizes_beside_the_positions_are_those_of_the_joints_of_another_file(tmp_path):
    rows = [
        [name, *digits(unloaded), *digits(loaded), f"{size:.1f}"]
        for (name, *_), unloaded, loaded, size in zip(
            joint_rows(CAMPAIGN), UNLOADED, LOADED, SIZES, strict=True
        )
    ]
    files = {
        "joints.csv": table(["Pose", *JOINTS], joint_rows(CAMPAIGN)),
        "points.csv": table(["Pose", *STATES, "Kraft [N]"], rows),
    }
    document = accept(files, tmp_path, **NEWTONS)
    np.testing.assert_allclose(list_forces(document), [[0.0, 0.0, -size] for size in SIZES], atol=0.06)


@pytest.mark.parametrize(
    ("sizes", "found"),
    [
        (SIZES + 100.0, "1400 to 1426 N under load"),
        (SIZES * np.where(np.arange(len(SIZES)) == 3, -1.0, 1.0), "1300 to 1326 N, of both signs"),
        (SIZES * np.where(np.arange(len(SIZES)) == 3, 0.0, 1.0), "0 to 1326 N"),
    ],
)
def test_sizes_of_another_force_are_refused_with_the_option_that_leaves_them_out(sizes, found, tmp_path):
    files = write_wide([f"{size:.1f}" for size in sizes], "Force_N")
    with pytest.raises(
        js.CampaignError, match=f"is 1313 N, but 'Force_N' has {found}.*by `ignore`: 'Force_N'"
    ):
        propose(files, tmp_path, **NEWTONS)
    document = accept(files, tmp_path, ignore=["Force_N"], **NEWTONS)
    np.testing.assert_allclose(list_forces(document), [[0.0, 0.0, -1313.0]] * len(SIZES))


def test_a_force_of_merged_cells_is_that_of_all_targets_of_a_posture(tmp_path):
    targets = [both(CAMPAIGN, target) for target in range(3)]
    rows = [
        [
            name if target == 0 else "",
            *digits(unloaded[n]),
            *digits(loaded[n]),
            "1.313" if target == 0 else "",
        ]
        for n, (name, *_) in enumerate(joint_rows(CAMPAIGN))
        for target, (unloaded, loaded) in enumerate(targets)
    ]
    files = {
        "joints.csv": table(["Pose", *JOINTS], joint_rows(CAMPAIGN)),
        "points.csv": table(["Position", *STATES, "Kraft [kN]"], rows),
    }
    document = accept(files, tmp_path, **NEWTONS)
    np.testing.assert_allclose(list_forces(document), [[0.0, 0.0, -1313.0]] * len(SIZES))


@pytest.mark.parametrize(
    ("without", "under"),
    [
        ("Obelastad", "Belastad"),
        ("Utan belastning", "Med belastning"),
        ("Ubelastet", "Belastet"),
        ("Uten last", "Med last"),
        ("Nieobciążony", "Obciążony"),
        ("без", "с"),
        ("T1 без груза", "T1 с грузом"),
        ("без нагр", "с нагр"),
        ("Yük yok", "Yük var"),
        ("Kuormittamaton", "Kuormitettu"),
    ],
)
def test_states_in_more_languages_are_known(without, under, tmp_path):
    header = ["Pose", *JOINTS, *[f"{state} {axis}" for state in (under, without) for axis in "XYZ"]]
    files = {"a.csv": table(header, wide(CAMPAIGN, LOADED, UNLOADED))}
    (first, *_) = accept(files, tmp_path, **NEWTONS).observations
    (reading,) = first.readings
    np.testing.assert_allclose(reading.unloaded, UNLOADED[0], atol=1e-3)
    np.testing.assert_allclose(reading.loaded, LOADED[0], atol=1e-3)


def test_no_word_means_two_states():
    with Path(words.__file__).with_name("words.toml").open("rb") as file:
        states = tomllib.load(file)["states"]
    listed = [word for each in states.values() for word in each]
    assert sorted(set(listed)) == sorted(listed)


def test_targets_with_cyrillic_letters_are_no_states(tmp_path):
    both_states = [both(CAMPAIGN, target) for target in range(3)]
    columns = [
        f"{name} {state} {axis}" for name in "АВС" for state in ("unloaded", "loaded") for axis in "xyz"
    ]
    rows = wide(CAMPAIGN, *[positions for pair in both_states for positions in pair])
    document = accept({"a.csv": table(["Pose", *JOINTS, *columns], rows)}, tmp_path, **NEWTONS)
    assert {each.target for each in document.observations[0].readings} == {"А", "В", "С"}


@pytest.mark.parametrize("header", ["디스크 (kg)", "Вес [кг]"])
def test_the_question_for_the_force_quotes_a_column_of_one_mass(header, tmp_path):
    files = write_wide(["12"] * len(SIZES), header)
    (missing, *_) = propose(files, tmp_path).accept().missing
    assert f"{header!r} has 12 kg: if this load hangs, `force` is 0,0,-12kgf" in missing


@pytest.mark.parametrize("header", ["Load (lb)", "Payload [lbs]", "test_load_lb", "Weight, lbs", "Disc LB"])
def test_the_question_for_the_force_keeps_the_pounds_of_the_header(header, tmp_path):
    files = write_wide(["350"] * len(SIZES), header)
    (missing, *_) = propose(files, tmp_path).accept().missing
    assert f"{header!r} has 350 lb" in missing
    assert missing.endswith(": if this load hangs, `force` is 0,0,-350lbf")


@pytest.mark.parametrize("header", ["Load (%)", "Payload [g]", "Load [V]", "Weight [t]", "Load (setting)"])
def test_the_question_for_the_force_makes_no_mass_of_another_unit(header, tmp_path):
    files = write_wide(["350"] * len(SIZES), header)
    (missing, *_) = propose(files, tmp_path).accept().missing
    assert "350" not in missing


def test_the_question_for_the_force_asks_the_unit_of_a_load_without_one(tmp_path):
    files = write_wide(["12"] * len(SIZES), "Load")
    (missing, *_) = propose(files, tmp_path).accept().missing
    hint = (
        "'Load' has 12 without a unit: if this load hangs, `force` is 0,0,-12kgf for kg, or 0,0,-12lbf for lb"
    )
    assert hint in missing


def write_bare(forces):
    rows = [
        [*row[1:], *digits(force)]
        for row, force in zip(wide(CAMPAIGN, UNLOADED, LOADED), forces, strict=True)
    ]
    return {"a.txt": table([], rows, " ")}


def test_the_question_for_the_force_names_the_three_columns_that_are_left(tmp_path):
    forces = np.random.default_rng(5).uniform(-60.0, 60.0, (len(SIZES), 3))
    (missing, *_) = propose(write_bare(forces), tmp_path).accept().missing
    assert "in axes of R0" in missing
    assert "columns 13–15 of 'a.txt' are not read and may be the force" in missing
    header = [*JOINTS, *STATES, "Fx [N]"]
    with pytest.raises(
        js.CampaignError, match=r"13 columns, but the rows have 15 cells.*without blanks in a name"
    ):
        propose(write_bare(forces), tmp_path, header=header)


@pytest.mark.parametrize(
    ("header", "flag"),
    [("load", "1"), ("charge utile", "1.0"), ("mass", "1"), ("Force", "1"), ("F_N", "-1"), ("荷重[kN]", "1")],
)
def test_a_flag_of_loaded_rows_is_neither_taken_nor_suggested_as_the_size_of_a_load(header, flag, tmp_path):
    rows = []
    for joints, unloaded, loaded in zip(joint_rows(CAMPAIGN), UNLOADED, LOADED, strict=True):
        rows += [[*joints, *digits(unloaded), "0"], [*joints, *digits(loaded), flag]]
    files = {"a.csv": table(["Pose", *JOINTS, *"XYZ", header], rows)}
    (question,) = propose(files, tmp_path).accept().missing
    assert question.endswith("or one `force` (N, daN, kN, kgf, lbf)")
    document = accept(files, tmp_path, **NEWTONS)
    np.testing.assert_allclose(list_forces(document), [[0.0, 0.0, -1313.0]] * len(UNLOADED))


def test_a_flag_in_a_table_of_readings_is_not_suggested_as_the_size_of_a_load(tmp_path):
    rows = [
        [name, flag, *digits(position)]
        for (name, *_), pair in zip(joint_rows(CAMPAIGN), zip(UNLOADED, LOADED, strict=True), strict=True)
        for flag, position in enumerate(pair)
    ]
    files = {
        "robot.csv": table(["pose", *JOINTS], joint_rows(CAMPAIGN)),
        "tracker.csv": table(["pose", "load", *"xyz"], rows),
    }
    (question,) = propose(files, tmp_path).accept().missing
    assert question.endswith("or one `force` (N, daN, kN, kgf, lbf)")
