"""URDF documents that must be refused, and documents as large as the limits let them be."""

import json
from pathlib import Path

from jointstiff.solver.mechanics.urdf import MAX_ATTRIBUTE_LENGTH, MAX_BYTES, MAX_DEPTH, MAX_ELEMENTS

FOLDER = Path(__file__).parent
BRANCHED = (FOLDER / "branched.urdf").read_text(encoding="utf-8")
"""A world above the base, origins with three angles, a fixed joint within, a continuous joint, an axis that
is not quite a unit vector, a flange with a gripper that mimics."""
JOINT = (
    '<joint name="j1" type="revolute"><parent link="a"/><child link="b"/>'
    '<origin xyz="0 0 1" rpy="0 0 0"/><axis xyz="0 0 1"/><limit lower="-1" upper="1"/></joint>'
)
LINKS = '<link name="a"/><link name="b"/>'
SMALL = f'<robot name="r">{LINKS}{JOINT}</robot>'
ATTRIBUTES = "<robot " + " ".join(f"a{i}='1'" for i in range(65)) + "/>"
PARTS = {"SMALL": SMALL, "LINKS": LINKS, "JOINT": JOINT}


def robot_of(*content: str) -> str:
    return f'<robot name="r">{"".join(content)}</robot>'


def joint(name: str, parent: str, child: str) -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 1"/>'
    return f'<joint name="{name}" type="revolute">{ends}<limit lower="-1" upper="1"/></joint>'


def serial(count: int) -> str:
    names = ["a", *(f"l{i}" for i in range(1, count)), "b"]
    links = [f'<link name="{name}"/>' for name in names[1:-1]]
    return robot_of(LINKS, *links, *(joint(f"j{i}", *names[i : i + 2]) for i in range(count)))


def document_of(stated: str | dict[str, str]) -> str:
    """Return a document by its parts' names, or the small robot with one thing changed."""
    text = SMALL if isinstance(stated, dict) else stated
    changes = stated if isinstance(stated, dict) else PARTS
    for old, new in changes.items():
        assert changes is PARTS or old in text
        text = text.replace(old, new)
    return text


BILLION_LAUGHS = (
    '<!DOCTYPE lolz [<!ENTITY lol0 "lol">'
    + "".join(f'<!ENTITY lol{i} "' + f"&lol{i - 1};" * 10 + '">' for i in range(1, 10))
    + ']><robot name="&lol9;"/>'
)
STATED = json.loads((FOLDER / "hostile_urdfs.json").read_text(encoding="utf-8"))
HOSTILE = {name: (document_of(text), where, reason) for name, (text, where, reason) in STATED.items()} | {
    "too large": ("<!--" + " " * MAX_BYTES + "-->" + SMALL, "document", " bytes"),
    "too large in bytes": ("<!--" + "é" * (MAX_BYTES // 2) + "-->" + SMALL, "document", " bytes"),
    "billion laughs": (BILLION_LAUGHS, "line 1", "DTD"),
    "deep": ("<robot>" + "<a>" * MAX_DEPTH, "line 1", "16 levels"),
    "many elements": (robot_of("<a/>" * MAX_ELEMENTS), "line 1", "20000 elements"),
    "many attributes": (
        ATTRIBUTES,
        "line 1",
        "64 attributes",
    ),
    "long attribute": (SMALL.replace("0 0 1", "0" * (MAX_ATTRIBUTE_LENGTH + 1)), "line 1", "4096 char"),
    "long tag": (f"<{'x' * 5000}/>", "line 1", "4096 characters"),
    "long name": (SMALL.replace("j1", "j" * 201), "<joint> on line 1", "201 characters"),
    "many links": (serial(1_001), "<robot>", "1002 links"),
    "many joints": (robot_of(LINKS, JOINT * 1_001), "<robot>", "1001 joints"),
    "a thousand moving joints": (serial(1_000), "chain", "1000 moving joints"),
    "33 moving joints": (serial(33), "chain", "33 moving joints"),
}
"""Documents with the place and the reason of their refusals."""


def _filled(head: str, unit: str, tail: str) -> str:
    """Repeat the unit until the document is as large as it may be."""
    return head + unit * ((MAX_BYTES - len(head) - len(tail)) // len(unit)) + tail


def _counted(unit: str, most: int) -> str:
    """Number the units, until they are as long as they may be."""
    count = most // len(unit % 1_000_000)
    return "".join(unit % number for number in range(count))


ROOM = MAX_BYTES - 10_000
LARGE = {
    "quadratic blowup": _filled(
        '<!DOCTYPE r [<!ENTITY a "' + "a" * 100_000 + '">]><robot name="', "&a;", '"/>'
    ),
    "entity declarations": "<!DOCTYPE r [" + _counted('<!ENTITY e%07d "x">', ROOM) + "]><robot/>",
    "attributes of one element": "<robot " + _counted("a%07d='' ", ROOM) + "/>",
    "names of elements": robot_of(_counted("<a%07d/>", ROOM)),
    "elements with attributes": robot_of(("<a " + _counted("b%07d='' ", 150) + "/>") * 13_000),
    "values of attributes": robot_of(("<a " + _counted("b%07d='" + "é" * 2_000 + "' ", 250_000) + "/>") * 4),
    "opening tags": _filled("<robot>", "<a>", ""),
    "opening brackets": _filled("", "<", ""),
    "opening quotation": _filled('<robot name="', "a", ""),
    "text": _filled("<robot name='r'>", "text ", "</robot>"),
    "comments": _filled("<robot name='r'>", "<!---->", "</robot>"),
    "one comment": _filled("<robot name='r'><!--", " ", "--></robot>"),
    "character data": _filled("<robot name='r'><![CDATA[", "]", "]]></robot>"),
    "character references": _filled("<robot name='", "&#65;", "'/>"),
    "lines": _filled("<robot name='r'>", "\n", "</robot>"),
    "ampersands": _filled("<robot name='r'>", "&amp;", "</robot>"),
    "numbers": robot_of(
        LINKS, JOINT, "<joint name='n' type='fixed'><origin xyz='" + "9" * 4_000 + "'/></joint>"
    ),
    "cycle": robot_of(
        *(f'<link name="c{i}"/>' + joint(f"k{i}", f"c{i}", f"c{(i + 1) % 999}") for i in range(999)),
        LINKS,
        JOINT,
    ),
    "unknown links": robot_of(
        *(f'<link name="{i:0200d}"/>' for i in range(1_000)),
        *(joint(f"k{i}", "x" * 200, "y") for i in range(999)),
    ),
}
