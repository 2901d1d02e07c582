"""Forces of milling: what simple cuts must give, and the direction in which they act."""

from dataclasses import replace

import numpy as np
import pytest

from jointstiff.solver.correct.cut import MATERIALS, Cut, Material
from jointstiff.solver.errors import RequestError

LINEAR = Material(1000.0, 0.0, "a force in proportion to the chip's area")
SLOT = Cut(LINEAR, 0.02, 4, 50.0, 0.02, 0.003, 0.02, radial=0.0)


def test_a_slot_whose_force_is_proportional_to_the_chip_has_the_integral_by_hand():
    """``z/2π ∫ p b f_z cos θ (sin θ, −cos θ) dθ`` from −π/2 to π/2 is ``−z p b f_z / 4`` along the normal."""
    chip = 1e3 * SLOT.feed_per_tooth
    assert chip == pytest.approx(0.1)
    np.testing.assert_allclose(SLOT.mean_force(), [0.0, -4 * 1000.0 * 3.0 * chip / 4.0, 0.0], atol=1e-3)


def test_the_work_of_the_cutting_force_is_the_pressure_on_the_volume_removed():
    """The mean tangential force on the circumference is the power: k_c · depth · width · feed."""
    cut = replace(SLOT, width=0.007)
    # A radial share ρ adds ρ times the tangential force turned by a quarter, so its cost tells F_c's size
    edge = 1.0 - 2.0 * cut.width / cut.diameter
    angle = np.linspace(np.arcsin(edge), np.pi / 2, 200_001)
    chip = 1e3 * cut.feed_per_tooth * np.cos(angle)
    tangential = 4 / (2 * np.pi) * np.trapezoid(1000.0 * 3.0 * chip, angle)
    power = tangential * 2 * np.pi * cut.speed * cut.diameter / 2
    assert power == pytest.approx(1000.0e6 * cut.depth * cut.width * cut.feed, rel=1e-6)
    expected = (
        4
        / (2 * np.pi)
        * np.trapezoid(1000.0 * 3.0 * chip * np.stack([np.sin(angle), -np.cos(angle)]), angle, axis=1)
    )
    np.testing.assert_allclose(cut.mean_force()[:2], expected, rtol=1e-5)


def test_climb_milling_pulls_the_tool_along_and_conventional_milling_holds_it_back():
    climb = replace(SLOT, width=0.002)
    conventional = replace(climb, direction="conventional")
    assert climb.mean_force()[0] > 0.0 > conventional.mean_force()[0]
    np.testing.assert_allclose(climb.mean_force()[:2] * [-1, 1], conventional.mean_force()[:2], rtol=1e-9)
    # The radial force pushes the tool away from the workpiece, which is to the right in climb milling.
    pushed = replace(climb, radial=0.5).mean_force()[1] - climb.mean_force()[1]
    assert pushed < 0.0


def test_thin_chips_take_more_force_for_their_area():
    thin, thick = (Cut(MATERIALS["steel"], 0.02, 4, 50.0, feed, 0.003, 0.02) for feed in (0.01, 0.02))
    ratio = np.linalg.norm(thick.mean_force()) / np.linalg.norm(thin.mean_force())
    assert ratio == pytest.approx(2 ** (1 - 0.22))
    assert 100.0 < np.linalg.norm(thick.mean_force()) < 1000.0


def test_a_cut_that_cannot_be_is_refused():
    with pytest.raises(RequestError, match="exceeds the tool's diameter"):
        replace(SLOT, width=0.03)
    with pytest.raises(RequestError, match="teeth"):
        replace(SLOT, teeth=0)
    with pytest.raises(RequestError, match="100 mm a tooth, more than the tool's radius"):
        replace(SLOT, feed=20.0)  # mm/s, as if they were m/s
