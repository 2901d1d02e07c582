"""Sheets of messages: a column a component, with the unit that the schema of its field states."""

from jointstiff.schemas.fields import Message, Metres, Newtons
from jointstiff.service.tables.table import Sheet


class Part(Message):
    """A part of a row."""

    ends: Metres[tuple[tuple[float, float], tuple[float, float]]]


class Row(Message):
    """A row."""

    name: str
    force: Newtons[tuple[float, float] | None]
    part: Part | None
    notes: list[str]


ROWS = [
    Row(name="a", force=(1.0, 2.0), part=Part(ends=((0.1, 0.2), (0.3, 0.4))), notes=["one", "two"]),
    Row(name="b", force=None, part=None, notes=[]),
]
COLUMNS = {"label": "name", "force {x y}": "force", "{x y} from {low high}": "part.ends", "notes": "notes"}


def test_components_have_columns_and_units_come_from_fields():
    assert Sheet.of_fields(ROWS, COLUMNS, {"m": (1e3, "mm")}).columns == {
        "label": ["a", "b"],
        "force x [N]": [1.0, None],
        "force y [N]": [2.0, None],
        "x from low [mm]": [100.0, None],
        "x from high [mm]": [200.0, None],
        "y from low [mm]": [300.0, None],
        "y from high [mm]": [400.0, None],
        "notes": ["one; two", None],
    }
    assert "x from low [m]" in Sheet.of_fields(ROWS, COLUMNS).columns
    assert Sheet.of_fields([], COLUMNS).columns == {}
