"""Relations are followed to their end, each node once; what nothing reads leaves the states."""

from robotprograms import list_moves
from robotprograms.reaching import reach

RELATION = {"a": ["b", "c"], "b": ["a", "d"], "c": ["d"], "d": ["d"], "e": ["a"]}


def follow(*starts, known=()):
    return list(reach(starts, lambda node: RELATION.get(node, []), {*known}))


def test_each_node_is_reached_once_with_the_node_before_it():
    found = follow("a", known=["a"])
    assert sorted(node for _, node in found) == ["b", "c", "d"]
    assert all(node in RELATION[before] for before, node in found)


def test_known_nodes_are_passed_over():
    assert follow("b", known=["a", "b"]) == [("b", "d")]
    assert follow("x") == []


POINT = "[[{},0,500],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"


def read(*lines):
    text = "\n".join(["MODULE m", *lines, "ENDMODULE"])
    return [(each.line, each.corrected) for each in list_moves([("m.mod", text.encode())])]


def test_a_point_that_another_routine_assigns_is_known_behind_its_call():
    """The point is read in the caller alone, so that it has to leave the routine."""
    found = read(
        "PROC main()", "r;", "MoveL p,v1,z1,tool0;", "ENDPROC",
        "PROC r()", f"p:={POINT.format(500)};", "ENDPROC",
    )  # fmt: skip
    assert found == [(4, True)]


def test_a_point_that_changes_in_a_routine_between_is_not_known_as_before():
    point = f"p:={POINT.format(500)};"
    kept = read("PROC main()", point, "r;", "MoveL p,v1,z1,tool0;", "ENDPROC", "PROC r()", "n:=1;", "ENDPROC")
    changed = read(
        "PROC main()", point, "r;", "MoveL p,v1,z1,tool0;", "ENDPROC",
        "PROC r()", "IF n=1 THEN", f"p:={POINT.format(600)};", "ENDIF", "ENDPROC",
    )  # fmt: skip
    assert (kept, changed) == ([(5, True)], [(5, False)])


def test_a_point_that_the_next_round_of_a_loop_reads_stays_in_the_state():
    found = read(
        "PROC main()", "WHILE n<3 DO", "MoveL p,v1,z1,tool0;", f"p:={POINT.format(500)};", "ENDWHILE",
        "ENDPROC",
    )  # fmt: skip
    assert found == [(4, False)]
