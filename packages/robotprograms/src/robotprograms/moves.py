"""Moves in their states: added to the columns with targets and frames, or with the cause against this."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cached_property
from itertools import chain
from typing import Final, NamedTuple

import numpy as np

from robotprograms import language as ir
from robotprograms.arrays import FloatArray, IndexArray
from robotprograms.calls import Calls
from robotprograms.columns import (
    MAX_VALUE,
    OF_ROUTINE,
    Cause,
    Frames,
    WrittenNumbers,
    is_without_axes,
)
from robotprograms.control_flow import ControlFlow
from robotprograms.declarations import UNKNOWN, Content, Entry, State
from robotprograms.errors import quote_text
from robotprograms.frames import FrameFinder
from robotprograms.language import Name
from robotprograms.notation import Orientation, iterate_integers
from robotprograms.places import Place
from robotprograms.program import FrameName, Literal, Motion
from robotprograms.reaching import reach
from robotprograms.statements import Statements

_MAX_LISTED: Final = 10
"""Largest number of routines that a remark names."""


def _identify(frames: Frames) -> tuple[object, ...]:
    """Return a key of a base and a tool, which is equal for equal frames: name and numbers of each.

    The bytes of the numbers take the place of their array, because an array cannot be a part of a key.
    """
    parts: list[object] = []
    for frame in frames:
        if isinstance(frame, FrameName) and frame.pose is not None:
            parts.append((frame.name, frame.pose.tobytes()))
        else:
            parts.append(frame)
    return tuple(parts)


class _ReadTargets(NamedTuple):
    """Targets of a move, as far as their numbers are known."""

    numbers: list[WrittenNumbers]  # targets whose numbers are known
    cause: Cause | None  # why the numbers of another target are not known; None if all are known


class _FramesOfMove(NamedTuple):
    """Base and tool of each target of a move, and whether the move can be corrected in them."""

    of_targets: list[Frames]  # a `Cause` in place of a frame that is not known
    cause: Cause | None  # why the move cannot be corrected, apart from its targets; None if it can be

    @property
    def of_first(self) -> Frames:
        """Base and tool of the first target."""
        return self.of_targets[0]


class _Repetitions(NamedTuple):
    """Moves whose text differs from that of a move before them in its numbers only."""

    lines: IndexArray  # (k,) line of each of these moves
    first: IndexArray  # (k,) index of the first number of each of them among those of the file

    def list_places(self, place: Place) -> Iterator[Place]:
        """Yield the place of the move itself, and those of its repetitions."""
        yield place
        lines, firsts = iterate_integers(self.lines), iterate_integers(self.first)
        for line, first in zip(lines, firsts, strict=True):
            yield replace(place, line=line, first=first)


def _make_state_of_unreached() -> State:
    """Return the contents of all names at a move that the program never reaches: all of them are unknown."""
    cause = Cause(0, "the program never reaches this line", "omit the move")
    return {UNKNOWN: Entry.from_content(cause)}


def _complete_place(cause: Cause, place: Place) -> Cause:
    """Return a cause with the place of its move, unless the cause has a place of its own."""
    return cause if cause.line else cause._replace(line=place.line, source=place.source)


def _find_unknown_frame(frames: list[Frames]) -> Cause | None:
    """Return the cause of the first base or tool that is not known; None if all are known."""
    for frame in chain(*frames):
        if isinstance(frame, Cause):
            return frame
    return None


class MoveRecorder:
    """Recorder of the moves of a program."""

    def __init__(self, statements: Statements, flow: ControlFlow, calls: Calls) -> None:
        """Prepare to record the moves of a program with its control flow and calls."""
        self._statements, self._ops, self._places = statements, statements.ops, statements.places
        self._language, self._contents = statements.language, statements.contents
        self._declarations, self._uses = statements.declarations, statements.uses
        self._changes, self._columns = statements.changes, statements.columns
        self._flow, self._calls, self._frames = flow, calls, FrameFinder(statements)
        self._needs_assumption = False  # whether moves are certain that come behind calls of unknown routines
        self._shared_with_remark: set[str] = set()  # targets of other programs, too, that have a remark
        self._targets: set[str] = set()  # names of the targets of moves
        # by the name of a pose that is calculated at an offset from targets, the names of these targets
        self._targets_near: dict[str, set[str]] = defaultdict(set)
        # by base and tool of moves, the targets that were found for such moves by these calculations
        self._found_near: dict[tuple[object, ...], set[str]] = defaultdict(set)
        # by base and tool of moves that are not corrected, the names from which their places were calculated
        self._found_origins: dict[tuple[object, ...], set[str]] = defaultdict(set)

    def collect_targets(self) -> None:
        """Collect the targets of moves, and the poses that are calculated at an offset from a target.

        In URScript, `p2 = pose_trans(p1, p[0,0,0.1,0,0,0])` is such a pose, 0.1 m from p1. Where p2 is used
        for something else than a move, so is p1: then the numbers of p1 have to stay as they are.
        """
        moves = self._list_moves()
        for place, move in moves:
            self._targets.update(self._list_named_targets(place, move))
        for place, offset in self._uses.offsets:
            self._targets_near[place.qualify(offset.name)].add(place.qualify(offset.target))
        for place, move in moves:
            if self._is_near_target(place, move):  # the offset itself is part of a calculation
                self._uses.used |= dict.fromkeys(self._list_named_targets(place, move), place.at)
        self._mark_targets_behind_offsets()

    def _list_moves(self) -> list[tuple[Place, ir.Move]]:
        """Return the moves of the program, each with its place."""
        moves = list[tuple[Place, ir.Move]]()
        for place, op in zip(self._places, self._ops, strict=True):
            if isinstance(op, ir.Move):
                moves.append((place, op))
        return moves

    def _mark_targets_behind_offsets(self) -> None:
        """Mark targets as used where a pose at an offset from them is used for something else than a move."""
        found = set[str]()
        for pose in sorted(self._targets_near.keys() & self._uses.used.keys()):
            place_of_use = self._uses.used[pose]
            for target in self._find_targets_behind([pose], found):
                self._uses.used.setdefault(target, place_of_use)

    @staticmethod
    def _list_named_targets(place: Place, op: ir.Move) -> list[str]:
        """Return the full names of a move's targets, such as p1; targets in numbers have no name."""
        return [place.qualify(each) for each in op.targets if not isinstance(each, Literal)]

    def _is_near_target(self, place: Place, op: ir.Move) -> bool:
        """Return whether `movel(pose_trans(p1, p[0,0,0.1,0,0,0]))` goes to a place near the target p1.

        The same text may mean numbers in the frame p1. Only the whole program shows which one is meant: p1 is
        a target if another move goes to it, or if p1 is itself calculated at an offset from a target. The
        move `op` goes to numbers in a frame, and `op.near_target` is its other meaning; None if it has no
        other one.
        """
        if op.near_target is None:
            return False
        names = {place.qualify(name) for name in op.near_target.offset_from}  # such as p1
        is_any_a_target = not names.isdisjoint(self._targets)
        is_any_calculated_from_target = not names.isdisjoint(self._targets_near)
        return is_any_a_target or is_any_calculated_from_target

    def _list_targets_near_move(self, place: Place, op: ir.Move, frames: _FramesOfMove) -> list[str]:
        """Return the targets at an offset from which a move ends, so that their correction shifts the move.

        The move itself states them (`op.offset_from`), or its target was calculated of them: behind the line
        `p2 = pose_trans(p1, ...)`, the move `movel(p2)` ends at an offset from p1. If many moves go to p2,
        then p1 is returned for the first one of them only, and once again for moves in another base or tool.
        """
        stated = [place.qualify(name) for name in op.offset_from]
        names = [*stated, *self._list_named_targets(place, op)]
        is_any_calculated = not self._targets_near.keys().isdisjoint(names)
        if not is_any_calculated:
            return stated
        found_before = self._found_near[_identify(frames.of_first)]
        return stated + self._find_targets_behind(names, found_before)

    def _find_targets_behind(self, poses: Iterable[str], found_before: set[str]) -> list[str]:
        """Find the targets from which poses are at an offset, directly or through other poses.

        Behind `p2 = pose_trans(p1, ...)` and `p3 = pose_trans(p2, ...)`, p3 is at an offset from p2 and p1.

        Args:
            poses: full names of the poses.
            found_before: targets that are left out; those that are found here are added to this set.
        """
        return [target for _, target in reach(poses, self._list_targets_near, found_before)]

    def _list_targets_near(self, name: str) -> list[str]:
        """Return the targets from which a line of the program calculates the pose with this name."""
        return sorted(self._targets_near.get(name, ()))

    def record(self, op: ir.Move | ir.MoveToStored, i: int, state: State | None) -> None:
        """Add the moves of an operation to the columns, or the cause why they cannot be corrected.

        The columns are the arrays of all targets and moves of the program. Moves behind this one that differ
        from it in their numbers only, such as `LIN {X 1,...}` and `LIN {X 2,...}`, are repetitions of one
        operation.

        Args:
            op: the operation.
            i: its index.
            state: contents of all names at the operation; None if the program never reaches it.
        """
        place = self._places[i]
        if isinstance(op, ir.MoveToStored):
            text = f"a move to {op.name}, a position stored in the controller"
            self._columns.add_remark(place.at, text, op.name)
            return
        move = self._choose_meaning(place, op)
        state_at_move = _make_state_of_unreached() if state is None else state
        repetitions = self._list_repetitions(i)
        if self._add_moves_at_once(move, place, repetitions, state_at_move):
            return
        for place_of_move in repetitions.list_places(place):
            self._add_move(move, place_of_move, state_at_move)

    def _choose_meaning(self, place: Place, move: ir.Move) -> ir.Move:
        """Return the move that a statement means: one to a place near a target, or to a target in a frame.

        `movel(pose_trans(p1, ...))` has both meanings; any other move has only one.
        """
        if move.near_target is not None and self._is_near_target(place, move):
            return move.near_target
        return move

    def _add_moves_at_once(self, op: ir.Move, place: Place, repetitions: _Repetitions, state: State) -> bool:
        """Add a move and its repetitions as whole columns, because long programs are mostly such moves.

        Return False, and add nothing, if the move has no repetitions, if it cannot be corrected, or if its
        target is a name: then each move has to be added on its own.
        """
        if len(repetitions.lines) == 0 or not op.differs_only_in_target:
            return False
        frames = self._evaluate_frames(op, place, state)
        if frames.cause is not None:
            return False
        self._note_certain_move(state)
        lines = np.append(place.line, repetitions.lines)
        first = np.append(place.first, repetitions.first)
        feeds = self._find_feeds(op, place, first, state)
        self._columns.add_moves(op, place.source, lines, first, frames.of_first, feeds)
        return True

    def _list_repetitions(self, i: int) -> _Repetitions:
        """Return the moves that repeat operation i with other numbers."""
        lines_and_firsts = np.asarray(self._statements.repeats.get(i, ()), dtype=np.intp)
        lines, first = lines_and_firsts.reshape(-1, 2).T
        return _Repetitions(lines, first)

    def _evaluate_frames(self, op: ir.Move, place: Place, state: State) -> _FramesOfMove:
        """Find base and tool of each target of a move, and whether anything there forbids a correction.

        Args:
            op: the move, which names its frames, or has those that are active.
            place: place of the move in the program.
            state: contents of all names there.
        """
        frames = list[Frames]()
        for base, tool in zip(op.bases, op.tools, strict=True):
            base_frame = self._frames.evaluate(place, base, state)
            frames.append((base_frame, self._frames.evaluate(place, tool, state)))
        return _FramesOfMove(frames, self._find_obstacle(place, op, frames, state))

    def _note_certain_move(self, state: State) -> None:
        """Note whether the frames and targets of a move are known only by an assumption.

        It is assumed that routines of other files, which were called before the move, leave what the program
        stores. `note_assumption` writes one remark for all such moves.
        """
        is_behind_unknown = UNKNOWN in state or UNKNOWN in self._changes.anytime
        if is_behind_unknown and self._calls.unknown_routines:
            self._needs_assumption = True

    def _find_feeds(self, op: ir.Move, place: Place, first: IndexArray, state: State) -> FloatArray:
        r"""Return the speeds (k,) of the tool's centre [mm/s] that moves with the same text state.

        The speed is NaN if it is unknown, not positive, or replaced by the time of the move, such as the
        option `\T:=3` of RAPID; and for a move of the joints, which has no speed of the tool.

        Args:
            op: the moves.
            place: place of the first of them.
            first: (k,) index of the first number of each statement among those of the file.
            state: contents of all names at these moves.
        """
        feed = op.feed
        if feed is None or op.motion is Motion.JOINT:
            return np.full(len(first), np.nan)
        numbers = self._find_numbers_of_feed(feed, place, first, state)
        percentage = self._find_number(place, feed.percentage, 100.0, state)
        greatest = self._find_number(place, feed.greatest, np.inf, state)
        speeds = np.minimum(numbers * feed.unit * percentage / 100.0, greatest)
        is_stated = (speeds > 0.0) & (speeds <= MAX_VALUE)
        if feed.time is not None:  # a time that is not zero counts in place of the speed
            times = place.values[first + feed.time]
            is_stated &= times == 0.0
        return np.where(is_stated, speeds, np.nan)

    def _find_numbers_of_feed(
        self, feed: ir.Feed, place: Place, first: IndexArray, state: State
    ) -> FloatArray:
        """Return the numbers (k,) of a feed, in its own unit, that moves state as a number or by a name.

        A number, as in `100mm/sec`, differs from move to move: it has an ordinal, its index among the numbers
        of each statement. A name, as in `v100`, has the same number for all. The other arguments are those of
        `_find_feeds`.
        """
        if isinstance(feed.value, Literal):
            (ordinal, *_) = feed.value.numbers
            return np.asarray(place.values[first + ordinal])
        return np.full(len(first), self._find_named_feed(place, feed, feed.value, state))

    def _find_named_feed(self, place: Place, feed: ir.Feed, value: ir.Copy, state: State) -> float:
        """Return the number of the feed that a move states by a name; NaN if it is unknown.

        A name that the program does not declare means data of the controller, such as `v100` of ABB.
        """
        content = self._look_up(place, value, state)
        if isinstance(content, WrittenNumbers):
            return self._contents.read_number(content)
        return np.nan if self._has_data(place, value.name) else feed.otherwise

    def _find_number(self, place: Place, name: str, default: float, state: State) -> float:
        """Return the number that a name has at a place, where the contents of all names are in `state`.

        The number is the default if no statement sets it, or if the name is empty; NaN if it is unknown.
        """
        if not name or not self._has_data(place, name):
            return default
        content = self._look_up(place, ir.Copy(name), state)
        return self._contents.read_number(content) if isinstance(content, WrittenNumbers) else np.nan

    def _look_up(self, place: Place, copy: ir.Copy, state: State) -> Content:
        """Return the content of the name that a value copies: numbers, the cause against them, or a name."""
        no_label = ""  # the numbers get no name of their own
        return self._contents.evaluate(place, no_label, copy, state)

    def _has_data(self, place: Place, name: ir.Name) -> bool:
        """Return whether a name means a variable of the program, which declares or changes it.

        A full name with the name of a routine in it is that of a local variable.
        """
        full_name = place.qualify(name)
        is_local = OF_ROUTINE in full_name
        is_declared = is_local or full_name in self._declarations.names
        return is_declared or bool(self._changes.find(full_name))

    def _add_move(self, op: ir.Move, place: Place, state: State) -> None:
        """Add one move to the columns, with its targets and frames, or with the cause against a correction.

        `state` has the contents of all names at the move.
        """
        frames = self._evaluate_frames(op, place, state)
        if frames.cause is None:
            self._note_certain_move(state)
        for name in self._list_targets_near_move(place, op, frames):
            self._note_offset(place, name, frames.of_first, state)
        targets = self._evaluate_targets(op, place, state)
        cause, feed = frames.cause or targets.cause, np.nan
        if cause is None:
            (feed,) = self._find_feeds(op, place, np.array([place.first]), state).tolist()
        else:
            self._keep_targets_of_move(place, op, frames, state)
            cause = _complete_place(cause, place)
        self._columns.add_move(op, place.line, targets.numbers, frames.of_targets, cause, feed)

    def _evaluate_targets(self, op: ir.Move, place: Place, state: State) -> _ReadTargets:
        """Find the numbers of a move's targets at a place, where all names have the contents in `state`."""
        numbers = list[WrittenNumbers]()
        first_cause: Cause | None = None
        for target in op.targets:
            content = self._evaluate_target(place, target, state)
            if isinstance(content, WrittenNumbers):
                numbers.append(content)
            else:
                first_cause = first_cause or content
        return _ReadTargets(numbers, first_cause)

    def _keep_targets_of_move(self, place: Place, op: ir.Move, frames: _FramesOfMove, state: State) -> None:
        """Note that a move which is not corrected needs the numbers of its named targets as they are.

        So the declaration of a target such as p1 has to stay. A target that was calculated has no
        declaration: the correction of the targets behind its calculation then shifts the move.
        """
        for target in self._list_named_targets(place, op):
            is_calculated = target in self._uses.origins
            if is_calculated:
                self._note_offset(place, target, frames.of_first, state)
            else:
                self._uses.used[target] = place.at

    def _note_offset(self, place: Place, name: Name, frames: Frames, state: State) -> None:
        """Note that a move goes to an offset from a target, or to what was calculated of targets.

        A correction of these targets shifts the move. The columns add a remark, and refuse the correction if
        the move has another base or tool than the target.

        Args:
            place: place of the move.
            name: name of the target, or of the calculated pose.
            frames: base and tool of the move.
            state: contents of all names at the move.
        """
        target = self._evaluate_target(place, name, state)
        if isinstance(target, WrittenNumbers):
            self._columns.add_offset(target, frames, place.line)
        # Copies may be copied many times: each name is followed once for the same base and tool.
        found_before = self._found_origins[_identify(frames)]
        for _, origin in reach([place.qualify(name)], self._list_origins, found_before):
            numbers = self._find_numbers_on_any_path(origin)
            if isinstance(numbers, WrittenNumbers) and origin not in self._uses.used:
                self._columns.add_offset(numbers._replace(label=origin), frames, place.line)

    def _list_origins(self, name: str) -> list[str]:
        """Return the names from which a name was calculated."""
        return list(self._uses.origins.get(name, ()))

    def _find_numbers_on_any_path(self, name: str) -> Content | None:
        """Return the content that a name has on any path of execution; None if it never gets numbers.

        It is the content of the declaration if no statement changes it, else numbers of an assignment.
        """
        is_never_changed = not self._changes.of_name.get(name)
        if name in self._declarations.initial and is_never_changed:
            return self._declarations.initial[name]
        return self._assigned_numbers.get(name)

    @cached_property
    def _assigned_numbers(self) -> dict[str, WrittenNumbers]:
        """Numbers that assignments give to names; the last assignment of a name in the text counts."""
        assigned = dict[str, WrittenNumbers]()
        for place, op in zip(self._places, self._ops, strict=True):
            if isinstance(op, ir.Assign) and isinstance(op.value, Literal):
                numbers = WrittenNumbers("", place.source, place.line, place.first, op.value)
                assigned[place.qualify(op.name)] = numbers
        return assigned

    def _find_obstacle(self, place: Place, op: ir.Move, frames: list[Frames], state: State) -> Cause | None:
        """Return the cause why a move cannot be corrected, apart from its targets; None without a cause.

        Args:
            place: place of the move.
            op: the move.
            frames: base and tool of each target; a `Cause` in place of a frame that is not known.
            state: contents of all names at the move.
        """
        stated_cause = place.make_cause(op.reason, op.remedy) if op.reason else None
        return (
            stated_cause
            or self._find_axes_in_variable(place, op, state)
            or self._find_active_shift(state)
            or _find_unknown_frame(frames)
            or self._find_other_frame(place, op, frames, state)
        )

    def _find_axes_in_variable(self, place: Place, op: ir.Move, state: State) -> Cause | None:
        """Return the cause if a target of a move has external axes in a variable, which may carry the arm."""
        for target in op.targets:
            if isinstance(target, Literal) and (cause := self._refuse_axes_in_variable(place, target, state)):
                return cause
        return None

    def _find_active_shift(self, state: State) -> Cause | None:
        """Return the cause if what lasts moves the targets, such as an offset, tracking or force control."""
        for name in self._changes.lasting:
            content, _ = self._contents.look_up(state, name)
            if isinstance(content, Cause):
                return content
        return None

    def _find_other_frame(
        self, place: Place, op: ir.Move, frames: list[Frames], state: State
    ) -> Cause | None:
        """Return the cause if a frame is active with which the target was not recorded.

        In FANUC's programs a position states its frames, as in `P[1]{ GP1: UF : 1, UT : 2, ...`: the
        controller stops at a move to P[1] if another UFRAME_NUM or UTOOL_NUM is active. An active frame that
        is not known is no cause: a move that the controller runs then has the right one.

        Args:
            place: place of the move.
            op: the move; `op.matched_frames` has the names of the active base and tool.
            frames: base and tool of each target.
            state: contents of all names at the move.
        """
        for active_name, frame in zip(op.matched_frames, frames[0], strict=False):
            active_frame, _ = self._contents.look_up(state, active_name)
            if isinstance(active_frame, Cause):
                continue
            is_unchanged_since_start = active_frame == self._language.active[active_name]
            is_that_of_target = isinstance(frame, FrameName) and active_frame == frame.name
            if not (is_unchanged_since_start or is_that_of_target):
                reason = f"the target is recorded with another {active_name} than the active one"
                return place.make_cause(reason, "activate the frame with which the target is recorded")
        return None

    def _evaluate_target(self, place: Place, target: Literal | Name, state: State) -> WrittenNumbers | Cause:
        """Return the numbers of a target, or the cause why these numbers are unknown.

        A target is numbers in the move itself, or a name such as p1, whose content is in `state`. If the
        numbers of p1 have to stay in its declaration, the reason is noted.
        """
        if isinstance(target, Literal):
            return WrittenNumbers("", place.source, place.line, place.first, target)
        name = place.qualify(target)
        content, _ = self._contents.look_up(state, name)
        unknown = f"the target {quote_text(name)} is not given by constant numbers"
        if isinstance(content, WrittenNumbers):
            reason = self._explain_unusable_numbers(name, content)
            if not reason:
                return self._settle_target(place, name, content._replace(label=name), unknown)
        else:
            reason = self._explain_unknown_content(name, content)
        return place.make_cause(f"{unknown}: {reason}" if reason else unknown, self._language.remedy)

    def _explain_unusable_numbers(self, name: str, numbers: WrittenNumbers) -> str:
        """Return why the numbers of a name are no target that can be corrected; empty if they are one."""
        if numbers.literal.notation.orientation is Orientation.NONE:
            return "it is no pose"
        if name in self._declarations.stored:  # other programs, or a computer, may set it at any time
            return "the declaration is shared with other programs"
        return ""

    def _explain_unknown_content(self, name: str, content: Cause | str) -> str:
        """Return why the content of a name is not known at a move; empty if there is no certain reason."""
        if another := self._find_another_content(name):
            return another.reason
        return content.reason if isinstance(content, Cause) and content.line else ""

    def _find_another_content(self, name: str) -> Cause | None:
        """Return the last change of a name that has several contents in the program; None if it has one."""
        changes = self._changes.of_name.get(name, [])
        is_declared = name in self._declarations.initial
        return changes[-1] if len(changes) + is_declared > 1 else None

    def _refuse_axes_in_variable(self, place: Place, target: Literal, state: State) -> Cause | None:
        """Return the cause against a correction if a variable has external axes that may carry the arm.

        ABB writes such a target as `[[x,y,z],[q1,...],[cf1,...],axes1]` with a variable axes1. Axes whose
        numbers are known and zero carry nothing, and give no cause.
        """
        if not target.axes_name:
            return None
        content, _ = self._contents.look_up(state, place.qualify(target.axes_name))
        if isinstance(content, WrittenNumbers):
            axes = self._contents.read_numbers(content)
            if is_without_axes(axes):
                return None
        variable = quote_text(target.axes_name)
        reason = f"the external axes are in the variable {variable}, and may carry the arm"
        return place.make_cause(reason, "write the numbers of the external axes at the target")

    def _settle_target(
        self, place: Place, name: str, numbers: WrittenNumbers, unknown: str
    ) -> WrittenNumbers:
        """Return the numbers of a target at a move; note why the numbers in its declaration have to stay.

        Args:
            place: place of the move.
            name: full name of the target.
            numbers: numbers of the target.
            unknown: beginning of the reason if the target gets numbers more than once.
        """
        if another := self._find_another_content(name):
            self._keep_numbers(place, numbers, f"{unknown}: {another.reason}")
        elif name in self._declarations.shared and name not in self._shared_with_remark:
            self._shared_with_remark.add(name)
            text = f"{quote_text(name)} is GLOBAL: its correction moves it for other programs, too"
            self._columns.add_remark(place.at, text)
        return numbers

    def _keep_numbers(self, place: Place, numbers: WrittenNumbers, reason: str) -> None:
        """Note why the numbers of a target have to stay in its declaration."""
        cause = place.make_cause(reason, self._language.remedy)
        self._columns.keep_numbers(numbers, cause, place.line)

    def trace_uses(self) -> None:
        """Mark the numbers from which a value is calculated as used, wherever the value is used.

        Behind `a := p1.trans.x;`, the call `Grind a;` of a routine in another file uses the numbers of p1,
        which then have to stay. A value whose name is that of a routine of another file, or of data that the
        program does not declare, counts as used.
        """
        used, origins = self._uses.used, self._uses.origins
        calculated = origins.keys() - {ir.CONDITION}
        used_or_foreign = [name for name in calculated if name in used or not self._is_own_name(name)]
        for name, origin in reach(used_or_foreign, self._list_origins, set(used)):
            used[origin] = origins[name][origin]

    def _is_own_name(self, name: str) -> bool:
        """Return whether a full name is that of a variable or a routine of this program.

        A full name with the name of a routine in it is that of a local variable.
        """
        is_local = OF_ROUTINE in name
        return is_local or name in self._declarations.names or name in self._flow.begins

    def remark_conditions(self) -> None:
        """Add a remark for each target that is corrected and whose numbers decide a condition.

        `IF p1.trans.x>100 THEN` is such a condition. A target decides also through values that are calculated
        of its numbers.
        """
        place_of_condition = dict(self._uses.origins[ir.CONDITION])  # by the names that decide conditions
        for name, origin in reach([*place_of_condition], self._list_all_origins, set(place_of_condition)):
            place_of_condition[origin] = place_of_condition[name]
        deciding_targets = place_of_condition.keys() & self._targets
        for name in sorted(deciding_targets - self._uses.used.keys()):
            target, _, _ = name.partition(OF_ROUTINE)
            text = f"numbers of the target {quote_text(target)} decide here, and the correction changes them"
            self._columns.add_remark(place_of_condition[name], text)

    def _list_all_origins(self, name: str) -> list[str]:
        """Return the names from which a name was calculated, and targets from which it is at an offset."""
        return sorted({*self._list_origins(name), *self._list_targets_near(name)})

    def note_assumption(self) -> None:
        """Add a remark on what routines of other files are assumed to leave, if moves behind them need it."""
        if not self._needs_assumption:
            return
        routines = [*self._calls.unknown_routines]
        names = ", ".join(map(quote_text, routines[:_MAX_LISTED]))
        more = len(routines) - _MAX_LISTED
        others = f" and {more} more" if more > 0 else ""
        text = "it is assumed that these routines leave the stored frames and points of the program unchanged"
        self._columns.add_remark(self._calls.first_unknown, f"{text}: {names}{others}")
