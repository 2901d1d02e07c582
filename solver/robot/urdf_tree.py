"""Find the way from the base to the flange through the links of a URDF: names only."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple

from jointstiff.solver.errors import RobotError

_SHOWN = 8  # names listed in a message


class Edge(NamedTuple):
    """A joint as an edge of the tree: its name and the links that it joins."""

    joint: str
    parent: str
    child: str


def path_down(links: Collection[str], edges: Iterable[Edge], base: str, flange: str) -> list[str]:
    """Return the names of the joints from the base down to the flange, at least one.

    Args:
        links: names of all links, each once.
        edges: all joints, each once.
        base: link to start from; it need not be the root.
        flange: link to end at.

    Raises:
        RobotError: links and joints are not one tree, base or flange is not among them, or the
            flange is not below the base.
    """
    above = _edge_above(links, edges)
    _check_one_tree(links, above)
    for link, role in ((base, "base"), (flange, "flange")):
        if link not in links:
            raise RobotError(
                f"there is no link {link[:60]!a} for the {role} frame",
                remedy=f"use one of the links {_listed(links)}",
                where=role,
            )
    if base == flange:
        raise RobotError(
            f"base and flange are the same link, '{base}'",
            remedy="choose a flange with revolute joints between the base and it",
            where="flange",
        )
    path = []
    link = flange
    while link != base:
        if link not in above:
            raise RobotError(
                f"the flange '{flange}' is not below the base '{base}'",
                remedy="choose a base on the way from the root to the flange",
                where="flange",
            )
        path.append(above[link].joint)
        link = above[link].parent
    return path[::-1]


def _edge_above(links: Collection[str], edges: Iterable[Edge]) -> dict[str, Edge]:
    """Map each link that has a parent to the joint that carries it."""
    above: dict[str, Edge] = {}
    for edge in edges:
        for link, role in ((edge.parent, "parent"), (edge.child, "child")):
            if link not in links:
                raise RobotError(
                    f"there is no link '{link[:60]}'",
                    remedy=f"use one of the links {_listed(links)}",
                    where=f"joint '{edge.joint}' <{role}>",
                )
        if edge.child in above:
            raise RobotError(
                f"the link has two parents, by joints '{above[edge.child].joint}' and '{edge.joint}'",
                remedy="a URDF is a tree: keep one of them",
                where=f"link '{edge.child}'",
            )
        above[edge.child] = edge
    return above


def _check_one_tree(links: Collection[str], above: Mapping[str, Edge]) -> None:
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        raise RobotError(
            f"{len(roots)} links have no parent: {_listed(roots)}",
            remedy="join all links into one tree with one root",
            where="<robot>",
        )
    below = defaultdict(list)
    for edge in above.values():
        below[edge.parent].append(edge.child)
    reached = roots
    for link in reached:  # grows on the way
        reached.extend(below[link])
    rooted = set(reached)
    if cycle := [link for link in links if link not in rooted]:
        raise RobotError(
            f"links hang in a cycle, not from the root: {_listed(cycle)}",
            remedy="a URDF is a tree: give one of them another parent",
            where=f"link '{cycle[0]}'",
        )


def _listed(names: Collection[str]) -> str:
    shown = ", ".join(f"'{name[:40]}'" for name in list(names)[:_SHOWN])
    return shown + (f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")
