"""The tables of a process, `turns.csv` and `places.csv`: packed into a result, and read from it."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jointstiff.service.kinds.process.columns import OF_GRID
from jointstiff.service.tables.table import Sheet
from jointstiff.solver.arrays import FloatArray

WAYS: Final = ("before", "turned", "remaining")
"""Columns of deflections in the table of turns."""
_LEGAL: Final = "legal, or why not"
_JOINT_UNIT: Final = 1e-6
"""Unit in which joints are stored [deg]: at a reach of 3 m it moves the tool by 0.05 µm."""
_LENGTH_DECIMALS: Final = 7
"""Decimals of lengths [mm]."""


@dataclass(frozen=True)
class Deflections:
    """Deflections of the m points of a path with their intervals [m]."""

    length: FloatArray  # (m,)
    by_readings: FloatArray  # (m, 2) ends of the interval by the errors of readings and forces
    with_model_error: FloatArray  # (m, 2) ends of the interval that also has the model's error

    @classmethod
    def unknown(cls, count: int) -> Deflections:
        """Return deflections of `count` points that are not known: NaN."""
        return cls(np.full(count, np.nan), np.full((count, 2), np.nan), np.full((count, 2), np.nan))

    def to_columns(self) -> FloatArray:
        """Return the columns (m, 5) of a table: deflection, then the ends of both intervals."""
        return np.column_stack([self.length, self.by_readings, self.with_model_error])


def pack_choice(
    turn: FloatArray,
    ways: Mapping[str, Deflections],
    joints: Mapping[str, FloatArray],
    places: FloatArray,
    remarks: Sequence[str],
    of_grid: int,
    speeds: FloatArray,
) -> bytes:
    """Return the tables of turns and places as bytes that `turns_sheet` and `places_sheet` read.

    Args:
        turn: (m,) turns of all points [rad]; NaN where the joints are given.
        ways: deflections by the names of `WAYS`; names that are unknown are left out.
        joints: joints of the arm (m, 6) [rad] by the end of their headers.
        places: (P, 5) places that were tried: position [m], turn [rad], deflection [m].
        remarks: P remarks on these places.
        of_grid: number of the places that are those of the grid, in its order; the others come behind.
        speeds: parts (m, 6) of the greatest speeds of the arm's joints; NaN if unknown.
    """
    unknown = Deflections.unknown(len(turn))
    lengths = np.column_stack([ways.get(name, unknown).to_columns() for name in WAYS])  # [m]
    joint_degrees = np.degrees(np.hstack(list(joints.values())))
    joint_headers = [f"J{j}{ending} [deg]" for ending in joints for j in range(1, 7)]
    content = io.BytesIO()
    np.savez(
        content,
        allow_pickle=False,
        turn=np.degrees(turn),
        lengths=(1e3 * lengths).astype(np.float32),
        joints=np.round(joint_degrees / _JOINT_UNIT).astype(np.int32),
        headers=_pack_texts(_list_length_headers()),
        joint_headers=_pack_texts(joint_headers),
        places=places.astype(np.float32),
        remarks=_pack_texts(remarks),
        of_grid=np.array(of_grid),
        speeds=speeds.astype(np.float32),
    )
    return content.getvalue()


def _list_length_headers() -> list[str]:
    """Return the headers of the deflections in the table of turns, five for each of `WAYS`.

    For "turned": turned [mm], turned low, readings [mm], …, turned high, with model error [mm]. The order is
    that of `Deflections.to_columns`.
    """
    headers = list[str]()
    for name in WAYS:
        headers.append(f"{name} [mm]")
        for interval in ("readings", "with model error"):
            headers += [f"{name} low, {interval} [mm]", f"{name} high, {interval} [mm]"]
    return headers


def _pack_texts(texts: Sequence[str]) -> np.ndarray[Any, Any]:
    """Return texts as one array without axes, with "|" between two texts; `.split("|")` gives them back."""
    return np.array("|".join(texts))


def turns_sheet(content: bytes) -> Sheet:
    """Return the table of the turns of all points from bytes of a result's `choice`."""
    stored = np.load(io.BytesIO(content), allow_pickle=False)
    turn, lengths = stored["turn"], np.round(stored["lengths"].astype(np.float64), _LENGTH_DECIMALS)
    columns: dict[str, Any] = {"point": np.arange(1, len(turn) + 1), "turn [deg]": turn}
    columns |= dict(zip(str(stored["headers"]).split("|"), lengths.T, strict=True))
    joints = _JOINT_UNIT * stored["joints"]
    columns |= dict(zip(str(stored["joint_headers"]).split("|"), joints.T, strict=True))
    if "speeds" in stored:  # older results have none
        percent = np.round(100.0 * stored["speeds"].astype(np.float64), 2)
        columns |= {f"J{j} speed [%]": percent[:, j - 1] for j in range(1, 7)}
    return Sheet(columns, digits=".9g")


def places_sheet(content: bytes) -> Sheet:
    """Return the table of all places that were tried from bytes of a result's `choice`."""
    stored = np.load(io.BytesIO(content), allow_pickle=False)
    places = stored["places"]
    columns: dict[str, Any] = {
        "x [m]": places[:, 0],
        "y [m]": places[:, 1],
        "z [m]": places[:, 2],
        "turn [deg]": np.degrees(places[:, 3]),
        "deflection [m]": places[:, 4],
    }
    if "remarks" in stored:  # older results have none
        is_of_grid = np.arange(len(places)) < int(stored["of_grid"])
        columns[OF_GRID] = is_of_grid.astype(np.float64)
        columns[_LEGAL] = str(stored["remarks"]).split("|") if len(places) else []
    return Sheet(columns, texts=frozenset({_LEGAL}), digits=".7g")
