"""A worker's queue without threads: a test says who claims a part, who ends it, and who dies over it."""

from collections.abc import Iterable

import sqlalchemy as sa

from jointstiff.service.jobs import Part
from jointstiff.service.workers.engine import _QUEUE, ATTEMPTS, Queue
from jointstiff.service.workers.worker import Retries, carry_out

_NEXT = (
    "SELECT workflow_uuid, recovery_attempts FROM {} WHERE status = 'ENQUEUED' "
    "ORDER BY priority, created_at LIMIT 1"
)
_SET = (
    "UPDATE {} SET status = :status, executor_id = :executor, recovery_attempts = :starts "
    "WHERE workflow_uuid = :name"
)


class Claims(Queue):
    """The rows of DBOS as its workers change them: claimed, ended, and given up when claimed too often."""

    def __init__(self, store, database):
        super().__init__(store, database)
        self.claimed: dict[Part, str] = {}  # names of the parts
        table = "workflow_status" if store.schema() is None else f"{self._schema}.workflow_status"
        self._next, self._set = sa.text(_NEXT.format(table)), sa.text(_SET.format(table))
        self.used: dict[str, float] = {}  # what the engine says of the parts of this process

    def claim(self, executor: str) -> Part | None:
        """Claim the next part; None if there is none."""
        with self._store.transaction() as connection:
            row = connection.execute(self._next).one_or_none()
            if row is None:
                return None
            starts = row.recovery_attempts + 1
            status = "PENDING" if starts <= ATTEMPTS else "MAX_RECOVERY_ATTEMPTS_EXCEEDED"
            values = {"status": status, "executor": executor, "starts": starts, "name": row.workflow_uuid}
            connection.execute(self._set, values)
        job_id, number, kept = row.workflow_uuid.split("-")[:3]
        part = Part(job_id, int(number), int(kept))
        self.claimed[part] = row.workflow_uuid
        return part if status == "PENDING" else self.claim(executor)

    def end(self, part: Part) -> None:
        values = {"status": "SUCCESS", "executor": None, "starts": 0, "name": self.claimed[part]}
        with self._store.transaction() as connection:
            connection.execute(self._set, values)

    def work(self, jobs, executor: str = "worker") -> bool:
        """Carry out the next part, as a worker does; return whether there was one."""
        part = self.claim(executor)
        if part is None:
            return False
        Retries().retry(lambda: carry_out(self._store, jobs, part, self))
        self.end(part)
        return True

    def work_all(self, jobs, executor: str = "worker") -> None:
        while self.work(jobs, executor):
            pass

    def waiting(self) -> list[str]:
        """Return the names of the parts that wait, first come first."""
        return [each.workflow_id for each in self._list_rows(status="ENQUEUED")]

    # What an engine does beyond a queue

    def seconds_of_running_parts(self) -> dict[str, float]:
        return self.used

    def recover(self, executors: Iterable[str]) -> None:
        dead = list(executors)
        for name, executor in self.claimed_parts().items():
            if executor in dead:
                self._client._sys_db.reenqueue_for_recovery(name, dead, _QUEUE)

    def stop(self) -> None:
        self.put_back(name for name, executor in self.claimed_parts().items() if executor == "alive")
