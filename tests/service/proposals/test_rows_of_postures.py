"""Tables with several rows for each posture: what stands in the first row only, and states without names."""

import io

import numpy as np
import openpyxl
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on
from support.importing_samples import answered, numbers_of, refusals

import jointstiff as js
from jointstiff.service.importing.grammar import Meaning, Quantity
from jointstiff.service.importing.grid import Row
from jointstiff.service.importing.merged_rows import fill_down

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=94, configurations=12)
DEGREES = np.rad2deg(READINGS.joints)
FIRST = 1e3 * READINGS.position[:, 0]
SECOND = 1e3 * READINGS.position[:, 1]
SAG = np.array([0.02, -0.03, -0.4])
STATED = {"encoders": "motor", "load_point": [0, 0, 100], "force": [0, 0, -100], "units": {"force": "N"}}
BLANK = [""] * 7


def cells(numbers, digits=3):
    return [f"{float(number):.{digits}f}" for number in numbers]


def rounded(numbers):
    return tuple(float(cell) for cell in cells(numbers))


def names_of(number):
    return [f"{number + 1}", *cells(DEGREES[number])]


def rows_of_targets():
    header = ["Stellung", *(f"A{i} [°]" for i in range(1, 7)), "Ziel", *(f"{c} ohne" for c in "XYZ")]
    yield [*header, *(f"{c} mit" for c in "XYZ")]
    for number in range(len(DEGREES)):
        for first, target, places in ((names_of(number), "SMR1", FIRST), (BLANK, "SMR2", SECOND)):
            yield [*first, target, *cells(places[number]), *cells(places[number] + SAG)]


def rows_of_states():
    yield ["Nr", *(f"J{i}" for i in range(1, 7)), "Ablauf", "X", "Y", "Z"]
    for number, place in enumerate(FIRST):
        yield [*names_of(number), "ohne Last", *cells(place)]
        yield [*BLANK, "mit Last", *cells(place + SAG)]
        yield [*BLANK, "ohne Last wieder", *cells(place + 0.01)]


def rows_of_states_and_targets():
    yield ["label", *(f"J{i} [deg]" for i in range(1, 7)), "state", "target", *(f"{c} [mm]" for c in "xyz")]
    for number in range(len(DEGREES)):
        for state, shift in (("unloaded", 0.0), ("loaded", SAG)):
            first = names_of(number) if state == "unloaded" else BLANK
            yield [*first, state, "SMR1", *cells(FIRST[number] + shift)]
            yield [*BLANK, "", "SMR2", *cells(SECOND[number] + shift)]


def rows_of_targets_and_states(header="SMR", *, are_joints_merged=True, without=()):
    yield ["Pose", *(f"Axis{i}" for i in range(1, 7)), header, "Load", *"XYZ"]
    for number in range(len(DEGREES)):
        for target, places in (("upper", FIRST), ("lower", SECOND)):
            first = names_of(number) if target == "upper" or not are_joints_merged else BLANK
            yield [*first, target, "off", *cells(places[number])]
            if (number, target) not in without:
                yield [*(BLANK if are_joints_merged else first), "", "on", *cells(places[number] + SAG)]


def write_csv(rows):
    return "\n".join(";".join(row) for row in rows).encode() + b"\n"


def write_workbook(rows, *, are_merged=True):
    book = openpyxl.Workbook()
    sheet = book.active
    for row in rows:
        sheet.append(
            [float(cell) if cell.lstrip("-").replace(".", "", 1).isdigit() else cell for cell in row]
        )
    for first in range(2, sheet.max_row, 2) if are_merged else ():
        for column in range(1, 8):
            sheet.merge_cells(start_row=first, end_row=first + 1, start_column=column, end_column=column)
    output = io.BytesIO()
    book.save(output)
    return output.getvalue()


def shifts_of(proposal):
    observations = proposal.accept().campaign.measurement_set.observations
    return {
        each.target: np.subtract(each.loaded, each.unloaded) for own in observations for each in own.readings
    }, observations


@pytest.mark.parametrize(
    ("name", "content", "targets"),
    [
        ("merged.xlsx", write_workbook(rows_of_targets()), {"SMR1", "SMR2"}),
        ("targets.csv", write_csv(rows_of_targets()), {"SMR1", "SMR2"}),
        ("states.csv", write_csv(rows_of_states()), {"T1"}),
        ("both.csv", write_csv(rows_of_states_and_targets()), {"SMR1", "SMR2"}),
        ("smr.csv", write_csv(rows_of_targets_and_states()), {"upper", "lower"}),
        ("side.csv", write_csv(rows_of_targets_and_states("Side")), {"upper", "lower"}),
        (
            "full.csv",
            write_csv(rows_of_targets_and_states(are_joints_merged=False)),
            {"upper", "lower"},
        ),
        (
            "short.csv",
            write_csv(rows_of_targets_and_states(without=[(2, "lower")])),
            {"upper", "lower"},
        ),
    ],
    ids=[
        "merged cells",
        "rows of targets",
        "rows of states",
        "states of two rows",
        "targets of two rows",
        "unknown names of two rows",
        "joints in each row",
        "a row is missing",
    ],
)
def test_names_and_joints_of_the_first_row_hold_for_the_rows_of_their_posture(
    name, content, targets, tmp_path
):
    (tmp_path / name).write_bytes(content)
    proposal = js.read(tmp_path / name, robot=ARM, length_unit="mm", **STATED)
    shifts, observations = shifts_of(proposal)
    assert set(shifts) == targets
    assert len(observations) == len(DEGREES)
    assert all(np.allclose(shift, SAG, atol=2e-3) for shift in shifts.values())


def test_a_target_of_more_rows_than_the_others_is_not_filled():
    """The name of the second target of a posture is missing: its rows are not those of the first."""
    cells_of_rows = list(rows_of_targets_and_states())[1:]
    cells_of_rows[6][7] = ""
    rows = [row(number, *texts) for number, texts in enumerate(cells_of_rows)]
    meanings = (*[JOINT] * 7, Meaning(Quantity("target")), Meaning(Quantity("state")), *[X] * 3)
    filled = fill_down(rows, [""] * len(meanings), meanings).rows
    assert [each.cells[7] for each in filled] == [each.cells[7] for each in rows]


def row(line, *texts):
    return Row(line, texts)


JOINT, X = Meaning(Quantity("joint"), 0), Meaning(Quantity("position"), 0)
UNTIDY = {
    "a posture has more rows than the others": ["1", "", "2", "", "", "", "3", ""],
    "one cell is missing": ["1", "2", "3", "4", "", "6"],
    "the first row has no cell": ["", "1", "", "2", "", "3", ""],
}


@pytest.mark.parametrize("form", UNTIDY)
def test_no_cell_is_filled_where(form):
    rows = [row(number, cell, "7.5") for number, cell in enumerate(UNTIDY[form])]
    assert fill_down(rows, ("J1", "x"), (JOINT, X)) == (tuple(rows), "")


def test_readings_are_never_filled_from_above():
    rows = [
        row(number, f"{number}" if number % 2 == 0 else "", "1.5" * (number % 2 == 0)) for number in range(8)
    ]
    filled = fill_down(rows, ("J1", "x"), (JOINT, X)).rows
    assert [each.cells for each in filled[:2]] == [("0", "1.5"), ("0", "")]


def test_a_state_in_two_of_three_rows_is_not_filled():
    state = Meaning(Quantity("state"))
    words = ("unloaded", "loaded", "")
    rows = [row(n, f"{n}" if n % 3 == 0 else "", words[n % 3]) for n in range(9)]
    filled = fill_down(rows, ("J1", "state"), (JOINT, state)).rows
    assert [each.cells[1] for each in filled[:3]] == ["unloaded", "loaded", ""]


def test_the_empty_joint_of_a_list_is_refused():
    lines = ["label;J1 [deg];P1 dx [mm];P1 dy [mm];P1 dz [mm]", "a;1;2;3;4", "b;;3;3;4", "c;4;5;6;7"]
    assert any("this row has no joint" in each for each in refusals(("a.csv", "\n".join(lines) + "\n")))


# ---- states without names

NOISE = np.random.default_rng(5)
FORCES = ("TCP_force_0", "TCP_force_1", "TCP_force_2")


def pairs(order, load, header="payload", *, noise=1e-5):
    """Yield a header, then the rows of each posture without and under load in an order such as `ul`."""
    yield ["time", *(f"q{i}" for i in range(6)), *FORCES, header]
    for number, own in enumerate(READINGS.joints):
        for state in order[number % len(order)]:
            joints = own + noise * NOISE.uniform(-1.0, 1.0, 6)
            size = load if state == "l" else 0.0
            yield [f"{number}", *cells(joints, 6), *cells(NOISE.normal(0.0, 1.5, 3)), size]


def text_of(rows):
    return "\n".join(" ".join(map(str, row)) for row in rows).encode() + b"\n"


def positions(order):
    rows = [place + SAG * (state == "l") for n, place in enumerate(FIRST) for state in order[n % len(order)]]
    return text_of([["X", "Y", "Z"], *map(cells, rows)])


@pytest.mark.parametrize(
    "order", [["ul"], ["lu"], ["ul", "lu", "lu"]], ids=["unloaded first", "last", "mixed"]
)
@pytest.mark.parametrize("header", ["payload", "load_cell[N]", "Kraft[N]"])
def test_a_column_of_loads_shows_which_rows_are_under_load(order, header, tmp_path):
    (tmp_path / "robot.txt").write_bytes(text_of(pairs(order, 100.0, header)))
    (tmp_path / "points.txt").write_bytes(positions(order))
    proposal = js.read(tmp_path / "robot.txt", tmp_path / "points.txt", robot=ARM, length_unit="mm", **STATED)
    shifts, observations = shifts_of(proposal)
    assert len(observations) == len(FIRST)
    assert np.allclose(shifts["T1"], SAG, atol=2e-3)
    assert "their mean was taken" in str(proposal)


def test_postures_that_occur_twice_with_other_readings_are_no_unloaded_poses(tmp_path):
    rows = [
        " ".join([*cells(joints, 5), *cells(place + shift)])
        for joints, place in zip(READINGS.joints, FIRST, strict=True)
        for shift in (0.0, SAG)
    ]
    (tmp_path / "a.txt").write_text("\n".join(rows[:-1]) + "\n")  # the last posture lacks a row
    with pytest.raises(js.CampaignError, match="row 2 has the joints of row 1, as in 11 of 12 postures"):
        js.read(tmp_path / "a.txt", robot=ARM, encoders="motor")
    assert js.read(tmp_path / "a.txt", robot=ARM, encoders="motor", state="unloaded").accept()


def write_visits(folder, shift=SAG):
    """Write a recording of three rows a posture, taken twice, and points of two targets of each visit."""
    joints = [[*cells(own, 5), run] for run in (0, 1) for own in READINGS.joints for _ in range(3)]
    points = [
        [f"pose{number:02}_load{run}_T{target}", *cells(places[number - 1] + run * shift)]
        for run in (0, 1)
        for number in range(1, 13)
        for target, places in ((1, FIRST), (2, SECOND))
    ]
    header = [*(f"actual_q_{axis}" for axis in range(6)), "register_25"]
    paths = folder / "robot.txt", folder / "points.txt"
    paths[0].write_bytes(text_of([header, *joints]))
    paths[1].write_bytes(text_of([["Name", "X", "Y", "Z"], *points]))
    return paths


def test_two_visits_to_each_posture_are_its_two_states(tmp_path):
    proposal = js.read(*write_visits(tmp_path), robot=ARM, length_unit="mm", **STATED)
    assert "rows with the same joints are one posture" in str(proposal)
    shifts, observations = shifts_of(proposal)
    assert len(observations) == len(FIRST)
    assert all(np.allclose(own, SAG, atol=2e-3) for own in shifts.values())
    assert len(shifts) == 2


def test_visits_whose_targets_move_against_the_force_are_refused(tmp_path):
    with pytest.raises(js.CampaignError, match="the targets then move against `force`"):
        js.read(*write_visits(tmp_path, -SAG), robot=ARM, length_unit="mm", **STATED)


def test_visits_without_a_force_are_no_campaign(tmp_path):
    unknown = {key: value for key, value in STATED.items() if key not in ("force", "units")}
    answer = js.read(*write_visits(tmp_path), robot=ARM, length_unit="mm", **unknown).accept()
    assert answer.measurement_set is None
    assert "force" in answer.missing_fields


def test_visits_with_both_states_are_observations(tmp_path):
    """The arm comes back in the other order, 0.2 mm aside; a visit has readings without and under load."""
    rows = [
        [*cells(own, 5), *cells(place + aside), *cells(place + aside + SAG)]
        for aside, order in ((0.0, 1), (0.2, -1))
        for own, place in zip(READINGS.joints[::order], FIRST[::order], strict=True)
    ]
    header = [
        *(f"axis{number}" for number in range(1, 7)),
        *(f"p{state}{axis}" for state in "01" for axis in "xyz"),
    ]
    (tmp_path / "a.txt").write_bytes(text_of([header, *rows]))
    shifts, observations = shifts_of(js.read(tmp_path / "a.txt", robot=ARM, length_unit="mm", **STATED))
    assert len(observations) == 2 * len(FIRST)
    assert np.allclose(shifts["T1"], SAG, atol=2e-3)


def test_visits_that_differ_by_noise_are_no_states(tmp_path):
    proposal = js.read(*write_visits(tmp_path, 1e-3 * SAG), robot=ARM, length_unit="mm", encoders="motor")
    answer = proposal.accept()
    assert answer.states == ["unloaded"]


def test_folders_tell_files_with_one_name_apart(tmp_path):
    for folder, shift in (("unloaded", 0.0), ("loaded", SAG)):
        (tmp_path / folder).mkdir()
        rows = [" ".join(cells(place + shift)) for place in FIRST]
        (tmp_path / folder / "points.txt").write_text("\n".join(rows))
    (tmp_path / "robot.txt").write_text("\n".join(" ".join(cells(own, 5)) for own in READINGS.joints))
    files = ["robot.txt", "loaded/points.txt", "unloaded/points.txt"]
    proposal = js.read(*(tmp_path / file for file in files), robot=ARM, length_unit="mm", **STATED)
    shifts, _ = shifts_of(proposal)
    assert np.allclose(shifts["T1"], SAG, atol=2e-3)
    with pytest.raises(js.CampaignError, match="two files have this name"):
        js.read(tmp_path / files[0], *2 * [tmp_path / files[1]], robot=ARM, encoders="motor")


def test_repeats_within_noise_are_unloaded_poses(tmp_path):
    rows = [
        " ".join([*cells(joints, 5), *cells(place + shift)])
        for joints, place in zip(READINGS.joints, FIRST, strict=True)
        for shift in (0.0, 0.02)
    ]
    (tmp_path / "a.txt").write_text("\n".join(rows[:-1]) + "\n")
    assert js.read(tmp_path / "a.txt", robot=ARM, encoders="motor").accept()


# ---- notes, displacements, arrays and words


def test_joints_between_slashes_and_labelled_lines_are_postures(tmp_path):
    lines = ["Messprotokoll, Halle 3", "Last = 4 kg", ""]
    for number, degrees in enumerate(DEGREES):
        lines += [f"Pose {number + 1}:  J = ({' / '.join(cells(degrees, 2))})"]
        lines += [f"   ohne Last:  {'  '.join(cells(FIRST[number]))}"]
        lines += [
            f"   mit Last:   {'  '.join(cells(FIRST[number] + SAG))}",
            "   (neu angepeilt)"[: 20 * (number == 2)],
        ]
        lines += [""]
    (tmp_path / "notes.txt").write_text("\n".join(lines).replace(".", ","))
    shifts, observations = shifts_of(js.read(tmp_path / "notes.txt", robot=ARM, length_unit="mm", **STATED))
    assert len(observations) == len(FIRST)
    assert np.allclose(shifts["T1"], SAG, atol=2e-3)


@pytest.mark.parametrize(
    ("words", "unit"),
    [
        ("dX com carga", "mm"),
        ("ΔX", "µm"),
        ("depl. X", "mm"),
        ("Versch. X", "µm"),
        ("X spostamento", "mm"),
    ],
)
def test_displacements_beside_positions_without_load_are_added(words, unit, tmp_path):
    factor = 1e3 if unit == "µm" else 1.0
    header = [*(f"A{i} [°]" for i in range(1, 7)), *(f"{axis} [mm]" for axis in "XYZ")]
    header += [f"{words.replace('X', axis)} [{unit}]" for axis in "XYZ"]
    rows = [
        [*cells(degrees), *cells(place), *cells(factor * SAG)]
        for degrees, place in zip(DEGREES, FIRST, strict=True)
    ]
    (tmp_path / "a.csv").write_bytes(write_csv([header, *rows]))
    shifts, _ = shifts_of(js.read(tmp_path / "a.csv", robot=ARM, length_unit="mm", **STATED))
    assert np.allclose(shifts["T1"], SAG, atol=2e-3)


@pytest.mark.process
@pytest.mark.parametrize("axis_of_targets", [1, 2])
def test_three_targets_of_an_array_are_those_whose_distances_stay(axis_of_targets, tmp_path):
    places = np.stack([FIRST, SECOND, 1e3 * READINGS.position[:, 2]], axis=axis_of_targets)
    sag = SAG[None, None, :] if axis_of_targets == 1 else SAG[None, :, None]
    np.savez(tmp_path / "a.npz", q_deg=DEGREES, P_unloaded=places, P_loaded=places + sag)
    shifts, _ = shifts_of(js.read(tmp_path / "a.npz", robot=ARM, length_unit="mm", **STATED))
    assert len(shifts) == 3
    assert all(np.allclose(shift, SAG, atol=1e-6) for shift in shifts.values())


@pytest.mark.parametrize(
    ("without", "under"), [("bez", "z"), ("zonder", "met"), ("utan", "med"), ("sin", "con")]
)
def test_words_for_without_and_with_of_one_language_are_states(without, under, tmp_path):
    header = [*(f"J{i} [deg]" for i in range(1, 7)), *(f"{axis} {without} xyzzy [mm]" for axis in "XYZ")]
    header += [f"{axis} {under} xyzzy [mm]" for axis in "XYZ"]
    rows = [
        [*cells(degrees), *cells(place), *cells(place + SAG)]
        for degrees, place in zip(DEGREES, FIRST, strict=True)
    ]
    (tmp_path / "a.csv").write_bytes(write_csv([header, *rows]))
    stated = {**STATED, "force": None}
    proposal = js.read(tmp_path / "a.csv", robot=ARM, length_unit="mm", **stated)
    assert "unloaded [mm] and" in str(proposal)


OPPOSITES = [
    ("sem", "com"),
    ("sin", "con"),
    ("senza", "con"),
    ("ohne", "mit"),
    ("sans", "avec"),
    ("utan", "med"),
]


@pytest.mark.parametrize(("without", "under"), OPPOSITES)
@pytest.mark.parametrize("form", ["{axis}_SMR1_{word} [mm]", "SMR1_{word}_{axis} [mm]", "{axis} {word} [mm]"])
def test_words_for_without_and_with_at_names_of_targets_are_states(form, without, under):
    header = ["label", *(f"J{i} [deg]" for i in range(1, 7))]
    header += [form.format(axis=axis, word=word) for word in (without, under) for axis in "xyz"]
    rows = [
        [f"c{number}", *cells(degrees), *cells(place), *cells(place + SAG)]
        for number, (degrees, place) in enumerate(zip(DEGREES, FIRST, strict=True))
    ]
    answer = answered(("a.csv", write_csv([header, *rows])), force=(0, 0, -100), units={"force": "N"})
    assert answer.states == ["unloaded", "loaded"]
    assert answer.targets == ["SMR1" if "SMR1" in form else "a"]
    assert numbers_of(answer)[0][-1] == {answer.targets[0]: (rounded(FIRST[0]), rounded(FIRST[0] + SAG))}


@pytest.mark.parametrize("words", [("sem", "con"), ("sin", "com"), ("com", "con")])
def test_words_of_two_languages_are_asked(words):
    names = [f"{name}_{word}" for name in ("A", "B") for word in words]
    header = ["label", *(f"{axis}_{name} [mm]" for name in names for axis in "xyz")]
    said = refusals(("a.csv", write_csv([header, ["c1", *"123456123456"]])))
    assert any("may be states, but their meaning is unknown" in each for each in said)


@pytest.mark.parametrize(("without", "under"), OPPOSITES)
def test_two_values_of_a_column_for_without_and_with_are_states(without, under, tmp_path):
    rows = [
        [str(number), *cells(degrees), word, *cells(place + sag)]
        for number, (degrees, place) in enumerate(zip(DEGREES, FIRST, strict=True), 1)
        for word, sag in ((under, SAG), (without, 0.0))
    ]
    header = ["Nr", *(f"J{i}" for i in range(1, 7)), "xyzzy", "X", "Y", "Z"]
    (tmp_path / "a.csv").write_bytes(write_csv([header, *rows]))
    shifts, _ = shifts_of(js.read(tmp_path / "a.csv", robot=ARM, length_unit="mm", **STATED))
    assert np.allclose(shifts["T1"], SAG, atol=2e-3)


def test_a_size_of_a_force_is_offered_as_the_force(tmp_path):
    header = [*(f"J{i} [deg]" for i in range(1, 7)), *(f"{axis} bez [mm]" for axis in "XYZ")]
    header += [*(f"{axis} z [mm]" for axis in "XYZ"), "Síla č. 2 [N]"]
    rows = [
        [*cells(degrees), *cells(place), *cells(place + 0.3), "50"]
        for degrees, place in zip(DEGREES, FIRST, strict=True)
    ]
    (tmp_path / "a.csv").write_bytes(write_csv([header, *rows]))
    stated = {name: value for name, value in STATED.items() if name != "force"}
    answer = js.read(tmp_path / "a.csv", robot=ARM, length_unit="mm", **stated).accept()
    assert any("`force` is 0,0,-50N" in each for each in answer.missing)


def test_the_header_of_a_lower_block_names_columns_that_the_upper_header_leaves_open(tmp_path):
    names = ["Punto", *(f"J{i}" for i in range(1, 7)), *"XYZ"]
    rows = [["SIN CARGA"], [*names, "", "", ""]]
    rows += [[*names_of(n), *cells(place), "", "", ""] for n, place in enumerate(FIRST)]
    rows += [["CON CARGA"], [*names, "Fx", "Fy", "Fz"]]
    rows += [[*names_of(n), *cells(place + SAG), "0", "7.5", "-100"] for n, place in enumerate(FIRST)]
    (tmp_path / "a.xlsx").write_bytes(write_workbook(rows, are_merged=False))
    stated = {**STATED, "force": None}
    shifts, observations = shifts_of(js.read(tmp_path / "a.xlsx", robot=ARM, length_unit="mm", **stated))
    assert np.allclose(shifts["T1"], SAG, atol=2e-3)
    assert all(each.force == (0.0, 7.5, -100.0) for each in observations)


@pytest.mark.parametrize("names", [("TB1", "TB2"), ("links", "rechts")])
def test_two_words_beside_columns_of_both_states_are_targets(names, tmp_path):
    states = [f"{axis} {state}" for state in ("no load", "loaded") for axis in "XYZ"]
    rows = []
    for number, degrees in enumerate(DEGREES):
        for row, (name, place) in enumerate(zip(names, (FIRST[number], SECOND[number]), strict=True)):
            inches = [f"{each / 25.4:.5f}" for each in (*place, *(place + SAG))]
            rows.append([str(number + 1), name, *(cells(degrees) if row == 0 else [""] * 6), *inches])
    header = ["Pt", "Ball", *(f"J{i}" for i in range(1, 7)), *states]
    (tmp_path / "a.csv").write_bytes(write_csv([header, *rows]))
    shifts, _ = shifts_of(js.read(tmp_path / "a.csv", robot=ARM, **STATED))
    assert set(shifts) == set(names)
    assert all(np.allclose(shift, SAG, atol=2e-3) for shift in shifts.values())
