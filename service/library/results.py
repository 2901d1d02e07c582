"""Jobs in a notebook: they show themselves as the tables of the terminal, and runs give what follows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

from pydantic import PrivateAttr
from rich.console import Console

from jointstiff.schemas.campaign import Campaign
from jointstiff.schemas.job import Job
from jointstiff.schemas.run.joints import JointResult
from jointstiff.schemas.run.run import CampaignRun, Run, RunResult
from jointstiff.service.inputs.inputs import Inputs
from jointstiff.service.kinds.kind import AnyJob, AnyKind, Kind
from jointstiff.service.kinds.report import job_report, job_sheet
from jointstiff.service.kinds.run import RUN
from jointstiff.service.tables.files import written
from jointstiff.solver.errors import RequestError

if TYPE_CHECKING:
    from jointstiff.service.library.collections import Runs

_WIDTH = 100


class _Shown:
    """A job that shows itself as tables: to be mixed with its message."""

    declared: ClassVar[AnyKind]
    _inputs: Any  # inputs of the work, where it was done in this process

    def __eq__(self, other: object) -> bool:
        """Return whether the other is the same job, whether it shows itself or not."""
        return (
            isinstance(other, Job) and other.kind == self.declared.name and dict(self._job()) == dict(other)
        )

    def __hash__(self) -> int:
        """Return the hash of the id, which is the job's alone."""
        return hash(self._job().id)

    def _job(self) -> Job:
        return cast("Job", self)

    def table(self, suffix: str) -> bytes:
        """Return the table of the job as a file: `csv`, and for maps `npz` and `json`.

        Raises:
            ValueError: the kind has no such table, or its inputs are a service's.
        """
        job, kind = self._job(), self.declared
        file = next((file for file in kind.files if file.suffix == suffix), None)
        if file is None:
            endings = ", ".join(f".{file.suffix}" for file in kind.files) or "none"
            raise ValueError(f"a {kind.name} has tables of these endings: {endings}")
        if file.made_of == "work" and self._inputs is None:
            raise ValueError(f"the table of a {kind.name} is made from inputs that only the service has")
        return written(job_sheet(file, job, lambda: kind.compute(self._inputs, job.request)), suffix)

    def __str__(self) -> str:
        """Return the report of the terminal as text."""
        console = Console(file=StringIO(), width=_WIDTH, highlight=False)
        console.print(job_report(self.declared, self._job()))
        return cast("StringIO", console.file).getvalue()

    def _repr_html_(self) -> str:
        """Return the report of the terminal as HTML, which notebooks display."""
        console = Console(record=True, file=StringIO(), width=_WIDTH)
        console.print(job_report(self.declared, self._job()))
        return console.export_html(
            inline_styles=True, code_format='<pre style="line-height:1.2">{code}</pre>'
        )


class Joints(Mapping[str, JointResult]):
    """The joints of a run by name, in order."""

    def __init__(self, joints: list[JointResult]) -> None:
        """Hold the joints of a result."""
        self._joints = {joint.name: joint for joint in joints}

    def __getitem__(self, name: str) -> JointResult:
        """Return a joint."""
        return self._joints[name]

    def __iter__(self) -> Iterator[str]:
        """Yield the names."""
        return iter(self._joints)

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._joints)


class TabledRun(_Shown, Run):
    """A run with its joints by name, as a table where it is displayed, and as a report or a model file."""

    declared: ClassVar[AnyKind] = RUN
    _inputs: Any = PrivateAttr(default=None)
    _campaign: Campaign | None = PrivateAttr(default=None)  # campaign that was identified in this process
    _service: Runs | None = PrivateAttr(default=None)  # service that the run comes from, of a client

    @property
    def joints(self) -> Joints:
        """Joints by name, such as `run.joints["joint_2"].stiffness` [N·m/rad].

        Raises:
            RequestError: the run has no result.
        """
        return Joints(self._found().joints)

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
        if self._campaign is None:
            raise RequestError(
                "the run has no reference to its campaign",
                where="run",
                remedy="use a run that `jointstiff.identify` returned, or the client of its service",
            )
        return self._campaign

    def apply(self, action: str) -> TabledRun:
        """Apply an action that a reason advises, and identify what it changes, here or in the run's service.

        Args:
            action: kind of the action, such as `exchange_columns` or `convert_units`.

        Returns:
            The run of the mended campaign, by the options of this one; in this process its `campaign`.

        Raises:
            RequestError: the run has no result, or comes from elsewhere.
            CampaignError: no reason advises the action, or it cannot be applied to this campaign.
            RefusedError: the service refuses it.
        """
        from jointstiff.service.conversion.mending import advised, mended
        from jointstiff.service.library.campaigns import as_campaign_error
        from jointstiff.service.library.in_process import identify

        assessment = self._found().assessment
        if self._service is not None:
            with as_campaign_error(""):
                chosen = advised(assessment, action)
            return self._service.apply(self, chosen)
        options = self.request.model_dump(exclude={"measurement_set_id", "variant_of"})
        campaign = self.campaign.model_copy(update={"run": CampaignRun.model_validate(options)})
        with as_campaign_error(""):
            campaign = mended(campaign, advised(assessment, action))
        return identify(campaign)

    def _found(self) -> RunResult:
        if self.result is None:
            reason = self.error.detail if self.error else f"the run is {self.state}"
            raise RequestError(reason, where="run", remedy="read `run.error`")
        return self.result

    @classmethod
    def of(cls, run: Run, campaign: Campaign) -> TabledRun:
        """Return a run that knows its campaign."""
        tabled = cls.model_validate(dict(run))
        tabled._campaign = campaign
        return tabled

    def report(self, path: str | Path, laboratory: str | Path | None = None) -> None:
        """Write the report, a draft, as PDF or HTML.

        Args:
            path: file to write, ending in `.pdf` or `.html`.
            laboratory: TOML file of the laboratory that issues it; a service has its own.

        Raises:
            CampaignError: the report cannot be made, or Typst is not installed.
        """
        from jointstiff.service.library.models import reported_run
        from jointstiff.service.reports.laboratory import LaboratorySettings, read_laboratory

        if self._service is not None and laboratory is None:
            name = f"report.{_suffix(path, {'pdf', 'html'})}"
            Path(path).write_bytes(self._service.file(self, name, {}))
            return
        settings = LaboratorySettings() if laboratory is None else read_laboratory(Path(laboratory))
        as_pdf = _suffix(path, {"pdf", "html"}) == "pdf"
        Path(path).write_bytes(reported_run(self.campaign, as_pdf, settings, self))

    def export(self, path: str | Path, accept_verdict: str | None = None) -> None:
        """Write the identified model.

        Args:
            path: file to write, ending in `.csv`, `.xlsx`, `.urdf`, `.sdf`, `.mjcf`, or `.xml` (MJCF).
            accept_verdict: `do_not_use` to export a run with that verdict.

        Raises:
            CampaignError: the run has no model for this format, or is not to be used.
            RefusedError: the service refuses it.
        """
        from jointstiff.service.exporting.formats import FORMATS
        from jointstiff.service.library.models import exported

        suffix = _suffix(path, {*FORMATS, "xml"})
        name = cast("Any", suffix.replace("xml", "mjcf"))
        if self._service is not None:
            query = {} if accept_verdict is None else {"accept_verdict": accept_verdict}
            Path(path).write_bytes(self._service.file(self, f"model.{name}", query))
            return
        Path(path).write_bytes(exported(self.campaign, name, self, accept_verdict))

    def over(self, service: Runs) -> TabledRun:
        """Return the run, which goes over a service from now on."""
        self._service = service
        return self


@cache
def shown(kind: Kind[AnyJob, Any, Any]) -> type[AnyJob]:
    """Return the message of a kind that shows itself as tables."""
    if kind.message is Run:
        return cast("type[AnyJob]", TabledRun)
    members = {
        "__doc__": kind.message.__doc__,
        "__module__": __name__,
        "__annotations__": {"declared": ClassVar[AnyKind], "_inputs": Any},
        "declared": kind,
        "_inputs": PrivateAttr(default=None),
    }
    return cast("type[AnyJob]", type(kind.message.__name__, (_Shown, kind.message), members))


def with_inputs(job: Job, inputs: Inputs) -> None:
    """Let a job that shows itself know its inputs, from which tables are made."""
    cast("Any", job)._inputs = inputs


def _suffix(path: str | Path, known: set[str]) -> str:
    suffix = Path(path).suffix.removeprefix(".").lower()
    if suffix not in known:
        endings = ", ".join(f".{each}" for each in sorted(known))
        raise ValueError(f"'{path}' must end in one of {endings}")
    return suffix
