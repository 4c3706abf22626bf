"""What the environment tells about itself: its observation table and its docstring."""

from jssa_gym.envs.observation import FAR, Feature, feature_table
from jssa_gym.envs.surroundings import OVER_POSITION, OVER_VELOCITY
from jssa_gym.envs.tasks import COMMON_TERMS, TASKS
from jssa_gym.robots import RobotModel, lr_mate_200id_7l


def arm_features(robot: RobotModel, parts: int) -> tuple[Feature, ...]:
    """What every task observes before its own features: the arm and the people."""
    limits, n = robot.limits, robot.n
    half = (limits.position[:, 1] - limits.position[:, 0]) / 2.0
    return (
        Feature("position", n, tuple(half.tolist()), -1.5, 1.5, "joint position from mid-range / half range"),
        Feature("velocity", n, tuple(limits.velocity.tolist()), -2.0, 2.0, "joint velocity / limit"),
        Feature("acceleration", n, tuple(limits.acceleration.tolist()), -2.0, 2.0, "joint acceleration / limit"),
        Feature("tip", 3, (1.0,), -FAR, FAR, "tool centre point from the robot's base [m]"),
        Feature("gap", 3, (1.0,), -FAR, FAR, "closest axis points: human's minus robot's [m]"),
        Feature("human_point", 3, (1.0,), -FAR, FAR, "closest human axis point from the robot's base [m]"),
        Feature("human_velocity", 3, (1.0,), -3.0, 3.0, "its velocity [m/s]"),
        Feature("human_distance", parts, (1.0,), -0.5, FAR, "surface distance of each body part to the arm [m]"),
    )


def describe() -> str:
    """The class docstring, from the tables that the code runs on."""
    robot = lr_mate_200id_7l()
    parts = 6
    indent = "\n    ".join
    common = arm_features(robot, parts)
    blocks = []
    for task in (cls() for cls in TASKS.values()):
        features = feature_table((*common, *task.features(robot))).splitlines()[len(common) :]
        terms = "\n".join(f"{t.weight:+7.2f} · {t.name:<10} {t.text}" for t in (*task.terms, *COMMON_TERMS))
        blocks.append(
            f"**{task.name}** (default human: ``{task.human}``). {task.text}\n\n::\n\n"
            + "\n".join("    " + line for line in (*features, *terms.splitlines()))
            + "\n"
        )
    text = f"""An arm driven by joint jerk beside moving people, 125 Hz.

The joint state follows the paper's Eq. (1) exactly, jerk held over each step of 0.008 s. With
``dynamics="servo"`` MuJoCo simulates the arm's inertias under 1 kHz position servos that track that command;
distances, contacts and success are then those of the simulated arm, and ``info["tracking_error"]`` (n,) [rad] is its
position minus the command's. Limits are reported, not enforced: that is a shield's work. With servos
``limit_violation`` is of the command (position to jerk) and of the simulated arm, whose position may swing over by
{1e3 * OVER_POSITION:g} mrad and whose velocity by {100.0 * OVER_VELOCITY:g} % of its limit.

**Action**: joint jerk as a share of the jerk bounds, ``Box(-1, 1, (n,), float32)``; float64 is taken as it is.

**Observation**, float32, values clipped to the bounds (index, name, bounds, meaning; for the six joints and one
kind of body)::

{chr(10).join("    " + line for line in feature_table(common).splitlines())}

then the task's goal. Without a human the human's entries are at their upper bounds, the velocity 0.

**Tasks**, with the goal's observation and the reward's terms:

{chr(10).join(blocks)}

**Termination**: what ``terminate_on`` names: ``success``, ``contact``, ``moving_contact`` (the robot's touching
point faster than 1e-3 m/s) or ``limit_violation``; the default is success and moving contact. A contact with the arm
at rest never ends an episode by default. **Truncation**: after 1,000 steps (8 s), by ``TimeLimit``.

**Start**: at rest at home, nobody closer than 0.1 m. ``reset(options={{...}})`` takes ``joint_position``, ``goal`` and
``human_start``.

**info**, the same keys and types after reset and step: ``distance`` [m] (smallest robot-human surface distance, inf
without a human), ``contact`` (bool), ``contact_speed`` [m/s] (of the robot's touching point, 0.0 without contact),
``cost`` (1.0 when the distance is below ``d_min``), ``jerk`` (n,) [rad/s³] applied, ``limit_violation`` (bool),
``success`` (bool; as ``is_success`` too, which Stable-Baselines3 counts), ``reward/<term>`` (0.0 after reset) and what
the task says.

Args:
    task: {", ".join(f'``"{name}"``' for name in TASKS)} or a :class:`~jssa_gym.envs.tasks.Task`.
    human: A name in :data:`jssa_gym.humans.HUMANS`, a motion, or several of them; None for the task's default.
    dynamics: ``"kinematic"`` or ``"servo"``.
    scene: ``"table"`` (the base stands at 0.87 m, the arm must stay above) or ``"floor"``.
    robot: A name in :data:`jssa_gym.robots.ROBOTS`, a model, or an MJCF file with its limits beside it.
    terminate_on: What ends an episode.
    d_min: Distance below which ``cost`` is 1 [m].
    render_mode: ``"rgb_array"``, ``"human"`` (a window; listed where there is a display) or None.
    width, height: Size of pictures [pixels].

Raises:
    ParameterError: An argument is unknown or out of range.
    RobotModelError: The robot's file cannot be modelled.
    DisplayError: ``render_mode="human"`` without a display.
"""
    return indent(text.splitlines())
