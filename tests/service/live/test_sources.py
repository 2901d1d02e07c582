"""Sources of readings: what is none, and one of a class of one's own."""

import json
from types import SimpleNamespace

import pytest
from support.rows import rows_of

import jointstiff as js
from jointstiff.service.live import sources
from jointstiff.service.live.sources import SourceError, make_source
from jointstiff.simulator import LOAD_POINT, TARGETS, default_arm, simulate_campaign
from jointstiff.solver.errors import RequestError


@pytest.mark.parametrize(("source", "said"), rows_of(__file__, "sources.txt"))
def test_what_is_no_source_is_refused_with_what_is(source, said):
    address, options = source.split(" ", 1)
    with pytest.raises(RequestError) as refused:
        make_source(address, json.loads(options))
    assert str(refused.value) == said


def test_an_arm_of_the_catalogue_is_measured_with_a_load_and_targets():
    arm = "KUKA KR 210 R2700 extra"
    with pytest.raises(
        js.CampaignError, match="the positions of the targets are missing; remedy: give `targets`"
    ):
        js.measure(arm, goal="15 %")
    load = {
        "load": "dead_weight:1500",
        "targets": TARGETS,
        "load_point": LOAD_POINT,
        "sigma": 2e-5,
        "units": "m, rad, N",
    }
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
        "P10: (1, 2, nan) m cannot be the position of a target: up to 100 m, and a standard uncertainty "
        "below 1 m, is plausible: check the unit and the columns of the source; `jointstiff import` takes "
        "such readings from a file"
    )
