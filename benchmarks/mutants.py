"""Mutation testing of the shield: each guard is broken once, and some test has to notice.

    python benchmarks/mutants.py                 # all, a quarter of an hour on one core
    python benchmarks/mutants.py age tail        # those whose name contains one of the words

A mutant is a substitution in the source of a copy of the package; the tests that are to notice it run on that copy
with kernels that are not compiled (compiling each mutant takes longer than its tests). Exit status 1 if one survives,
or if a substitution no longer fits the source.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
TIMEOUT = 300.0
"""A mutant that keeps its tests busy for longer is noticed too [s]."""

PEERS = "[ssa or -ssa or sss or cbf or pfm or sma or ssm or [stop or -stop"
"""Cases of other filters than the shield's own, which would only repeat what those of the shield notice."""

KERNELS = "tests/kernels/test_verification.py"
FILTERS = "tests/shields/test_failsafe.py"
JOINTS = "tests/safety/test_joints.py"
ASSUMPTIONS = (FILTERS, "every_assumption or contact_speed")
FAULTS = (FILTERS, "a_fault_ends and 3 or sick or elsewhere or clocks or missed")
PROMISES = (FILTERS, "whatever_anybody_does or rejected_for_good")
ROWS = (FILTERS, "rows_ask and (0.2 or 0.5)")
MOTION = (KERNELS, "agree or rest or spinning or foreseen or touch_is or single_joint or endless")
NUMBERS = (KERNELS, "no_number or fixtures or deviation")
CHOICE = (KERNELS, "choice or every_instant or within_the_step")


class Mutant(NamedTuple):
    """One way to break the shield."""

    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, str]
    """A test file and an expression that chooses of its tests."""


def _kernel(name, old, new, tests=MOTION):
    return Mutant(name, "kernels/verification.py", old, new, tests)


def _guard(name, old, new, tests=ASSUMPTIONS):
    return Mutant(name, "shields/failsafe.py", old, new, tests)


def _joints(name, old, new, tests=(JOINTS, "test_monitor_ or rebased")):
    return Mutant(name, "kernels/joints.py", old, new, tests)


def _monitor(name, old, new, tests=(JOINTS, "test_monitor_ or rebased")):
    return Mutant(name, "safety/joints.py", old, new, tests)


def _filter(name, old, new, tests=FAULTS):
    return Mutant(name, "shields/filter.py", old, new, tests)


PERSON = """                radii = robot["radius"] + agent["radius"]
                gap, _, _ = capsule_pair(robot["start"], robot["end"], agent["start"], agent["end"], radii)"""
STATIC = """                radii = robot["radius"] + static["radius"]"""
FAILED = """            reason = f"the filter failed: {type(error).__name__}: {error}"
            self._log(reason)
            return self._brake(nominal, reason)"""
ROW = """        row[j] = -slope"""

MUTANTS = [
    # what a verification looks at
    _kernel("robot's radius dropped", PERSON, PERSON.replace('robot["radius"] + ', "", 1)),
    _kernel("person's radius dropped", PERSON, PERSON.replace(' + agent["radius"]', "", 1)),
    _kernel("static's radius dropped", STATIC, STATIC.replace(' + static["radius"]', "")),
    _kernel("reach dropped", "gap - reach[k] - speed[k] * t", "gap - speed[k] * t"),
    _kernel("v t of the person dropped", "gap - reach[k] - speed[k] * t", "gap - reach[k]"),
    _kernel("person's speed not in the closing speed", "/ (rate + speed[k])", "/ max(rate, 1e-9)"),
    _kernel("first tick not checked", "end, t = dt * (1 + ticks), 0.0", "end, t = dt * (1 + ticks), dt"),
    _kernel("last ticks not checked", "end, t = dt * (1 + ticks), 0.0", "end, t = dt * (1 + ticks // 2), 0.0"),
    _kernel(
        "present speed instead of the largest to come",
        "fastest[j] = peak_speed(after[1, j], after[2, j], stop, dt, t - dt)",
        "fastest[j] = abs(stop_at(after[0, j], after[1, j], after[2, j], stop, dt, t - dt)[1])",
    ),
    _kernel("the stop's speed not foreseen in the step", "max(max(abs(now), turn), later)", "max(abs(now), turn)"),
    _kernel("the step's turning point forgotten", "max(max(abs(now), turn), later)", "max(abs(now), later)"),
    _kernel("spin forgotten", 'spin += (levers[i, j] + robot["radius"])', "spin += levers[i, j]"),
    _kernel(
        "half-spaces skipped",
        "for k in range(planes.shape[0]):\n                if stands",
        "for k in range(0):\n                if stands",
    ),
    _kernel("statics skipped", "            for k in range(statics.shape[0]):", "            for k in range(0):"),
    _kernel("self pairs skipped", "for k in range(self_pairs.shape[0]):", "for k in range(0):"),
    _kernel(
        "one joint between self pairs forgotten",
        'range(one["link"] + 1, two["link"] + 1)',
        'range(one["link"] + 1, two["link"])',
    ),
    _kernel("margin of self pairs dropped", "gap - 2.0 * margin", "gap"),
    _kernel("too many looks read as safe", "return UNDECIDED, -1, -1, t", "return SAFE, -1, -1, t"),
    _kernel(
        "NaN distance of a person passes",
        "if not (lasts > _SHORTEST):\n                    return REACH",
        "if lasts <= _SHORTEST:\n                    return REACH",
        NUMBERS,
    ),
    _kernel(
        "NaN half-space passes",
        "if not (abs(length2 - 1.0) < 1e-6 and np.isfinite(offset[j])):",
        "if abs(length2 - 1.0) >= 1e-6:",
        NUMBERS,
    ),
    _joints(
        "NaN does not deviate",
        "if not abs(state[row, j] - expected[row, j]) <= allowed + ROUNDING * limit:",
        "if abs(state[row, j] - expected[row, j]) > allowed + ROUNDING * limit:",
    ),
    _joints("deviations are allowed for", "<= allowed + ROUNDING * limit", "<= allowed + 1e-3 * limit"),
    _joints(
        "a frozen reading is no fault", "if repeated and deviates(expected, anchor, bounds, tolerance):", "if False:"
    ),
    _joints("a lag is not recognised", "for k in range(past.shape[0]):", "for k in range(0):"),
    _monitor(
        "expectation follows the reading",
        "        if code != AGREES:\n",
        "        self.expected[:] = reading.state\n        if code != AGREES:\n",
    ),
    _monitor(
        "a wrong reading is forgotten at once",
        "self._owed = AGREEMENTS << min(self._lapses - 1, _DOUBLINGS)",
        "self._owed = 0",
    ),
    _monitor("relapses are forgotten", "AGREEMENTS << min(self._lapses - 1, _DOUBLINGS)", "AGREEMENTS"),
    _monitor(
        "a clock that stands still is believed", "if not (last < now < math.inf or", "if not (last <= now < math.inf or"
    ),
    _monitor("a lag of the clock is forgotten", "if self._offset < self._due:", "if False:"),
    _monitor("masked joints are read", "if isinstance(values, np.ma.MaskedArray):", "if False:"),
    _monitor("single precision is read", 'kind == "f" and size < 8', "False"),
    _monitor("rebased in motion", "if not at_rest(self.expected):", "if False:"),
    _monitor("rebased to a moving arm", "if not self.agrees(self._reading, still):", "if False:"),
    _monitor("noise is reckoned with", "self.begun = self.agrees(self._reading, self.expected)", "self.begun = False"),
    _kernel(
        "one part's contact speed for everybody",
        "spin <= max(touch[k], REST)",
        "spin <= max(touch.max(), REST)",
        ASSUMPTIONS,
    ),
    # how a jerk is chosen
    _kernel("limits check skipped", "if keeps_limits(state, jerk, after, plan, bounds, dt):", "if True:", CHOICE),
    _kernel("the step's limits not checked", "if not step_keeps(", "if False and not step_keeps(", CHOICE),
    _kernel("the stop's limits not checked", "if not stop_keeps(", "if False and not stop_keeps(", CHOICE),
    _kernel("half-way jerk not verified", "if code == SAFE:", "if code == SAFE or attempt == 1:", CHOICE),
    _kernel(
        "tail one tick ahead",
        "stop_jerk(stored, tick, jerk)\n    integrate",
        "stop_jerk(stored, tick + 1, jerk)\n    integrate",
        CHOICE,
    ),
    _kernel(
        "tail instead of which the wanted goes on",
        "    stop_jerk(stored, tick, jerk)\n    integrate",
        "    jerk[:] = wanted\n    integrate",
        CHOICE,
    ),
    # what the stored stop is
    Mutant("tail's ramp one tick longer", "kernels/stopping.py", "if left < 0:", "if left <= 0:", PROMISES),
    Mutant(
        "peak within the ramp forgotten",
        "kernels/stopping.py",
        'if stop["jerk_in"] != 0.0 and t < -a / stop["jerk_in"] < end:',
        "if False:",
        MOTION,
    ),
    Mutant(
        "jerk limit of stops twice as large",
        "kernels/stopping.py",
        "step = J * tau\n",
        "step = 2.0 * J * tau\n",
        CHOICE,
    ),
    Mutant(
        "levers halved",
        "safety/failsafe.py",
        "max(out[i, j], across + beyond)",
        "max(out[i, j], 0.5 * (across + beyond))",
        (KERNELS, "levers"),
    ),
    Mutant(
        "levers of the last link only",
        "safety/failsafe.py",
        "beyond += np.linalg.norm(arm)",
        "beyond += 0.0",
        (KERNELS, "levers"),
    ),
    _guard("stored stop not swapped", "self._stored, self._next = self._next, self._stored\n", "pass\n", PROMISES),
    _guard(
        "stored stop's tick not reset",
        "self._tick, self._verified, self._rests = 0, True, False",
        "self._verified, self._rests = True, False",
        PROMISES,
    ),
    _guard(
        "stored stop goes on two ticks",
        "            self._tick += 1\n        else:",
        "            self._tick += 2\n        else:",
        PROMISES,
    ),
    _guard(
        "expectation not kept",
        "self._joints.expected, self._after = self._after, self._joints.expected\n",
        "pass\n",
        PROMISES,
    ),
    _guard("a deviation is ignored", "wrong = joints.judge(form)", 'wrong = joints.judge(form) and ""', FAULTS),
    _guard("nobody is told", "if wrong and joints.persistent and not self._told:", "if False:", FAULTS),
    _guard(
        "a stop that did not end in rest is the last",
        "self._rests = begun and at_rest(self.expected)",
        "self._rests = begun",
        (JOINTS, "did_not_end"),
    ),
    _kernel(
        "fixtures may change",
        "return _changed(start, end, radius, normal, offset, statics, planes)",
        "return 0",
        NUMBERS,
    ),
    _guard(
        "names of fixtures may change",
        "if not self._first and names != self._names:",
        "if False:",
        (JOINTS, "not_what_it_was"),
    ),
    _guard("people of another tick are believed", "if not self._joints.timely:", "if False:", (JOINTS, "another_tick")),
    _guard(
        "tolerance is not kept as a distance",
        "self._astray = params.displacement(robot)",
        "self._astray = params.tracking_error",
        (JOINTS, "edge"),
    ),
    _guard(
        "missed ticks are not counted", "for passed in range(min(late, left + 1)):", "for passed in range(0):", FAULTS
    ),
    _guard(
        "any stop counts as verified",
        "self._joints.begun and at_rest(state) and not violates(state, still, self._bounds, _ROUNDING)",
        "True",
        (JOINTS, "first_seen_in_motion"),
    ),
    _guard(
        "things without a name",
        "if (len(offset), len(statics)) != (len(names[0]), len(names[1])):",
        "if False:",
        (FILTERS, "without_a_name"),
    ),
    # what is assumed
    _kernel("age dropped", "(age[k] + lag)", "lag", ASSUMPTIONS),
    _kernel("lag dropped", "(age[k] + lag)", "age[k]", ASSUMPTIONS),
    _guard("tracking error dropped", "params.position_error + self._astray", "params.position_error"),
    _guard("position error dropped", "params.position_error + self._astray", "self._astray"),
    _guard("max_age ignored", "max_age=params.max_age", "max_age=1e9", (FILTERS, "max_age or frozen or too_old")),
    _guard(
        "no margin to what stands",
        "            self._astray,\n            jerk,",
        "            0.0,\n            jerk,",
        (FILTERS, "tracking"),
    ),
    Mutant(
        "limbs as slow as bodies",
        "safety/failsafe.py",
        "return self.human_speed if known else max(self.limb_speed, self.human_speed)",
        "return self.human_speed",
        ASSUMPTIONS,
    ),
    Mutant(
        "parts not named may be touched",
        "safety/failsafe.py",
        "speeds.get(part, 0.0)",
        "speeds.get(part, 1.0)",
        ASSUMPTIONS,
    ),
    Mutant(
        "jumps are believed",
        "kernels/trust.py",
        "if not _within(ends, j, radius, track, allowed):",
        "if False:",
        (FILTERS, "jumping"),
    ),
    Mutant(
        "a frozen source is believed",
        "kernels/trust.py",
        "return fastest > CLAIMS_MOTION * CLAIMS_MOTION",
        "return False",
        (FILTERS, "frozen"),
    ),
    # failing closed
    _filter(
        "exception returns the nominal",
        FAILED,
        FAILED.replace(
            "self._brake(nominal, reason)",
            "Decision(nominal, nominal, Status.FAULT, reason, 0.0, 0.0, (-1, -1), 0.0, 0)",
        ),
    ),
    _filter("a filter's own fault is applied", "if decision.status == Status.FAULT:", "if False:"),
    _filter(
        "a scene that does not fit is no fault",
        "if reason := guard.take_fixtures(scene):",
        "if (reason := guard.take_fixtures(scene)) and False:",
    ),
    _filter("the answer is not looked at", "        if wrong:\n", "        if False:\n"),
    _filter("watch's fault is ignored", "if astray or watch.fault:", "if astray:"),
    _filter("the joints' fault is ignored", "if astray or watch.fault:", "if watch.fault:"),
    _filter(
        "what is verified is not what is applied",
        "decision = decision._replace(jerk=jerk)",
        "pass",
        ("tests/shields/test_shield.py", "to_the_bit and True"),
    ),
    _filter("brakes without the stored stop", "jerk = guard.stop()", "jerk = self.fallback(self._state)"),
    _filter("verification forgotten", "if not verdict.proposed:", "if False:", PROMISES),
    _filter("an unverified stop is no fault", "if not verdict.verified:", "if False:"),
    _guard(
        "a blind tick takes no time",
        "            self._clock.miss()\n",
        "            pass\n",
        (JOINTS, "missing_scenes"),
    ),
    Mutant(
        "people stand still with the clock",
        "safety/clock.py",
        "self._ahead = max(self._ahead + due - gap, 0.0)",
        "pass",
        (JOINTS, "missing_scenes"),
    ),
    Mutant(
        "a radius is believed at once",
        "kernels/trust.py",
        'left = allowed - abs(radius - track["radius"])',
        "left = allowed",
        (FILTERS, "radius_that"),
    ),
    Mutant(
        "viability box ignored",
        "kernels/tick.py",
        "if viability and fault == 0:",
        "if False:",
        (FILTERS, "viability_box"),
    ),
    Mutant(
        "NaN answer passes",
        "kernels/tick.py",
        "        if not np.isfinite(u):\n            return 1\n        if not lower[k] <= u <= upper[k]:",
        "        if u < lower[k] or u > upper[k]:",
        FAULTS,
    ),
    Mutant(
        "fallback returns the nominal",
        "kernels/projection.py",
        "out[k] = min(max(0.0, lower[k]), upper[k])",
        "out[k] = min(max(nominal[k], lower[k]), upper[k])",
        ("tests/shields/test_fail_closed.py", "unsolvable"),
    ),
    # rows
    Mutant("factor 2 in a row", "kernels/index.py", ROW, ROW.replace("-slope", "-2.0 * slope"), ROWS),
    Mutant("sign of a row", "kernels/index.py", ROW, ROW.replace("-slope", "slope"), ROWS),
    Mutant(
        "sign of the acceleration in the index",
        "kernels/index.py",
        "- index.lambda2 * curvature",
        "+ index.lambda2 * curvature",
        ROWS,
    ),
    Mutant(
        "plain square in the index",
        "kernels/index.py",
        "distance * abs(distance) -",
        "distance * distance -",
        ("tests/kernels/test_index.py", "deeper"),
    ),
    Mutant(
        "Jacobian of the wrong link",
        "kernels/index.py",
        '        if j > segment["link"]:',
        '        if j >= segment["link"]:',
        ROWS,
    ),
    Mutant(
        "recovery asks for the present index",
        "kernels/index.py",
        'now[i, j]["phi"] - recovery * span',
        'now[i, j]["phi"]',
        ROWS,
    ),
    Mutant(
        "recovery asks for too much less",
        "kernels/index.py",
        'now[i, j]["phi"] - recovery * span',
        'now[i, j]["phi"] - 0.5 * recovery * span',
        ROWS,
    ),
    Mutant(
        "the present index of the future people",
        "kernels/tick.py",
        "    advance(agents, -dt)\n    index",
        "    index",
        ROWS,
    ),
    Mutant(
        "clip after projection",
        "shields/jssa.py",
        "jerk, feasible, note = projection.jerk, ",
        "jerk, feasible, note = np.clip(projection.jerk, 0.3 * self.lower, 0.3 * self.upper), ",
        ("tests/shields/test_shield.py", "jerk_is_the_nearest"),
    ),
    Mutant(
        "degrees for radians",
        "robots/lr_mate_200id_7l.py",
        "return np.radians(np.array(degrees))",
        "return np.array(degrees)",
        ("tests/robots/test_model.py", "limit"),
    ),
]


def run(tests: tuple[str, str], copy: Path) -> tuple[str, str]:
    """Run some tests on a copy: ``"passed"``, ``"failed"`` or what else happened; and the first failure."""
    environment = {
        **os.environ, "PYTHONPATH": str(copy), "NUMBA_DISABLE_JIT": "1", "PYTHONDONTWRITEBYTECODE": "1",
        "OMP_NUM_THREADS": "1",
    }  # fmt: skip
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-x",
        "-q",
        "-p",
        "no:cacheprovider",
        "--tb=no",
        tests[0],
        "-k",
        f"({tests[1]}) and not ({PEERS})" if tests[0] == FILTERS else tests[1],
    ]
    try:
        done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True, timeout=TIMEOUT)
    except subprocess.TimeoutExpired:
        return "failed", "took too long"
    first = next((line for line in done.stdout.splitlines() if line.startswith("FAILED")), "")
    return {0: "passed", 1: "failed"}.get(done.returncode, f"error {done.returncode}"), first[7:].split(" - ")[0]


def main() -> int:
    words = sys.argv[1:]
    chosen = [mutant for mutant in MUTANTS if not words or any(word in mutant.name for word in words)]
    survived = broken = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        ignore = shutil.ignore_patterns("__pycache__")
        for part in ("jssa_gym", "tests"):
            shutil.copytree(ROOT / part, copy / part, ignore=ignore)
        shutil.copy(ROOT / "pyproject.toml", copy)
        for tests in sorted({mutant.tests for mutant in chosen}):
            outcome, first = run(tests, copy)
            if outcome != "passed":
                print(f"unchanged, {tests}: {outcome} {first}", flush=True)
                return 1
        for number, mutant in enumerate(chosen, 1):
            path, begun = copy / "jssa_gym" / mutant.file, time.perf_counter()
            source = path.read_text()
            if source.count(mutant.old) != 1:
                outcome, first = "does not fit", f"{source.count(mutant.old)} places in {mutant.file}"
            else:
                path.write_text(source.replace(mutant.old, mutant.new))
                outcome, first = run(mutant.tests, copy)
                path.write_text(source)
            verdict = {"failed": "killed", "passed": "SURVIVED"}.get(outcome, outcome.upper())
            survived += verdict == "SURVIVED"
            broken += verdict not in ("killed", "SURVIVED")
            seconds = time.perf_counter() - begun
            print(f"{number:3d}  {verdict:9s} {seconds:5.0f} s  {mutant.name:48s} {first}", flush=True)
    print(f"{len(chosen)} mutants: {len(chosen) - survived - broken} killed, {survived} survived, {broken} broken")
    return int(survived + broken > 0)


if __name__ == "__main__":
    sys.exit(main())
