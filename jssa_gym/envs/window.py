"""A window that shows a MuJoCo scene, in the thread that opens it, by GLFW, which MuJoCo comes with."""

import math
import re
import time
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from jssa_gym.envs.drawing import add_to
from jssa_gym.envs.figures import Rounded
from jssa_gym.exceptions import DisplayError
from jssa_gym.headless import has_display

if TYPE_CHECKING:
    import mujoco

NO_DISPLAY = (
    "no display for a window ({why}): take render_mode='rgb_array' for pictures, or give it a display, such as "
    "`xvfb-run -a python ...` for one that nobody sees, or `ssh -X` for one elsewhere"
)
"""What is told where no window can be opened."""

_LATE = 0.1
"""By how much the window may be late and still catch up [s]."""

_LONGEST = 0.04
"""How often one of the moments that come too late is drawn [s]."""

_SAID = re.compile(r"b[\'\"](.*)[\'\"]")
"""What GLFW says, in its warning."""


def check_display() -> None:
    """Find out whether a window could be opened.

    Raises:
        DisplayError: There is no display.
    """
    if not has_display():
        raise DisplayError(NO_DISPLAY.format(why="neither DISPLAY nor WAYLAND_DISPLAY is set"))


class Window:
    """Shows moments, no faster than they happen; the mouse turns the camera (left), moves it (right) and zooms.

    Once somebody closes the window, nothing is shown any more.

    Args:
        model: Whose scenes are shown.
        camera: From where; the mouse changes it.
        width, height: [pixels].

    Raises:
        DisplayError: No window can be opened.
    """

    def __init__(self, model: "mujoco.MjModel", camera: "mujoco.MjvCamera", width: int, height: int) -> None:
        check_display()
        import glfw
        import mujoco

        self._glfw, self._mujoco, self._model, self._camera = glfw, mujoco, model, camera
        with warnings.catch_warnings(record=True) as told:  # GLFW says why as a warning
            warnings.simplefilter("always")
            self._window: Any = glfw.create_window(width, height, "jssa_gym", None, None) if glfw.init() else None
        if not self._window:
            raise DisplayError(NO_DISPLAY.format(why=_reason(str(told[-1].message)) if told else "GLFW opens none"))
        self._focus()
        glfw.swap_interval(0)
        try:
            self._scene = mujoco.MjvScene(model, maxgeom=2000)
            self._context: Any = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        except Exception as error:  # every driver has errors of its own
            self.close()
            raise DisplayError(NO_DISPLAY.format(why=" ".join(str(error).split()))) from error
        self._held = (0.0, 0.0)
        self._due, self._drawn = time.perf_counter(), -math.inf
        glfw.set_cursor_pos_callback(self._window, self._drag)
        glfw.set_scroll_callback(self._window, lambda _, x, y: self._move(mujoco.mjtMouse.mjMOUSE_ZOOM, 0.0, -0.05 * y))

    @property
    def is_open(self) -> bool:
        """Whether there is something to look at."""
        return self._window is not None

    def show(self, data: "mujoco.MjData", option: "mujoco.MjvOption", drawn: Sequence[Rounded], period: float) -> None:
        """Draw a moment when it is time for it; where drawing takes too long, only every few.

        Args:
            data: The model's state.
            option: What of it is drawn.
            drawn: What is drawn besides.
            period: Time between moments [s].
        """
        if self._window is None:
            return
        glfw, mujoco, model = self._glfw, self._mujoco, self._model
        glfw.poll_events()
        if glfw.window_should_close(self._window):
            self.close()
            return
        now = time.perf_counter()
        time.sleep(max(self._due - now, 0.0))
        late, self._due = now > self._due, max(self._due, now - _LATE) + period
        if late and now - self._drawn < _LONGEST:
            return
        self._focus()
        every = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(model, data, option, None, self._camera, every, self._scene)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        add_to(self._scene, drawn)
        viewport = mujoco.MjrRect(0, 0, *glfw.get_framebuffer_size(self._window))
        mujoco.mjr_render(viewport, self._scene, self._context)
        glfw.swap_buffers(self._window)
        self._drawn = time.perf_counter()

    def close(self) -> None:
        """Close it."""
        if self._window is not None:
            self._focus()
            if getattr(self, "_context", None) is not None:
                self._context.free()
                self._context = None
            self._glfw.destroy_window(self._window)
            self._window = None

    def _focus(self) -> None:
        self._glfw.make_context_current(self._window)

    def _drag(self, _: Any, x: float, y: float) -> None:
        glfw, mouse = self._glfw, self._mujoco.mjtMouse
        (before_x, before_y), self._held = self._held, (x, y)
        height = max(glfw.get_window_size(self._window)[1], 1)
        for button, action in (
            (glfw.MOUSE_BUTTON_LEFT, mouse.mjMOUSE_ROTATE_H),
            (glfw.MOUSE_BUTTON_RIGHT, mouse.mjMOUSE_MOVE_V),
        ):
            if glfw.get_mouse_button(self._window, button) == glfw.PRESS:
                self._move(action, (x - before_x) / height, (y - before_y) / height)

    def _move(self, action: Any, x: float, y: float) -> None:
        self._mujoco.mjv_moveCamera(self._model, action, x, y, self._scene, self._camera)


def _reason(warning: str) -> str:
    found = _SAID.search(warning)
    return " ".join((found.group(1) if found else warning).split())
