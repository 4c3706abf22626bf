"""What several runs come to: rliable's definitions, and curves read from folders of trainings."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from trainings import tiny

from jssa_gym.exceptions import CheckpointError, ParameterError
from jssa_gym.train import PPO, interquartile_mean, learning_curves, stratified_interval
from jssa_gym.train.history import RECORD, Leg, write_record

NAN = float("nan")


def leg(steps, **changes):
    """A leg of 10 episodes."""
    values = dict.fromkeys(Leg.__dataclass_fields__, 0.0) | {"steps": steps, "seconds": 60.0, "episodes": 10}
    return Leg(**(values | {"moving_contacts": 0, "processor_seconds": 30.0} | changes))


def leave(folder, config, legs):
    """A training's folder."""
    folder.mkdir(parents=True)
    write_record(folder / RECORD, config.as_dict(), tuple(legs))
    return folder


def sweep(folder, finals, **changes):
    """Trainings with a seed for every final success, whose first leg has none."""
    for seed, final in enumerate(finals):
        legs = (leg(64), leg(128, eval_safe=final, eval_success=final, moving_contacts=seed))
        leave(folder / f"seed-{seed}", tiny(seed=seed, **changes), legs)
    return folder


# ---- numbers -----------------------------------------------------------------------------------------


def test_the_interquartile_mean_by_hand():
    # 8 scores: two at either end go, the mean of 3, 4, 5, 8 is 5
    assert interquartile_mean([100, 3, 8, 1, 4, -7, 5, 90]) == pytest.approx(5.0)
    # 5 scores: one at either end goes, as rliable's trim_mean has it, not a quarter of one more
    assert interquartile_mean([9, 1, 2, 3, 100]) == pytest.approx((2 + 3 + 9) / 3)
    assert interquartile_mean([1, 2, 6]) == pytest.approx(3.0)
    np.testing.assert_allclose(interquartile_mean([[0, 1], [2, 1], [1, 1], [9, 1], [-5, 1]]), [1.0, 1.0])


def test_it_is_what_rliable_takes():
    stats = pytest.importorskip("scipy.stats")
    rng = np.random.default_rng(0)
    for runs in range(1, 14):
        scores = rng.normal(size=(runs, 3))
        np.testing.assert_allclose(interquartile_mean(scores), stats.trim_mean(scores, 0.25, axis=0))


def test_an_interval_is_that_of_all_resamples():
    """Three runs have 27 resamples, equally likely, whose means are few numbers: quantiles are exact."""
    runs = [0.0, 1.0, 5.0]
    means = [np.mean(drawn) for drawn in itertools.product(runs, repeat=3)]
    for confidence in (0.95, 0.8, 0.6):  # none near a step of the distribution
        tail = (1.0 - confidence) / 2.0
        expected = np.quantile(means, [tail, 1.0 - tail], method="inverted_cdf")
        found = stratified_interval([runs], confidence=confidence, resamples=4000)
        np.testing.assert_allclose(found, expected)


def test_runs_are_drawn_within_their_stratum():
    """Of an easy task and a hard one, each always alike, nothing varies; drawn from all runs at once it would."""
    assert stratified_interval([[1.0, 1.0], [0.0, 0.0]], resamples=200) == (0.5, 0.5)
    low, high = stratified_interval([[1.0, 1.0, 0.0, 0.0]], resamples=200)
    assert (low, high) == (0.0, 1.0)


def test_a_run_is_drawn_whole():
    """Two curves that add up to 1 in every point stay so, whichever are drawn."""
    runs = np.array([[0.0, 1.0], [1.0, 0.0]])
    low, high = stratified_interval([runs], resamples=300, confidence=0.5)
    np.testing.assert_allclose(low + high[::-1], 1.0)
    assert stratified_interval([runs], seed=3)[0].shape == (2,)


@pytest.mark.parametrize("bad", [[], [[]], [[1.0, NAN]], [[1.0], [[1.0, 2.0]]]])
def test_what_is_no_scores_is_refused(bad):
    with pytest.raises(ParameterError):
        stratified_interval(bad)


# ---- folders -----------------------------------------------------------------------------------------


@pytest.mark.long
def test_seeds_are_put_together_by_label(tmp_path):
    inside, without = sweep(tmp_path / "inside", [0.0, 0.5, 0.6, 0.7, 1.0]), tmp_path / "without"
    sweep(without, [0.25], shield=False)
    one, other = learning_curves([("inside", inside), ("without", without)])
    assert (one.label, one.runs, one.steps, one.seconds, one.processor) == ("inside", 5, (64, 128), (30.0, 60.0), True)
    assert one.bands["success"].value == (0.0, pytest.approx(0.6))
    assert one.bands["success"].low[1] < 0.6 < one.bands["success"].high[1]
    assert one.bands["contacts"].value == (0.0, 2.0)
    assert (one.moving_contacts.k, one.moving_contacts.n) == (0 + 1 + 2 + 3 + 4, 100)
    assert other.bands["success"] == type(other.bands["success"])((0.0, 0.25), (0.0, 0.25), (0.0, 0.25))
    (folder_of_one,) = learning_curves([("x", without / "seed-0")])
    assert folder_of_one.bands == other.bands


def test_tasks_of_one_label_are_strata(tmp_path):
    sweep(tmp_path / "a", [1.0, 1.0])
    sweep(tmp_path / "b", [0.0, 0.0], task="track")
    (curve,) = learning_curves([("all", tmp_path / "a"), ("all", tmp_path / "b")])
    assert curve.runs == 4
    assert (curve.bands["success"].low[1], curve.bands["success"].high[1]) == (0.5, 0.5)


def test_a_curve_ends_where_the_shortest_training_has_come(tmp_path):
    leave(tmp_path / "0", tiny(seed=0), [leg(64)])
    leave(tmp_path / "1", tiny(seed=1), [leg(64), leg(128)])
    assert learning_curves([("x", tmp_path)])[0].steps == (64,)


def test_old_trainings_have_the_clock_on_the_wall(tmp_path):
    leave(tmp_path / "0", tiny(seed=0), [leg(64, processor_seconds=NAN)])
    leave(tmp_path / "1", tiny(seed=1), [leg(64, episodes=0)])
    (curve,) = learning_curves([("x", tmp_path)])
    assert (curve.seconds, curve.processor) == ((60.0,), False)
    leave(tmp_path / "alone" / "1", tiny(seed=1), [leg(64, episodes=0)])
    assert learning_curves([("x", tmp_path / "alone")])[0].moving_contacts is None


def test_what_does_not_belong_together_is_refused(tmp_path):
    leave(tmp_path / "a", tiny(seed=0), [leg(64)])
    leave(tmp_path / "b", tiny(seed=1, shield=False), [leg(64)])
    with pytest.raises(ParameterError, match="differ in shield; give each a label"):
        learning_curves([("x", tmp_path)])
    settings = PPO(width=17, rollout=64, batch_size=32, n_epochs=2)
    leave(tmp_path / "c", tiny(seed=2, settings=settings), [leg(64)])
    with pytest.raises(ParameterError, match="differ in settings"):
        learning_curves([("x", tmp_path / "a"), ("x", tmp_path / "c")])
    with pytest.raises(ParameterError, match="one seed twice"):
        learning_curves([("x", tmp_path / "a"), ("x", tmp_path / "a")])
    leave(tmp_path / "d", tiny(seed=3), [leg(32)])
    with pytest.raises(ParameterError, match="end their legs at different steps"):
        learning_curves([("x", tmp_path / "a"), ("x", tmp_path / "d")])
    with pytest.raises(ParameterError, match="holds no training"):
        learning_curves([("x", tmp_path / "none")])


@pytest.mark.parametrize("text", ["", "[]", '{"training": {}, "history": []}', "{"])
def test_a_file_that_is_no_record_is_named(text, tmp_path):
    (tmp_path / RECORD).write_text(text)
    with pytest.raises(CheckpointError, match="no record of a training"):
        learning_curves([("x", tmp_path)])


def test_a_record_without_a_leg_is_refused(tmp_path):
    leave(tmp_path / "a", tiny(), [])
    with pytest.raises(CheckpointError, match="history is empty"):
        learning_curves([("x", tmp_path)])
    data = json.loads((tmp_path / "a" / RECORD).read_text())
    assert data["training"] == replace(tiny()).as_dict()
