"""MuJoCo's renderer, or one line about what is missing."""

import os
import warnings
from typing import TYPE_CHECKING

from jssa_gym.exceptions import DisplayError
from jssa_gym.headless import choose_gl_backend, close_at_exit, without_opengl

if TYPE_CHECKING:
    import mujoco


def open_renderer(model: "mujoco.MjModel", height: int, width: int) -> "mujoco.Renderer":
    """A renderer, closed at the interpreter's end at the latest.

    Args:
        model: Whose scenes it draws.
        height, width: Of its pictures [pixels].

    Raises:
        DisplayError: There is no OpenGL; the message says what to install or set.
    """
    import mujoco

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of GLFW about what is raised next
            renderer = mujoco.Renderer(model, height, width)
    except Exception as error:  # every backend has errors of its own
        chosen = os.environ.get("MUJOCO_GL", "").strip() or "not set"
        why = " ".join((without_opengl() or str(error) or type(error).__name__).split())
        raise DisplayError(
            f"no OpenGL for pictures, with MUJOCO_GL {chosen} ({why}); install EGL (libegl1) and set MUJOCO_GL=egl, or "
            "OSMesa (libosmesa6) and MUJOCO_GL=osmesa, before mujoco is imported"
        ) from error
    close_at_exit(renderer)
    return renderer


def check_opengl() -> None:
    """Find out before long work whether pictures can be drawn.

    Raises:
        DisplayError: As of :func:`open_renderer`.
    """
    choose_gl_backend()
    import mujoco

    open_renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 16, 16).close()
