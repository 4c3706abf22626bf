"""Work on a Ray cluster of this machine: the same numbers, whoever dies, and nothing twice."""

import sys
from dataclasses import replace

import picklable
import pytest
from interrupted import ended, interrupt, start

from jssa_gym.certificate.certify import certify
from jssa_gym.certificate.lambda_map import sweep
from jssa_gym.cli import main
from jssa_gym.engine import Cluster, cluster
from jssa_gym.engine.workers import run
from jssa_gym.evaluation.campaign import Campaign, Grid
from jssa_gym.evaluation.ledger import Ledger
from jssa_gym.evaluation.play import play
from jssa_gym.evaluation.runner import complete
from jssa_gym.exceptions import MissingExtraError, ParameterError, WorkerError

pytestmark = pytest.mark.long
TWO = Cluster(2)


@pytest.fixture(scope="module", autouse=True)
def cluster_ends():
    ray = pytest.importorskip("ray")
    yield
    ray.shutdown()


def test_a_cluster_counts_the_same_as_this_process(tmp_path):
    def kept(reports):
        return [
            (one.setting, [(e.seed, e.digest) for e in one.episodes], [t.name for t in one.traces]) for one in reports
        ]

    here, there = complete(picklable.TINY, tmp_path / "here"), complete(picklable.TINY, tmp_path / "there", jobs=TWO)
    assert kept(here) == kept(there)
    tables = [(tmp_path / name / "episodes.csv").read_text().splitlines() for name in ("here", "there")]
    assert len(tables[0]) == len(tables[1]) == 13


def test_certificates_too():
    options = {"capsules": ("elbow",), "states": 300, "search": False}
    assert certify(**options).as_json() == certify(**options, jobs=TWO).as_json()


def test_the_map_of_lambdas_too():
    options = {"grid": 2, "states": 30, "lambda1": (0.5, 1.2), "capsules": ("elbow",)}
    told = []
    here = sweep(**options, progress=told.append)
    assert sum(told) == 0  # every pair that was to come is told of
    assert here.as_json() == sweep(**options, jobs=TWO).as_json() == sweep(**options, jobs=2).as_json()


@pytest.mark.parametrize("jobs", [TWO, 2], ids=["ray", "processes"])
def test_a_campaign_whose_worker_was_killed_lacks_nothing_and_has_nothing_twice(tmp_path, jobs):
    campaign = Campaign((Grid(("full", "none"), ("pursuit",), ("wander",), ("none",), 3),), steps=120, judge=0.0)

    def rows(folder):
        return sorted((replace(row, wall=0.0) for row in Ledger(folder, campaign).episodes), key=str)

    whole, killed = Ledger(tmp_path / "whole" / "c", campaign), Ledger(tmp_path / "killed" / "c", campaign)
    run(play, whole.chunks(3), 1, whole.append)
    run(picklable.playing_but_dying_first, killed.chunks(3), jobs, killed.append)
    assert next(tmp_path.rglob("died"))
    assert rows(tmp_path / "whole" / "c") == rows(tmp_path / "killed" / "c")
    assert len(rows(tmp_path / "killed" / "c")) == 6


def test_work_of_a_worker_that_dies_is_done_again_and_handed_over_once(tmp_path):
    found = []
    run(picklable.dying_first, [(number, tmp_path) for number in range(4)], TWO, found.append)
    assert (tmp_path / "died").exists()
    assert sorted(found) == [[0, 0], [1, 10], [2, 20], [3, 30]]


def test_workers_that_die_again_and_again_end_it_and_what_was_finished_is_kept():
    found = []
    with pytest.raises(WorkerError, match=r"lost .* is kept, and the same call goes on"):
        run(picklable.killed, [0, 1], TWO, found.extend)
    assert found == [0]


def test_errors_come_out_of_workers_and_keep_what_was_finished():
    found = []
    with pytest.raises(ParameterError, match="seven") as caught:
        run(picklable.failing_at_seven, [[1, 2], [6, 7, 8]], TWO, found.extend)
    assert 6 in found  # of the other chunk, which may be under way, nothing or all
    assert sorted(found) in ([6], [1, 2, 6])
    assert "in a worker process" in caught.value.__notes__[0]


def test_a_machine_with_another_version_is_refused(monkeypatch):
    monkeypatch.setattr(cluster, "source_hash", lambda: "another")
    with pytest.raises(WorkerError, match="another version of jssa_gym"):
        run(picklable.killed, [0], TWO, print)


def test_one_process_is_with_one_cluster():
    run(picklable.failing_at_seven, [[1]], TWO, print)
    with pytest.raises(WorkerError, match=r"is with .*jobs=2.* already"):
        run(picklable.failing_at_seven, [[1]], Cluster(3), print)


WORK = """
from picklable import lasting
from jssa_gym.evaluation import Cluster
from jssa_gym.engine.workers import run
if __name__ == "__main__":
    run(lasting, range(4), Cluster(2), print)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals of this kind")
def test_an_interrupt_ends_it(tmp_path):
    (tmp_path / "work.py").write_text(WORK.replace("run(lasting", "print('begun', flush=True)\n    run(lasting"))
    process = start(str(tmp_path / "work.py"))
    assert process.stdout.readline() == "begun\n"
    interrupt(process, 1)
    _, err = ended(process)
    assert err.splitlines()[-1].startswith("KeyboardInterrupt")


@pytest.mark.parametrize(("message", "starts"), [("The current node timed out during startup.", 4), ("no room", 1)])
def test_a_cluster_that_a_busy_machine_is_slow_to_begin_is_begun_again(monkeypatch, message, starts):
    ray, begun = pytest.importorskip("ray"), []

    def init(**options):
        begun.append(options)
        raise RuntimeError(message)

    monkeypatch.setattr(ray, "init", init)
    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    monkeypatch.setattr(ray, "shutdown", lambda: None)
    with pytest.raises(WorkerError, match=message):
        run(picklable.killed, [0], TWO, print)
    assert len(begun) == starts


def test_ray_is_an_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(MissingExtraError, match=r"Ray is not installed: pip install .*jssa-gym\[ray\]"):
        run(picklable.killed, [0], TWO, print)


@pytest.mark.parametrize("wrong", [{"jobs": 0}, {"jobs": 1.5}, {"address": ""}, {"address": 7}])
def test_what_is_no_cluster_is_refused(wrong):
    with pytest.raises(ParameterError, match=next(iter(wrong))):
        Cluster(**wrong)


@pytest.mark.parametrize("command", ["evaluate", "compare", "stress", "certify"])
def test_an_address_needs_somebody_who_asks_it(command, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["jssa-gym", command, "--address", "auto", "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code
    assert "--engine ray" in capsys.readouterr().err
    assert not (tmp_path / "out" / "episodes.csv").exists()
