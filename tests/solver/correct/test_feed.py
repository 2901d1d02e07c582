"""Frames of feed, normal and spindle axis along a path."""

import numpy as np
import pytest

from jointstiff.solver.correct.feed import apply_feed_frames, find_feed_frames
from jointstiff.solver.errors import RequestError

FORCE = np.array([-150.0, -300.0, -120.0])
"""Along feed, normal and spindle axis [N]."""


def test_feed_frames_follow_the_path_and_a_feed_along_the_axis_has_none():
    t = np.linspace(0.0, 1.5, 30)
    centres = np.column_stack([np.cos(t), np.sin(t), 0.0 * t])
    down = np.tile([0.0, 0.0, -1.0], (30, 1))
    frames = find_feed_frames(centres, down, np.arange(30) > 0)
    tangent = np.column_stack([-np.sin(t), np.cos(t), 0.0 * t])
    np.testing.assert_allclose(frames[1:-1, :, 0], tangent[1:-1], atol=1e-12)
    # Seen from the spindle, above, the normal points to the right: outward on a turn to the left.
    np.testing.assert_allclose(frames[1:-1, :, 1], centres[1:-1], atol=1e-12)
    drilled = find_feed_frames(np.outer(t, [0.0, 0.0, -1.0]), down, np.arange(30) > 0)
    along = apply_feed_frames(drilled, np.tile([0.0, 0.0, -100.0], (30, 1)), "axes")
    np.testing.assert_allclose(along, np.tile([0.0, 0.0, 100.0], (30, 1)))
    with pytest.raises(RequestError, match="no direction of feed"):
        apply_feed_frames(drilled, np.tile(FORCE, (30, 1)), "axes")


def test_the_feed_of_a_cut_is_not_that_of_the_approach_nor_of_a_rest():
    """A motion of the joints has no feed; a tool that rests has those before and after the rest."""
    places = np.array([[0, 9, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 0], [5, 5, 0]], float)
    continuous = np.array([False, False, True, True, True, True, False])
    frames = find_feed_frames(places, np.tile([0.0, 0.0, -1.0], (7, 1)), continuous)
    half = np.sqrt(0.5)
    expected = [[1, 0, 0], *np.tile([half, half, 0], (3, 1)), [0, 1, 0]]
    np.testing.assert_allclose(frames[1:6, :, 0], expected, atol=1e-15)
    assert np.isnan(frames[[0, 6], 0, 0]).all(), "only motions of the joints lead there"


def test_the_feed_along_an_arc_is_its_tangent():
    """Two points of a quarter of a circle after a line that does not run into it smoothly."""
    t = np.radians([0.0, 30.0, 90.0])
    circle = np.column_stack([3.0 + np.cos(t), np.sin(t) - 2.0, 0.5 + 0.0 * t])
    places = np.vstack([circle[:1] - [0.0, 1.0, 0.0], circle])
    middles = np.array([False, False, True, False])
    frames = find_feed_frames(places, np.tile([0.0, 0.0, -1.0], (4, 1)), np.arange(4) > 0, middles)
    tangents = np.column_stack([-np.sin(t), np.cos(t), 0.0 * t])
    np.testing.assert_allclose(frames[1:, :, 0], tangents, atol=1e-12)
    straight = places.copy()
    straight[1:] = np.outer([0.0, 0.4, 1.0], [1.0, 0.0, 0.0])
    frames = find_feed_frames(straight, np.tile([0.0, 0.0, -1.0], (4, 1)), np.arange(4) > 0, middles)
    np.testing.assert_allclose(frames[2:, :, 0], [[1.0, 0.0, 0.0]] * 2, atol=1e-12)
