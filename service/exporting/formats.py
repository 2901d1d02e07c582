"""Formats of exports, by the end of a file's name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

from jointstiff.service.exporting.model import ExportedModel
from jointstiff.service.exporting.simulators import mjcf, sdf, urdf
from jointstiff.service.exporting.tables import joints_csv, workbook
from jointstiff.service.kinds.acceptance import refuse_unaccepted

ModelFormat = Literal["csv", "xlsx", "urdf", "sdf", "mjcf"]


@dataclass(frozen=True)
class Format:
    """A format."""

    write: Callable[[ExportedModel], bytes]  # writes a model
    media_type: str  # for HTTP


_XML: Final = "application/xml"
FORMATS: Final[Mapping[ModelFormat, Format]] = MappingProxyType(
    {
        "csv": Format(joints_csv, "text/csv"),
        "xlsx": Format(workbook, "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet"),
        "urdf": Format(urdf, _XML),
        "sdf": Format(sdf, _XML),
        "mjcf": Format(mjcf, _XML),
    }
)


def export_model(model: ExportedModel, name: ModelFormat, accept_verdict: str | None = None) -> bytes:
    """Return a model as a file of a format.

    Raises:
        VerdictError: the run is not to be used, and that is not accepted.
    """
    refuse_unaccepted(model.result.assessment, accept_verdict, f"run '{model.run.id}'")
    return FORMATS[name].write(model)
