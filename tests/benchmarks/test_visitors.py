"""The people and the camera of ``benchmarks/visitors.py``: what its figures are about, and that a run can go on."""

import runpy
import sys

import numpy as np
import pytest
from places import ROOT

from jssa_gym import ArmEnv

BENCH = runpy.run_path(str(ROOT / "benchmarks" / "visitors.py"))
Camera, Raiders, HALF, ERROR, DT = (BENCH[name] for name in ("Camera", "Raiders", "HALF", "ERROR", "DT"))


@pytest.mark.long
def test_the_camera_is_late_imprecise_and_forgets_nobody_who_comes_in():
    env, known, hidden, numbers = Camera(ArmEnv(human=Raiders(), terminate_on=())), set(), 0, set()
    truths = []
    env.reset(seed=1)
    for k in range(300):
        truth, scene = env.unwrapped.scene.human, env.scene
        truths.append(truth)
        if np.isnan(scene.frame_age):
            assert k < BENCH["LATE"]
            assert not len(scene.human.radius)
        else:
            then = truths[k - round(scene.frame_age / DT)]
            numbers.add(len(scene.human.radius) // 6)
            assert BENCH["LATE"] * DT <= scene.frame_age + 1e-9 < (BENCH["LATE"] + BENCH["PERIOD"]) * DT
            assert sorted(set(scene.human.person)) == sorted(set(then.person))
            hidden += not scene.valid.all()
            # every measured capsule is somebody's of that moment
            for start in scene.human.start[scene.valid]:
                assert np.linalg.norm(then.start - start, axis=1).min() <= ERROR + 1e-9
            inside = {
                who
                for who in set(then.person)
                if np.abs(then.start[then.person == who]).max(axis=0)[:2].max() < HALF - 0.7
            }
            known |= {int(who) for who in scene.human.person[scene.valid]}
            assert inside <= known
        env.step(np.zeros(6))
    assert hidden > 3
    assert len(numbers) > 2


def test_a_run_goes_on_where_it_was(monkeypatch, capsys, tmp_path):
    main = BENCH["main"]
    monkeypatch.setitem(main.__globals__, "TICKS", 5)
    out = tmp_path / "found.jsonl"
    for episodes in (1, 3):
        monkeypatch.setattr(sys, "argv", ["", "--episodes", str(episodes), "--shields", "no shield", "--out", str(out)])
        assert main() == 0
        assert len(out.read_text().splitlines()) == episodes
        assert f"| no shield | {episodes} |" in capsys.readouterr().out
