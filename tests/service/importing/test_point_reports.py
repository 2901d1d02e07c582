"""Reports of coordinate measuring machines: measured points are read, nominal ones never.

The texts are made up; they follow DMIS (ISO 22093) and the dimension format of PC-DMIS's manual.
"""

import random

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on
from support.importing_samples import MM, READ_POINTS, points_of, read

import jointstiff as js
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.texts.point_reports import read_point_report

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=4, configurations=12)
JOINTS = "".join(
    " ".join(f"{value:.5f}" for value in row) + "\n" for row in np.rad2deg(READINGS.joints).tolist()
)
NAMED = {"_".join(key): place for key, place in READ_POINTS.items()}
PLACES = {f"PT{i}": tuple(place) for i, place in enumerate((1e3 * READINGS.position[:, 0]).tolist(), 1)}


def write_dmis(places):
    lines = ["$$ made up", "DMISMN/'targets',05.2", "UNITS/MM,ANGDEC,TEMPC"]
    for name, (x, y, z) in places.items():
        lines += [
            f"F({name})=FEAT/POINT,CART,{x + 1:.0f},{y - 1:.0f},{z:.0f},0,0,1",
            f"FA({name})=FEAT/POINT,CART,{x:.4f},{y:.4f},$",
            f"{z:.4f},0.0000,0.0000,1.0000",
        ]
    return "\n".join([*lines, "FA(PLN1)=FEAT/PLANE,CART,0,0,0,0,0,1", "ENDFIL"]) + "\n"


def write_pcdmis(places):
    blocks = ["made up\n"]
    for i, (name, place) in enumerate(places.items(), 1):
        rows = [
            f"{axis}   {value + 0.5:.4f}   0.0500   0.0500   {value:.4f}  -0.5000   0.4500 <-------"
            for axis, value in zip("XYZ", place, strict=True)
        ]
        head = (
            f"DIM LOC{i}= LOCATION OF POINT {name}  UNITS=MM ,$\nGRAPH=OFF  TEXT=OFF  MULT=10.00  OUTPUT=BOTH"
        )
        columns = "AX    NOMINAL    +TOL    -TOL    MEAS    DEV    OUTTOL"
        blocks.append("\n".join([head, columns, *rows, f"END OF DIMENSION LOC{i}\n"]))
    return "\n".join(blocks)


def write_triples(places):
    lines = [f"{name}  X {x:.4f}  Y {y:.4f}  Z {z:.4f}" for name, (x, y, z) in places.items()]
    return "\n".join(["# made up", *lines]) + "\n"


WRITERS = {"DMIS": write_dmis, "PC-DMIS": write_pcdmis, "X Y Z in lines": write_triples}


@pytest.mark.parametrize("form", WRITERS)
def test_measured_points_are_read_by_their_names(form):
    content = WRITERS[form](NAMED)
    assert points_of(read(("points.txt", content), units=MM)) == READ_POINTS


@pytest.mark.parametrize("form", WRITERS)
def test_the_proposal_alone_leads_from_a_report_to_a_set(form, tmp_path):
    loaded = {name: (x, y, z - 0.4) for name, (x, y, z) in PLACES.items()}
    files = {
        "j.txt": JOINTS,
        "unloaded.txt": WRITERS[form](PLACES),
        "loaded.txt": WRITERS[form](loaded),
    }
    for name, content in files.items():
        (tmp_path / name).write_text(content)
    stated = {"encoders": "motor", "load_point": [0, 0, 100], "force": [0, 0, -100], "units": {"force": "N"}}
    proposal = js.read(*(tmp_path / name for name in files), robot=ARM, **stated)
    assert "in 24 of 24 positions" in str(proposal)
    assert len(proposal.accept().campaign.measurement_set.observations) == 12


def test_an_inch_of_dmis_is_an_inch():
    report = read_point_report("p.dmo", write_dmis(NAMED).replace("UNITS/MM", "UNITS/INCH"))
    assert report is not None
    assert report.unit == "in"


def test_features_without_a_place_are_left_out():
    report = read_point_report("p.dmo", write_dmis(NAMED))
    assert report is not None
    assert [point.name for point in report.points] == list(NAMED)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("F(P1)=FEAT/POINT,CART,1,2,3,0,0,1\nENDFIL\n", "nominal features only"),
        ("FA(P1)=FEAT/POINT,POL,1,2,3\n", "no Cartesian coordinates"),
        ("FA(P1)=FEAT/POINT,CART,1,2\n", "no Cartesian coordinates"),
        ("FA(P1)=FEAT/POINT,CART,1,2,3\nFA(P2=FEAT/POINT,CART,1,2,3\n", "no point of the report"),
        ("UNITS/MM\nUNITS/INCH\nFA(P1)=FEAT/POINT,CART,1,2,3\n", "several units"),
        ("UNITS/YARD\nFA(P1)=FEAT/POINT,CART,1,2,3\n", "unknown unit"),
        ("DIM L1= LOCATION OF POINT P1 UNITS=MM\nAX NOMINAL DEV\nX 1 2\nY 1 2\nZ 1 2\n", "column MEAS"),
        ("DIM L1= LOCATION OF CIRCLE C1 UNITS=MM\nAX NOMINAL MEAS\nD 1 2\n", "no dimension has X, Y and Z"),
        ("P1 X 1 Y 2 Z 3\nP2 X 1 Y 2\nP3 X 1 Y 2 Z 3\nP4 X 1 Y 2 Z 3\n", "no point of the report"),
    ],
)
def test_a_report_that_is_not_understood_is_refused_with_its_place(text, words):
    with pytest.raises(ImportFileError, match=words) as refused:
        read_point_report("p.txt", text)
    assert refused.value.place.file == "p.txt"
    assert refused.value.remedy


@pytest.mark.parametrize("text", ["name X Y Z\np 1 2 3\n" * 5, "N10 G1 X1 Y2 Z3\n" * 5, "X" * 600, ""])
def test_other_texts_are_no_reports(text):
    assert read_point_report("p.txt", text) is None


@pytest.mark.parametrize("form", WRITERS)
def test_a_damaged_report_is_refused_or_its_points_are_whole(form):
    """A place of a damaged file has only numbers of this file, of one point and in its order."""
    random_ = random.Random(form)  # noqa: S311
    content = WRITERS[form](NAMED)
    lines = content.split("\n")
    refused = 0
    for _ in range(300):
        damaged = list(lines)
        at = random_.randrange(len(damaged))
        if random_.random() < 0.5:
            del damaged[at]
        else:
            cut = random_.randrange(len(damaged[at]) + 1)
            damaged[at] = damaged[at][:cut] + damaged[at][cut + 1 :]
        try:
            found = points_of(read(("points.txt", "\n".join(damaged)), units=MM))
        except ImportFileError:
            refused += 1
            continue
        for key, place in found.items():
            one_digit_less = [
                abs(a - b) > 1e-9 for a, b in zip(place, READ_POINTS.get(key, place), strict=True)
            ]
            assert sum(one_digit_less) <= 1
    assert refused > 30
