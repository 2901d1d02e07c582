"""Print how many readings a large workbook has, and by how many MB importing it raises the peak of memory."""

from __future__ import annotations

import io
import resource
import sys

import openpyxl

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.reading import SourceFile
from jointstiff.service.resources.imports import import_files

OBSERVATIONS, TARGETS = 3_600, 16
UNITS = {"length": "mm", "angle": "deg", "force": "N"}


def points() -> bytes:
    """Write a list of points, of nearly as many cells as a sheet may have."""
    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet()
    for number in range(OBSERVATIONS * TARGETS * 2):
        label, target = divmod(number // 2, TARGETS)
        name = f"c{label:04d}_P{target}_{'loaded' if number % 2 else 'unloaded'}"
        sheet.append([name, *(number * factor % 9973 / 10_000 for factor in (7, 11, 13))])
    output = io.BytesIO()
    book.save(output)
    return output.getvalue()


def joints() -> bytes:
    """Write the angles and forces of the same observations."""
    rows = (f"c{label:04d};{label % 90};{label % 77};0;0;-100" for label in range(OBSERVATIONS))
    return "\n".join(["label;J1 [deg];J2 [deg];Fx [N];Fy [N];Fz [N]", *rows]).encode()


def peak() -> float:
    """Return the peak of memory, in MB."""
    unit = 1024**2 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


if __name__ == "__main__":
    files = [SourceFile("points.xlsx", points()), SourceFile("joints.csv", joints())]
    options = {"units": UNITS, "encoders": "motor", "load_point": [0.0, 0.0, 1.0]}
    request = ImportRequest.model_validate(options)
    before = peak()
    answer = import_files(files, request)
    print(answer.preview.reading_count if answer.measurement_set else -1, peak() - before)  # noqa: T201
