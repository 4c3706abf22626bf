"""Ctrl-C, once and again, and processes that cannot begin: what is finished is kept, nobody is left behind."""

import contextlib
import signal
import subprocess
import sys
import textwrap
import threading
from types import SimpleNamespace

import picklable
import pytest
from interrupted import ended, interrupt, start
from places import PATIENCE

import jssa_gym.cli
from jssa_gym.cli import compare, evaluate, stress
from jssa_gym.engine import workers
from jssa_gym.engine.workers import run
from jssa_gym.evaluation.runner import complete
from jssa_gym.evaluation.study import Study
from jssa_gym.exceptions import ParameterError, WorkerError

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals of this kind")


# ---- work ----------------------------------------------------------------------------------------------

WORK = """
import sys
from picklable import one_then_lasting
from jssa_gym.engine.workers import run
if __name__ == "__main__":
    try:
        run(one_then_lasting, range(4), int(sys.argv[1]), lambda found: print("kept", *found))
    except KeyboardInterrupt:
        print("interrupted")
        sys.exit(130)
"""


@pytest.mark.long
@pytest.mark.parametrize(("jobs", "times"), [(1, 2), (2, 1), (2, 2)])
def test_an_interrupt_ends_work_at_once_and_keeps_what_was_finished(tmp_path, jobs, times):
    (tmp_path / "work.py").write_text(WORK)
    process = start(str(tmp_path / "work.py"), str(jobs))
    begun = [process.stdout.readline() for _ in range(jobs)]
    interrupt(process, times)
    out, err = ended(process)
    assert sorted(begun) == [f"begun {number}\n" for number in range(jobs)]
    # the second one may come when all is over but the interpreter
    assert process.returncode in ((130,) if times == 1 else (130, -signal.SIGINT)), err
    kept = sorted(line for line in out.splitlines() if line.startswith("kept"))
    assert kept == [f"kept {number}" for number in range(jobs)]
    assert times == 2 or out.endswith("interrupted\n")
    assert "Traceback" not in err or times == 2


@pytest.mark.long
def test_a_command_that_is_interrupted_twice_goes_on_from_what_it_played(tmp_path):
    options = ("--episodes", "3000", "--filter", "none", "--human", "none", "--policy", "hold", "--jobs", "2")
    process = start("-m", "jssa_gym", "evaluate", *options, "--seconds", "1", "--out", str(tmp_path / "out"))
    table = tmp_path / "out" / "episodes.csv"
    while process.poll() is None and not (table.exists() and table.read_bytes()):
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(0.05)
    interrupt(process, 2)
    _, err = ended(process)
    assert process.returncode in (130, -signal.SIGINT)
    played = len(table.read_text().splitlines()) - 1
    assert 0 < played < 3000
    assert f"stopped; the same command goes on from {played} episodes in" in " ".join(err.split())
    assert err.count("stopped") == 1
    # and it does
    study = Study(("reach",), ("none",), ("none",), ("hold",), 3000, steps=125)
    seen = []

    def stop(done, total):
        seen.append(done)
        if len(seen) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        complete(study, tmp_path / "out", progress=stop)
    assert seen[0] == played < seen[1] < 3000


@pytest.mark.long
@pytest.mark.parametrize("jobs", [1, 2])
def test_errors_come_out_of_workers_and_keep_what_was_finished(jobs):
    kept = []
    with pytest.raises(ParameterError, match="seven"):
        run(picklable.failing_at_seven, [[1, 2], [6, 7, 8]], jobs, kept.extend)
    assert {6} <= set(kept) <= {1, 2, 6}
    with pytest.raises(WorkerError if jobs > 1 else picklable.DemandingError, match="a and b"):
        run(picklable.failing_to_tell, [1], jobs, kept.extend)


@pytest.mark.long
def test_a_worker_that_ends_by_itself_was_not_killed(monkeypatch):
    monkeypatch.setattr(workers, "LAST_BREATH", PATIENCE)  # an interpreter takes its time to end where much else runs
    with pytest.raises(WorkerError, match=r"ended by itself; what had ended .* is kept"):
        run(picklable.leaving, [1], 2, id)


@pytest.mark.long
def test_work_of_a_process_that_is_killed_is_begun_anew_and_handed_over_once(tmp_path):
    found = []
    run(picklable.dying_first, [(number, tmp_path) for number in range(3)], 2, found.append)
    assert (tmp_path / "died").exists()
    assert sorted(found) == [[0, 0], [1, 10], [2, 20]]


@pytest.mark.long
def test_processes_that_are_killed_again_and_again_are_one_line_that_says_how_to_go_on():
    found = []
    with pytest.raises(WorkerError, match="same call goes on"):
        run(picklable.killed, range(3), 2, found.extend)
    assert set(found) <= {0, 2}
    assert len(set(found)) == len(found)


@pytest.mark.long
def test_a_process_that_is_killed_while_it_begins_in_place_of_another_is_replaced_too(tmp_path, monkeypatch):
    class Frail(workers.Worker):
        killed = 0

        def __init__(self, play, interrupts, task=None):
            super().__init__(play, interrupts, task)
            if task is not None and Frail.killed < 2:
                Frail.killed += 1
                self.process.kill()

    monkeypatch.setattr(workers, "Worker", Frail)
    found = []
    run(picklable.dying_first, [(number, tmp_path) for number in range(3)], 2, found.append)
    assert Frail.killed == 2
    assert sorted(found) == [[0, 0], [1, 10], [2, 20]]


@pytest.mark.long
def test_what_was_finished_is_kept_even_if_those_that_begin_anew_finish_less(tmp_path):
    found = []
    with pytest.raises(WorkerError, match="same call goes on"):
        run(picklable.dying_ever_earlier, [(7, tmp_path)], 2, found.append)
    assert found == [[7]]


@pytest.fixture
def listening():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_done_is_not_interrupted(listening):
    seen = []

    def done(found):
        signal.raise_signal(signal.SIGINT)
        seen.extend(found)

    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        run(lambda number: [number], range(5), 1, done)
    assert seen == [0]
    assert signal.getsignal(signal.SIGINT) is before


def test_one_that_somebody_swallows_is_asked_for_again(listening):
    """As those are that come in a ``__del__``, or in a callback that catches everything."""

    def play(number):
        with contextlib.suppress(KeyboardInterrupt) if number == 0 else contextlib.nullcontext():
            signal.raise_signal(signal.SIGINT)
        yield number

    seen = []
    with pytest.raises(KeyboardInterrupt):
        run(play, range(5), 1, seen.extend)
    assert seen == [0]


def test_one_that_somebody_swallows_is_asked_for_again_of_workers(listening, monkeypatch):
    waits = []

    def wait(links):
        waits.append(links)
        assert len(waits) < 3
        with contextlib.suppress(KeyboardInterrupt) if len(waits) == 1 else contextlib.nullcontext():
            signal.raise_signal(signal.SIGINT)
        return []

    monkeypatch.setattr(workers, "connection", SimpleNamespace(wait=wait))
    with pytest.raises(KeyboardInterrupt):
        run(picklable.lasting, range(2), 2, id)
    assert len(waits) == 2


@pytest.mark.long
def test_what_was_sent_and_not_read_is_kept(listening, tmp_path):
    seen = []

    def done(found):
        seen.extend(found)
        if found == ["first"]:
            (tmp_path / "go").touch()
            picklable.wait_for(tmp_path / "sent")
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        run(picklable.relay, [("first", tmp_path), ("second", tmp_path)], 2, done)
    assert seen == ["first", 0, 1, 2]


def test_those_that_hang_are_waited_for_together(monkeypatch):
    now = [0.0]

    class Hung:
        """A worker, its process and its link."""

        killed = False

        def __init__(self):
            self.process = self.link = self

        def join(self, timeout=None):
            assert timeout is not None or self.killed
            now[0] += timeout or 0.0

        def kill(self):
            self.killed = True

        def close(self):
            pass

        drain = close

    monkeypatch.setattr(workers.time, "monotonic", lambda: now[0])
    hung = [Hung() for _ in range(5)]
    workers.end_all(hung, workers.LAST_BREATH)
    assert all(worker.killed for worker in hung)
    assert now[0] == workers.LAST_BREATH


def test_work_can_be_done_in_a_thread():
    seen = []
    thread = threading.Thread(target=run, args=(lambda number: [number], range(3), 1, seen.extend))
    thread.start()
    thread.join()
    assert seen == [0, 1, 2]


# ---- commands ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["demo", "bench", "reproduce", "certify", "train", "compare", "stress", "evaluate"])
def test_every_command_answers_an_interrupt_with_a_line(monkeypatch, capsys, tmp_path, command):
    kind = next(one for name, one in vars(jssa_gym.cli).items() if name == command.capitalize())

    def pressed(self):
        raise KeyboardInterrupt

    monkeypatch.setattr(kind, "run", pressed)
    monkeypatch.setattr(sys, "argv", ["jssa-gym", command])
    with pytest.raises(SystemExit) as end:
        jssa_gym.cli.main()
    assert end.value.code == 130
    assert capsys.readouterr().err == "jssa-gym: stopped; give the same command again\n"


@pytest.mark.parametrize(
    ("module", "name", "kind"),
    [
        (evaluate, "complete", evaluate.Evaluate),
        (evaluate, "complete", compare.Compare),
        (stress, "finish", stress.Stress),
    ],
)
def test_campaigns_say_where_they_go_on(monkeypatch, capsys, tmp_path, module, name, kind):
    def pressed(*told, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, name, pressed)
    with pytest.raises(SystemExit) as end:
        kind(out=tmp_path / "x").run()
    assert end.value.code == 130
    assert "the same command goes on from 0 episodes" in " ".join(capsys.readouterr().err.split())


# ---- processes that cannot begin -----------------------------------------------------------------------

SCRIPT = 'import jssa_gym\njssa_gym.evaluate("jssa_gym/Home-v0", "hold", 2, steps=5, jobs=2)\n'
GUARD = 'if __name__ == "__main__"'


@pytest.mark.long
@pytest.mark.parametrize("stdin", [False, True])
def test_a_script_without_a_main_guard_is_told_of_it(tmp_path, stdin):
    (tmp_path / "script.py").write_text(SCRIPT)
    with (tmp_path / "script.py").open() as file:
        process = start("-" if stdin else str(tmp_path / "script.py"), stdin=file if stdin else subprocess.DEVNULL)
        _, err = ended(process)
    assert process.returncode == 1
    assert GUARD in err.splitlines()[-1]
    assert "jobs=1" in err.splitlines()[-1]
    assert "memory" not in err


@pytest.mark.long
def test_what_only_a_prompt_knows_is_asked_for_in_a_module():
    code = """
        import jssa_gym, numpy as np
        def act(observation): return np.zeros(6)
        jssa_gym.evaluate("jssa_gym/Home-v0", act, 2, steps=5, jobs=2)
    """
    process = start("-c", textwrap.dedent(code))
    _, err = ended(process)
    assert process.returncode == 1
    assert "attribute 'act'" in err.splitlines()[-1]
    assert "belong into a module" in err.splitlines()[-1]


@pytest.mark.slow
def test_a_training_in_processes_without_a_main_guard_is_told_of_it(tmp_path):
    pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    (tmp_path / "script.py").write_text(
        "from jssa_gym.train import TrainConfig, train\n"
        f"train(TrainConfig(processes=True), {str(tmp_path / 'out')!r})\n"
    )
    process = start(str(tmp_path / "script.py"))
    _, err = ended(process)
    assert process.returncode == 1
    assert GUARD in err.splitlines()[-1]
