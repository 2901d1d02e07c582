"""The work of a process: search places, choose turns, correct what is left, and write the program."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from jointstiff.schemas.finding import Assessment, Finding
from jointstiff.schemas.process import (
    DeflectionBand,
    ProcessPlace,
    ProcessRequest,
    ProcessResult,
)
from jointstiff.schemas.program import ProgramFrame
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.readings import hash_texts
from jointstiff.service.conversion.units import LENGTH
from jointstiff.service.kinds.process.feeds import unload_approaches
from jointstiff.service.kinds.process.path import ProgramToTurn, make_turn_task
from jointstiff.service.kinds.process.tables import Deflections, pack_choice
from jointstiff.service.kinds.process.unseen import advise_load, assume_unseen
from jointstiff.service.kinds.program.files import compress_file
from jointstiff.service.kinds.program.path import ProgramPath, find_feeds, find_wanted_postures
from jointstiff.service.kinds.program.rows import RowsWriting
from jointstiff.service.kinds.program.text import FaultsError, read_program
from jointstiff.service.kinds.program.work import ProgramWork, WrittenPoints, refuse_corrected_files
from jointstiff.service.kinds.work import Arrays, Span, as_request_errors, begin_part, cut_into_spans
from jointstiff.service.resources.inputs import Inputs
from jointstiff.service.runs.verdicts import find_accepted_run, make_reason
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.postures import Postures, flange_poses
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.messages import point
from jointstiff.solver.process.candidates import find_branches
from jointstiff.solver.process.cut import UNCERTAINTY
from jointstiff.solver.process.deflection import Band, PathDeflection, Ranking
from jointstiff.solver.process.inspection import Inspector
from jointstiff.solver.process.pace import REFERENCE_FEED, Pace
from jointstiff.solver.process.path import ProcessPath
from jointstiff.solver.process.placing import (
    Flatness,
    PlaceBox,
    coarsen,
    evaluate_places,
    find_flatness,
    search_around,
)
from jointstiff.solver.process.turning import NO_GAIN, TurnChoice, choose_turns
from jointstiff.solver.text import figure
from robotprograms import Orientation, Program, Rewriting, choose_frame_notation

_QUICK_POINTS: Final = 150
"""Greatest number of points whose turns are chosen at once, without a step."""
_PLACES_A_STEP: Final = 8
_LEGAL: Final = 3
"""Places that are evaluated in full, with a motion that keeps all limits."""
_REFINED: Final = 2
"""Places of the grid around which the search goes on."""
_READ_BACK: Final = 1e-4
"""Greatest difference of a joint between what was meant and what the written program says [rad or m]."""


@dataclass(frozen=True, eq=False)
class _TriedPlaces:
    """All places that a search tried."""

    places: FloatArray  # (P, 4) places [m, rad]
    sizes: FloatArray  # (P,) deflections of the search [m]; NaN where the arm does not follow
    remarks: tuple[str, ...]  # (P,) `legal`, or why not, for places that were evaluated in full; empty else


class _FoundPlace(NamedTuple):
    """A place of the workpiece from which the robot follows the whole path."""

    place: FloatArray  # (4,) position [m] and turn [rad]
    program: ProgramToTurn  # moved to this place
    choice: TurnChoice  # turns of the tool there
    deflection: PathDeflection

    def rank(self, best: _FoundPlace, confidence: float) -> tuple[Band, Ranking | None]:
        """Return the deflection with its intervals, and its difference from the best; None for the best."""
        difference = None if self is best else self.deflection.compare(best.deflection, confidence)
        return self.deflection.band(confidence), difference


@dataclass(frozen=True)
class _SpeedCheck:
    """Speeds of the joints along a path, to name the joint that is too slow for it."""

    shares: FloatArray | None  # (v, n) parts of the joints' greatest speeds; NaN where unknown; None: no path
    subject: str  # "the path"
    remedy: str

    def find_excess(self) -> tuple[int, int] | None:
        """Return (visit, joint) of the greatest part, if a joint would have to exceed its greatest speed."""
        if self.shares is None or not (self.shares > 1.0).any():
            return None
        visit, joint = np.unravel_index(int(np.nanargmax(self.shares)), self.shares.shape)
        return int(visit), int(joint)


@dataclass(frozen=True, eq=False)
class _Placed:
    """The program in its best place, and what the search of places found."""

    program: ProgramToTurn
    choice: TurnChoice
    places: FloatArray  # (k, 4) best places, the best first [m, rad]; empty without a search
    rankings: tuple[tuple[Band, Ranking | None], ...]  # deflection at each, and its difference from the best
    flat: Flatness | None  # places of the search that are nearly as good; None without a search
    tried: _TriedPlaces


class _ChangeOfBranches(NamedTuple):
    """Bits (v,) of the branch in which chosen postures differ from those of the program, 0 or 1."""

    wrist: IndexArray
    elbow: IndexArray
    determinant: IndexArray  # sign of the Jacobian's determinant: changes with wrist, elbow and shoulder each

    def find_unstated(self, has_words: BoolArray, has_letters: BoolArray) -> BoolArray:
        """Return a mask (v,) of the targets whose words or letters cannot state the changed branch.

        Words such as KUKA's S keep their bits of shoulder and elbow, so that a target with such words may
        change the side of its wrist only. FANUC's letters are kept, so that nothing may change.
        """
        shoulder = self.wrist ^ self.elbow ^ self.determinant
        is_changed = (self.elbow | shoulder | (has_letters & self.wrist)) > 0
        return np.asarray((has_words | has_letters) & is_changed)


class ProcessWork(ProgramWork):
    """Work of a process, whose units are places of the workpiece, or points if a path is long."""

    activity = "placing and turning"
    subject = "process"
    cut_remark = (
        "the force of the cut is computed: the intervals along the path include the uncertainty of this "
        "force, the intervals of the worst points do not"
    )
    _request: ProcessRequest

    def __init__(
        self, robot: Robot, robot_id: str, run: Run | None, request: ProcessRequest, content: str = ""
    ) -> None:
        """Read the program, and collect its loads.

        Without a run, the model is the prior of the robot, and `content` is the hash of the robot.

        Raises:
            RequestError: fields of the request contradict each other, there is no model, or the program is
                not understood.
        """
        super().__init__(robot, robot_id, run, request, content)
        speeds = robot.speeds.tolist()
        self.input_hash = hash_texts(self.input_hash, repr(speeds), repr(robot.payload))
        self._run_model, self._assumed = assume_unseen(self._run_model)
        self.unit = "points" if request.place is None else "places"
        self.corrects = request.correct
        self._visits, self._approaches = unload_approaches(self._program, request, self._visits)
        wanted = None if request.feed is None else LENGTH[request.units.length] * request.feed
        feeds = find_feeds(self._program, request, self._visits, wanted)
        self._pace = Pace(feeds, robot.speeds, float(np.radians(request.rate) * 1e3))
        self._joint_limits = replace(self._pace, rate=np.inf).limits()
        self._task = make_turn_task(request, self._pace)
        self._sizes, self._chosen = np.zeros(0), dict[str, Any]()
        self._unwritten: str | None = None  # why no program is written

    def steps(self) -> Sequence[Span]:
        """Return spans of places as steps, none for few; without a search one step for a long path."""
        if self._request.place is not None:
            spans = self._spans_of_places()
            return spans if len(spans) > 1 else ()
        points = len(self._visits.targets)
        return () if points <= _QUICK_POINTS else ((0, points),)

    def compute(self, span: Span) -> Arrays:
        """Evaluate the places of a step, or choose the turns of a long path; return arrays by name.

        Raises:
            RequestError: the robot does not follow the path.
        """
        if self._request.place is None:
            return self._pack_stored_choice()
        path, task, first = self._coarse
        places = self._box.places()[slice(*span)]
        return {"sizes": evaluate_places(self._run_model.model, self._inverse, path, task, places, first)}

    def _pack_stored_choice(self) -> Arrays:
        """Choose the turns of the program in its place; return the choice as arrays, which can be stored.

        `_read_stored_choice` reads them. Joints (…, 6) that are unknown are NaN.
        """
        choice = self._choose(self._as_sent)
        of_fixed_turns = list[FloatArray]()
        for joints in (choice.best_fixed, choice.unturned):
            of_fixed_turns.append(np.full_like(choice.joints, np.nan) if joints is None else joints)
        return {
            "joints": choice.joints,
            "turn": choice.turn,
            "size": np.array(choice.size),
            "fixed": choice.fixed,
            "motion": choice.motion,
            "of_fixed_turns": np.stack(of_fixed_turns),
        }

    def conclude(self, parts: Sequence[Arrays]) -> ProcessResult:
        """Choose place and turns, correct what is left, and write the program.

        Raises:
            RequestError: the robot does not follow the path from any place.
            FaultsError: the robot does not reach a target, or the written program would be misread.
        """
        if self._request.place is not None:
            steps = parts or [self.compute(span) for span in self._spans_of_places()]
            self._sizes = np.concatenate([each["sizes"] for each in steps])
        elif parts:
            self._chosen = dict(parts[0])
        fields = dict(super().conclude(()))
        if self._unwritten is not None:
            fields |= {"files": [], "corrected": 0}
        return ProcessResult.model_validate(fields | self._describe_choice())

    @cached_property
    def _as_sent(self) -> ProgramToTurn:
        """The program in the place of the workpiece as it is."""
        visits, robot = self._visits, self._run_model.model.robot
        return ProgramToTurn.find(self._program, self._request, robot, self._inverse, visits)

    @cached_property
    def _box(self) -> PlaceBox:
        """Box of places of the request."""
        if self._request.place is None:
            raise ValueError("the request has no box of places")
        low, high = LENGTH[self._request.units.length] * np.array(self._request.place)
        turns = 2.0 * np.pi * np.arange(self._request.place_turns) / self._request.place_turns
        return PlaceBox(low, high, self._request.grid, turns)

    def _spans_of_places(self) -> tuple[Span, ...]:
        """Return all places, cut into spans."""
        return cut_into_spans(len(self._box.places()), _PLACES_A_STEP)

    @cached_property
    def _coarse(self) -> tuple[Any, Any, IndexArray]:
        """Path and task with fewer points and turns, for the search of places."""
        return coarsen(self._as_sent.path, self._task, self._as_sent.same)

    def _choose(self, program: ProgramToTurn) -> TurnChoice:
        """Return the turns of a program with the least deflection; its own postures if the turn is kept."""
        if self._is_kept and program.programmed is not None:
            joints = program.programmed.cases.joints[program.visits.number]
            size = self._predict(program, joints).size
            turn = np.where(np.isnan(program.path.given[:, 0]), 0.0, np.nan)
            motion = self._inspect(program.path, joints)
            return TurnChoice(joints, turn, size, np.array([size]), joints, joints, motion)
        return choose_turns(self._run_model.model, self._inverse, program.path, self._task, program.same)

    def _predict(self, program: ProgramToTurn, joints: FloatArray) -> PathDeflection:
        """Predict the deflections of a program in postures (v, n) [rad or m], each target once."""
        first, request = program.visits.first, self._request
        cases = program.path.cases(first, joints[first])
        return PathDeflection.predict(
            self._run_model.model,
            self._run_model.error,
            cases,
            is_prior=self._run_model.result is None,
            force_parts=self._split_forces(program, cases.force),
            confidence=request.confidence,
            greatest=request.objective == "greatest",
            weights=program.sum_weights(),
        )

    def _inspect(self, path: ProcessPath, joints: FloatArray) -> FloatArray:
        """Return the motion (v, n) of the model's joints for a length of the lines of a path [rad/m]."""
        model = self._run_model.model
        inspector = Inspector(model, self._inverse, path, self._task.clearance, corrects=False)
        angles = model.robot.joint_map.model_angles(joints)
        return inspector.inspect(angles, np.zeros(len(joints))).motion

    def _split_forces(self, program: ProgramToTurn, force: FloatArray) -> FloatArray | None:
        """Return standard errors (m, 3, 3) of the components of forces (m, 3) [N]; None without an error.

        Components are along the axes in which the loads are stated, which move with the workpiece.
        """
        request = self._request
        share = request.force_uncertainty
        if share is None:
            share = UNCERTAINTY if request.cut is not None else 0.0
        if not share:
            return None
        axes = program.load_axes
        components = np.einsum("bik,bi->bk", axes, force)
        return np.asarray(share * axes * components[:, None])

    @cached_property
    def _placed(self) -> _Placed:
        """The program in its best place, with the turns chosen there.

        Raises:
            RequestError: the robot does not follow the path within limits and step.
        """
        if self._request.place is not None:
            return self._choose_place()
        choice = self._read_stored_choice() if self._chosen else self._choose(self._as_sent)
        nothing = _TriedPlaces(np.zeros((0, 4)), np.zeros(0), ())
        return _Placed(self._as_sent, choice, np.zeros((0, 4)), (), None, nothing)

    def _read_stored_choice(self) -> TurnChoice:
        """Return the choice of turns that the step of a long path stored as arrays."""
        stored = self._chosen
        # A fixed turn that the robot cannot follow is stored as NaN.
        of_fixed_turns = [None if np.isnan(joints).any() else joints for joints in stored["of_fixed_turns"]]
        best_fixed, unturned = of_fixed_turns
        return TurnChoice(
            stored["joints"],
            stored["turn"],
            float(stored["size"]),
            stored["fixed"],
            best_fixed,
            unturned,
            stored["motion"],
        )

    def _choose_place(self) -> _Placed:
        """Evaluate the best places of the search in full, in their order, and choose the best of them.

        If the robot follows the path from none of them, the workpiece stays.
        """
        places, sizes = self._search_places()
        found, remarks = self._evaluate_in_full(places, sizes)
        tried = _TriedPlaces(places, sizes, remarks)
        if not found:
            return _Placed(
                self._as_sent,
                self._choose(self._as_sent),
                places=np.zeros((0, 4)),
                rankings=(),
                flat=None,
                tried=tried,
            )
        found.sort(key=lambda each: each.deflection.size)
        best = found[0]
        return _Placed(
            best.program,
            best.choice,
            places=np.array([each.place for each in found]),
            rankings=tuple(each.rank(best, self._request.confidence) for each in found),
            flat=find_flatness(places, sizes),
            tried=tried,
        )

    def _search_places(self) -> tuple[FloatArray, FloatArray]:
        """Return places (P, 4) [m, rad], of the grid and around its best ones, with their deflections (P,).

        The deflections [m] are those of a path with fewer points; NaN where the arm does not follow it.
        """
        path, task, first = self._coarse
        model, grid = self._run_model.model, self._box.places()
        places, sizes = [grid], [self._sizes]

        def evaluate(further: FloatArray) -> FloatArray:
            further_sizes = evaluate_places(model, self._inverse, path, task, further, first)
            places.append(further)
            sizes.append(further_sizes)
            return further_sizes

        order = np.argsort(self._sizes, kind="stable")
        followed = order[np.isfinite(self._sizes[order])]
        for i in followed[:_REFINED].tolist():
            begin_part("searching around the best places")
            search_around(self._box, grid[i], float(self._sizes[i]), evaluate)
        return np.concatenate(places), np.concatenate(sizes)

    def _evaluate_in_full(
        self, places: FloatArray, sizes: FloatArray
    ) -> tuple[list[_FoundPlace], tuple[str, ...]]:
        """Return the first places, by deflection, from which the robot follows the whole path; and remarks.

        The remark on a place is "legal" or why the path is not followed from it, and "" for the places that
        are left when enough are found.

        Args:
            places: (P, 4) places of the search [m, rad].
            sizes: (P,) deflections of the search [m].
        """
        found, remarks = list[_FoundPlace](), [""] * len(places)
        for i in _sort_places(places, sizes):
            begin_part(f"turning at place {1 + len(found)} of {_LEGAL}")
            try:
                found.append(self._evaluate_place(places[i]))
                remarks[i] = "legal"
            except RequestError as error:
                remarks[i] = error.reason  # the path of the search can be followed there, the whole one not
            if len(found) == _LEGAL:
                break
        return found, tuple(remarks)

    def _evaluate_place(self, place: FloatArray) -> _FoundPlace:
        """Return a place (4,) with the turns of the tool that are chosen there, and the deflection.

        Raises:
            RequestError: the robot does not follow the path from there.
        """
        program = self._as_sent.move(place[:3] - self._as_sent.path.middle, float(place[3]))
        choice = self._choose(program)
        return _FoundPlace(place, program, choice, self._predict(program, choice.joints))

    @cached_property
    def _path(self) -> ProgramPath:
        """Path of the program in the chosen place and postures."""
        if self._is_kept and self._as_sent.programmed is not None:
            return self._as_sent.programmed  # the very path of `compensate`
        return self._placed.program.turned(self._placed.choice.joints)

    @cached_property
    def _ramp(self) -> FloatArray:
        """Fraction (m,) of the full correction at each point: zero if no correction is requested."""
        return super()._ramp if self.corrects else np.zeros(len(self._path.targets))

    def _points(self) -> IndexArray:
        """Return the indices of the points that are written: all, if their turns may differ."""
        return super()._points() if self._is_kept else np.arange(len(self._visits.order))

    @property
    def _is_kept(self) -> bool:
        """True if the path remains as it was sent."""
        return self._request.turn == "keep" and self._request.place is None

    @cached_property
    def _after(self) -> PathDeflection:
        """Deflections along the path as chosen."""
        return self._predict(self._placed.program, self._placed.choice.joints)

    @cached_property
    def _before(self) -> PathDeflection | None:
        """Deflections along the path as it was sent; None if the robot does not follow it there.

        If its postures are not known, they are those of the best branch at turn zero, or else of the best
        fixed turn.
        """
        sent, choice = self._as_sent, self._placed.choice
        if sent.programmed is not None:
            return self._predict(sent, sent.programmed.cases.joints[sent.visits.number])
        if self._request.place is not None:
            try:
                choice = self._choose(sent)
            except RequestError:
                return None
        known = (each for each in (choice.unturned, choice.best_fixed) if each is not None)
        return self._predict(sent, next(known, choice.joints))

    @cached_property
    def _ranking(self) -> Ranking | None:
        """Comparison of the chosen path with the path as it was sent; None if that is not followed."""
        before = self._before
        return None if before is None else self._after.compare(before, self._request.confidence)

    def _gain(self) -> Literal["less", "no_order", "no_gain"]:
        """Return whether the choice is better, as `gain` of the result describes."""
        ranking, before = self._ranking, self._before
        if ranking is None or before is None:
            return "no_order"
        # Another branch may gain where no turn does.
        is_equal = self._after.size >= (1.0 - NO_GAIN) * before.size
        searched = len(self._placed.places) > 0
        if self._request.turn != "keep" and not searched and is_equal and not self._placed.choice.gains:
            return "no_gain"
        return "less" if ranking.first_is_less else "no_order"

    def _list_reasons(self) -> list[Finding]:
        """Return the reasons of the choice, most important first."""
        return [
            *self._find_place_reason(),
            *self._find_prior_reason(),
            *self._find_speed_reasons(),
            *self._find_order_reason(),
        ]

    def _find_order_reason(self) -> list[Finding]:
        """Return the reason that nothing orders the chosen path and the path as it was sent."""
        if self._gain() != "no_order" or self._is_kept:
            return []
        if self._ranking is None:
            message = (
                "the robot cannot follow the path with the workpiece in its programmed place, so the "
                "deflections before and after cannot be compared"
            )
            remedy = "compare places with each other, or send a program that the robot can follow"
        else:
            message = self._describe_unordered(self._ranking)
            remedy = f"before you trust the choice, {self._advise_measuring()}"
        return [make_reason("no_order", "use_with_care", message, remedy)]

    def _describe_unordered(self, ranking: Ranking) -> str:
        """Return a sentence on an interval of the difference that includes zero, or on a missing one."""
        interval = ranking.difference.with_model_error
        text = "has no interval, because the model error is unknown"
        if interval is not None:
            low, high = [figure(1e6 * end, ".3g") for end in interval]
            text = f"is within {low} to {high} µm"
        return (
            f"the difference of the deflections before and after {text}, so it is not certain which "
            "deflection is less"
        )

    def _advise_measuring(self) -> str:
        """Return what to measure for a shorter interval; the force first, if its error counts."""
        measure = "measure more, or measure with loads like those of the process"
        if self._request.cut is not None or self._request.force_uncertainty:
            return f"measure the force of the process, and state the force; or {measure}"
        return measure

    def _find_speed_reasons(self) -> list[Finding]:
        """Return the reason that the path as chosen, as corrected or as sent exceeds a joint's speed.

        Only the first of these paths that is too fast is named.
        """
        slower = "lower the feed there, or "
        away = slower + "place the workpiece away from the singularity"
        over_a_length = slower + "state a force that changes over a length of the path, and not at one point"
        checks = [
            _SpeedCheck(self._shares, "the path", away),
            _SpeedCheck(self._corrected_shares, "the corrected path", over_a_length),
            _SpeedCheck(self._sent_shares, "the program as sent", away),
        ]
        for check in checks:
            excess = check.find_excess()
            if excess is not None:
                message = self._describe_excess(check, *excess)
                return [make_reason("too_fast", "use_with_care", message, check.remedy)]
        return []

    def _describe_excess(self, check: _SpeedCheck, visit: int, joint: int) -> str:
        """Return the line, the feed and the joint whose greatest speed a path exceeds at a visit."""
        if check.shares is None:
            raise ValueError("a path that is not followed has no speeds")
        name = self._run_model.model.robot.joint_names[joint]
        moves = self._program.moves
        line = int(moves.line[moves.move_of_visit[visit]])
        feed = self._pace.feed[visit]
        shown = REFERENCE_FEED if np.isnan(feed) else feed
        return (
            f"line {line}: at {figure(1e3 * shown, '.3g')} mm/s {check.subject} needs "
            f"{figure(100.0 * check.shares[visit, joint], '.3g')} % of the greatest speed of {name}"
        )

    def _find_place_reason(self) -> list[Finding]:
        """Return the reason that a search of places found none that the robot can follow."""
        if self._request.place is None or len(self._placed.places):
            return []
        tried = self._placed.tried
        reached = int(np.isfinite(tried.sizes).sum())
        message = (
            f"the workpiece stays: of {len(tried.sizes)} places that were tried, the robot follows a part "
            f"of the path's points from {reached}, and all points from none"
        )
        remedy = "see places.csv for the reasons; move or enlarge the box, or lower `clearance`"
        return [make_reason("place_kept", "use_with_care", message, remedy)]

    def _find_prior_reason(self) -> list[Finding]:
        """Return the reason that stiffnesses of joints are from the payload."""
        if not self._assumed:
            return []
        names = " and ".join(self._assumed)
        verb = "is" if len(self._assumed) == 1 else "are"
        message = (
            f"the readings do not determine {names}, whose stiffness {verb} guessed from payload and reach: "
            "the intervals include the factor of two"
        )
        return [make_reason("prior_joint", "use_with_care", message, advise_load(self._assumed))]

    @cached_property
    def _shares(self) -> FloatArray:
        """(v, n) parts of the joints' speeds that the chosen motion needs; NaN where unknown."""
        return self._pace.shares(self._placed.choice.motion)

    @cached_property
    def _corrected_shares(self) -> FloatArray | None:
        """(v, n) parts of the joints' speeds that the corrected targets need; None without a correction.

        Where the force changes at a point, the correction does, too, so that the line there has a step.
        """
        if not self.corrects:
            return None
        robot, path = self._run_model.model.robot, self._placed.program.path
        poses = flange_poses(robot, robot.joint_map.model_angles(self._meant))
        corrected = replace(path, poses=poses)
        # A tool that turns in one place, as programmed, takes its time, though the correction moves it a bit.
        moves = path.moves & (corrected.steps > 0.0)
        length = np.where(moves, corrected.steps, np.where(path.steps > 0.0, path.steps, 1.0))
        motion = self._inspect(path, self._meant) * (path.steps / length)[:, None]
        return self._pace.shares(motion)

    @cached_property
    def _sent_shares(self) -> FloatArray | None:
        """(v, n) parts of the joints' speeds that the program as sent needs; None if it is not followed."""
        sent = self._as_sent
        if sent.programmed is None:
            return None
        joints = sent.programmed.cases.joints[sent.visits.number]
        return self._pace.shares(self._inspect(sent.path, joints))

    def must_mark(self, assessment: Assessment, unchanged_moves: int) -> bool:
        """Return whether the written program gets a comment that marks it as compensated."""
        return self.corrects and super().must_mark(assessment, unchanged_moves)

    def _check_written(self, rewriting: Rewriting | RowsWriting, points: WrittenPoints) -> None:
        """Read the written program back, and compare the joints with those that were meant.

        With free branches, the joints are also in turns.csv, so that a program which cannot state them is not
        written; with branches that are kept, it is refused.

        Raises:
            RequestError: a target would be reached in other joints than meant, and the branches are kept.
        """
        self._written = points
        if self._is_kept:
            return
        if self._request.branches == "free":
            self._unwritten = self._find_unstated_branch() or self._explain_misread(rewriting)
            return
        misread = self._find_misread(rewriting)
        if misread is not None:
            raise RequestError(
                misread,
                where="turn",
                remedy="state a range of `turn`, or `branches: free` and take the joints from turns.csv",
            )

    def _explain_misread(self, rewriting: Rewriting | RowsWriting) -> str | None:
        """Return why the written program is not read in the joints that were meant; None if it is."""
        try:
            return self._find_misread(rewriting)
        except (FaultsError, RequestError) as error:
            return str(error)

    def _find_unstated_branch(self) -> str | None:
        """Return why the program cannot state the chosen branches; None if it can, or need not.

        A branch is a side of shoulder, elbow and wrist: one of 8 postures that reach a target.
        """
        targets, visited = self._program.targets, self._visits.targets
        literals = [targets.literals[i] for i in targets.literal[visited].tolist()]
        if any(not each.notation.has_pose and not each.notation.is_joints for each in literals):
            return "the program states no angle about the tool's axis"
        if not any(each.words or each.letters for each in literals):
            return None  # the controller takes the nearest posture
        sent = self._as_sent.programmed
        if sent is None:
            return "the arm configurations of the sent program are not known"
        programmed = sent.cases.joints[self._visits.number]
        change = self._find_change_of_branches(programmed)
        has_words = np.array([bool(each.words) for each in literals])
        has_letters = np.array([bool(each.letters) for each in literals])
        unstated = change.find_unstated(has_words, has_letters)
        if not unstated.any():
            return None
        return (
            f"line {int(targets.line[visited[np.argmax(unstated)]])}: the words of the target cannot be "
            "rewritten for the chosen side of shoulder, elbow or wrist"
        )

    def _find_change_of_branches(self, programmed: FloatArray) -> _ChangeOfBranches:
        """Return where the chosen postures (v, n) are on another side than those of the program (v, n)."""
        robot = self._run_model.model.robot
        before = find_branches(self._inverse, Postures(robot, robot.joint_map.model_angles(programmed)))
        chosen_angles = robot.joint_map.model_angles(self._placed.choice.joints)
        after = find_branches(self._inverse, Postures(robot, chosen_angles))
        change = after ^ before
        return _ChangeOfBranches(wrist=change & 1, elbow=(change >> 1) & 1, determinant=(change >> 2) & 1)

    def _find_misread(self, rewriting: Rewriting | RowsWriting) -> str | None:
        """Return where the written program would be read in other joints than meant; None if nowhere.

        Raises:
            RequestError: a frame of the written program is not known.
            FaultsError: the configuration of a target is ambiguous, or it is not reached.
        """
        if isinstance(rewriting, RowsWriting):
            written = rewriting.program
        else:
            written = self._read_files(rewriting.files())
        if not np.array_equal(written.moves.line, self._program.moves.line):
            return "the written program has other moves that can be corrected"
        program = self._number_targets_as_sent(written)
        read = self._find_read_joints(program)
        difference = np.abs(read - self._meant).max(axis=1)  # (v,)
        wrong = difference > _READ_BACK
        if not wrong.any():
            return None
        first_wrong = int(np.argmax(wrong))
        line = int(program.targets.line[self._visits.targets[first_wrong]])
        return (
            f"line {line}: the controller would not reach the turned target in the chosen posture, as a "
            f"joint would differ by {np.degrees(difference[first_wrong]):.3g}°"
        )

    def _number_targets_as_sent(self, written: Program) -> Program:
        """Return a written program whose targets have the numbers of the program as sent.

        Where a name came back in place of numbers, several moves of the written program share a target.
        """
        moves = self._program.moves
        indices = np.zeros(len(self._program.targets), dtype=np.intp)
        indices[moves.visits] = written.moves.visits
        return replace(written, targets=written.targets.select(indices), moves=moves)

    def _find_read_joints(self, program: Program) -> FloatArray:
        """Return the joints (v, n) in which the controller reaches the targets of a written program.

        Raises:
            RequestError: a frame of the program is not known.
            FaultsError: the configuration of a target is ambiguous, or it is not reached.
        """
        placed = self._placed.program
        with as_request_errors("program"):
            return find_wanted_postures(
                program,
                self._request,
                placed.frames,
                type(placed.stated)(program),
                self._run_model.model.robot,
                self._inverse,
                self._visits.targets,
                start=self._meant[0],
            )

    def _read_files(self, contents: Sequence[bytes]) -> Program:
        """Read the written files, without marks, as the files of the request were read.

        Raises:
            FaultsError: a file is not understood.
        """
        files = [
            (source.name, content) for source, content in zip(self._program.sources, contents, strict=True)
        ]
        return read_program(
            files,
            self._request.format,
            self._request.leave_alone,
            leave_others=self._request.leave_others,
            trust_routines=self._request.trust_routines,
            external_axes=self._external_axes,
        )

    def list_remarks(self) -> list[str]:
        """Return the remarks of a compensated program, and what free branches need."""
        remarks = super().list_remarks()
        if self._unwritten is not None:
            reason = f"no program is written, so move the robot to the joints in turns.csv: {self._unwritten}"
            return [reason, *remarks]
        return [
            *self._list_place_remarks(),
            *self._list_feed_remarks(),
            *self._list_start_remarks(),
            *remarks,
        ]

    def _list_place_remarks(self) -> Iterator[str]:
        """Yield remarks on the frames of a new place, and on a best place at the edge of the box."""
        was_searched = len(self._placed.places) > 0
        if was_searched and not self._as_sent.moves_base[self._used_bases].all():
            yield "targets are written in the new place, in base frames with the numbers of the program"
        edges = self._find_edges()
        if edges:
            yield (
                f"the best place is at the edge of the box along {edges}: a larger box may have a "
                "better place"
            )

    def _list_start_remarks(self) -> Iterator[str]:
        """Yield a remark on a first target that states no configuration of the arm."""
        targets, first = self._program.targets, int(self._visits.targets[0])
        literal = targets.literals[targets.literal[first]]
        if not self._is_kept and literal.notation.has_pose and not literal.words:
            yield (
                "bring the arm to the first joints of turns.csv before the program starts: its first "
                "target states no configuration"
            )

    def _list_feed_remarks(self) -> Iterator[str]:
        """Yield remarks on an unknown feed, on approaches without force, and on turns of the program."""
        motion = self._placed.choice.motion
        if motion.any() and np.isnan(self._pace.feed).all():
            yield (
                "no feed is stated: tool and joints turn by at most `rate` along the path; at 50 mm/s they "
                f"need {self._describe_speeds_at_reference(motion)} °/s"
            )
        if self._approaches.any():
            yield (
                f"approaches and retracts carry no force: lines {self._list_lines(self._approaches)}; state "
                "loads by lines or in a table if they do"
            )
        _, roll = self._task.steady(self._as_sent.path, self._as_sent.same)
        jumps = np.diff(roll, prepend=0.0) * self._as_sent.path.continuous != 0.0
        if jumps.any():
            yield (
                "the program turns the tool about the spindle faster than `rate` on the way to lines "
                f"{self._list_lines(jumps)}: the chosen turn does not follow there"
            )

    def _describe_speeds_at_reference(self, motion: FloatArray) -> str:
        """Return the greatest speed of each joint at 50 mm/s [°/s]: "J1 12, J2 7.5"; `motion` is in rad/m."""
        needed = np.degrees(REFERENCE_FEED * motion.max(axis=0)).tolist()
        names = self._run_model.model.robot.joint_names
        return ", ".join(f"{name} {figure(speed, '.3g')}" for name, speed in zip(names, needed, strict=True))

    def _list_lines(self, visits: BoolArray) -> str:
        """Return the lines of the moves of some visits (v,), as a person reads them; at most five."""
        moves = self._program.moves
        lines = np.unique(moves.line[moves.move_of_visit[visits]]).tolist()
        return ", ".join(map(str, lines[:5])) + (", …" if lines[5:] else "")

    def _find_edges(self) -> str:
        """Return the axes along which the best place is at the edge of the box; empty without a search."""
        if not len(self._placed.places):
            return ""
        low, high, place = self._box.low, self._box.high, self._placed.places[0][:3]
        is_edge = (low < high) & (np.isclose(place, low) | np.isclose(place, high))
        return ", ".join(np.array(list("xyz"))[is_edge])

    @property
    def _meant(self) -> FloatArray:
        """(v, n) controller's joints of the corrected targets at each visit [rad or m]."""
        return np.asarray(self._commanded[self._visits.number])

    def _describe_choice(self) -> dict[str, Any]:
        """Return the fields of the result that a compensated program does not have."""
        confidence, placed = self._request.confidence, self._placed
        before = None if self._before is None else _band_message(self._before.band(confidence))
        difference = None if self._ranking is None else _band_message(self._ranking.difference)
        frames = self._list_frames() if len(placed.places) else []
        return {
            "objective": self._request.objective,
            "gain": self._gain(),
            "before": before,
            "turned": _band_message(self._after.band(confidence)),
            "remaining": _band_message(self._remaining(confidence)),
            "difference": difference,
            **self._describe_fixed_turns(),
            **self._describe_speeds(),
            "places": self._make_place_messages(placed),
            "places_tried": len(self._sizes),
            "places_reached": int(np.isfinite(self._sizes).sum()),
            **self._describe_equal_places(),
            "frames": frames,
            "choice": compress_file("choice", self._pack_choice()),
        }

    def _describe_fixed_turns(self) -> dict[str, Any]:
        """Return the fields about one turn of the tool for the whole path, and the deflection with each."""
        turns, deflections = self._task.angles, self._placed.choice.fixed
        are_all_turns_tried = len(deflections) == len(turns)
        return {
            "fixed_turns": turns.tolist() if are_all_turns_tried else [0.0],
            "fixed_deflections": [each if np.isfinite(each) else None for each in deflections.tolist()],
        }

    def _describe_equal_places(self) -> dict[str, Any]:
        """Return the fields about the box of the places that are as good as the best one."""
        flat = self._placed.flat
        if flat is None:
            return {"flat_low": None, "flat_high": None, "flat_places": 0}
        low, high = point(flat.low[:3]), point(flat.high[:3])
        return {"flat_low": low, "flat_high": high, "flat_places": flat.count}

    def _describe_speeds(self) -> dict[str, Any]:
        """Return the fields of the result about speeds."""
        feed = self._pace.feed[~np.isnan(self._pace.feed) & ~self._approaches]
        at = np.where(np.isnan(self._pace.feed), REFERENCE_FEED, self._pace.feed)
        needed = self._placed.choice.motion * at[:, None]
        sent = self._sent_shares
        return {
            "feed": float(feed.max()) if len(feed) else None,
            "needed_speeds": needed.max(axis=0).tolist(),
            "speed_shares": _list_greatest(self._shares),
            "sent_speed_shares": [] if sent is None else _list_greatest(sent),
        }

    def _remaining(self, confidence: float) -> Band:
        """Return the deflection that is left after the correction, with its intervals.

        The correction is right where the prediction is, so what is left is the error of the prediction.
        """
        if not self.corrects:
            return self._after.band(confidence)
        return self._after.remaining(self._residual, self._share, confidence)

    @property
    def _share(self) -> FloatArray:
        """(m,) fraction of the full correction at each point."""
        return self._at_all_points(self._written.corrections.share, 0.0)

    @property
    def _residual(self) -> FloatArray:
        """(m,) predicted distances of the loaded tool from its targets [m]; zero where nothing is written."""
        return self._at_all_points(np.linalg.norm(self._written.residual[:, :3], axis=1), 0.0)

    def _at_all_points(self, values: FloatArray, other: float | FloatArray) -> FloatArray:
        """Return values (m, …) of all points from those (k, …) of the written ones, and others elsewhere."""
        everywhere = np.empty((len(self._visits.order), *values.shape[1:]))
        everywhere[...] = other
        everywhere[self._written.corrections.points] = values
        return everywhere

    def _make_place_messages(self, placed: _Placed) -> list[ProcessPlace]:
        """Return the best places of the workpiece as `ProcessPlace` messages, best first."""
        middle = self._as_sent.path.middle  # centre of the path in the sent program
        return [
            ProcessPlace(
                centre=point(place[:3]),
                shift=point(place[:3] - middle),
                turn=float(place[3]),
                deflection=_band_message(band),
                # A ranking compares a place with the best one, which has none.
                behind_best=None if ranking is None else _band_message(ranking.difference),
                is_worse=ranking is not None and ranking.is_ordered,
            )
            for place, (band, ranking) in zip(placed.places, placed.rankings, strict=True)
        ]

    @property
    def _used_bases(self) -> list[int]:
        """Indices of the base frames of all targets that are poses; −1 for the world of the controller."""
        order, targets = self._visits.order, self._program.targets
        poses = order[~targets.given_as_joints[order]]
        used: list[int] = np.unique(self._as_sent.frames.base.of_target[poses]).tolist()
        return used

    def _list_frames(self) -> list[ProgramFrame]:
        """Return the base frames of the best place, with numbers as the program writes frames."""
        notation, frames = choose_frame_notation(self._program), self._placed.program.frames
        near = np.zeros((1, 3 + notation.count))
        near[0, 3] = float(notation.orientation is Orientation.QUATERNION)  # of two, the one with q1 > 0
        stated = []
        for index in self._used_bases:
            if not self._placed.program.moves_base[index]:
                continue
            name = self._program.targets.frames[index].name
            pose = np.linalg.inv(self._world) @ frames.base.poses[index]
            numbers = notation.from_poses(pose[None], near)[0]
            stated.append(ProgramFrame(name=name, values=numbers.tolist()))
        return stated

    @cached_property
    def _world(self) -> FloatArray:
        """(4, 4) pose of the controller's world in R0 [m]."""
        stated = self._request.world
        return np.eye(4) if stated is None else choose_frame_notation(self._program).to_pose(stated)

    def _pack_choice(self) -> bytes:
        """Return the tables of turns and places as bytes."""
        joints = {
            "": self._arm(self._path.cases.joints),
            ", command": self._arm(self._commanded),
        }
        tried = self._placed.tried
        return pack_choice(
            turn=self._placed.choice.turn[self._visits.first],
            ways=self._collect_deflections(),
            joints=joints,
            places=np.column_stack([tried.places, tried.sizes]),
            remarks=tried.remarks,
            of_grid=len(self._sizes),
            speeds=self._find_greatest_shares(),
        )

    def _collect_deflections(self) -> dict[str, Deflections]:
        """Return the deflections of all points as sent, after the turns, and after the correction."""
        after, before = self._after, self._before
        confidence, left = self._request.confidence, self._residual
        bands = after.bands(confidence)
        remaining_bands = bands
        if self.corrects:
            remaining_bands = after.remaining_bands(left, self._share, confidence)
        ways = {
            "turned": Deflections(after.length, *bands),
            "remaining": Deflections(left, *remaining_bands),
        }
        if before is not None:
            ways["before"] = Deflections(before.length, *before.bands(confidence))
        return ways

    def _find_greatest_shares(self) -> FloatArray:
        """Return the greatest share (v, 6) of its speed that each joint of the arm needs at each target.

        NaN where the speed of a joint is unknown.
        """
        greatest = np.full((len(self._visits.first), self._shares.shape[1]), -np.inf)
        np.fmax.at(greatest, self._visits.number, self._shares)
        return self._arm(np.where(np.isinf(greatest), np.nan, greatest))

    def _arm(self, joints: FloatArray) -> FloatArray:
        """Return the arm's joints (m, 6) [rad] of all joints (m, n)."""
        return self._inverse.select_arm_joints(joints)

    @property
    def _commanded(self) -> FloatArray:
        """(m, n) controller's joints of the corrected targets [rad or m]."""
        return self._at_all_points(self._written.corrections.commanded, self._path.cases.joints)


def _list_greatest(shares: FloatArray) -> list[float | None]:
    """Return the greatest share (n,) of each joint along a path; None if the joint's speed is unknown."""
    greatest = np.where(np.isnan(shares), -np.inf, shares).max(axis=0)
    return [each if np.isfinite(each) else None for each in greatest.tolist()]


def _sort_places(places: FloatArray, sizes: FloatArray) -> list[int]:
    """Return the indices of the places with a deflection, the least first, each place once."""
    order = np.argsort(sizes, kind="stable")
    order = order[np.isfinite(sizes[order])]
    normal = places[order].copy()
    normal[:, 3] %= 2.0 * np.pi
    _, first = np.unique(np.round(normal, 9), axis=0, return_index=True)
    sorted_places: list[int] = order[np.sort(first)].tolist()
    return sorted_places


def _band_message(band: Band) -> DeflectionBand:
    """Return the message of a value with its intervals."""
    return DeflectionBand(value=band.value, readings=band.readings, with_model_error=band.with_model_error)


def prepare_process(inputs: Inputs, request: ProcessRequest) -> ProcessWork:
    """Fetch the run or robot of a request, and return the work of the process.

    Raises:
        RequestError: run or robot do not exist or give no model; or the request has no files, does not fit,
            or has a program that was compensated already.
    """
    if request.run_id is None:
        robot_id = request.robot_id or ""
        robot, content = inputs.robot(robot_id, "robot_id")
        refuse_corrected_files(inputs, request, robot_id)
        return ProcessWork(robot, robot_id, None, request, content)
    run = find_accepted_run(inputs, request.run_id, request.accept_verdict)
    refuse_corrected_files(inputs, request, run.prepared.robot_id)
    return ProcessWork(run.prepared.robot, run.prepared.robot_id, run.run, request)
