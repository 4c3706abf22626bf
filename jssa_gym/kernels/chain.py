r"""Kinematics of a serial chain of hinge joints.

Frame :math:`i` sits on joint :math:`i`'s axis and turns with link :math:`i`. With :math:`r` the offset to the
next origin, the recursion of velocities, accelerations and jerks follows from :math:`\dot r = \omega\times r`
and :math:`\dot z = \omega\times z`; nothing is left out of the angular terms.
"""

import numpy as np

from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.vector import add, along, copy, cross, dot, fill, put, scale, subtract


@jit
def velocity_of(frame, r):
    """Velocity of the point at world offset r from a frame's origin, moving with the link [m/s]."""
    return add(frame["velocity"], cross(frame["omega"], r))


@jit
def acceleration_of(frame, r):
    """Acceleration of the point at world offset r from a frame's origin [m/s²]."""
    omega = frame["omega"]
    turning = add(cross(frame["alpha"], r), cross(omega, cross(omega, r)))
    return add(frame["acceleration"], turning)


@jit
def drift_of(frame, r):
    r"""Jerk at zero joint jerk, :math:`\ddot J\dot\theta + 2\dot J\ddot\theta` of Eq. (10) [m/s³]."""
    omega, alpha = frame["omega"], frame["alpha"]
    r_dot = cross(omega, r)
    r_ddot = add(cross(alpha, r), cross(omega, r_dot))
    turning = add(cross(frame["psi"], r), scale(cross(alpha, r_dot), 2.0))
    turning = add(turning, cross(omega, r_ddot))
    return add(frame["drift"], turning)


@jit
def pose(links, position, frames):
    """Where all link frames are: rotation, origin and axis.

    Args:
        links: Chain geometry, shape (n,) of ``LINK``.
        position: Shape (n,) [rad].
        frames: Result, shape (n,) of ``FRAME``, world coordinates; what moves is left alone.
    """
    for i in range(links.shape[0]):
        link, frame = links[i], frames[i]
        fixed, rotation = link["rotation"], frame["rotation"]
        x, y, z = link["axis"][0], link["axis"][1], link["axis"][2]
        c, s = np.cos(position[i]), np.sin(position[i])
        k = 1.0 - c
        # Rodrigues' rotation about the joint's axis, columns of the matrix
        turn = (
            (c + x * x * k, x * y * k + z * s, x * z * k - y * s),
            (x * y * k - z * s, c + y * y * k, y * z * k + x * s),
            (x * z * k + y * s, y * z * k - x * s, c + z * z * k),
        )
        local_axis = link["axis"]
        # axis in the previous link's frame, then in the world
        seated = (dot(fixed[0], local_axis), dot(fixed[1], local_axis), dot(fixed[2], local_axis))
        if i == 0:
            for row in range(3):
                for column in range(3):
                    rotation[row, column] = dot(fixed[row], turn[column])
            put(frame["origin"], link["offset"])
            put(frame["axis"], seated)
            continue
        before = frames[i - 1]
        base = before["rotation"]
        for row in range(3):
            along_row = (
                base[row, 0] * fixed[0, 0] + base[row, 1] * fixed[1, 0] + base[row, 2] * fixed[2, 0],
                base[row, 0] * fixed[0, 1] + base[row, 1] * fixed[1, 1] + base[row, 2] * fixed[2, 1],
                base[row, 0] * fixed[0, 2] + base[row, 1] * fixed[1, 2] + base[row, 2] * fixed[2, 2],
            )
            for column in range(3):
                rotation[row, column] = dot(along_row, turn[column])
        put(frame["axis"], (dot(base[0], seated), dot(base[1], seated), dot(base[2], seated)))
        put(frame["origin"], add(before["origin"], _offset(link, before)))


@jit
def _offset(link, before):
    """The way from the origin of the frame before to the link's own, in world coordinates."""
    base, offset = before["rotation"], link["offset"]
    return (dot(base[0], offset), dot(base[1], offset), dot(base[2], offset))


@jit
def forward(links, state, frames):
    r"""Motion of all link frames: pose, velocity, acceleration and drift (Eq. 10).

    Args:
        links: Chain geometry, shape (n,) of ``LINK``.
        state: Rows position, velocity, acceleration, shape (3, n) [rad, rad/s, rad/s²].
        frames: Result, shape (n,) of ``FRAME``, world coordinates.
    """
    pose(links, state[0], frames)
    set_moving(links, state, frames)


@jit
def set_moving(links, state, frames):
    """The second half of :func:`forward`, after :func:`pose`: velocity, acceleration and drift."""
    still = (0.0, 0.0, 0.0)
    for i in range(links.shape[0]):
        frame, q_dot, q_ddot = frames[i], state[1, i], state[2, i]
        a = frame["axis"]
        axis = (a[0], a[1], a[2])
        if i == 0:
            put(frame["omega"], scale(axis, q_dot))
            put(frame["alpha"], scale(axis, q_ddot))
            put(frame["psi"], still)
            put(frame["velocity"], still)
            put(frame["acceleration"], still)
            put(frame["drift"], still)
            continue
        before = frames[i - 1]
        r = _offset(links[i], before)
        put(frame["velocity"], velocity_of(before, r))
        put(frame["acceleration"], acceleration_of(before, r))
        put(frame["drift"], drift_of(before, r))

        omega, alpha = before["omega"], before["alpha"]
        axis_dot = cross(omega, axis)
        axis_ddot = add(cross(alpha, axis), cross(omega, axis_dot))
        put(frame["omega"], add(omega, scale(axis, q_dot)))
        put(frame["alpha"], add(add(alpha, scale(axis, q_ddot)), scale(axis_dot, q_dot)))
        psi = add(before["psi"], scale(axis_dot, 2.0 * q_ddot))
        put(frame["psi"], add(psi, scale(axis_ddot, q_dot)))


@jit
def _turned(frame, point):
    """A point of a link, or its offset from the frame's origin, in world coordinates."""
    rotation = frame["rotation"]
    return (dot(rotation[0], point), dot(rotation[1], point), dot(rotation[2], point))


@jit
def place_axes(frames, capsules, segments):
    """Where the axes of all robot capsules are; arguments as of :func:`place`, after :func:`pose` already."""
    for i in range(capsules.shape[0]):
        capsule, segment = capsules[i], segments[i]
        frame = frames[capsule["link"]]
        put(segment["start"], add(frame["origin"], _turned(frame, capsule["start"])))
        r = _turned(frame, capsule["end"])
        put(segment["end"], add(frame["origin"], r))
        segment["radius"] = capsule["radius"]
        segment["link"] = capsule["link"]
        if capsule["link"] == 0:
            start, end = cross(frame["axis"], subtract(segment["start"], frame["origin"])), cross(frame["axis"], r)
            put(segment["swing"], scale(frame["axis"], np.sqrt(max(dot(start, start), dot(end, end)))))


@jit
def place(frames, capsules, segments):
    """Motion of the axes of all robot capsules in world coordinates.

    Args:
        frames: Shape (n,) of ``FRAME``, from :func:`forward`.
        capsules: Shape (m,) of ``CAPSULE``.
        segments: Result, shape (m,) of ``SEGMENT``.
    """
    place_axes(frames, capsules, segments)
    move_axes(frames, capsules, segments)


@jit
def place_present(robot, position, work):
    """Where the arm is at present, at ``position`` (n,), into ``work.frames_present`` and ``segments_present``.

    Several parts of a tick look there: the first of them computes it. A tick begins with :func:`forget_present`.

    Args:
        robot: Its ``links`` and ``capsules``.
        position: Shape (n,) [rad]; for another one than before it is computed anew.
        work: As of :class:`~jssa_gym.tick.layout.Work`.
    """
    known = True
    for j in range(position.shape[0]):
        known = known and position[j] == work.present[j]
    if not known:
        copy(position, work.present)
        pose(robot.links, position, work.frames_present)
        place_axes(work.frames_present, robot.capsules, work.segments_present)


@jit
def forget_present(work):
    """Nothing is known of where the arm is at present."""
    fill(work.present, np.nan)


@jit
def move_axes(frames, capsules, segments):
    """The second half of :func:`place`, after :func:`place_axes`: velocities and accelerations."""
    for i in range(capsules.shape[0]):
        capsule, segment = capsules[i], segments[i]
        frame = frames[capsule["link"]]
        r = _turned(frame, capsule["start"])
        put(segment["start_velocity"], velocity_of(frame, r))
        put(segment["start_acceleration"], acceleration_of(frame, r))
        r = _turned(frame, capsule["end"])
        put(segment["end_velocity"], velocity_of(frame, r))
        put(segment["end_acceleration"], acceleration_of(frame, r))


@jit
def jacobian(frames, link, point, out):
    r"""Jacobian :math:`J` of a world point on a link, :math:`J_j = z_j \times (p - p_j)`, shape (3, n) [m]."""
    for j in range(frames.shape[0]):
        if j > link:
            column = (0.0, 0.0, 0.0)
        else:
            column = cross(frames[j]["axis"], subtract(point, frames[j]["origin"]))
        out[0, j], out[1, j], out[2, j] = column


@jit
def jacobian_rate(frames, link, point, out):
    r""":math:`\dot J` of a material point, :math:`\dot z_j\times(p-p_j) + z_j\times(v-v_j)`, shape (3, n) [m/s]."""
    v = velocity_of(frames[link], subtract(point, frames[link]["origin"]))
    for j in range(frames.shape[0]):
        column = (0.0, 0.0, 0.0)
        if j <= link:
            frame = frames[j]
            # the joint's own rate does not turn its axis, so omega of either side serves
            turned = cross(cross(frame["omega"], frame["axis"]), subtract(point, frame["origin"]))
            column = add(turned, cross(frame["axis"], subtract(v, frame["velocity"])))
        out[0, j], out[1, j], out[2, j] = column


@jit
def point_on(segment, s):
    """Position, velocity, acceleration of the material point at fraction s of a capsule's axis."""
    return (
        along(segment["start"], segment["end"], s),
        along(segment["start_velocity"], segment["end_velocity"], s),
        along(segment["start_acceleration"], segment["end_acceleration"], s),
    )


@jit
def tool_motion(frames, link, local, out):
    """Position and velocity of a point of a link, into ``out`` (2, 3) [m, m/s]; returns its speed [m/s]."""
    frame = frames[link]
    rotation = frame["rotation"]
    r = (dot(rotation[0], local), dot(rotation[1], local), dot(rotation[2], local))
    put(out[0], add(frame["origin"], r))
    v = velocity_of(frame, r)
    put(out[1], v)
    return np.sqrt(dot(v, v))
