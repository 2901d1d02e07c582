"""Campaigns to try, by name."""

from pathlib import Path

import pytest

import jointstiff as js
from jointstiff.service.library import datasets as module
from jointstiff.simulator import default_arm
from jointstiff.solver.errors import RequestError


@pytest.mark.parametrize("name", js.datasets.names())
def test_every_campaign_can_be_identified(name):
    campaign = js.datasets.load(name)
    run = js.identify(campaign)
    assert run.state == "succeeded"
    kind = "Measured" if name == "fanuc_r2000ic" else "Simulated"
    assert js.datasets.about(name).startswith(
        f"{kind}: {len(campaign.measurement_set.observations)} postures"
    )


def test_the_simulated_stiffnesses_are_in_their_intervals():
    run = js.identify(js.datasets.load("pull"))
    planted = default_arm().stiffnesses
    inside = [low < each < high for each, (low, high) in zip(planted, run.conf_int("stiffness"), strict=True)]
    assert sum(inside) >= 5, "95 % intervals of six joints"


def test_the_measured_campaign_has_its_published_solution():
    """Least squares of the same readings by another program."""
    run = js.identify(
        js.datasets.load("fanuc_r2000ic"), weighting="uniform", complementary_stiffness="neglected"
    )
    published = [861071.8805, 2743390.9984, 2069594.5785, 359217.0978, 444155.9142, 137986.3549]
    assert run.stiffness == pytest.approx(published, rel=1e-6)


def test_the_licence_of_the_measured_campaign_is_in_the_package():
    text = (Path(module.__file__).parent / "data" / "fanuc_r2000ic.LICENSE").read_text(encoding="utf-8")
    assert text.startswith("MIT License\n\nCopyright (c) 2026 longton2001-pixel\n")
    assert "MIT licence" in js.datasets.about("fanuc_r2000ic")


@pytest.mark.parametrize("function", [js.datasets.load, js.datasets.about])
def test_an_unknown_name_is_refused_with_the_names(function):
    with pytest.raises(RequestError, match="there is no campaign 'fanuc'") as refused:
        function("fanuc")
    assert refused.value.remedy == "use one of dead_weight, pull, secondary_encoders, fanuc_r2000ic"
    assert js.identify(js.datasets.load("dead_weight")).state == "succeeded"
