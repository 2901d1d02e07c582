"""Results as Python objects: shown as a line or tables, and written as a data frame, plot or file."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache, partial
from io import StringIO
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NoReturn, Protocol, Self, Unpack, cast

from pydantic import PrivateAttr, create_model
from rich.console import Console

from jointstiff.schemas.deflection import DeflectionResult
from jointstiff.schemas.fields import Message
from jointstiff.schemas.finding import Finding, Verdict
from jointstiff.schemas.job import Job
from jointstiff.schemas.run import JointResult, Run, RunResult
from jointstiff.schemas.trend import Trend
from jointstiff.service.kinds import verb
from jointstiff.service.kinds.kind import AnyJob, File, Kind
from jointstiff.service.kinds.rooms import import_kind
from jointstiff.service.library.campaigns import Campaign, extract_run_options
from jointstiff.service.library.restoring import describe_contents, parse_job, parse_message, with_version
from jointstiff.service.problems import require_folder
from jointstiff.service.tables.estimate import percent_text
from jointstiff.service.tables.files import make_data_frame, write_sheet, xlsx_bytes
from jointstiff.service.tables.report import View
from jointstiff.service.tables.stiffness import DEFAULT_UNIT, UNITS
from jointstiff.service.tables.table import NO_NUMBER, Chart, Line, Part, Sheet, Table, build_text_table
from jointstiff.service.tables.terminal import lay_out_parts
from jointstiff.solver.errors import RequestError
from jointstiff.solver.text import figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jointstiff.schemas import run as messages
    from jointstiff.schemas.comparison import Comparison
    from jointstiff.schemas.correction import CorrectionJob
    from jointstiff.schemas.deflection import Map
    from jointstiff.schemas.gearbox import Gearbox
    from jointstiff.schemas.geometry import Geometry
    from jointstiff.schemas.plan import Plan
    from jointstiff.service.kinds.correction.verb import CorrectFields
    from jointstiff.service.library.campaigns import Numbers
    from jointstiff.service.library.cases import AnyPostures, PredictFields
    from jointstiff.service.library.correction import AnyPoses
    from jointstiff.service.reports.plots import AnyAxes, PlotStyle
    from jointstiff.solver.arrays import FloatArray
    from jointstiff.solver.mechanics.robot import Robot

_WIDTH = 100
_REPORTS = {"pdf", "html"}
_MODELS = {"csv", "xlsx", "mjcf"}


class Backend(verb.Backend, Protocol):
    """Service or process that does work, and also makes files, predictions and new runs from a job."""

    @property
    def unpickler(self) -> Callable[[str], Any]:
        """Function that makes a job from the text to which it was pickled."""

    def read_campaign(self, job: Run | Plan) -> messages.Campaign | None:
        """Return the campaign of a run, or the campaign that a plan continues; None if it is not known."""

    def find_run_for_tables(self, job: Job) -> TabledRun | None:
        """Return the run from which a job's tables are computed again; None for jobs that store tables."""

    def read_contents(self, job: Job) -> tuple[Mapping[str, Sheet], Mapping[str, bytes]]:
        """Return (tables, files) of a job, each by name, that the job's message leaves out."""

    def file(
        self, job: Job, name: str, query: Mapping[str, str] | None = None, laboratory: Path | None = None
    ) -> bytes:
        """Return the content of a file of a job, such as `report.pdf`.

        Args:
            job: the job.
            name: name of the file.
            query: parameters of the API for this file.
            laboratory: TOML file about the laboratory that issues a report.
        """

    def sheet(self, job: Job, file: File) -> Sheet:
        """Return a table of a job, given by the file to which the table is written."""

    def predict(
        self,
        run: Any,  # noqa: ANN401 - a run, or a campaign
        postures: AnyPostures,
        /,
        forces: Numbers | None = None,
        **options: Unpack[PredictFields],
    ) -> Prediction:
        """Predict deflections with the model of a run or a campaign; arguments as of `jointstiff.predict`."""

    def correct(
        self,
        source: Any,  # noqa: ANN401 - a run, a campaign, or a robot
        poses: AnyPoses,
        /,
        joints: Any = None,  # noqa: ANN401 - an array
        **options: Unpack[CorrectFields],
    ) -> Any:  # noqa: ANN401 - a `Correction`, or the job of a program
        """Correct poses; arguments as of `jointstiff.correct`."""

    def apply(self, run: TabledRun, action: str, payload: float | None = None) -> TabledRun:
        """Apply an action that the run's assessment recommends; return the run of the changed campaign."""


class ShownText(str):
    """Text of several lines, which Python's prompt and notebooks show as lines."""

    __slots__ = ()

    def __repr__(self) -> str:
        """Return the text itself."""
        return str.__str__(self)


def _lay_out_text(parts: Sequence[Part]) -> ShownText:
    """Lay out the parts of a report as text, as wide as a page of 100 characters."""
    console = Console(file=StringIO(), width=_WIDTH, highlight=False)
    console.print(lay_out_parts(parts))
    return ShownText(cast("StringIO", console.file).getvalue())


class Presented(ABC):
    """Base class of results: shown in a line or as tables; made into data frames, plots and files."""

    _saved_kind: ClassVar[str]  # `kind` in the files of a result that is no job

    @abstractmethod
    def _parts(self) -> Sequence[Part]:
        """Return the parts of the report, lines and tables, in the order in which they are shown."""

    @abstractmethod
    def _sheets(self) -> Mapping[str, Callable[[], Sheet]]:
        """Return table name → function that makes the table; the main table comes first."""

    @abstractmethod
    def _draw_figure(self, style: PlotStyle) -> Figure:
        """Draw the result as a figure of matplotlib."""

    @property
    def _endings(self) -> Sequence[str]:
        """Endings of the files that `save` writes."""
        return (".json", ".csv", ".xlsx", ".svg", ".png")

    @property
    def _message(self) -> Message:
        """This object, typed as the message that every subclass also is."""
        return cast("Message", self)

    def __reduce__(self) -> tuple[Callable[[str], Any], tuple[str]]:
        """Return how the result is pickled: as its saved file, which is read in the other process."""
        return self._unpickler(), (json.dumps(self._to_document()),)

    @classmethod
    def _from_text(cls, text: str) -> Self:
        """Return the result from the text to which it was pickled."""
        return cls._from_fields(json.loads(text))

    @classmethod
    def _from_fields(cls, fields: Mapping[str, Any]) -> Self:
        """Return the result from its document.

        Raises:
            CampaignError: the document is no such result.
        """
        return cast("Self", parse_message(fields, cast("type[Message]", cls)))

    def _unpickler(self) -> Callable[[str], Any]:
        """Return the function that makes the result from the text to which it was pickled."""
        return type(self)._from_text

    def _to_document(self) -> dict[str, Any]:
        """Return the result as a document that `jointstiff.load` reads.

        Raises:
            RefusedError: the service that did the work does not answer, or has deleted the campaign.
        """
        return with_version({"kind": self._saved_kind}) | self._message.model_dump(mode="json")

    def __dir__(self) -> list[str]:
        """Return the fields and the methods of the result, without those that pydantic adds."""
        own = {
            name
            for cls in type(self).__mro__
            if cls.__module__.startswith("jointstiff.")
            for name in (*vars(cls), *getattr(cls, "model_fields", ()))
        }
        return sorted(name for name in own if not name.startswith(("_", "model_")))

    def __repr__(self) -> str:
        """Return the type and the first line of the report."""
        return f"<{type(self).__name__}: {self._first_line()}>"

    def __str__(self) -> str:
        """Return the report of the terminal as text."""
        return str(self.summary())

    def _repr_html_(self) -> str:
        """Return the report of the terminal as HTML, which notebooks display."""
        console = Console(record=True, file=StringIO(), width=_WIDTH)
        console.print(lay_out_parts(self._parts()))
        return console.export_html(
            inline_styles=True, code_format='<pre style="line-height:1.2">{code}</pre>'
        )

    def _first_line(self) -> str:
        """Return the first text line of the report; empty if the report has only tables."""
        lines = [part.text for part in self._parts() if isinstance(part, Line)]
        return lines[0].strip().partition("\n")[0] if lines else ""

    def summary(self) -> ShownText:
        """Return the text that `print()` shows: verdict, reasons, table and remedies."""
        return _lay_out_text(self._parts())

    def to_frame(self, name: str | None = None) -> Any:  # noqa: ANN401 - of pandas or polars
        """Return a table as a data frame of pandas, or of polars if pandas is not installed.

        Headers state SI units.

        Args:
            name: name of the table, such as `residuals` of a run; default: the first table.

        Raises:
            MissingExtraError: neither pandas nor polars is installed.
            ValueError: the result has no table of this name.
        """
        return make_data_frame(self._make_table(name))

    def plot(
        self,
        ax: AnyAxes | None = None,
        *,
        title: str | None = None,
        joints: Iterable[str] | None = None,
        figsize: tuple[float, float] | None = None,
        dpi: float | None = None,
    ) -> Figure:
        """Draw the result with matplotlib; notebooks display the figure, and `.savefig(path)` writes it.

        A new figure has a panel for each quantity, one below the other, and is as wide as a column of a paper
        (88 mm). The figure belongs to no window of pyplot.

        Args:
            ax: axes to draw on, one for each panel; None for a new figure.
            title: title of the figure; None for no title.
            joints: names of the joints to draw; None for all.
            figsize: width and height of a new figure [inch].
            dpi: resolution with which `.savefig` writes a new figure [dots per inch]; None for 100.

        Raises:
            MissingExtraError: matplotlib is not installed.
            ValueError: the result has nothing to draw, another number of panels than `ax`, or no such joint.
        """
        from jointstiff.service.reports.plots import PlotStyle

        return self._draw_figure(PlotStyle(ax, title, joints, figsize, dpi))

    def to_latex(self, name: str | None = None) -> str:
        r"""Return a table as LaTeX for the package booktabs, by pandas.

        Args:
            name: name of a table of `to_frame`, which is written in SI units with all digits; default: the
                first table that `print()` shows, as it is shown.

        Raises:
            MissingExtraError: pandas is not installed.
            ValueError: the result has no such table.
        """
        from jointstiff.service.tables.files import make_latex

        if name is not None:
            return make_latex(self._make_table(name))
        shown = next((part for part in self._parts() if isinstance(part, Table)), None)
        if shown is None:
            raise ValueError("the result shows no table: print the result")
        headers = shown.head()
        cells = [[cell.text for cell in row] for row in shown.rows()]
        columns = {header: [row[i] for row in cells] for i, header in enumerate(headers)}
        return make_latex(Sheet(columns, frozenset(headers)), shown.legend)

    def save(self, path: str | PathLike[str], *, dpi: float | None = None) -> None:
        """Write the result to a file, in the format of the file's ending.

        Args:
            path: ends in `.json` (the whole result, read by `jointstiff.load` and by every verb), `.csv` (the
                first table), `.xlsx` (all tables), `.svg` or `.png` (the plot); of jobs `.pdf` or `.html`
                (the report); of a map `.npz`; of a run `.mjcf` (the model); of a program as the program
                itself (the corrected file, with its .dat next to it); or is a folder, in which the files
                of a program keep their names.
            dpi: resolution of a `.png` [dots per inch]; None for 100. Other files have none.

        Raises:
            ValueError: the result has no file with this ending, or `dpi` is stated for another file.
            CampaignError: the file cannot be made, its folder is missing, or the result must not be used.
            RefusedError: the service refuses the request.
        """
        target = require_folder(Path(path))
        suffix = target.suffix.removeprefix(".").lower()
        if dpi is not None and suffix != "png":
            raise ValueError(
                f"the format of '{path}' has no resolution: omit `dpi`, or give a name that ends in .png"
            )
        if suffix in {"svg", "png"}:
            self.plot(dpi=dpi).savefig(target)
        elif suffix == "json":
            text = json.dumps(self._to_document(), indent=1, ensure_ascii=False)
            target.write_text(text + "\n", encoding="utf-8")
        elif suffix == "csv":
            target.write_bytes(write_sheet(self._make_table(None), suffix))
        elif suffix == "xlsx":
            target.write_bytes(xlsx_bytes({name: sheet() for name, sheet in self._sheets().items()}))
        else:
            self._save_other(target, suffix)

    def _save_other(self, path: Path, suffix: str) -> None:  # noqa: ARG002 - for subclasses
        """Raise ValueError for an ending that no result has; subclasses write files with further endings."""
        *endings, last = self._endings
        raise ValueError(f"'{path}' must end in {', '.join(endings)} or {last}")

    def _make_table(self, name: str | None) -> Sheet:
        """Return the table with a name; the first table if the name is None.

        Raises:
            ValueError: the result has no table of this name.
        """
        sheets = self._sheets()
        sheet_name = next(iter(sheets), "") if name is None else name
        if sheet_name not in sheets:
            raise ValueError(
                f"the result has no table '{sheet_name}': its tables are {', '.join(sheets) or 'none'}"
            )
        return sheets[sheet_name]()


class PresentedJob(Presented):
    """Base class of jobs with tables, plots, files and reports; combined with a kind's message."""

    _origin: Any  # client or process that did the job; None if it is not known

    def __eq__(self, other: object) -> bool:
        """Return whether another job, of this class or a plain message, has the same kind and fields."""
        return isinstance(other, Job) and other.kind == self._job.kind and dict(self._job) == dict(other)

    def _unpickler(self) -> Callable[[str], Any]:
        """Return the function that makes the job from the text to which it was pickled."""
        return _parse_job_text if self._origin is None else self._require_origin().unpickler

    def _to_document(self) -> dict[str, Any]:
        """Return the job as a document, with what its message only names."""
        from jointstiff.schemas.plan import Plan

        job = self._job
        fields: dict[str, Any] = job.model_dump(mode="json")
        if self._origin is None:
            return with_version(fields)
        origin = self._require_origin()
        if isinstance(job, Plan) and (continued := origin.read_campaign(job)) is not None:
            fields["continues"] = continued.model_dump(mode="json", exclude_unset=True)
        if (run := origin.find_run_for_tables(job)) is not None:
            fields["made_from"] = run._to_document()
        return with_version(fields | describe_contents(*origin.read_contents(job)))

    def __hash__(self) -> int:
        """Return the hash of the job's id, which is unique."""
        return hash(self._job.id)

    @property
    def _endings(self) -> Sequence[str]:
        """Endings of the files that `save` writes, those of reports and of further tables included."""
        kind = import_kind(self._job.kind)
        endings = [*super()._endings]
        if kind.has_report or kind.message is Run:
            endings += [".html", ".pdf"]
        if any(file.suffix == "npz" for file in kind.files):
            endings.append(".npz")
        if kind.message is Run:
            endings += [".mjcf"]
        return endings

    @property
    def _job(self) -> Job:
        return cast("Job", self)

    def __repr__(self) -> str:
        """Return kind, short id, state and first line of the report in one line."""
        job = self._job
        return f"<{import_kind(job.kind).message.__name__} {job.id[:8]}, {job.state}: {self._first_line()}>"

    def _parts(self) -> Sequence[Part]:
        """Return the lines and tables of the report of the job."""
        from jointstiff.service.reports.job import job_parts

        kind = import_kind(self._job.kind)
        view = View(door=f"{kind.name}.details()", assumed=self._list_assumptions())
        return job_parts(kind, self._job, view)

    def _list_assumptions(self) -> Sequence[str]:
        """Return in a few words what was assumed about the readings before they were sent."""
        return ()

    def details(self) -> ShownText:
        """Return the whole report as text: all reasons, assumptions, warnings, advice and evidence."""
        from jointstiff.service.reports.job import job_parts

        view = View(details=True, assumed=self._list_assumptions())
        return _lay_out_text(job_parts(import_kind(self._job.kind), self._job, view))

    def get_params(self) -> dict[str, Any]:
        """Return the options with which the job was done, by name, as scikit-learn names its method.

        `js.identify(campaign, js.RunOptions(**run.get_params()))` repeats a run. Options that were not stated
        have their defaults. Values have the units of the API: SI units, unless `units` states others.
        """
        options = import_kind(self._job.kind).options
        return {name: value for name, value in self._job.request if name in options.model_fields}

    def _sheets(self) -> Mapping[str, Callable[[], Sheet]]:
        """Return table name → function that makes the table; names are those of files without the ending."""
        # If several files have the same name, such as a CSV and a JSON file, the first one is used.
        files = {file.name.partition(".")[0]: file for file in reversed(import_kind(self._job.kind).files)}
        return {name: partial(self._make_sheet, file) for name, file in reversed(files.items())}

    def _make_sheet(self, file: File) -> Sheet:
        """Return the table of a file of this job.

        The origin of the job, the client or process that did it, makes the table if the origin is known.

        Raises:
            ValueError: the job has no result; or only the origin can compute the table, and it is not known.
        """
        job = self._job
        if job.result is None:
            raise ValueError(job.error.detail if job.error else f"the {job.kind} is {job.state}")
        if self._origin is not None:
            return self._require_origin().sheet(job, file)
        if file.made_of == "work":
            self._require_origin()  # raises an error: only the origin can compute the table again
        from jointstiff.service.reports.job import build_job_sheet

        return build_job_sheet(file, job, lambda: cast("Any", None))

    def _draw_figure(self, style: PlotStyle) -> Figure:
        """Draw the map of the work area, if this kind has one, and below it the charts of the result.

        Raises:
            ValueError: the job has no result.
        """
        from jointstiff.service.reports.plots import draw_figure

        kind, job = import_kind(self._job.kind), self._job
        if job.result is None:
            raise ValueError(job.error.detail if job.error else f"the {job.kind} is {job.state}")
        area_maps = []
        if kind.make_area_map is not None:
            area_map = kind.make_area_map(self._make_table(None))
            area_maps = [] if area_map is None else [area_map]
        return draw_figure(list(kind.make_charts(job.result)), area_maps, style)

    def table(self, suffix: str) -> bytes:
        """Return the content of a table of the job as a file.

        Args:
            suffix: ending of the main table: `csv`, and for maps also `npz` and `json`; or the name of a
                table, such as `rows.csv` of a correction.

        Raises:
            ValueError: the kind of job has no such file, or the origin of the job is not known.
        """
        kind = import_kind(self._job.kind)
        file = next((file for file in kind.files if suffix in {file.suffix, file.name}), None)
        if file is None:
            names = ", ".join(file.name for file in kind.files) or "none"
            raise ValueError(f"a {kind.name} has these tables: {names}")
        if self._origin is not None and self._job.result is not None:
            return self._require_origin().file(self._job, file.name)
        return write_sheet(self._make_sheet(file), file.suffix)

    def report(self, path: str | Path, laboratory: str | Path | None = None) -> None:
        """Write the report of the job to a file.

        Args:
            path: file to write, ending in `.pdf` or `.html`.
            laboratory: TOML file about the laboratory that issues the report; only in this process, as a
                service has its own file.

        Raises:
            CampaignError: the report cannot be made, or Typst is not installed.
            RefusedError: the service refuses the request.
        """
        name = f"report.{_require_suffix(path, _REPORTS)}"
        settings = None if laboratory is None else Path(laboratory)
        target = require_folder(Path(path))
        target.write_bytes(self._require_origin().file(self._job, name, None, settings))

    def _save_other(self, path: Path, suffix: str) -> None:
        """Write the report, the archive of a map, or the files of a program, depending on the ending."""
        job: Any = self._job
        if suffix in _REPORTS:
            self.report(path)
        elif suffix == "npz":
            path.write_bytes(self.table(suffix))
        elif job.kind == "correction" and job.result is not None and job.result.program is not None:
            from jointstiff.service.kinds.correction.files import choose_program_paths

            names = [file.name for file in job.result.program.files]
            for name, target in choose_program_paths(path, names).items():
                target.write_bytes(self._require_origin().file(job, "program", {"file": name}))
        else:
            super()._save_other(path, suffix)

    def was_done_by(self, backend: object) -> bool:
        """Return whether a client or process did this job; `backend` is the client or process."""
        return self._origin is backend

    def _require_origin(self) -> Backend:
        """Return the client or process that did the job; raise ValueError if it is not known."""
        if self._origin is None:
            raise ValueError(
                f"the {self._job.kind} does not know the process or service that computed the result: use "
                "the result that `jointstiff` or a client returned"
            )
        return cast("Backend", self._origin)


if TYPE_CHECKING:  # `make_presented_class` makes them when they are needed

    class TabledComparison(PresentedJob, Comparison):
        """A comparison, with its tables, plots and files."""

    class TabledGearbox(PresentedJob, Gearbox):
        """Gearboxes, with their tables, plots and files."""

    class TabledGeometry(PresentedJob, Geometry):
        """A geometry, with its tables, plots and files."""

    class TabledMap(PresentedJob, Map):
        """A map, with its tables, plots and files."""

    class TabledPlan(PresentedJob, Plan):
        """A plan, with its tables, plots and files."""

    class TabledCorrectionJob(PresentedJob, CorrectionJob):
        """A corrected program, with its tables, plots and files."""


class _Joints(dict[str, JointResult]):
    """Results of joints by name; the error for an unknown name lists the known names."""

    def __missing__(self, name: str) -> JointResult:
        raise KeyError(f"the robot has no joint '{name}': its joints are {', '.join(self)}")


class TabledRun(PresentedJob, Run):
    """Run with its joints by name; shown as tables, and written as a report or a model file."""

    _origin: Any = PrivateAttr(default=None)

    def __getitem__(self, name: object) -> NoReturn:
        """Refuse an item: those of a run are in `joints`.

        Raises:
            TypeError: always.
        """
        raise TypeError(f"a Run has no items; remedy: use `run.joints[{name!r}]`, or `run.to_frame()`")

    @property
    def joints(self) -> Mapping[str, JointResult]:
        """Joints by name, in order, such as `run.joints["joint_2"].stiffness` [N·m/rad].

        Raises:
            RequestError: the run has no result.
        """
        return MappingProxyType(_Joints({joint.name: joint for joint in self._require_result().joints}))

    @property
    def verdict(self) -> Verdict:
        """Verdict on the run: `use`, `use_with_care` or `do_not_use`.

        Raises:
            RequestError: the run has no result.
        """
        return self._require_result().assessment.verdict

    @property
    def reasons(self) -> list[Finding]:
        """Findings that do not allow the verdict `use`, most severe first.

        Raises:
            RequestError: the run has no result.
        """
        return self._require_result().assessment.reasons

    @property
    def stiffness(self) -> FloatArray:
        """Stiffnesses (n,) of the joints, in order [N·m/rad]; NaN for joints without a number.

        Stiffnesses of prismatic joints are in N/m.

        Raises:
            RequestError: the run has no result.
        """
        return self._list_numbers("stiffness")

    @property
    def compliance(self) -> FloatArray:
        """Compliances (n,) of the joints, in order [rad/(N·m)]; NaN for joints without a number.

        Compliances of prismatic joints are in m/N.

        Raises:
            RequestError: the run has no result.
        """
        return self._list_numbers("compliance")

    def conf_int(self, of: Literal["compliance", "stiffness"] = "compliance") -> FloatArray:
        """Return the intervals (n, 2) of `params` at the run's confidence level; lower and upper ends.

        Args:
            of: `compliance` [rad/(N·m)], the quantity of `params`, `bse` and `cov_params()`, or `stiffness`
                [N·m/rad]; of prismatic joints [m/N] or [N/m].

        Returns:
            Profile-likelihood intervals under the run's constraints. The upper end of a stiffness is inf if
            the readings allow a rigid joint; joints without an interval are NaN.

        Raises:
            RequestError: the run has no result, or there is no such interval.
        """
        import numpy as np

        if of not in ("compliance", "stiffness"):
            raise RequestError(
                f"there is no interval of {of!r}",
                where="of",
                remedy="give `compliance` or `stiffness`; the level is the option `confidence` of `identify`",
            )
        unknown, field = (np.nan, np.nan), f"{of}_interval"
        intervals = [getattr(joint, field) or unknown for joint in self._require_result().joints]
        return np.array(
            [
                (-np.inf if lower is None else lower, np.inf if upper is None else upper)
                for lower, upper in intervals
            ]
        )

    @property
    def params(self) -> FloatArray:
        """Estimated parameters (n,) of the fit, as statsmodels names them: `compliance` [rad/(N·m)].

        Compliances of prismatic joints are in m/N. `bse`, `cov_params()` and `conf_int()` concern the same
        compliances, in the same order; `stiffness` and `conf_int("stiffness")` are their inverses.

        Raises:
            RequestError: the run has no result.
        """
        return self.compliance

    @property
    def bse(self) -> FloatArray:
        """Standard uncertainties (n,) of `params` [rad/(N·m)], as statsmodels names them; NaN if unknown.

        Those of prismatic joints are in m/N.

        Raises:
            RequestError: the run has no result.
        """
        return self._list_numbers("standard_uncertainty")

    def cov_params(self) -> FloatArray:
        """Return the covariance matrix (n, n) of `params`, as statsmodels names it: `covariance`.

        Raises:
            RequestError: the run has no result, or no uncertainty budget.
        """
        return self.covariance

    @property
    def resid(self) -> FloatArray:
        """Residuals (N, 3) of the N target readings, measured minus fitted, axes of R0 [m].

        The rows are those of `to_frame("residuals")`, which names observation and target.

        Raises:
            RequestError: the run has no result.
        """
        return self._stack_residuals("residual")

    @property
    def fittedvalues(self) -> FloatArray:
        """Deflections (N, 3) of the N target readings by the fitted model, axes of R0 [m]; rows as `resid`.

        Raises:
            RequestError: the run has no result.
        """
        return self._stack_residuals("predicted")

    @property
    def nobs(self) -> int:
        """Number N of target readings (vectors of three coordinates) that were fitted.

        Raises:
            RequestError: the run has no result.
        """
        return len(self._require_result().residuals)

    @property
    def rsquared(self) -> float:
        """Fraction of the sum of the squared deflections that the model explains; 1 for a perfect fit.

        As zero load means zero deflection, the sum is not centred at a mean. NaN without target readings.

        Raises:
            RequestError: the run has no result.
        """
        import numpy as np

        total = float(np.sum(self._stack_residuals("deflection") ** 2))
        return 1.0 - float(np.sum(self.resid**2)) / total if total else np.nan

    def _stack_residuals(self, field: str) -> FloatArray:
        """Return a vector field of the N residuals as an array (N, 3) [m]."""
        import numpy as np

        vectors = [getattr(each, field) for each in self._require_result().residuals]
        return np.array(vectors, dtype=np.float64).reshape(-1, 3)

    def _list_numbers(self, field: str) -> FloatArray:
        """Return a field of all n joints as an array (n,); NaN for joints without a number."""
        import numpy as np

        numbers = [getattr(joint, field) for joint in self._require_result().joints]
        return np.array([np.nan if each is None else each for each in numbers])

    @property
    def covariance(self) -> FloatArray:
        """Covariance matrix (n, n) of the joints' compliances, in order [rad²/(N·m)²].

        Compliances of prismatic joints are in m/N. Rows and columns of joints without an estimate are NaN.

        Raises:
            RequestError: the run has no result, or no uncertainty budget.
        """
        import numpy as np

        result = self._require_result()
        if result.budget is None:
            remedy = "identify joints without links, and state `sigma` or measure more readings than joints"
            raise RequestError("the run has no uncertainty budget", where="run", remedy=remedy)
        names, budget = [joint.name for joint in result.joints], result.budget
        matrix = np.full((len(names), len(names)), np.nan)
        # Entry (i, j) is u_i u_j times the correlation of joints i and j.
        indices = [names.index(name) for name in budget.joints]
        uncertainty = np.array(budget.standard_uncertainty)
        matrix[np.ix_(indices, indices)] = np.outer(uncertainty, uncertainty) * np.array(budget.correlation)
        return matrix

    def predict(
        self,
        postures: AnyPostures,
        /,
        forces: Numbers | None = None,
        **options: Unpack[PredictFields],
    ) -> Prediction:
        """Predict deflections with the model of this run; arguments as of `jointstiff.predict`."""
        return self._require_origin().predict(self, postures, forces, **options)

    def correct(
        self,
        poses: AnyPoses,
        /,
        joints: Any = None,  # noqa: ANN401 - an array
        **options: Unpack[CorrectFields],
    ) -> Any:  # noqa: ANN401 - a `Correction`, or the job of a program
        """Correct poses with the model of this run; arguments as of `jointstiff.correct`."""
        return self._require_origin().correct(self, poses, joints, **options)

    def _list_assumptions(self) -> Sequence[str]:
        """Return in a few words what `Campaign.from_arrays` assumed, if this process made the run."""
        campaign = getattr(self._origin, "campaign", None)
        return campaign._assumed if isinstance(campaign, Campaign) else ()

    @property
    def campaign(self) -> Campaign:
        """Campaign from which the run was identified, in this process or in the service.

        Raises:
            RequestError: the run has no reference to its campaign, such as a run read from a file.
        """
        campaign = None if self._origin is None else self._require_origin().read_campaign(self)
        if campaign is None:
            raise RequestError(
                "the run has no reference to its campaign",
                where="run",
                remedy="use a run that `jointstiff.identify` returned, or a run that the client of its "
                "service returned",
            )
        return Campaign.from_message(campaign)

    def _to_document(self) -> dict[str, Any]:
        """Return the run as a document, with its campaign if that is known."""
        fields: dict[str, Any] = self.model_dump(mode="json")
        campaign = None if self._origin is None else self._require_origin().read_campaign(self)
        if campaign is not None:
            campaign = campaign.model_copy(update={"run": extract_run_options(self)})
            fields["campaign"] = campaign.model_dump(mode="json", exclude_unset=True)
        return with_version(fields)

    @property
    def robot(self) -> Robot:
        """Robot that was measured; `run.robot.model` is its Pinocchio model.

        Raises:
            RequestError: the run has no reference to its campaign.
        """
        from jointstiff.service.library.robots import prepare_once

        return prepare_once(self.campaign.robot).robot

    def apply(self, action: str, *, payload: float | None = None) -> TabledRun:
        """Apply an action that the run's assessment recommends, and identify the changed campaign.

        The work is done where this run was done: in this process or in its service.

        Args:
            action: kind of the action, such as `exchange_columns` or `convert_units`.
            payload: largest payload of the robot by its maker [kg], for the action `state_payload`.

        Returns:
            The run of the changed campaign, with the options of this run.

        Raises:
            RequestError: the run has no result.
            CampaignError: the assessment does not recommend the action, or the action cannot be applied to
                this campaign.
            RefusedError: the service refuses the request.
        """
        self._require_result()
        return self._require_origin().apply(self, action, payload)

    def export(self, path: str | Path, accept_verdict: str | None = None) -> None:
        """Write the identified model to a table or a file for simulators.

        Args:
            path: file to write, ending in `.csv`, `.xlsx` or `.mjcf` (MuJoCo).
            accept_verdict: `do_not_use` to export a run with that verdict.

        Raises:
            CampaignError: the run has no model for this format, or its verdict is `do_not_use`.
            RefusedError: the service refuses the request.
        """
        suffix = _require_suffix(path, _MODELS)
        query = {} if accept_verdict is None else {"accept_verdict": accept_verdict}
        target = require_folder(Path(path))
        target.write_bytes(self._require_origin().file(self, f"model.{suffix}", query))

    def _save_other(self, path: Path, suffix: str) -> None:
        """Write a model for simulators, or a file that every kind of job can write."""
        if suffix == "mjcf":
            self.export(path)
        else:
            super()._save_other(path, suffix)

    def _require_result(self) -> RunResult:
        """Return the result; raise RequestError if the run has none."""
        if self.result is None:
            reason = self.error.detail if self.error else f"the run is {self.state}"
            raise RequestError(reason, where="run", remedy="read `run.error`")
        return self.result


class Prediction(Presented, DeflectionResult):  # type: ignore[misc]  # `summary` of a listing
    """Predicted deflections, shown as tables; its arrays have a row for each of N load cases."""

    _saved_kind: ClassVar[str] = "prediction"

    @property
    def displacement(self) -> FloatArray:
        """Displacements (N, 3) of the loaded place in N cases, axes of R0 [m]; NaN without a prediction."""
        return self._stack_vectors("displacement")

    @property
    def rotation(self) -> FloatArray:
        """Rotation vectors (N, 3) of the flange, axes of R0 [rad]; NaN for cases without a prediction."""
        return self._stack_vectors("rotation")

    @property
    def intervals(self) -> FloatArray:
        """Confidence intervals (N, 3, 2) of `displacement`, without model error [m]; NaN where unknown."""
        import numpy as np

        intervals = [case.readings_only for case in self.cases]
        return np.array([np.full((3, 2), np.nan) if each is None else each for each in intervals])

    def _stack_vectors(self, field: str) -> FloatArray:
        """Return a vector field of all N cases as an array (N, 3); NaN for cases without the field."""
        import numpy as np

        unknown = (np.nan, np.nan, np.nan)
        return np.array([getattr(case, field) or unknown for case in self.cases], dtype=np.float64)

    def _parts(self) -> Sequence[Part]:
        """Return the lines and tables of the predicted deflections."""
        from jointstiff.service.runs.deflection import describe_predictions

        return describe_predictions(self)

    def _sheets(self) -> Mapping[str, Callable[[], Sheet]]:
        """Return table name → function that makes the table; the only table has a row for each load case."""
        from jointstiff.service.runs.deflection import prediction_sheet

        return {"cases": lambda: prediction_sheet(self)}

    def _draw_figure(self, style: PlotStyle) -> Figure:
        """Draw the predicted deflections of all load cases."""
        from jointstiff.service.reports.plots import draw_figure
        from jointstiff.service.runs.deflection import prediction_charts

        return draw_figure(prediction_charts(self), style=style)


class RobotTrend(Presented, Trend):
    """Stiffness of a robot's joints over its campaigns; shown as a table of changes, and plots."""

    _saved_kind: ClassVar[str] = "trend"

    def _parts(self) -> Sequence[Part]:
        """Return the report of a trend: number of changed joints, a table of the changes in %, remarks."""
        changed_count = sum(joint.changed for joint in self.joints)
        headline = (
            f"{self.campaign_count} campaigns: {changed_count} of {len(self.joints)} joints "
            "changed since the first"
        )
        rows = []
        for joint in self.joints:
            change_text = NO_NUMBER if joint.change is None else percent_text(joint.change)
            p_value = NO_NUMBER if joint.p_value is None else figure(joint.p_value, ".2g")
            rows.append([joint.name, "changed" if joint.changed else "", change_text, p_value])
        lines = [
            Line(headline),
            *map(Line, self._describe_other_pairs()),
            *([Line(self.note)] if self.note else []),
        ]
        return [*lines, build_text_table(["joint", "", "change", "p-value"], rows, left_aligned=[0, 1])]

    def _describe_other_pairs(self) -> Iterator[str]:
        """Yield a sentence for each joint whose test does not compare the first with the latest campaign."""
        dates = self._campaign_dates()
        for joint in self.joints:
            compared_campaigns = [index for index, point in enumerate(joint.points) if point.reason is None]
            if joint.change is None or (
                compared_campaigns[0] == 0 and compared_campaigns[-1] == len(dates) - 1
            ):
                continue
            first, latest = (
                f"'{self.campaigns[index].name}' ({dates[index]})"
                for index in (compared_campaigns[0], compared_campaigns[-1])
            )
            reason = "because the other campaigns give no number to compare"
            yield f"{joint.name}: compared from {first} to {latest}, {reason}"

    def _campaign_dates(self) -> list[str]:
        """Return a distinct text for each campaign: its date, if needed with time, and with a number."""
        times = [campaign.at for campaign in self.campaigns]
        days, minutes = ([f"{at:{form}}" for at in times] for form in ("%Y-%m-%d", "%Y-%m-%d %H:%M"))
        if len(set(days)) == len(times):
            return days
        are_unique = len(set(minutes)) == len(times)
        return minutes if are_unique else [f"{minute} ({i})" for i, minute in enumerate(minutes, 1)]

    def _sheets(self) -> Mapping[str, Callable[[], Sheet]]:
        """Return table name → function that makes it; the only table has a row for each point."""
        return {"points": self._points_sheet}

    def _points_sheet(self) -> Sheet:
        """Return the table of the trend: stiffness and interval for each joint and campaign, in SI units."""
        cells = [
            (joint, campaign, point)
            for joint in self.joints
            for campaign, point in zip(self.campaigns, joint.points, strict=True)
        ]
        limits = [point.interval or (None, None) for _, _, point in cells]
        columns = {
            "joint": [joint.name for joint, _, _ in cells],
            "campaign": [campaign.name for _, campaign, _ in cells],
            "at": [campaign.at.isoformat() for _, campaign, _ in cells],
            "stiffness [N.m/rad]": [point.stiffness for _, _, point in cells],
            "lower [N.m/rad]": [lower for lower, _ in limits],
            "upper [N.m/rad]": [upper for _, upper in limits],
        }
        sheet = Sheet(columns, frozenset(["joint", "campaign", "at"]))
        return Sheet.with_joint_kinds(sheet, [joint.kind for joint, _, _ in cells])

    def _draw_figure(self, style: PlotStyle) -> Figure:
        """Draw a figure with a chart for each joint: its stiffness over the campaigns."""
        from jointstiff.service.reports.plots import draw_figure

        names = self._campaign_dates()
        charts = []
        for joint in self.joints:
            unit = UNITS[DEFAULT_UNIT].for_kind(joint.kind)
            series = {"stiffness": [point.stiffness for point in joint.points]}
            intervals = {"stiffness": [point.interval for point in joint.points]}
            title = f"{joint.name}: changed" if joint.changed else joint.name
            charts.append(
                Chart(
                    title, names, series, unit.factor, unit.label, "campaigns", intervals, True, "stiffness"
                )
            )
        return draw_figure(charts, style=style)


@cache
def make_presented_class(kind: Kind[AnyJob, Any]) -> type[AnyJob]:
    """Return the class of a kind's jobs, extended by methods for tables, plots and files.

    A cache keeps one class for each kind.
    """
    if kind.message is Run:
        return cast("type[AnyJob]", TabledRun)
    bases: Any = (PresentedJob, kind.message)
    origin: Any = (Any, PrivateAttr(default=None))
    presented = create_model(
        kind.message.__name__, __base__=bases, __doc__=kind.message.__doc__, _origin=origin
    )
    return cast("type[AnyJob]", presented)


def attach_origin(job: AnyJob, origin: Backend) -> AnyJob:
    """Return a copy of a job with methods for tables, plots and files.

    `origin` is the client or process that computed the job; it also makes the files.
    """
    presented = make_presented_class(import_kind(job.kind)).model_validate(dict(job))
    cast("Any", presented)._origin = origin
    return cast("AnyJob", presented)


def _parse_job_text(text: str) -> Any:  # noqa: ANN401 - a job of any kind
    """Return a job, without an origin, from the text to which it was pickled."""
    job = parse_job(json.loads(text)).job
    return make_presented_class(import_kind(job.kind)).model_validate(dict(job))


def _require_suffix(path: str | Path, known: set[str]) -> str:
    """Return the ending of a path without the dot, if the ending is in `known`.

    Raises:
        ValueError: the path has another ending.
    """
    suffix = Path(path).suffix.removeprefix(".").lower()
    if suffix not in known:
        endings = ", ".join(f".{each}" for each in sorted(known))
        raise ValueError(f"'{path}' must end in one of {endings}")
    return suffix
