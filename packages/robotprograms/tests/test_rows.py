"""Programs of rows of numbers: the same as those of a table with the same numbers."""

import numpy as np

from robotprograms import Notation, Orientation, Program, read_program

HEADER = "x [mm],y [mm],z [mm],rx [deg],ry [deg],rz [deg]"
ROWS = np.array([[1700.25, -12.5, 900.0, 0.5, 180.0, 1.0], [1710.25, -12.5, 900.0, 0.5, 179.0, 1.0]])


def test_rows_are_the_program_of_a_table_with_the_same_numbers():
    table = "\n".join([HEADER, *(",".join(map(repr, row)) for row in ROWS.tolist())])
    read = read_program([("path.csv", table.encode())])
    notation = read.targets.notations[0]
    made = Program.from_rows("path.csv", ROWS, notation)
    assert (made.format, made.left_moves, made.faults) == (read.format, (), ())
    assert made.sources[0].name == read.sources[0].name
    for name in ("source", "line", "literal", "base", "tool", "values"):
        np.testing.assert_array_equal(getattr(made.targets, name), getattr(read.targets, name), name)
        assert getattr(made.targets, name).dtype == getattr(read.targets, name).dtype, name
    assert list(made.targets.names) == list(read.targets.names)
    assert [each.notation for each in made.targets.literals] == [notation]
    frames = [[(each.name, each.pose) for each in program.targets.frames] for program in (made, read)]
    assert frames[0] == frames[1]
    for name in ("line", "motion", "ends", "visits", "feed"):
        np.testing.assert_array_equal(getattr(made.moves, name), getattr(read.moves, name), name)


def test_rows_may_be_quaternions():
    notation = Notation(Orientation.QUATERNION, 1.0)
    made = Program.from_rows("path", np.array([[1.7, 0.0, 0.9, 1.0, 0.0, 0.0, 0.0]]), notation)
    numbers = made.targets.values[0, : 3 + notation.count]
    assert made.targets.notations == (notation,)
    assert notation.to_pose(numbers)[:3, 3].tolist() == [1.7, 0.0, 0.9]
