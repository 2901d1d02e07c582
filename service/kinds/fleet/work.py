"""A fleet as work: its units are measurement sets, each identified as a run of its own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from functools import cached_property
from typing import Any, Final, get_args

import numpy as np

from jointstiff.schemas.fleet import MAX_SETS, FleetOutcome, FleetRequest, FleetResult, FleetRow
from jointstiff.schemas.run import Run, RunRequest
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.service.conversion.readings import hash_texts
from jointstiff.service.kinds.run.one_of_many import identify_one_of_many
from jointstiff.service.kinds.run.work import prepare_identification
from jointstiff.service.kinds.work import Arrays, Span, Work, concatenate_steps, cut_into_spans
from jointstiff.service.problems import StoreUnavailableError
from jointstiff.service.resources.inputs import Inputs, NamedSet
from jointstiff.solver.errors import JointstiffError, RequestError

SETS_PER_STEP: Final = 10
"""Number of sets in a step, which takes a quarter of a second, if only joints are elastic."""
_SETS_PER_STEP_AUTOMATIC: Final = 1
"""Number of sets in a step if the elastic model is chosen automatically: elastic links take seconds."""
_RETRIED_ERRORS: Final = (StoreUnavailableError, MemoryError)
"""Errors that the set did not cause: the step is carried out again, in this process or by another worker."""


class FleetWork(Work):
    """Work of a fleet, whose units are measurement sets; a single block of quick runs has no steps."""

    unit = "sets"
    activity = "identifying"
    robot_id = None

    def __init__(self, inputs: Inputs, request: FleetRequest) -> None:
        """Find the sets, cut them into blocks, and write their ids into the request that is stored.

        Raises:
            RequestError: a set does not exist, or the fleet has no set, or too many.
        """
        self._inputs = inputs
        self._first = 0  # number of the first set in `_sets`; not 0 in the work of a single step
        self._sets = inputs.named_sets(request.measurement_set_ids, "measurement_set_ids")
        _refuse_wrong_set_count(len(self._sets))
        run = request.run
        self._options = {name: getattr(run, name) for name in run.model_fields_set}
        # Resampling or elastic links make a run slow: then each set is a step of its own.
        sizes = {"joints": SETS_PER_STEP, "automatic": _SETS_PER_STEP_AUTOMATIC}
        size = sizes.get(run.elasticity, 1) if run.resampling is None else 1
        self._blocks = cut_into_spans(len(self._sets), size)
        self.input_hash = hash_texts(*(each.content for each in self._sets), run.model_dump_json())
        # A request without ids means all robots at this moment: the stored request lists the ids.
        set_ids = [each.id for each in self._sets]
        self.details = {"request": request.model_copy(update={"measurement_set_ids": set_ids})}

    def steps(self) -> tuple[Span, ...]:
        """Return one step for each block of sets; none if all sets are in one block and every run is short.

        A run is short if it is computed without steps.
        """
        return () if self._needs_no_steps else self._blocks

    def compute(self, span: Span) -> Arrays:
        """Identify the sets of a step; return their rows as bytes of JSON, and the size of each row in bytes.

        The row of a set that fails has the error.

        Raises:
            StoreUnavailableError: the database does not answer.
        """
        sets = self._sets[span[0] - self._first : span[1] - self._first]
        rows = [self._identify_as_row(each).model_dump_json().encode() for each in sets]
        return {
            "rows": np.frombuffer(b"".join(rows), np.uint8),
            "sizes": np.array([len(row) for row in rows]),
        }

    def conclude(self, arrays_of_steps: Sequence[Arrays]) -> FleetResult:
        """Return the result of the fleet: the rows of all sets, and the number of sets with each outcome.

        `arrays_of_steps` are the arrays of all steps; if empty, all sets are identified now.
        """
        table = concatenate_steps(arrays_of_steps or map(self.compute, self._blocks))
        row_ends = np.cumsum(table["sizes"])
        texts = np.split(table["rows"], row_ends[:-1])
        rows = [FleetRow.model_validate_json(text.tobytes()) for text in texts]
        counts = Counter(row.outcome for row in rows)
        return FleetResult(counts={name: counts[name] for name in get_args(FleetOutcome)}, rows=rows)

    def detach_for_step(self, span: Span) -> FleetWork:
        """Return a copy of this work that has the measurement sets of one step in memory.

        A process without access to the store can then compute the step. `span` has the first set of the step,
        and one past the last.
        """
        step_work, sets = copy(self), self._sets[slice(*span)]
        in_memory = _SetsInMemory.fetch(self._inputs, sets, self._options)
        vars(step_work).update(_inputs=in_memory, _sets=sets, _first=span[0], details={})
        return step_work

    @cached_property
    def _needs_no_steps(self) -> bool:
        """True if the fleet is one block of sets whose runs take no steps."""
        return len(self._blocks) == 1 and not any(map(self._takes_steps, self._sets))

    def _takes_steps(self, named_set: NamedSet) -> bool:
        """Return whether the identification of a set takes steps."""
        try:
            return bool(prepare_identification(self._inputs, self._make_request(named_set)).steps())
        except JointstiffError:  # `compute` makes a row of this error
            return False

    def _make_request(self, named_set: NamedSet) -> RunRequest:
        """Return the request that identifies a set with the options of the fleet."""
        return RunRequest(measurement_set_id=named_set.id, **self._options)

    def _identify_as_row(self, named_set: NamedSet) -> FleetRow:
        """Identify a set; return its row, with the result or the error."""
        request = self._make_request(named_set)
        run = identify_one_of_many(self._inputs, request, Run, retried=_RETRIED_ERRORS)
        return _make_row(named_set, run)


class _SetsInMemory:
    """Measurement sets by id, or the errors of unusable sets; replaces `Inputs` in another process."""

    def __init__(self, sets: Mapping[str, PreparedSet | JointstiffError]) -> None:
        self._sets = sets

    @classmethod
    def fetch(cls, inputs: Inputs, sets: Iterable[NamedSet], options: Mapping[str, Any]) -> _SetsInMemory:
        """Fetch measurement sets from the store, without the observations that the option `leave_out` names.

        For a set that cannot be used, the error is kept in place of the set.
        """
        fetched = dict[str, PreparedSet | JointstiffError]()
        for named_set in sets:
            try:
                fetched[named_set.id] = inputs.measured(
                    named_set.id, "measurement_set_id", options.get("leave_out", ())
                )
            except JointstiffError as error:
                fetched[named_set.id] = error
        return cls(fetched)

    def measured(self, set_id: str, _where: str, _leave_out: Sequence[str] = ()) -> PreparedSet:
        """Return a set by its id, or raise the error of an unusable set."""
        set_or_error = self._sets[set_id]
        if isinstance(set_or_error, JointstiffError):
            raise set_or_error
        return set_or_error


def _make_row(named_set: NamedSet, run: Run) -> FleetRow:
    """Return the row of a set: numbers of its run, or the error of a failed run."""
    result = run.result
    joints = () if result is None else result.joints
    return FleetRow(
        measurement_set_id=named_set.id,
        measurement_set_name=named_set.name,
        robot_id=named_set.robot_id,
        robot_name=named_set.robot_name,
        verdict=None if result is None else result.assessment.verdict,
        joint_kinds={} if result is None else result.joint_kinds,
        stiffness={joint.name: joint.stiffness for joint in joints},
        stiffness_interval={joint.name: joint.stiffness_interval for joint in joints},
        error=run.error,
    )


def _refuse_wrong_set_count(count: int) -> None:
    """Raise a `RequestError` if a fleet has no measurement set, or more than `MAX_SETS`."""
    if count == 0:
        raise RequestError(
            "the store has no measurement set with loads",
            where="measurement_set_ids",
            remedy="store the campaigns first",
        )
    if count > MAX_SETS:
        raise RequestError(
            f"the fleet has {count:,} measurement sets, but at most {MAX_SETS:,} are possible",
            where="measurement_set_ids",
            remedy="post several fleets, each with the ids of some sets",
        )
