"""Files that are no tables are read by their repeated places: lines, records, sheets and objects."""

import io
import json
from itertools import chain

import openpyxl
import pytest
from support.strange_files import judge, simulate

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=11, postures=9)
POSTURES = range(len(CAMPAIGN.joints))
STATED = {
    "encoders": "motor", "load_point": [0, 0, 120], "force": [0, 0, -981], "units": {"force": "N"},
    "length_unit": "mm",
}  # fmt: skip


def angles_of(posture):
    return [round(float(each), 4) for each in CAMPAIGN.joints[posture]]


def place_of(posture, target, state):
    positions = CAMPAIGN.loaded if state else CAMPAIGN.unloaded
    return [round(1e3 * float(each), 4) for each in positions[posture, target]]


def join(numbers, mark=" "):
    return mark.join(map(str, numbers))


def with_commas(numbers, mark="  "):
    return join(numbers, mark).replace(".", ",")


def write_notes():
    """Return notes of a block for each posture, with decimal commas and remarks."""
    lines = ["Prüfung der Steifigkeit", "Datum: 14.09.2023, Gewicht 100 kg", ""]
    for k in POSTURES:
        axes = [
            f"{name} = {with_commas([number])}" for name, number in zip("XYZ", place_of(k, 0, 0), strict=True)
        ]
        under_load = [
            f"{name} = {with_commas([number])}" for name, number in zip("XYZ", place_of(k, 0, 1), strict=True)
        ]
        lines += [
            f"Stellung {k + 1}",
            "   Achsen (A1-A6): " + "  ".join(f"{with_commas([each])}°" for each in angles_of(k)),
            "   ohne Last: " + "  ".join(axes),
            "   mit Last: " + "  ".join(under_load),
            *(["   Anm.: 2 min gewartet"] if k == 3 else []),
            "",
        ]
    return {"notes.txt": "\n".join(lines)}


def write_job():
    """Return a program with a line of joints for each posture, and a table of positions with its names."""
    job = [f"C{k:05}={join(angles_of(k), ',')}" for k in POSTURES]
    moves = chain.from_iterable((f"MOVJ C{k:05} VJ=10.00", "TIMER T=30.00") for k in POSTURES)
    rows = [f"C{k:05}\t{join([*place_of(k, 0, 0), *place_of(k, 0, 1)], chr(9))}" for k in POSTURES]
    return {
        "JOB.JBI": "\n".join(
            ["/JOB", "///NPOS 9,0,0,0,0,0", "///TOOL 0", *job, "//INST", "NOP", *moves, "END"]
        ),
        "tracker.txt": "\n".join(["# tracker, mm", "pos\tx\ty\tz\tx_load\ty_load\tz_load", *rows]),
    }


def build_document():
    poses = [
        {
            "id": k + 1,
            "q": angles_of(k),
            "tracker": {
                state: {f"SMR{t + 1}": place_of(k, t, number) for t in range(2)}
                for number, state in enumerate(("no_payload", "payload"))
            },
        }
        for k in POSTURES
    ]
    return {"experiment": "static", "payload_kg": 100, "poses": poses}


def write_json():
    return {"readings.json": json.dumps(build_document(), indent=1)}


def write_yaml():
    lines = ["experiment: static", "poses:"]
    for each in build_document()["poses"]:
        lines += [f"  - id: {each['id']}", f"    q: [{join(each['q'], ', ')}]"]
        for state, name in (("no_payload", "before"), ("payload", "under")):
            lines.append(f"    {name}:")
            lines += [f"      {t}: [{join(p, ', ')}]" for t, p in each["tracker"][state].items()]
    return {"readings.yaml": "\n".join(lines)}


def write_xml():
    rows = [
        f'<pose n="{k + 1}"><axes>{join(angles_of(k))}</axes></pose>\n'
        f"<unloaded>{join(place_of(k, 0, 0))}</unloaded>\n<loaded>{join(place_of(k, 0, 1))}</loaded>"
        for k in POSTURES
    ]
    return {"readings.xml": "\n".join(['<?xml version="1.0"?>', "<run>", *rows, "</run>"])}


def workbook(sheets):
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    content = io.BytesIO()
    book.save(content)
    return content.getvalue()


def write_form(k):
    """Return the rows of a form: joints below each other, beside rows of targets and states."""
    beside = [
        ["Bersaglio", "Stato", "X", "Y", "Z"],
        *(
            [f"SMR{t + 1}", word, *place_of(k, t, s)]
            for t in range(2)
            for s, word in enumerate(("scarico", "carico"))
        ),
        [],
    ]
    return [
        ["Prova di cedevolezza"],
        ["Postura n.", k + 1, None, "Operatore", "A. Rossi" if k < 5 else "B. Neri"],
        [],
        ["Asse", "Angolo (°)", None, "Lettura tracker (mm)"],
        *([n, angle, None, *own] for n, (angle, own) in enumerate(zip(angles_of(k), beside, strict=True), 1)),
    ]


def write_forms():
    return {"forms.xlsx": workbook({f"Postura {k + 1}": write_form(k) for k in POSTURES})}


def write_stacked():
    """Return one sheet with three tables below each other."""
    headers = ["Pose", *(f"nest {t} {axis}" for t in "AB" for axis in "XYZ")]
    blocks = [["JOINT TARGETS (deg)"], ["Pose", *(f"Axis {n}" for n in range(1, 7))]]
    blocks += [[k + 1, *angles_of(k)] for k in POSTURES]
    for state, title in enumerate(("WITHOUT WEIGHT (mm)", "WITH 100 KG (mm)")):
        blocks += [[], [title], headers]
        blocks += [[k + 1, *place_of(k, 0, state), *place_of(k, 1, state)] for k in POSTURES]
    return {"stacked.xlsx": workbook({"Sheet1": [["compliance check"], [], *blocks]})}


def write_turned():
    """Return a sheet with a column for each posture, titles above, and names nobody knows."""
    quantities = [(f"Glied {n + 1}", [angles_of(k)[n] for k in POSTURES]) for n in range(6)]
    quantities += [
        (f"Reflektor {word} {axis}", [place_of(k, 0, state)[n] for k in POSTURES])
        for state, word in enumerate(("ohne Last", "mit Last"))
        for n, axis in enumerate("XYZ")
    ]
    rows = [[name, "Wert", *numbers] for name, numbers in quantities]
    return {
        "turned.xlsx": workbook(
            {"Blatt": [["Versuch 7"], ["Stand", None, *(f"S{k + 1}" for k in POSTURES)], *rows]}
        )
    }


def write_fixed_width():
    """Return text in columns, with groups and units above, and a word where a reading is missing."""
    lines = ["Pomiar sztywności", "", f"{'BEZ':>80}{'POD':>30}"]
    lines.append("".join(f"{name:>11}" for name in ["Nr", *(f"J{n}" for n in range(1, 7)), *"XYZ", *"XYZ"]))
    lines.append(" " * 11 + "".join(f"{unit:>11}" for unit in [*["[st]"] * 6, *["[mm]"] * 6]))
    for k in POSTURES:
        loaded = ["brak"] * 3 if k == 6 else place_of(k, 0, 1)
        cells = [k + 1, *angles_of(k), *place_of(k, 0, 0), *loaded]
        lines.append("".join(f"{cell!s:>11}" for cell in cells).replace(".", ","))
    return {"readings.txt": "\n".join(lines)}


def propose(files, folder, **options):
    paths = []
    for name, content in files.items():
        path = folder / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        paths.append(path)
    return js.read(*paths, robot=ARM, **STATED, **options)


@pytest.mark.parametrize(
    "write",
    [write_notes, write_job, write_json, write_yaml, write_xml, write_forms, write_stacked, write_turned],
)
def test_repeated_places_of_any_file_are_read_as_tables(write, tmp_path):
    proposed = propose(write(), tmp_path)
    answer = proposed.accept()
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []
    assert any("repeated rows of" in note for file in answer.files for note in file.assumptions)


@pytest.mark.parametrize(
    "form", ["[10:{:02}:{:02}]", "2024-01-25 10:{:02}:{:02},125", "25.01.2024 10:{:02}:{:02} -"]
)
def test_a_time_at_the_start_of_a_line_is_no_word_of_its_place(form, tmp_path):
    lines = [line for line in write_notes()["notes.txt"].splitlines() if line]
    stamped = [f"{form.format(n // 60, n % 60)} {line.strip()}" for n, line in enumerate(lines)]
    proposed = propose({"notes.log": "\n".join(stamped)}, tmp_path)
    answer = proposed.accept()
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []
    assert "Stellung 1" in [each.label for each in answer.measurement_set.observations]
    assert "10:00" not in str([each.header for each in answer.files[0].columns])


def test_a_word_in_place_of_numbers_is_a_missing_reading(tmp_path):
    answer = propose(write_fixed_width(), tmp_path).accept()
    labels = [each.label for each in answer.measurement_set.observations]
    assert labels == [str(k + 1) for k in POSTURES if k != 6]


def test_lines_with_numbers_that_are_not_read_are_named(tmp_path):
    (file,) = propose(write_notes(), tmp_path).accept().files
    assert any(
        "lines with numbers that were not read: 'Datum: 14.09.2023" in each for each in file.assumptions
    )


@pytest.mark.parametrize("write", [write_notes, write_json, write_forms, write_stacked, write_turned])
def test_repeated_places_in_which_nothing_is_right_have_no_proposal(write, tmp_path, monkeypatch):
    right = place_of
    monkeypatch.setitem(globals(), "place_of", lambda k, t, s: right((5 * k + 2) % len(POSTURES), t, s))
    with pytest.raises(js.CampaignError):
        propose(write(), tmp_path)


def test_a_record_that_lacks_one_of_equal_lines_is_left_out_only_if_the_request_says_so(tmp_path):
    """Two points of a pose differ by nothing: which of both lacks is not known."""
    poses = [
        {"q": angles_of(k), "points": [place_of(k, 0, s) for s in ((1,) if k == 4 else (0, 1))]}
        for k in POSTURES
    ]
    files = {"readings.json": json.dumps({"poses": poses})}
    with pytest.raises(js.CampaignError) as refused:
        propose(files, tmp_path)
    assert "a posture lacks lines that the others have" in str(refused.value)
    assert "`allow_missing`" in str(refused.value)
    proposed = propose(files, tmp_path, accept_proposal=True)
    assert "a posture lacks lines that the others have" in str(proposed)
    assert len(proposed.accept().measurement_set.observations) == len(POSTURES) - 1
    answer = propose(files, tmp_path, allow_missing=True).accept()
    assert len(answer.measurement_set.observations) == len(POSTURES) - 1
    assert any("records with other rows were left out: 1" in each for each in answer.files[0].assumptions)


def test_a_row_of_a_table_with_other_numbers_is_not_passed_over(tmp_path):
    files = write_job()
    lines = files["JOB.JBI"].splitlines()
    number = next(k for k, line in enumerate(lines) if line.startswith("C00008"))
    lines[number] = lines[number].rsplit(",", 1)[0]
    with pytest.raises(js.CampaignError):
        propose(files | {"JOB.JBI": "\n".join(lines)}, tmp_path)
