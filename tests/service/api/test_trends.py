"""Trends: what campaigns share, and whose alarm is acknowledged."""

import json
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from jointstiff.schemas.run import JointResult
from jointstiff.schemas.trend import TrendSelection
from jointstiff.service.kinds.trend import Campaign, ReadRun, acknowledgements_of, note_of
from jointstiff.service.kinds.trend import trend_of as charts_of
from jointstiff.service.store.tables import MeasurementSetEntry


def limit_among(measured):
    (joint,) = charts_of(["joint_1"], measured)["joints"]
    return np.log(joint.points[-1].upper_limit / joint.charts[0].stiffness)


def limit_of(instruments, **source):
    return limit_among(list(campaigns(instruments, **source)))


START = datetime(2026, 1, 1, tzinfo=UTC)
SELECTION = TrendSelection(
    serial_number="A",
    method="partial_pose",
    weighting="covariance",
    positive=True,
    encoders="motor",
    complementary_stiffness="neglected",
)


def campaigns(instruments, source="force_scale"):
    """Campaigns whose uncertainty of 3 % is 2.9 % that of one source."""
    values = 1e-6 * (1.0 + 0.005 * np.random.default_rng(4).standard_normal(len(instruments)))
    for number, (c, instrument) in enumerate(zip(values, instruments, strict=True)):
        joint = JointResult(
            name="joint_1",
            status="identified",
            verdict="use",
            reason=None,
            compliance=c,
            standard_uncertainty=0.03 * c,
            compliance_interval=(0.94 * c, 1.06 * c),
            stiffness=1.0 / c,
            stiffness_interval=(0.94 / c, 1.06 / c),
            budget={"readings": 0.0, source: 0.029 * c},
        )
        result = {"joints": [joint], "assessment": {"verdict": "use", "reasons": []}, "links": None}
        run = ReadRun.model_validate({"request": {"measurement_set_id": "s"}, "result": result})
        at = START + timedelta(days=number)
        entry = MeasurementSetEntry(
            str(number), "r", "c", "motor", 9, 0, at, "", measured_at=at, instrument=instrument
        )
        yield Campaign(str(number), at, run, entry)


def test_an_acknowledgement_is_of_one_methods_trend():
    document = {
        "measurement_set_id": "s",
        "joint": "joint_1",
        "note": "seen",
        "selection": SELECTION.model_dump(),
    }
    notes = [note_of("r", "acknowledgement", document, None, START)]
    assert json.loads(notes[0].document) == document
    assert acknowledgements_of(notes, SELECTION)["s", "joint_1"].note == "seen"
    for change in ({"method": "complete_pose"}, {"positive": False}, {"encoders": "secondary"}):
        assert acknowledgements_of(notes, SELECTION.model_copy(update=change)) == {}


@pytest.mark.parametrize("source", ["load_point", "force_scale"])
def test_what_is_assumed_is_that_of_one_hook_and_one_load_cell(source):
    """Nothing was stated, so no campaign says that it is another than in the others."""
    assumed = limit_of(["cell 7"] * 4 + ["cell 8"], source=f"assumed_{source}")
    assert assumed == pytest.approx(limit_of(["cell 7"] * 5))
    *others, last = campaigns(["cell 7"] * 5, source=f"assumed_{source}")
    *_, stated = campaigns(["cell 7"] * 4 + ["cell 8"], source=source)
    assert last.joints["joint_1"].compliance == stated.joints["joint_1"].compliance
    assert limit_among([*others, stated]) > 2.0 * assumed  # it has one of its own
