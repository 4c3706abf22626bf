"""MuJoCo's OpenGL backend: its choice, which is fixed the moment ``mujoco`` is first imported, and its end."""

import atexit
import ctypes.util
import os
import sys
import weakref
from typing import Any

_missing = ""

_open: weakref.WeakSet[Any] = weakref.WeakSet()


def has_display() -> bool:
    """Whether a window can be opened here."""
    if not sys.platform.startswith("linux"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def choose_gl_backend() -> None:
    """Import ``mujoco`` with EGL on a Linux machine without a display, unless the user has chosen or EGL is missing.

    Call it before ``import mujoco``. Without any backend everything but drawing still works: MuJoCo, which refuses to
    be imported where ``MUJOCO_GL`` names one that is not there, is then imported without.
    """
    global _missing
    if "mujoco" in sys.modules:
        return
    chosen = os.environ.get("MUJOCO_GL", "")
    if not (chosen.strip() or has_display()) and ctypes.util.find_library("EGL"):
        os.environ["MUJOCO_GL"] = chosen = "egl"
    try:
        import mujoco
    except Exception as error:  # every backend has errors of its own
        if not chosen.strip():
            raise
        _missing = str(error) or type(error).__name__
        os.environ["MUJOCO_GL"] = "disable"
        try:
            import mujoco  # noqa: F401
        finally:
            os.environ["MUJOCO_GL"] = chosen


def without_opengl() -> str:
    """Why MuJoCo was imported without OpenGL; empty if it was not."""
    return _missing


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
