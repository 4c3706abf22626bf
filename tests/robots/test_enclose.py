"""Capsules around shapes: nothing sticks out. Oracle: points all over the triangles, distances from a line by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots_arms import cube

from jssa_gym.robots.prepare import enclose as module
from jssa_gym.robots.prepare.enclose import MARGIN, Solid, around, enclose, fit, joined

SETTINGS = settings(max_examples=6, deadline=None)


def solid(triangles, radius=0.0):
    return Solid(np.asarray(triangles, float), np.full(len(triangles), radius))


def farthest_out(shape, capsules, rng, count=40):
    """How far points all over the triangles, with their balls, lie outside of the nearest capsule [m]."""
    share = rng.dirichlet(np.ones(3), (len(shape.triangles), count))
    share[:, :3] = np.eye(3)
    points = np.einsum("tkc,tcx->tkx", share, shape.triangles)
    out = np.full(points.shape[:2], np.inf)
    for start, end, radius in capsules:
        way = end - start
        length = np.linalg.norm(way)
        along = np.clip((points - start) @ (way / max(length, 1e-12)), 0.0, length)
        foot = start + along[..., None] * way / max(length, 1e-12)
        out = np.minimum(out, np.linalg.norm(points - foot, axis=-1) - radius)
    return float((out + shape.radius[:, None]).max())


@SETTINGS
@given(st.integers(0, 10_000), st.integers(1, 30), st.floats(0.0, 0.05))
@pytest.mark.long
def test_nothing_sticks_out(seed, count, ball):
    rng = np.random.default_rng(seed)
    shape = solid(rng.normal(size=(count, 3, 3)) * rng.uniform(0.01, 0.3, 3), ball)
    for most in (1, 2, 3):
        capsules = [one.capsule for one in enclose(shape, most)]
        assert 1 <= len(capsules) <= most
        assert farthest_out(shape, capsules, rng) <= -0.9 * MARGIN


def test_a_tube_gets_a_capsule_as_long_and_thick_as_it_is():
    turn = np.linspace(0.0, 2.0 * np.pi, 61)
    ring = np.stack([0.05 * np.cos(turn), 0.05 * np.sin(turn), np.zeros(61)], axis=1)
    top = ring + np.array([0.0, 0.0, 0.6])
    shape = solid([*np.stack([ring[:-1], ring[1:], top[1:]], 1), *np.stack([ring[:-1], top[1:], top[:-1]], 1)])
    ((one, _),) = enclose(shape)
    assert one.radius == pytest.approx(0.05, abs=0.012)
    assert abs((one.end - one.start) @ [0.0, 0.0, 1.0]) == pytest.approx(0.6, abs=0.05)


@pytest.mark.parametrize("points", [[[0.1, 0.2, 0.3]] * 3, [[0, 0, 0], [0, 0, 0.4], [0, 0, 0.4]]])
def test_a_ball_and_a_line_are_what_they_are(points):
    shape = solid([points], 0.04)
    ((one, _),) = enclose(shape)
    assert one.radius == pytest.approx(0.04, abs=2.0 * MARGIN)
    length = np.linalg.norm(np.subtract(points[1], points[0]))
    assert np.linalg.norm(one.end - one.start) == pytest.approx(length, abs=2e-3)


def bracket():
    """Two long beams at a right angle."""
    return joined(
        [
            solid(cube(np.array([0.02, 0.02, 0.2]), (0.0, 0.0, 0.2))),
            solid(cube(np.array([0.2, 0.02, 0.02]), (0.2, 0.0, 0.4))),
        ]
    )


@pytest.mark.long
def test_a_bracket_gets_two_that_are_slimmer(monkeypatch):
    shape, rng = bracket(), np.random.default_rng(0)
    one = around(shape)
    fits = enclose(shape)
    several = [one.capsule for one in fits]
    assert len(several) >= 2
    assert max(capsule.radius for capsule in several) < 0.6 * one.radius
    assert sum(capsule.volume for capsule in several) < 0.5 * one.volume
    assert farthest_out(shape, several, rng, 400) <= -0.9 * MARGIN
    # two beams of 0.04 × 0.04 × 0.4 m; the hull of both is the prism over their triangle
    assert fit(shape).ratio == pytest.approx(one.volume / fit(shape).hull)
    for each in fits:
        assert each.ratio == each.capsule.volume / each.hull < 0.5 * fit(shape).ratio
    monkeypatch.setattr(module, "LOOSE", 0.0)
    assert len(enclose(shape)) == 1


@pytest.mark.long
def test_triangles_that_are_cut_are_held_to_the_middle():
    """One large triangle over both parts of a shape: its corners alone would not do."""
    shape, rng = (
        joined([bracket(), solid([[[0, 0.02, 0], [0.4, 0.02, 0.4], [0, 0.02, 0.4]]])]),
        np.random.default_rng(0),
    )
    capsules = [one.capsule for one in enclose(shape)]
    assert farthest_out(shape, capsules, rng, 2000) <= -0.9 * MARGIN


@pytest.mark.parametrize(
    ("shape", "hull"),
    [(solid(cube(np.array([0.1, 0.2, 0.3]))), 8.0 * 0.1 * 0.2 * 0.3), (solid([[[0.1, 0.2, 0.3]] * 3], 0.1), 4.19e-3)],
)
def test_what_a_capsule_wastes_is_told_against_the_hull(shape, hull):
    found = fit(shape)
    assert found.hull == pytest.approx(hull, rel=0.025)
    assert found.ratio == found.capsule.volume / found.hull >= 1.0


def test_the_hull_of_what_is_flat_is_nothing():
    assert fit(solid([[[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]])).ratio == np.inf
