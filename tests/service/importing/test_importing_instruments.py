"""Files as instruments and people write them: SpatialAnalyzer 2022, Leica's columns, words for states."""

import re
from datetime import UTC, datetime

import pytest
from support.importing_samples import JOINTS, answered, points_of, read
from support.importing_samples import READ_POINTS as READ

# ---- SpatialAnalyzer 2022


# ---- Leica


HEADERS = [
    "Name", "X  [mm]", "Y  [mm]", "Z  [mm]", "U(95)  [mm]", "U(95) X  [mm]", "U(95) Y  [mm]", "U(95) Z  [mm]",
    "Tilt  [deg]", "Q0 ", "Q1 ", "Q2 ", "Q3 ", "Image RMS  [µm]", "Target", "Temperature  [°C]",
    "Pressure  [mBar]", "Humidity  [%]", "Time Stamp", "OTG Applied", "Delete",
]  # fmt: skip
U95 = (0.031, 0.012, 0.0)


def leica_rows(*, deleted=()):
    total = sum(u * u for u in U95) ** 0.5
    rows = []
    for index, ((label, target, state), xyz) in enumerate(READ.items()):
        name = f"{label}_{target}_{state}"
        rows.append([
            name, *(f"{value:.4f}" for value in xyz), f"{total:.6f}", *(f"{u:.3f}" for u in U95),
            "0.00", "0.7071", "0.0", "0.0", "0.7071", "3", "CCR 1.5in", f"2{index}.5", "1013.2", "41.0",
            f"'08.11.2022 16:1{index}:28.353", "False", str(index in deleted),
        ])  # fmt: skip
    return rows


def leica(
    delimiter=",", mark=".", order=1, encoding="latin-1", end="\r\n", trailing=True, without=(), **options
):
    """Leica's table; names are last if `order` is -1."""
    kept = [index for index, header in enumerate(HEADERS) if header not in without][::order]
    lines = []
    for row in [HEADERS, *leica_rows(**options)]:
        cells = [row[index] for index in kept]
        cells = [cell.replace(".", mark) if re.fullmatch(r"-?\d+\.\d+", cell) else cell for cell in cells]
        lines.append(delimiter.join(cells) + (delimiter if trailing else ""))
    return (end.join(lines) + end).encode(encoding)


def test_uncertainties_of_coordinates_become_covariances():
    answer = answered(("joints.csv", JOINTS), ("tracker.csv", leica()))
    reading = answer.measurement_set.observations[0].readings[0]
    assert reading.sigma is None
    diagonal = [row[index] for index, row in enumerate(reading.unloaded_covariance)]
    assert diagonal == pytest.approx([(u / 1.96) ** 2 for u in (0.031, 0.012, 0.0005)], rel=1e-12)
    assert reading.unloaded_covariance[0][1:] == (0.0, 0.0)
    notes = " ".join(answer.preview.assumptions)
    assert "σ = U/1.96" in notes
    assert "U(95) of 0 is rounded to 1 µm, and was read as 0.5 µm (4 cells)" in notes
    assert answer.measurement_set.measured_at == datetime(2022, 11, 8, 16, 10, 28, 353_000, UTC)


# ---- words for states


# ---- headers as a whole, files that were cut off, values far from all others


# ---- other instruments


def test_groups_of_spatial_analyzer_that_end_with_the_state():
    rows = "".join(f"{a} {c}, {b}, {x}, {y}, {z}\n" for (a, b, c), (x, y, z) in READ.items())
    assert points_of(read(("a.txt", "// X, Y, Z in mm\n" + rows))) == READ
