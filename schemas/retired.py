"""Jobs of kinds that this version does not have. They are shown as they were stored; none is carried out."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from pydantic import Field

from jointstiff.schemas.correction import ProgramFile
from jointstiff.schemas.fields import Message
from jointstiff.schemas.finding import Verdict
from jointstiff.schemas.job import Job


class StoredFields(Message, extra="allow"):
    """A request or a result with the fields that the earlier version stored."""


class RetiredJob(Job, extra="allow"):
    """A stored job of a kind that this version does not have."""

    request: StoredFields
    result: StoredFields | None = Field(description="Present if the job succeeded.")

    @property
    def name(self) -> str | None:
        """Name that the requester chose, or the name of the first sent file; for listings."""
        request = self.request.model_dump()
        files = request.get("files") or [{}]
        name: str | None = request.get("name", files[0].get("name"))
        return name

    @property
    def verdict(self) -> Verdict | None:
        """Verdict on the result, for listings."""
        assessment = self._result_fields.get("assessment") or {}
        verdict: Verdict | None = assessment.get("verdict")
        return verdict

    @property
    def files(self) -> list[ProgramFile]:
        """Stored files of the result: programs first, then tables."""
        result = self._result_fields
        tables = [result[name] for name in ("table", "choice") if name in result]
        return [ProgramFile.model_validate(file) for file in [*result.get("files", []), *tables]]

    @property
    def outputs(self) -> list[str]:
        """SHA-256 of each corrected file, for listings; none if nothing was corrected."""
        result = self._result_fields
        files = result["files"] if result.get("corrected") else []
        return [file["sha256"] for file in files if file["sha256"]]

    @property
    def _result_fields(self) -> dict[str, Any]:
        """Fields of the result as they were stored; empty without a result."""
        return {} if self.result is None else self.result.model_dump()


class RetiredFleet(RetiredJob):
    """A stored fleet: the campaigns of many robots, each identified by itself."""

    collection: ClassVar[str] = "fleets"

    kind: Literal["fleet"] = "fleet"


class RetiredProcess(RetiredJob):
    """A stored process: rotations of a tool and places of a workpiece with the least deflection."""

    collection: ClassVar[str] = "processes"

    kind: Literal["process"] = "process"


class RetiredProgram(RetiredJob):
    """A stored program whose targets were corrected."""

    collection: ClassVar[str] = "programs"

    kind: Literal["program"] = "program"
