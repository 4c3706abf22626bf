"""Mutation testing of the shield: each guard is broken once, and some test has to notice.

    python benchmarks/mutants.py                 # all, hours on a busy machine
    python benchmarks/mutants.py age tail        # those whose name contains one of the words
    python benchmarks/mutants.py --log FILE      # goes on where a run of the same sources that was ended left off

A mutant is a substitution in the source of a copy of the package; the tests that are to notice it run on that copy
with kernels that are not compiled (compiling each mutant takes longer than its tests). Exit status 1 if one survives,
or if a substitution no longer fits the source.
"""

import argparse
import hashlib
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
PARTS = "jssa_gym", "tests"
"""What is copied."""
LONGEST = 1200
"""Processor time [s]: a mutant that keeps its tests busy for longer is noticed too, however busy the machine is."""
PATIENCE = 7200.0
"""One that makes them wait for ever likewise [s]."""

PEERS = "[ssa or -ssa or sss or cbf or pfm or sma or ssm or [stop or -stop"
"""Cases of other filters than the shield's own, which would only repeat what those of the shield notice."""

KERNELS = "tests/kernels/test_verification.py"
FILTERS = "tests/shields/test_failsafe.py"
JOINTS = "tests/tick/test_joints.py"
PEOPLE = "tests/tick/test_people.py"
REGION, WATCHED = "tests/tick/test_region.py", "tests/shields/test_watched.py"
CLOSER = "tests/kernels/test_occupancy.py"
BOUNDS = "tests/shields/test_closer_bounds.py"
HELD = "tests/shields/test_held_joints.py"
CLOSED = "tests/shields/test_fail_closed.py"
OFFERS = "tests/shields/test_offers.py"
VECTOR_OFFERS = "tests/shields/test_vector_offers.py"
MANY_JPC = "tests/policies/test_vector_jpc.py"
MARGIN = "tests/kernels/test_margin.py"
MOVED = "tests/evaluation/test_motion.py"
PREPARE = "tests/robots/test_prepare.py"
ENCLOSE = "tests/robots/test_enclose.py"
GUARANTEES = "tests/robots/test_prepare_guarantees.py"
COVERAGE = "tests/robots/test_coverage.py"
DOORS = "tests/robots/test_doors.py"
SEEN = "tests/perception/test_tracker.py"
ENERGY = "tests/evaluation/test_energy.py"
DATA = "tests/datasets/test_datasets.py"
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


def _closer(name, old, new, tests=(CLOSER, "pieces or swerve or nobody")):
    return Mutant(name, "kernels/occupancy.py", old, new, tests)


def _seen(name, old, new, tests, file="tracked_body"):
    return Mutant(name, f"perception/{file}.py", old, new, (SEEN, tests))


def _admit(name, old, new, tests=ASSUMPTIONS):
    return Mutant(name, "tick/admit.py", old, new, tests)


def _decide(name, old, new, tests=FAULTS):
    return Mutant(name, "tick/decide.py", old, new, tests)


def _people(name, old, new, tests):
    return Mutant(name, "tick/people.py", old, new, tests)


def _reading(name, old, new, tests=(JOINTS, "test_monitor_ or rebased")):
    return Mutant(name, "shields/reading.py", old, new, tests)


def _joints(name, old, new, tests=(JOINTS, "test_monitor_ or rebased")):
    return Mutant(name, "kernels/joints.py", old, new, tests)


def _monitor(name, old, new, tests=(JOINTS, "test_monitor_ or rebased")):
    return Mutant(name, "tick/joints.py", old, new, tests)


def _jumps(name, old, new):
    return Mutant(
        name, "evaluation/motion.py", old, new, (MOVED, "test_jumps_are or jerk_that or what_is or own_bound")
    )


def _track(name, file, old, new, tests):
    return Mutant(name, file, old, new, (REGION, tests))


def _filter(name, old, new, tests=FAULTS):
    return Mutant(name, "shields/filter.py", old, new, tests)


def _guard(name, file, old, new, tests):
    return Mutant(name, file, old, new, ("tests/guard/test_guard.py", tests))


def _stream(name, old, new, tests):
    return Mutant(name, "hardware/fanuc/stream.py", old, new, ("tests/hardware/test_fanuc.py", tests))


PERSON = """                radii = part["radius"] + agent["radius"]
"""
STATIC = """                radii = part["radius"] + static["radius"]"""
FAILED = """        reason = f"{REASONS[codes.FILTER_FAILED]}: {type(error).__name__}: {words_of(error)}"
        alarm.failure("filter", f"{reason}; the arm brakes")
        return filter.failed(tick, reason)"""
ROW = """        row[j] = -slope"""

MUTANTS = [
    # what a verification looks at
    _kernel("robot's radius dropped", PERSON, PERSON.replace('part["radius"] + ', "", 1)),
    _kernel("person's radius dropped", PERSON, PERSON.replace(' + agent["radius"]', "", 1)),
    _kernel("static's radius dropped", STATIC, STATIC.replace(' + static["radius"]', "")),
    _kernel("reach dropped", "gap - reach[k] - speed[k] * t", "gap - speed[k] * t"),
    _kernel("v t of the person dropped", "gap - reach[k] - speed[k] * t", "gap - reach[k]"),
    _kernel("person's speed not in the closing speed", "/ (rate + speed[k])", "/ max(rate, 1e-9)"),
    _kernel("first tick not checked", "end, t = dt * (1 + ticks), 0.0", "end, t = dt * (1 + ticks), dt"),
    _kernel("last ticks not checked", "end, t = dt * (1 + ticks), 0.0", "end, t = dt * (1 + ticks // 2), 0.0"),
    _kernel(
        "present speed instead of the largest to come",
        "fastest[j] = peak_from(now, after[1, j], after[2, j], stop, dt, t - dt)",
        "fastest[j] = abs(now)",
    ),
    _kernel("the stop's speed not foreseen in the step", "max(max(abs(now), turn), later)", "max(abs(now), turn)"),
    _kernel("the step's turning point forgotten", "max(max(abs(now), turn), later)", "max(abs(now), later)"),
    _kernel("spin forgotten", 'spin += (levers[i, j] + part["radius"])', "spin += levers[i, j]"),
    _kernel(
        "half-spaces skipped",
        "            for k in range(planes.shape[0]):",
        "            for k in range(0):",
    ),
    _kernel("statics skipped", "            for k in range(statics.shape[0]):", "            for k in range(0):"),
    _kernel("self pairs skipped", "for k in range(self_pairs.shape[0]):", "for k in range(0):"),
    _kernel(
        "one joint between self pairs forgotten",
        'range(one["link"] + 1, two["link"] + 1)',
        'range(one["link"] + 1, two["link"])',
    ),
    _kernel("margin of self pairs dropped", "else (gap - 2.0 * margin) / rate", "else gap / rate"),
    _kernel(
        "a crawl into itself is not looked at",
        "            if rate <= 0.0:\n                continue\n            gap",
        "            if rate <= REST_SPEED:\n                continue\n            gap",
    ),
    _kernel("what moves may stay closed", "gap <= 0.0 and rate <= REST_SPEED", "gap <= 0.0"),
    _kernel(
        "who is off is off for good", "return until - t - _ROUNDING > max(lasting, SHORTEST)", "return until > -np.inf"
    ),
    _kernel("who is apart at a glance is nearer", "far = radii + reach[k] + speed[k] * t", "far = radii"),
    _kernel("who is near is surely met", "* t < -_CLOSED", "* t < 0.1", (KERNELS, "surely_met and people")),
    _kernel(
        "who may be touched is surely met",
        "if not spin > 2.0 * max(around.touch[k], REST_SPEED):",
        "if False:",
        (KERNELS, "surely_met and touched"),
    ),
    _kernel(
        "who is confined is surely met",
        "if is_confined(around.confined[k]):",
        "if False:",
        (KERNELS, "surely_met and confined"),
    ),
    _admit(
        "who is in the way of the last stop is not told", "if hardness + 1 < end and", "if", (KERNELS, "whoever_was")
    ),
    Mutant(
        "where the arm is at present is where it was before",
        "kernels/chain.py",
        "known = known and position[j] == work.present[j]",
        "known = known or position[j] == work.present[j]",
        ("tests/kernels/test_chain.py", "one_posture"),
    ),
    _kernel("too many looks read as safe", "return UNDECIDED, -1, -1, t", "return SAFE, -1, -1, t"),
    _kernel(
        "NaN distance of a person passes",
        # both doors, of which the second would do: what is asked between them is not told NaN
        "if not (lasts > SHORTEST):\n                    lasts = apart_for("
        "part, radii, around.confined[k], reach[k], speed[k], rate, t)\n                if not (lasts > SHORTEST):",
        "if lasts <= SHORTEST:\n                    lasts = apart_for("
        "part, radii, around.confined[k], reach[k], speed[k], rate, t)\n                if lasts <= SHORTEST:",
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
        "    if code != AGREES:\n",
        "    memory.expected[e][:] = scene.joints[e]\n    if code != AGREES:\n",
    ),
    _monitor(
        "a wrong reading is forgotten at once",
        'arm["owed"] = AGREEMENTS << min(arm["lapses"] - 1, DOUBLINGS)',
        'arm["owed"] = 0',
    ),
    _monitor("relapses are forgotten", 'AGREEMENTS << min(arm["lapses"] - 1, DOUBLINGS)', "AGREEMENTS"),
    _monitor("a clock that stands still is believed", "elif last < now < np.inf or", "elif last <= now < np.inf or"),
    _monitor("a lag of the clock is forgotten", 'if arm["offset"] < arm["due"]:', "if False:"),
    _reading("masked joints are read", "if isinstance(values, np.ma.MaskedArray):", "if False:"),
    _reading("single precision is read", 'self._exact and kind == "f" and size < 8', "False"),
    Mutant("rebased in motion", "shields/rebasing.py", "if not at_rest(expected):", "if False:", (JOINTS, "rebased")),
    Mutant(
        "rebased to a moving arm",
        "shields/rebasing.py",
        "if deviates(joints, still, settings.stop_limits, settings.tolerance):",
        "if False:",
        (JOINTS, "rebased"),
    ),
    _monitor(
        "noise is reckoned with",
        'memory.arm[e]["begun"] = not deviates(reading, expected, settings.stop_limits, settings.tolerance)',
        'memory.arm[e]["begun"] = False',
    ),
    _kernel(
        "one part's contact speed for everybody",
        "spin <= max(touch[k], REST_SPEED)",
        "spin <= max(touch.max(), REST_SPEED)",
        ASSUMPTIONS,
    ),
    # how a jerk is chosen
    _admit("limits check skipped", "    if not keeps_limits(", "    if False and not keeps_limits(", CHOICE),
    _kernel("the step's limits not checked", "keeps = together.keeps(", "keeps = True or together.keeps(", CHOICE),
    _kernel("the stop's limits not checked", "keeps &= together.stop_keeps(", "keeps |= together.stop_keeps(", CHOICE),
    _admit("half-way jerk not verified", "if half == SAFE:", "if True:", CHOICE),
    _admit(
        "the softest of several stops is taken as it is", "if code == SAFE:", "if True:", (OFFERS, "blend_is_verified")
    ),
    _admit(
        "tail one tick ahead",
        "stop_jerk(memory.stored[e], step, jerk)\n    integrate",
        "stop_jerk(memory.stored[e], step + 1, jerk)\n    integrate",
        CHOICE,
    ),
    _admit(
        "tail instead of which the wanted goes on",
        "    stop_jerk(memory.stored[e], step, jerk)\n    integrate",
        "    jerk[:] = wanted\n    integrate",
        CHOICE,
    ),
    _admit(
        "another jerk is not verified",
        "    which, _, _, _, _ = choose(robot, settings, memory, work.wanted, work.jerk, np.nan, work, e)\n",
        "    keeps_safe(robot, settings, memory, work.wanted, 0, work, e)\n    which, work.jerk[:] = 1, work.wanted\n",
        (HELD, "amendment"),
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
        "    sign, x, a, rise, cruise, fall = _shortest(v, a, J, A, tau)\n    step = J * tau\n",
        "    J *= 2.0\n    sign, x, a, rise, cruise, fall = _shortest(v, a, J, A, tau)\n    step = J * tau\n",
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
    _admit("stored stop not taken over", "memory.stored[e, j] = work.next[j]", "pass", PROMISES),
    _admit(
        "stored stop's tick not reset",
        'arm["step"], arm["verified"], arm["rests"] = 0, True, False',
        'arm["verified"], arm["rests"] = True, False',
        PROMISES,
    ),
    _admit("stored stop goes on two ticks", 'arm["step"] += 1\n', 'arm["step"] += 2\n', PROMISES),
    _admit("expectation not kept", "copy_rows(work.after, memory.expected[e])\n", "pass\n", PROMISES),
    _monitor("a deviation is ignored", "    return code, ticks\n", "    return 0, ticks\n", FAULTS),
    Mutant("nobody is told", "shields/alarm.py", "if persistent and not self._said_astray:", "if False:", FAULTS),
    _monitor(
        "a stop that did not end in rest is the last",
        'arm["rests"] = begun and at_rest(memory.expected[e])',
        'arm["rests"] = begun',
        (JOINTS, "did_not_end"),
    ),
    _kernel(
        "fixtures may change",
        "return _changed(start, end, radius, normal, offset, statics, planes)",
        "return 0",
        NUMBERS,
    ),
    _reading(
        "names of fixtures may change",
        'if self._records.memory.arm[0]["fixed"] and names != (self.planes, self.statics):',
        "if False:",
        (JOINTS, "not_what_it_was"),
    ),
    _people("people of another tick are believed", "if not timely(memory, e):", "if False:", (JOINTS, "another_tick")),
    _filter(
        "tolerance is not kept as a distance",
        "astray=assumed.displacement(self.robot)",
        "astray=assumed.tracking_error",
        (JOINTS, "edge"),
    ),
    _monitor("missed ticks are not counted", "most = min(late, left + 1)", "most = 0", FAULTS),
    _monitor(
        "any stop counts as verified",
        'arm["begun"] and at_rest(state) and not violates(state, still, settings.stop_limits, ROUNDING)',
        "True",
        (JOINTS, "first_seen_in_motion"),
    ),
    _reading(
        "things without a name",
        "if (len(offset), len(capsules.radius)) != (len(names[0]), len(names[1])):",
        "if False:",
        (FILTERS, "without_a_name"),
    ),
    # what is assumed
    _kernel("age dropped", "(age[k] + lag)", "lag", ASSUMPTIONS),
    _kernel("lag dropped", "(age[k] + lag)", "age[k]", ASSUMPTIONS),
    _admit(
        "tracking error dropped", "error = settings.position_error + settings.astray", "error = settings.position_error"
    ),
    _admit("position error dropped", "= settings.position_error + settings.astray", "= settings.astray"),
    _filter("max_age ignored", "max_age=assumed.max_age", "max_age=1e9", (FILTERS, "max_age or frozen or too_old")),
    _admit(
        "no margin to what stands",
        "        settings.astray, settings.faces",
        "        0.0, settings.faces",
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
        "feet as slow as bodies",
        "safety/failsafe.py",
        "return max(self.foot_speed, self.limb_speed, self.human_speed)",
        "return self.human_speed",
        (BOUNDS, "feet"),
    ),
    Mutant(
        "nobody is told of fast people",
        "shields/people.py",
        "if speed > bound * _ROUNDING:",
        "if False:",
        (BOUNDS, "feet"),
    ),
    Mutant(
        "people are as fast as the fastest bound",
        "shields/people.py",
        "beyond.sort(key=lambda part: part[2] / part[1])",
        "beyond = beyond if len(beyond) == len(names) else []",
        (BOUNDS, "whose_parts"),
    ),
    Mutant(
        "nobody is told of motions without a speed",
        "shields/people.py",
        "if names and _says_nothing(motion):",
        "if False:",
        (BOUNDS, "no_speed"),
    ),
    Mutant(
        "nobody is told of accelerations",
        "shields/people.py",
        "if most is not None and most > bound * _ROUNDING > 0.0:",
        "if False:",
        (BOUNDS, "accelerate_faster"),
    ),
    Mutant(
        "nobody is told of names that nothing has",
        "shields/people.py",
        "if names and (beside := params.names_beside(names)):",
        "if False:",
        (BOUNDS, "nobody_has"),
    ),
    Mutant(
        "names of bounds are case sensitive",
        "safety/parts.py",
        "if one.casefold() == name)",
        "if one == part)",
        (BOUNDS, "any_case"),
    ),
    Mutant(
        "ships have hips",
        "safety/parts.py",
        'WHOLE_WORDS = ("hip",)',
        "WHOLE_WORDS = ()",
        (FILTERS, "taken_for_fast"),
    ),
    Mutant(
        "lower legs are legs",
        "safety/parts.py",
        '    "lower leg",\n',
        "",
        (FILTERS, "taken_for_fast"),
    ),
    Mutant(
        "parts not named may be touched",
        "safety/failsafe.py",
        "by_name(speeds, part) or 0.0",
        "by_name(speeds, part) or 1.0",
        ASSUMPTIONS,
    ),
    Mutant(
        "jumps are believed",
        "kernels/people.py",
        "if not within(ends, j, radius, track, elapsed, error):",
        "if False:",
        (FILTERS, "jumping"),
    ),
    _closer("grown by the slower end", "less = min(", "less = max("),
    _closer("age left out of a taper", 'less * one["late"]', 'less * (one["late"] + 0.1)'),
    _closer("a taper's error dropped", "(gap - (reach - ", "(gap - (reach * 0.0 - "),
    _closer("velocity error dropped", ' + one["velocity_error"] * longest', ""),
    _closer("age left out of a swerve", "t + late / 2.0, t + late", "t, t"),
    _closer("when it was measured is known", ' + one["speed"] * late / 2.0', ""),
    _closer("acceleration not in the closing speed", ' + one["velocity_error"] + a * longest', ""),
    _closer("nobody has to keep the acceleration", ' if track["steady"] == STEADY else 0.0', "", (CLOSER, "granted")),
    Mutant(
        "one bound for both ends' measurements",
        "kernels/people.py",
        'allowed = track["speed"][row] * elapsed',
        'allowed = max(track["speed"][0], track["speed"][1]) * elapsed',
        (PEOPLE, "own_speed"),
    ),
    Mutant(
        "swerves are forgiven",
        "kernels/people.py",
        'track["steady"] = SWERVED',
        'track["steady"] = UNCONFIRMED',
        (PEOPLE, "swerved"),
    ),
    Mutant(
        "swerves: faster than the speed bound",
        "kernels/people.py",
        "if not dot(ends[row + 2, j], ends[row + 2, j]) <= fastest * fastest:",
        "if False:",
        (PEOPLE, "beyond"),
    ),
    Mutant(
        "who is not believed confirms an acceleration",
        "kernels/people.py",
        "            return JUMPED\n",
        '            track["steady"] = max(track["steady"], STEADY)\n            return JUMPED\n',
        (PEOPLE, "confirms"),
    ),
    Mutant(
        "a rounding confirms an acceleration",
        "kernels/people.py",
        "and elapsed > STAMP_ROUNDING:",
        "and elapsed > 0.0:",
        (PEOPLE, "confirms"),
    ),
    Mutant(
        "places of swerves not looked at",
        "kernels/people.py",
        " and dot(way, way) <= drift * drift",
        "",
        (PEOPLE, "swerved"),
    ),
    Mutant(
        "swerves: only neighbouring samples",
        "kernels/people.py",
        'return _strays(ends, j, radius - track["anchor_radius"], track["anchor"], since, error, track)',
        "return False",
        (PEOPLE, "lasts"),
    ),
    Mutant(
        "swerves: the first sample for ever",
        "kernels/people.py",
        ">= ANCHORED:",
        "== np.inf:",
        (PEOPLE, "stood"),
    ),
    Mutant(
        "swerves: radii since long ago not looked at",
        "kernels/people.py",
        'radius - track["anchor_radius"]',
        "0.0",
        (PEOPLE, "radii"),
    ),
    Mutant(
        "swerves: those of the episode before",
        "tick/people.py",
        'track["anchor_radius"], track["anchor_stamp"] = np.nan, -np.inf',
        "pass",
        (PEOPLE, "stood"),
    ),
    Mutant(
        "a frozen source is believed",
        "kernels/people.py",
        "return fastest > CLAIMS_MOTION * CLAIMS_MOTION",
        "return False",
        (FILTERS, "frozen"),
    ),
    # failing closed
    Mutant(
        "exception returns the nominal",
        "shields/asking.py",
        FAILED,
        FAILED.replace(
            "filter.failed(tick, reason)",
            'Decision(tick.nominal, tick.nominal, Status.NOMINAL, "", 0.0, 0.0, (-1, -1), 0.0, 0)',
        ),
        FAULTS,
    ),
    Mutant(
        "a filter's own fault is applied",
        "shields/asking.py",
        "if decision.status == Status.FAULT:",
        "if False:",
        FAULTS,
    ),
    _decide(
        "a scene that does not fit is no fault",
        'fault, told["detail"] = take_fixtures(memory, scene, e)',
        '_, told["detail"] = take_fixtures(memory, scene, e)',
    ),
    _decide("the answer is not looked at", "        if wrong:\n", "        if False:\n"),
    _decide("watch's fault is ignored", "        fault = missing\n", "        fault = 0\n"),
    _decide(
        "the joints' fault is ignored",
        'fault, told["ticks"] = check_joints(settings, memory, scene, work, e)\n',
        '_, told["ticks"] = check_joints(settings, memory, scene, work, e)\n    fault = 0\n',
    ),
    _admit(
        "what is verified is not what is applied",
        "jerk[j] = representable(u, limit[j])",
        "pass",
        ("tests/shields/test_shield.py", "to_the_bit and True"),
    ),
    _decide(
        "brakes without the stored stop",
        'go_on(settings, memory, memory.arm[e]["step"], memory.expected[e], jerk, e)',
        "brake(memory.state[e], -robot.limits[4], robot.limits[4], settings.dt, jerk)",
    ),
    _admit("verification forgotten", "copy(work.jerk, answer.jerk[e])", "pass", PROMISES),
    _decide(
        "an unverified stop is no fault",
        'if not memory.arm[e]["verified"]:',
        "if False:",
        (FILTERS, "from_which_no_stop"),
    ),
    _filter(
        "without a scene a failed step brakes where it was",
        "integrate(view.state, self.records.memory.applied[0], self.dt, view.state)",
        "pass",
        (CLOSED, "dead_reckoning"),
    ),
    _filter(
        "what cannot be said takes another tick",
        '        except Exception as error:\n            return f"{REASONS',
        '        except ImportError as error:\n            return f"{REASONS',
        (CLOSED, "cannot_be_said"),
    ),
    _people(
        "a blind tick takes no time",
        '        arm["missed"] += 1\n        return codes.PEOPLE\n',
        "        return codes.PEOPLE\n",
        (JOINTS, "missing_scenes"),
    ),
    Mutant(
        "people stand still with the clock",
        "tick/people.py",
        'return max(arm["ahead"] + due - gap, 0.0)',
        'return arm["ahead"]',
        (JOINTS, "missing_scenes"),
    ),
    Mutant(
        "a radius is believed at once",
        "kernels/people.py",
        'left = allowed - abs(radius - track["radius"])',
        "left = allowed",
        (FILTERS, "radius_that"),
    ),
    Mutant(
        "viability box ignored",
        "tick/decide.py",
        "if settings.viability:",
        "if False:",
        (FILTERS, "viability_box"),
    ),
    Mutant(
        "NaN answer passes",
        "tick/admit.py",
        "        if not np.isfinite(u):\n            return 1\n        if not work.lower[j] <= u <= work.upper[j]:",
        "        if u < work.lower[j] or u > work.upper[j]:",
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
        "tick/proposals/exact.py",
        "    advance(work.agents, -settings.dt)\n",
        "",
        ROWS,
    ),
    Mutant(
        "clip after projection",
        "tick/propose.py",
        "        stage = projected(proposal)(robot,",
        "        for j in range(nominal.shape[0]):\n"
        "            work.wanted[j] = min(max(work.wanted[j], 0.3 * work.lower[j]), 0.3 * work.upper[j])\n"
        "        stage = projected(proposal)(robot,",
        ("tests/shields/test_shield.py", "jerk_is_the_nearest"),
    ),
    Mutant(
        "degrees for radians",
        "robots/lr_mate_200id_7l.py",
        "return np.radians(np.array(degrees))",
        "return np.array(degrees)",
        ("tests/robots/test_model.py", "limit"),
    ),
    # arms' files
    Mutant(
        "capsules around the middle of what is drawn",
        "robots/prepare/enclose.py",
        "radius = float((aside + radii).max()) + abs(float(x[4]))",
        "radius = float(np.quantile(aside + radii, 0.9)) + abs(float(x[4]))",
        (ENCLOSE, "sticks_out"),
    ),
    Mutant(
        "what a plane cuts is left to neither side",
        "robots/prepare/enclose.py",
        "    for alone in (1, 2):",
        "    for alone in ():",
        (ENCLOSE, "cut_are_held or bracket"),
    ),
    Mutant(
        "fingers held only where they are frozen",
        "robots/prepare/anatomy.py",
        "triangles = np.concatenate([triangles, other, *_between(places[0][0], other)])",
        "triangles = places[0][0]",
        (PREPARE, "wherever_they_slide"),
    ),
    Mutant(
        "slides are let through",
        "robots/prepare/chain.py",
        "        if free or j in asked:",
        "        if True:",
        (PREPARE, "one_list"),
    ),
    Mutant(
        "ties are let through",
        "robots/prepare/chain.py",
        "    findings += _couplings(model, joints)",
        "    findings += _couplings(model, joints)[:0]",
        (PREPARE, "ties_the_arm"),
    ),
    Mutant(
        "capsules kept though they hold half",
        "robots/prepare/covering.py",
        "kept = link.found if own <= TOLERATED else ()",
        "kept = link.found",
        (PREPARE, "kept_and_others"),
    ),
    Mutant(
        "boxes in the capsules' group count as measured",
        "robots/coverage.py",
        "return (model.geom_group == group) & np.isin(model.geom_type, (kinds.mjGEOM_CAPSULE, kinds.mjGEOM_SPHERE))",
        "return model.geom_group == group",
        (GUARANTEES, "check_accepts or is_written_holds"),
    ),
    Mutant(
        "a link that reaches out is taken",
        "robots/coverage.py",
        "    if link.arm <= TOLERATED:",
        "    if link.arm <= 0.3:",
        (COVERAGE, "refused_or_named"),
    ),
    Mutant(
        "capsules are looked for in group 3 whatever is said",
        "robots/model.py",
        "capsules_of(model, link_of_body, anchors, group)",
        "capsules_of(model, link_of_body, anchors)",
        (DOORS, "which_group"),
    ),
    Mutant(
        "servos are made for less than what is written",
        "robots/prepare/writing.py",
        "mass = max(link.mass, _LIGHT[0])  # as it is written",
        "mass = link.mass",
        (DOORS, "hardly_weighs"),
    ),
    Mutant(
        "between corners nothing is looked at",
        "robots/prepare/enclose.py",
        "        if not np.any(still):\n            return worst",
        "        return worst",
        (GUARANTEES, "balls_at_the_ends"),
    ),
    Mutant(
        "what is written is not compared with the file",
        "robots/prepare/writing.py",
        "            _agree(arm, make_robot(unfinished))\n",
        "",
        (GUARANTEES, "does_not_hold_its_file"),
    ),
    Mutant(
        "the reader of models is not asked",
        "robots/prepare/examine.py",
        "        findings += _refused(source)",
        "        pass",
        (GUARANTEES, "check_accepts"),
    ),
    Mutant(
        "an arm without capsules on some links is taken",
        "robots/model.py",
        "        check_coverage(model, joints, link_of_body, home, group, spared)",
        "        check_coverage(model, joints, link_of_body, home, group, range(len(joints)))",
        (PREPARE, "one_capsule_of_three"),
    ),
    Mutant(
        "what is drawn collides in the simulator",
        "envs/world.py",
        "            geom.contype = geom.conaffinity = 0",
        "            pass",
        (PREPARE, "geoms_collide"),
    ),
    # what gives way gradually, what planners offer, and rows from a predicted miss
    Mutant(
        "an alternative without a verified stop",
        "tick/decide.py",
        "if settings.guarded and not admits(robot, settings, memory, work.clipped, work, answer, e):",
        "if settings.guarded and not admits(robot, settings, memory, work.clipped, work, answer, e) and False:",
        (OFFERS, "no_stop_follows"),
    ),
    Mutant(
        "an alternative that the filter would change",
        "tick/propose.py",
        'return code == 0 and told["rows"] == 0',
        "return True",
        (OFFERS, "would_change"),
    ),
    Mutant(
        "an offer that is passed over stops the arm",
        "tick/propose.py",
        'arm["resume"] = resume',
        "pass",
        (OFFERS, "stops_nobody"),
    ),
    Mutant(
        "an alternative outside the box",
        "tick/decide.py",
        "if unfit_answer(work.clipped, jerk, False, robot.limits[4], work) or not leaves_alone",
        "if not np.isfinite(jerk).all() or not leaves_alone",
        (OFFERS, "first_alternative and none"),
    ),
    Mutant(
        "an offer for ever",
        "shields/shield.py",
        "        self._offered = None\n        scene = self._scene()\n",
        "        scene = self._scene()\n",
        (OFFERS, "first_alternative and stop"),
    ),
    Mutant(
        "the limits of a soft stop are its own",
        "tick/admit.py",
        "if not keeps_limits(state, jerk, work.after, work.next, settings.stop_limits, settings.dt):",
        "if not keeps_limits(state, jerk, work.after, work.next, settings.soft_limits[hardness], settings.dt):",
        (OFFERS, "softer_stop"),
    ),
    Mutant(
        "a blend that nobody verifies",
        "tick/admit.py",
        "        hardness, _, _, _, _ = softest(robot, settings, memory, jerk, FIRST, count, work, e)\n"
        "        if hardness < count:",
        "        plan_behind(settings, memory, jerk, FIRST, work, e)\n        if True:",
        (OFFERS, "blend_is_verified"),
    ),
    Mutant(
        "what a filter wants however little room it leaves",
        "tick/admit.py",
        "if count > 1 and _differ(wanted, work.clipped):",
        "if False:",
        (OFFERS, "blend_is_verified"),
    ),
    Mutant(
        "an arm found in motion stops softly or not at all",
        "tick/admit.py",
        "softest(robot, settings, memory, work.halt, FIRST, settings.hardness.shape[0], work, e)",
        "softest(robot, settings, memory, work.halt, FIRST, 1, work, e)",
        (OFFERS, "found_in_motion"),
    ),
    Mutant(
        "an acceleration that no projection found is applied",
        "tick/proposals/energy.py",
        "    if not left < np.inf:\n",
        "    if False:\n",
        (OFFERS, "projection_that_fails"),
    ),
    Mutant(
        "a blend the wrong way round",
        "tick/admit.py",
        "jerk[j] + share * (wanted[j] - jerk[j])",
        "wanted[j] + share * (jerk[j] - wanted[j])",
        (OFFERS, "blend_is_what"),
    ),
    Mutant(
        "an alternative before a hard stop",
        "tick/admit.py",
        "soft = min(SOFT, settings.hardness.shape[0])",
        "soft = settings.hardness.shape[0]",
        (OFFERS, "verified_soft_stop"),
    ),
    Mutant(
        "an alternative before a stop that fails",
        "tick/admit.py",
        "    if code != SAFE:\n        return False\n    told",
        "    told",
        (OFFERS, "no_stop_follows"),
    ),
    Mutant(
        "room that is no number counts as room",
        "tick/admit.py",
        "return min(max(room / EASY, 0.0), 1.0) if room > 0.0 else 0.0",
        "return 0.0 if room <= 0.0 else min(room / EASY, 1.0)",
        (OFFERS, "share_of_the_room"),
    ),
    Mutant(
        "a path that is left goes on being offered",
        "kernels/pacing.py",
        "    if astray(plan, paced, state, e):\n",
        "    if False:\n",
        ("tests/control/test_path.py", "garbage"),
    ),
    Mutant(
        "a path takes what it did not offer",
        "kernels/pacing.py",
        'if not 0 <= choice < kept["count"]:',
        "if choice < 0:",
        ("tests/control/test_path.py", "garbage"),
    ),
    Mutant(
        "an offer to many shields for ever",
        "shields/vector.py",
        "offered, self._offered = self._offered, None",
        "offered = self._offered",
        (VECTOR_OFFERS, "asked_and_told"),
    ),
    Mutant(
        "an offer to many outlives their episodes",
        "shields/vector.py",
        "began, self._offered = self._arms.began, None",
        "began = self._arms.began",
        (VECTOR_OFFERS, "ends_with_a_reset"),
    ),
    Mutant(
        "what an arm of many is offered though it has none",
        "shields/offers.py",
        "return np.where(asked, np.minimum(counts, most), 0)",
        "return np.full(count, most)",
        (VECTOR_OFFERS, "asked_and_told"),
    ),
    Mutant(
        "many arms that nobody asks what happens to them",
        "control/many.py",
        "min(wake, _wakes(jpc))",
        "wake",
        (MANY_JPC, "options"),
    ),
    Mutant(
        "many arms that pass their waypoints by",
        "control/many.py",
        "marks[0] if marks else NEVER",
        "NEVER",
        (MANY_JPC, "were_met"),
    ),
    Mutant(
        "many arms that do not notice that they were thrown off",
        "tick/play.py",
        "    if count < 0:\n        return False\n",
        "",
        (MANY_JPC, "thrown_off"),
    ),
    Mutant(
        "a way back through what stands still",
        "control/rejoin.py",
        "if not way.within(kept) or not clear(way.states[:, 0]):",
        "if not way.within(kept):",
        ("tests/control/test_rejoin.py", ""),
    ),
    Mutant(
        "a way back beyond the limits",
        "control/rejoin.py",
        "kept[4] *= share",
        "kept[2:] *= 2.0 * share",
        ("tests/control/test_rejoin.py", ""),
    ),
    Mutant(
        "a plan that touches the table is played",
        "policies/jpc.py",
        "if not self._is_clear(plan.states[:, 0]):",
        "if False:",
        ("tests/policies/test_yielding.py", ""),
    ),
    Mutant(
        "a campaign's jpc offers nothing",
        "evaluation/policy.py",
        "        policy.offer_to(seen)\n",
        "        pass\n",
        ("tests/evaluation/test_campaign.py", "offers"),
    ),
    Mutant(
        "a gap that is not finite is far",
        "kernels/ahead.py",
        "                if not np.isfinite(gap):\n",
        "                if False:\n",
        (OFFERS, "known_of_nobody"),
    ),
    Mutant(
        "rows without a projection are kept",
        "tick/proposals/rows.py",
        'return of_rows(told) if told["slack"] < np.inf else codes.UNSOLVED',
        "return of_rows(told)",
        (OFFERS, "projection_that_fails"),
    ),
    Mutant(
        "a fault told through what has failed",
        "shields/filter.py",
        "emergency if path is None else emergency._replace(override=tell(path, -1, self._alarm))",
        "emergency if path is None else self._chosen(path, emergency)",
        (OFFERS, "out_of_order"),
    ),
    Mutant(
        "people stand still ahead",
        "kernels/ahead.py",
        "start, end = _moved(agent, t)",
        "start, end = _moved(agent, 0.0)",
        (MARGIN, "passes_by"),
    ),
    Mutant(
        "rows without the acceleration",
        "kernels/ahead.py",
        "- 9.0 / T * curvature",
        "",
        (MARGIN, "quintic"),
    ),
    Mutant(
        "a margin without reach",
        "kernels/margin.py",
        "(around.reach[first + k] + around.growth[first + k] * until)",
        "(around.growth[first + k] * until)",
        (MARGIN, "formula"),
    ),
    Mutant(
        "a margin until now",
        "kernels/margin.py",
        "until = t + motion.dt + length / _MOMENTS",
        "until = t",
        (MARGIN, "formula"),
    ),
    Mutant(
        "a margin that forgets how far the arm has moved",
        "kernels/margin.py",
        "room[i] += widening - moved",
        "room[i] += widening",
        (MARGIN, "formula or moments"),
    ),
    Mutant(
        "a margin for which people do not grow back",
        "kernels/margin.py",
        "slowest * (then - t), room)",
        "np.inf, room)",
        (MARGIN, "formula or moments"),
    ),
    Mutant(
        "a margin for which the arm stands still before its last moment",
        "kernels/margin.py",
        "(slowest - speed) * (then - t)",
        "slowest * (then - t)",
        (MARGIN, "formula or moments"),
    ),
    Mutant(
        "a margin to balls as to lines",
        "kernels/margin.py",
        "if holds[k] == 0.0:",
        "if False:",
        (MARGIN, "formula or moments"),
    ),
    Mutant(
        "any margin is wide enough not to look at people again",
        "kernels/margin.py",
        "return room > (between + SHORTEST) * quickest + _CLEARLY",
        "return room > 0.0",
        (MARGIN, "only_a_wide"),
    ),
    Mutant(
        "a margin that is there is wide enough not to look at people again",
        "kernels/margin.py",
        "return room > (between + SHORTEST) * quickest + _CLEARLY",
        "return room > 0.0",
        (MARGIN, "for_a_wide"),
    ),
    Mutant(
        "a margin is wide enough for a step shorter than the last look",
        "kernels/margin.py",
        "if not room > 0.0 or motion.dt < SHORTEST:",
        "if not room > 0.0:",
        (MARGIN, "for_a_wide"),
    ),
    Mutant(
        "balls are lines where they are looked at again",
        "kernels/index.py",
        "            if not common:\n                _, _, _, phi",
        "            if False:\n                _, _, _, phi",
        ("tests/kernels/test_lanes.py", "people_together"),
    ),
    Mutant("balls are lines", "kernels/capsules.py", "    if not holds:\n", "    if False:\n", (KERNELS, "agree")),
    Mutant(
        "a margin does not say how fast the arm is",
        "kernels/margin.py",
        "work.quickest[0] = speed",
        "work.quickest[0] = 0.0",
        (MARGIN, "only_a_wide"),
    ),
    _admit(
        "the hardest stop is the one from another state",
        "if hardest and same_rows(work.after, work.hardest_after):",
        "if hardest and not np.isnan(work.hardest_after[0, 0]):",
        CHOICE,
    ),
    Mutant(
        "who could be too close is not looked at again",
        "kernels/ahead.py",
        "if not _asked(off, t):",
        "if moment > 0:",
        (MARGIN, "quintic or passes_by"),
    ),
    _kernel(
        "a table is not looked at either where people are off",
        "around.touch, around.confined, around.statics, around.planes,",
        "around.touch, around.confined, around.statics[:0], around.planes[:0],",
        (MARGIN, "for_a_wide"),
    ),
    _admit(
        "the room of another jerk is believed",
        "known = room if count == 1 and not _differ(wanted, work.clipped) else np.nan",
        "known = room",
        CHOICE,
    ),
    Mutant(
        "rows of an arm that stays where it is",
        "kernels/ahead.py",
        "rests = t - motion.dt >= stopped",
        "rests = True",
        (MARGIN, "quintic or passes_by"),
    ),
    Mutant(
        "rows that are violated are taken for kept by far",
        "tick/proposals/exact.py",
        "CLOSE = -1e-6",
        "CLOSE = 1.0",
        ("tests/shields/test_shield.py", "projector_that_fails"),
    ),
    # people who come and go
    _kernel(
        "nobody comes in at the edge",
        "if pieces.shape[0] > 1 and spin > REST_SPEED:",
        "if pieces.shape[0] > 9 and spin > REST_SPEED:",
        (WATCHED, "reason_says or older"),
    ),
    _admit("frames are new", "entered(settings, since +", "entered(settings, 0.0 * since +", (WATCHED, "older")),
    _admit("who comes in waits for the lag", "since + settings.lag", "since", (WATCHED, "older")),
    _admit(
        "the edge is seen exactly",
        "settings.lag, settings.position_error + settings.astray)",
        "settings.lag, settings.astray)",
        (WATCHED, "older"),
    ),
    Mutant(
        "who appears in the middle is no trouble",
        "tick/region.py",
        'memory.arm[e]["verified"] = False',
        "pass",
        (WATCHED, "middle"),
    ),
    _track(
        "frames count though somebody jumped",
        "tick/region.py",
        'if not track["stamp"] > -np.inf or _doubted(memory, k, e):',
        'if not track["stamp"] > -np.inf:',
        "hidden_after",
    ),
    _track(
        "a region need not be seen",
        "tick/region.py",
        'return time - arm["frame"] <= settings.max_age + STAMP_ROUNDING',
        "return True",
        "nobody_sees",
    ),
    _track(
        "dropped whatever the error",
        "tick/region.py",
        '(time - track["stamp"]) + settings.position_error',
        '(time - track["stamp"])',
        "error_of_places",
    ),
    _track(
        "lost is forgotten",
        "shields/association.py",
        "if j not in kept and met[j] and not track_left(arms, seen.time, j, False)",
        "if False",
        "lost_inside or jumps",
    ),
    _track("either of two", "shields/association.py", "if len(near) == 1:", "if near:", "either_of_two"),
    _track(
        "ids are right",
        "shields/association.py",
        "if all(settle(i, set())",
        "if False and all(settle(i, set())",
        "exchanged",
    ),
    _track("any number", "shields/association.py", "if len(source) > self._capacity:", "if False:", "more_people"),
    # in front of a controller
    _guard(
        "what is no command is followed",
        "guard/guard.py",
        "wrong = self._follower.jerk(command, state, self._nominal) or wrong",
        "self._follower.jerk(command, state, self._nominal)",
        "no_command",
    ),
    _guard(
        "a late tick skips a part of the stop",
        "tick/joints.py",
        "if leapt and not settings.paced:",
        "if leapt:",
        "further_along",
    ),
    _guard(
        "a doubled tick is held against the clock for good",
        "tick/joints.py",
        "        if not settings.paced:\n            # what is",
        "        if True:\n            # what is",
        "doubled",
    ),
    _guard("jitter makes people older", "tick/people.py", "    if settings.paced:", "    if False:", "with_jitter"),
    _guard("any rate will do", "guard/clock.py", "if abs(self._off) <= TOLERANCE:", "if True:", "another_rate_than"),
    _guard("a rate may be off by half", "guard/clock.py", "TOLERANCE = 0.05", "TOLERANCE = 0.5", "another_rate_than"),
    _guard("half a tick late is on time", "guard/clock.py", "math.floor(passed + MISSED)", "round(passed)", "all_come"),
    _guard("lost time is made up for", "guard/clock.py", "HASTY = 0.5", "HASTY = 0.0", "catches_up"),
    _guard("measured states are not compared", "guard/guard.py", "self._watched = True", "pass", "measured_state_that"),
    _guard("measuring begins in motion", "guard/guard.py", "if not self._step.rests:", "if False:", "rests_only"),
    _guard("measured states cost nothing", "guard/guard.py", "decider(STATE_TOLERANCE)", "decider()", "tenth_of"),
    _guard("answers share their arrays", "guard/answers.py", "count() != self._free", "count() < 0", "kept_answers"),
    _guard(
        "people as old as the tick", "guard/inputs.py", "self._age.fill(float(age))", "self._age.fill(0.0)", "ages_with"
    ),
    _stream("a lost packet is no trouble", "None if trouble or self.halted else", "None if self.halted else", "lost"),
    _stream("halted, but commanded", "None if trouble or self.halted else", "None if not people else", "fault_of"),
    _stream("drives may be anywhere", "if off[j] <= ASTRAY:", "if True:", "drive_that"),
    _stream("duplicates are news", "not 0 < ahead < 0x8000_0000", "ahead < 0", "gaps"),
    _stream("late packets are ticks", ">= LATE * self.guard.dt", ">= 0.0", "comes_late"),
    _stream("tables are not looked at", "if excess := tables.excess(guard.robot):", "if False:", "refused_before"),
    _stream("people are as old as before the wait", "max(self._heard - entered, 0.0)", "0.0", "grow_older"),
    _stream("an arm that coasts rests", "now - since >= SETTLED", "True", "rest_before or does_not_rest"),
    _stream(
        "silence slows the stop",
        "max(self._heard + self.guard.dt, now - LATE * self.guard.dt)",
        "now",
        "silence_positions",
    ),
    _stream("drives may lag for ever", "math.ceil(lag / guard.dt) + 1", "10_000", "may_lag"),
    _stream("drives do not lag", "if lag <= 0.0:", "if False:", "refused_before"),
    _stream("the stream ends in motion", "bool(self.halted) and self.guard.rests", "bool(self.halted)", "fault_of"),
    # how the arm moves and how long it takes, as it is told
    _jumps("wanted and applied jerks swapped", "jumps, wanted = _jumps", "wanted, jumps = _jumps"),
    _jumps("jumps: wanted jerk not clipped", "np.clip(nominal, -bound, bound)", "nominal"),
    _jumps("jumps: only upwards", "np.abs(np.diff(jerk, axis=0))", "np.diff(jerk, axis=0)"),
    _jumps("jumps: from rest into the first step", "np.diff(jerk, axis=0)", "np.diff(jerk, axis=0, prepend=0.0)"),
    _jumps("jumps: of all joints together", "np.any(", "np.all("),
    _jumps("jumps: one bound for all joints", "> bound * (1.0 + _ROUNDING)", "> bound.max() * (1.0 + _ROUNDING)"),
    _jumps("jumps: by rounding alone", "bound * (1.0 + _ROUNDING)", "bound"),
    _jumps(
        "jumps: policy's told as the shield's", "jumps & wanted, jumps & ~wanted", "jumps & ~wanted, jumps & wanted"
    ),
    Mutant(
        "jumps of what was asked for, not applied",
        "evaluation/metrics.py",
        "jerk_jumps(trace.jerk, trace.nominal, limits.jerk)",
        "jerk_jumps(trace.nominal, trace.jerk, limits.jerk)",
        ("tests/evaluation/test_evaluation.py", "summary_by_hand"),
    ),
    Mutant(
        "switches a step, not a second",
        "evaluation/steps.py",
        "int((np.diff(steps.status) != 0).sum()) / (count * dt)",
        "int((np.diff(steps.status) != 0).sum()) / count",
        (MOVED, "switches"),
    ),
    Mutant(
        "switches away from NOMINAL alone",
        "evaluation/steps.py",
        "(np.diff(steps.status) != 0)",
        "(np.diff(steps.status) > 0)",
        (MOVED, "switches"),
    ),
    Mutant(
        "slowdown upside down",
        "evaluation/slowdown.py",
        "here / there",
        "there / here",
        (MOVED, "goal_by_goal"),
    ),
    Mutant(
        "slowdown: goals that were left again count",
        "evaluation/slowdown.py",
        "np.where(could & done,",
        "np.where(could,",
        ("tests/evaluation/test_slowdown.py", "left_again"),
    ),
    Mutant(
        "Home's goals have a time to them",
        "evaluation/standings.py",
        "if one.task not in TASKS or TASKS[one.task].ends",
        "if True",
        (MOVED, "held_from_the_beginning"),
    ),
    Mutant(
        "episodes are compared with others",
        "evaluation/standings.py",
        "if [_trial(one) for one in report.episodes] != [_trial(one) for one in first.episodes]:",
        "if False:",
        (MOVED, "nothing_to_compare_with"),
    ),
    Mutant(
        "energies: twice what a body part may be given",
        "safety/energy.py",
        "math.sqrt(2.0 * energy / mass_of(part))",
        "math.sqrt(4.0 * energy / mass_of(part))",
        (ENERGY, "keep_the_energy"),
    ),
    Mutant(
        "energies: of several regions the hardest one counts",
        "safety/energy.py",
        "return min(region.energy for region in regions_of(part))",
        "return max(region.energy for region in regions_of(part))",
        (ENERGY, "keep_the_energy"),
    ),
    Mutant(
        "energies: a contact speed is no bound beside one",
        "safety/failsafe.py",
        "return min(speed, slow) if speed > 0.0 else slow",
        "return slow",
        (ENERGY, "is_a_contact_speed"),
    ),
    Mutant(
        "energies: the arm weighs nothing",
        "evaluation/geometry.py",
        "reduced = human / (1.0 + human / mass)",
        "reduced = human / (1.0 + 100.0 * human / mass)",
        (ENERGY, "share_the_motion"),
    ),
    Mutant(
        "data sets: people who come are not seen",
        "datasets/episode.py",
        "if scene.human.names != people.names:",
        "if False:",
        (DATA, "who_come"),
    ),
    Mutant(
        "data sets: what is checked is not what is read",
        "datasets/minari.py",
        "digest.update(array.tobytes())",
        'digest.update(b"")',
        ("tests/cli/test_dataset.py", "what_was_changed"),
    ),
    Mutant(
        "leaderboard: half a table is one",
        "board/episodes.py",
        "if not archive.eof:",
        "if False:",
        ("tests/board/test_board.py", "no_board"),
    ),
    _seen(
        "keypoints: those that jump are believed",
        "near = way <= self._speed * elapsed",
        "near = way <= np.inf + 0.0 * elapsed",
        "jumps or taken_for_each_other",
    ),
    _seen(
        "keypoints: those that could be another's are believed",
        "whole[i] &= ~mistaken | whole[j]",
        "whole[i] &= ~mistaken | True",
        "whoever_is_called",
        "tracker",
    ),
    _seen(
        "keypoints: places are the filter's",
        "room = np.maximum(self._allowed - error, 0.0)",
        "room = np.full_like(error, np.inf)",
        "keep_the_promise",
    ),
    _seen(
        "keypoints: what is held is new", "self.stamp[k] = stamp - late", "self.stamp[k] = stamp", "wrist or inside_of"
    ),
    _seen(
        "keypoints: joints are held for ever",
        "<= self._params.hold for joint in",
        "<= np.inf for joint in",
        "wrist",
    ),
    _seen("keypoints: held despite a bound of acceleration", "self._held[k] and younger", "younger", "wrist"),
    _seen(
        "keypoints: strangers are forgotten",
        "self._stranger = self._stranger or not",
        "self._stranger = not",
        "announced",
        "tracker",
    ),
    _seen(
        "keypoints: half seen is seen",
        "if count[k] >= self._needed[k]",
        "if count[k] >= 1",
        "inside_of or last_frame",
    ),
    Mutant(
        "keypoints: velocities are right but for accelerations",
        "perception/filtering.py",
        "gain * error[:, None],",
        "0.0 * gain * error[:, None],",
        (SEEN, "velocities_are_within or hardly_larger"),
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
        done = subprocess.run(
            command, cwd=copy, env=environment, capture_output=True, text=True, timeout=PATIENCE,
            # were both limits one, it would end as what runs out of memory does
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (LONGEST, LONGEST + 60)),
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "failed", "waited for ever"
    if done.returncode == -signal.SIGXCPU:
        return "failed", "took too long"
    if done.returncode == -signal.SIGKILL:
        return f"error {done.returncode}, as if out of memory", ""
    first = next((line for line in done.stdout.splitlines() if line.startswith("FAILED")), "")
    return {0: "passed", 1: "failed"}.get(done.returncode, f"error {done.returncode}"), first[7:].split(" - ")[0]


def judge(mutant: Mutant, copy: Path) -> tuple[str, str]:
    """Run the mutant's tests on a copy that has it, and take it out again: the verdict, and the first failure."""
    path = copy / "jssa_gym" / mutant.file
    source = path.read_text()
    if source.count(mutant.old) != 1:
        return "DOES NOT FIT", f"{source.count(mutant.old)} places in {mutant.file}"
    path.write_text(source.replace(mutant.old, mutant.new))
    outcome, first = run(mutant.tests, copy)
    path.write_text(source)
    return {"failed": "killed", "passed": "SURVIVED"}.get(outcome, outcome.upper()), first


def sources(copy: Path) -> str:
    """Hash of all files of package and tests, of which any may decide what is noticed."""
    digest = hashlib.sha256()
    for path in sorted(path for part in PARTS for path in (copy / part).rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(f"{path.relative_to(copy).as_posix()}\0{path.stat().st_size}\0".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _of(mutant: Mutant, source: str) -> str:
    """Hash of a mutant and of the sources that it was tried on."""
    return hashlib.sha256(repr((source, tuple(mutant))).encode()).hexdigest()[:16]


def line(verdict: str, seconds: float, mutant: Mutant, first: str, source: str) -> str:
    """What a log says of a mutant."""
    return f"{verdict}\t{seconds:.0f}\t{mutant.name}\t{_of(mutant, source)}\t{first}\n"


def killed(log: Path | None, mutants: list[Mutant], source: str) -> set[str]:
    """Names of the mutants that a run before noticed on the same sources, by its log."""
    if log is None or not log.exists():
        return set()
    told = {tuple(one.split("\t")[:4]) for one in log.read_text(encoding="utf-8").splitlines()}
    of = {(name, token) for verdict, _, name, token in (one for one in told if len(one) == 4) if verdict == "killed"}
    return {mutant.name for mutant in mutants if (mutant.name, _of(mutant, source)) in of}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("words", nargs="*", metavar="WORD", help="only mutants whose name has one of them")
    parser.add_argument(
        "--log",
        type=Path,
        help="a line for each goes there; what it says was killed of these sources is left out",
    )
    args = parser.parse_args()
    chosen = [mutant for mutant in MUTANTS if not args.words or any(word in mutant.name for word in args.words)]
    unchanged = dict[tuple[str, str], tuple[str, str]]()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        ignore = shutil.ignore_patterns("__pycache__")
        for part in PARTS:
            shutil.copytree(ROOT / part, copy / part, ignore=ignore)
        shutil.copy(ROOT / "pyproject.toml", copy)
        source = sources(copy)
        before = killed(args.log, chosen, source)
        left = [mutant for mutant in chosen if mutant.name not in before]
        verdicts = ["killed"] * (len(chosen) - len(left))
        for number, mutant in enumerate(left, len(chosen) - len(left) + 1):
            begun = time.perf_counter()
            if mutant.tests not in unchanged:
                unchanged[mutant.tests] = run(mutant.tests, copy)
            outcome, first = unchanged[mutant.tests]
            verdict = f"UNCHANGED {outcome.upper()}"
            if outcome == "passed":
                verdict, first = judge(mutant, copy)
            verdicts.append(verdict)
            seconds = time.perf_counter() - begun
            print(f"{number:3d}  {verdict:9s} {seconds:5.0f} s  {mutant.name:48s} {first}", flush=True)
            if args.log is not None:
                with args.log.open("a", encoding="utf-8") as log:
                    log.write(line(verdict, seconds, mutant, first, source))
    noticed, survived = verdicts.count("killed"), verdicts.count("SURVIVED")
    print(f"{len(chosen)} mutants: {noticed} killed, {survived} survived, {len(chosen) - noticed - survived} broken")
    return int(noticed < len(chosen))


if __name__ == "__main__":
    sys.exit(main())
