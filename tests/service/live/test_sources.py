"""Sources of readings: what is none, and one of a class of one's own."""

from types import SimpleNamespace

import pytest

import jointstiff as js
from jointstiff.service.live import sources
from jointstiff.service.live.sources import SourceError, source_of
from jointstiff.simulator import LOAD_POINT, TARGETS, default_arm, simulate_campaign
from jointstiff.solver.errors import RequestError

LINES = "write lines:/dev/ttyUSB0, lines:tcp://host:port or lines:udp://:port"


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        (
            "radar:1",
            {},
            "source: there is no source 'radar'; give one of lines, robodk, simulated, such as simulated:1",
        ),
        ("simulated:x", {}, "source: 'x' is no seed of a simulated arm; write simulated:1"),
        (
            "simulated:1",
            {"columns": "x,y,z"},
            "source: the source 'simulated' takes no `columns`; omit `columns`",
        ),
        ("lines:", {}, f"source: '' is no address of lines; {LINES}"),
        ("lines:tcp://nowhere", {}, f"source: 'tcp://nowhere' is no address of lines; {LINES}"),
        (
            "lines:udp://:4000",
            {"request": "READ"},
            "request: UDP is only listened to; omit `request`, or use TCP",
        ),
        (
            "lines:/dev/ttyS9",
            {"columns": "x,y"},
            "columns: the columns 'x,y' do not name x, y and z, each once; name them in order, such as "
            "target,x,y,z or -,x,y,z,sigma",
        ),
        (
            "lines:/dev/ttyS9",
            {"pattern": "(?P<x>.*"},
            "pattern: the pattern is no regular expression: missing ), unterminated subpattern at position "
            "0; "
            "correct it",
        ),
        (
            "lines:/dev/ttyS9",
            {"source_unit": "ell"},
            "source_unit: 'ell' is no unit of length; give one of mm, m, um, in",
        ),
    ],
)
def test_what_is_no_source_is_refused_with_what_is(text, options, said):
    with pytest.raises(RequestError) as refused:
        source_of(text, options)
    assert str(refused.value) == said


def test_an_arm_of_the_catalogue_is_measured_with_a_load_and_targets():
    arm = "KUKA KR 210 R2700 extra"
    with pytest.raises(
        js.CampaignError, match="the positions of the targets are missing; remedy: give `targets`"
    ):
        js.measure(arm, goal="15 %")
    load = {"load": "dead_weight:1500", "targets": TARGETS, "load_point": LOAD_POINT, "sigma": 2e-5}
    with js.measure(arm, "15 %", "simulated:2", **load) as live:
        state = live.run_source(most=3)
    assert (state.state, live.count) == ("measuring", 3)


def test_a_source_is_a_class_with_one_method_that_an_entry_point_names(monkeypatch):
    opened = []

    class Still:
        def __init__(self, address):
            opened.append(address)

        async def point(self, _):
            return (1.0, 2.0, float("nan")), None

    entry = SimpleNamespace(name="still", load=lambda: Still)
    monkeypatch.setattr(
        sources, "entry_points", lambda group: [entry] if group == "jointstiff.sources" else []
    )
    document = simulate_campaign(default_arm(), load="dead_weight", configurations=8, seed=1)
    with js.measure(document, "15 %", "still:here") as live, pytest.raises(SourceError) as refused:
        live.run_source()
    assert opened == ["here"]
    assert str(refused.value) == (
        "P10: (1, 2, nan) m is no position of a target: look at the unit and the columns of the source"
    )
