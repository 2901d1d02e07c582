"""Units, exact storage, and the translation of bounds."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.campaigns import estimate, prepare
from support.examples import examples

from jointstiff.schemas.measurement import Observation
from jointstiff.service.conversion.readings import ReadingArrays
from jointstiff.simulator import default_arm, simulate_campaign

coordinate = st.floats(-1e12, 1e12, allow_nan=False)
vector = st.lists(coordinate, min_size=3, max_size=3)
square = [[4e-10, 1e-10, 0.0], [1e-10, 4e-10, 0.0], [0.0, 0.0, 9e-10]]
noise = st.sampled_from([{}, {"sigma": 1e-5}, {"unloaded_covariance": square, "loaded_covariance": square}])
text = st.text(st.characters(categories=["L", "N", "P", "S"]), min_size=1, max_size=12)
reading = st.one_of(
    st.fixed_dictionaries({"unloaded": vector, "loaded": vector}),
    st.fixed_dictionaries({"deflection": vector}),
    st.fixed_dictionaries({"unloaded": vector}),
    st.fixed_dictionaries({"displacement": coordinate, "direction": st.just([0.6, 0.0, -0.8])}),
    st.fixed_dictionaries({"displacement": coordinate, "flange_direction": st.just([0.0, 1.0, 0.0])}),
)


def with_noise(read, stated):
    """The reading with what is stated of it: a gauge has no covariance."""
    return read | (stated if "sigma" in stated or "displacement" not in read else {})


@st.composite
def observations(draw):
    labels = draw(st.lists(text, min_size=1, max_size=4, unique=True))
    joints, stated = draw(st.integers(1, 5)), draw(noise)
    return [
        {
            "label": label,
            "joints": draw(st.lists(coordinate, min_size=joints, max_size=joints)),
            "force": draw(vector),
            **draw(st.fixed_dictionaries({}, optional={"moment": vector, "load_point": vector})),
            "readings": [
                {"target": target} | with_noise(read, stated)
                for target, read in draw(st.dictionaries(text, reading, min_size=1, max_size=3)).items()
            ],
        }
        for label in labels
    ]


@examples(100)
@given(observations())
def test_what_is_stored_comes_back_bit_for_bit(sent):
    arrays = ReadingArrays.from_observations([Observation.model_validate(o) for o in sent])
    restored = ReadingArrays.unpack(arrays.pack())
    assert restored.digest() == arrays.digest()
    assert restored.observations() == arrays.observations()
    for given_, kept in zip(sent, restored.observations(), strict=True):
        dumped = json.loads(kept.model_dump_json(exclude_none=True))
        by_target = {reading["target"]: reading for reading in dumped.pop("readings")}
        assert by_target == {reading["target"]: reading for reading in given_["readings"]}
        assert dumped == {k: v for k, v in given_.items() if k != "readings"}


@pytest.mark.parametrize("length", ["m", "mm"])
@pytest.mark.parametrize("angle", ["rad", "deg"])
@pytest.mark.parametrize("force", ["N", "kN", "kgf"])
@pytest.mark.parametrize("readings", ["positions", "deflections"])
def test_units_do_not_matter(length, angle, force, readings):
    options = {
        "load": "pull",
        "configurations": 8,
        "seed": 1,
        "moment": 50.0,
        "readings": readings,
        "sigma": 1e-6,
    }
    expected = estimate(*prepare(simulate_campaign(default_arm(), **options)))
    units = {"length": length, "angle": angle, "force": force, "moment": "N.mm"}
    found = estimate(*prepare(simulate_campaign(default_arm(), **options, units=units)))
    # Readings are rounded in their own unit when the campaign is written, to a hundredth of sigma.
    np.testing.assert_allclose(found.compliance, expected.compliance, rtol=1e-3)
    assert found.sigma == pytest.approx(expected.sigma)
