"""Files of the study of meanings that were once read wrong: columns of a target in two states, mixed up."""

import pytest

from benchmarks.studies.layouts import (
    inches,
    points_first,
    rounded,
    sentinels,
    simulate,
    wide_mm,
    wide_rad_m,
    with_forces,
)
from benchmarks.studies.meanings import judge
from jointstiff.service.resources.known_robots import catalogue_robots
from jointstiff.solver.meaning.proposal import propose
from jointstiff.solver.meaning.table import Table

READ_WRONG = [
    ("Yaskawa GP25", 7000, sentinels),
    ("ABB IRB 6640-185/2.8", 7001, wide_rad_m),
    *(("Yaskawa GP180", 7002, layout) for layout in (wide_mm, inches, points_first, rounded, with_forces)),
]


@pytest.mark.parametrize(("arm", "seed", "make"), READ_WRONG)
def test_x_y_and_z_are_never_taken_from_two_states_of_a_target(arm, seed, make):
    known = next(each for each in catalogue_robots() if each.name == arm)
    layout = make(simulate(arm, seed))
    tables = [Table(name, numbers) for name, numbers in layout.tables.items()]
    assert judge(layout, propose(tables, known.robot), known) in ("right", "asks")


@pytest.mark.parametrize(("arm", "seed"), [("ABB IRB 6640-185/2.8", 91_001), ("Yaskawa GP180", 171_000)])
def test_positions_in_a_smaller_unit_are_no_rival(arm, seed):
    """Numbers of m that are taken as inches have small distances, because the targets hardly move."""
    known = next(each for each in catalogue_robots() if each.name == arm)
    layout = wide_rad_m(simulate(arm, seed))
    (table,) = layout.tables.values()
    best = propose([Table("a", table)], known.robot).best
    assert best is not None
    assert (best.unit, best.joints.columns) == ("m", layout.columns)
