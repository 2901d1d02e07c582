"""Files → proposal or mapping → check, in one call: what HTTP, the terminal and Python share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.imports import (
    FORCE_UNITS,
    SHOWN_ROWS,
    ImportAnswer,
    ImportChoice,
    ImportQuestion,
    ImportRequest,
    Mapping,
    TableColumn,
    TableView,
)
from jointstiff.schemas.measurement import MeasurementSetDocument
from jointstiff.service.conversion.prepared import check_set, resolve_stated_frame
from jointstiff.service.imports.check import check
from jointstiff.service.imports.documents import build_geometry, build_set, list_places, name_set
from jointstiff.service.imports.formats import SourceFile, read_files
from jointstiff.service.imports.gather import Readings, gather
from jointstiff.service.imports.mapping import (
    describe_role,
    exchange_states,
    is_named,
    list_columns,
    replace_role,
)
from jointstiff.service.imports.propose import propose
from jointstiff.service.imports.tables import Table, TableError, split_words, transpose
from jointstiff.service.imports.template import find_template
from jointstiff.service.imports.texts import EncodingError
from jointstiff.service.imports.weight_step import is_weight_step, read_weight_step
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.mechanics.robot import KnownRobot

_ENCODINGS: Final = ("windows-1252", "windows-1250", "windows-1251", "utf-16-le", "shift_jis", "gb18030")
"""Encodings that a question offers; any other may be stated."""


def import_files(
    files: Sequence[SourceFile],
    request: ImportRequest,
    robot: KnownRobot | None,
    others: Iterable[KnownRobot] = (),
) -> ImportAnswer:
    """Read files by the mapping of a request, by documented headers, or by a proposal of the robot.

    Args:
        files: tables of readings, in any order.
        request: mapping of the files; without tables, the robot proposes them.
        robot: robot that was measured; None if unknown: then only documented headers are understood.
        others: robots that may have been measured instead, for the integrity checks.

    Raises:
        TableError: a file is too large, is damaged, or has no table.
    """
    stated = request.mapping
    try:
        tables = read_files(files, stated.encoding)
    except EncodingError as error:
        if stated.encoding is not None:
            raise
        choices = [_choose(word, stated, encoding=word) for word in _ENCODINGS]
        question = ImportQuestion(
            text=f"{error.where}: {error.reason}: which encoding has it?", choices=choices
        )
        return ImportAnswer(tables=[], mapping=stated, sentence="", questions=[question], faults=[])
    return import_tables(tables, request, robot, others)


def import_tables(
    tables: Sequence[Table],
    request: ImportRequest,
    robot: KnownRobot | None,
    others: Iterable[KnownRobot] = (),
) -> ImportAnswer:
    """Read tables by the mapping of a request, by documented headers, or by a proposal of the robot.

    Arguments and errors are those of `import_files`.
    """
    stated = request.mapping
    if is_weight_step(tables[0]):
        names = () if robot is None else robot.robot.joint_names
        step = read_weight_step(tables[0], names)
        views = [_view(table, stated) for table in tables]
        return ImportAnswer(
            tables=views, mapping=stated, sentence="", questions=[], faults=[], weight_step=step
        )
    return _Import(tables, robot, others, name_set(request, tables[0].name)).answer(stated)


def _choose(text: str, mapping: Mapping, **changed: object) -> ImportChoice:
    """Return an answer that changes fields of the mapping."""
    return ImportChoice(text=text, mapping=mapping.model_copy(update=changed))


class _Import:
    """Tables of one import, with the robot that judges them."""

    def __init__(
        self, tables: Sequence[Table], robot: KnownRobot | None, others: Iterable[KnownRobot], name: str
    ) -> None:
        self._tables, self._robot, self._others, self._name = tables, robot, others, name

    def answer(self, stated: Mapping) -> ImportAnswer:
        """Return what the tables say by a mapping, which is found if it names no tables."""
        mapping, sentence = stated, ""
        if not stated.tables:
            template = find_template(self._tables, stated)
            if template is not None:
                mapping = template
            elif self._robot is None:
                reason = (
                    "the headers are not those of the template: state the robot, or the roles of the columns"
                )
                return self._refuse(stated, reason)
            else:
                draft = propose(self._tables, self._robot, stated)
                if draft.reason:
                    return self._refuse(stated, f"{draft.reason}: state the roles of the columns")
                mapping, sentence = draft.mapping, draft.sentence
        try:
            readings = gather(self._tables, mapping, None if self._robot is None else self._robot.robot)
        except TableError as error:
            where = f"{error.where}: " if error.where else ""
            return self._refuse(mapping, f"{where}{error.reason}: {error.remedy}", sentence)
        return self._complete(readings, mapping, sentence)

    def _refuse(self, mapping: Mapping, fault: str, sentence: str = "") -> ImportAnswer:
        """Return the tables with a question that only roles of columns answer."""
        question = ImportQuestion(text=fault, field="tables")
        return ImportAnswer(
            tables=self._view_tables(mapping),
            mapping=mapping,
            sentence=sentence,
            questions=[*_ask(mapping), question],
            faults=[],
        )

    def _view_tables(self, mapping: Mapping) -> list[TableView]:
        return [_view(table, mapping) for table in self._tables]

    def _complete(self, readings: Readings, mapping: Mapping, sentence: str) -> ImportAnswer:
        """Return the answer for readings: the next questions, or the documents made of them."""
        robot = None if self._robot is None else self._robot.robot
        found = check(readings, mapping, robot)
        is_loaded = any(key.state == "loaded" for key in readings.positions) or bool(
            readings.displacements or readings.gauges
        )
        by_weight = not is_loaded and robot is not None and bool(robot.bodies)
        questions = [
            *_ask(mapping),
            *_ask_statements(readings, mapping, is_loaded=is_loaded, by_weight=by_weight),
        ]
        answer = ImportAnswer(
            tables=self._view_tables(mapping),
            mapping=mapping,
            sentence="; ".join(filter(None, (sentence, found.sentence))),
            questions=questions,
            faults=found.faults,
            far=found.far,
        )
        if questions:
            return answer
        return self._add_documents(answer, readings, mapping, has_set=is_loaded or by_weight)

    def _add_documents(
        self, answer: ImportAnswer, readings: Readings, mapping: Mapping, *, has_set: bool
    ) -> ImportAnswer:
        """Return the answer with a measurement set and its findings, or with the poses of a geometry."""
        try:
            if not has_set:
                geometry = build_geometry(readings, mapping, self._name)
                return answer.model_copy(update={"geometry": geometry})
            document = build_set(readings, mapping, self._name)
            findings = None if self._robot is None else self._inspect(document, self._robot)
        except (TableError, MeasurementError) as error:
            faults = [*answer.faults, f"{error.reason}: {error.remedy}"]
            return answer.model_copy(update={"faults": faults})
        return answer.model_copy(update={"measurement_set": document, "findings": findings})

    def _inspect(self, document: MeasurementSetDocument, known: KnownRobot) -> list[Finding]:
        """Return the findings of the integrity checks.

        Raises:
            MeasurementError: the readings cannot be those of the robot.
        """
        resolved = resolve_stated_frame(document)
        return check_set(
            document, known.robot, resolved, [], self._others, robot_id=known.identifier or ""
        ).warnings


def _view(table: Table, mapping: Mapping) -> TableView:
    """Return a table with the role of each column, and with the parts of words that have a role."""
    role_of: dict[str, str] = {}
    parts = [part for part in mapping.tables if is_named(table, part)]
    if any(part.transpose for part in parts):
        table = transpose(table)
    columns = list(table.columns)
    for part in parts:
        for role in part.roles:
            role_of |= dict.fromkeys(list_columns(role), describe_role(role))
        for name, marks in part.split.items():
            columns += split_words(table.column(name), marks)
    views = [
        TableColumn(
            id=column.id,
            header=column.header,
            cells=list(column.cells[:SHOWN_ROWS]),
            role=role_of.get(column.id, ""),
        )
        for column in columns
    ]
    return TableView(name=table.name, row_count=table.row_count, columns=views)


def _ask(mapping: Mapping) -> Iterator[ImportQuestion]:
    """Yield what numbers cannot say: doubts of the proposal, and units of forces."""
    for doubt in mapping.doubts:
        rest = [each for each in mapping.doubts if each != doubt]
        choices = [_choose("yes", mapping, doubts=rest)]
        if doubt.about == "states":
            exchanged = exchange_states(mapping)
            choices.append(_choose("no, exchange the states", exchanged, doubts=rest))
        yield ImportQuestion(text=doubt.text, choices=choices)
    for number, part in enumerate(mapping.tables):
        for role in part.roles:
            if role.role in ("force", "load", "mass") and role.unit is None:
                choices = [
                    ImportChoice(
                        text=unit,
                        mapping=replace_role(mapping, number, role.model_copy(update={"unit": unit})),
                    )
                    for unit in FORCE_UNITS
                ]
                text = f"in which unit are the {role.role}s in columns {role.columns}?"
                yield ImportQuestion(text=text, choices=choices)


def _ask_statements(
    readings: Readings, mapping: Mapping, *, is_loaded: bool, by_weight: bool
) -> Iterator[ImportQuestion]:
    """Yield what files do not say: the force, the load point, the encoders and the places of targets."""
    if is_loaded:
        has_load = any(role.role == "load" for part in mapping.tables for role in part.roles)
        if mapping.force is None and (has_load or not readings.forces):
            what = "which way do the loads pull" if has_load else "which force pulls at the load point"
            yield ImportQuestion(text=f"{what} (Fx, Fy, Fz in R0 [N])?", field="force")
        if mapping.load_point is None and mapping.load_point_target is None:
            text = "where on the flange does the load act (x, y, z in the flange frame [mm])?"
            yield ImportQuestion(text=text, field="load_point")
        missing = [name for name in list_places(readings) if name not in mapping.flange_targets]
        if missing:
            text = f"where on the flange are the targets {', '.join(missing)} [mm]?"
            yield ImportQuestion(text=text, field="flange_targets")
    elif any(force.any() for force in (*readings.forces.values(), np.array(mapping.force or 0.0))):
        text = "there is a force, but no position is under load: which columns are?"
        yield ImportQuestion(text=text, field="tables")
    if mapping.encoders is None and (is_loaded or by_weight):
        choices = [
            _choose("motor", mapping, encoders="motor"),
            _choose("secondary", mapping, encoders="secondary"),
        ]
        text = "which encoders close the position loop: motor, or secondary behind the gearboxes?"
        yield ImportQuestion(text=text, field="encoders", choices=choices)
