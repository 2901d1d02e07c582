"""Moves in their states: added to the columns with targets and frames, or with the cause against this."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from itertools import chain
from typing import Final

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
from robotprograms.declarations import UNKNOWN, Content, State
from robotprograms.errors import quote_text
from robotprograms.frames import FrameFinder
from robotprograms.language import Name
from robotprograms.notation import Orientation, iterate_integers
from robotprograms.places import Place
from robotprograms.program import At, FrameName, Literal, Motion
from robotprograms.reaching import reach
from robotprograms.statements import Statements

_MAX_LISTED: Final = 10
"""Largest number of routines that a remark names."""


def _identify(frames: Frames) -> tuple[object, ...]:
    """Return a key of a base and a tool, which is equal for equal frames: name and numbers of each."""
    parts: list[object] = []
    for frame in frames:
        if isinstance(frame, FrameName) and frame.pose is not None:  # arrays have no hash
            parts.append((frame.name, frame.pose.tobytes()))
        else:
            parts.append(frame)
    return tuple(parts)


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
        self._offsets_of: dict[str, set[str]] = defaultdict(set)  # targets by names of poses at offsets
        # names of targets near which moves with these frames go
        self._noted_offsets: dict[tuple[object, ...], set[str]] = defaultdict(set)
        self._targets: set[str] = set()  # names of the targets of moves
        # names from which the place of a left move was calculated, by the frames of the move
        self._noted_origins: dict[tuple[object, ...], set[str]] = defaultdict(set)

    def collect_targets(self) -> None:
        """Collect the names of the targets of moves, and of poses at offsets from them.

        Where such a pose is used otherwise than as a target, so are the numbers of the target behind it.
        """
        moves = list[tuple[Place, ir.Move]]()
        for place, op in zip(self._places, self._ops, strict=True):
            if isinstance(op, ir.Move):
                moves.append((place, op))
        for place, move in moves:
            self._targets.update(self._list_named_targets(place, move))
        for place, offset in self._uses.offsets:
            self._offsets_of[place.qualify(offset.name)].add(place.qualify(offset.target))
        for place, move in moves:
            if self._is_near_target(place, move):  # the offset itself is part of a calculation
                self._uses.used |= dict.fromkeys(self._list_named_targets(place, move), place.at)
        self._mark_targets_behind_offsets()

    def _mark_targets_behind_offsets(self) -> None:
        """Mark targets as used where a pose at an offset from them is used otherwise than as a target."""
        traced = set[str]()
        for name in sorted(self._offsets_of.keys() & self._uses.used.keys()):
            place_of_use = self._uses.used[name]
            for target in self._trace_offsets([name], traced):
                self._uses.used.setdefault(target, place_of_use)

    @staticmethod
    def _list_named_targets(place: Place, op: ir.Move) -> list[str]:
        """Return the names of the targets of a move."""
        return [place.qualify(each) for each in op.targets if not isinstance(each, Literal)]

    def _is_near_target(self, place: Place, op: ir.Move) -> bool:
        """Return whether a move goes to an offset from a target, and not to numbers in a frame.

        Both are written alike: which one is meant depends on whether the name is that of a target.
        """
        if op.near_target is None:
            return False
        names = {place.qualify(name) for name in op.near_target.offset_from}
        is_offset_of_offset = not names.isdisjoint(self._offsets_of)
        return is_offset_of_offset or not names.isdisjoint(self._targets)

    def _list_offsets(self, place: Place, op: ir.Move, frames: list[Frames]) -> list[str]:
        """Return the names of targets near which a move goes, because its own targets are offsets from them.

        Targets at the end of a calculation are returned once only for moves with the same frames, which are
        base and tool of each target of the move.
        """
        near = [place.qualify(name) for name in op.offset_from]
        names = [*near, *self._list_named_targets(place, op)]
        are_any_calculated = not self._offsets_of.keys().isdisjoint(names)
        if are_any_calculated:
            traced_with_frames = self._noted_offsets[_identify(frames[0])]
            near += self._trace_offsets(names, traced_with_frames)
        return near

    def _trace_offsets(self, names: Iterable[str], traced: set[str]) -> list[str]:
        """Return the names of all targets from which poses with these names are at an offset.

        Names in `traced` are left out, and those that are found are added to it: each is found once.
        """
        return [target for _, target in reach(names, self._list_targets_near, traced)]

    def _list_targets_near(self, name: str) -> list[str]:
        """Return the targets from which a pose is at an offset."""
        return sorted(self._offsets_of.get(name, ()))

    def record(self, op: ir.Move | ir.MoveToStored, i: int, state: State | None) -> None:
        """Add the moves of an operation to the columns, or the cause why they cannot be corrected.

        Moves behind this one that differ from it in their numbers only are repetitions of one operation.

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
        if state is None:
            state = {UNKNOWN: (Cause(0, "the program never reaches this line", "omit the move"), At())}
        if op.near_target and self._is_near_target(place, op):
            op = op.near_target
        lines, numbers = self._list_repetitions(i)
        if len(lines) and op.differs_only_in_target:
            frames, cause = self._evaluate_frames(op, place, state)
            if cause is None:
                self._note_certain_move(state)
                lines, numbers = np.append(place.line, lines), np.append(place.first, numbers)
                feeds = self._find_feeds(op, place, numbers, state)
                self._columns.add_moves(op, place.source, lines, numbers, frames[0], feeds)
                return
        self._add_move(op, place, state)
        for line, number in zip(iterate_integers(lines), iterate_integers(numbers), strict=True):
            self._add_move(op, replace(place, line=line, first=number), state)

    def _list_repetitions(self, i: int) -> tuple[IndexArray, IndexArray]:
        """Return the lines (k,) of the moves that repeat operation i with other numbers.

        The second result is the index (k,) of the first number of each of these moves.
        """
        lines_and_numbers = np.asarray(self._statements.repeats.get(i, ()), dtype=np.intp)
        lines, numbers = lines_and_numbers.reshape(-1, 2).T
        return lines, numbers

    def _evaluate_frames(self, op: ir.Move, place: Place, state: State) -> tuple[list[Frames], Cause | None]:
        """Find the frames of a move at a place of the program, where names have the contents in `state`.

        Returns:
            Base and tool of each target; the cause why the move cannot be corrected, None if it can be.
        """
        frames = list[Frames]()
        for base, tool in zip(op.bases, op.tools, strict=True):
            base_frame = self._frames.evaluate(place, base, state)
            frames.append((base_frame, self._frames.evaluate(place, tool, state)))
        return frames, self._find_obstacle(place, op, frames, state)

    def _note_certain_move(self, state: State) -> None:
        """Note that a move is certain: behind the call of a routine of another file only by an assumption."""
        is_behind_unknown = UNKNOWN in state or UNKNOWN in self._changes.anytime
        if is_behind_unknown and self._calls.unknown_routines:
            self._needs_assumption = True

    def _find_feeds(self, op: ir.Move, place: Place, first: IndexArray, state: State) -> FloatArray:
        """Return the speeds (k,) of the tool's centre [mm/s] that moves with the same text state.

        The speed is NaN if it is unknown, not positive, or replaced by the time of the move; and for a move
        of the joints, which has no speed of the tool.

        Args:
            op: the moves.
            place: place of the first of them.
            first: (k,) index of the first number of each statement among those of the file.
            state: contents of all names at these moves.
        """
        feed = op.feed
        if feed is None or op.motion is Motion.JOINT:
            return np.full(len(first), np.nan)
        if isinstance(feed.value, Literal):
            (ordinal, *_) = feed.value.numbers
            numbers = place.values[first + ordinal]
        else:
            numbers = np.full(len(first), self._find_named_feed(place, feed, feed.value, state))
        percentage = self._find_number(place, feed.percentage, 100.0, state)
        greatest = self._find_number(place, feed.greatest, np.inf, state)
        speeds = np.minimum(numbers * feed.unit * percentage / 100.0, greatest)
        is_stated = (speeds > 0.0) & (speeds <= MAX_VALUE)
        if feed.time is not None:  # a time that is not zero counts in place of the speed
            times = place.values[first + feed.time]
            is_stated &= times == 0.0
        return np.where(is_stated, speeds, np.nan)

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
        frames, cause = self._evaluate_frames(op, place, state)
        if cause is None:
            self._note_certain_move(state)
        for name in self._list_offsets(place, op, frames):
            self._note_offset(place, name, frames[0], state)
        targets: list[WrittenNumbers] = []
        for target in op.targets:
            content = self._evaluate_target(place, target, state)
            if isinstance(content, WrittenNumbers):
                targets.append(content)
            else:
                cause = cause or content
        if cause is None:
            feed = float(self._find_feeds(op, place, np.array([place.first]), state)[0])
            self._columns.add_move(op, place.line, targets, frames, None, feed)
            return
        self._note_left_move(place, op, frames, state)
        if not cause.line:  # the cause has no place of its own
            cause = cause._replace(line=place.line, source=place.source)
        self._columns.add_move(op, place.line, targets, frames, cause, np.nan)

    def _note_left_move(self, place: Place, op: ir.Move, frames: list[Frames], state: State) -> None:
        """Note that a move which is not corrected needs the numbers of its targets as they are.

        Used numbers stay in their declaration. If a target was calculated of others, the move shifts with the
        correction of these others.
        """
        for target in self._list_named_targets(place, op):
            is_calculated = target in self._uses.origins
            if is_calculated:
                self._note_offset(place, target, frames[0], state)
            else:
                self._uses.used[target] = place.at

    def _note_offset(self, place: Place, name: Name, frames: Frames, state: State) -> None:
        """Note that a move goes to an offset from a target, or to what was calculated of targets.

        A correction of these targets shifts the move; the columns refuse the correction if the move has other
        frames (base and tool) than the target.
        """
        target = self._evaluate_target(place, name, state)
        if isinstance(target, WrittenNumbers):
            self._columns.add_offset(target, frames, place.line)
        # Names from which the name was calculated, each of them once for the same frames: copies may be
        # copied many times.
        noted_with_frames = self._noted_origins[_identify(frames)]
        for _, origin in reach([place.qualify(name)], self._list_origins, noted_with_frames):
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
        if op.reason:
            return place.make_cause(op.reason, op.remedy)
        for target in op.targets:
            if isinstance(target, Literal) and (cause := self._refuse_axes_in_variable(place, target, state)):
                return cause
        for name in self._changes.lasting:  # offsets, tracking, force control
            content, _ = self._contents.look_up(state, name)
            if isinstance(content, Cause):
                return content
        for frame in chain(*frames):
            if isinstance(frame, Cause):
                return frame
        return self._find_other_frame(place, op, frames, state)

    def _find_other_frame(
        self, place: Place, op: ir.Move, frames: list[Frames], state: State
    ) -> Cause | None:
        """Return the cause if a frame is active with which the target was not recorded.

        This concerns languages whose positions state their frames, as those of FANUC do: the controller stops
        at such a move. An unknown active frame is no cause, because the move then has the right one.

        Args:
            place: place of the move.
            op: the move.
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

        `state` has the contents of all names at `place`. If the numbers of a named target have to stay in its
        declaration, the reason is noted.
        """
        if isinstance(target, Literal):
            return WrittenNumbers("", place.source, place.line, place.first, target)
        name = place.qualify(target)
        content, _ = self._contents.look_up(state, name)
        unknown = f"the target {quote_text(name)} is not given by constant numbers"
        if not isinstance(content, WrittenNumbers):
            reason = self._explain_unknown_content(name, content)
        elif content.literal.notation.orientation is Orientation.NONE:
            reason = "it is no pose"
        elif name in self._declarations.stored:  # other programs, or a computer, may set it at any time
            reason = "the declaration is shared with other programs"
        else:
            return self._settle_target(place, name, content._replace(label=name), unknown)
        return place.make_cause(f"{unknown}: {reason}" if reason else unknown, self._language.remedy)

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

        Axes whose numbers are known and zero carry nothing, and give no cause.
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

        The use of a value is not known, and counts as one, if its name is that of a routine of another file,
        or of data that the program does not declare.
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

        A target decides also through values that are calculated of its numbers.
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
