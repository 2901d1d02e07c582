"""Proposal of a robot for the meaning of tables: columns, units, frame, targets and states, with a margin."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.meaning.budget import Budget
from jointstiff.solver.meaning.decision import (
    LARGEST_PART,
    LARGEST_RESIDUAL,
    LEAST_SHARE,
    Decision,
    decide,
    explains_by_rounding,
    find_doubt,
    find_near,
    fits,
    is_computed,
)
from jointstiff.solver.meaning.hypotheses import build_joints, build_points
from jointstiff.solver.meaning.kinematics import FlangeModel
from jointstiff.solver.meaning.refinement import FramePlacement, RigidFit, fit_frame, fit_targets
from jointstiff.solver.meaning.search import (
    REFINED_ROWS,
    Interpretation,
    choose_rows,
    find_interpretations,
)
from jointstiff.solver.meaning.table import JointColumns, LengthUnit, PointColumns, Table
from jointstiff.solver.mechanics.robot import Robot

_SAME_PLACE: Final = 0.02
"""Distance [m] of places on the flange up to which two readings are states of one target."""
_EXCHANGES: Final = ((1, 0, 2), (2, 1, 0), (0, 2, 1))
"""Orders of x, y and z after an exchange of two of them."""


@dataclass(frozen=True, eq=False)
class TargetReading:
    """Positions of one target in one state."""

    points: PointColumns
    index: int  #: row of each posture, from 0
    target: int  #: number of the target, from 1
    state: int  #: number of the state in the order of the columns, from 0
    place: FloatArray  #: (3,) on the flange [m]
    positions: FloatArray  #: (N, 3) in R0 [m]; NaN where no position is
    distances: FloatArray  #: (N,) from the place by the robot [m]; NaN where no position is


@dataclass(frozen=True, eq=False)
class Proposal:
    """Meaning of tables by the robot that fits."""

    joints: JointColumns
    readings: tuple[TargetReading, ...]
    unit: LengthUnit  #: of the positions
    frame: FramePlacement  #: of the positions in R0
    residual: float  #: median distance of the positions from their places by the robot [m]
    next_residual: float  #: the same of the best reading that contradicts [m]; infinite without one
    fitting: int  #: number of positions that fit
    count: int  #: number of positions
    doubt: str = ""  #: question that the numbers cannot decide

    @property
    def margin(self) -> float:
        """Ratio of the next reading's median distance to that of this reading."""
        return self.next_residual / self.residual

    @property
    def is_in_base_frame(self) -> bool:
        """Return whether the positions are in R0 as they are written."""
        return self.frame.is_base

    def with_axes(self, order: tuple[int, int, int]) -> Proposal:
        """Return the proposal with the columns of x, y and z in another order, and the frame turned alike.

        `order` are the numbers, 0 to 2, of the columns that become x, y and z.
        """
        readings = []
        for reading in self.readings:
            x, y, z = (reading.points.columns[axis] for axis in order)
            readings.append(replace(reading, points=replace(reading.points, columns=(x, y, z))))
        frame = replace(self.frame, rotation=self.frame.rotation[:, list(order)])
        return replace(self, readings=tuple(readings), frame=frame)

    @property
    def target_count(self) -> int:
        """Number of targets."""
        return max(reading.target for reading in self.readings)


@dataclass(frozen=True, eq=False)
class Proposals:
    """Answer of the robots: a proposal with a margin, or the reason why there is none."""

    best: Proposal | None  #: None without a margin
    reason: str  #: why there is no proposal; empty with one
    readings: tuple[Interpretation, ...]  #: all readings that were compared, the smallest residual first


def propose(tables: Sequence[Table], robot: Robot, budget: Budget | None = None) -> Proposals:
    """Find the meaning of tables: columns that say where the robot's joints move targets (method.md §17).

    Args:
        tables: numbers of files, the joints in one of them.
        robot: robot that was measured.
        budget: fits and time of this search and others; None for a budget of its own.

    Raises:
        BudgetExceeded: too many columns may be joints or positions.
    """
    # Cells without a number are NaN, and a target without any position has neither median nor deviation.
    with np.errstate(invalid="ignore", divide="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        interpretations = find_interpretations(tables, robot, budget or Budget())
        decision = decide(interpretations)
        if decision.best is None:
            return Proposals(None, decision.reason, tuple(interpretations))
        neighbours = _list_neighbours(tables, decision.best)
        candidates = (decision.best, *decision.shifted, *neighbours)
        proposals = [_build_proposal(tables, chosen, decision, interpretations) for chosen in candidates]
    # An interpretation that reads x, y and z from two states of a target explains fewer positions.
    best = max(proposals, key=lambda proposal: proposal.count)
    if best.frame.is_mirrored:
        best = _exchange_axes(best)
    return Proposals(best, "", tuple(interpretations))


def _exchange_axes(proposal: Proposal) -> Proposal:
    """Return a proposal in a left-handed frame with two of x, y and z exchanged, in a right-handed frame.

    Of the three exchanges, the one whose frame is turned least against R0 is chosen.
    """
    rotation = proposal.frame.rotation
    return proposal.with_axes(max(_EXCHANGES, key=lambda order: float(np.trace(rotation[:, list(order)]))))


def _list_neighbours(tables: Sequence[Table], interpretation: Interpretation) -> Iterator[Interpretation]:
    """Yield interpretations whose x, y and z begin one column earlier or later, if they fit.

    The loaded position is so near to the unloaded one that y and z of the first, and x of the second, fit as
    well, in a frame with exchanged axes. Rows with damaged numbers may have hidden the right columns.
    """
    table = next(table for table in tables if table.name == interpretation.joints.table)
    flange = place_flange(table, interpretation)
    rows = choose_rows(len(flange.place), REFINED_ROWS)
    hypotheses = list(build_points(tables, table, interpretation.joints.groups, rows))
    for shift in (-1, 1):
        first, second, third = (column + shift for column in interpretation.points.columns)
        wanted = replace(interpretation.points, columns=(first, second, third))
        points = next((each.points for each in hypotheses if each.columns == wanted), None)
        if points is not None and _is_free(wanted, (), interpretation.joints):
            fit = _fit_shifted(interpretation.fit, flange.select(rows), points, shift)
            neighbour = replace(interpretation, points=wanted, fit=fit)
            if fits(neighbour) and not is_computed(neighbour):
                yield neighbour


def _fit_shifted(fit: RigidFit, flange: FlangePlacement, points: FloatArray, shift: int) -> RigidFit:
    """Fit the frame of positions whose columns are `shift` columns away from those of another fit.

    Column i then has the coordinate of column i − shift, so that the fit begins with exchanged axes.

    Args:
        fit: the other fit.
        flange: flange in N postures.
        points: (N, K, 3) positions in the unit of the file.
        shift: −1 or 1.
    """
    exchanged_axes = np.roll(np.eye(3), -shift, axis=1)
    matrix = fit.frame.scale * fit.frame.rotation @ exchanged_axes
    return fit_frame(flange.rotation, flange.place, points, matrix, fit.targets)


def _build_proposal(
    tables: Sequence[Table],
    interpretation: Interpretation,
    decision: Decision,
    interpretations: Sequence[Interpretation],
) -> Proposal:
    """Build a proposal from an interpretation of one triple of columns as the positions of a target.

    All other triples of columns that fit with the same joints and the same frame are further targets, or the
    same target in another state, such as under load.

    Args:
        tables: numbers of files.
        interpretation: meaning of the columns of the joints, and of one triple of positions.
        decision: decision for this interpretation, with those that have the same effect or contradict it.
        interpretations: all interpretations that were compared.
    """
    table = next(table for table in tables if table.name == interpretation.joints.table)
    readings = _find_readings(tables, table, interpretation, place_flange(table, interpretation))
    distances = np.column_stack([reading.distances for reading in readings])
    residual = float(np.nanmedian(distances))
    rival = decision.next
    return Proposal(
        joints=interpretation.joints,
        readings=tuple(_number_targets(readings)),
        unit=interpretation.fit.unit,
        frame=interpretation.fit.frame,
        residual=residual,
        next_residual=np.inf if rival is None else rival.fit.typical,
        fitting=int(find_near(distances).sum()),
        count=int(np.isfinite(distances).sum()),
        doubt=find_doubt(interpretation, interpretations),
    )


class FlangePlacement(NamedTuple):
    """Flange in N postures."""

    rotation: FloatArray  # (N, 3, 3)
    place: FloatArray  # (N, 3) [m]

    def select(self, rows: IndexArray) -> FlangePlacement:
        """Return the flange in some of the postures, given by their indices."""
        return FlangePlacement(self.rotation[rows], self.place[rows])


def place_flange(table: Table, interpretation: Interpretation) -> FlangePlacement:
    """Return the flange in all postures of a table of joints."""
    robot = interpretation.robot
    q = read_positions(table, interpretation.joints, robot)
    return FlangePlacement(*FlangeModel.of(robot).place_flange(q))


def read_positions(table: Table, joints: JointColumns, robot: Robot) -> FloatArray:
    """Return the positions (N, n) [rad or m] of the model's joints in all postures of a table of joints."""
    row_count, _ = table.size
    all_postures = np.arange(row_count // joints.groups.count)
    by_unit = build_joints(table, joints.columns, joints.groups, all_postures, robot, [joints.counting])
    return next(hypothesis.q for hypothesis in by_unit if hypothesis.columns.unit == joints.unit)


def _find_readings(
    tables: Sequence[Table],
    joint_table: Table,
    interpretation: Interpretation,
    flange: FlangePlacement,
) -> list[TargetReading]:
    """Return the positions that fit, in the order of tables and columns; each column is used once.

    Numbers of target and state are zero, as they follow only when all readings are known.

    Args:
        tables: numbers of files.
        joint_table: table with the joints.
        interpretation: meaning of its columns, with the frame of the positions.
        flange: flange in all N postures.
    """
    fitting = list(_list_fitting_points(tables, joint_table, interpretation, flange))
    used = _choose_disjoint(fitting, interpretation.joints)
    number_of_table = {table.name: number for number, table in enumerate(tables)}
    used.sort(key=lambda points: (number_of_table[points.columns.table], points.columns.columns))
    return [reading for points in used for reading in points.list_readings()]


def _list_fitting_points(
    tables: Sequence[Table],
    joint_table: Table,
    interpretation: Interpretation,
    flange: FlangePlacement,
) -> Iterator[_PointSet]:
    """Yield the columns that can be positions of targets: near where the robot would put some targets.

    Args:
        tables: numbers of files.
        joint_table: table with the joints.
        interpretation: meaning of its columns, with the frame of the positions.
        flange: flange in all N postures.
    """
    all_postures = np.arange(len(flange.place))
    for hypothesis in build_points(tables, joint_table, interpretation.joints.groups, all_postures):
        positions = interpretation.fit.frame.to_base(hypothesis.points)
        targets, distances = fit_targets(flange.rotation, flange.place, positions)
        is_chosen = hypothesis.columns == interpretation.points
        if is_chosen or _fit_as_targets(positions, distances, interpretation):
            yield _PointSet(hypothesis.columns, targets, positions, distances, is_chosen=is_chosen)


def _choose_disjoint(fitting: Sequence[_PointSet], joints: JointColumns) -> list[_PointSet]:
    """Return positions that share no column with each other, nor with the joints.

    Of positions that share a column, the chosen ones or those with the smallest distance are used.
    """
    used: list[_PointSet] = []
    for points in sorted(fitting, key=lambda points: points.rank):
        used_columns = [other.columns for other in used]
        if _is_free(points.columns, used_columns, joints):
            used.append(points)
    return used


@dataclass(frozen=True, eq=False)
class _PointSet:
    """Positions of K targets that fit."""

    columns: PointColumns
    targets: FloatArray  #: (K, 3) places on the flange [m]
    positions: FloatArray  #: (N, K, 3) in R0 [m]
    distances: FloatArray  #: (N, K) [m]
    is_chosen: bool  #: whether the frame was fitted to these positions

    @property
    def rank(self) -> tuple[bool, float]:
        """Order in which positions are accepted: the chosen ones first, then by their median distance."""
        return not self.is_chosen, float(np.nanmedian(self.distances))

    def list_readings(self) -> Iterator[TargetReading]:
        """Yield the positions of each of the K targets, without numbers of target and state yet."""
        for k, target in enumerate(self.targets):
            yield TargetReading(
                points=self.columns,
                index=k,
                target=0,
                state=0,
                place=target,
                positions=self.positions[:, k],
                distances=self.distances[:, k],
            )


def _is_free(columns: PointColumns, used: Sequence[PointColumns], joints: JointColumns) -> bool:
    """Return whether columns of positions are neither joints nor positions that are used already."""
    are_joints = columns.table == joints.table and bool(set(columns.columns) & set(joints.columns))
    are_used = any(columns.overlaps(other) for other in used)
    return not are_joints and not are_used


def _fit_as_targets(positions: FloatArray, distances: FloatArray, interpretation: Interpretation) -> bool:
    """Return whether positions (N, K, 3) [m] are those of measured targets.

    Most positions must be near where the robot would put them, but not as near as computed positions. They
    must also be near in comparison with the movement of the targets: a target at rest is near any place.

    Args:
        positions: in R0 [m].
        distances: (N, K) distances from where the robot would put the targets [m].
        interpretation: joints of the positions, and the frame of the positions.
    """
    is_known = np.isfinite(distances)
    if is_known.mean() < LEAST_SHARE:
        return False
    known_distances = distances[is_known]
    typical = float(np.median(known_distances))
    movement = float(np.nanstd(positions, axis=0).max())
    largest_typical = min(LARGEST_RESIDUAL, LARGEST_PART * movement)
    most_are_near = float(np.mean(find_near(distances)[is_known])) >= LEAST_SHARE
    fits_as_readings = typical < largest_typical and most_are_near
    return fits_as_readings and not explains_by_rounding(interpretation, typical)


def _number_targets(readings: Sequence[TargetReading]) -> Iterator[TargetReading]:
    """Yield the readings with numbers of target and state: readings at one place are states of one target."""
    places: list[FloatArray] = []  # of each target on the flange
    state_counts: list[int] = []  # of each target
    for reading in readings:
        distances = [float(np.linalg.norm(reading.place - place)) for place in places]
        is_new_target = min(distances, default=np.inf) > _SAME_PLACE
        if is_new_target:
            places.append(reading.place)
            state_counts.append(0)
        target = len(places) - 1 if is_new_target else int(np.argmin(distances))
        yield replace(reading, target=target + 1, state=state_counts[target])
        state_counts[target] += 1
