"""Digital calibration certificates: their quantities are a table; hostile XML is refused.

The certificates are made up; they follow the elements of PTB's schema 3 and of D-SI 2.
"""

import random

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on
from support.importing_samples import CAMPAIGN, CAMPAIGN_NUMBERS, points_of, read, values_of

import jointstiff as js
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.formats.certificates import read_certificate

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=4, configurations=12)
UNITS = {"deg": r"\degree", "mm": r"\milli\metre", "m": r"\metre", "N": r"\newton", "rad": r"\radian"}
HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<!-- made up -->\n<dcc:digitalCalibrationCertificate '
    'xmlns:dcc="https://ptb.de/dcc" xmlns:si="https://ptb.de/si" schemaVersion="3.2.1">\n'
)
TAIL = "</dcc:digitalCalibrationCertificate>\n"


def named(tag, name, content):
    names = f'<dcc:name><dcc:content lang="en">{name}</dcc:content></dcc:name>' if name else ""
    return f"<dcc:{tag}>{names}{content}</dcc:{tag}>\n"


def listed(name, unit, values):
    texts = " ".join(values)
    if unit is None:
        return named("quantity", name, f"<dcc:charsXMLList>{texts}</dcc:charsXMLList>")
    uncertainty = (
        "<si:expandedUncXMLList><si:uncertaintyXMLList>0.02</si:uncertaintyXMLList></si:expandedUncXMLList>"
    )
    values_and_unit = (
        f"<si:valueXMLList>{texts}</si:valueXMLList>\n<si:unitXMLList>{UNITS[unit]}</si:unitXMLList>"
    )
    parts = f"{values_and_unit}{uncertainty}"
    return named("quantity", name, f"<si:realListXMLList>{parts}</si:realListXMLList>")


def single(name, unit, value):
    real = f"<si:real><si:value>{value}</si:value><si:unit>{UNITS[unit]}</si:unit></si:real>"
    return named("quantity", name, real)


def result(name, *lists):
    return named("result", name, f"<dcc:data>{''.join(lists)}</dcc:data>")


def certificate(*results):
    body = "".join(results)
    return f"{HEAD}<dcc:measurementResults><dcc:measurementResult><dcc:results>{body}</dcc:results>\
</dcc:measurementResult></dcc:measurementResults>\n{TAIL}"


HEADER, *ROWS = [line.split(";") for line in CAMPAIGN.splitlines()[1:]]
COLUMNS = [
    (name.split(" [")[0], name.partition(" [")[2].strip("]") or None, [row[i] for row in ROWS])
    for i, name in enumerate(HEADER)
]
LISTS = certificate(result("readings", named("list", "", "".join(listed(*column) for column in COLUMNS))))
SINGLES = certificate(
    *(
        result("posture", named("list", row[0], "".join(
            single(name, unit, row[i]) for i, (name, unit, _) in enumerate(COLUMNS) if unit
        )))
        for row in ROWS
    )
)  # fmt: skip


def columns_of(prefix, unit, numbers):
    return "".join(
        listed(f"{prefix}{name}", unit, [f"{value:.7f}" for value in column])
        for name, column in zip("xyz" if numbers.shape[1] == 3 else "abcdef", numbers.T.tolist(), strict=True)
    )


def test_lists_of_values_are_columns():
    imported = read(("c.xml", LISTS))
    assert values_of(imported) == values_of(read(("c.csv", CAMPAIGN)))
    assert points_of(imported) == points_of(read(("c.csv", CAMPAIGN)))
    assert len(values_of(imported)) == 2 * len(CAMPAIGN_NUMBERS)


def test_lists_of_single_values_are_rows():
    header, first, *_ = read_certificate("c.xml", SINGLES.encode())[0].rows
    assert header.cells == ("name", *HEADER[1:])
    assert first.cells == tuple(ROWS[0])


def test_the_proposal_alone_leads_from_a_certificate_to_a_set(tmp_path):
    unloaded = READINGS.position[:, 0]
    loaded = unloaded - [0.0, 0.0, 4e-4]
    path = tmp_path / "certificate.xml"
    path.write_text(
        certificate(
            result("angles", named("list", "", columns_of("axis ", "rad", READINGS.joints))),
            result("before", named("list", "", columns_of("", "m", unloaded))),
            result("after", named("list", "", columns_of("", "m", loaded))),
        )
    )
    stated = {"encoders": "motor", "load_point": [0, 0, 0.1], "force": [0, 0, -100], "units": {"force": "N"}}
    proposal = js.read(path, robot=ARM, **stated)
    assert "as J1…J6 [rad]" in str(proposal)
    assert "in 24 of 24 positions" in str(proposal)
    assert len(proposal.accept().campaign.measurement_set.observations) == 12


def test_of_a_quantity_in_two_units_the_first_is_read():
    both = LISTS.replace("<si:realListXMLList>", "<si:hybrid><si:realListXMLList>").replace(
        "</si:realListXMLList>",
        "</si:realListXMLList><si:realListXMLList><si:valueXMLList>1 1 1</si:valueXMLList>"
        r"<si:unitXMLList>\inch</si:unitXMLList></si:realListXMLList></si:hybrid>",
    )
    assert values_of(read(("c.xml", both))) == values_of(read(("c.xml", LISTS)))


DTD = HEAD.replace("<!-- made up -->", '<!DOCTYPE a [<!ENTITY b "1">]>')


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (f"{DTD}{TAIL}", "document type"),
        (f"{HEAD}<a>", "not well-formed"),
        (f"{HEAD}&b;{TAIL}", "not well-formed"),
        (f"{HEAD}{'<a>' * 80}{'</a>' * 80}{TAIL}", "80|64 levels"),
        (f"{HEAD}{TAIL}", "no list of 3 values"),
        (HEAD.replace("dcc:digital", "dcc:other") + "</dcc:otherCalibrationCertificate>", "no calibration"),
        (LISTS.replace("10.5 -15 0.5", "10.5 -15 0.5 7"), "have 3 and 4 values"),
        (LISTS.replace(r">\degree<", r">\degree \radian \degree<", 1), "several units"),
        (LISTS.replace("10.5 -15 0.5", "10.5-15 0.5"), "have 2 and 3 values"),
        (LISTS.replace(">J2<", ">J1<"), "two quantities have the name"),
        (SINGLES.replace(r"\newton", r"\kilo\newton", 1), "several units"),
        (LISTS.replace(">c01 ", f">{'c' * 300} "), "256 characters"),
    ],
)
def test_a_certificate_that_is_damaged_or_hostile_is_refused(content, words):
    with pytest.raises(ImportFileError, match=words) as refused:
        read_certificate("c.xml", content.encode())
    assert refused.value.place.file == "c.xml"
    assert refused.value.remedy


def test_too_many_elements_are_refused():
    content = f"{HEAD}{'<a/>' * 400_001}{TAIL}".encode()
    with pytest.raises(ImportFileError, match="400000 elements"):
        read_certificate("c.xml", content)


def test_a_certificate_of_which_a_sign_is_lost_is_refused_or_differs_in_one_number():
    random_ = random.Random(1)  # noqa: S311
    whole = values_of(read(("c.xml", LISTS))) | points_of(read(("c.xml", LISTS)))
    refused = 0
    for _ in range(400):
        at = random_.randrange(len(HEAD), len(LISTS))
        try:
            imported = read(("c.xml", LISTS[:at] + LISTS[at + 1 :]))
        except ImportFileError:
            refused += 1
            continue
        found = values_of(imported) | points_of(imported)
        common = found.keys() & whole.keys()
        changed = [key for key in common if not np.array_equal(found[key], whole[key])]
        assert len(changed) <= 1
    assert refused > 100
