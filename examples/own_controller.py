"""A guard in a controller's loop: joint positions in at 125 Hz, a camera's people at 30 Hz, safe positions out.

The controller, the camera and the drives are pretended here, and so is the time: put your own in their place.
"""

import numpy as np

import jssa_gym

DT = 0.008
PARTS = ("body", "right_arm")  # names say how fast a part can be: see docs/guarantees.md, A1


def planned(t):  # your trajectory, in joint space [rad]
    return np.array([0.8 * np.sin(0.8 * t), 0.2, -0.2, 0.0, -1.4, 0.0])


def camera(t):  # your perception: capsules with velocities, in the frame that the arm stands in
    x = 2.2 - 0.9 * np.clip(t - 1.0, 0.0, 2.0) + 0.9 * np.clip(t - 5.0, 0.0, 2.0)
    speed = -0.9 if 1.0 <= t < 3.0 else 0.9 if 5.0 <= t < 7.0 else 0.0
    start = np.array([[x, 0.0, 0.3], [x, 0.2, 1.4]])
    end = np.array([[x, 0.0, 1.5], [x - 0.45, 0.2, 1.2]])
    velocity = np.full((2, 3), (speed, 0.0, 0.0))
    return jssa_gym.CapsuleSet(start, end, velocity, velocity, np.array([0.2, 0.06]), PARTS, np.zeros(2, np.int64))


def main() -> None:
    guard = jssa_gym.Guard(
        "lr_mate_200id_7l",
        dt=DT,
        profile="work",
        failsafe={"position_error": 0.02, "actuation_lag": 0.02, "state_tolerance": (2e-3, np.inf, np.inf)},
    )
    drives = planned(0.0)
    guard.start(drives)
    rng, pace_time, nearest = np.random.default_rng(0), 0.0, 1.0
    changed = dict.fromkeys(jssa_gym.Status, 0)
    for k in range(round(10.0 / DT)):
        stamp = k * DT  # time.monotonic(), in a real loop
        shot = np.floor(stamp * 30.0) / 30.0  # the camera's last picture ...
        people = jssa_gym.MeasuredPeople(camera(shot), age=stamp - shot)  # ... and how old it is by now
        measured = drives + 1e-4 * rng.normal(size=6)
        command = jssa_gym.JointPosition(planned(pace_time))
        answer = guard.tick(command, people, stamp, measured)
        drives = answer.position  # what is sent; the next measurement is of it
        pace_time += answer.override * DT  # go on along the trajectory as fast as there is room
        changed[answer.status] += 1
        nearest = min(nearest, answer.margin)
    counts = ", ".join(f"{count} {status.name}" for status, count in changed.items() if count)
    print(f"10 s at 125 Hz: {counts}; {pace_time:.1f} s of the trajectory done, margin down to {nearest:.3f} m")


if __name__ == "__main__":
    main()
