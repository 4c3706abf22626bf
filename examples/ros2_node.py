"""A guard as a ROS 2 node: a sketch, which needs rclpy and a robot's own drivers to run.

Subscribes to ``/command`` (trajectory_msgs/JointTrajectory: the first point is where the joints are to be),
``/joint_states`` (sensor_msgs/JointState) and ``/people`` (std_msgs/Float64MultiArray: eleven numbers a capsule, start,
end, velocity, radius and age), and publishes ``/safe_command`` (std_msgs/Float64MultiArray: positions) every 8 ms.

What a real node has to add: a real-time executor or a process of its own, so that ticks come on time (the guard says
when they do not); people's stamps in the clock that the ticks have; and a hardware interface that holds its last
position when no command comes. The guard then stops the arm by itself for whatever is late, missing or wrong.
"""

import sys
import time

import numpy as np

import jssa_gym

DT, JOINTS = 0.008, ("J1", "J2", "J3", "J4", "J5", "J6")
PARTS = ("body", "right_arm", "left_arm")


class Loop:
    """What the node does, without ROS: the newest of everything, and a tick."""

    def __init__(self) -> None:
        self.guard = jssa_gym.Guard("lr_mate_200id_7l", dt=DT, failsafe={"position_error": 0.02})
        self.command: jssa_gym.JointPosition | None = None
        self.commanded = self.seen = 0.0
        self.people: jssa_gym.MeasuredPeople | None = None
        self.joints: np.ndarray | None = None
        self.begun = False

    def on_command(self, positions: list[float], now: float) -> None:
        self.command, self.commanded = jssa_gym.JointPosition(np.array(positions)), now

    def on_joints(self, names: list[str], positions: list[float]) -> None:
        order = [list(names).index(name) for name in JOINTS]
        self.joints = np.array(positions)[order]

    def on_people(self, numbers: list[float], now: float) -> None:
        rows = np.array(numbers).reshape(len(PARTS), 11)
        velocity = rows[:, 6:9].copy()
        capsules = jssa_gym.CapsuleSet(
            rows[:, :3].copy(), rows[:, 3:6].copy(), velocity, velocity, rows[:, 9].copy(), PARTS, np.zeros(3, np.int64)
        )
        self.people, self.seen = jssa_gym.MeasuredPeople(capsules, rows[:, 10].copy()), now

    def tick(self, now: float) -> jssa_gym.GuardAnswer | None:
        """The next safe position; None until it is known where the arm is."""
        if not self.begun:
            if self.joints is None:
                return None
            self.guard.start(self.joints)
            self.begun = True
        command = self.command if now - self.commanded < 5 * DT else None  # a sender that died commands nothing
        people = self.people
        if people is not None:  # what was measured when it came has grown older since
            people = jssa_gym.MeasuredPeople(people.capsules, people.age + (now - self.seen))
        return self.guard.tick(command, people, now, self.joints)


def main() -> int:
    try:
        import rclpy
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Float64MultiArray
        from trajectory_msgs.msg import JointTrajectory
    except ImportError as error:
        print(f"this sketch needs ROS 2 and its Python packages: {error}")
        return 0
    rclpy.init()
    node, loop = rclpy.create_node("guard"), Loop()
    publisher = node.create_publisher(Float64MultiArray, "/safe_command", 1)
    node.create_subscription(
        JointTrajectory, "/command", lambda m: loop.on_command(m.points[0].positions, time.monotonic()), 1
    )
    node.create_subscription(JointState, "/joint_states", lambda m: loop.on_joints(m.name, m.position), 1)
    node.create_subscription(Float64MultiArray, "/people", lambda m: loop.on_people(m.data, time.monotonic()), 1)

    def every_tick() -> None:
        answer = loop.tick(time.monotonic())
        if answer is not None:
            publisher.publish(Float64MultiArray(data=answer.position.tolist()))
            if answer.reason:
                node.get_logger().info(f"{answer.status.name}: {answer.reason}", throttle_duration_sec=1.0)

    node.create_timer(DT, every_tick)
    rclpy.spin(node)
    return 0


if __name__ == "__main__":
    if code := main():
        sys.exit(code)
