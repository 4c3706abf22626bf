"""Prints what the kernels compute for a few fixed inputs, as JSON; run by test_compiled.py in both modes."""

import json

import numpy as np

from jssa_gym.humans import Body, nobody
from jssa_gym.kernels.capsules import measure_planes, measure_self
from jssa_gym.kernels.chain import drift_of, jacobian, jacobian_rate
from jssa_gym.kernels.contact import observe
from jssa_gym.kernels.derivatives import derivatives
from jssa_gym.kernels.index import assess, exact_rows
from jssa_gym.kernels.motion import brake, integrate, scale_action, violates
from jssa_gym.kernels.printed import measure_present, printed_rows
from jssa_gym.kernels.projection import project_row, project_rows, scratch, violation
from jssa_gym.kernels.reach import nearest_to_point, nearest_to_walker
from jssa_gym.kernels.records import AGENT, FRAME, PAIR, PLANE, SEGMENT, STOP, records
from jssa_gym.kernels.stopping import parts_keep, peak_speed, plan_stop, step_keeps, stop_at, stop_jerk
from jssa_gym.kernels.viability import jerk_box
from jssa_gym.robots import make_robot
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import IndexParams
from jssa_gym.safety.proximity import agent_records
from jssa_gym.shields import make_filter
from jssa_gym.shields.reasons import reason_code
from jssa_gym.types import JointState, Planes, Scene

TAU = 0.008


def decided(robot):
    """What whole control steps come to, beside somebody who walks up to an arm that moves."""
    planes, jerk = Planes(np.array([[0.0, 0.0, 1.0]]), np.array([0.87]), ("table",)), np.array(robot.limits.jerk)
    for name in ("jssa", "jssa_published", "none", "stop", "cbf"):
        for stop in (None, FailsafeParams()):
            chosen = make_filter(name, robot, TAU, viability=stop is not None, failsafe=stop)
            state, said = np.array([robot.home, np.zeros(robot.n), np.zeros(robot.n)]), f"{name} {stop is not None}"
            for k in range(40):
                people = Body.facing().at((0.95 - 0.8 * TAU * k, 0.1), (-0.8, 0.0))
                count = len(people.radius)
                fine = np.zeros(count), np.ones(count, np.bool_)
                scene = Scene(TAU * k, JointState(*state.copy()), people, nobody(), planes, *fine)
                if k == 0:
                    chosen.reset(scene)
                decision = chosen.decide(None if k == 20 else scene, 0.3 * jerk * [0, 1, -1, 0, 1, 0])
                yield said, [*decision.jerk, decision.phi, decision.distance, *decision.pair, decision.rows]
                yield f"{said} status", [decision.status, reason_code(decision)]
                integrate(state, decision.jerk, TAU, state)


def main() -> None:
    robot = make_robot("lr_mate_200id_7l").mounted([0.0, 0.0, 0.87])
    n, bound = robot.n, np.array(robot.limits.jerk)
    rng = np.random.default_rng(3)
    index = IndexParams(lambda1=3.0, lambda2=1.0, sliding=True).kernel()
    planes = records(1, PLANE)
    planes["normal"], planes["offset"] = [0.0, 0.0, 1.0], 0.87
    result: dict[str, list[float]] = {}

    def keep(name: str, value) -> None:
        numbers = np.asarray(value, float).ravel()
        result.setdefault(name, []).extend(np.where(np.isfinite(numbers), numbers, 0.0).tolist())

    for _ in range(4):
        state = np.array([robot.home + rng.normal(size=n) * 0.3, rng.normal(size=n), rng.normal(size=n) * 3.0])
        jerk = rng.uniform(-1.0, 1.0, n) * bound
        agents = agent_records(Body.facing().at((0.75 + rng.uniform(0.0, 0.3), 0.1), (-0.8, 0.1)))
        frames, segments = records(n, FRAME), records(len(robot.capsules), SEGMENT)
        pairs, after = records((len(segments), len(agents) + 1), PAIR), np.zeros((3, n))
        worst = assess(
            robot.links, robot.capsules, state, jerk, agents, planes, TAU, index, after, frames, segments, pairs
        )
        keep("assess", worst)
        for name in ("distance", "s", "r", "phi"):
            keep(f"pair {name}", pairs[name])
        for name in ("origin", "omega", "alpha", "psi", "velocity", "acceleration", "drift"):
            keep(f"frame {name}", frames[name])
        L, S, owner = np.zeros((40, n)), np.zeros(40), np.zeros(40, np.int64)
        now, target = records(pairs.shape, PAIR), np.zeros(40)
        now["phi"] = pairs["phi"] + 0.1
        ahead = (frames, segments, agents, planes, pairs, jerk, -bound, bound, TAU, index, -1, -np.inf)
        count = exact_rows(*ahead, bound, 1e-3, 0.5, now, L, S, owner, target)
        keep("recovering", S[:count])
        keep("target", target[:count])
        count = exact_rows(*ahead, bound, 1e-3, 0.0, now, L, S, owner, target)
        keep("rows", L[:count])
        keep("right", S[:count])
        out = np.zeros(n)
        _, left = project_rows(jerk, L, S, count, -bound, bound, np.eye(n), *scratch(n, count), out)
        keep("projection left", left)
        if left < 1e-9:
            keep("projection", out)
            keep("violation", violation(L, S, count, out))
        project_row(jerk, L[0], S[0], -bound, bound, np.ones(n), out)
        keep("one row", out)

        columns = np.zeros((3, n))
        jacobian(frames, n - 1, np.array([0.4, 0.1, 1.4]), columns)
        keep("jacobian", columns)
        jacobian_rate(frames, n - 1, np.array([0.4, 0.1, 1.4]), columns)
        keep("jacobian rate", columns)
        keep("drift", drift_of(frames[n - 1], np.array([0.1, 0.0, 0.1])))

        human_pairs = records((len(segments), len(agents)), PAIR)
        near, parts = np.zeros(13), np.zeros(6)
        observe(robot.links, robot.capsules, state, agents, index, frames, segments, human_pairs, near, parts)
        keep("observe", near)
        keep("parts", parts)
        measure_present(robot.links, robot.capsules, state, agents, frames, segments, human_pairs)
        count = printed_rows(frames, segments, agents, human_pairs, -bound, bound, TAU, index, -1, 1e-3, L, S, owner)
        keep("printed", L[:count])
        present = (np.zeros((human_pairs.size, 4)), np.zeros((human_pairs.size, n)), np.zeros((human_pairs.size, 3)))
        parameters = IndexParams().array()
        derivatives(robot.links, robot.capsules, state, agents, parameters, frames, segments, human_pairs, *present)
        for name, values in zip(("motion", "normal jacobian", "normal"), present, strict=True):
            keep(name, values)
        keep("present phi", human_pairs["phi"])
        own, plane_pairs = np.zeros(len(robot.self_pairs)), records((len(segments), 1), PAIR)
        measure_self(segments, robot.self_pairs, own)
        measure_planes(segments, planes, plane_pairs)
        keep("own", own)
        keep("planes", plane_pairs["distance"])

        links = [np.ascontiguousarray(segments[name]) for name in ("start", "end", "radius")]
        body = Body.facing(0.3)
        keep("walker", nearest_to_walker(body.start, body.end, body.radius, 0.9, 0.2, *links))
        distance, point = nearest_to_point((0.7, 0.1, 1.3), *links)
        keep("point", [distance, *point])

        integrate(state, jerk, TAU, after)
        keep("integrate", after)
        brake(state, -bound, bound, TAU, out)
        keep("brake", out)
        fraction = rng.uniform(-2.0, 2.0, n)
        keep("scaled", [scale_action(fraction, bound, out), *out])
        limits = robot.limits
        rows = np.array([*limits.position.T, limits.velocity, limits.acceleration, limits.jerk])
        keep("violates", [violates(state, jerk, rows, 1e-9)])

        plan, lower = records(n, STOP), np.zeros(n)
        keep("stop", plan_stop(state, rows, TAU, plan))
        for name in ("ramp", "hold", "release", "jerk_in", "jerk_out"):
            keep(f"stop {name}", plan[name])
        for i, (q, v, a) in enumerate(state.T):
            for t in (0.0, 0.05, 0.3, 10.0):
                keep("stop at", stop_at(q, v, a, plan[i], TAU, t))
                keep("peak speed", peak_speed(v, a, plan[i], TAU, t))
            for scale in (1.0, 0.2):
                keep("stop keeps", parts_keep(q, v, a, *plan[i].item(), *(scale * rows[:, i]), TAU, 1e-9))
                keep("step keeps", step_keeps(q, v, a, jerk[i], *(scale * rows[:, i]), TAU, 1e-9))
        for tick in (0, 20, 30, 200):
            stop_jerk(plan, tick, out)
            keep("stop jerk", out)
        for scale in (1.0, 0.4):
            keep("box complete", jerk_box(state, scale * rows, TAU, lower, out))
            keep("box", [*lower, *out])
    assert records(1, AGENT).size == 1
    for name, value in decided(robot):
        keep(name, value)
    print(json.dumps(result))


if __name__ == "__main__":
    main()
