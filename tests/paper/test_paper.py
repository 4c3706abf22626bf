"""The paper's claims as tests: which come out here, and which do not; the machinery that says so."""

import dataclasses
import json
import sys

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jssa_gym.cli import main
from jssa_gym.exceptions import RecordingError
from jssa_gym.paper import claims, experiments, handover_claims, index_claims, person, reported
from jssa_gym.paper.claims import Claim, Evidence
from jssa_gym.paper.experiments import SHIELDS
from jssa_gym.paper.handover import BEGIN, Delivery
from jssa_gym.paper.reported import Measures
from jssa_gym.safety.condition import fastest_approach
from jssa_gym.safety.index import IndexParams

PUBLISHED, EXACT, OURS = SHIELDS
PAPERS = IndexParams(lambda1=3.0, lambda2=1.0)


@pytest.fixture(scope="module")
def avoidance():
    return experiments.avoidance()


@pytest.fixture(scope="module")
def corners():
    """Table 1's corners: what its trends are judged by."""
    return experiments.sensitivity(values=(6.0, 8.0))


def holds(found: list[Claim], shield: str) -> dict[str, bool]:
    return {claim.text: claim.verdicts[shield].holds for claim in found}


# ---- the stand-in person -----------------------------------------------------------------------------


def test_the_stand_in_comes_near_the_numbers_of_fig_6(avoidance):
    traces, limits = avoidance
    seen = reported.measures(traces[PUBLISHED], limits)
    assert seen.min_distance == pytest.approx(reported.FIG6.min_distance, abs=0.005)
    assert seen.first_trigger == pytest.approx(reported.FIG6.first_trigger, abs=0.1)
    assert seen.last_trigger == pytest.approx(reported.FIG6.last_trigger, abs=0.05)
    assert seen.active_duration == pytest.approx(reported.FIG6.active_duration, abs=0.05)


def test_the_stand_in_walks_as_fast_as_people_do():
    human = person.stand_in()
    rng = np.random.default_rng(0)
    people = [human.reset(rng)]
    for _ in range(reported.STEPS):
        people.append(human.step(0.008, people[0]))
    speed = np.linalg.norm([p.start_velocity[0] for p in people], axis=1)
    assert speed.max() < 1.6
    roots = np.array([p.start[0, :2] for p in people])
    np.testing.assert_allclose(roots[0], person.WALK[0][1:])
    # it is where its table says at the table's times
    for time, x, y in person.WALK:
        step = round(time / 0.008)
        np.testing.assert_allclose(roots[step], (x, y), atol=1.6 * 0.008)


@pytest.mark.parametrize(
    "table", ["abc", [], [(0.0, 1.0)], [(0.0, 1.0, 1.0)], [(0.0, 1.0, 1.0), (0.0, 1.1, 1.0)], [(0.0, 1.0), (1.0,)]]
)
def test_a_walk_along_no_table_is_an_error(table):
    with pytest.raises(RecordingError):
        person.walk(table)


# ---- Fig. 6 ------------------------------------------------------------------------------------------


def test_fig_6_comes_out_but_for_the_size_of_the_jerk(avoidance):
    """The jerk is larger for some steps, where the person suddenly walks faster (φ jumps by λ₁ Δv, about 0.7 m²), and
    where the filter lets go of the arm.
    """
    traces, limits = avoidance
    found = claims.avoidance_claims(traces, limits, PAPERS.d_min)
    assert {text for text, held in holds(found, PUBLISHED).items() if not held} == {
        "the jerk stays within about 2000 °/s³"
    }
    assert {claim.text for claim in found if claim.source == claims.ASKED} == {
        "the jerk stays within about 2000 °/s³",
        "the arm's critical link is the end effector",
        "the person's are left arm, core, head, core (4-2-1-2)",
    }
    # the same with the exact row and with all layers
    for name in traces:
        assert {text for text, held in holds(found, name).items() if not held} <= {
            "the jerk stays within about 2000 °/s³"
        }


# ---- Table 1 -----------------------------------------------------------------------------------------


@pytest.mark.long
def test_all_trends_of_table_1_come_out_as_published_and_with_the_exact_row(corners):
    found = claims.sensitivity_claims(corners)
    for shield in (PUBLISHED, EXACT):
        assert [text for text, held in holds(found, shield).items() if not held] == []
    assert all(claim.reproduced for claim in found)


@pytest.mark.long
def test_all_layers_keep_what_lambda1_does_to_distance_and_duration(corners):
    """They act from the first step on, so that nothing can begin earlier; the recovery rate and the rows of all pairs
    decide when they end.
    """
    held = holds(claims.sensitivity_claims(corners), OURS)
    assert held["λ₁ up: active for longer"]
    assert held["λ₁ up: larger minimum distance"]
    assert held["λ₂ up: smaller minimum distance"]
    assert not held["λ₁ up: triggered earlier"]
    assert not held["λ₁ up: the last trigger is later"]


def test_the_papers_own_table_bears_its_claims_out():
    found = claims.sensitivity_claims({PUBLISHED: reported.TABLE1})
    assert all(claim.verdicts[claims.PAPER].holds for claim in found)


def test_a_trend_that_goes_the_other_way_is_seen():
    backwards = {(14.0 - a, 14.0 - b): entry for (a, b), entry in reported.TABLE1.items()}
    found = claims.sensitivity_claims({PUBLISHED: backwards})
    assert not any(claim.reproduced for claim in found)
    level = dict.fromkeys(reported.TABLE1, Measures(0.3, None, None, 0.0, 0.5, 0.3))
    assert not any(claim.reproduced for claim in claims.sensitivity_claims({PUBLISHED: level}))


# ---- Fig. 8 ------------------------------------------------------------------------------------------


def test_the_ssa_saturates_more_but_comes_hardly_closer_and_acts_for_less():
    """Of Fig. 8, the saturated jerk and the restlessness come out. The person slows down so much that neither filter
    has much to do: the SSA comes 2 mm closer, and it forgets the approach that it has stopped.
    """
    traces, limits = experiments.comparison()
    baseline = traces.pop("SSA")
    found = claims.comparison_claims(baseline, traces, limits)
    assert holds(found, PUBLISHED) == {
        "SSA: smaller minimum distance": False,
        "SSA: active for longer": False,
        "SSA: the jerk saturates more often": True,
        "SSA: the distance fluctuates more (mean |D̈|)": True,
    }
    assert baseline.distance.min() < traces[PUBLISHED].distance.min()
    assert holds(found, OURS)["SSA: smaller minimum distance"]
    # nothing is smaller, longer or more than itself
    assert not any(claim.reproduced for claim in claims.comparison_claims(baseline, {"": baseline}, limits))


def test_ssa_is_closer_and_more_saturated_where_the_person_walks_faster():
    from jssa_gym.humans import ApproachRetreat

    def human():
        return ApproachRetreat(
            start=2.2, nearest=(0.8, 0.8), side=(0.0, 0.0), speed=(0.8, 0.8), wait=(0.1, 0.1), stay=(0.5, 0.5)
        )

    one, limits = experiments.play(experiments.ssa, "", 550, human())
    other, _ = experiments.play(lambda env: SHIELDS[PUBLISHED](env, 3.0, 1.0), "", 550, human())
    assert one.distance.min() < other.distance.min()
    assert claims.saturation(one, limits) > claims.saturation(other, limits)


# ---- Fig. 3 and 7 ------------------------------------------------------------------------------------


@pytest.mark.sampled(2)
@pytest.mark.parametrize("lambdas", [(3.0, 1.0), (6.0, 8.0), (2.0, 0.25)])
def test_the_fastest_approach_is_the_one_that_just_stops(lambdas):
    """An oracle of its own: the equation of Eq. (6) at 0, written down again, integrated from either side."""
    one, two = lambdas
    index = IndexParams(lambda1=one, lambda2=two)
    begin = np.array([0.05, 0.1, 0.3, 1.0])
    fastest = fastest_approach(index, begin)
    assert fastest[0] == 0.0

    def closest(distance, rate):
        def motion(_, y):
            return [y[1], (0.05**2 - y[0] * abs(y[0]) - one * y[1]) / two]

        return solve_ivp(motion, (0.0, 60.0), [distance, rate], rtol=1e-9, atol=1e-12, max_step=0.1).y[0].min()

    for distance, rate in zip(begin[1:], fastest[1:], strict=True):
        assert closest(distance, 0.98 * rate) > 0.05 - 1e-6
        assert closest(distance, 1.02 * rate) < 0.05 - 1e-6


def test_the_portraits_say_what_the_paper_says():
    found = index_claims.portrait_claims(PAPERS) + index_claims.shift_claims(PAPERS, 5.0, 3.0)
    assert len(found) == 4
    assert all(claim.reproduced for claim in found)


# ---- Fig. 10 -----------------------------------------------------------------------------------------


def test_the_handover_yields_and_replans_but_does_not_arrive():
    """φ ≤ 0 allows an approach of D²/λ₁ at most: at 0.3 m, 3 cm/s, far below what the controller plans."""
    from jssa_gym.paper.handover import deliver
    from jssa_gym.shields import JSSAShield

    run = deliver(JSSAShield.as_published, PUBLISHED, 450)
    bare = deliver(lambda env: env, "no shield", 600)
    found = handover_claims.handover_claims({PUBLISHED: run, "no shield": bare}, 0.05)
    assert list(holds(found, PUBLISHED).values()) == [True, True, True, False]
    # without a shield nothing yields, although the goal moves away from the arm
    assert list(holds(found, "no shield").values()) == [False, False, False, True]
    ahead = bare.error[bare.trace.time >= BEGIN]
    assert (ahead - np.minimum.accumulate(ahead)).max() > 0.1
    assert run.replans.sum() > bare.replans.sum()
    assert bare.error[-1] < 0.01
    assert bare.trace.distance.min() < 0.05 < run.trace.distance.min()


def delivery(avoidance, tip, goal, active, replans):
    """A handover along the x axis."""
    trace = avoidance[0][PUBLISHED]
    along = np.zeros((2, len(trace.time), 3))
    along[0, :, 0], along[1, :, 0] = tip, goal
    return Delivery(dataclasses.replace(trace, intervened=active), *along, replans, avoidance[1])


def test_only_the_arms_own_motion_counts_as_moving_away(avoidance):
    time = avoidance[0][PUBLISHED].time
    still, none = np.zeros(len(time)), np.zeros(len(time), bool)
    back = np.where(time > 3.0, -0.05, 0.0)
    before = np.where(time > 0.5, -0.05, 0.0)  # the delivery has not begun
    for tip, goal, expected in (
        (still, 1.0 + 0.1 * time, 0.0),
        (back, still + 1.0, 0.05),
        (before, still + 1.0, 0.0),
        (back, 2.0 - 0.1 * time, 0.05),
        (0.1 * time, still + 1.0, 0.0),
    ):
        assert handover_claims.retreat(delivery(avoidance, tip, goal, none, none)) == pytest.approx(expected, abs=1e-12)


def test_a_replan_goes_along_with_activity_only_soon_after_it(avoidance):
    count = len(avoidance[0][PUBLISHED].time)
    active = np.arange(count) == 300
    for steps, holding in ((0, True), (12, True), (13, False), (-1, False)):
        run = delivery(avoidance, 0.0, 1.0, active, np.arange(count) == 300 + steps)
        assert handover_claims.handover_claims({"": run}, 0.05)[1].reproduced == holding
    run = delivery(avoidance, 0.0, 1.0, active, np.zeros(count, bool))
    assert not handover_claims.handover_claims({"": run}, 0.05)[1].reproduced


# ---- words and commands ------------------------------------------------------------------------------


def test_critical_links_are_listed_in_their_order():
    assert claims.sequence(np.array([3, 3, 1, 0, 0, 1])) == (4, 2, 1, 2)
    assert claims.sequence(np.array([4])) == (5,)


def test_a_claim_is_reproduced_if_the_published_filter_bears_it_out():
    yes, no = Evidence(np.True_, ""), Evidence(np.False_, "")
    assert type(yes.holds) is bool
    assert Claim("", "", {claims.PAPER: no, PUBLISHED: yes, OURS: no}).reproduced
    assert not Claim("", "", {claims.PAPER: yes, PUBLISHED: no, OURS: yes}).reproduced


def test_one_line_of_three_is_a_part():
    one, two = Evidence(True, "1 of 3", partly=True), Evidence(True, "2 of 3")
    assert Claim("", "", {claims.PAPER: two, PUBLISHED: one, OURS: two}).extent == "partly reproduced"
    assert Claim("", "", {claims.PAPER: one, PUBLISHED: two, OURS: one}).extent == "reproduced"
    assert (
        Claim("", "", {claims.PAPER: two, PUBLISHED: Evidence(False, "1 of 3, 1 against")}).extent == "not reproduced"
    )
    for rising, extent in ((1, "partly reproduced"), (2, "reproduced"), (3, "reproduced")):
        table = {}
        for k, b in enumerate((6.0, 7.0, 8.0)):
            for a in (6.0, 8.0):
                distance = 0.4 if a == 8.0 and k < rising else 0.3
                table[a, b] = Measures(distance, None, None, 0.0, 0.5, 0.3)
        found = {claim.text: claim.extent for claim in claims.sensitivity_claims({PUBLISHED: table})}
        assert found["λ₁ up: larger minimum distance"] == extent


def run_command(monkeypatch, *arguments):
    """``jssa-gym reproduce`` in this process."""
    monkeypatch.setattr(sys, "argv", ["jssa-gym", "reproduce", *map(str, arguments)])
    main()


@pytest.mark.long
def test_reproduce_writes_a_picture_and_its_numbers(tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    run_command(monkeypatch, "fig6", "--out", tmp_path / "deep" / "out")
    printed = capsys.readouterr().out
    assert sorted(path.name for path in (tmp_path / "deep" / "out").iterdir()) == ["fig6.json", "fig6.png"]
    assert "not reproduced" in printed
    assert "0.446" in printed
    result = json.loads((tmp_path / "deep" / "out" / "fig6.json").read_text())
    assert result["measured"]["paper"]["min_distance"] == 0.446
    assert [claim["reproduced"] for claim in result["claims"]].count(False) == 1


@pytest.mark.parametrize(
    ("arguments", "reason"), [(("fig3", "--out", "file"), "cannot write to file"), (("fig5",), "")]
)
def test_reproduce_refuses_what_it_cannot_do(arguments, reason, tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("mine")
    with pytest.raises(SystemExit) as caught:
        run_command(monkeypatch, *arguments)
    assert caught.value.code == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    if reason:
        (line,) = (line for line in printed.err.splitlines() if line.strip())
        assert line.startswith(f"jssa-gym: {reason}")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("part", ["portraits", "shifts", "sensitivity", "handovers"])
def test_the_figures_have_their_panels(part):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    from jssa_gym import plots

    if part == "portraits":
        assert len(plots.portraits(PAPERS).axes) == 6
    elif part == "shifts":
        assert len(plots.shifts(PAPERS, 5.0, 3.0).axes) == 4
    elif part == "sensitivity":
        table = np.arange(8.0).reshape(2, 2, 2)
        table[..., 1] = np.nan
        figure = plots.sensitivity({"one": table}, (6, 7), (6, 7), ("a", "b"))
        assert [len(axes.texts) for axes in figure.axes] == [4, 0]
    else:
        trace, limits = experiments.play(lambda env: env, "bare", 20)
        run = Delivery(trace, np.zeros((20, 3)), np.ones((20, 3)), np.arange(20) == 5, limits)
        assert len(plots.handovers([run, run], 0.05).axes) == 8
