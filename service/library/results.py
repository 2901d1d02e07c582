"""Jobs in a notebook: they show themselves as the tables of the terminal, and runs give what follows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from io import StringIO
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol, cast

from pydantic import PrivateAttr, create_model
from rich.console import Console

from jointstiff.schemas.job import Job, Progress
from jointstiff.schemas.run import JointResult, Run, RunRequest, RunResult
from jointstiff.service.kinds.kind import AnyJob, Kind
from jointstiff.service.kinds.rooms import kind_of
from jointstiff.service.library.campaigns import Campaign
from jointstiff.service.reports.job import job_report, job_sheet
from jointstiff.service.tables.files import written
from jointstiff.solver.errors import RequestError

if TYPE_CHECKING:
    from jointstiff.schemas import run as messages
    from jointstiff.schemas.robot import RobotDocument
    from jointstiff.schemas.run import CampaignRun

OnProgress = Callable[[Progress], object]
_WIDTH = 100
_MODELS = {"csv", "xlsx", "urdf", "sdf", "mjcf", "xml"}


class Door(Protocol):
    """This process or a service: it knows what requests are made of by ids, and does the work."""

    @property
    def campaign(self) -> messages.Campaign | None:
        """Campaign that was identified; None if it is not kept."""

    def measured(self, source: Any, _place: str = "") -> tuple[str, CampaignRun | None]:  # noqa: ANN401
        """Return the id of a campaign's measurement set, and the options of its run if they are known."""

    def identified(self, source: Any) -> str:  # noqa: ANN401 - a run, or a campaign
        """Return the id of a run, which is identified now from a campaign."""

    def described(self, robot: RobotDocument) -> str:
        """Return the id of a robot."""

    def run(self, request: RunRequest, on_progress: OnProgress | None, dispensable: bool) -> Run | None:
        """Identify a measurement set; a dispensable run may fail or be none if it is not supported."""

    def done(
        self,
        kind: Kind[AnyJob, Any, Any],
        request: dict[str, Any],
        files: Mapping[str, bytes],
        on_progress: OnProgress | None = None,
    ) -> AnyJob:
        """Do the work of a request, and of files where it takes some; return the job once it has ended."""

    def file(
        self, job: Job, name: str, query: Mapping[str, str] | None = None, laboratory: Path | None = None
    ) -> bytes:
        """Return a file of a job, such as `report.pdf`, by the query of the API."""

    def apply(self, run: TabledRun, action: str) -> TabledRun:
        """Apply an action that a reason of a run advises; return the run of what it changes."""


class Shown:
    """A job that shows itself as tables: to be mixed with its message."""

    _origin: Any  # where it was done; None if that is not known

    def __eq__(self, other: object) -> bool:
        """Return whether the other is the same job, whether it shows itself or not."""
        return isinstance(other, Job) and other.kind == self._job.kind and dict(self._job) == dict(other)

    def __hash__(self) -> int:
        """Return the hash of the id, which is the job's alone."""
        return hash(self._job.id)

    @property
    def _job(self) -> Job:
        return cast("Job", self)

    def table(self, suffix: str) -> bytes:
        """Return the table of the job as a file: `csv`, and for maps `npz` and `json`.

        Raises:
            ValueError: the kind has no such table, or its inputs are not known.
        """
        job, kind = self._job, kind_of(self._job.kind)
        file = next((file for file in kind.files if file.suffix == suffix), None)
        if file is None:
            endings = ", ".join(f".{file.suffix}" for file in kind.files) or "none"
            raise ValueError(f"a {kind.name} has tables of these endings: {endings}")
        if self._origin is not None or file.made_of == "work":
            return self._known_origin().file(job, file.name)
        return written(job_sheet(file, job, lambda: cast("Any", None)), suffix)

    def report(self, path: str | Path, laboratory: str | Path | None = None) -> None:
        """Write the report, a draft, as PDF or HTML.

        Args:
            path: file to write, ending in `.pdf` or `.html`.
            laboratory: TOML file of the laboratory that issues it; a service has its own.

        Raises:
            CampaignError: the report cannot be made, or Typst is not installed.
            RefusedError: the service refuses it.
        """
        name = f"report.{_suffix(path, {'pdf', 'html'})}"
        settings = None if laboratory is None else Path(laboratory)
        Path(path).write_bytes(self._known_origin().file(self._job, name, None, settings))

    def __str__(self) -> str:
        """Return the report of the terminal as text."""
        console = Console(file=StringIO(), width=_WIDTH, highlight=False)
        console.print(job_report(kind_of(self._job.kind), self._job))
        return cast("StringIO", console.file).getvalue()

    def _repr_html_(self) -> str:
        """Return the report of the terminal as HTML, which notebooks display."""
        console = Console(record=True, file=StringIO(), width=_WIDTH)
        console.print(job_report(kind_of(self._job.kind), self._job))
        return console.export_html(
            inline_styles=True, code_format='<pre style="line-height:1.2">{code}</pre>'
        )

    def _known_origin(self) -> Door:
        if self._origin is None:
            raise ValueError(f"it is not known where the {self._job.kind} was done: use what a verb returned")
        return cast("Door", self._origin)


class TabledRun(Shown, Run):
    """A run with its joints by name, as a table where it is displayed, and as a report or a model file."""

    _origin: Any = PrivateAttr(default=None)

    @property
    def joints(self) -> Mapping[str, JointResult]:
        """Joints by name, in order, such as `run.joints["joint_2"].stiffness` [N·m/rad].

        Raises:
            RequestError: the run has no result.
        """
        return MappingProxyType({joint.name: joint for joint in self._found().joints})

    def to_frame(self) -> Any:  # noqa: ANN401 - of pandas or polars, whichever is installed
        """Return a row a joint, in SI units, as a data frame of pandas, or of polars without it.

        Raises:
            ImportError: neither is installed.
        """
        rows = [joint.model_dump() for joint in self.joints.values()]
        try:
            import pandas

            return pandas.DataFrame(rows).set_index("name")
        except ImportError:
            pass
        try:
            import polars

            return polars.DataFrame(rows, strict=False)
        except ImportError:
            raise ImportError("to_frame needs pandas or polars: pip install pandas") from None

    @property
    def campaign(self) -> Campaign:
        """Campaign that was identified in this process.

        Raises:
            RequestError: the run comes from elsewhere.
        """
        campaign = None if self._origin is None else self._known_origin().campaign
        if campaign is None:
            raise RequestError(
                "the run has no reference to its campaign",
                where="run",
                remedy="use a run that `jointstiff.identify` returned, or the client of its service",
            )
        return Campaign.of(campaign)

    def apply(self, action: str) -> TabledRun:
        """Apply an action that a reason advises, and identify what it changes, here or in the run's service.

        Args:
            action: kind of the action, such as `exchange_columns` or `convert_units`.

        Returns:
            The run of the mended campaign, by the options of this one; in this process its `campaign`.

        Raises:
            RequestError: the run has no result.
            CampaignError: no reason advises the action, or it cannot be applied to this campaign.
            RefusedError: the service refuses it.
        """
        self._found()
        return self._known_origin().apply(self, action)

    def export(self, path: str | Path, accept_verdict: str | None = None) -> None:
        """Write the identified model.

        Args:
            path: file to write, ending in `.csv`, `.xlsx`, `.urdf`, `.sdf`, `.mjcf`, or `.xml` (MJCF).
            accept_verdict: `do_not_use` to export a run with that verdict.

        Raises:
            CampaignError: the run has no model for this format, or is not to be used.
            RefusedError: the service refuses it.
        """
        suffix = _suffix(path, _MODELS).replace("xml", "mjcf")
        query = {} if accept_verdict is None else {"accept_verdict": accept_verdict}
        Path(path).write_bytes(self._known_origin().file(self, f"model.{suffix}", query))

    def _found(self) -> RunResult:
        if self.result is None:
            reason = self.error.detail if self.error else f"the run is {self.state}"
            raise RequestError(reason, where="run", remedy="read `run.error`")
        return self.result


@cache
def shown(kind: Kind[AnyJob, Any, Any]) -> type[AnyJob]:
    """Return the message of a kind that shows itself as tables."""
    if kind.message is Run:
        return cast("type[AnyJob]", TabledRun)
    bases: Any = (Shown, kind.message)
    origin: Any = (Any, PrivateAttr(default=None))
    made = create_model(kind.message.__name__, __base__=bases, __doc__=kind.message.__doc__, _origin=origin)
    return cast("type[AnyJob]", made)


def of(job: AnyJob, origin: Door) -> AnyJob:
    """Return a job that was done there, and shows itself."""
    known = shown(kind_of(job.kind)).model_validate(dict(job))
    cast("Any", known)._origin = origin
    return cast("AnyJob", known)


def _suffix(path: str | Path, known: set[str]) -> str:
    suffix = Path(path).suffix.removeprefix(".").lower()
    if suffix not in known:
        endings = ", ".join(f".{each}" for each in sorted(known))
        raise ValueError(f"'{path}' must end in one of {endings}")
    return suffix
