"""Links of a URDF that may be base and flange of the arm, and those that belong to a gripper."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

from jointstiff.solver.errors import RobotError
from jointstiff.solver.mechanics.urdf import XmlElement, check_root, parse_xml, refuse_unknown_link

_TURNING: Final = frozenset(("revolute", "continuous"))
_MOVING: Final = _TURNING | {"prismatic"}
_JOINTS_OF_ARM: Final = 4
"""Number of turning joints of an arm behind which a sliding joint is that of a finger; a SCARA has three."""
_NAMES_OF_FLANGES: Final = ("tool0", "flange")
"""Names of the flange's link, as makers and ROS-Industrial give them; the first is preferred."""
_MAX_NAMED: Final = 8


class SeveralLinksError(RobotError):
    """Several links of a URDF may be its flange, or the only one belongs to a gripper; `link` is likely."""

    def __init__(self, reason: str, link: str) -> None:
        super().__init__(
            reason,
            where="flange",
            remedy=f"name the link of the flange behind the name of the file: FILE.urdf#{link}; in a robot "
            f'file and over HTTP, state "flange": "{link}"; do not remove links',
        )
        self.link = link  # the likely flange


def convert_urdf(text: str, base: str | None, flange: str | None) -> dict[str, Any]:
    """Convert the text of a URDF to the model of a robot document.

    Without `base`, the root link is the base; without `flange`, the only tip link is the flange.

    Raises:
        RobotError: the text is not a URDF, a link does not exist, several may be the base or the flange, or
            the only tip belongs to a gripper.
    """
    document = parse_xml(text)
    check_root(document)
    for link, role in ((base, "base"), (flange, "flange")):
        if link is not None:
            names = [each.attributes.get("name", "") for each in document.find_children("link")]
            refuse_unknown_link(names, link, role)
    root = find_base(document) if base is None else base
    tip = find_flange(document) if flange is None else flange
    return {"format": "urdf", "urdf": text, "base": root, "flange": tip}


def find_flange(document: XmlElement) -> str:
    """Return the only link of a URDF that may be its flange: its only tip, unless a gripper has the tip.

    Raises:
        RobotError: there is no such link, or several; the error names the link where the branches part.
    """
    tree = _LinkTree.read(document)
    tips = [link for link in tree.links if link not in tree.parents]
    if not tips:
        raise RobotError(
            "each link of the URDF carries another link",
            where="flange",
            remedy="a URDF is a tree: give the last joint a child that carries no joint",
        )
    flange = tree.find_likely_flange(tips)
    if len(tips) > 1:
        names = ", ".join(tips[:_MAX_NAMED])
        where = f"'{flange}' is likely the flange"
        if flange == tree.find_parting(tips):
            where = f"the branches part at '{flange}'"
        raise SeveralLinksError(
            f"the URDF ends in {len(tips)} links, so that the flange is not certain: {names}; {where}", flange
        )
    finger = tree.find_finger_joint(tips[0])
    if finger is not None:
        raise SeveralLinksError(
            f"the URDF ends in a gripper: its joint '{finger}', which moves '{tips[0]}', is no joint of "
            f"the arm; '{flange}' is likely the flange",
            flange,
        )
    return tips[0]


def find_base(document: XmlElement) -> str:
    """Return the only link of a URDF that no joint moves.

    Raises:
        RobotError: there is no such link, or several.
    """
    tree = _LinkTree.read(document)
    roots = [link for link in tree.links if link not in tree.above]
    if len(roots) != 1:
        raise RobotError(
            f"the URDF has {len(roots)} links that may be the base: {', '.join(roots[:_MAX_NAMED])}",
            where="base",
            remedy="join the links into one tree: each link but the base is the child of one joint",
        )
    return roots[0]


@dataclass(frozen=True)
class _Joint:
    """Joint of a URDF."""

    name: str
    kind: str  # of the standard, such as `revolute`
    parent: str  # name of a link
    mimics: bool  # whether it follows another joint


@dataclass(frozen=True)
class _LinkTree:
    """Links of a URDF, and the joint above each; the URDF may have any faults."""

    links: Sequence[str]
    above: Mapping[str, _Joint]  # by the name of the link that the joint carries

    @classmethod
    def read(cls, document: XmlElement) -> _LinkTree:
        """Read the names of links and joints."""
        above = dict[str, _Joint]()
        for joint in document.find_children("joint"):
            parent, child = (joint.find_only_child(role, "joint") for role in ("parent", "child"))
            if parent is not None and child is not None:
                above[child.attributes.get("link", "")] = _Joint(
                    name=joint.attributes.get("name", ""),
                    kind=joint.attributes.get("type", ""),
                    parent=parent.attributes.get("link", ""),
                    mimics=bool(joint.find_children("mimic")),
                )
        return cls([link.attributes.get("name", "") for link in document.find_children("link")], above)

    @cached_property
    def parents(self) -> set[str]:
        """Links that carry a joint."""
        return {joint.parent for joint in self.above.values()}

    def find_likely_flange(self, tips: Sequence[str]) -> str:
        """Return the link that is likely the flange: by its name, or where the branches of the arm part."""
        ends = [self._cut_gripper(tip) for tip in tips]
        most = max(self._count_moving(end) for end in ends)
        ends_of_arm = [end for end in ends if self._count_moving(end) == most]
        parting = self.find_parting(ends_of_arm)
        at_end = [
            link
            for link in self.links
            if self._count_moving(link) == self._count_moving(parting) and self._cut_gripper(link) == link
        ]
        for name in _NAMES_OF_FLANGES:
            for link in at_end:
                if link.lower() == name or link.lower().endswith(f"_{name}"):
                    return link
        return parting

    def find_parting(self, links: Sequence[str]) -> str:
        """Return the last link that carries all of some links, or is one of them."""
        ways = [list(self._climb(link))[::-1] for link in links]
        common = ways[0][0]
        for steps in zip(*ways, strict=False):
            if len(set(steps)) > 1:
                break
            common = steps[0]
        return common

    def find_finger_joint(self, tip: str) -> str | None:
        """Return the name of the last moving joint above a tip if it is that of a finger; None otherwise."""
        for link in self._climb(tip):
            joint = self.above.get(link)
            if joint is not None and (joint.mimics or joint.kind in _MOVING):
                turning = sum(1 for each in self._list_joints(joint.parent) if each.kind in _TURNING)
                slides = joint.kind == "prismatic" and turning >= _JOINTS_OF_ARM
                return joint.name if joint.mimics or slides else None
        return None

    def _cut_gripper(self, tip: str) -> str:
        """Return the link that carries the joints of fingers above a tip; the tip itself without fingers."""
        while (finger := self.find_finger_joint(tip)) is not None:
            tip = next(each.parent for each in self._list_joints(tip) if each.name == finger)
        return tip

    def _count_moving(self, link: str) -> int:
        """Return the number of moving joints above a link."""
        return sum(1 for joint in self._list_joints(link) if joint.kind in _MOVING)

    def _list_joints(self, link: str) -> list[_Joint]:
        """Return the joints above a link, the nearest first."""
        return [self.above[each] for each in self._climb(link) if each in self.above]

    def _climb(self, link: str) -> Iterator[str]:
        """Yield a link and the links that carry it, up to the root; a cycle ends where it closes."""
        passed = set[str]()
        while link not in passed:
            passed.add(link)
            yield link
            if link not in self.above:
                return
            link = self.above[link].parent
