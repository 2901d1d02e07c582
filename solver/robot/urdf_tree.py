"""The links of a URDF as a tree, and the way through it from the base to the flange.

Only names here: no numbers, no XML.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from jointstiff.solver.errors import RobotError

__all__ = ["TreeJoint", "path_down"]

_SHOWN = 8  # names listed in a message


@dataclass(frozen=True)
class TreeJoint:
    """A joint as an edge of the tree: its name and the links that it joins."""

    name: str
    parent: str
    child: str


def path_down(
    links: Collection[str], joints: Collection[TreeJoint], base: str, flange: str
) -> tuple[TreeJoint, ...]:
    """Find the joints from the base down to the flange.

    Args:
        links: names of all links, each once.
        joints: all joints, each name once.
        base: link to start from; it need not be the root.
        flange: link to end at.

    Returns:
        The joints in order, at least one.

    Raises:
        RobotError: links and joints are not one tree, base or flange is not among them, or the
            flange is not below the base.
    """
    above = _joint_above(links, joints)
    _check_one_tree(links, above)
    for link, role in ((base, "base"), (flange, "flange")):
        if link not in links:
            raise RobotError(
                f"there is no link {link[:60]!a} to be the {role} frame",
                remedy=f"choose one of the links {_listed(links)}",
                where=role,
            )
    if base == flange:
        raise RobotError(
            f"base and flange are the same link, '{base}'",
            remedy="choose a flange with revolute joints between the base and it",
            where="flange",
        )
    return _walk_up(above, base, flange)


def _joint_above(links: Collection[str], joints: Iterable[TreeJoint]) -> dict[str, TreeJoint]:
    """Map each link that has a parent to the joint that carries it."""
    above: dict[str, TreeJoint] = {}
    for joint in joints:
        for link, role in ((joint.parent, "parent"), (joint.child, "child")):
            if link not in links:
                raise RobotError(
                    f"there is no link '{link[:60]}'",
                    remedy=f"name one of the links {_listed(links)}",
                    where=f"joint '{joint.name}' <{role}>",
                )
        if joint.child in above:
            raise RobotError(
                f"two parents, by joints '{above[joint.child].name}' and '{joint.name}'",
                remedy="a URDF is a tree: keep one of them",
                where=f"link '{joint.child}'",
            )
        above[joint.child] = joint
    return above


def _check_one_tree(links: Collection[str], above: Mapping[str, TreeJoint]) -> None:
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        raise RobotError(
            f"{len(roots)} links have no parent: {_listed(roots)}",
            remedy="join all links into one tree with one root",
            where="<robot>",
        )
    rooted = set(roots)
    for link in links:
        rooted.update(_climb(link, above, rooted))
    if cycle := [link for link in links if link not in rooted]:
        raise RobotError(
            f"links hang in a cycle, not from the root: {_listed(cycle)}",
            remedy="a URDF is a tree: give one of them another parent",
            where=f"link '{cycle[0]}'",
        )


def _climb(link: str, above: Mapping[str, TreeJoint], rooted: Collection[str]) -> set[str]:
    """Return the links from this one up to a rooted one; none if the way up never gets there."""
    passed: set[str] = set()
    while link not in rooted:
        if link in passed:
            return set()
        passed.add(link)
        link = above[link].parent
    return passed


def _walk_up(above: Mapping[str, TreeJoint], base: str, flange: str) -> tuple[TreeJoint, ...]:
    path: list[TreeJoint] = []
    link = flange
    while link != base:
        if link not in above:
            raise RobotError(
                f"the flange '{flange}' is not below the base '{base}'",
                remedy="choose a base on the way from the root to the flange",
                where="flange",
            )
        path.append(above[link])
        link = above[link].parent
    return tuple(reversed(path))


def _listed(names: Iterable[str]) -> str:
    shown = [f"'{name[:40]}'" for name in names]
    return ", ".join(shown[:_SHOWN]) + (f" and {len(shown) - _SHOWN} more" if len(shown) > _SHOWN else "")
