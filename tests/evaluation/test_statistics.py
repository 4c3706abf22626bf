"""Intervals against their definitions and against numbers from the books."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from jssa_gym.evaluation import Rate, bootstrap_interval, clopper_pearson, paired_difference
from jssa_gym.exceptions import ParameterError


@pytest.mark.parametrize(
    ("k", "n", "low", "high"),
    [
        (0, 10, 0.0, 0.3085),
        (1, 10, 0.0025, 0.4450),
        (5, 10, 0.1871, 0.8129),
        (10, 10, 0.6915, 1.0),
        (0, 1, 0.0, 0.975),
        (2, 100, 0.0024, 0.0704),
        (0, 1000, 0.0, 0.003682),
    ],
)
def test_known_values(k, n, low, high):
    assert clopper_pearson(k, n) == pytest.approx((low, high), abs=5e-5)


@pytest.mark.parametrize("n", [1, 7, 300, 10**6])
@pytest.mark.parametrize("confidence", [0.9, 0.95, 0.999])
def test_the_tails_hold_what_the_definition_says(n, confidence):
    tail = (1.0 - confidence) / 2.0
    for k in {0, 1, n // 3, n - 1, n}:
        low, high = clopper_pearson(k, n, confidence)
        assert 0.0 <= low <= k / n <= high <= 1.0
        if k == 0:
            assert low == 0.0
        else:
            # at the lower end, k or more happen with the tail's probability
            assert stats.binom.sf(k - 1, n, low) == pytest.approx(tail, rel=1e-6)
            assert low == pytest.approx(stats.beta.ppf(tail, k, n - k + 1), rel=1e-9)
        if k == n:
            assert high == 1.0
        else:
            assert stats.binom.cdf(k, n, high) == pytest.approx(tail, rel=1e-6)
            assert high == pytest.approx(stats.beta.ppf(1.0 - tail, k + 1, n - k), rel=1e-9)


def test_the_interval_covers_the_truth_often_enough():
    n, truth = 40, 0.07
    covered = sum(
        stats.binom.pmf(k, n, truth)
        for k in range(n + 1)
        if clopper_pearson(k, n)[0] <= truth <= clopper_pearson(k, n)[1]
    )
    assert covered >= 0.95


@pytest.mark.parametrize(("k", "n"), [(0, 0), (1, 0), (3, 2), (-1, 5), (1.0, 5), (1, 5.0), (True, 5), ("1", 5)])
def test_no_rate_without_trials_or_beyond_them(k, n):
    for function in (clopper_pearson, Rate.of):
        with pytest.raises(ParameterError):
            function(k, n)


@pytest.mark.parametrize("confidence", [0.0, 1.0, -1.0, 95, float("nan")])
def test_confidence_is_between_zero_and_one(confidence):
    with pytest.raises(ParameterError, match="confidence"):
        clopper_pearson(1, 2, confidence)
    with pytest.raises(ParameterError, match="confidence"):
        bootstrap_interval([1.0], np.mean, 0, confidence=confidence)
    with pytest.raises(ParameterError, match="confidence"):
        paired_difference([1], [0], confidence)


@pytest.mark.parametrize(
    ("k", "n", "text"),
    [
        (0, 1000, "0 / 1,000 (≤ 0.37 %)"),
        (0, 1_000_000, "0 / 1,000,000 (≤ 0.00037 %)"),
        (3, 1000, "3 / 1,000 (0.062 % to 0.87 %)"),
        (500, 1000, "500 / 1,000 (47 % to 53 %)"),
        (1000, 1000, "1,000 / 1,000 (≥ 99.63 %)"),
    ],
)
def test_a_rate_in_words(k, n, text):
    rate = Rate.of(np.int64(k), n)
    assert str(rate) == text
    assert (rate.low, rate.high) == clopper_pearson(k, n)
    assert rate.value == k / n
    assert type(rate.k) is int
    with pytest.raises(dataclasses.FrozenInstanceError):
        rate.k = 1


def test_a_bootstrap_of_the_mean_is_about_the_normal_interval():
    values = np.random.default_rng(0).normal(3.0, 2.0, 400)
    low, high = bootstrap_interval(values, np.mean, 0)
    half = 1.96 * values.std() / 20.0
    assert low == pytest.approx(values.mean() - half, abs=0.03)
    assert high == pytest.approx(values.mean() + half, abs=0.03)
    assert bootstrap_interval(values, np.mean, 0) == (low, high)
    assert bootstrap_interval(values, np.mean, 1) != (low, high)
    narrow = bootstrap_interval(values, np.mean, 0, confidence=0.5)
    assert low < narrow[0] < narrow[1] < high


@pytest.mark.parametrize("statistic", [np.mean, np.median, np.std])
@pytest.mark.parametrize("confidence", [0.5, 0.95])
def test_a_bootstrap_is_scipys_of_the_same_draws(statistic, confidence):
    values = np.random.default_rng(0).exponential(size=37)
    theirs = stats.bootstrap(
        (values,),
        statistic,
        n_resamples=500,
        confidence_level=confidence,
        method="percentile",
        vectorized=False,
        random_state=np.random.default_rng(7),
    ).confidence_interval
    ours = bootstrap_interval(values, statistic, 7, confidence=confidence, resamples=500)
    assert ours == pytest.approx((theirs.low, theirs.high), rel=1e-12)


@pytest.mark.parametrize("confidence", [0.5, 0.95])
def test_a_bootstrap_is_quantiles_of_resamples(confidence):
    values, rng = np.random.default_rng(1).exponential(size=37), np.random.default_rng(7)
    drawn = [np.median(values[rng.integers(37, size=37)]) for _ in range(500)]
    tail = (1.0 - confidence) / 2.0
    ours = bootstrap_interval(values, np.median, 7, confidence=confidence, resamples=500)
    assert ours == pytest.approx(np.quantile(drawn, [tail, 1.0 - tail]), rel=1e-12)


@pytest.mark.parametrize("values", [[7.0], [7.0, 7.0], np.full((5, 2), 7.0)])
def test_a_bootstrap_of_what_is_always_the_same_has_no_width(values):
    assert bootstrap_interval(values, np.mean, 0, resamples=20) == (7.0, 7.0)


def test_a_bootstrap_takes_whole_rows():
    rows = np.random.default_rng(0).normal(size=(50, 1)) + np.array([0.0, 10.0])
    low, high = bootstrap_interval(rows, lambda r: np.mean(r[:, 1] - r[:, 0]), 0, resamples=50)
    assert low == pytest.approx(10.0)
    assert high == pytest.approx(10.0)
    assert bootstrap_interval([7.0], np.median, 0, resamples=5) == (7.0, 7.0)
    assert len(set(bootstrap_interval([1.0, 2.0, 4.0], np.mean, 0, resamples=1))) == 1
    assert np.isnan(bootstrap_interval([1.0, 2.0, 4.0], lambda drawn: np.nan, 0, resamples=5)).all()


@pytest.mark.parametrize("values", [[], 3.0, [np.nan], [np.inf, 1.0]])
def test_a_bootstrap_needs_values(values):
    with pytest.raises(ParameterError):
        bootstrap_interval(values, np.mean, 0)
    with pytest.raises(ParameterError):
        bootstrap_interval([1.0], np.mean, 0, resamples=0)


def test_a_paired_difference_by_hand():
    first = np.array([1] * 8 + [1] * 12 + [0] * 3 + [0] * 77, bool)
    second = np.array([1] * 8 + [0] * 12 + [1] * 3 + [0] * 77, bool)
    result = paired_difference(first, second)
    assert (result.n, result.first_only, result.second_only, result.value) == (100, 12, 3, 0.09)
    p, q = 13.0 / 102.0, 4.0 / 102.0
    half = 1.959964 * np.sqrt((p + q - (p - q) ** 2) / 102.0)
    assert result.low == pytest.approx(p - q - half, abs=1e-6)
    assert result.high == pytest.approx(p - q + half, abs=1e-6)
    # twice the chance of at most 3 of 15 throws of a coin
    assert result.p_value == pytest.approx(2.0 * sum((1, 15, 105, 455)) / 2**15)
    assert str(result) == f"0.09 ({result.low:.3g} to {result.high:.3g})"
    turned = paired_difference(second, first)
    assert (turned.value, turned.low, turned.high) == pytest.approx((-result.value, -result.high, -result.low))


def test_two_that_never_differ_are_not_known_to_be_equal():
    result = paired_difference([0] * 100, [0] * 100)
    assert (result.value, result.p_value) == (0.0, 1.0)
    assert -0.03 < result.low < -0.02 < 0.02 < result.high < 0.03
    certain = paired_difference([1] * 5, [0] * 5)
    assert certain.value == certain.high == 1.0


def test_a_paired_interval_covers_the_truth():
    rng, hits = np.random.default_rng(0), 0
    for _ in range(400):
        draws = rng.uniform(size=60)
        result = paired_difference(draws < 0.30, (draws > 0.05) & (draws < 0.20))
        hits += result.low <= 0.15 <= result.high
    assert hits >= 0.93 * 400


@pytest.mark.parametrize(("one", "other"), [([], []), ([1], [1, 0]), ([0.5], [0]), ([[1]], [[0]]), ([np.nan], [0])])
def test_a_paired_difference_needs_pairs_of_yes_and_no(one, other):
    with pytest.raises(ParameterError):
        paired_difference(one, other)
