"""What a control step costs, now and at another commit, side by side: decisions, env.step, many arms, compilation.

    python benchmarks/control_step.py --before ../jssa_gym-before

The other commit's folder comes from ``git worktree add ../jssa_gym-before COMMIT``. Each tree is measured in processes
of its own, in turns; times are medians and 99th percentiles of single calls [µs], of many
arms the median processor time an arm.
"""

import argparse
import gc
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

BEGUN = time.perf_counter()

ROOT = Path(__file__).parents[1]

KINDS = ("jssa", "stop", "jssa+stop", "work")
"""Shields of which many arms are timed at once."""


def decisions() -> dict[str, list[float]]:
    """Times of ``filter.decide`` with all layers by status, and of ``step``, in seconds."""
    import gymnasium as gym

    import jssa_gym

    times: dict[str, list[float]] = {}
    gc.disable()
    for human, policy in (("walk_by", "wander"), ("pursuit", "bang_bang")):
        env = gym.make("jssa_gym/Home-v0", human=human, terminate_on=())
        base, env = env.unwrapped, jssa_gym.JSSAShield(env)
        chosen, decide = jssa_gym.POLICIES[policy](base, 1), env.filter.decide

        def timed(scene, nominal, decide=decide):
            start = time.perf_counter()
            decision = decide(scene, nominal)
            times.setdefault(decision.status.name, []).append(time.perf_counter() - start)
            return decision

        env.filter.decide = timed
        for seed in range(4):
            observation, _ = env.reset(seed=seed)
            for _ in range(600):
                action = chosen(observation)
                start = time.perf_counter()
                observation, *_ = env.step(action)
                times.setdefault("step", []).append(time.perf_counter() - start)
    return times


def together(kind: str, count: int = 1024, ticks: int = 250) -> dict[str, float]:
    """Processor time an arm of one compiled loop over many arms [s], compared bit for bit with a single filter's."""
    import importlib.util

    import gymnasium as gym
    import numpy as np

    import jssa_gym

    if importlib.util.find_spec("jssa_gym.shields.batch") is None:
        return {}  # the code from before there was a loop
    from jssa_gym.evaluation.study import put_filter
    from jssa_gym.shields.batch import Batch

    env = gym.make("jssa_gym/Home-v0", human="walk_by", terminate_on=())
    base, shield = env.unwrapped, put_filter(env, kind)
    observation, _ = shield.reset(seed=0)
    policy, shown = jssa_gym.POLICIES["wander"](base, 1), []
    for _ in range(ticks):
        scene = base.scene
        observation, *_ = shield.step(policy(observation))
        shown.append((scene, shield.last_decision.nominal))
    single = put_filter(gym.make("jssa_gym/Home-v0", human="walk_by"), kind).filter
    batch = Batch(single, count, shown[0][0].human.names, planes=len(base.planes.offset))
    alone, decided, many, to = [], [], [], batch.scene
    single.reset(shown[0][0])
    for scene, jerk in shown:
        start = time.perf_counter()
        decision = single.decide(scene, jerk)
        alone.append(time.perf_counter() - start)
        decided.append((decision.jerk, single.records.answer.told[0].item()))
    for k, (scene, jerk) in enumerate(shown):
        to.now["time"], to.joints[:], to.ends[:] = scene.time, scene.robot, np.array(scene.human[:4])[None]
        to.radius[:], to.person[:], to.age[:], to.valid[:] = (
            scene.human.radius, scene.human.person, scene.age, scene.valid
        )  # fmt: skip
        to.normal[:], to.offset[:] = scene.planes.normal, scene.planes.offset
        if k == 0:
            batch.start()
        nominal = np.tile(jerk, (count, 1))
        start = time.process_time()
        answer = batch.decide(nominal)
        many.append((time.process_time() - start) / count)
        assert (answer.jerk == decided[k][0]).all()
        assert all(repr(told.item()) == repr(decided[k][1]) for told in answer.told)
    return {"many": float(np.median(many)), "alone": float(np.median(alone))}


def compilation() -> dict[str, float]:
    """From nothing to the first shielded steps: by the clock, and processor time of this process and another [s]."""
    import resource

    import gymnasium as gym

    import jssa_gym

    env = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", human="walk_by", terminate_on=()))
    env.reset(seed=0)
    for _ in range(3):
        env.step(env.action_space.sample())
    other = resource.getrusage(resource.RUSAGE_CHILDREN)
    times = {"clock": time.perf_counter() - BEGUN, "here": time.process_time()}
    return {**times, "elsewhere": other.ru_utime + other.ru_stime}


def measured(tree: Path, what: str, *of: str, cache: str | None = None) -> object:
    """The answer of one of the functions above, ``of`` something, in a process that imports ``tree``'s package."""
    environment = {**os.environ, "PYTHONPATH": str(tree)} | ({"NUMBA_CACHE_DIR": cache} if cache else {})
    command = [sys.executable, __file__, "--measure", what, *of]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, cwd=tree)
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", type=Path, help="folder of the other commit")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--measure", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        what, *of = options.measure
        print(json.dumps({"decisions": decisions, "together": together, "compilation": compilation}[what](*of)))
        return
    import numpy as np

    from jssa_gym.evaluation.identity import made_with

    print(made_with())
    trees = {"now": ROOT} | ({"before": options.before.resolve()} if options.before else {})
    times: dict[str, dict[str, list[float]]] = {name: {} for name in trees}
    for _ in range(options.rounds):
        for name, tree in trees.items():
            for what, values in measured(tree, "decisions").items():
                times[name].setdefault(what, []).extend(values)
    for what in times["now"]:
        line = f"{what:10}"
        for name in trees:
            values = 1e6 * np.array(times[name][what])
            line += f"  {name} {np.median(values):6.1f} us, 99 % {np.percentile(values, 99):6.1f}"
        if options.before:
            line += f"  ratio {np.median(times['now'][what]) / np.median(times['before'][what]):.2f}"
        print(line)
    for kind in KINDS:
        for name, tree in trees.items():
            if not (loop := measured(tree, "together", kind)):
                continue
            many, alone = 1e6 * loop["many"], 1e6 * loop["alone"]
            print(f"1024 arms, {kind:9} {name:6} {many:5.1f} us an arm, the single call {alone:5.1f} us: ", end="")
            print(f"{alone / many:.1f} times; bitwise equal")
    for name, tree in trees.items():
        with tempfile.TemporaryDirectory() as cache:
            first, again = (measured(tree, "compilation", cache=cache) for _ in range(2))
        spent = " and ".join(f"{first[where]:.1f}" for where in ("here", "elsewhere") if first[where])
        print(f"first use {name}: {first['clock']:.1f} s by the clock, {spent} s of processor time; ", end="")
        print(f"again {again['clock']:.1f} s and {again['here']:.1f} s")


if __name__ == "__main__":
    main()
