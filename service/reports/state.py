"""State of a report, by the authorisations of its run."""

from __future__ import annotations

from collections.abc import Sequence

from jointstiff.schemas.report import Authorisation
from jointstiff.service.reports.document import State
from jointstiff.service.reports.wording import moment


def draft(reason: str = "Nobody has authorised it.") -> State:
    """Return the state of a report that nobody has authorised."""
    return State("draft", reason)


def state_of(own: Sequence[Authorisation], successor: Authorisation | None) -> State:
    """Return the state of a run's report.

    Args:
        own: authorisations of this report, oldest first.
        successor: authorisation of the report that replaces this one.
    """
    if not own:
        return draft()
    last = own[-1]
    by = f"Authorised by {last.key_name} (key {last.key_id}) on {moment(last.authorised_at)}."
    line = f"{by} Note: {last.note}" if last.note else by
    if last.number > 1:
        line = f"{line} It supersedes report {last.run_id}-{last.number - 1}."
    if successor is not None:
        line = (
            f"Superseded by the report of run {successor.run_id} on {moment(successor.authorised_at)}. {line}"
        )
        return State("superseded", line, last.number, last.authorised_at, last.key_name)
    return State("authorised", line, last.number, last.authorised_at, last.key_name)
