"""Measurement sets in a tracker's frame: brought to R0 when they are prepared, stored as they came."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from jointstiff.schemas.fields import Vector3
from jointstiff.schemas.measurement import Frame, MeasurementSetHeader, Noise, ResolvedFrame
from jointstiff.service.conversion.message import message
from jointstiff.service.conversion.point_noise import PointNoise
from jointstiff.service.conversion.readings import ReadingArrays
from jointstiff.service.conversion.units import LENGTH, to_instrument
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError

if TYPE_CHECKING:
    from jointstiff.schemas.geometry import GeometryRequest
    from jointstiff.solver.geometry.charts import RigidTransform
    from jointstiff.solver.geometry.frames import BaseTargets

Header = TypeVar("Header", bound=MeasurementSetHeader)


def stated_transform(frame: Frame, length: float) -> RigidTransform:
    """Return an explicit transform from tracker to R0, its rotation made exact.

    Args:
        frame: with rotation and translation.
        length: metres in the set's unit of length.

    Raises:
        MeasurementError: the matrix is not a rotation.
    """
    from jointstiff.solver.geometry.charts import RigidTransform

    return RigidTransform.stated(
        np.array(frame.rotation, dtype=np.float64), length * np.array(frame.translation, dtype=np.float64)
    )


def to_resolved(transform: RigidTransform, flange_targets: dict[str, Vector3] | None = None) -> ResolvedFrame:
    """Return what a frame means, to be stored with its set."""
    return message(ResolvedFrame, transform, flange_targets=flange_targets or {})


def in_base(
    header: Header, readings: ReadingArrays, resolved: ResolvedFrame | None
) -> tuple[Header, ReadingArrays]:
    """Bring all that stands in the tracker's frame to R0, in the set's units.

    Positions are moved; deflections, covariances and, if the frame says so, forces are turned. The
    transform's own uncertainty is left out: of 100 µrad it changes a deflection of 1 mm by 0.1 µm, and a
    lever of 2 m by 0.2 mm.

    Args:
        header: of the set.
        readings: as they were posted.
        resolved: what the header's frame means; None if all is in R0.
    """
    if resolved is None or header.frame is None:
        return header, readings
    length = LENGTH[header.units.length]
    R = np.array(resolved.rotation)
    t = np.array(resolved.translation) / length
    turned = readings.loaded @ R.T
    as_deflection, present = readings.as_deflection[..., None], readings.present[..., None]
    forces = R if header.frame.forces == "tracker" else np.eye(3)
    moved = replace(
        readings,
        unloaded=np.where(present & ~as_deflection, readings.unloaded @ R.T + t, readings.unloaded),
        loaded=np.where(present, np.where(as_deflection, turned, turned + t), readings.loaded),
        force=readings.force @ forces.T,
        moment=readings.moment @ forces.T,
        noise=_turned(readings.noise, R) if readings.noise is not None else None,
        directions=None if readings.directions is None else readings.directions.turned(R),
    )
    known = {name: _scaled(place, 1.0 / length) for name, place in resolved.flange_targets.items()}
    update = {"flange_targets": known | header.flange_targets, "noise": _moved(header.noise, R, t)}
    return header.model_copy(update=update), moved


def _turned(noise: PointNoise, R: FloatArray) -> PointNoise:
    """Turn covariances, and keep them symmetric to the last digit."""
    parts = [R @ part @ R.T for part in (noise.unloaded, noise.loaded)]
    even = [0.5 * (part + np.swapaxes(part, -1, -2)) for part in parts]
    return replace(noise, unloaded=even[0], loaded=even[1])


def _moved(noise: Noise | None, R: FloatArray, t: FloatArray) -> Noise | None:
    """Return the noise with the station in R0."""
    if noise is None or noise.instrument is None:
        return noise
    station = _scaled(R @ np.array(noise.instrument.station) + t, 1.0)
    return noise.model_copy(update={"instrument": noise.instrument.model_copy(update={"station": station})})


def _scaled(vector: npt.ArrayLike, factor: float) -> tuple[float, float, float]:
    x, y, z = (factor * np.asarray(vector, dtype=np.float64)).tolist()
    return x, y, z


def to_base_targets(
    request: GeometryRequest, sigma: float | None, after: dict[str, tuple[float, float, float]] | None = None
) -> BaseTargets | None:
    """Return the base targets that were read both times; None if none were read a second time.

    Args:
        request: with the first readings.
        sigma: unit of the covariances [m]; None if it is not stated.
        after: the second ones, in units.length of the request; its own if None.

    Raises:
        MeasurementError: fewer than three were read both times.
    """
    from jointstiff.solver.geometry.frames import BaseTargets

    targets = request.base_targets
    later = after if after is not None else targets.after if targets is not None else None
    if targets is None or later is None:
        return None
    common = [name for name in targets.before if name in later]
    if len(common) < 3:
        raise MeasurementError(
            f"only {len(common)} base targets were read both times; three are needed",
            where="base_targets",
            remedy="read at least three targets both times, with the same names",
        )
    length = LENGTH[request.units.length]
    first = length * np.array([targets.before[name] for name in common])
    second = length * np.array([later[name] for name in common])
    covariance = np.eye(3)
    if sigma is not None and request.noise is not None and request.noise.instrument is not None:
        covariance = to_instrument(request.noise.instrument, length).covariance(first) / sigma**2
    return BaseTargets(first, second, covariance, tuple(common))
