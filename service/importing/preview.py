"""Preview of an import in words, before anything is stored."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

from jointstiff.schemas.importing import (
    MAX_PREVIEW_ROWS,
    ColumnMeaning,
    DecimalMark,
    FilePreview,
    ImportPreview,
    MissingField,
)
from jointstiff.service.importing.assembly import Assembly
from jointstiff.service.importing.grid import Grid
from jointstiff.service.importing.layout import Layout


def preview_file(grid: Grid, layout: Layout, mark: DecimalMark | None, notes: Sequence[str]) -> FilePreview:
    """One file and how it was read."""
    columns = [
        ColumnMeaning(
            column=column,
            header=header,
            meaning=str(meaning),
            unit=meaning.unit,
            guessed=meaning.guessed and meaning.kind != "ignored",
        )
        for column, (header, meaning) in enumerate(
            zip(layout.headers, layout.columns.meanings, strict=True), start=1
        )
    ]
    return FilePreview(
        file=grid.file,
        format=grid.format,
        sheet=grid.sheet,
        encoding=grid.encoding,
        delimiter=grid.delimiter,
        decimal_mark=mark if grid.format == "text" else None,
        columns=columns,
        row_count=len(layout.rows),
        first_rows=[list(row.cells) for row in layout.rows[:MAX_PREVIEW_ROWS]],
        assumptions=list(notes),
        header_lines=list(layout.lines),
        first_lines=[row.line for row in layout.rows[:MAX_PREVIEW_ROWS]],
    )


def preview_all(files: list[FilePreview], assembly: Assembly | None) -> ImportPreview:
    """All files together; without an assembly as far as they were understood."""
    observations = () if assembly is None else assembly.observations
    joints = observations[0].values.get("joint") if observations else None
    read = assembly is not None and not assembly.one_state
    return ImportPreview(
        files=files,
        observation_count=len(observations),
        first_labels=[one.label for one in observations[:MAX_PREVIEW_ROWS]],
        joint_count=None if joints is None else len(joints[0]),
        targets=list(assembly.targets) if assembly else [],
        states=list(assembly.states) if assembly else [],
        reading_count=sum(len(one.points) for one in observations) if read else 0,
        assumptions=list(assembly.assumptions) if assembly else [],
        uncertainty=assembly.uncertainty if assembly else None,
        missing=[item.text for item in missing_from(assembly)] if assembly else [],
    )


class Missing(NamedTuple):
    """Something that a measurement set needs beyond what was read."""

    field: MissingField  # for programs
    text: str  # for people


def missing_from(
    assembly: Assembly,
    flange_targets: Collection[str] = (),
    *,
    load_point: bool = False,
    force: bool = False,
    unusual: Sequence[str] = (),
) -> list[Missing]:
    """Return what a measurement set needs beyond what was read.

    Args:
        assembly: what was read.
        flange_targets: names of targets whose place in the flange frame is known.
        load_point: whether it is known.
        force: whether one force of all observations is known.
        unusual: values to be confirmed, in words.
    """
    values = assembly.observations[0].values
    states = set(assembly.states)
    joints = "joint angles of each observation: columns `J1 [deg]`, `J2 [deg]`, …"
    forces = "the force of each observation: columns `Fx [N]`, `Fy [N]`, `Fz [N]`, or one `force`"
    readings = "readings: columns such as `P10 unloaded x [mm]`, or lists of points"
    places = "the targets' positions in the flange frame (`flange_targets`), for deflections"
    right = f"a confirmation (`accept_unusual`) that this is right: {'; '.join(unusual[:MAX_PREVIEW_ROWS])}"
    unplaced = "deflection" in states and not set(assembly.targets) <= set(flange_targets)
    wanted: list[tuple[bool, MissingField, str]] = [
        ("joint" not in values, "joints", joints),
        ("force" not in values and not force, "force", forces),
        (not states, "readings", readings),
        (states == {"unloaded"}, "loaded", "the positions under load"),
        (states == {"loaded"}, "unloaded", "the positions without load"),
        (unplaced, "flange_targets", places),
        (
            "load point" not in values and not load_point,
            "load_point",
            "the load point (`load_point`), in the flange frame",
        ),
        (bool(unusual), "accept_unusual", right),
    ]
    return [Missing(field, text) for lacks, field, text in wanted if lacks]
