"""The position controller as a policy: it plans, and yields along its path or resumes, as in the paper."""

import logging
import math
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from jssa_gym.control.inverse import path_is_clear, postures_for, way_is_clear
from jssa_gym.control.jpc import JPC, Phase, Request
from jssa_gym.control.least_jerk import FEWEST
from jssa_gym.control.moves import plan_approach, plan_move, within_range
from jssa_gym.control.path import PacedPath
from jssa_gym.control.plan import Plan, plan_waypoints
from jssa_gym.control.yielding import YieldingJPC
from jssa_gym.exceptions import InfeasibleError, InterfaceError, ParameterError, UnreachableError
from jssa_gym.policies.delays import Delay, drawn_delay
from jssa_gym.robots import JointLimits
from jssa_gym.safety.postures import room
from jssa_gym.types import Array, JointState, Planes, Scene
from jssa_gym.validation import positive_number, true_or_false

_logger = logging.getLogger(__name__)

_SLOWER = 0.7
"""By which speed and acceleration are reduced after an interruption that came before the next waypoint."""

_SLOWEST = 0.15
"""Share of the limits that is left at least."""

_HURRY = 0.85
"""Share of the period between waypoints once the schedule was interrupted: it may be again."""


_SPARING = 0.7
"""Share of the acceleration and jerk limits that a plan that is to yield takes: the rest is for changes of its pace."""


class JPCPolicy:
    """Drives any task by the jerk-bounded position controller: the scripted baseline.

    It plans jerks within all joint limits to the environment's goal, reads them from a buffer, and notices from the
    joint state alone when a shield commands something else; see ``docs/control.md``. The goal is
    ``env.unwrapped.goal``, which ``env.unwrapped.task.space`` says how to read: ``"joints"`` for a posture (n,) or
    waypoints (K, n) that ``task.period`` seconds lie between and that count as met within ``task.tolerance`` (root
    mean square), if it has one; ``"tip"`` for a point (3,) for the tool that may move. An environment without a task is
    kept at the robot's home. Interrupted again and again on the way to the same waypoint, it goes there more slowly
    every time: what a shield refuses at full speed it may grant at less.

    It yields: inside a shield it offers its path (:class:`~jssa_gym.control.path.PacedPath`), which the shield slows
    the arm down along; that is no interruption. Thrown off it, the arm rejoins it ahead without coming to rest. Plans
    are checked as a whole against what stands still, and take 0.7 of the acceleration and jerk limits if that will do.
    With ``yielding=False`` it is the paper's: any jerk that is not its own ends the plan, and after a stop there is a
    new one.

    It has to be called in every tick, so not outside of an :class:`~jssa_gym.ActionRepeat`.

    Args:
        env: The environment, wrapped or not.
        seed: Seed of the host's delays and of the inverse kinematics' restarts.
        host_delay: Time that the host takes for a plan [s]: a number, (low, high), or a function of a generator.
        tolerance: How far a goal of the tool may move before there is a new plan [m].
        clear: Distance that postures and ways keep from half-spaces and the arm from itself, where they can [m]; half
            of what there is at home, if that is less.
        patience: See :class:`~jssa_gym.control.jpc.JPC`.
        yielding: Whether it yields along its path, or is interrupted as in the paper.

    Raises:
        ParameterError: An argument is out of range.
    """

    def __init__(
        self,
        env: gym.Env,
        seed: int | None = None,
        *,
        host_delay: Delay = (0.0, 0.1),
        tolerance: float = 0.01,
        clear: float = 0.01,
        patience: float = 2.5,
        yielding: bool = True,
    ) -> None:
        self._env, self._rng = env, np.random.default_rng(seed)
        self.offer_to(env)
        self._robot = env.get_wrapper_attr("robot")
        self._dt = float(env.get_wrapper_attr("dt"))
        self._delay = drawn_delay(host_delay)
        self._tolerance, self._wanted = positive_number("tolerance", tolerance), positive_number("clear", clear)
        self._clear = self._wanted
        self._jerk_bound = np.array(self._robot.limits.jerk)
        task = getattr(env.unwrapped, "task", None)
        self._tip = getattr(task, "space", "joints") == "tip"
        period = getattr(task, "period", None)
        # up to the grid; what a tick's rounding adds is nobody's lateness
        self._period = None if period is None else math.ceil(period / self._dt - 1e-6) * self._dt
        self._near = 0.0 if period is None else float(getattr(task, "tolerance", 0.0))
        self._yields = true_or_false("yielding", yielding)
        limits = self._robot.limits
        self.jpc: JPC = JPC(limits, self._dt, patience=patience)
        if self._yields:
            self.jpc = YieldingJPC(limits, self._dt, self._is_clear, schedule=period is not None, patience=patience)
        self._scene: Scene | None = None
        self._time = np.inf

    def _restart(self, planes: Planes) -> None:
        self.jpc.reset()
        self._clear = min(room(self._robot, planes, (self._wanted, self._wanted)))
        self._goal = np.zeros(0)
        self._seen = self.jpc.request
        self._due: list[tuple[int, Request, Array]] = []
        self._refused = False  # whether the host found no plan to the goal
        self._tick = 0
        self._share, self._met, self._done = 1.0, 0, True
        self._visited = 0  # waypoints that the arm has been near, in their order
        self._late = False  # whether the schedule was interrupted

    def __call__(self, observation: Any) -> Array:
        """The next jerk of the buffer as a share of the jerk bounds, shape (n,)."""
        self._scene = scene = self._env.get_wrapper_attr("scene")
        if scene.time <= self._time:  # a clock that went back is a new episode's
            self._restart(scene.planes)
        self._time = scene.time
        goal = np.asarray(getattr(self._env.unwrapped, "goal", self._robot.home), float)
        if goal.shape != self._goal.shape or self._has_moved(goal):
            self._goal, self._refused = np.array(goal), False
            self._visited, self._late = 0, False
            self.jpc.assign()
        if self._due:
            self._answer(scene.planes)
        state = scene.robot
        self._look_around(state.position)
        jerk = self.jpc.step(np.array((state.position, state.velocity, state.acceleration)))
        if isinstance(self.jpc, YieldingJPC) and self.jpc.path is not None:
            self._offer(self.jpc.path)
        request = self.jpc.request
        if request is not None and request is not self._seen:
            self._choose_share(request)
            delay = self._delay(self._rng)
            if np.isfinite(delay):
                self._due.append((self._tick + max(1, round(delay / self._dt)), request, self._goal))
        self._seen = request
        self._done = self._done or self.jpc.phase is Phase.IDLE
        self._tick += 1
        return np.clip(jerk / self._jerk_bound, -1.0, 1.0)  # rounding

    def reseed(self, seed: int | None) -> None:
        """The episode that begins next is one of a policy that was made with this seed."""
        self._rng = np.random.default_rng(seed)

    @property
    def follows(self) -> bool:
        """Whether a goal of the tool that moves is planned to anew.

        One replan at a time, or a goal that never stops would make every answer void; a refusal is none.
        """
        return self._refused or self.jpc.request is None or self.jpc.phase is Phase.IDLE

    def offer_to(self, env: gym.Env) -> None:
        """Offer paths to the shield among the wrappers of ``env``, which need not be what the policy looks at."""
        self._take = env.get_wrapper_attr("offer") if env.has_wrapper_attr("offer") else None

    def _offer(self, path: PacedPath) -> None:
        """Have a shield choose among the path's alternatives; without one, the first is what is applied."""
        try:
            if self._take is not None:
                self._take(path)
                return
        except InterfaceError:  # a filter with a decide of its own, which only knows the action
            _logger.info("the shield takes no path; it is interrupted as by hand")
            self._take = None
        path.took(0)

    def _is_clear(self, positions: Array) -> bool:
        """Whether a motion is clear of what stands still now."""
        scene = self._scene
        return scene is None or path_is_clear(self._robot, positions, scene.planes, scene.static, self._clear)

    def _look_around(self, position: Array) -> None:
        """Count the waypoints that the arm comes near, whoever commands it."""
        if self._period is None or self._goal.ndim != 2:
            return
        if self._visited < len(self._goal):
            gap = self._goal[self._visited] - position
            self._visited += bool(gap.dot(gap) <= len(gap) * self._near**2)
        self.jpc.count(self._visited)

    def _choose_share(self, request: Request) -> None:
        """Slower after an interruption, at full speed again after a waypoint or at the goal."""
        if self.jpc.phase is Phase.SETTLING:
            self._late = True
            self._share = max(_SLOWER * self._share, _SLOWEST)
        elif self.jpc.phase is not Phase.WAITING or self._done:
            self._share = 1.0
        if request.met > self._met:
            self._share = 1.0
        self._met, self._done = request.met, False

    def _limits(self, state: JointState) -> JointLimits:
        """Those to plan with; all of them in motion, which may already need them."""
        full = self._robot.limits
        if self._share == 1.0 or np.any(state.velocity):
            return full
        return JointLimits(full.position, self._share * full.velocity, self._share * full.acceleration, full.jerk)

    def _made(self, limits: JointLimits, make: Callable[[JointLimits], Plan]) -> Plan:
        """A plan within the limits; one that is to yield with room to do so if possible, and clear all the way.

        Raises:
            InfeasibleError: There is none.
        """
        if not self._yields:
            return make(limits)
        spared = JointLimits(limits.position, limits.velocity, _SPARING * limits.acceleration, _SPARING * limits.jerk)
        try:
            plan = make(spared)
        except InfeasibleError:
            plan = make(limits)
        if not self._is_clear(plan.states[:, 0]):
            raise InfeasibleError("on its way the arm would touch the table, what stands around or itself")
        return plan

    def _has_moved(self, goal: Array) -> bool:
        if not self._tip:
            return not np.array_equal(goal, self._goal)
        return self.follows and bool(np.abs(goal - self._goal).max() > self._tolerance)

    def _answer(self, planes: Any) -> None:
        """Hand over what the host has finished by now; it need not have worked on what is void."""
        due = [entry for entry in self._due if entry[0] <= self._tick]
        self._due = [entry for entry in self._due if entry[0] > self._tick]
        for _, request, goal in due:
            if self.jpc.request is not None and request.number == self.jpc.request.number:
                plan = self._plan(request, goal, planes)
                self._refused = plan is None
                self.jpc.deliver(request.number, plan)

    def _plan(self, request: Request, goal: Array, planes: Any) -> Plan | None:
        """The host: a plan from the requested state through what is left of the task; None if there is none."""
        state = JointState(*request.state)
        if not within_range(state.position, self._robot.limits):
            _logger.info("no plan: the arm was thrown out of its range")
            return None
        try:
            if self._tip:
                return self._to_point(state, goal, planes)
            if goal.ndim == 1:
                return self._to_posture(state, goal, planes)
            return self._through(state, goal[min(request.met, len(goal) - 1) :], planes)
        except (InfeasibleError, UnreachableError, ParameterError) as error:
            _logger.info("no plan: %s", error)
            return None

    def _to_point(self, state: JointState, point: Array, planes: Any) -> Plan:
        robot = self._robot
        slowed = isinstance(self.jpc, YieldingJPC) and self.jpc.path is not None
        if slowed or np.any(state.velocity):
            # a goal that moves while the arm does: the nearest posture goes on from the present one
            postures = postures_for(robot, point, planes, state.position, self._rng, restarts=0, clear=self._clear)
            return self._made(self._limits(state), lambda limits: plan_approach(state, postures[0], limits, self._dt))
        postures = postures_for(robot, point, planes, state.position, self._rng, clear=self._clear)
        for posture in postures:
            if way_is_clear(robot, state.position, posture, planes, self._clear):
                return self._made(
                    self._limits(state), lambda limits, to=posture: plan_move(state.position, to, limits, self._dt)
                )
        return self._to_posture(state, postures[0], planes)

    def _to_posture(self, state: JointState, posture: Array, planes: Any) -> Plan:
        robot, dt, clear, start = self._robot, self._dt, self._clear, state.position
        home = np.array(robot.home)
        if np.any(state.velocity) or way_is_clear(robot, start, posture, planes, clear):
            return self._made(self._limits(state), lambda limits: plan_approach(state, posture, limits, dt))
        round_about = way_is_clear(robot, start, home, planes, clear)
        if not (round_about and way_is_clear(robot, home, posture, planes, clear)):
            return self._made(self._limits(state), lambda limits: plan_move(start, posture, limits, dt))

        def by_home(limits: JointLimits) -> Plan:
            via = plan_move(start, home, limits, dt).then(plan_move(home, posture, limits, dt))
            return Plan(dt, via.jerk, via.states, via.marks[-1:])

        return self._made(self._limits(state), by_home)

    def _through(self, state: JointState, waypoints: Array, planes: Any) -> Plan:
        """Waypoints a period apart; from too far away, or after an interruption, first to the next one, fast.

        A schedule that waits for the arm loses what passes until then, and nothing else; see :class:`Track`.
        """
        if self._period is None:
            raise ParameterError("waypoints need task.period, the time between them [s]")
        dt, period = self._dt, self._period
        if not self._late:
            try:
                return self._made(
                    self._limits(state),
                    lambda limits: plan_waypoints(state, waypoints, period, limits, dt, shortest=False),
                )
            except InfeasibleError:
                pass
        first = self._to_posture(state, waypoints[0], planes)
        if len(waypoints) == 1:
            return first
        rest = JointState(waypoints[0], *np.zeros((2, self._robot.n)))
        if self._late:
            period = max(round(_HURRY * period / dt), FEWEST) * dt
        later = self._made(
            self._robot.limits, lambda limits: plan_waypoints(rest, waypoints[1:], period, limits, dt, stretch=True)
        )
        return first.then(later)
