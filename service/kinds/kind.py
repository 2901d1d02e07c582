"""The declaration of a kind of work. It imports fast: only computing work imports numerical modules."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Generic, Literal, TypeVar

from jointstiff.schemas.fields import Message
from jointstiff.schemas.job import Job
from jointstiff.service.problems import Resource

if TYPE_CHECKING:
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.resources.inputs import Inputs
    from jointstiff.service.tables.report import Report, View
    from jointstiff.service.tables.table import Area, Chart, Sheet

OPTIONS_BYTES: Final = 64 * 1024
"""Greatest size of a request that has only options and ids of stored resources."""
READINGS_BYTES: Final = 4 * 1024 * 1024
"""Greatest size of a request that has readings."""

MEDIA_TYPES: Final = {
    "csv": "text/csv",
    "json": "application/json",
    "npz": "application/octet-stream",
    "parquet": "application/vnd.apache.parquet",
}
"""Types of files for HTTP, by the ending of the name."""
Source = Literal[
    "measurement_set", "run", "campaigns", "sets", "robot_or_set", "run_or_robot", "readings", "files"
]
"""Arguments of a verb, from which the ids or contents in its request are made: a campaign; a run or a
campaign to identify; one campaign or two; many campaigns; a robot or a campaign; a run, a campaign or a
robot; a file of readings; a table of poses or files of a program."""

AnyJob = TypeVar("AnyJob", bound=Job)
AnyRequest = TypeVar("AnyRequest", bound=Message)


@dataclass(frozen=True)
class File:
    """A file that users can download from a job that has succeeded."""

    name: str  # last part of its address, such as `table.csv`
    description: str  # what it has, for the API's users
    sheet: Callable[[Any], Sheet]  # makes the table that is written to the file
    # argument of `sheet`: "result" for the job with its stored result, "work" for the job's work, which is
    # computed again
    made_of: Literal["result", "work"]

    @property
    def suffix(self) -> str:
        """Ending of the file's name without the dot, such as `csv`."""
        return self.name.rpartition(".")[2]

    @property
    def media_type(self) -> str:
        """Type of the file for HTTP, such as `text/csv`."""
        return MEDIA_TYPES[self.suffix]


def list_table_files(
    name: str, description: str, sheet: Callable[[Any], Sheet], made_of: Literal["result", "work"] = "result"
) -> tuple[File, File]:
    """Return the two files of a table, such as `points.csv` and `points.json`.

    Args:
        name: name of the table, without an ending.
        description: what the table has, for the API's users.
        sheet: makes the table.
        made_of: argument of `sheet`, as in `File`.
    """
    by_column = "the same by columns"
    return (
        File(f"{name}.csv", description, sheet, made_of),
        File(f"{name}.json", by_column, sheet, made_of),
    )


@dataclass(frozen=True, eq=False)
class Kind(Generic[AnyJob, AnyRequest]):
    """Declaration of a kind of work, such as plans: messages, computation, report and files."""

    message: type[AnyJob]  # a stored job, which has the names of the kind
    request: type[AnyRequest]  # a job as it is posted
    options: type[Message]  # the fields of the request that users choose
    # return the work of a request; raises a RequestError if the request names what does not exist, or cannot
    # be carried out
    prepare_work: Callable[[Inputs, AnyRequest], Work]
    make_report: Callable[[AnyJob, Any, View], Report]  # return the report of a job with a result
    sources: tuple[Source, ...]  # arguments of the verb other than options, in order
    title: str  # title of its report
    description: str  # description of the post, for the API's users
    stepped: bool = False  # true if its jobs may be cut into steps, which workers carry out
    max_bytes: int = OPTIONS_BYTES  # greatest size of a request
    examples: Mapping[str, Any] = field(default_factory=dict)  # examples of requests, by title
    files: tuple[File, ...] = ()  # files that can be downloaded
    has_report: bool = True  # true if a job of this kind has a printable report, made of its tables
    is_form: bool = False  # true if a request is posted as a form with files, at a route of its own
    writes_programs: bool = False  # true if a result may have files of a program
    to_answer: Callable[[str], str] = str  # convert a stored job's JSON to the JSON that the API returns
    # return the charts of a result, for reports and `plot`
    make_charts: Callable[[Any], Sequence[Chart]] = lambda _result: ()
    # make the map of the work area that `plot` draws below the charts, from the first table; None if results
    # of this kind have no places
    make_area_map: Callable[[Sheet], Area | None] | None = None

    @cached_property
    def name(self) -> str:
        """Name of the kind in the store, in the singular, such as `plan`; never changes."""
        return self.message.kind_name()

    @cached_property
    def collection(self) -> str:
        """Name of the kind's collection, part of the route where requests are posted, such as `plans`."""
        return self.message.collection

    @cached_property
    def resource(self) -> Resource:
        """Name and collection of the kind, as the store needs them."""
        return Resource(self.name, self.collection)


AnyKind = Kind[Any, Any]
