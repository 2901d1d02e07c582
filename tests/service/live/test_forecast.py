"""The forecast of the readings still needed: near the number that the campaign takes, and falling."""

import numpy as np
import pytest

import jointstiff as js
from jointstiff.service.library.measure import Person
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.live.forecast import Forecast


class Listener(Person):
    """Person who notes the number of readings still needed after each reading."""

    def __init__(self):
        self.needed = []

    def on_reading(self, state, reading):
        assert not reading.doubtful
        self.needed.append(state.still_needed)


@pytest.mark.parametrize(
    ("goal", "seed", "readings"), [("15 %", 4, 30), ("15 %", 5, 20), ("15 %", 6, 17), ("below 0.5 mm", 4, 6)]
)
def test_the_forecast_is_near_the_number_of_readings_and_falls(goal, seed, readings):
    """The load point is assumed, so that each fit uses less than the information of its readings."""
    document = simulate_campaign(default_arm(), load="pull", seed=1)
    options = (
        {} if goal.endswith("%") else {"area": [[1500, -500, 600], [2000, 500, 1200]], "force": [0, 0, -1e3]}
    )
    listener = Listener()
    with js.measure(document, goal=goal, source=f"simulated:{seed}", **options) as live:
        live.run_source(listener)
        assert (live.state.state, live.count) == ("reached", readings)
    needed = listener.needed
    if goal.endswith("%"):
        assert needed[0] is None, "one reading does not determine every joint"
        totals = [count + 2 + number for count, number in enumerate(needed[1:])]
        assert 0.75 * readings <= min(totals)
        assert max(totals) <= 1.25 * readings
        third = len(needed) // 3
        first, middle, last = (
            np.mean(needed[1:][part]) for part in (slice(third), slice(third, -third), slice(-third, None))
        )
        assert first > middle > last
    assert needed[-2:] == [1, 0]


def test_an_assumed_error_takes_information_but_its_own_contribution_is_not_counted():
    """One compliance c and one error e, both in y = c + e + noise, and a reading of c + 2 e: by hand.

    The fit has [M, N; N, S + 1] = [2, 3; 3, 6] with inverse [2, -1; -1, 2/3]. Of the variance 2, the assumed
    error causes 1 (the square of -1).
    """
    rows, columns = np.ones((2, 1)), np.array([[1.0], [2.0]])
    for assumed, variance in ((True, 1.0), (False, 2.0)):
        forecast = Forecast.begin(np.zeros((1, 1)), np.array([assumed])).add(rows, columns)
        assert forecast.uncertainties(1) == pytest.approx([variance**0.5])
        assert forecast.weighted_variance(np.array([[4.0]])) == pytest.approx(4.0 * variance)
    alone = Forecast.begin(np.zeros((1, 1)), np.zeros(0, dtype=bool)).add(rows, np.zeros((2, 0)))
    assert alone.uncertainties(1) == pytest.approx([0.5**0.5])
    nothing = Forecast.begin(np.zeros((1, 1)), np.array([True]))
    assert (nothing.uncertainties(1)[0], nothing.weighted_variance(np.eye(1))) == (np.inf, np.inf)
