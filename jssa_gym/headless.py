"""Choice of MuJoCo's OpenGL backend, which is fixed the moment ``mujoco`` is first imported."""

import ctypes.util
import os
import sys


def has_display() -> bool:
    """Whether a window can be opened here."""
    if not sys.platform.startswith("linux"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def choose_gl_backend() -> None:
    """Ask for EGL on a Linux machine without a display, unless the user has chosen or EGL is missing.

    Call it before ``import mujoco``. Without any backend everything but drawing still works.
    """
    if "MUJOCO_GL" in os.environ or "mujoco" in sys.modules or has_display():
        return
    if ctypes.util.find_library("EGL"):
        os.environ["MUJOCO_GL"] = "egl"
