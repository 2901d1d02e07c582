"""Sources of readings: simulated arms, lines of text, RoboDK; others by entry points.

A source is a class whose constructor takes the address, which is the text after the name of the source:
`tcp://host:port` in `lines:tcp://host:port`. One method is required: ``async def point(name)`` returns the
position of a target [m], in R0 or in the frame that the campaign states, and its standard uncertainty [m], or
None for that of the campaign. `Source` defines the optional methods; the entry points `jointstiff.sources`
name source classes of other packages.
"""

from __future__ import annotations

import asyncio
import inspect
import math
import os
import re
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from typing import Any, Final
from urllib.parse import urlsplit

import numpy as np

from jointstiff.service.problems import ServiceError
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import JointstiffError, RequestError
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.live.innovation import LARGEST_PLACE_ERROR
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.models import JointModel

Place = tuple[float, float, float]
Point = tuple[Place, float | None]
"""Position of a target [m] and its standard uncertainty [m]; None for that of the campaign."""
_PAST: Final = "`jointstiff import` takes such readings from a file"
"""How to go past a limit of plausibility: the end of a remedy."""
GROUP: Final = "jointstiff.sources"
"""Group of the entry points that name sources of other packages and their classes."""
PATIENCE: Final = 30.0
"""Time after which a source that sends nothing counts as stopped [s]."""
_FARTHEST: Final = 100.0
"""Greatest plausible coordinate of a position [m]."""
_LARGEST_POSITION_ERROR: Final = LARGEST_PLACE_ERROR
"""Greatest plausible distance of an unloaded target from the position that the kinematics predict [m]."""
_LARGEST_DISTANCE_ERROR: Final = 0.01
"""Greatest plausible difference between the measured distance of two targets and their distance on the flange
[m]."""
_LARGEST_DEFLECTION: Final = 0.05
"""Greatest plausible distance of a target under load from its position without load [m]."""


class SourceError(ServiceError):
    """A source gave no usable reading: the source stopped, repeated a reading, jumped, or sent other text."""


@dataclass(frozen=True, eq=False)
class Setting:
    """Facts of a campaign that a source of readings may need: robot, targets, load point, noise and frame."""

    robot: Robot
    targets: Mapping[str, Place]  # name → position in the flange frame [m]
    load_point: Place  # in the flange frame [m]
    sigma: float  # standard uncertainty of a coordinate [m]
    #: rotation (3, 3) and translation (3,) [m] from the frame of the readings to R0
    frame: tuple[FloatArray, FloatArray] = field(default_factory=lambda: (np.eye(3), np.zeros(3)))

    def to_base(self, place: FloatArray) -> FloatArray:
        """Transform a position (3,) [m] from the frame of the readings to R0."""
        return np.asarray(self.frame[0] @ place + self.frame[1])

    def from_base(self, place: FloatArray) -> FloatArray:
        """Transform a position (3,) [m] from R0 to the frame of the readings."""
        return np.asarray(self.frame[0].T @ (place - self.frame[1]))


@dataclass(frozen=True)
class Stand:
    """Posture and load of the robot in which the targets are read next."""

    label: str  # label of the planned reading
    joints: tuple[float, ...]  # joint values as the controller shows them [rad or m]
    force: Place  # force of the posture's load, axes of R0 [N]
    loaded: bool  # True if the load acts while the targets are read, False if they are read without load


class Source(ABC):
    """A source of positions, one target after the other."""

    by_itself = False
    """True if the source needs no person who moves an arm or hangs a weight.

    Then no question is asked before each reading.
    """
    names: Mapping[str, str | None] = {}
    """Target of each other name that the source sends; None: positions of this name are left out."""
    unknown: Mapping[str, Place] = {}
    """Last position [m] of each name that the source sent and that is no target."""
    unit: str | None = None
    """Unit of lengths that the option `source_unit` states; None if the source has no such option."""
    stiffness: FloatArray | None = None
    """(n,) planted stiffnesses of a simulated arm [N·m/rad, N/m of a prismatic joint]; None for other
    sources, and before the source is open."""

    async def open(self, setting: Setting) -> None:  # noqa: B027 - most sources do not ask
        """Get ready to read for a campaign, for instance connect to the instrument.

        Raises:
            SourceError: the instrument cannot be reached.
        """

    async def profile(self) -> str | None:
        """Describe how readings are understood, for the user to confirm once; return None to ask nothing."""
        return None

    async def stand(self, stand: Stand) -> None:  # noqa: B027 - most sources do not ask
        """Take note of the posture and the load in which the targets are read from now on."""

    @abstractmethod
    async def point(self, name: str) -> Point:
        """Read a target. Return its position (3,) [m] and the standard uncertainty of a coordinate [m].

        None as uncertainty means that the uncertainty of the campaign applies.

        Raises:
            SourceError: the source gives no reading.
        """

    async def close(self) -> None:  # noqa: B027 - most sources hold nothing
        """Release connections and devices."""


def make_source(text: str, options: Mapping[str, Any]) -> Source:
    """Make a source from a text `NAME:ADDRESS`, such as `simulated:1`; options that are None are ignored.

    Raises:
        RequestError: no source has this name, or the source does not take an option.
    """
    name, _, address = text.partition(":")
    source_class = _find_source_class(name)
    stated_options = {key: value for key, value in options.items() if value is not None}
    _refuse_unknown_options(name, source_class, stated_options)
    source: Source = source_class(address, **stated_options)
    return source


def _find_source_class(name: str) -> Any:  # noqa: ANN401 - a class of this program or of an installed package
    """Return the class of the source with a name; installed packages may add sources as entry points.

    Raises:
        RequestError: no source has this name.
    """
    known = {"simulated": Simulated, "lines": Lines, "robodk": RoboDk}
    if name in known:
        return known[name]
    from_packages = {entry.name: entry for entry in entry_points(group=GROUP)}
    if name not in from_packages:
        raise RequestError(
            f"no source of readings has the name '{name}'",
            where="source",
            remedy=f"give one of {', '.join(sorted({*known, *from_packages}))}, such as simulated:1",
        )
    return from_packages[name].load()


def _refuse_unknown_options(name: str, source_class: Any, options: Iterable[str]) -> None:  # noqa: ANN401
    """Refuse options that the class of a source does not take; a class with `**options` takes any.

    Raises:
        RequestError: names the first of these options.
    """
    parameters = inspect.signature(source_class).parameters
    if any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters.values()):
        return
    for key in options:
        if key not in parameters:
            raise RequestError(
                f"the source '{name}' has no option `{key}`", where="source", remedy=f"omit `{key}`"
            )


@dataclass(frozen=True)
class _StandReading:
    """Points of the targets that were read in a posture, with or without load."""

    stand: Stand | None = None  # None before the first reading
    points: Mapping[str, Point] = field(default_factory=dict)  # target → position and uncertainty [m]

    @property
    def positions(self) -> set[Place]:
        """Positions of all targets [m]."""
        return {place for place, _ in self.points.values()}

    def find_position(self, name: str, joints: tuple[float, ...]) -> FloatArray | None:
        """Return the position (3,) [m] of a target, if it was read at these joint values; else None."""
        if self.stand is None or self.stand.joints != joints or name not in self.points:
            return None
        place, _ = self.points[name]
        return np.array(place)


def _is_plausible(place: Place, sigma: float | None) -> bool:
    """Return whether numbers can be a position and its standard uncertainty [m]; False also for NaN."""
    is_near = all(abs(part) <= _FARTHEST for part in place)
    return is_near and (sigma is None or 0.0 < sigma < 1.0)


class CheckedSource:
    """A source whose readings are checked before they count; an implausible reading raises an error."""

    def __init__(self, source: Any, setting: Setting, patience: float | None = PATIENCE) -> None:  # noqa: ANN401
        """Check the readings of a source.

        Args:
            source: object that has at least the method `point` of a `Source`.
            setting: robot and targets of the campaign.
            patience: longest time to wait for each answer of the source [s]; None waits for ever.
        """
        self._source, self._setting, self._patience = source, setting, patience
        self._announced_stand: Stand | None = None  # posture announced to the source and not read yet
        self._last = _StandReading()  # last reading; without points while its targets are read
        self._last_unloaded = _StandReading()  # last reading without load
        self._earlier_positions: set[Place] = set()  # positions read in earlier postures

    @property
    def unknown(self) -> dict[str, Place]:
        """Last position [m] of each name that the source sent and whose target is not known."""
        if not isinstance(self._source, Source):
            return {}
        points = dict(self._source.unknown)  # at once: another thread may read on
        return {name: place for name, place in points.items() if name not in self._source.names}

    def rename(self, names: Mapping[str, str | None]) -> None:
        """State the target of each other name that the source sends; None leaves its positions out."""
        if isinstance(self._source, Source):
            self._source.names = names

    async def open(self) -> None:
        """Get the source ready."""
        await self._call_if_defined("open", self._setting)

    async def profile(self, stand: Stand | None = None) -> str | None:
        """Announce a posture to the source; return the source's text on how its readings are understood.

        The user confirms the text. Return None if there is nothing to confirm.
        """
        if stand is not None:
            await self._call_if_defined("stand", stand)
        self._announced_stand = stand
        profile: str | None = await self._call_if_defined("profile")
        return profile

    async def close(self) -> None:
        """Let the source release its connections; its errors are ignored."""
        with suppress(SourceError):
            await self._call_if_defined("close")

    async def read(
        self,
        stand: Stand,
        on_point: Callable[[str, Place], object] = lambda _name, _place: None,
        *,
        goes_on: bool = False,
    ) -> dict[str, Point]:
        """Read all targets in a posture, with or without load; return target → (position, uncertainty) [m].

        Args:
            stand: posture and load. A later reading of the same stand may repeat a position.
            on_point: function called with the name and the position [m] of each target as it was read.
            goes_on: True if the targets are read once more in the same stand, which the source knows already.

        Raises:
            SourceError: the source has stopped, or sent a position that cannot be right.
        """
        if stand != self._last.stand:
            self._earlier_positions |= self._last.positions
            self._last = _StandReading(stand)
        if not goes_on:
            await self._announce_once(stand)
        self._announced_stand = None  # a second reading in this posture is announced to the source again
        # Targets that are read again have to keep their distances to the others of the last round.
        points_before = self._last.points if goes_on else {}
        points = dict[str, Point]()
        for name in self._setting.targets:
            points[name] = point = await self._read_target(name)
            self._refuse_implausible(stand, name, np.array(point[0]), {**points_before, **points})
            on_point(name, point[0])
        self._last = _StandReading(stand, points)
        if not stand.loaded:
            self._last_unloaded = self._last
        return points

    async def _announce_once(self, stand: Stand) -> None:
        """Announce a posture to the source, unless `profile` announced it just before.

        Raises:
            SourceError: the source does not answer in time, or cannot be reached.
        """
        if self._announced_stand != stand:
            await self._call_if_defined("stand", stand)

    async def _call_if_defined(self, method_name: str, *arguments: object) -> Any:  # noqa: ANN401 - whatever a source answers
        """Call a method of the source and return its answer; None if the source lacks the method.

        Raises:
            SourceError: the source does not answer in time, or cannot be reached.
        """
        method = getattr(self._source, method_name, None)
        if method is None:
            return None
        try:
            return await asyncio.wait_for(method(*arguments), self._patience)
        except TimeoutError as error:
            if self._patience is not None:
                raise self._silent_error() from None
            raise SourceError(
                f"the source cannot be reached: {error or 'no answer'}",
                remedy="check the address and the cable of the source",
            ) from error
        except OSError as error:
            raise SourceError(
                f"the source cannot be reached: {error}",
                remedy="check the address and the cable of the source",
            ) from error

    def _silent_error(self) -> SourceError:
        """Return the error of a source that sent nothing in time."""
        if self.unknown:
            return SourceError(
                f"the source sent nothing of the next target for {self._patience:g} s, but positions of "
                f"other names: {', '.join(self.unknown)[:80]}",
                remedy=f"name the targets at the instrument {', '.join(self._setting.targets)}, then read on",
            )
        return SourceError(
            f"the source sent nothing for {self._patience:g} s",
            remedy="check the instrument and its cable, then read again",
        )

    async def _read_target(self, name: str) -> Point:
        """Read a target from the source; return its position and uncertainty [m] as numbers.

        Raises:
            SourceError: the source's answer cannot be the position of a target.
        """
        answer = await self._call_if_defined("point", name)
        try:
            place, stated_sigma = answer
            x, y, z = (float(part) for part in place)
            sigma = None if stated_sigma is None else float(stated_sigma)
        except (TypeError, ValueError):
            raise SourceError(
                f"{name}: {str(answer)[:80]!r} is not a position and its uncertainty",
                remedy="let `point` return three numbers in metres, and a number or None",
            ) from None
        if not _is_plausible((x, y, z), sigma):
            raise SourceError(
                f"{name}: ({x:g}, {y:g}, {z:g}) m cannot be the position of a target: up to {_FARTHEST:g} m, "
                "and a standard uncertainty below 1 m, is plausible",
                remedy=f"check the unit and the columns of the source; {_PAST}",
            )
        return (x, y, z), sigma

    def _refuse_implausible(
        self, stand: Stand, name: str, position: FloatArray, points: Mapping[str, Point]
    ) -> None:
        """Refuse a position (3,) [m] of a target that cannot be right.

        Args:
            stand: posture and load in which the target was read.
            name: name of the target.
            position: position of the target in the frame of the readings.
            points: the targets read in this posture so far, including this one.

        Raises:
            SourceError: the position repeats an earlier reading, or is too far from the expected position.
        """
        # A point is a position and its uncertainty.
        positions = {target: position for target, (position, _) in points.items()}
        own_position = positions.pop(name)
        if own_position in self._earlier_positions.union(positions.values()):
            raise SourceError(
                f"{name}: the source sent exactly the same position as in an earlier reading",
                remedy="check that the instrument still measures, then read again",
            )
        self._compare_with_other_targets(name, position, positions)
        if stand.loaded:
            self._compare_with_unloaded_position(stand, name, position)
        else:
            self._compare_with_kinematics(stand, name, position)

    def _compare_with_other_targets(
        self, name: str, position: FloatArray, positions: Mapping[str, Place]
    ) -> None:
        """Refuse a position whose distances from other targets differ from those on the flange.

        `positions` are those of the other targets that were read in this posture.

        Raises:
            SourceError: a distance differs too much.
        """
        on_flange = {target: np.array(place) for target, place in self._setting.targets.items()}
        for other, other_position in positions.items():
            distance_on_flange = float(np.linalg.norm(on_flange[name] - on_flange[other]))
            measured_distance = float(np.linalg.norm(position - other_position))
            if abs(measured_distance - distance_on_flange) > _LARGEST_DISTANCE_ERROR:
                raise SourceError(
                    f"the source has jumped to another target: {name} is {1e3 * measured_distance:.0f} mm "
                    f"from {other}, but the targets are {1e3 * distance_on_flange:.0f} mm apart on the "
                    f"flange; a difference up to {1e3 * _LARGEST_DISTANCE_ERROR:g} mm is plausible",
                    remedy=f"check which target the instrument sees, then read again; {_PAST}",
                )

    def _compare_with_unloaded_position(self, stand: Stand, name: str, position: FloatArray) -> None:
        """Refuse a position under load that is too far from the position without load in the same posture.

        Raises:
            SourceError: the deflection is too large.
        """
        unloaded_position = self._last_unloaded.find_position(name, stand.joints)
        if unloaded_position is None:
            return
        deflection = float(np.linalg.norm(position - unloaded_position))
        if deflection > _LARGEST_DEFLECTION:
            raise SourceError(
                f"the source has jumped to another target: {name} is {1e3 * deflection:.0f} mm from "
                f"its position without load; up to {1e3 * _LARGEST_DEFLECTION:g} mm is plausible",
                remedy=f"check that the arm is still in the posture, then read again; {_PAST}",
            )

    def _compare_with_kinematics(self, stand: Stand, name: str, position: FloatArray) -> None:
        """Refuse a position without load that is too far from the position that the joint values give.

        Raises:
            SourceError: the distance is too large.
        """
        setting = self._setting
        angles = setting.robot.joint_map.model_angles(np.array([stand.joints]))
        on_flange = np.array(setting.targets[name])
        expected_position = Postures(setting.robot, angles).to_base(on_flange[None, None])[0, 0]  # in R0
        position_error = float(np.linalg.norm(setting.to_base(position) - expected_position))
        if position_error <= _LARGEST_POSITION_ERROR:
            return
        fitting_unit = self._find_fitting_unit(position, expected_position)
        if fitting_unit is not None:
            raise SourceError(
                f"{name} is {position_error:.3g} m from the position that the robot's joint values give, but "
                f"within {_LARGEST_POSITION_ERROR:g} m if the source's lengths are in {fitting_unit}, not in "
                f"{self._source.unit}",
                remedy=f"give `--source-unit {fitting_unit}`; in Python the source's option source_unit",
            )
        raise SourceError(
            f"the source has jumped to another target: {name} is {position_error:.3g} m from the "
            "position that the robot's joint values give; up to "
            f"{_LARGEST_POSITION_ERROR:g} m is plausible",
            remedy=f"check the posture, and the frame and the unit of the readings, then read again; {_PAST}",
        )

    def _find_fitting_unit(self, position: FloatArray, expected_position: FloatArray) -> str | None:
        """Return the unit of lengths with which a reading fits the kinematics; None if no unit does.

        Args:
            position: (3,) position as it was read, in the frame of the readings [m].
            expected_position: (3,) position that the joint values give, in R0 [m].
        """
        stated_unit = getattr(self._source, "unit", None)
        if stated_unit is None:
            return None
        for unit, size in _LENGTHS.items():
            converted = position * (size / _LENGTHS[stated_unit])
            distance = float(np.linalg.norm(self._setting.to_base(converted) - expected_position))
            if distance <= _LARGEST_POSITION_ERROR:
                return unit
        return None


_BASE_JOINT_STIFFNESS: Final = 3e6
"""Typical stiffness of the base joint of an arm with the reach `_USUAL_REACH` [N·m/rad]."""
_USUAL_REACH: Final = 2.8
"""Reach of an arm whose base joint has the stiffness `_BASE_JOINT_STIFFNESS` [m]."""
_SHORTEST_LEVER: Final = 0.15
"""Least ratio of a joint's lever (distance from the flange) to the reach that is used for its stiffness."""
_LINEAR_STIFFNESS: Final = 1e8
"""Stiffness of a linear axis [N/m]."""
_LOG_STIFFNESS_SPREAD: Final = 0.35
"""Standard deviation of the logarithm of a stiffness."""


class Simulated(Source):
    """A simulated arm with random plausible stiffnesses, exact balance of springs and load, and noise."""

    by_itself = True

    def __init__(self, address: str = "") -> None:
        """Use the address as the seed of stiffnesses and noise; an empty address is the seed 1.

        Raises:
            RequestError: the address is not a whole number.
        """
        if not (address or "1").isdecimal():
            raise RequestError(
                f"the seed of a simulated arm must be a whole number, not '{address}'",
                where="source",
                remedy="give a number such as in simulated:1",
            )
        self._random = np.random.default_rng(int(address or 1))

    async def open(self, setting: Setting) -> None:
        """Draw random stiffnesses of the joints of the campaign's robot."""
        robot = setting.robot
        self._setting = setting
        self.stiffness = draw_plausible_stiffness(robot, self._random)
        bounds = Constraints(Bounds.positive(robot.n))
        self._model = JointModel(robot, 1.0 / self.stiffness, None, bounds)

    async def stand(self, stand: Stand) -> None:
        """Compute the positions of all targets in a posture, bent by the load if it acts.

        Raises:
            SourceError: springs and load have no balance.
        """
        names, setting = list(self._setting.targets), self._setting
        count = len(names)

        def repeat_for_targets(values: object) -> FloatArray:
            """Return values (m,) repeated in T rows (T, m), one for each target."""
            return np.tile(np.asarray(values, dtype=np.float64), (count, 1))

        force = stand.force if stand.loaded else (0.0, 0.0, 0.0)
        # One load case for each target: all have the same posture and load, but another place.
        cases = LoadCases(
            joints=repeat_for_targets(stand.joints),
            force=repeat_for_targets(force),
            moment=np.zeros((count, 3)),
            load_point=repeat_for_targets(setting.load_point),
            place=np.array([setting.targets[name] for name in names], dtype=np.float64),
        )
        try:
            places = self._model.deflect(cases).place
        except JointstiffError as error:
            raise SourceError(error.reason, remedy="give a smaller load") from error
        self._places = dict(zip(names, places, strict=True))

    async def point(self, name: str) -> Point:
        """Return the computed position of a target with normal noise of the campaign's sigma."""
        noise = self._setting.sigma * self._random.standard_normal(3)
        x, y, z = (self._setting.from_base(self._places[name]) + noise).tolist()
        return (x, y, z), None


def draw_plausible_stiffness(robot: Robot, random: np.random.Generator) -> FloatArray:
    """Draw random stiffnesses (n,) typical of arms of this size [N·m/rad, N/m of a prismatic joint].

    The typical stiffness of a revolute joint grows with the square of the joint's distance from the flange,
    so that all joints move the tool by similar lengths, and with the cube of the arm's reach. Each stiffness
    is multiplied by a random lognormal factor.
    """
    zero_posture = Postures(robot, np.zeros((1, robot.n)))
    origins = zero_posture.joint_frames[1][0]  # (n, 3) [m]
    flange = zero_posture.flange_translation  # (1, 3) [m]
    link_lengths = np.linalg.norm(np.diff(np.concatenate([origins, flange]), axis=0), axis=1)  # (n,)
    # A joint's lever is the length of the chain of links from the joint to the flange.
    levers = np.maximum(np.cumsum(link_lengths[::-1])[::-1], 1e-3)
    reach = float(levers.max())
    relative_levers = np.maximum(levers / reach, _SHORTEST_LEVER)
    revolute = _BASE_JOINT_STIFFNESS * (reach / _USUAL_REACH) ** 3 * relative_levers**2
    typical = np.where(robot.prismatic, _LINEAR_STIFFNESS * reach / _USUAL_REACH, revolute)
    return np.asarray(typical * np.exp(_LOG_STIFFNESS_SPREAD * random.standard_normal(robot.n)))


_LENGTHS: Final = {"mm": 1e-3, "m": 1.0, "um": 1e-6, "in": 0.0254}
"""Unit of length → its size [m]."""
_FIELDS: Final = ("target", "x", "y", "z", "sigma")
"""Names that a column of a line may have."""
_CELL: Final = r"[^,;\s]+"
_SEPARATOR: Final = r"[,;\s]+"
_DEFAULT_FORMAT: Final = (
    rf"(?:(?P<target>{_CELL}){_SEPARATOR})?"
    + rf"(?P<x>{_CELL}){_SEPARATOR}(?P<y>{_CELL}){_SEPARATOR}(?P<z>{_CELL})"
)
"""Regular expression of a line with three coordinates, or with a target and three coordinates."""
_MOST_USELESS_LINES: Final = 20
"""Number of lines without a reading after which reading from a source fails."""
_LONGEST_LINE: Final = 65_536
_KEPT_LINES: Final = 1_000


@dataclass(frozen=True)
class Profile:
    """Format of a line of text with a reading, and the unit of its lengths."""

    pattern: re.Pattern[str]  # with the groups x, y, z; the groups target and sigma are optional
    format_phrase: str  # phrase for people about the format, such as "as columns target, x, y, z"
    unit: str  # unit of lengths: mm, m, um or in

    @classmethod
    def from_options(cls, pattern: str | None, columns: str | None, unit: str) -> Profile:
        """Return the profile of lines with the format `pattern` or `columns`.

        If neither is stated, lines have the format `x y z` or `target x y z`.

        Args:
            pattern: regular expression with the groups x, y and z, and perhaps target and sigma.
            columns: names of columns in order, separated by commas.
            unit: unit of lengths.

        Raises:
            RequestError: x, y and z are not named, both `pattern` and `columns` are stated, or the unit is
                unknown.
        """
        if unit not in _LENGTHS:
            raise RequestError(
                f"'{unit}' is not a unit of length",
                where="source_unit",
                remedy=f"give one of {', '.join(_LENGTHS)}",
            )
        if pattern is None:
            return cls._from_columns(
                [name.strip() for name in (columns or "").split(",") if name.strip()], unit
            )
        if columns is not None:
            raise RequestError(
                "both `pattern` and `columns` describe the lines",
                where="columns",
                remedy="omit one of the two options",
            )
        try:
            compiled = re.compile(pattern)
        except re.error as error:
            raise RequestError(
                f"the pattern is not a valid regular expression: {error}",
                where="pattern",
                remedy="correct the regular expression",
            ) from error
        if not {"x", "y", "z"} <= set(compiled.groupindex):
            raise RequestError(
                "the pattern has no groups x, y and z",
                where="pattern",
                remedy=r"name the groups, such as (?P<target>\w+) (?P<x>\S+) (?P<y>\S+) (?P<z>\S+)",
            )
        return cls(compiled, f"by the pattern {pattern}", unit)

    @classmethod
    def _from_columns(cls, names: list[str], unit: str) -> Profile:
        """Return the profile of lines with columns of these names; a column with the name `-` is not read.

        Without names, lines have the format `x y z` or `target x y z`.

        Raises:
            RequestError: the names do not include x, y and z, or a name is unknown or repeated.
        """
        read_names = [name for name in names if name != "-"]
        has_needed_columns = {"x", "y", "z"} <= set(read_names) <= set(_FIELDS)
        if names and (not has_needed_columns or len(read_names) != len(set(read_names))):
            raise RequestError(
                f"the columns '{','.join(names)}' must name x, y and z, and no column twice",
                where="columns",
                remedy="name the columns in order, such as target,x,y,z or -,x,y,z,sigma",
            )
        cells = [_CELL if name == "-" else f"(?P<{name}>{_CELL})" for name in names]
        line_format = _SEPARATOR.join(cells) if cells else _DEFAULT_FORMAT
        format_phrase = f"as columns {', '.join(names)}" if names else "as [target] x y z"
        return cls(re.compile(rf"^[,;\s]*{line_format}[,;\s]*$"), format_phrase, unit)

    def read(self, line: str) -> tuple[str | None, Point] | None:
        """Return (target, (position, uncertainty)) of a line [m]; None if the line is no reading.

        The target is None if the line names none, the uncertainty None if the line states none.
        """
        match = self.pattern.search(line)
        groups = {} if match is None else match.groupdict()
        texts = {name: text for name, text in groups.items() if text is not None}
        try:
            x, y, z = (_LENGTHS[self.unit] * float(texts[axis]) for axis in "xyz")
            sigma = _LENGTHS[self.unit] * float(texts["sigma"]) if "sigma" in texts else None
        except (KeyError, ValueError):
            return None
        if not all(map(math.isfinite, (x, y, z))):
            return None
        return texts.get("target"), ((x, y, z), sigma)

    def describe(self, line: str | None) -> str:
        """Return a description of the profile for people; with `line` as an example if it is a reading."""
        text = f"lines are read {self.format_phrase}, lengths in {self.unit}"
        reading = None if line is None else self.read(line)
        if reading is None:
            return text
        target, ((x, y, z), sigma) = reading
        target_text = "the requested target" if target is None else f"target {target}"
        sigma_text = "" if sigma is None else f", uncertainty {1e6 * sigma:.3g} µm"
        shown = "".join(c if c.isprintable() else " " for c in (line or "").strip())[:200]
        return f"{text}\n  {shown!r} is {target_text} at x {x:.6f} m, y {y:.6f} m, z {z:.6f} m{sigma_text}"


class Lines(Source):
    """Lines of text from a serial line, a TCP connection or UDP: an instrument, or any script."""

    def __init__(
        self,
        address: str,
        *,
        pattern: str | None = None,
        columns: str | None = None,
        source_unit: str = "mm",
        request: str | None = None,
        baud: int = 9600,
        sample: bool = True,
        warn: Callable[[str], object] = lambda _: None,
    ) -> None:
        """Set up a source of lines; `open` connects to the address.

        Args:
            address: file of a serial line, `tcp://host:port`, or `udp://[host]:port` to listen at.
            pattern: regular expression with the groups x, y and z; the groups target and sigma are optional.
            columns: names of columns in order, such as `target,x,y,z`; default: x,y,z or target,x,y,z.
            source_unit: unit of lengths, mm, m, um or in.
            request: text that is sent, with a newline, before each reading; {target}, {state}, {label},
                {joints} and {force} in it are replaced. None: nothing is sent.
            baud: bits a second of a serial line.
            sample: True if `profile` is to wait for a line and to show how the line is read.
            warn: function that is called with a message about each line that is no reading.

        Raises:
            RequestError: the address or the profile cannot be understood.
        """
        self._profile = Profile.from_options(pattern, columns, source_unit)
        self.unit = source_unit
        self._address, self._url = address, urlsplit(address)
        self._request, self._baud, self._sample, self._warn = request, baud, sample, warn
        is_net = self._url.scheme in {"tcp", "udp"}
        try:
            port = self._url.port
        except ValueError:
            port = None
        # TCP needs a host and a port; UDP only listens, and needs a port.
        is_incomplete = is_net and (port is None or (self._url.scheme == "tcp" and not self._url.hostname))
        if is_incomplete or not address or (self._url.scheme and not is_net):
            raise RequestError(
                f"'{address}' is not an address from which lines can be read",
                where="source",
                remedy="write lines:/dev/ttyUSB0, lines:tcp://host:port or lines:udp://:port",
            )
        if request is not None and self._url.scheme == "udp":
            raise RequestError(
                "a source over UDP only receives lines and cannot send `request`",
                where="request",
                remedy="omit `request`, or use TCP",
            )
        self._lines: deque[str] = deque(maxlen=_KEPT_LINES)  # received lines that were not read yet
        self._kept_points: dict[str, Point] = {}  # target → reading that was received before its request
        self.names: Mapping[str, str | None] = {}
        self.unknown: dict[str, Place] = {}
        self._warned_names: set[str] = set()  # names of no target, each warned about once
        self._buffer = b""  # received bytes of a line that is not complete yet
        self._end_reason: str | None = "not open"  # why no lines come; None while connected
        self._stand: Stand | None = None  # posture and load of the targets that are read now
        self._disconnect: Callable[[], None] = lambda: None  # replaced when connected
        self._send: Callable[[bytes], object] = lambda _: None

    async def open(self, setting: Setting) -> None:
        """Connect to the address."""
        self._has_changed = asyncio.Event()  # set when lines were received or the source has ended
        self._targets = tuple(setting.targets)
        self._first_target = next(iter(setting.targets), "")
        await self._connect()

    async def profile(self) -> str | None:
        """Describe how lines are read; with the first reading as example if the option `sample` is true."""
        if not self._sample:
            return self._profile.describe(None)
        self._request_reading(self._first_target)
        line = await self._next_line()
        while self._profile.read(line) is None:
            self._warn_of(line)
            line = await self._next_line()
        self._lines.appendleft(line)  # put back, as it is also the first reading
        return self._profile.describe(line)

    async def stand(self, stand: Stand) -> None:
        """Drop the lines received so far: they belong to another posture or another load."""
        if self._end_reason is not None:
            await self._connect()
        if stand != self._stand:
            self.unknown.clear()
        self._stand = stand
        self._lines.clear()
        self._kept_points.clear()

    async def point(self, name: str) -> Point:
        """Return the next reading of a target; readings of other targets are kept until they are requested.

        Raises:
            SourceError: the source has stopped, or sent too many lines that are no readings.
        """
        if name in self._kept_points:
            return self._kept_points.pop(name)
        useless_lines, is_requested = 0, False
        while useless_lines < _MOST_USELESS_LINES:
            if not self._lines and not is_requested:
                self._request_reading(name)
                is_requested = True
            line = await self._next_line()
            reading = self._profile.read(line)
            if reading is None:
                self._warn_of(line)
                useless_lines += 1
                continue
            sent_name, point = reading
            target = self.names.get(sent_name, sent_name) if sent_name is not None else name
            if target == name:  # a line without a name belongs to the requested target
                return point
            if target is not None:
                self._keep(target, point)
        raise SourceError(
            f"the source sent {_MOST_USELESS_LINES} lines that contain no reading",
            remedy="state the form of a line with `columns` or `pattern`",
        )

    async def close(self) -> None:
        """Close the connection."""
        self._disconnect()

    def _keep(self, name: str, point: Point) -> None:
        """Keep the reading of a target until it is requested; warn once of a name that is no target."""
        if name in self._targets:
            self._kept_points[name] = point
            return
        self.unknown[name] = point[0]
        if name not in self._warned_names:
            self._warned_names.add(name)
            self._warn(
                f"{name!r} is no target of this campaign, whose targets are {', '.join(self._targets)}"
            )

    def _warn_of(self, line: str) -> None:
        """Warn the user of a line that is no reading."""
        shown = "".join(c if c.isprintable() else "�" for c in line)[:80]
        self._warn(f"{shown!r} is not a reading and is ignored")

    def _request_reading(self, name: str) -> None:
        """Send the request for a reading of a target; do nothing if the source needs no request."""
        if self._request is None:
            return
        stand = self._stand
        # Text of each placeholder in the request.
        texts = {
            "{target}": name,
            "{state}": "loaded" if stand is not None and stand.loaded else "unloaded",
            "{label}": "" if stand is None else stand.label,
            "{joints}": "" if stand is None else " ".join(map(repr, stand.joints)),
            "{force}": "" if stand is None else " ".join(map(repr, stand.force)),
        }
        text = re.sub(r"\{\w+\}", lambda match: texts.get(match[0], match[0]), self._request)
        self._send(text.encode() + b"\n")

    async def _next_line(self) -> str:
        """Return the next received line; wait for a line if all were read.

        Raises:
            SourceError: the source has ended.
        """
        while not self._lines:
            if self._end_reason is not None:
                raise SourceError(
                    f"the source has stopped: {self._end_reason}",
                    remedy="start the source again, then read again",
                )
            self._has_changed.clear()
            await self._has_changed.wait()
        return self._lines.popleft()

    def _receive(self, data: bytes) -> None:
        """Split received bytes into lines; an incomplete last line is kept in the buffer."""
        *complete_lines, incomplete_line = re.split(rb"[\r\n]+", self._buffer + data)
        self._buffer = incomplete_line[-_LONGEST_LINE:]
        self._lines.extend(line.decode("utf-8", "replace") for line in complete_lines if line.strip())
        self._has_changed.set()

    def _end_source(self, reason: str) -> None:
        """Store the reason why no more lines come, and wake the reader."""
        self._end_reason = reason
        self._has_changed.set()

    async def _connect(self) -> None:
        """Connect to the address, by TCP, UDP or a serial line; an earlier connection is closed first."""
        self._disconnect()
        self._buffer, loop, url = b"", asyncio.get_running_loop(), self._url
        if url.scheme == "tcp":
            transport, _ = await loop.create_connection(
                lambda: _Stream(self), url.hostname or "", url.port or 0
            )
            self._send, self._disconnect = transport.write, transport.close
        elif url.scheme == "udp":
            local = (url.hostname or "0.0.0.0", url.port or 0)  # noqa: S104 - instruments are other machines
            datagrams, _ = await loop.create_datagram_endpoint(lambda: _Datagrams(self), local)
            self._disconnect = datagrams.close
        else:
            self._connect_serial(loop)
        self._end_reason = None

    def _connect_serial(self, loop: asyncio.AbstractEventLoop) -> None:
        """Open the serial line and let the event loop read from it."""
        descriptor = _open_serial_line(self._address, self._baud)

        def receive_available() -> None:
            """Read the received bytes; end the source if the line was hung up."""
            reason = "the line was hung up"
            try:
                data = os.read(descriptor, 4096)
            except BlockingIOError:
                return
            except OSError as error:
                data, reason = b"", str(error)
            if data:
                self._receive(data)
            else:
                loop.remove_reader(descriptor)
                self._end_source(reason)

        def disconnect() -> None:
            """Stop reading from the serial line, and close it."""
            loop.remove_reader(descriptor)
            os.close(descriptor)
            self._disconnect = lambda: None

        loop.add_reader(descriptor, receive_available)
        self._send, self._disconnect = lambda data: os.write(descriptor, data), disconnect


def _open_serial_line(address: str, baud: int) -> int:
    """Open a serial line and set its speed; return its file descriptor.

    Raises:
        SourceError: the file is not a serial line, or the line has no such speed.
    """
    import termios
    import tty

    descriptor = os.open(address, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    speed = getattr(termios, f"B{baud}", None)
    if not os.isatty(descriptor) or speed is None:
        is_serial_line = os.isatty(descriptor)
        os.close(descriptor)
        if is_serial_line:
            raise SourceError(
                f"a serial line cannot run at {baud} bits per second",
                remedy="give a usual rate: 9600 or 115200",
            )
        raise SourceError(
            f"{address} is not a serial line", remedy="give the device of a serial line, such as /dev/ttyUSB0"
        )
    tty.setraw(descriptor)
    attributes = termios.tcgetattr(descriptor)
    attributes[4] = attributes[5] = speed  # elements 4 and 5 are the speeds of input and output
    termios.tcsetattr(descriptor, termios.TCSANOW, attributes)
    return descriptor


class _Stream(asyncio.Protocol):
    """TCP connection that hands received bytes to a source of lines."""

    def __init__(self, lines: Lines) -> None:
        self._lines = lines

    def data_received(self, data: bytes) -> None:
        self._lines._receive(data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._lines._end_source("the connection was closed" if exc is None else str(exc))


class _Datagrams(asyncio.DatagramProtocol):
    """UDP socket of a source of lines.

    Once a sender has sent a reading, datagrams of all other senders are ignored.
    """

    def __init__(self, lines: Lines) -> None:
        self._lines, self._sender = lines, None

    def datagram_received(self, data: bytes, addr: Any) -> None:  # noqa: ANN401 - of the system
        if self._sender is None and any(
            self._lines._profile.read(line) for line in data.decode("utf-8", "replace").splitlines()
        ):
            self._sender = addr[0]
        if self._sender in (None, addr[0]):
            self._lines._receive(data + b"\n")


class RoboDk(Source):
    """The laser tracker of a RoboDK station, with a simulated or a connected robot."""

    def __init__(self, address: str = "") -> None:
        """Connect to RoboDK.

        Raises:
            SourceError: the package `robodk` is not installed.
        """
        try:
            from robodk import robolink  # type: ignore[import-not-found]
        except ImportError:
            raise SourceError(
                "the source `robodk` needs RoboDK's Python package, which is not installed",
                remedy="install the package with `pip install robodk`, and start RoboDK",
            ) from None
        self._link, self._name = robolink.Robolink(), address

    async def open(self, setting: Setting) -> None:
        """Store the robot and the targets of the campaign, which the expected positions are computed from."""
        self._setting = setting

    async def stand(self, stand: Stand) -> None:
        """Compute the expected positions of the targets in a posture, in the tracker's frame [mm]."""
        setting, names = self._setting, list(self._setting.targets)
        posture = Postures(setting.robot, setting.robot.joint_map.model_angles(np.array([stand.joints])))
        places = posture.to_base(np.array([[setting.targets[name] for name in names]], dtype=np.float64))[0]
        self._expected = {
            name: (1e3 * setting.from_base(place)).tolist() for name, place in zip(names, places, strict=True)
        }

    async def point(self, name: str) -> Point:
        """Measure a target near its expected position; return its position [m] and None."""
        measured = await asyncio.to_thread(self._link.LaserTracker_Measure, self._expected[name], True)
        if measured is None:
            raise SourceError(
                f"the tracker did not find {name}", remedy="aim the tracker at the target, then read again"
            )
        x, y, z = (1e-3 * float(part) for part in measured)
        return (x, y, z), None
