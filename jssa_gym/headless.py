"""MuJoCo's OpenGL backend: its choice, which is fixed the moment ``mujoco`` is first imported, and its end."""

import atexit
import ctypes.util
import os
import sys
import weakref
from typing import Any

_open: weakref.WeakSet[Any] = weakref.WeakSet()


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


def close_at_exit(renderer: Any) -> None:
    """Close a ``mujoco.Renderer`` that is still open when the interpreter ends; by itself it would be too late.

    Call it when the renderer is made: EGL has then registered its own end, and what registers later ends earlier.
    """
    _open.add(renderer)
    atexit.unregister(_close_all)
    atexit.register(_close_all)


def _close_all() -> None:
    for renderer in list(_open):
        renderer.close()
