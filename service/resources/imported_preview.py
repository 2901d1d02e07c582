"""Preview of an import in words, before anything is stored."""

from __future__ import annotations

from jointstiff.schemas.importing import (
    MAX_PREVIEW_ROWS,
    ColumnMeaning,
    FilePreview,
    ImportPreview,
)
from jointstiff.service.importing.layout import Layout
from jointstiff.service.importing.reading import Understood


def _file(layout: Layout) -> FilePreview:
    """Return one file and how it was read."""
    grid = layout.grid
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
        decimal_mark=layout.mark if grid.format == "text" else None,
        columns=columns,
        row_count=len(layout.rows),
        first_rows=[list(row.cells) for row in layout.rows[:MAX_PREVIEW_ROWS]],
        assumptions=list(layout.assumptions),
        header_lines=list(layout.lines),
        first_lines=[row.line for row in layout.rows[:MAX_PREVIEW_ROWS]],
    )


def preview_of(understood: Understood) -> ImportPreview:
    """Return what was understood of all files."""
    assembly = None if understood.imported is None else understood.imported.assembly
    observations = () if assembly is None else assembly.observations
    joints = observations[0].values.get("joint") if observations else None
    read = assembly is not None and not assembly.one_state
    return ImportPreview(
        files=[_file(layout) for layout in understood.layouts],
        observation_count=len(observations),
        first_labels=[one.label for one in observations[:MAX_PREVIEW_ROWS]],
        joint_count=None if joints is None else len(joints[0]),
        targets=list(assembly.targets) if assembly else [],
        states=list(assembly.states) if assembly else [],
        reading_count=sum(len(one.points) for one in observations) if read else 0,
        assumptions=list(assembly.assumptions) if assembly else [],
        uncertainty=assembly.uncertainty if assembly else None,
    )
