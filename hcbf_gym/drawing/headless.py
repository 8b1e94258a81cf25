"""Choice of MuJoCo's OpenGL backend on machines without a display."""

import ctypes
import os
import sys


def prefer_egl() -> None:
    """Let MuJoCo render through EGL where there is no display and EGL is installed.

    MuJoCo reads MUJOCO_GL once, when it is first imported, and fails to import if EGL is chosen
    but missing; a value that the user has set is left alone.
    """
    has_display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if not sys.platform.startswith("linux") or has_display or "MUJOCO_GL" in os.environ:
        return
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        return
    os.environ["MUJOCO_GL"] = "egl"
