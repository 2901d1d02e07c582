"""Moves in their states: added to the columns with targets and frames, or with the cause against this."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace
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
        self._noted: set[str] = set()  # shared names of targets about which a remark was made
        self._offsets_of: dict[str, set[str]] = defaultdict(set)  # targets by names of poses at offsets
        # names of targets near which moves with these frames go
        self._noted_offsets: dict[tuple[object, ...], set[str]] = defaultdict(set)
        self._targets: set[str] = set()  # names of the targets of moves
        # numbers that assignments give to names; None before they are needed
        self._assigned: dict[str, WrittenNumbers] | None = None
        # names from which the place of a left move was calculated, by the frames of the move
        self._noted_origins: dict[tuple[object, ...], set[str]] = defaultdict(set)

    def collect_targets(self) -> None:
        """Collect the names of the targets of moves, and of poses at offsets from them.

        Where such a pose is used otherwise than as a target, so are the numbers of the target behind it.
        """
        places = zip(self._places, self._ops, strict=True)
        moves = [(place, op) for place, op in places if isinstance(op, ir.Move)]
        for place, move in moves:
            self._targets.update(self._list_named_targets(place, move))
        for place, offset in self._uses.offsets:
            self._offsets_of[place.qualify(offset.name)].add(place.qualify(offset.target))
        for place, move in moves:
            if self._is_near_target(place, move):  # the offset itself is part of a calculation
                self._uses.used |= dict.fromkeys(self._list_named_targets(place, move), place.at)
        known = set[str]()
        for name in sorted(self._offsets_of.keys() & self._uses.used.keys()):
            for target in self._trace_offsets([name], known):
                self._uses.used.setdefault(target, self._uses.used[name])

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
        """Return the names of targets near which a move goes; calculated ones once for the same frames.

        `frames` are base and tool of each target of the move.
        """
        near = [place.qualify(name) for name in op.offset_from]
        names = [*near, *self._list_named_targets(place, op)]
        are_any_calculated = not self._offsets_of.keys().isdisjoint(names)
        if are_any_calculated:
            known = self._noted_offsets[_identify(frames[0])]
            near += self._trace_offsets(names, known)
        return near

    def _trace_offsets(self, names: Iterable[str], known: set[str]) -> list[str]:
        """Return the names of all targets from which poses with these names are at an offset.

        Names in `known` are left out, and those that are found are added to it: each is found once.
        """
        return [target for _, target in reach(names, self._list_targets_near, known)]

    def _list_targets_near(self, name: str) -> list[str]:
        """Return the targets from which a pose is at an offset."""
        return sorted(self._offsets_of.get(name, ()))

    def record(self, op: ir.Move | ir.MoveToStored, i: int, state: State | None) -> None:
        """Add the moves of an operation to the columns, or the cause why they cannot be corrected.

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
        if self._is_near_target(place, op) and op.near_target:
            op = op.near_target
        # Lines and first numbers of the moves behind this one that differ from it in their numbers only
        repeats = np.asarray(self._statements.repeats.get(i, ()), dtype=np.intp)
        lines, numbers = repeats.reshape(-1, 2).T
        if len(lines) and op.differs_only_in_target:
            frames, cause = self._evaluate_frames(op, place, state)
            if cause is None:
                lines, numbers = np.append(place.line, lines), np.append(place.first, numbers)
                feeds = self._find_feeds(op, place, numbers, state)
                self._columns.add_moves(op, place.source, lines, numbers, frames[0], feeds)
                return
        self._add_move(op, place, state)
        for line, number in zip(iterate_integers(lines), iterate_integers(numbers), strict=True):
            self._add_move(op, replace(place, line=line, first=number), state)

    def _evaluate_frames(self, op: ir.Move, place: Place, state: State) -> tuple[list[Frames], Cause | None]:
        """Find the frames of a move at a place of the program, where names have the contents in `state`.

        Returns:
            Base and tool of each target; the cause why the move cannot be corrected, None if it can be.
        """
        frames = list[Frames]()
        for base, tool in zip(op.bases, op.tools, strict=True):
            base_frame = self._frames.evaluate(place, base, state)
            frames.append((base_frame, self._frames.evaluate(place, tool, state)))
        cause = self._find_obstacle(place, op, frames, state)
        # Behind the call of a routine of another file, the move is certain under an assumption only.
        is_behind_unknown = UNKNOWN in state or UNKNOWN in self._changes.anytime
        if cause is None and is_behind_unknown and self._calls.unknown_routines:
            self._needs_assumption = True
        return frames, cause

    def _find_feeds(self, op: ir.Move, place: Place, first: IndexArray, state: State) -> FloatArray:
        """Return the speeds (k,) of the tool's centre that moves with the same text state [mm/s], or NaN.

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
        if feed.time is not None:  # a time in place of the speed
            is_stated &= place.values[first + feed.time] == 0.0
        return np.where(is_stated, speeds, np.nan)

    def _find_named_feed(self, place: Place, feed: ir.Feed, value: ir.Copy, state: State) -> float:
        """Return the number of the feed that a move states by a name; NaN if it is unknown.

        A name that the program does not declare means data of the controller, such as `v100` of ABB.
        """
        content = self._contents.evaluate(place, "", value, state)
        if isinstance(content, WrittenNumbers):
            return self._read_number(content)
        return np.nan if self._has_data(place, value.name) else feed.otherwise

    def _find_number(self, place: Place, name: str, default: float, state: State) -> float:
        """Return the number of a name in a state: a default if no statement sets it, NaN if it is unknown."""
        if not name or not self._has_data(place, name):
            return default
        content = self._contents.evaluate(place, "", ir.Copy(name), state)
        return self._read_number(content) if isinstance(content, WrittenNumbers) else np.nan

    def _read_number(self, content: WrittenNumbers) -> float:
        """Return the first of the numbers of a content."""
        values = self._statements.numerals[content.source].values
        return float(values[content.first + content.literal.numbers[0]])

    def _has_data(self, place: Place, name: ir.Name) -> bool:
        """Return whether the program declares or changes a name."""
        name = place.qualify(name)
        is_declared = name in self._declarations.names or OF_ROUTINE in name
        return is_declared or bool(self._changes.find(name))

    def _add_move(self, op: ir.Move, place: Place, state: State) -> None:
        """Add one move to the columns, with its targets in a state, or with the cause against correction."""
        frames, cause = self._evaluate_frames(op, place, state)
        for name in self._list_offsets(place, op, frames):
            self._note_offset(place, name, frames[0], state)
        targets: list[WrittenNumbers] = []
        for target in op.targets:
            content = self._evaluate_target(place, target, state)
            if isinstance(content, WrittenNumbers):
                targets.append(content)
            else:
                cause = cause or content
        if cause is not None:
            self._note_left_move(place, op, frames, state)
            if not cause.line:
                cause = cause._replace(line=place.line, source=place.source)
        feed = np.nan
        if cause is None:
            feed = float(self._find_feeds(op, place, np.array([place.first]), state)[0])
        self._columns.add_move(op, place.line, targets, frames, cause, feed)

    def _note_left_move(self, place: Place, op: ir.Move, frames: list[Frames], state: State) -> None:
        """Note that a move which is not corrected uses the numbers of its targets."""
        for target in self._list_named_targets(place, op):
            if target in self._uses.origins:
                self._note_offset(place, target, frames[0], state)
            else:
                self._uses.used[target] = place.at

    def _note_offset(self, place: Place, name: Name, frames: Frames, state: State) -> None:
        """Note that a move goes to an offset from a target, or to what was calculated of targets.

        If frames of the move differ from those of a target, the target is not corrected.
        """
        target = self._evaluate_target(place, name, state)
        if isinstance(target, WrittenNumbers):
            self._columns.add_offset(target, frames, place.line)
        # Each origin once for the same frames: copies may be copied many times.
        noted = self._noted_origins[_identify(frames)]
        for _, origin in reach([place.qualify(name)], self._list_origins, noted):
            point = self._find_point(origin)
            if isinstance(point, WrittenNumbers) and origin not in self._uses.used:
                self._columns.add_offset(point._replace(label=origin), frames, place.line)

    def _list_origins(self, name: str) -> list[str]:
        """Return the names from which a name was calculated."""
        return list(self._uses.origins.get(name, ()))

    def _find_point(self, name: str) -> Content | None:
        """Return the numbers that a name has on any path of execution; None if it never has numbers."""
        is_never_changed = not self._changes.of_name.get(name)
        if name in self._declarations.initial and is_never_changed:
            return self._declarations.initial[name]
        if self._assigned is None:
            self._assigned = {}
            for place, op in zip(self._places, self._ops, strict=True):
                if isinstance(op, ir.Assign) and isinstance(op.value, Literal):
                    numbers = WrittenNumbers("", place.source, place.line, place.first, op.value)
                    self._assigned[place.qualify(op.name)] = numbers
        return self._assigned.get(name)

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
            if isinstance(target, Literal) and (cause := self._find_axes(place, target, state)):
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
        """Return the cause if a frame is active with which the target was not recorded."""
        for name, frame in zip(op.matched_frames, frames[0], strict=False):
            content, _ = self._contents.look_up(state, name)
            if isinstance(content, Cause):
                continue  # the controller stops unless the frame of the target is active
            # The active frame must be unchanged since the program began, or be the frame of the target.
            is_initial = content == self._language.active[name]
            is_own = isinstance(frame, FrameName) and content == frame.name
            if not (is_initial or is_own):
                reason = f"the target is recorded with another {name} than the active one"
                return place.make_cause(reason, "activate the frame with which the target is recorded")
        return None

    def _evaluate_target(self, place: Place, target: Literal | Name, state: State) -> WrittenNumbers | Cause:
        """Return the numbers of a target, or the cause why these numbers are unknown.

        `state` has the contents of all names at `place`.
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
        changes = self._changes.of_name.get(name, [])
        count_of_contents = len(changes) + (name in self._declarations.initial)
        if count_of_contents > 1:
            return changes[-1].reason
        return content.reason if isinstance(content, Cause) and content.line else ""

    def _find_axes(self, place: Place, target: Literal, state: State) -> Cause | None:
        """Return the cause against a correction if a variable holds external axes that may carry the arm.

        Axes whose numbers are known and zero carry nothing, and give no cause.
        """
        if not target.axes_name:
            return None
        content, _ = self._contents.look_up(state, place.qualify(target.axes_name))
        if isinstance(content, WrittenNumbers):
            numbers_of_file = self._statements.numerals[content.source].values
            axes = numbers_of_file[content.first + np.array(content.literal.numbers)]
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
        changes = self._changes.of_name.get(name, [])
        count_of_contents = len(changes) + (name in self._declarations.initial)
        if count_of_contents > 1:
            self._keep_numbers(place, numbers, f"{unknown}: {changes[-1].reason}")
        elif name in self._declarations.shared and name not in self._noted:
            self._noted.add(name)
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
        starts = []
        for name in origins.keys() - {ir.CONDITION}:
            is_declared = name in self._declarations.names
            is_own = is_declared or name in self._flow.begins or OF_ROUTINE in name
            if name in used or not is_own:
                starts.append(name)
        for name, origin in reach(starts, self._list_origins, set(used)):
            used[origin] = origins[name][origin]

    def remark_conditions(self) -> None:
        """Add a remark for each target that is corrected and whose numbers decide a condition."""
        # Names that decide conditions, also through values that are calculated of them, with the place
        places = dict(self._uses.origins[ir.CONDITION])
        for name, origin in reach([*places], self._list_all_origins, set(places)):
            places[origin] = places[name]
        corrected_targets = (places.keys() & self._targets) - self._uses.used.keys()
        for name in sorted(corrected_targets):
            target, _, _ = name.partition(OF_ROUTINE)
            text = f"numbers of the target {quote_text(target)} decide here, and the correction changes them"
            self._columns.add_remark(places[name], text)

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
