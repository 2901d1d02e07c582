"""Files of readings as instruments, controllers and metrologists write them, and whether a campaign is right.

Each form is a function that writes files of a simulated campaign. Nobody who wrote a form knew the reader.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import chain, product
from typing import Any

import numpy as np
from support.measured_arms import PLACES

from jointstiff.service.resources.known_robots import catalogue_robots
from jointstiff.solver.mechanics.postures import Postures

STATES = ("unloaded", "loaded")
GERMAN = ("ohne Last", "mit Last")
JOINTS = [f"J{number}" for number in range(1, 7)]
Files = Mapping[str, str]
Row = list[str]


@dataclass(frozen=True, eq=False)
class Campaign:
    """Readings of three targets of an arm whose zeros are off."""

    arm: str
    joints: Any  # (N, 6) as the controller shows them [deg]
    unloaded: Any  # (N, 3, 3) in R0 [m]
    loaded: Any  # (N, 3, 3)


def simulate(arm: str, seed: int, postures: int) -> Campaign:
    robot = next(each for each in catalogue_robots() if each.name == arm).robot
    generator = np.random.default_rng(seed)
    model = generator.uniform(-1.1, 1.1, (postures, robot.n))
    true = Postures(robot, model + np.radians(0.03) * generator.standard_normal(robot.n))
    unloaded = np.einsum("nij,kj->nki", true.flange_rotation, PLACES) + true.flange_translation[:, None]
    twist = 5e-5 * generator.standard_normal((postures, 1, 3))
    loaded = unloaded + np.cross(twist, unloaded) - [0.0, 0.0, 8e-4]
    noise = 2e-5 * generator.standard_normal((2, *unloaded.shape))
    angles = np.degrees(robot.joint_map.controller_angles(model))
    return Campaign(arm, angles, unloaded + noise[0], loaded + noise[1])


@dataclass(frozen=True)
class Form:
    """A form of files, and the options that a person states besides those of every campaign."""

    write: Callable[[Campaign], Files]
    options: str = ""
    load_count: int = 1  # loads of each posture; a file with several states them
    states_force: bool = True  # whether an option states the force


FORMS: dict[str, Form] = {}


def form(**more: Any) -> Callable[[Callable[[Campaign], Files]], Callable[[Campaign], Files]]:
    def add(write: Callable[[Campaign], Files]) -> Callable[[Campaign], Files]:
        FORMS[write.__name__] = Form(write, **more)
        return write

    return add


def digits(numbers: Any, count: int = 4) -> Row:
    return [f"{number:.{count}f}" for number in numbers]


def table(header: Row, rows: Any, mark: str = ";", *, comma: bool = False) -> str:
    body = "".join(mark.join(map(str, row)) + "\n" for row in rows)
    head = mark.join(header) + "\n" if header else ""
    return head + (body.replace(".", ",") if comma else body)


def places(c: Campaign, target: int = 0, state: int = 0) -> Any:
    return 1e3 * (c.loaded if state else c.unloaded)[:, target]


def deflection(c: Campaign, target: int = 0) -> Any:
    return places(c, target, 1) - places(c, target)


def names(c: Campaign) -> Row:
    return [f"P{number:02}" for number in range(1, len(c.joints) + 1)]


def joint_rows(c: Campaign) -> list[Row]:
    return [[name, *digits(q)] for name, q in zip(names(c), c.joints, strict=True)]


def joints(c: Campaign, headers: Row = JOINTS, label: str = "label", *, comma: bool = False) -> str:
    return table([label, *headers], joint_rows(c), comma=comma)


def points(c: Campaign, state: int, order: Any = None, target: int = 0) -> list[Row]:
    rows = [[name, *digits(p)] for name, p in zip(names(c), places(c, target, state), strict=True)]
    return rows if order is None else [rows[number] for number in order]


def wide(c: Campaign, *blocks: Any, count: int = 4) -> list[Row]:
    more = [
        list(chain.from_iterable(digits(each[number], count) for each in blocks))
        for number in range(len(c.joints))
    ]
    return [[*row, *numbers] for row, numbers in zip(joint_rows(c), more, strict=True)]


def both(c: Campaign, target: int = 0) -> tuple[Any, Any]:
    return places(c, target), places(c, target, 1)


def loads(c: Campaign) -> list[Any]:
    return [places(c), places(c) + 0.5 * deflection(c), places(c, 0, 1)]


def shuffled(c: Campaign, seed: int) -> Any:
    return np.random.default_rng(seed).permutation(len(c.joints))


def in_turn(c: Campaign, words: Any, positions: Any, order: Any = None) -> list[Row]:
    """Return name, joints, word and position of each posture and state, the states of a posture in turn."""
    pairs = list(zip(words, positions, strict=True))
    rows = joint_rows(c)
    chosen = pairs if order is None else [pairs[number] for number in order]
    return [
        [*rows[number], str(word), *digits(p[number])] for number in range(len(rows)) for word, p in chosen
    ]


# ---- a row for each point and axis


def by_axis(c: Campaign, state: int, name: Callable[[str], str], target: int = 0) -> list[Row]:
    rows = []
    for label, p in zip(names(c), places(c, target, state), strict=True):
        for axis in range(3):
            nominal = round(float(p[axis]))
            rows.append([name(label), "XYZ"[axis], *digits([nominal, p[axis], p[axis] - nominal])])
    return rows


@form()
def axes_of_polyworks(c: Campaign) -> Files:
    rows = chain.from_iterable(
        by_axis(c, state, lambda label, k=k, s=state: f"{label}_T{k}_{STATES[s]}", k)
        for k, state in product((0, 1), (0, 1))
    )
    header = ["Name", "Control", "Nominal", "Measured", "Deviation"]
    return {"joints.csv": joints(c), "report.csv": table(header, rows, ",")}


@form()
def axes_below_titles_with_units(c: Campaign) -> Files:
    rows = [
        [*row, "-0.1", "Pass"]
        for state in (0, 1)
        for row in by_axis(c, state, lambda label, s=state: f"{label}_{STATES[s]}")
    ]
    header = ["Object Name", "Axis", "Nom [mm]", "Meas [mm]", "Dev [mm]", "Lower Tol", "Test"]
    titles = "Project:,Robot stiffness,,,,,\nUnits:,mm,,,,,\n"
    return {"joints.csv": joints(c), "report.csv": titles + table(header, rows, ",")}


@form()
def axes_in_german_files(c: Campaign) -> Files:
    header = ["Punkt", "Achse", "Soll", "Ist", "Abw."]
    tables = [table(header, by_axis(c, state, str), comma=True) for state in (0, 1)]
    angles = joints(c, [f"A{n} [Grad]" for n in range(1, 7)], "Punkt", comma=True)
    return {"achsen.csv": angles, "unbelastet.csv": tables[0], "belastet.csv": tables[1]}


# ---- blocks


@form()
def blocks_of_joints_and_states(c: Campaign) -> Files:
    text = "# joints\n" + table(JOINTS, [row[1:] for row in joint_rows(c)])
    for state in (1, 0):
        text += f"\n# {STATES[state]}\n" + table(["X", "Y", "Z"], [row[1:] for row in points(c, state)])
    return {"all.csv": text}


@form()
def blocks_without_words(c: Campaign) -> Files:
    blocks = [joint_rows(c), points(c, 0), points(c, 1)]
    return {"all.txt": "\n".join(table([], [row[1:] for row in block], " ") for block in blocks)}


@form()
def blocks_with_the_loaded_one_first(c: Campaign) -> Files:
    header = [*JOINTS, "X", "Y", "Z"]
    parts = [
        f"{GERMAN[state]}\n" + table(header, [row[1:] for row in wide(c, places(c, 0, state))], comma=True)
        for state in (1, 0)
    ]
    return {"all.csv": "\n".join(parts)}


@form()
def a_block_for_each_posture(c: Campaign) -> Files:
    text = ""
    for number, q in enumerate(c.joints):
        text += f"Posture {number + 1}\njoints;" + ";".join(digits(q)) + "\n"
        for k, state in product((0, 1), (0, 1)):
            text += f"T{k + 1};{STATES[state]};" + ";".join(digits(places(c, k, state)[number])) + "\n"
        text += "\n"
    return {"postures.txt": text}


@form()
def a_block_with_headers_for_each_posture(c: Campaign) -> Files:
    text = "Messprotokoll\n\n"
    for number, q in enumerate(c.joints):
        text += f"Stellung {number + 1}\n" + table([f"A{n}" for n in range(1, 7)], [digits(q)], comma=True)
        rows = [
            [f"T{k + 1}", GERMAN[state], *digits(places(c, k, state)[number])]
            for k, state in product((0, 1), (0, 1))
        ]
        header = ["Target", "Zustand", "X [mm]", "Y [mm]", "Z [mm]"]
        text += ";".join(header) + "\n"
        text += "".join(
            ";".join([*row[:2], *(cell.replace(".", ",") for cell in row[2:])]) + "\n" for row in rows
        )
        text += "\n"
    return {"protokoll.csv": text}


@form()
def a_block_for_each_target(c: Campaign) -> Files:
    text = joints(c, label="Pose")
    for k in (0, 1):
        rows = [
            [*unloaded, *loaded[1:]]
            for unloaded, loaded in zip(points(c, 0, target=k), points(c, 1, target=k), strict=True)
        ]
        text += f"\nTarget T{k + 1}\n" + table(["Pose", "X0", "Y0", "Z0", "X1", "Y1", "Z1"], rows)
    return {"targets.csv": text}


# ---- metres and millimetres


@form()
def metres_and_millimetres_in_headers(c: Campaign) -> Files:
    header = [
        "label",
        *(f"{joint} [deg]" for joint in JOINTS),
        *(
            f"T1 {state} {axis} [{unit}]"
            for state, unit in zip(STATES, ("m", "mm"), strict=True)
            for axis in "xyz"
        ),
    ]
    return {"mix.csv": table(header, wide(c, places(c) / 1e3, places(c, 0, 1), count=7))}


@form()
def metres_and_millimetres_without_headers(c: Campaign) -> Files:
    rows = [row[1:] for row in wide(c, places(c) / 1e3, places(c, 0, 1), count=7)]
    return {"mix.txt": table([], rows, " ")}


@form()
def a_file_in_metres_and_one_in_millimetres(c: Campaign) -> Files:
    in_metres = [digits(p / 1e3, 7) for p in places(c)]
    return {
        "j.txt": table([], [row[1:] for row in joint_rows(c)], " "),
        "unloaded.txt": table([], in_metres, " "),
        "loaded.txt": table([], [row[1:] for row in points(c, 1)], " "),
    }


@form()
def nominal_in_metres_and_measured_in_millimetres(c: Campaign) -> Files:
    header = [
        "Pose",
        *JOINTS,
        *(f"{axis}nom" for axis in "XYZ"),
        *(f"{axis}{s}" for s in "01" for axis in "XYZ"),
    ]
    return {"mix.csv": table(header, wide(c, np.round(places(c)) / 1e3, *both(c), count=6))}


# ---- JSON


@form()
def lines_of_json(c: Campaign) -> Files:
    lines = []
    for number, q in enumerate(c.joints.tolist()):
        record: dict[str, Any] = {"pose": names(c)[number]}
        record |= {f"j{n}": round(angle, 4) for n, angle in enumerate(q, 1)}
        for state in (0, 1):
            place = places(c, 0, state)[number].tolist()
            record |= {f"{axis}_{STATES[state]}": round(x, 4) for axis, x in zip("xyz", place, strict=True)}
        lines.append(json.dumps(record) + "\n")
    return {"log.jsonl": "".join(lines)}


@form()
def an_array_of_json(c: Campaign) -> Files:
    records = [
        {
            "id": number + 1,
            "timestamp": f"2026-03-01T10:{number:02}:00Z",
            "joints_deg": np.round(q, 4).tolist(),
            **{f"{STATES[state]}_mm": np.round(places(c, 0, state)[number], 4).tolist() for state in (0, 1)},
        }
        for number, q in enumerate(c.joints)
    ]
    return {"log.json": json.dumps(records, indent=1)}


@form()
def json_with_targets_in_a_document(c: Campaign) -> Files:
    records = [
        {
            "posture": names(c)[number],
            "joints": dict(zip(JOINTS, np.round(q, 4).tolist(), strict=True)),
            "targets": {
                f"T{k + 1}": {
                    STATES[state]: dict(
                        zip("xyz", np.round(places(c, k, state)[number], 4).tolist(), strict=True)
                    )
                    for state in (0, 1)
                }
                for k in (0, 1)
            },
        }
        for number, q in enumerate(c.joints)
    ]
    return {"log.json": json.dumps({"robot": c.arm, "date": "2026-03-01", "measurements": records})}


@form()
def json_with_a_row_for_each_state(c: Campaign) -> Files:
    lines = [
        json.dumps(
            {
                "t": 1.5 * number + state,
                "q": np.round(np.radians(q), 7).tolist(),
                "payload": ("none", "100kg")[state],
                "tcp": dict(zip("xyz", np.round(places(c, 0, state)[number] / 1e3, 7).tolist(), strict=True)),
            }
        )
        for number, q in enumerate(c.joints)
        for state in (0, 1)
    ]
    return {"log.jsonl": "\n".join(lines) + "\n"}


# ---- displacements under load


def displaced(c: Campaign, header: Row, factor: float = 1.0, count: int = 4, *, comma: bool = False) -> Files:
    rows = [
        [*row, *digits(factor * d, count)] for row, d in zip(wide(c, places(c)), deflection(c), strict=True)
    ]
    return {"dx.csv": table(["Pose", *JOINTS, *header], rows, comma=comma)}


@form()
def displacements_without_units(c: Campaign) -> Files:
    return displaced(c, ["X", "Y", "Z", "dX", "dY", "dZ"])


@form()
def displacements_in_micrometres(c: Campaign) -> Files:
    header = [*(f"{axis} [mm]" for axis in "XYZ"), *(f"d{axis} [µm]" for axis in "XYZ")]
    return displaced(c, header, 1e3, 1)


@form()
def displacements_in_micrometres_without_units(c: Campaign) -> Files:
    return displaced(c, ["X", "Y", "Z", "dX", "dY", "dZ"], 1e3, 1, comma=True)


@form()
def displacements_below_a_row_of_units(c: Campaign) -> Files:
    joints_and_positions = [*["deg"] * 6, *["mm"] * 3]
    units = ["", *joints_and_positions, *["µm"] * 3]
    rows = wide(c, places(c), 1e3 * deflection(c))
    return {"dx.csv": table(["#", *JOINTS, *"XYZ", "dX", "dY", "dZ"], [units, *rows])}


@form()
def displacements_in_german(c: Campaign) -> Files:
    header = [f"{word} {axis} [mm]".strip() for word in ("", "Verschiebung") for axis in "XYZ"]
    return displaced(c, header, comma=True)


@form(options="--header 'J1;J2;J3;J4;J5;J6;X;Y;Z;dX;dY;dZ'")
def displacements_with_a_stated_header(c: Campaign) -> Files:
    rows = [row[1:] for row in wide(c, places(c), deflection(c))]
    return {"dx.txt": table([], rows, "\t")}


# ---- numbers behind their names


@form()
def a_report_of_metrolog_in_lines(c: Campaign) -> Files:
    text = "METROLOG XG 18\nUnit: mm\n\n"
    for number, state in product(range(len(c.joints)), (0, 1)):
        x, y, z = digits(places(c, 0, state)[number])
        text += f"Point : {names(c)[number]}_{STATES[state]}\n  X = {x}\n  Y = {y}\n  Z = {z}\n\n"
    return {"joints.csv": joints(c), "report.txt": text}


@form()
def names_and_values_in_a_line(c: Campaign) -> Files:
    text = ""
    for number, state in product(range(len(c.joints)), (0, 1)):
        angles = " ".join(f"A{n}={angle:.4f}" for n, angle in enumerate(c.joints[number], 1))
        x, y, z = digits(places(c, 0, state)[number])
        text += f"N={number + 1} {angles} Last={('ohne', 'mit')[state]} X={x} Y={y} Z={z}\n"
    return {"log.txt": text}


@form()
def names_and_values_by_colons(c: Campaign) -> Files:
    text = ""
    for number, q in enumerate(c.joints):
        pairs = [("Pose", str(number + 1)), *zip(JOINTS, digits(q), strict=True)]
        for state in (0, 1):
            axes = [f"{axis}{state}" for axis in "XYZ"]
            pairs += zip(axes, digits(places(c, 0, state)[number]), strict=True)
        text += ", ".join(f"{name}: {value}" for name, value in pairs) + "\n"
    return {"log.txt": text}


# ---- a column for each posture


def turned(c: Campaign, angle: Callable[[int], Row], place: Callable[[int, str], Row]) -> list[Row]:
    rows = [[*angle(n + 1), *digits(c.joints[:, n])] for n in range(6)]
    return rows + [
        [*place(state, "XYZ"[axis]), *digits(places(c, 0, state)[:, axis])]
        for state in (0, 1)
        for axis in range(3)
    ]


@form()
def columns_of_postures(c: Campaign) -> Files:
    rows = turned(c, lambda n: [f"J{n} [deg]"], lambda state, axis: [f"{axis} {STATES[state]} [mm]"])
    return {"t.csv": table(["", *names(c)], rows)}


@form()
def columns_of_postures_without_labels(c: Campaign) -> Files:
    rows = turned(c, lambda n: [f"A{n}"], lambda state, axis: [f"{axis}{state}"])
    return {"t.csv": table([], rows, comma=True)}


@form()
def columns_of_postures_with_units(c: Campaign) -> Files:
    rows = turned(c, lambda n: [f"Achse {n}", "°"], lambda state, axis: [f"{axis} {GERMAN[state]}", "mm"])
    header = ["Größe", "Einheit", *(str(n) for n in range(1, len(c.joints) + 1))]
    return {"t.csv": table(header, rows, comma=True)}


# ---- several loads


@form(load_count=2, states_force=False)
def loads_in_a_column(c: Campaign) -> Files:
    header = ["Pose", *JOINTS, "Load [kg]", "X", "Y", "Z"]
    return {"loads.csv": table(header, in_turn(c, (0, 50, 100), loads(c), (2, 0, 1)))}


@form(load_count=2, states_force=False)
def loads_in_words(c: Campaign) -> Files:
    header = ["Pose", *JOINTS, "Load", "X", "Y", "Z"]
    return {"loads.csv": table(header, in_turn(c, ("unloaded", "50 kg", "100 kg"), loads(c)))}


@form(load_count=2, states_force=False)
def loads_in_headers(c: Campaign) -> Files:
    header = ["Pose", *JOINTS, *(f"{axis} {mass}kg" for mass in (0, 50, 100) for axis in "XYZ")]
    return {"loads.csv": table(header, wide(c, *loads(c)))}


@form(load_count=2, states_force=False)
def loads_in_titles_of_blocks(c: Campaign) -> Files:
    header = ["Pose", *JOINTS, "X", "Y", "Z"]
    parts = [
        f"Load: {word}\n" + table(header, wide(c, p))
        for word, p in zip(("without load", "50 kg", "100 kg"), loads(c), strict=True)
    ]
    return {"loads.csv": "\n".join(parts)}


@form(load_count=2, states_force=False)
def loads_in_names_of_files(c: Campaign) -> Files:
    files = {"joints.csv": joints(c)}
    for mass, p in reversed(list(zip((0, 50, 100), loads(c), strict=True))):
        rows = [[name, *digits(place)] for name, place in zip(names(c), p, strict=True)]
        files[f"points_{mass}kg.csv"] = table(["Name", "X", "Y", "Z"], rows)
    return files


@form(load_count=2, states_force=False)
def loads_in_columns_of_forces(c: Campaign) -> Files:
    words = [f"0;0;{-9.80665 * mass:.3f}" for mass in (0, 50, 100)]
    header = ["Pose", *JOINTS, "Fx [N]", "Fy [N]", "Fz [N]", "X", "Y", "Z"]
    return {"loads.csv": table(header, in_turn(c, words, loads(c)))}


@form(states_force=False)
def forces_with_decimal_commas(c: Campaign) -> Files:
    weight = np.tile([0.0, 0.0, -981.0], (len(c.joints), 1))
    header = ["Pose", *(f"{j} [°]" for j in JOINTS), "Fx [N]", "Fy [N]", "Fz [N]"]
    header += [f"{axis} {state} [mm]" for state in GERMAN for axis in "XYZ"]
    return {"Messung_01.csv": table(header, wide(c, weight, *both(c)), comma=True)}


# ---- states, targets and observations in words


@form()
def states_in_a_column_with_the_loaded_first(c: Campaign) -> Files:
    header = ["Pose", *JOINTS, "Zustand", "X", "Y", "Z"]
    return {"a.csv": table(header, in_turn(c, GERMAN, both(c), (1, 0)))}


@form()
def states_by_unknown_words_in_their_order(c: Campaign) -> Files:
    header = ["Pose", *JOINTS, "Zustand", "X", "Y", "Z"]
    return {"a.csv": table(header, in_turn(c, ("B", "A"), both(c)))}


@form()
def targets_and_states_in_shuffled_rows(c: Campaign) -> Files:
    rows = [
        [name, f"SMR{k + 1}", STATES[state], *digits(places(c, k, state)[number])]
        for number, name in enumerate(names(c))
        for k, state in product((0, 1), (0, 1))
    ]
    order = np.random.default_rng(9).permutation(len(rows))
    shuffled_rows = [rows[number] for number in order]
    header = ["Pose", "Target", "State", "X", "Y", "Z"]
    return {"joints.csv": joints(c), "points.csv": table(header, shuffled_rows)}


@form()
def names_with_unknown_words(c: Campaign) -> Files:
    rows = [
        [f"{name}-T{k + 1}-{'AB'[state]}", *digits(places(c, k, state)[number])]
        for number, name in enumerate(names(c))
        for k, state in product((0, 1), (0, 1))
    ]
    header = ["Name", "X [mm]", "Y [mm]", "Z [mm]"]
    return {"joints.csv": joints(c), "points.csv": table(header, rows)}


@form()
def times_and_an_operator(c: Campaign) -> Files:
    rows = [
        [f"2026-03-01 10:{n:02}:{30 * s:02}", "Huber", *digits(q), *digits(places(c, 0, s)[n]), STATES[s]]
        for n, q in enumerate(c.joints)
        for s in (0, 1)
    ]
    header = ["Time", "Operator", *JOINTS, "X", "Y", "Z", "State"]
    return {"log.csv": table(header, rows, ",")}


@form()
def rows_of_files_in_other_orders(c: Campaign) -> Files:
    header = ["Pose", "X", "Y", "Z"]
    return {
        "mit_last.csv": table(header, points(c, 1, shuffled(c, 3))),
        "ohne_last.csv": table(header, points(c, 0, shuffled(c, 4))),
        "achsen.csv": joints(c, label="Pose"),
    }


@form()
def rows_in_other_orders_without_headers(c: Campaign) -> Files:
    return {
        "j.txt": table([], joint_rows(c), " "),
        "a.txt": table([], points(c, 0, shuffled(c, 3)), " "),
        "b.txt": table([], points(c, 1, shuffled(c, 4)), " "),
    }


@form()
def joints_in_both_files_in_other_orders(c: Campaign) -> Files:
    header = ["Pos", *JOINTS, "X", "Y", "Z"]
    loaded = wide(c, places(c, 0, 1))
    return {
        "vorher.csv": table(header, wide(c, places(c))),
        "nachher.csv": table(header, [loaded[number] for number in shuffled(c, 5)]),
    }


@form(options="--mean-of-repeats")
def repeated_readings(c: Campaign) -> Files:
    header = ["Pose", *JOINTS, "Zustand", "X", "Y", "Z"]
    shift = np.array([0.01, -0.01, 0.02])
    positions = [p + k * shift for p in both(c) for k in (-1, 0, 1)]
    return {"a.csv": table(header, in_turn(c, np.repeat(GERMAN, 3), positions))}


@form(load_count=2, states_force=False)
def loads_and_a_reading_after_unloading(c: Campaign) -> Files:
    header = ["Pose", *JOINTS, "Load", "X", "Y", "Z"]
    after = places(c) + 0.01
    return {"loads.csv": table(header, in_turn(c, ("0 kg", "50 kg", "100 kg", "0 kg"), [*loads(c), after]))}


@form()
def joints_that_differ_by_the_last_digit(c: Campaign) -> Files:
    header = ["Pose", *JOINTS, "Zustand", "X", "Y", "Z"]
    rows = in_turn(c, GERMAN, both(c))
    for row in rows[1::2]:
        row[2] = f"{float(row[2]) + 3e-4:.4f}"
    return {"a.csv": table(header, rows)}


@form()
def displacements_in_another_file(c: Campaign) -> Files:
    moved = [[name, *digits(d)] for name, d in zip(names(c), deflection(c), strict=True)]
    return {
        "a.csv": table(["Pose", *JOINTS, "X", "Y", "Z"], wide(c, places(c))),
        "d.csv": table(["Pose", "dX", "dY", "dZ"], moved[::-1]),
    }


@form()
def arrays_of_json(c: Campaign) -> Files:
    arrays = {"joints": c.joints, "unloaded": places(c), "loaded": places(c, 0, 1)}
    return {"a.json": json.dumps({name: np.round(each, 4).tolist() for name, each in arrays.items()})}


@form()
def titles_between_postures(c: Campaign) -> Files:
    text = ""
    for number, q in enumerate(c.joints):
        text += f"--- Pose {number + 1} ---\nJoints: {' '.join(digits(q))}\n"
        for state in (0, 1):
            text += f"{STATES[state].title()}: {' '.join(digits(places(c, 0, state)[number]))}\n"
    return {"log.txt": text}


# ---- headers


@form()
def units_and_other_columns(c: Campaign) -> Files:
    rows = [[*row[:10], "0.012", "21.3", *row[10:], "0.013", "ok"] for row in wide(c, *both(c))]
    header = [
        "Pose",
        *(f"{joint} (°)" for joint in JOINTS),
        "X [mm]",
        "Y [mm]",
        "Z [mm]",
        "RMS [mm]",
        "Temp [°C]",
    ]
    return {"a.csv": table([*header, "X' [mm]", "Y' [mm]", "Z' [mm]", "RMS' [mm]", "Remark"], rows)}


@form()
def a_header_of_two_rows_with_numbers(c: Campaign) -> Files:
    header = "Pose;Achsen;;;;;;mit Last;;;ohne Last;;\n;1;2;3;4;5;6;x;y;z;x;y;z\n"
    return {"a.csv": header + table([], wide(c, places(c, 0, 1), places(c)))}


# ---- words of loads


def in_turn_below(c: Campaign, header: str, words: Any) -> Files:
    rows = in_turn(c, words, both(c))
    return {"loads.csv": table(["Pose", *JOINTS, header, *"XYZ"], rows)}


@form()
def answers_below_a_load(c: Campaign) -> Files:
    return in_turn_below(c, "Load", ("no", "yes"))


@form()
def digits_below_a_load(c: Campaign) -> Files:
    return in_turn_below(c, "Last", (0, 1))


@form()
def a_force_or_none(c: Campaign) -> Files:
    return in_turn_below(c, "load", ("none", "981N"))


@form()
def a_force_of_numbers(c: Campaign) -> Files:
    return in_turn_below(c, "Charge [N]", (0, 981))


@form()
def italian_words(c: Campaign) -> Files:
    return in_turn_below(c, "stato", ("vuoto", "carico"))


@form()
def repeats_with_a_number(c: Campaign) -> Files:
    states = np.repeat(("leer", "beladen"), 3)
    positions = [places(c, 0, int(number >= 3)) for number in range(6)]
    rows = [
        [*row[:8], str(number % 3 + 1), *row[8:]] for number, row in enumerate(in_turn(c, states, positions))
    ]
    return {"a.csv": table(["Stellung", *JOINTS, "Zustand", "Wiederholung", *"XYZ"], rows)}


@form()
def repeats_with_the_loaded_ones_first(c: Campaign) -> Files:
    states = np.repeat(("yes", "no"), 3)
    positions = [places(c, 0, int(number < 3)) for number in range(6)]
    rows = [
        [*row[:8], str(number % 3 + 1), *row[8:]] for number, row in enumerate(in_turn(c, states, positions))
    ]
    return {"a.csv": table(["Pose", *JOINTS, "Load", "Rep", *"XYZ"], rows)}


@form()
def short_words_in_names_of_points(c: Campaign) -> Files:
    rows = [
        [f"{name}_T1_{('unl', 'load')[state]}", *row[1:]]
        for state in (0, 1)
        for name, row in zip(names(c), points(c, state), strict=True)
    ]
    return {"joints.csv": joints(c), "points.csv": table(["Name", *"XYZ"], rows)}


@form(states_force=False)
def a_force_along_z_alone(c: Campaign) -> Files:
    rows = [[*row[:7], "-981", *row[7:]] for row in wide(c, places(c), deflection(c))]
    return {"a.csv": table(["Nr", *JOINTS, "Fz [N]", *"XYZ", "dX", "dY", "dZ"], rows)}


@form()
def names_with_and_without_zeros(c: Campaign) -> Files:
    rows = [
        [f"{number:02}-A-{('unbelastet', 'belastet')[state]}", *row[1:]]
        for state in (0, 1)
        for number, row in enumerate(points(c, state), 1)
    ]
    angles = [[str(number), *row[1:]] for number, row in enumerate(joint_rows(c), 1)]
    return {"joints.csv": table(["Pose", *JOINTS], angles), "points.csv": table(["ID", *"XYZ"], rows)}


# ---- logs and notes


def by_state(c: Campaign) -> dict[str, str]:
    """Return a file of points for each state, with the same names."""
    return {f"{word}.csv": table(["Name", *"XYZ"], points(c, state)) for state, word in enumerate(STATES)}


@form()
def degrees_in_cells(c: Campaign) -> Files:
    angles = [[name, *(f"{angle}°" for angle in row)] for name, *row in joint_rows(c)]
    places_in_mm = {
        f"{word}.csv": table(
            ["Name", *"XYZ"], [[name, *(f"{x} mm" for x in row)] for name, *row in points(c, state)]
        )
        for state, word in enumerate(STATES)
    }
    return {"joints.csv": table(["Pose", *JOINTS], angles)} | places_in_mm


@form()
def a_log_of_joint_targets(c: Campaign) -> Files:
    external = ",".join(["9E+09"] * 6)
    lines = [f"10:{n:02}:00 [[{','.join(digits(q))}],[{external}]]\n" for n, q in enumerate(c.joints)]
    return {"joints.log": "".join(lines)} | by_state(c)


@form()
def names_before_numbers_of_a_pendant(c: Campaign) -> Files:
    lines = [
        f"{name}: " + "  ".join(f"J{n} {angle}" for n, angle in enumerate(row, 1)) + "\n"
        for name, *row in joint_rows(c)
    ]
    return {"pendant.txt": "".join(lines)} | by_state(c)


@form()
def a_notebook_with_titles_and_signs(c: Campaign) -> Files:
    text = "Stiffness test, cell B, 12 May\nTracker, 2 nests (A, B), 100 kg plate on flange\n\n"
    for number, q in enumerate(c.joints):
        text += f"Posture {number + 1}\n  " + " ".join(f"J{n}={x}" for n, x in enumerate(digits(q), 1)) + "\n"
        for k, state in product((0, 1), (0, 1)):
            x, y, z = digits(places(c, k, state)[number])
            text += f"  {'AB'[k]} {STATES[state]}: X {x}  Y {y}  Z {z}\n"
        text += "\n"
    return {"notebook.txt": text}


@form()
def a_file_for_each_posture(c: Campaign) -> Files:
    files = {}
    for number, q in enumerate(c.joints):
        text = f"joints [deg]: {' '.join(digits(q))}\n"
        for k, state in product((0, 1), (0, 1)):
            text += f"T{k + 1} {STATES[state]} {' '.join(digits(places(c, k, state)[number]))}\n"
        files[f"pose_{number + 1}.txt"] = text
    return files


@form()
def messages_of_ros_in_yaml(c: Campaign) -> Files:
    text = ""
    for number, q in enumerate(np.radians(c.joints)):
        text += f"header:\n  stamp:\n    sec: {number}\n  frame_id: base\nname:\n"
        text += "".join(f"- axis_{n}\n" for n in range(1, 7)) + "position:\n"
        text += "".join(f"- {x}\n" for x in digits(q, 7)) + "velocity: []\n---\n"
    rows = in_turn(c, ("free", "loaded"), both(c))
    points_in_turn = [[row[0], *row[7:]] for row in rows]
    return {"states.yaml": text, "points.csv": table(["pose", "state", *"xyz"], points_in_turn)}


@form(states_force=False)
def displacements_beside_forces(c: Campaign) -> Files:
    forces = np.tile([0.0, 0.0, -981.0], (len(c.joints), 1))
    header = ["label", *JOINTS, *(f"F{axis} [N]" for axis in "abc"), *"XYZ", "dX", "dY", "dZ"]
    return {"dx.csv": table(header, wide(c, forces, places(c), deflection(c)))}


@form()
def coordinates_with_a_column_for_each_state(c: Campaign) -> Files:
    before, after = (by_axis(c, state, str) for state in (0, 1))
    rows = [[*first[:2], first[3], second[3]] for first, second in zip(before, after, strict=True)]
    return {"joints.csv": joints(c), "sphere.csv": table(["label", "axis", "before", "after"], rows)}


@form()
def names_and_joints_in_the_first_row_of_a_posture(c: Campaign) -> Files:
    rows = in_turn(c, ("off", "on"), both(c))
    for row in rows[1::2]:
        row[:7] = [""] * 7
    return {"once.csv": table(["posture", *JOINTS, "load", *"xyz"], rows)}


@form()
def names_with_blanks_between_tabs(c: Campaign) -> Files:
    header = ["Pose", *(f"Axis {number} (deg)" for number in range(1, 7))]
    words = ("at rest", "under load")
    rows = [[row[0], f"Target {k + 1}", *row[7:]] for k in (0, 1) for row in in_turn(c, words, both(c, k))]
    points_of_targets = table(["Pose", "Target", "State", "X (mm)", "Y (mm)", "Z (mm)"], rows, "\t")
    return {"axes.txt": table(header, joint_rows(c), "\t"), "points.txt": points_of_targets}


@form(states_force=False)
def a_mass_or_zero(c: Campaign) -> Files:
    rows = in_turn(c, ("0", "100"), both(c))
    return {"masses.csv": table(["posture", *JOINTS, "peso [kg]", *"XYZ"], rows)}


@form()
def arrays_of_json_with_names_of_columns(c: Campaign) -> Files:
    rows = [[float(number) for number in row[1:]] for row in wide(c, *both(c))]
    return {"a.json": json.dumps({"columns": [*JOINTS, *"uvwxyz"], "data": rows})}


# ---- the judgement


def judge(c: Campaign, document: Mapping[str, Any], load_count: int = 1) -> list[str]:
    """Return what a measurement set has wrong: joints, positions without load, and deflections by 2 µm."""
    wrong, found = list[str](), set[tuple[int, int, int]]()
    length = {"m": 1.0, "mm": 1e-3}[document["units"]["length"]]
    for each in document["observations"]:
        angles = np.array(each["joints"])
        if document["units"]["angle"] == "rad":
            angles = np.degrees(angles)
        posture = int(np.abs(c.joints - angles).max(axis=1).argmin())
        newtons = {"N": 1.0, "kgf": 9.80665}[document["units"]["force"]]
        load = 2 if load_count == 1 else round(newtons * abs(each["force"][2]) / (50 * 9.80665))
        for reading in each["readings"]:
            unloaded, loaded = (length * np.array(reading[state]) for state in STATES)
            target = int(np.linalg.norm(c.unloaded[posture] - unloaded, axis=1).argmin())
            full = c.loaded[posture, target] - c.unloaded[posture, target]
            found.add((posture, target, load))
            differences = {
                "joints": 1e-3 * np.abs(c.joints[posture] - angles).max(),
                "position": np.linalg.norm(c.unloaded[posture, target] - unloaded),
                "deflection": np.linalg.norm(loaded - unloaded - 0.5 * load * full),
            }
            wrong += [f"{each['label']}: {name}" for name, size in differences.items() if not size < 2e-6]
    expected = len(c.joints) * load_count * len({target for _, target, _ in found})
    return wrong + ([] if len(found) == expected else [f"{len(found)} of {expected} readings"])
