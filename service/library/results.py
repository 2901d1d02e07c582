"""Results that people hold: a line, a table, a frame, a plot, a file; and runs give what follows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from io import StringIO
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol, Unpack, cast

from pydantic import PrivateAttr, create_model
from rich.console import Console

from jointstiff.schemas.deflection import DeflectionResult
from jointstiff.schemas.fields import Message
from jointstiff.schemas.job import Job
from jointstiff.schemas.run import JointResult, Run, RunResult
from jointstiff.schemas.trend import Trend
from jointstiff.service.kinds import verb
from jointstiff.service.kinds.kind import AnyJob, File, Kind
from jointstiff.service.kinds.rooms import kind_of
from jointstiff.service.library.campaigns import Campaign
from jointstiff.service.tables.files import frame_of, written, xlsx_bytes
from jointstiff.service.tables.stiffness import DEFAULT_UNIT, UNITS
from jointstiff.service.tables.table import NO_NUMBER, Chart, Line, Part, Sheet, text_table
from jointstiff.service.tables.terminal import printed
from jointstiff.solver.errors import RequestError
from jointstiff.solver.text import figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jointstiff.schemas import run as messages
    from jointstiff.service.library.campaigns import Numbers
    from jointstiff.service.library.cases import AnyPostures, PredictFields
    from jointstiff.solver.arrays import FloatArray
    from jointstiff.solver.mechanics.robot import Robot

_WIDTH = 100
_REPORTS = {"pdf", "html"}
_MODELS = {"csv", "xlsx", "mjcf", "xml"}


class Door(verb.Door, Protocol):
    """A door that also gives what follows from a job."""

    def campaign_of(self, run: Run) -> messages.Campaign | None:
        """Return the campaign of a run; None if it is not known."""

    def file(
        self, job: Job, name: str, query: Mapping[str, str] | None = None, laboratory: Path | None = None
    ) -> bytes:
        """Return a file of a job, such as `report.pdf`, by the query of the API."""

    def sheet(self, job: Job, file: File) -> Sheet:
        """Return the table of a file of a job."""

    def predict(
        self,
        run: Any,  # noqa: ANN401 - a run, or a campaign
        postures: AnyPostures,
        /,
        forces: Numbers | None = None,
        **options: Unpack[PredictFields],
    ) -> Prediction:
        """Predict deflections by a run."""

    def apply(self, run: TabledRun, action: str) -> TabledRun:
        """Apply an action that a reason of a run advises; return the run of what it changes."""


class Presented(ABC):
    """A result that people hold: short by name, a table where it is printed, a frame, a plot, a file."""

    @abstractmethod
    def _parts(self) -> Sequence[Part]:
        """Return what people read."""

    @abstractmethod
    def _sheets(self) -> Mapping[str, Callable[[], Sheet]]:
        """Return the tables by name, the first one first."""

    @abstractmethod
    def _figure(self) -> Figure:
        """Draw what can be drawn."""

    @property
    def _message(self) -> Message:
        return cast("Message", self)

    def __repr__(self) -> str:
        """Return kind, state and verdict in one line."""
        return f"<{type(self).__name__}: {self._headline()}>"

    def __str__(self) -> str:
        """Return the report of the terminal as text."""
        console = Console(file=StringIO(), width=_WIDTH, highlight=False)
        console.print(printed(self._parts()))
        return cast("StringIO", console.file).getvalue()

    def _repr_html_(self) -> str:
        """Return the report of the terminal as HTML, which notebooks display."""
        console = Console(record=True, file=StringIO(), width=_WIDTH)
        console.print(printed(self._parts()))
        return console.export_html(
            inline_styles=True, code_format='<pre style="line-height:1.2">{code}</pre>'
        )

    def _headline(self) -> str:
        lines = [part.text for part in self._parts() if isinstance(part, Line)]
        return lines[0].strip().partition("\n")[0] if lines else ""

    def summary(self) -> str:
        """Return the verdict, its reasons, counts and what to do, without the tables."""
        return "\n".join(part.text for part in self._parts() if isinstance(part, Line))

    def to_frame(self, name: str | None = None) -> Any:  # noqa: ANN401 - of pandas or polars
        """Return a table as a data frame of pandas, or of polars without it; the headers carry SI units.

        Args:
            name: name of the table, such as `residuals` of a run; default: the first one.

        Raises:
            MissingExtraError: neither is installed.
            ValueError: there is no such table.
        """
        return frame_of(self._sheet(name))

    def plot(self) -> Figure:
        """Draw the result by matplotlib, which notebooks display; `.savefig(path)` writes it.

        Raises:
            MissingExtraError: matplotlib is not installed.
            ValueError: there is nothing to draw.
        """
        return self._figure()

    def save(self, path: str | PathLike[str]) -> None:
        """Write a file, of the kind that its ending says.

        Args:
            path: ends in `.json` (all numbers), `.csv` (the first table), `.xlsx` (all tables), `.svg` or
                `.png` (the plot); of jobs `.pdf` or `.html` (the report); of a map `.npz`; of a run
                `.mjcf` or `.xml` (the model); of a program as the program itself (the
                corrected file, with its .dat next to it).

        Raises:
            ValueError: there is no such file.
            CampaignError: it cannot be made, or the result is not to be used.
            RefusedError: the service refuses it.
        """
        target = Path(path)
        suffix = target.suffix.removeprefix(".").lower()
        if suffix in {"svg", "png"}:
            self._figure().savefig(target)
        elif suffix == "json":
            target.write_text(self._message.model_dump_json(indent=1) + "\n", encoding="utf-8")
        elif suffix == "csv":
            target.write_bytes(written(self._sheet(None), suffix))
        elif suffix == "xlsx":
            target.write_bytes(xlsx_bytes({name: sheet() for name, sheet in self._sheets().items()}))
        else:
            self._save_other(target, suffix)

    def _save_other(self, path: Path, suffix: str) -> None:  # noqa: ARG002 - of those that have others
        raise ValueError(f"'{path}' must end in .json, .csv, .xlsx, .svg or .png")

    def _sheet(self, name: str | None) -> Sheet:
        sheets = self._sheets()
        chosen = next(iter(sheets), "") if name is None else name
        if chosen not in sheets:
            raise ValueError(f"there is no table '{chosen}': its tables are {', '.join(sheets) or 'none'}")
        return sheets[chosen]()


class Shown(Presented):
    """A job that shows itself: to be mixed with its message."""

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

    def __repr__(self) -> str:
        """Return kind, id, state and verdict in one line."""
        job = self._job
        return f"<{kind_of(job.kind).message.__name__} {job.id[:8]}, {job.state}: {self._headline()}>"

    def _parts(self) -> Sequence[Part]:
        from jointstiff.service.reports.job import job_parts

        return job_parts(kind_of(self._job.kind), self._job)

    def _sheets(self) -> Mapping[str, Callable[[], Sheet]]:
        files = {file.name.partition(".")[0]: file for file in reversed(kind_of(self._job.kind).files)}
        return {name: partial(self._sheet_of, file) for name, file in reversed(files.items())}

    def _sheet_of(self, file: File) -> Sheet:
        """Return the table of a file; from where the job was done if its result does not hold it."""
        job = self._job
        if job.result is None:
            raise ValueError(job.error.detail if job.error else f"the {job.kind} is {job.state}")
        if self._origin is not None:
            return self._known_origin().sheet(job, file)
        if file.made_of == "work":
            self._known_origin()
        from jointstiff.service.reports.job import job_sheet

        return job_sheet(file, job, lambda: cast("Any", None))

    def _figure(self) -> Figure:
        from jointstiff.service.reports.plots import figure_of

        kind, job = kind_of(self._job.kind), self._job
        if job.result is None:
            raise ValueError(job.error.detail if job.error else f"the {job.kind} is {job.state}")
        areas = [] if kind.area is None else [kind.area(self._sheet(None))]
        return figure_of(f"{kind.title}: {self._headline()}", list(kind.charts(job.result)), areas)

    def table(self, suffix: str) -> bytes:
        """Return the first table of the job as a file: `csv`, and for maps `npz` and `json`.

        Raises:
            ValueError: the kind has no such table, or its inputs are not known.
        """
        kind = kind_of(self._job.kind)
        file = next((file for file in kind.files if file.suffix == suffix), None)
        if file is None:
            endings = ", ".join(f".{file.suffix}" for file in kind.files) or "none"
            raise ValueError(f"a {kind.name} has tables of these endings: {endings}")
        if self._origin is not None and self._job.result is not None:
            return self._known_origin().file(self._job, file.name)
        return written(self._sheet_of(file), suffix)

    def report(self, path: str | Path, laboratory: str | Path | None = None) -> None:
        """Write the report.

        Args:
            path: file to write, ending in `.pdf` or `.html`; of a run also `.xml`, a digital calibration
                certificate (DCC 3.3.0).
            laboratory: TOML file of the laboratory that issues it; a service has its own.

        Raises:
            CampaignError: the report cannot be made, or Typst is not installed.
            RefusedError: the service refuses it.
        """
        name = f"report.{_suffix(path, _REPORTS | {'xml'})}"
        settings = None if laboratory is None else Path(laboratory)
        Path(path).write_bytes(self._known_origin().file(self._job, name, None, settings))

    def _save_other(self, path: Path, suffix: str) -> None:
        job: Any = self._job
        if suffix in _REPORTS:
            self.report(path)
        elif suffix == "npz":
            path.write_bytes(self.table(suffix))
        elif kind_of(job.kind).is_form and job.result is not None:
            names = [file.name for file in job.result.files]
            for name in names:
                target = path if len(names) == 1 else path.with_suffix(Path(name).suffix)
                target.write_bytes(self._known_origin().file(job, "program", {"file": name}))
        else:
            super()._save_other(path, suffix)

    def is_of(self, door: object) -> bool:
        """Return whether the job was done there."""
        return self._origin is door

    def _known_origin(self) -> Door:
        if self._origin is None:
            raise ValueError(f"it is not known where the {self._job.kind} was done: use what a verb returned")
        return cast("Door", self._origin)


class _Joints(dict[str, JointResult]):
    """Joints by name."""

    def __missing__(self, name: str) -> JointResult:
        raise KeyError(f"there is no joint '{name}': the joints are {', '.join(self)}")


class TabledRun(Shown, Run):
    """A run with its joints by name, as a table where it is displayed, and as a report or a model file."""

    _origin: Any = PrivateAttr(default=None)

    @property
    def joints(self) -> Mapping[str, JointResult]:
        """Joints by name, in order, such as `run.joints["joint_2"].stiffness` [N·m/rad].

        Raises:
            RequestError: the run has no result.
        """
        return MappingProxyType(_Joints({joint.name: joint for joint in self._found().joints}))

    @property
    def covariance(self) -> FloatArray:
        """Covariance matrix (n, n) of the compliances, joints in order [rad²/(N·m)²].

        Those of prismatic joints are in m/N. Rows and columns of joints without an estimate are NaN.

        Raises:
            RequestError: the run has no result, or no uncertainty budget.
        """
        import numpy as np

        found = self._found()
        if found.budget is None:
            remedy = "identify by joints alone, with `sigma` or more readings than joints"
            raise RequestError("the run has no uncertainty budget", where="run", remedy=remedy)
        names, budget = [joint.name for joint in found.joints], found.budget
        matrix = np.full((len(names), len(names)), np.nan)
        places, u = [names.index(name) for name in budget.joints], np.array(budget.standard_uncertainty)
        matrix[np.ix_(places, places)] = np.outer(u, u) * np.array(budget.correlation)
        return matrix

    def predict(
        self,
        postures: AnyPostures,
        /,
        forces: Numbers | None = None,
        **options: Unpack[PredictFields],
    ) -> Prediction:
        """Predict deflections by this run; arguments as of `jointstiff.predict`."""
        return self._known_origin().predict(self, postures, forces, **options)

    @property
    def campaign(self) -> Campaign:
        """Campaign that was identified, in this process or in the service.

        Raises:
            RequestError: the run comes from elsewhere.
        """
        campaign = None if self._origin is None else self._known_origin().campaign_of(self)
        if campaign is None:
            raise RequestError(
                "the run has no reference to its campaign",
                where="run",
                remedy="use a run that `jointstiff.identify` returned, or the client of its service",
            )
        return Campaign.of(campaign)

    @property
    def robot(self) -> Robot:
        """Robot that was measured; `run.robot.model` is its model of Pinocchio.

        Raises:
            RequestError: the run comes from elsewhere.
        """
        from jointstiff.service.library.robots import prepared_robot

        return prepared_robot(self.campaign.robot).robot

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
            path: file to write, ending in `.csv`, `.xlsx`, `.mjcf`, or `.xml` (MJCF).
            accept_verdict: `do_not_use` to export a run with that verdict.

        Raises:
            CampaignError: the run has no model for this format, or is not to be used.
            RefusedError: the service refuses it.
        """
        suffix = _suffix(path, _MODELS).replace("xml", "mjcf")
        query = {} if accept_verdict is None else {"accept_verdict": accept_verdict}
        Path(path).write_bytes(self._known_origin().file(self, f"model.{suffix}", query))

    def _save_other(self, path: Path, suffix: str) -> None:
        if suffix in _MODELS - {"csv", "xlsx"}:
            self.export(path)
        else:
            super()._save_other(path, suffix)

    def _found(self) -> RunResult:
        if self.result is None:
            reason = self.error.detail if self.error else f"the run is {self.state}"
            raise RequestError(reason, where="run", remedy="read `run.error`")
        return self.result


class Prediction(Presented, DeflectionResult):  # type: ignore[misc]  # `summary` of a listing
    """Predicted deflections, which show themselves; arrays have a row for each case."""

    @property
    def displacement(self) -> FloatArray:
        """Displacements (N, 3) of the place, axes of R0 [m]; NaN where there is no number."""
        return self._rows("displacement")

    @property
    def rotation(self) -> FloatArray:
        """Rotation vectors (N, 3) of the flange, axes of R0 [rad]; NaN where there is no number."""
        return self._rows("rotation")

    @property
    def intervals(self) -> FloatArray:
        """Lower and upper ends (N, 3, 2) of the displacements by the readings [m]; NaN where unknown."""
        import numpy as np

        known = [case.readings_only for case in self.cases]
        return np.array([np.full((3, 2), np.nan) if ends is None else ends for ends in known])

    def _rows(self, field: str) -> FloatArray:
        import numpy as np

        none = (np.nan, np.nan, np.nan)
        return np.array([getattr(case, field) or none for case in self.cases], dtype=np.float64)

    def _parts(self) -> Sequence[Part]:
        from jointstiff.service.runs.deflection import prediction_parts

        return prediction_parts(self)

    def _sheets(self) -> Mapping[str, Callable[[], Sheet]]:
        from jointstiff.service.runs.deflection import prediction_sheet

        return {"cases": lambda: prediction_sheet(self)}

    def _figure(self) -> Figure:
        from jointstiff.service.reports.plots import figure_of
        from jointstiff.service.runs.deflection import prediction_charts

        return figure_of(f"Predicted deflection: {self._headline()}", prediction_charts(self))


class RobotTrend(Presented, Trend):
    """Stiffness of a robot's joints over its campaigns, and what changed since the first; it shows itself."""

    def _parts(self) -> Sequence[Part]:
        changed = sum(joint.changed for joint in self.joints)
        head = (
            f"{len(self.campaigns)} campaigns: {changed} of {len(self.joints)} joints changed since the first"
        )
        rows = []
        for joint in self.joints:
            shown = NO_NUMBER
            if (change := joint.change) is not None:
                u = change.standard_uncertainty
                known = "" if u is None else f" ± {figure(100 * u, '.2g')}"
                shown = f"{figure(100 * change.value, '.2g')}{known} %"
            p_value = NO_NUMBER if joint.p_value is None else figure(joint.p_value, ".2g")
            rows.append([joint.name, "changed" if joint.changed else "", shown, p_value])
        lines = [Line(head), *map(Line, self._other_pairs()), *([Line(self.note)] if self.note else [])]
        return [*lines, text_table(["joint", "", "change, ± u", "p-value"], rows, texts=[0, 1])]

    def _other_pairs(self) -> Iterator[str]:
        """Yield which campaigns a joint's test compares, where these are not the first and the latest."""
        whens = self._whens()
        for joint in self.joints:
            compared = [i for i, point in enumerate(joint.points) if point.reason is None]
            if joint.change is None or (compared[0] == 0 and compared[-1] == len(whens) - 1):
                continue
            first, latest = (f"'{self.campaigns[i].name}' ({whens[i]})" for i in (compared[0], compared[-1]))
            yield f"{joint.name}: compared from {first} to {latest}, as others give no number to compare"

    def _whens(self) -> list[str]:
        """Return when the campaigns were: by day; by time, or by time and number, where labels repeat."""
        times = [campaign.at for campaign in self.campaigns]
        days, minutes = ([f"{at:{form}}" for at in times] for form in ("%Y-%m-%d", "%Y-%m-%d %H:%M"))
        if len(set(days)) == len(times):
            return days
        unlike = len(set(minutes)) == len(times)
        return minutes if unlike else [f"{minute} ({i})" for i, minute in enumerate(minutes, 1)]

    def _sheets(self) -> Mapping[str, Callable[[], Sheet]]:
        return {"points": self._points}

    def _points(self) -> Sheet:
        """Return a row for each joint and campaign, in SI units."""
        pairs = [
            (joint, campaign, point)
            for joint in self.joints
            for campaign, point in zip(self.campaigns, joint.points, strict=True)
        ]
        limits = [point.interval or (None, None) for _, _, point in pairs]
        columns = {
            "joint": [joint.name for joint, _, _ in pairs],
            "campaign": [campaign.name for _, campaign, _ in pairs],
            "at": [campaign.at.isoformat() for _, campaign, _ in pairs],
            "stiffness [N.m/rad]": [point.stiffness for _, _, point in pairs],
            "lower [N.m/rad]": [low for low, _ in limits],
            "upper [N.m/rad]": [high for _, high in limits],
        }
        sheet = Sheet(columns, frozenset(["joint", "campaign", "at"]))
        return Sheet.of_joints(sheet, [joint.kind for joint, _, _ in pairs])

    def _figure(self) -> Figure:
        from jointstiff.service.reports.plots import figure_of

        names = self._whens()
        charts = []
        for joint in self.joints:
            unit = UNITS[DEFAULT_UNIT].of(joint.kind)
            series = {"stiffness": [point.stiffness for point in joint.points]}
            ends = {"stiffness": [point.interval for point in joint.points]}
            title = f"{joint.name}: changed" if joint.changed else joint.name
            charts.append(Chart(title, names, series, unit.factor, unit.label, "campaigns", ends, True))
        return figure_of(f"Trend: {self._headline()}", charts)


@cache
def shown(kind: Kind[AnyJob, Any]) -> type[AnyJob]:
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
