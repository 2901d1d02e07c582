"""Kinds of work of earlier versions: their jobs are read as they were stored; none is carried out.

A kind becomes a retired one when its package is removed.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NoReturn

from jointstiff.schemas.retired import RetiredFleet, RetiredJob, RetiredProcess, RetiredProgram, StoredFields
from jointstiff.service.kinds.correction.files import CONTENT
from jointstiff.service.kinds.kind import AnyKind, Kind
from jointstiff.service.kinds.rooms import ROOMS
from jointstiff.service.tables.report import Report
from jointstiff.service.tables.table import Line
from jointstiff.solver.errors import RequestError


def _refuse_work(*_: object) -> NoReturn:
    """Refuse to carry out a job, for example of a queue that an earlier version filled."""
    raise RequestError(
        "this version does not do work of this kind",
        where="kind",
        remedy="use the version of Jointstiff that stored the job",
    )


def _make_kind(message: type[RetiredJob]) -> AnyKind:
    """Return the declaration of a kind that has neither work nor tables, given the class of its jobs."""
    return Kind[RetiredJob, StoredFields](
        message=message,
        request=StoredFields,
        options=StoredFields,
        prepare_work=_refuse_work,
        make_report=lambda *_: Report([Line("this version shows the job as JSON only")]),
        sources=(),
        title=message.kind_name().title(),
        description="",
        has_report=False,
        to_answer=lambda document: CONTENT.sub('"content":null', document),  # files have their own addresses
    )


RETIRED: Final[Mapping[str, AnyKind]] = MappingProxyType(
    {
        message.kind_name(): _make_kind(message)
        for message in (RetiredFleet, RetiredProcess, RetiredProgram)
        if message.kind_name() not in ROOMS
    }
)
"""Kinds whose jobs databases and files may have, and which this version does not offer; by name."""
