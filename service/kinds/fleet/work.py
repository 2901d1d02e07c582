"""A fleet as work: its units are measurement sets, each identified as a run of its own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from functools import cached_property, partial
from typing import Any, Final, get_args

import numpy as np

from jointstiff.schemas.finding import Problem
from jointstiff.schemas.fleet import MAX_SETS, FleetOutcome, FleetRequest, FleetResult, FleetRow
from jointstiff.schemas.run import RunRequest, RunResult
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.service.conversion.readings import hash_of
from jointstiff.service.kinds.fleet.kind import outcome_of_row
from jointstiff.service.kinds.run.work import identification
from jointstiff.service.kinds.work import Arrays, Span, Work, joined, outcome_of, spans
from jointstiff.service.problems import StoreUnavailableError
from jointstiff.service.resources.inputs import Inputs, NamedSet
from jointstiff.solver.errors import JointstiffError, RequestError

SETS_A_STEP: Final = 10
"""Sets that are identified by joints in a quarter of a second."""
_AUTOMATIC: Final = 1
"""Sets of a step where any may turn out to need links, which takes seconds."""
_ELSEWHERE: Final = (StoreUnavailableError, MemoryError)
"""Errors that say nothing of a set: its step is carried out again, here or by another worker."""


class FleetWork(Work):
    """The work of a fleet, its units the sets; one step whose runs are quick is quick."""

    unit = "sets"
    activity = "identifying"
    robot_id = None

    def __init__(self, inputs: Inputs, request: FleetRequest) -> None:
        """Name the sets.

        Raises:
            RequestError: a set is not there, or there is none at all, or there are too many.
        """
        self._inputs, self._first = inputs, 0
        self._sets = inputs.named_sets(request.measurement_set_ids, "measurement_set_ids")
        _refuse_count(len(self._sets))
        run = request.run
        self._options = {name: getattr(run, name) for name in run.model_fields_set}
        # Draws and penalties are steps of a run: a set with many of them is a step of its own.
        sizes = {"joints": SETS_A_STEP, "automatic": _AUTOMATIC}
        size = sizes.get(run.elasticity, 1) if run.resampling is None else 1
        self._blocks = spans(len(self._sets), size)
        self.input_hash = hash_of(*(each.content for each in self._sets), run.model_dump_json())
        frozen = [each.id for each in self._sets]
        self.details = {"request": request.model_copy(update={"measurement_set_ids": frozen})}

    def steps(self) -> tuple[Span, ...]:
        """Return the sets in blocks; none where one block holds them all, and their runs take no steps."""
        return () if self._is_quick else self._blocks

    def compute(self, span: Span) -> Arrays:
        """Identify some of the sets; a set that fails is a row.

        Raises:
            StoreUnavailableError: the database does not answer.
        """
        sets = self._sets[span[0] - self._first : span[1] - self._first]
        rows = [self._row(each).model_dump_json().encode() for each in sets]
        return {
            "rows": np.frombuffer(b"".join(rows), np.uint8),
            "sizes": np.array([len(row) for row in rows]),
        }

    def conclude(self, parts: Sequence[Arrays]) -> FleetResult:
        """Return the rows of all sets, and their counts."""
        table = joined(parts or map(self.compute, self._blocks))
        ends = np.cumsum(table["sizes"])
        texts = np.split(table["rows"], ends[:-1])
        rows = [FleetRow.model_validate_json(text.tobytes()) for text in texts]
        counts = Counter(map(outcome_of_row, rows))
        return FleetResult(counts={name: counts[name] for name in get_args(FleetOutcome)}, rows=rows)

    def alone(self, span: Span) -> FleetWork:
        """Return the work with the sets of a step themselves: a store does not go to another process."""
        part, sets = copy(self), self._sets[slice(*span)]
        held = _Held.of(self._inputs, sets, self._options)
        vars(part).update(_inputs=held, _sets=sets, _first=span[0], details={})
        return part

    @cached_property
    def _is_quick(self) -> bool:
        return len(self._blocks) == 1 and not any(map(self._takes_steps, self._sets))

    def _takes_steps(self, one: NamedSet) -> bool:
        try:
            return bool(self._run_set(one).steps())
        except JointstiffError:  # it is a row that says why
            return False

    def _run_set(self, one: NamedSet) -> Work:
        request = RunRequest(measurement_set_id=one.id, **self._options)
        return identification(self._inputs, request)

    def _identify_set(self, one: NamedSet) -> RunResult:
        run = self._run_set(one)
        result = run.conclude([run.compute(span) for span in run.steps()])
        assert isinstance(result, RunResult)  # noqa: S101 - for mypy: a run has no other result
        return result

    def _row(self, one: NamedSet) -> FleetRow:
        result, error = outcome_of(partial(self._identify_set, one), _ELSEWHERE)
        return _row_of(one, result if isinstance(result, RunResult) else None, error)


class _Held:
    """The sets of a fleet in memory, or why each cannot be used."""

    def __init__(self, sets: Mapping[str, PreparedSet | JointstiffError]) -> None:
        self._sets = sets

    @classmethod
    def of(cls, inputs: Inputs, sets: Iterable[NamedSet], options: Mapping[str, Any]) -> _Held:
        """Fetch the sets as runs with these options do."""
        held = dict[str, PreparedSet | JointstiffError]()
        for one in sets:
            try:
                held[one.id] = inputs.measured(one.id, "measurement_set_id", options.get("leave_out", ()))
            except JointstiffError as error:
                held[one.id] = error
        return cls(held)

    def measured(self, set_id: str, _where: str, _leave_out: Sequence[str] = ()) -> PreparedSet:
        """Return a set; raises why it cannot be used."""
        found = self._sets[set_id]
        if isinstance(found, JointstiffError):
            raise found
        return found


def _row_of(one: NamedSet, result: RunResult | None, error: Problem | None) -> FleetRow:
    joints = () if result is None else result.joints
    return FleetRow(
        measurement_set_id=one.id,
        measurement_set_name=one.name,
        robot_id=one.robot_id,
        robot_name=one.robot_name,
        verdict=None if result is None else result.assessment.verdict,
        joint_kinds={} if result is None else result.joint_kinds,
        stiffness={joint.name: joint.stiffness for joint in joints},
        stiffness_interval={joint.name: joint.stiffness_interval for joint in joints},
        error=error,
    )


def _refuse_count(count: int) -> None:
    if count == 0:
        raise RequestError(
            "there is no measurement set with loads",
            where="measurement_set_ids",
            remedy="store the campaigns first",
        )
    if count > MAX_SETS:
        raise RequestError(
            f"{count:,} robots have measurement sets, which exceeds {MAX_SETS:,}",
            where="measurement_set_ids",
            remedy="post several fleets, each with the ids of some sets",
        )
