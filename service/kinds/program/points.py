"""Points of a compensated program: as arrays, summed up, and as a table."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Final

import numpy as np

from jointstiff.schemas.program import MAX_WORST, ProgramPoint, Spread
from jointstiff.service.kinds.program.path import ProgramPath
from jointstiff.service.programs.program import BLOCK
from jointstiff.service.tables.table import Sheet
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.predict.forward import Compensation
from jointstiff.solver.predict.model_error import ModelErrorBound

_MM: Final = 1e3
_MRAD: Final = 1e3


@dataclass(frozen=True, eq=False)
class Corrections:
    """Corrections of k points under load."""

    points: IndexArray  # (k,) places in the path
    commanded: FloatArray  # (k, 6) controller's angles [rad]
    correction: FloatArray  # (k, 6) displacement [m] and rotation vector [rad], axes of R0
    residual: FloatArray  # (k, 6) from the wanted to the loaded place, before the program's rounding
    uncorrected: FloatArray  # (k, 6) the same without a correction
    uncertainty: FloatArray  # (k,) standard uncertainty of the deflection along itself [m]; NaN if unknown
    # (k,) bound of the displacement's error, with what the model lacks [m]; inf or NaN where there is none
    model_error: FloatArray
    # (k,) load, or what the readings say of the place, beyond the campaign's: above 1 it extrapolates; NaN
    # without a model error
    extrapolation: FloatArray
    share: FloatArray  # (k,) share of the full correction
    uncertain: BoolArray  # (k,) left alone, as the uncertainty exceeds the deflection
    capped: BoolArray  # (k,) held back by the limits

    @classmethod
    def of(cls, points: IndexArray, found: Compensation, bound: ModelErrorBound | None) -> Corrections:
        """Take over what was computed."""
        radius = beyond = np.full(len(points), np.nan)
        if bound is not None:
            radius, beyond = bound.radius, np.maximum(bound.load_ratio, bound.leverage_ratio)
        names = {field.name for field in fields(found)} - {"leverage"}
        taken = {name: getattr(found, name) for name in names}
        return cls(points, model_error=radius, extrapolation=beyond, **taken)

    @classmethod
    def joined(cls, parts: Sequence[Corrections]) -> Corrections:
        """Join parts, in order."""
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))


@dataclass(frozen=True, eq=False)
class WrittenPoints:
    """The m points of a path with what is written for them."""

    path: ProgramPath  # the path
    corrections: Corrections  # corrections of the points under load
    residual: FloatArray  # (k, 6) from the wanted to the loaded place under what is written [m, rad]
    rounding: FloatArray  # (k,) part of it that comes of the program's digits [m]
    changed: BoolArray  # (k,) whether a number is another one than before
    place: FloatArray  # (m, 3) where the tool's centre is wanted, in R0 [m]
    quantile: float  # half the width of intervals in standard uncertainties

    def spread(self, sizes: FloatArray) -> Spread | None:
        """Return median, 95 % quantile and greatest of sizes (k,)."""
        if not len(sizes):
            return None
        median, p95, greatest = np.quantile(sizes, [0.5, 0.95, 1.0]).tolist()
        return Spread(median=median, p95=p95, greatest=greatest)

    @cached_property
    def _intervals(self) -> FloatArray:
        """(2, k, 2) of the deflection, from the readings and with model error [m]; NaN where unknown."""
        corrections = self.corrections
        half = np.stack([self.quantile * corrections.uncertainty, corrections.model_error])
        half = np.where(np.isfinite(half), half, np.nan)
        half[1] = np.where(np.isnan(half[1]), np.nan, np.fmax(half[0], half[1]))
        deflection = _size(corrections.uncorrected[:, :3])
        return np.stack([np.maximum(deflection - half, 0.0), deflection + half], axis=2)

    def worst(self) -> list[ProgramPoint]:
        """Return the points with the greatest deflections, greatest first."""
        order = np.argsort(-_size(self.corrections.uncorrected[:, :3]), kind="stable")[:MAX_WORST]
        return [self._point(int(k)) for k in order]

    def _point(self, k: int) -> ProgramPoint:
        corrections, point = self.corrections, int(self.corrections.points[k])
        targets, target = self.path.program.targets, int(self.path.targets[point])
        u = float(corrections.uncertainty[k])
        readings, with_error = (
            (low, high) if np.isfinite(high) else None for low, high in self._intervals[:, k].tolist()
        )
        return ProgramPoint(
            number=point + 1,
            name="".join(each if each.isprintable() else "?" for each in targets.names[target]),
            line=int(targets.line[target]),
            place=tuple(self.place[point].tolist()),
            deflection=float(_size(corrections.uncorrected[k, :3])),
            deflection_rotation=float(_size(corrections.uncorrected[k, 3:])),
            correction=float(_size(corrections.correction[k, :3])),
            correction_rotation=float(_size(corrections.correction[k, 3:])),
            standard_uncertainty=u if np.isfinite(u) else None,
            interval=readings,
            interval_with_model_error=with_error,
            residual=float(_size(self.residual[k, :3])),
            residual_rotation=float(_size(self.residual[k, 3:])),
            rounding=float(self.rounding[k]),
            share=float(corrections.share[k]),
            capped=bool(corrections.capped[k]),
        )

    def _columns(self, block: slice) -> FloatArray:
        """Return the columns `_LOADED` of some points."""
        corrections = self.corrections
        uncorrected, correction = corrections.uncorrected[block], corrections.correction[block]
        residual = self.residual[block]
        return np.column_stack(
            [
                _MM * uncorrected[:, :3],
                _MM * _size(uncorrected[:, :3]),
                _MRAD * _size(uncorrected[:, 3:]),
                _MM * correction[:, :3],
                _MM * _size(correction[:, :3]),
                _MRAD * _size(correction[:, 3:]),
                _MM * corrections.uncertainty[block],
                *(_MM * interval for interval in self._intervals[:, block]),
                _MM * residual[:, :3],
                _MM * _size(residual[:, :3]),
                _MRAD * _size(residual[:, 3:]),
                _MM * self.rounding[block],
                corrections.share[block],
            ]
        )

    def table(self) -> bytes:
        """Return all points in the order of the path, as `points_sheet` reads them."""
        corrections, path = self.corrections, self.path
        numbers = np.full((len(_POSTURE) + len(_LOADED), len(path.targets)), np.nan, dtype=np.float32)
        numbers[:3], numbers[3 : len(_POSTURE)] = self.place.T, np.degrees(path.cases.joints).T
        for start in range(0, len(corrections.points), BLOCK):
            block = slice(start, start + BLOCK)
            numbers[len(_POSTURE) :, corrections.points[block]] = self._columns(block).T
        remark = np.full(len(path.targets), _REMARKS.index("no load"), dtype=np.uint8)
        remark[corrections.points] = _REMARKS.index("")
        remark[corrections.points[corrections.capped]] = _REMARKS.index("capped")
        remark[corrections.points[corrections.uncertain]] = _REMARKS.index("uncertain: left alone")
        targets = path.program.targets
        names = "\n".join([targets.names[i] for i in path.targets.tolist()]).encode("latin-1")
        files = np.array([source.name for source in path.program.sources])
        places = targets.source[path.targets].astype(np.uint8), targets.line[path.targets].astype(np.int32)
        content = io.BytesIO()
        # Neighbours differ little: the differences of their bits, byte by byte, take a third of the room.
        steps = (np.diff(column.view(np.uint32), prepend=np.uint32(0)) for column in numbers)
        planes = (np.ascontiguousarray(each.view(np.uint8).reshape(-1, 4).T) for each in steps)
        for plane in planes:
            np.save(content, plane, allow_pickle=False)
        for array in (remark, *places, files, np.frombuffer(names, dtype=np.uint8)):
            np.save(content, array, allow_pickle=False)
        return content.getvalue()


def points_sheet(content: bytes) -> Sheet:
    """Return the points that `WrittenPoints.table` wrote; NaN, an empty cell, where there is no number."""
    stored = io.BytesIO(content)
    numbers = dict[str, FloatArray]()
    for name in _POSTURE + _LOADED:
        steps = np.ascontiguousarray(np.load(stored, allow_pickle=False).T).view(np.uint32)
        numbers[name] = np.cumsum(steps, dtype=np.uint32).view(np.float32)
    remark, source, line, files, names = (np.load(stored, allow_pickle=False) for _ in range(5))
    columns: dict[str, Any] = {
        "point": np.arange(1, len(line) + 1),
        "name": names.tobytes().decode("latin-1").split("\n"),
        "file": files.astype(object)[source],
        "line": line,
    }
    columns |= numbers
    columns["remark"] = np.array(_REMARKS, dtype=object)[remark]
    return Sheet(columns, texts=frozenset({"name", "file", "remark"}), digits=".7g")


_POSTURE: Final = (*(f"place {axis} [m]" for axis in "xyz"), *(f"J{j} [deg]" for j in range(1, 7)))
_LOADED: Final = (
    *(f"deflection {axis} [mm]" for axis in "xyz"),
    "deflection [mm]",
    "deflection rotation [mrad]",
    *(f"correction {axis} [mm]" for axis in "xyz"),
    "correction [mm]",
    "correction rotation [mrad]",
    "deflection standard uncertainty [mm]",
    "deflection low, readings [mm]",
    "deflection high, readings [mm]",
    "deflection low, with model error [mm]",
    "deflection high, with model error [mm]",
    *(f"residual {axis} [mm]" for axis in "xyz"),
    "residual [mm]",
    "residual rotation [mrad]",
    "rounding [mm]",
    "share [1]",
)
_REMARKS: Final = ("", "no load", "capped", "uncertain: left alone")


def _size(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(vectors, axis=-1))
