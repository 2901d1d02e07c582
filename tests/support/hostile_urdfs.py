"""URDF documents that must be refused, and documents as large as the limits let them be."""

from support.urdf_documents import JOINT, LINKS, SMALL, changed, joint, robot_of, serial

from jointstiff.solver.mechanics.urdf import MAX_ATTRIBUTE_LENGTH, MAX_BYTES, MAX_DEPTH, MAX_ELEMENTS

BILLION_LAUGHS = (
    '<!DOCTYPE lolz [<!ENTITY lol0 "lol">'
    + "".join(f'<!ENTITY lol{i} "' + f"&lol{i - 1};" * 10 + '">' for i in range(1, 10))
    + ']><robot name="&lol9;"/>'
)
BYTES = " bytes"
HOSTILE = {
    # the document
    "empty": ("", "line 1", "no element found"),
    "blank": (" \n ", "line 2", "no element found"),
    "prose": ("hello", "document", "not XML"),
    "file name": ("robot.urdf", "document", "begins with 'robot.urdf'"),
    "json": ('{"robot": 1}', "document", "not XML"),
    "too large": ("<!--" + " " * MAX_BYTES + "-->" + SMALL, "document", BYTES),
    "too large in bytes": ("<!--" + "é" * (MAX_BYTES // 2) + "-->" + SMALL, "document", BYTES),
    "unclosed": ('<robot name="r">', "line 1", "no element found"),
    "mismatched": ("<robot>\n<link></robot>", "line 2", "mismatched tag"),
    "attribute twice": ('<robot name="r" name="s"/>', "line 1", "duplicate attribute"),
    "NUL": (SMALL.replace("><", ">\x00<", 1), "line 1", "control character"),
    "escape character": ("\n\n<robot name='\x1b[2J'/>", "line 3", "control character"),
    "reference to NUL": (changed('"j1"', '"&#0;"'), "line 1", "invalid character number"),
    "lone surrogate": (changed('"j1"', '"\ud800"'), "line 1", "surrogate"),
    "billion laughs": (BILLION_LAUGHS, "line 1", "DTD"),
    "external entity": (
        '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="&x;"/>',
        "line 1",
        "DTD",
    ),
    "external DTD": ('<!DOCTYPE r SYSTEM "http://localhost/x.dtd"><robot/>', "line 1", "DTD"),
    "parameter entity": ('<!DOCTYPE r [<!ENTITY % p "x"> %p;]><robot/>', "line 1", "DTD"),
    "undefined entity": (changed('"j1"', '"&x;"'), "line 1", "undefined entity"),
    "processing instruction": ('<?xml-stylesheet href="x.xsl"?>' + SMALL, "line 1", "processing instruction"),
    "deep": ("<robot>" + "<a>" * MAX_DEPTH, "line 1", "16 levels"),
    "many elements": (robot_of("<a/>" * MAX_ELEMENTS), "line 1", "20000 elements"),
    "many attributes": (
        "<robot " + " ".join(f"a{i}='1'" for i in range(65)) + "/>",
        "line 1",
        "64 attributes",
    ),
    "long attribute": (changed("0 0 1", "0" * (MAX_ATTRIBUTE_LENGTH + 1)), "line 1", "4096 char"),
    "long tag": (f"<{'x' * 5000}/>", "line 1", "4096 characters"),
    # one robot, expanded
    "not a robot": ("<sdf version='1.9'/>", "line 1", "<sdf>, not <robot>"),
    "namespaced robot": ("<urdf:robot xmlns:urdf='x'/>", "line 1", "not <robot>"),
    "two roots": (SMALL + "\n" + SMALL, "line 2", "second robot"),
    "two robots": (robot_of(LINKS, JOINT, "\n<robot name='s'/>"), "line 2", "second <robot>"),
    "xacro element": (robot_of("\n<xacro:macro name='m'/>"), "line 2", "unexpanded xacro"),
    "xacro attribute": (robot_of("<link xacro:x='1'/>"), "line 1", "unexpanded xacro"),
    "xacro expression": (changed("0 0 1", "0 0 ${h}"), "line 1", "unexpanded xacro"),
    "xacro substitution": (robot_of("<a b='$(find x)'/>"), "line 1", "unexpanded xacro"),
    "robot without a name": (f"<robot>{LINKS}{JOINT}</robot>", "<robot>", "missing or empty"),
    "no link": ("<robot name='r'/>", "<robot>", "no link"),
    # names
    "link without a name": (robot_of("\n<link/>"), "<link> on line 2", "missing or empty"),
    "link of empty name": (robot_of("<link name=''/>"), "<link> on line 1", "missing or empty"),
    "joint without a name": (changed(' name="j1"', ""), "<joint> on line 1", "missing or empty"),
    "links of one name": (robot_of(LINKS, LINKS), "link 'a'", "a second link"),
    "joints of one name": (robot_of(LINKS, JOINT, JOINT), "joint 'j1'", "a second joint"),
    "long name": (changed("j1", "j" * 201), "<joint> on line 1", "201 characters"),
    "newline in a name": (changed("j1", "j&#10;1"), "<joint> on line 1", "invisible"),
    "space behind a name": (changed('"j1"', '"j1 "'), "<joint> on line 1", "spaces at an end"),
    "direction override": (changed("j1", "j\u202e1"), "<joint> on line 1", "invisible"),
    # numbers
    **{
        f"number {number}": (
            changed("0 0 1", f"0 {number} 1"),
            "joint 'j1' <origin> xyz",
            "is not a finite decimal number",
        )
        for number in ("nan", "inf", "-Infinity", "0x1p3", "1_0", "1,5", "1e", "--1", "１", "1f", ".")
    },
    "overflow": (changed("0 0 1", "0 1e400 1"), "joint 'j1' <origin> xyz", "outside ±100"),
    "absurd length": (changed("0 0 1", "0 -675 1"), "joint 'j1' <origin> xyz", "outside ±100"),
    "absurd angle": (changed("0 0 0", "0 0 1e4"), "joint 'j1' <origin> rpy", "outside ±1000"),
    "two numbers": (changed("0 0 1", "0 0"), "joint 'j1' <origin> xyz", "exactly 3 numbers, has 2"),
    "four numbers": (changed("0 0 0", "0 0 0 0"), "joint 'j1' <origin> rpy", "has 4"),
    "no number": (changed("0 0 0", " "), "joint 'j1' <origin> rpy", "has 0"),
    "no-break space": (changed("0 0 0", "0\u00a00 0 0"), "joint 'j1' <origin> rpy", "decimal"),
    "limit NaN": (changed('"-1"', '"nan"'), "joint 'j1' <limit> lower", "decimal"),
    "limit overflow": (changed('"-1"', '"-1e999"'), "joint 'j1' <limit> lower", "outside"),
    "NaN off the chain": (
        robot_of(
            LINKS, JOINT, '<link name="c"/>', joint("j2", "b", "c", "prismatic", "<origin xyz='0 0 nan'/>")
        ),
        "joint 'j2' <origin> xyz",
        "decimal",
    ),
    "quaternion": (
        changed('rpy="0 0 0"', 'quat_xyzw="0 0 0 1"'),
        "joint 'j1' <origin>",
        "unknown attribute 'quat_xyzw'",
    ),
    "misspelt": (changed("rpy=", "ryp="), "joint 'j1' <origin>", "unknown attribute 'ryp'"),
    # joints
    "mimic": (changed("<limit", '<mimic joint="j0"/><limit'), "joint 'j1' <mimic>", "mimic joint between"),
    **{
        kind: (changed("revolute", kind), "joint 'j1'", f"a {kind} joint between")
        for kind in ("floating", "planar")
    },
    "unknown type": (changed("revolute", "Revolute"), "joint 'j1'", "unknown joint type 'Revolute'"),
    "no type": (changed(' type="revolute"', ""), "joint 'j1'", "unknown joint type ''"),
    "unknown type off the chain": (
        robot_of(LINKS, JOINT, '<link name="c"/>', joint("j2", "b", "c", "ball")),
        "joint 'j2'",
        "unknown joint type 'ball'",
    ),
    "zero axis": (changed('axis xyz="0 0 1"', 'axis xyz="0 0 0"'), "joint 'j1' <axis>", "zero"),
    "long axis": (changed('axis xyz="0 0 1"', 'axis xyz="0 1 1"'), "joint 'j1' <axis>", "1.41421"),
    "tiny axis": (changed('axis xyz="0 0 1"', 'axis xyz="0 0 1e-300"'), "joint 'j1' <axis>", "norm"),
    "axis NaN": (changed('axis xyz="0 0 1"', 'axis xyz="0 0 nan"'), "joint 'j1' <axis> xyz", "dec"),
    "axis without xyz": (changed('axis xyz="0 0 1"', "axis"), "joint 'j1' <axis>", "no attribute xyz"),
    "two axes": (changed("<axis", '<axis xyz="0 1 0"/><axis'), "joint 'j1' <axis>", "2 times"),
    "no limit": (changed('<limit lower="-1" upper="1"/>', ""), "joint 'j1' <limit>", "needs <limit>"),
    "empty limit": (changed(' lower="-1" upper="1"', ""), "joint 'j1' <limit>", "needs <limit>"),
    "limits exchanged": (changed('lower="-1"', 'lower="2"'), "joint 'j1' limits", "no range"),
    "no parent": (changed('<parent link="a"/>', ""), "joint 'j1' <parent>", "missing or empty"),
    "no child": (changed('<child link="b"/>', "<child/>"), "joint 'j1' <child>", "missing or empty"),
    # the tree
    "unknown child": (changed('child link="b"', 'child link="c"'), "joint 'j1' <child>", "no link 'c'"),
    "unknown parent": (changed('parent link="a"', 'parent link="c"'), "joint 'j1' <parent>", "no link 'c'"),
    "two parents": (robot_of(LINKS, JOINT, joint("j2", "a", "b")), "link 'b'", "'j1' and 'j2'"),
    "own parent": (robot_of(LINKS, JOINT, joint("j2", "a", "a")), "link 'a'", "cycle"),
    "all in a cycle": (robot_of(LINKS, JOINT, joint("j2", "b", "a")), "link 'a'", "cycle"),
    "detached cycle": (
        robot_of(
            LINKS, JOINT, '<link name="c"/><link name="d"/>', joint("j2", "c", "d"), joint("j3", "d", "c")
        ),
        "link 'c'",
        "cycle",
    ),
    "several roots": (robot_of(LINKS, JOINT, '<link name="c"/>'), "<robot>", "'a', 'c'"),
    "many links": (serial(1_001), "<robot>", "1002 links"),
    "many joints": (robot_of(LINKS, JOINT * 1_001), "<robot>", "1001 joints"),
    # the chain
    "a thousand moving joints": (serial(1_000), "chain", "1000 moving joints"),
    "33 moving joints": (serial(33), "chain", "33 moving joints"),
    "only fixed joints": (changed("revolute", "fixed"), "chain", "fixed-only chain"),
}


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
