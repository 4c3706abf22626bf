"""Figures have one look: the package's style, colours that differ, and no legend over a curve."""

import itertools

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="matplotlib is not installed")

from matplotlib.backends.backend_agg import FigureCanvasAgg

from jssa_gym import HoldPolicy, plots
from jssa_gym.envs import ArmEnv
from jssa_gym.evaluation import rollout
from jssa_gym.palette import COLOURS, rgb
from jssa_gym.plots import style
from jssa_gym.rates import Rate
from jssa_gym.safety.index import IndexParams
from jssa_gym.train import Band, LearningCurve
from jssa_gym.train.curves import MEASURES


@pytest.fixture(scope="module")
def trace():
    env = ArmEnv("home", human="approach_retreat", terminate_on=())
    return rollout(env, HoldPolicy(env), seed=0, steps=60, name="x")


@pytest.fixture(params=["profile", "portraits", "shifts", "sensitivity", "degradation", "learning"])
def figure(request, trace, robot):
    index = IndexParams(d_min=0.05, lambda1=1.0, lambda2=0.5)
    curve = plots.Curve([1, 2], [0.0, 0.5], [0.0, 0.4], [0.1, 0.6], [0.0, 0.9])
    band = Band((0.0, 0.5), (0.0, 0.4), (0.1, 0.6))
    learnt = LearningCurve("a", 3, (64, 128), (30.0, 60.0), True, dict.fromkeys(MEASURES, band), Rate.of(1, 10))
    table = {"one": np.arange(4.0).reshape(2, 2, 1)}
    return {
        "profile": lambda: plots.profile([trace, trace], robot.limits, 0.05),
        "portraits": lambda: plots.portraits(index),
        "shifts": lambda: plots.shifts(index, 2.0, 1.0),
        "sensitivity": lambda: plots.sensitivity(table, [1.0, 2.0], [1.0, 2.0], ["distance [m]"]),
        "degradation": lambda: plots.degradation(curve, curve),
        "learning": lambda: plots.learning([learnt, learnt]),
    }[request.param]()


@pytest.mark.sampled(1)
def test_every_figure_is_drawn_in_the_style(figure):
    flat = [axes for axes in figure.axes if axes.name == "rectilinear"]
    assert flat
    for axes in flat:
        assert not axes.spines["top"].get_visible()
        assert not axes.spines["right"].get_visible()


@pytest.mark.sampled(1)
def test_no_legend_lies_over_a_panel(figure):
    FigureCanvasAgg(figure).draw()
    legends = [axes.get_legend() for axes in figure.axes if axes.get_legend()] + figure.legends
    for legend, axes in itertools.product(legends, figure.axes):
        box, panel = legend.get_window_extent(), axes.get_window_extent()
        wide = min(box.x1, panel.x1) - max(box.x0, panel.x0)
        high = min(box.y1, panel.y1) - max(box.y0, panel.y0)
        assert min(wide, high) < 2.0
        assert box.x1 <= figure.bbox.x1 + 2.0
        assert box.y0 >= -2.0


def test_the_style_leaves_others_figures_alone(trace, robot):
    import matplotlib

    before = dict(matplotlib.rcParams)
    plots.profile([trace], robot.limits, 0.05)
    assert dict(matplotlib.rcParams) == before


def test_the_style_file_has_the_palettes_colours():
    text = style.STYLE.read_text()
    assert [text.index(colour.removeprefix("#")) for colour in COLOURS] == sorted(
        text.index(colour.removeprefix("#")) for colour in COLOURS
    )


def _seen(colour, matrix):
    linear = (np.array(rgb(colour)) / 255.0) ** 2.2
    return np.clip(matrix @ linear, 0.0, 1.0) ** (1 / 2.2)


# Machado, Oliveira and Fernandes, 2009, severity 1
BLIND = {
    "nobody": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}


@pytest.mark.parametrize("eye", BLIND)
def test_colours_differ_for_everybody(eye):
    seen = [_seen(colour, BLIND[eye]) for colour in COLOURS]
    for (i, one), (k, other) in itertools.combinations(enumerate(seen), 2):
        assert np.linalg.norm(one - other) > 0.1, (COLOURS[i], COLOURS[k])
