"""The environment: an arm driven by joint jerk beside people."""

import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from jssa_gym import robots
from jssa_gym.envs.drawing import Marks, goal_points
from jssa_gym.envs.goals import GOAL_TERMS, Goals
from jssa_gym.envs.observation import MOST_PEOPLE, Observation, arm_features, bodies, body_features
from jssa_gym.envs.options import check_arguments, checked_options, checked_step
from jssa_gym.envs.surroundings import Closest, Surroundings
from jssa_gym.envs.tasks import COMMON_TERMS, Moment, Progress, Task, make_task
from jssa_gym.envs.view import live_camera
from jssa_gym.envs.world import World, placed, planes_of
from jssa_gym.exceptions import InvalidActionError, ParameterError
from jssa_gym.headless import has_display
from jssa_gym.humans import Given, make_human, nobody
from jssa_gym.humans.body import PARTS as BODY
from jssa_gym.kernels.compiled import announce_compilation
from jssa_gym.kernels.motion import scale_action
from jssa_gym.kernels.walkers import walking_parts
from jssa_gym.robots import RobotModel, make_robot
from jssa_gym.safety.action import checked_action
from jssa_gym.safety.postures import clearances, nearest
from jssa_gym.tick.move import fill_observation, move
from jssa_gym.types import Array, CapsuleSet, JointState, Scene
from jssa_gym.validation import positive_number

_logger = logging.getLogger("jssa_gym")

DT = 0.008
"""Control step if nothing else is said: 125 Hz, the paper's [s]."""

MOVING = 1e-3
"""Speed of the robot's touching point from which a contact counts as moving [m/s]."""

START_CLEARANCE = 0.1
"""Smallest robot-human distance that an episode starts with [m]."""


class ArmEnv(gym.Env[Any, NDArray[np.float32]]):
    """An arm driven by joint jerk beside moving people, 125 Hz unless ``dt`` says otherwise.

    The joint state follows the paper's Eq. (1) exactly, jerk held over each step of 0.008 s. With
    ``dynamics="servo"`` MuJoCo simulates the arm's inertias under 1 kHz position servos that track that command;
    distances, contacts and success are then those of the simulated arm, and ``info["tracking_error"]`` (n,) [rad] is
    its position minus the command's. Limits are reported, not enforced: that is a shield's work. With servos
    ``limit_violation`` is of the command (position to jerk) and of the simulated arm, whose position may swing over by
    2 mrad and whose velocity by 2 % of its limit.

    **Action**: joint jerk as a share of the jerk bounds, ``Box(-1, 1, (n,), float32)``; float64 is taken as it is.

    **Observation**, float32, values clipped to the bounds (index, name, bounds, meaning; for the six joints and one
    kind of body)::

        0-5     position         [-1.5, 1.5]  joint position from mid-range / half range
        6-11    velocity         [-2, 2]      joint velocity / limit
        12-17   acceleration     [-2, 2]      joint acceleration / limit
        18-20   tip              [-2, 2]      tool centre point from the robot's base [m]
        21-23   gap              [-2, 2]      closest axis points: human's minus robot's [m]
        24-26   human_point      [-2, 2]      closest human axis point from the robot's base [m]
        27-29   human_velocity   [-3, 3]      its velocity [m/s]
        30-35   human_distance   [-0.5, 2]    surface distance of each body part to the arm [m]

    then the task's goal. Without a human the human's entries are at their upper bounds, the velocity 0. With
    ``observation="full"`` all body parts of up to three people stand before the task's part, starts, ends, their
    velocities and whether they are there. With ``observation="goal"`` it is a dictionary of ``observation``, which is
    without the task's part, ``achieved_goal`` and ``desired_goal``; the reward is then −1 in every step in which these
    are farther apart than the task's tolerance, beside the terms that all tasks have: ``compute_reward`` makes it for
    other goals.

    **Tasks**, with the goal's observation and the reward's terms:

    **home** (default human: ``approach_retreat``). Hold the home position (the paper's task). Success, within 0.05 rad
    (root mean square) for 0.1 s, never ends it.

    ::

        36-41   goal             [-1, 1]      home minus joint position / range
          -1.00 · posture    root mean square distance of the joints from home [rad]
          -0.01 · effort     mean squared action
          -0.50 · closeness  1 if the smallest distance is below d_min, else 0
          -5.00 · contact    1 in a contact with the arm moving, else 0

    **reach** (default human: ``random``). Bring the tool centre point within 0.02 m of a random target, slower than
    0.05 m/s, for 0.1 s.

    ::

        36-38   goal             [-2, 2]      target minus tool centre point, world axes [m]
          -1.00 · reach      distance of the tool centre point from the target [m]
          -1.00 · near       tanh(that distance / 0.1 m)
         +10.00 · success    1 on success, else 0
          -0.01 · effort     mean squared action
          -0.50 · closeness  1 if the smallest distance is below d_min, else 0
          -5.00 · contact    1 in a contact with the arm moving, else 0

    **track** (default human: ``constant_velocity``). Follow joint waypoints, one every period (1.5 s), in their order.
    The reference waits for an arm that is late. Success: all visited within 0.05 rad (root mean square) and, when the
    reference is at its end, there at rest (0.05 rad, 0.05 rad/s) for 0.1 s. info: track/visited, track/lateness [s],
    track/error [rad].

    ::

        36-41   goal             [-1, 1]      next waypoint minus joint position / range
        42-47   reference        [-1, 1]      reference minus joint position / range
        48      due              [0, 2]       time until the next waypoint is due / period
        49      visited          [0, 1]       share of the waypoints visited
          -1.00 · track      root mean square distance of the joints from the reference [rad]
         +10.00 · success    1 on success, else 0
          -0.01 · effort     mean squared action
          -0.50 · closeness  1 if the smallest distance is below d_min, else 0
          -5.00 · contact    1 in a contact with the arm moving, else 0

    **handover** (default human: ``receive``). Bring the tool centre point to a person's right hand, which moves: within
    0.03 m of a point 0.27 m from the hand on the robot's side, slower than 0.05 m/s, for 0.1 s.

    ::

        36-38   goal             [-2, 2]      handover point minus tool centre point, world axes [m]
          -1.00 · handover   distance of the tool centre point from the handover point [m]
          -1.00 · near       tanh(that distance / 0.1 m)
         +10.00 · success    1 on success, else 0
          -0.01 · effort     mean squared action
          -0.50 · closeness  1 if the smallest distance is below d_min, else 0
          -5.00 · contact    1 in a contact with the arm moving, else 0

    **deliver** (default human: ``random``). Fetch at one place and bring to another, twice: the tool centre point
    within 0.02 m of the place that is next, slower than 0.05 m/s, for 0.1 s, four legs in all. info: deliver/legs,
    deliver/deliveries, deliver/per_minute (until the last delivery).

    ::

        36-38   goal             [-2, 2]      next place minus tool centre point, world axes [m]
        39-41   other            [-2, 2]      the other place minus tool centre point, world axes [m]
        42      done             [0, 1]       share of the legs done
        43      stay             [0, 1]       time at the next place, at rest / time asked for
          -1.00 · deliver    way that is left: to the next place, and the legs after it [m]
          -1.00 · near       tanh(distance to the next place / 0.1 m) + number of legs after it
         +10.00 · success    1 on success, else 0
          -0.01 · effort     mean squared action
          -0.50 · closeness  1 if the smallest distance is below d_min, else 0
          -5.00 · contact    1 in a contact with the arm moving, else 0

    **Termination**: what ``terminate_on`` names: ``success``, ``contact``, ``moving_contact`` (the robot's touching
    point faster than 1e-3 m/s) or ``limit_violation``; the default is success and moving contact. A contact with the
    arm at rest never ends an episode by default. **Truncation**: after 1,000 steps (8 s), by ``TimeLimit``; another
    ``dt`` does not change their number, ``gym.make(..., max_episode_steps=...)`` does.

    **Start**: at rest at home, nobody closer than 0.1 m. ``reset(options={...})`` takes ``joint_position``, ``goal``
    and ``human_start``.

    **info**, the same keys and types after reset and step: ``distance`` [m] (smallest robot-human surface distance, inf
    without a human), ``contact`` (bool), ``contact_speed`` [m/s] (of the robot's touching point, 0.0 without contact),
    ``cost`` (1.0 when the distance is below ``d_min``), ``jerk`` (n,) [rad/s³] applied, ``limit_violation`` (bool),
    ``success`` (bool; as ``is_success`` too, which Stable-Baselines3 counts), ``reward/<term>`` (0.0 after reset) and
    what the task says; with a robot that leaves links without capsules ``uncovered`` (their joints' names) too.

    Args:
        task: ``"home"``, ``"reach"``, ``"track"``, ``"handover"``, ``"deliver"`` or a
            :class:`~jssa_gym.envs.tasks.Task`.
        human: A name in :data:`jssa_gym.humans.HUMANS`, a file of a recording or of motion capture (``.npz``, ``.csv``,
            ``.bvh``), a motion, or several of them; None for the task's default.
        dynamics: ``"kinematic"`` or ``"servo"``.
        scene: ``"table"`` (the base stands at 0.87 m, the arm must stay above) or ``"floor"``.
        robot: A name, a model, an MJCF file with its limits beside it, or a folder of ``jssa-gym robot check --write``;
            see :func:`~jssa_gym.robots.make_robot`.
        terminate_on: What ends an episode.
        d_min: Distance below which ``cost`` is 1 [m].
        dt: Control step [s], from 0.001 to 0.02; whole milliseconds with ``dynamics="servo"``. All durations of tasks
            and people stay what they are in seconds.
        observation: ``"closest"``, ``"full"`` or ``"goal"``; see above.
        render_mode: ``"rgb_array"``, ``"human"`` (a window, where there is a display; it keeps to real time) or None.
        width, height: Size of pictures [pixels].

    Raises:
        ParameterError: An argument is unknown or out of range.
        RobotModelError: The robot's file cannot be modelled.
        DisplayError: ``render_mode="human"`` without a display.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  # Gymnasium declares it so
        "render_modes": ["rgb_array", "human"],
        "render_fps": round(1.0 / DT),
    }
    """What can be rendered, and how fast; where there is no display, not ``human``."""

    def __init__(
        self,
        task: str | Task = "home",
        *,
        human: Given | Sequence[Given] | None = None,
        dynamics: Literal["kinematic", "servo"] = "kinematic",
        scene: Literal["table", "floor"] = "table",
        robot: str | Path | RobotModel = robots.DEFAULT,
        terminate_on: Sequence[str] = ("success", "moving_contact"),
        d_min: float = 0.05,
        dt: float = DT,
        observation: Literal["closest", "full", "goal"] = "closest",
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
    ) -> None:
        size = check_arguments(dynamics, terminate_on, observation, render_mode, width, height)
        self.dt = checked_step(dt, dynamics)
        announce_compilation(move, beside=walking_parts)
        self.planes = planes_of(scene)
        self.task = make_task(task)
        self.robot = placed(make_robot(robot), scene)
        if min(clearances(self.robot, self.robot.home, self.planes)) <= 0.0:
            told = nearest(self.robot, self.robot.home, self.planes)
            _logger.warning("%s cannot move from home under a shield: %s", self.robot.name, told)
        self.human = make_human(self.task.human if human is None else human)
        self.d_min = positive_number("d_min", d_min)
        self.render_mode = render_mode
        if not has_display():
            modes = [mode for mode in self.metadata["render_modes"] if mode != "human"]
            self.metadata = {**self.metadata, "render_modes": modes}
        if self.dt != DT:
            self.metadata = {**self.metadata, "render_fps": round(1.0 / self.dt)}
        self.dynamics, self.observation = dynamics, observation
        self.terminate_on = tuple(terminate_on)
        self._scene_name, self._size = scene, size
        self._world: World | None = None
        self._servo_ratio = np.zeros(self.robot.n)
        if dynamics == "servo":
            self._servo_ratio = self.world.servo_gains()

        n, limits = self.robot.n, self.robot.limits
        self._jerk_bound = np.array(limits.jerk)
        self._zero = np.zeros(n)
        # the people as they would begin some episode: how many capsules there are, and whether the goal is among them
        rehearsal = make_human(self.human).reset(np.random.default_rng(0))
        self.task.follow(np.zeros(0), rehearsal)
        comes = self.human.comers
        parts = len(rehearsal.radius) // max(self.human.people, 1) if comes is None else len(comes)
        if observation == "full":
            parts = parts or len(BODY)  # what is observed does not depend on how many there are
        self._around = Surroundings(self.robot, parts)
        self._static = nobody()
        self._parts = parts if observation == "full" else 0
        if self._parts and max(len(rehearsal.radius) // parts, self.human.people) > MOST_PEOPLE:
            raise ParameterError(
                f"observation='full' has room for {MOST_PEOPLE} people, here are {self.human.people}: take 'closest'"
            )
        self._goals = Goals(self.task, self.robot) if observation == "goal" else None
        seen = (*arm_features(self.robot, max(parts, 1)), *(body_features(self._parts) if self._parts else ()))
        self.layout = Observation(seen if self._goals else (*seen, *self.task.features(self.robot)))
        """Where in the observation what is, by name, how it is scaled and within which bounds."""
        self._scaling = self.layout.scaling(
            {"position": limits.position.mean(axis=1), "tip": self.robot.mount, "human_point": self.robot.mount}
        )
        self.observation_space: spaces.Space = self.layout.space
        if self._goals:
            apart = {"achieved_goal": self._goals.space, "desired_goal": self._goals.space}
            self.observation_space = spaces.Dict({"observation": self.layout.space, **apart})
        self.action_space = spaces.Box(-1.0, 1.0, (n,), np.float32)
        terms = (*(GOAL_TERMS if self._goals else self.task.terms), *COMMON_TERMS)
        self._terms = tuple((f"reward/{t.name}", t.weight) for t in terms)
        if (count := len(self.task.rewarded(0.0, False))) != len(self.task.terms):
            names = ", ".join(term.name for term in self.task.terms)
            raise ParameterError(f"task {self.task.name!r} has the terms {names}, but rewarded() gives {count} values")
        endings = self.terminate_on
        self._evolves = self.task.evolves
        self._ends_success = "success" in endings and self.task.ends
        self._ends_contact = "contact" in endings
        self._ends_moving, self._ends_violation = "moving_contact" in endings, "limit_violation" in endings
        self._hold_steps = max(self.task.hold_time / self.dt, 1.0) - 1e-9
        self._begin(np.array(self.robot.home), np.zeros(0), nobody())
        self._begun = False

    @property
    def world(self) -> World:
        """The MuJoCo model behind pictures and servo; built when it is first needed."""
        if self._world is None:
            width, height = self._size
            self._world = World(self.robot, self._scene_name, width=width, height=height)
            if self.render_mode is not None:
                self._world.look_from(live_camera(self.robot, self.human, width / height))
        return self._world

    @property
    def scene(self) -> Scene:
        """The present, as a perception system could know it; what shields read."""
        if self._scene is None:
            # copies: what somebody does to a scene must not move the arm
            state = self.state.copy()
            self._scene = Scene(
                self._time,
                JointState(state[0], state[1], state[2]),
                self._people,
                self._static,
                self.planes,
                np.zeros(len(self._people.radius)),
                np.ones(len(self._people.radius), np.bool_),
            )
        return self._scene

    @property
    def closest(self) -> Closest:
        """Truth about the closest robot-human pair, of the simulated arm."""
        return self._around.closest

    @property
    def line(self) -> tuple[Array, Array] | None:
        """Axis points of the closest robot-human pair, robot's first, shape (3,) [m] each; None without a human."""
        line = self._around.line
        return None if line is None else (line[0].copy(), line[1].copy())

    @property
    def goal(self) -> Array:
        """The task's goal at present; a copy. Empty before the first ``reset``."""
        return (self.task.present(self._goal, self._progress) if self._begun else self._goal).copy()

    @property
    def robot_capsules(self) -> CapsuleSet:
        """The arm's capsules in the world, with velocities; what reacting people see."""
        return self._around.robot_capsules

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode: the arm at rest at home, a goal and people drawn from the seed.

        Args:
            seed: Seed of all randomness; the same seed gives the same episode, bit for bit.
            options: ``joint_position`` (n,) [rad], ``goal`` (see the task) and ``human_start`` (2,), the first
                person's root [m], replace what would be drawn.

        Raises:
            ParameterError: An option is unknown or out of range.
        """
        position, goal, start = checked_options(options, self.robot, self.human, self.task)
        # the user's part is checked; only now does anything change
        super().reset(seed=seed)
        if goal is None:
            goal = self.task.draw_goal(self.np_random, self.robot, self.planes)
        for _ in range(100):
            self._begin(position, goal, self.human.reset(self.np_random, start))
            _, distance, contact_speed, _ = self._around.move(self.state, self._zero, 0.0)
            # nobody begins within reach of contact, unless the user puts them there
            if distance >= START_CLEARANCE or start is not None:
                break
        self._begun = True
        if self.dynamics == "servo":
            self.world.servo_reset(position)
        # the same keys and types as after a step: vector environments and recorders stack them
        info = self._info(np.zeros(self.robot.n), distance, contact_speed, False, False)
        info |= dict.fromkeys((key for key, _ in self._terms), 0.0)
        around = self._around
        moment = Moment(position, around.tip[0], around.tip_speed, self._zero, distance, False, self._progress)
        if self._evolves:
            self._goal = self.task.follow(self._goal, self._people)
            info |= self.task.metrics(self.task.value(self._goal, moment), moment)
        if self.render_mode == "human":
            self.render()
        return self._observed(moment), info

    def _begin(self, position: Array, goal: Array, people: CapsuleSet) -> None:
        n = self.robot.n
        self.state = np.array([position, np.zeros(n), np.zeros(n)])
        """Joint state that was commanded, rows position, velocity, acceleration; :attr:`scene` has a copy."""
        self._actual = self.state
        self._goal, self._progress = goal, Progress(position)
        self._time, self._steps, self._held = 0.0, 0, 0
        self._take_people(people)

    def _take_people(self, people: CapsuleSet) -> None:
        self._people, self._scene = people, None
        self._around.take(people)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Apply a joint jerk for one control step.

        Args:
            action: Jerk in jerk bounds, shape (n,); finite values outside [-1, 1] are clipped.

        Raises:
            InvalidActionError: Wrong shape or type, or not finite (a shield answers that instead of raising).
            gymnasium.error.ResetNeeded: There was no ``reset`` yet.
        """
        if not self._begun:
            raise gym.error.ResetNeeded("reset() has to come before step()")
        fraction = checked_action(action, self.robot.n)
        jerk = np.empty(self.robot.n)
        if not scale_action(fraction, self._jerk_bound, jerk):
            raise InvalidActionError(f"an action has to be finite, got {action!r}")
        around = self._around
        self._take_people(self.human.step(self.dt, around.robot_capsules if self.human.reacts else self._static))
        self._steps += 1
        self._time = self._steps * self.dt
        before = self.state
        self.state, distance, contact_speed, violation = around.move(before, jerk, self.dt)
        self._actual = self.state
        if self.dynamics == "servo":
            self._actual = np.array(self.world.servo_step(before, jerk, self.dt, self._servo_ratio))
            distance, contact_speed, swung = around.look(self._actual)
            violation = violation or swung

        moving = contact_speed > MOVING
        moment = Moment(self._actual[0], around.tip[0], around.tip_speed, fraction, distance, moving, self._progress)
        if self._evolves:
            moment = self._evolve(moment)
        value = self.task.value(self._goal, moment)
        self._held = self._held + 1 if self.task.reached(value, moment) else 0
        success = self._held >= self._hold_steps
        info = self._info(jerk, distance, contact_speed, success, violation)
        if self._evolves:
            info |= self.task.metrics(value, moment)
        reward = self._reward(moment, value, success, info)
        terminated = (
            (success and self._ends_success)
            or (moving and self._ends_moving)
            or (violation and self._ends_violation)
            or (distance <= 0.0 and self._ends_contact)
        )
        if self.render_mode == "human":
            self.render()
        return self._observed(moment), reward, terminated, False, info

    def _evolve(self, moment: Moment) -> Moment:
        """Let the goal go with the people, and count what the arm has done of it."""
        self._goal = self.task.follow(self._goal, self._people)
        self._progress = self.task.advance(self._goal, moment, self._actual[1], self.dt)
        return moment._replace(progress=self._progress)

    def _reward(self, moment: Moment, value: float, success: bool, info: dict[str, Any]) -> float:
        action = moment.action
        effort = float(action.dot(action)) / len(action)
        common = (effort, info["cost"], 1.0 if moment.moving_contact else 0.0)
        if self._goals:
            own = (float(self._goals.missed(*self._pair_of_goals(self._goals))),)
        elif self._evolves:
            own = self.task.rewarded_at(self._goal, moment, value, success)
        else:
            own = self.task.rewarded(value, success)
        total = 0.0
        for (key, weight), x in zip(self._terms, own + common):  # noqa: B905  # hot path, same length by construction
            info[key] = term = weight * x
            total += term
        return total

    def _info(
        self, jerk: Array, distance: float, contact_speed: float, success: bool, violation: bool
    ) -> dict[str, Any]:
        info = {
            "distance": distance,
            "contact": distance <= 0.0,
            "contact_speed": contact_speed,
            "cost": 1.0 if distance < self.d_min else 0.0,
            "jerk": jerk,
            "limit_violation": violation,
            "success": success,
            "is_success": success,
        }
        if self.robot.uncovered:
            info["uncovered"] = self.robot.uncovered
        if self.dynamics == "servo":
            info["tracking_error"] = self._actual[0] - self.state[0]
        return info

    def _pair_of_goals(self, goals: Goals) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """What the arm has achieved, and what is desired of it."""
        achieved = self._around.tip[0] if self.task.space == "tip" else self._actual[0]
        return goals.told(achieved), goals.told(self.task.desired(self._goal, self._progress))

    @property
    def compute_reward(self) -> Callable[[Any, Any, Any], Any]:
        """The reward of ``observation="goal"`` for other goals than those that were.

        Called with achieved goal, desired goal and ``info``, as Gymnasium-Robotics has it. Environments that observe
        something else have no such attribute, by which libraries tell them apart.
        """
        if self._goals is None:
            raise AttributeError("compute_reward is of observation='goal', which this environment was not made with")
        return self._goals.reward

    def _observed(self, moment: Moment) -> Any:
        # with servos the policy sees the commanded joints, as the shield does; the tip is the simulated one's
        state, around, out = self.state, self._around, np.empty(self.layout.size, np.float32)
        if self._actual is not state:
            moment = moment._replace(position=state[0])
        if self._goals:
            fill_observation(state, around.pointers[1], self._zero, self._scaling, out)
            achieved, desired = self._pair_of_goals(self._goals)
            return {"observation": out, "achieved_goal": achieved, "desired_goal": desired}
        own = self.task.observe(self._goal, moment)
        if self._parts:
            own = np.concatenate([bodies(np.array(self._people[:4]), self.robot.mount, self._parts), own])
        fill_observation(state, around.pointers[1], own, self._scaling, out)
        return out

    def render(self) -> Any:
        """A picture of shape (height, width, 3) for ``rgb_array``; draws the window for ``human``."""
        if self.render_mode is None:
            gym.logger.warn("render() does nothing without a render_mode; pass render_mode='rgb_array'")
            return None
        goal = goal_points(self.robot, self.goal.ravel(), not self.task.ends)
        marks = Marks(self._around.line, goal, self._around.touching)
        if self.render_mode == "human":
            return self.world.show(self._actual[0], self._people, marks, self.dt)
        return self.world.picture(self._actual[0], self._people, marks)

    def close(self) -> None:
        """Free renderer and window; the environment can still be stepped."""
        if self._world is not None:
            self._world.close()
