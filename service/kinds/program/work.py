"""A compensated program: from a run's model, a program and its loads to the program with other numbers."""

from __future__ import annotations

import base64
import hashlib
import re
import zlib
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.schemas.program import (
    LeftAlone,
    Program,
    ProgramFile,
    ProgramFormat,
    ProgramRequest,
    ProgramResult,
)
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.readings import hash_of
from jointstiff.service.conversion.units import ANGLE, LENGTH
from jointstiff.service.inputs import Inputs
from jointstiff.service.kinds.acceptance import accepted_run
from jointstiff.service.kinds.deflection.models import to_own_weight
from jointstiff.service.kinds.deflection.work import assessment_of, forward_model, remarks_of
from jointstiff.service.kinds.program.path import ProgramPath, Visits, program_path
from jointstiff.service.kinds.program.points import Corrections, WrittenPoints
from jointstiff.service.kinds.program.rewriting import rewritten
from jointstiff.service.kinds.work import Arrays, Span, Work, as_request_errors
from jointstiff.service.programs.errors import ProgramError
from jointstiff.service.programs.formats import marked, read_program
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.predict.forward import CorrectionLimits, compensate, ramp_shares
from jointstiff.solver.robot.inverse import InverseKinematics
from jointstiff.solver.robot.model import Robot

MAX_QUICK_POINTS: Final = 10_000
"""Points of a program that is corrected at once; one that several moves use counts for each."""
STEP_POINTS: Final = 2_000
"""Points of a step of a longer one."""
_MAX_REMARKS: Final = 50
_CONTENT: Final = re.compile(r'"content":"[A-Za-z0-9+/=]*"')
"""Content of a file: in a text of JSON, quotes would have a backslash before them."""
_MAX_UNPACKED: Final = 256 * 1024 * 1024


class ProgramWork(Work):
    """The work of a compensated program; the postures of its path are found when they are needed first."""

    unit = "points"
    activity = "compensating"

    def __init__(self, robot: Robot, robot_id: str, run: Run, request: ProgramRequest) -> None:
        """Read the program.

        Raises:
            RequestError: the request contradicts itself, the run has no model, or the program is not
            understood.
        """
        if request.accuracy_option == "compensates_load":
            raise RequestError(
                "the controller already compensates the load, which would be compensated twice",
                where="accuracy_option",
                remedy="switch the controller's accuracy option off, measure with it off, and give `off`",
            )
        self.robot_id, self._run, self._request = robot_id, run, request
        options = request.model_dump_json(exclude={"run_id", "files"})
        contents = [each.content or "" for each in request.files]
        self.input_hash = hash_of(run.provenance.input_hash, options, *contents)
        with as_request_errors():
            self._model, self._error = forward_model(robot, run, to_own_weight(request, robot, run))
        files = [(each.name, unpacked(each)) for each in request.files if each.name != request.loads]
        if request.loads is not None and len(files) == len(request.files):
            raise RequestError(
                "this file was not sent", where="loads", remedy="send the table of loads with the files"
            )
        self._assessment = assessment_of(run)
        self._program = read_program(files, request.format, request.leave_alone)
        table = next((unpacked(each) for each in request.files if each.name == request.loads), None)
        self._visits = Visits.of(self._program, request, table)

    @cached_property
    def _inverse(self) -> InverseKinematics:
        with as_request_errors():
            return InverseKinematics(self._model.robot)

    @cached_property
    def _path(self) -> ProgramPath:
        return program_path(self._program, self._request, self._model.robot, self._inverse, self._visits)

    @cached_property
    def _ramp(self) -> FloatArray:
        length = LENGTH[self._request.units.length] * self._request.limits.ramp
        return ramp_shares(self._model.robot, self._path.cases, length)

    def steps(self) -> Sequence[Span]:
        """Return the targets of a long program, cut into steps."""
        points = max(len(self._program.targets), len(self._program.moves.visits))
        return () if points <= MAX_QUICK_POINTS else self._spans()

    def _spans(self) -> tuple[Span, ...]:
        count = len(self._program.targets)
        return tuple((start, min(start + STEP_POINTS, count)) for start in range(0, count, STEP_POINTS))

    def compute(self, span: Span) -> Arrays:
        """Correct the points of a part of the path.

        Raises:
            RequestError: a load twists a joint of which nothing is known, or the path is not reached.
            ProgramError: a load finds no stable balance.
        """
        path = self._path
        points = np.flatnonzero(path.loaded[span[0] : span[1]]) + span[0]
        if not len(points):
            return vars(_NONE)
        try:
            cases = path.cases[points]
            compensation = compensate(self._model, cases, self._limits(), self._ramp[points])
        except RequestError as error:
            if error.where is None or not error.where.startswith("cases["):
                raise
            case = int(error.where.partition("[")[2].partition("]")[0])
            raise ProgramError([path.fault(int(points[case]), error.reason, error.remedy)]) from error
        bound = None
        if self._error is not None:
            bound = self._error.bound(cases, compensation.leverage, self._request.confidence)
        return vars(Corrections.of(points, compensation, bound))

    def conclude(self, parts: Sequence[Arrays]) -> ProgramResult:
        """Write the program, and certify what was written.

        Raises:
            RequestError: as `compute` does.
            ProgramError: a corrected target is not reached.
        """
        corrections = Corrections.joined(
            [Corrections(**part) for part in parts or map(self.compute, self._spans())]
        )
        del parts  # as large again
        quantile = self._model.quantile(self._request.confidence)
        contents, points = rewritten(self._path, corrections, self._model, self._inverse, quantile)
        program, verdict = self._program, self._assessment.verdict
        if (self._request.mark or verdict == "do_not_use") and points.changed.any():
            today = datetime.now(UTC).date()
            contents[0] = marked(program.format, contents[0], self._run.id, verdict, today)
        files = [packed(source.name, contents.pop(0)) for source in program.sources]
        return self._result(points, files)

    def _limits(self) -> CorrectionLimits:
        limits, units = self._request.limits, self._request.units
        usual = CorrectionLimits()
        return CorrectionLimits(
            usual.displacement if limits.displacement is None else LENGTH[units.length] * limits.displacement,
            usual.rotation if limits.rotation is None else ANGLE[units.angle] * limits.rotation,
        )

    def _result(self, points: WrittenPoints, files: list[ProgramFile]) -> ProgramResult:
        corrections, program = points.corrections, self._program
        left: dict[LeftAlone, int] = {
            "no_load": int((~points.path.loaded).sum()),
            "uncertain": int(corrections.uncertain.sum()),
            "not_used": len(program.targets) - len(points.path.targets),
        }
        kind: ProgramFormat = program.format  # type: ignore[assignment]
        deflection, correction, residual = (
            points.spread(np.linalg.norm(vectors[:, :3], axis=1))
            for vectors in (corrections.uncorrected, corrections.correction, points.residual)
        )
        return ProgramResult(
            assessment=self._assessment,
            format=kind,
            points=len(program.targets),
            moves=len(program.moves),
            corrected=int(points.changed.sum()),
            capped=int(corrections.capped.sum()),
            left_alone={reason: count for reason, count in left.items() if count},
            deflection=deflection,
            correction=correction,
            residual=residual,
            rounding=points.spread(points.rounding),
            confidence=self._request.confidence,
            worst=points.worst(),
            remarks=self._remarks(corrections),
            files=files,
            table=packed("points", points.table()),
        )

    def _remarks(self, found: Corrections) -> list[str]:
        lines: dict[str, list[int]] = {}
        for remark in self._program.left_alone:
            lines.setdefault(remark.text, []).append(remark.line)
        left = [f"{_shown(numbers)}: {reason}" for reason, numbers in lines.items()]
        more = [f"… and {len(left) - _MAX_REMARKS} more"] if len(left) > _MAX_REMARKS else []
        remarks = remarks_of(self._run, self._model, self._error, self._request.confidence)
        beyond = int((found.extrapolation > 1.0).sum())
        if beyond:
            remarks.append(
                f"{beyond} points are extrapolated: their loads or postures are beyond those of the campaign"
            )
        return [*remarks, *left[:_MAX_REMARKS], *more]


def _shown(lines: Sequence[int]) -> str:
    """Return line numbers as text, the first five of them."""
    first = ", ".join(map(str, lines[:5]))
    more = f" and {len(lines) - 5} more" if len(lines) > 5 else ""
    return f"line {first}" if len(lines) == 1 else f"lines {first}{more}"


def without_contents(document: str) -> str:
    """Return a stored document without the contents of its files, which have addresses of their own."""
    return _CONTENT.sub('"content":null', document)


def packed(name: str, content: bytes) -> ProgramFile:
    """Return a file as it is stored: compressed, as text."""
    text = base64.b64encode(zlib.compress(content, 1)).decode("ascii")
    digest = hashlib.sha256(content).hexdigest()
    return ProgramFile(name=name, bytes=len(content), content=text, sha256=digest)


def unpacked(file: ProgramFile) -> bytes:
    """Return the bytes of a stored file.

    Raises:
        RequestError: it has none.
    """
    if file.content is None:
        raise RequestError("the file has no content", where="files", remedy="send the file itself")
    return zlib.decompressobj().decompress(base64.b64decode(file.content), _MAX_UNPACKED)


_EMPTY: Final = np.zeros(0)
_NONE: Final = Corrections(
    points=np.zeros(0, dtype=np.intp),
    commanded=np.zeros((0, 6)),
    correction=np.zeros((0, 6)),
    residual=np.zeros((0, 6)),
    uncorrected=np.zeros((0, 6)),
    uncertainty=_EMPTY,
    model_error=_EMPTY,
    extrapolation=_EMPTY,
    share=_EMPTY,
    uncertain=np.zeros(0, dtype=np.bool_),
    capped=np.zeros(0, dtype=np.bool_),
)


def work(inputs: Inputs, request: ProgramRequest) -> ProgramWork:
    """Return the work of a compensated program.

    Raises:
        RequestError: there is no such run, it has no model that predicts, or the request does not fit it.
    """
    run = accepted_run(inputs, request)
    sent = {hashlib.sha256(unpacked(file)).hexdigest() for file in request.files}
    for summary in inputs.listed(Program, run.prepared.robot_id):
        if sent.intersection(summary.get("outputs", ())):
            raise RequestError(
                f"a file is the output of the compensated program '{summary['id']}'",
                where="files",
                remedy="send the original program",
            )
    return ProgramWork(run.prepared.robot, run.prepared.robot_id, run.run, request)
