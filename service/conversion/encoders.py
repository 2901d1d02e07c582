"""Readings of secondary encoders as arrays: stored beside those of the targets, in the units of their set."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from jointstiff.schemas.measurement import EncoderReading, Observation
from jointstiff.schemas.robot import MAX_JOINTS
from jointstiff.service.conversion.array_group import ArrayGroup
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError


@dataclass(frozen=True, eq=False)
class EncoderArrays(ArrayGroup):
    """N observations of up to E encoders."""

    prefix = "encoder_"

    joints: npt.NDArray[np.str_]  # (E,) names of the joints, in order of first appearance
    present: BoolArray  # (N, E) which encoders were read
    unloaded: FloatArray  # (N, E) angles before the load; zero where not read
    loaded: FloatArray  # (N, E) angles under load; zero where not read

    @classmethod
    def from_observations(cls, observations: list[Observation]) -> EncoderArrays | None:
        """Arrange the readings; None if there are none.

        Raises:
            MeasurementError: a joint is given twice in an observation, or there are too many.
        """
        names = dict.fromkeys(r.joint for o in observations for r in o.encoder_readings or ())
        if not names:
            return None
        if len(names) > MAX_JOINTS:
            raise MeasurementError(
                f"the readings name encoders of {len(names)} different joints, more than {MAX_JOINTS}",
                where="observations",
                remedy="use the robot's joint names, the same in every observation",
            )
        column = {name: e for e, name in enumerate(names)}
        present = np.zeros((len(observations), len(names)), dtype=np.bool_)
        unloaded, loaded = np.zeros((2, *present.shape))
        for i, observation in enumerate(observations):
            for k, reading in enumerate(observation.encoder_readings or ()):
                place = i, column[reading.joint]
                if present[place]:
                    raise MeasurementError(
                        f"the encoder of '{reading.joint}' has two readings in observation "
                        f"'{observation.label}'",
                        where=f"observations[{i}].encoder_readings[{k}].joint",
                        remedy="give each joint at most once per observation",
                    )
                present[place] = True
                unloaded[place], loaded[place] = reading.unloaded, reading.loaded
        return cls(np.array(list(names)), present, unloaded, loaded)

    def readings(self, i: int) -> list[EncoderReading] | None:
        """Return those of one observation as they were posted, by `joints`; None if there are none."""
        readings = [
            EncoderReading.model_construct(
                joint=str(self.joints[e]),
                unloaded=float(self.unloaded[i, e]),
                loaded=float(self.loaded[i, e]),
            )
            for e in np.flatnonzero(self.present[i])
        ]
        return readings or None

    def columns(self, joint_names: tuple[str, ...]) -> IndexArray:
        """Return (E,) the robot's joint of each encoder.

        Raises:
            MeasurementError: the robot has no such joint.
        """
        for e, name in enumerate(self.joints.tolist()):
            if name not in joint_names:
                first = int(np.flatnonzero(self.present[:, e])[0])
                raise MeasurementError(
                    f"the robot has no joint '{name}'",
                    where=f"observations[{first}].encoder_readings",
                    remedy=f"use one of {', '.join(joint_names)}",
                )
        return np.array([joint_names.index(name) for name in self.joints.tolist()])
