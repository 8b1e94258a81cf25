"""Choice of MuJoCo's OpenGL backend on machines without a display."""

import ctypes
import os
import sys


def prefer_egl() -> None:
    """Let MuJoCo render through EGL on Linux without a display, if EGL is installed.

    MuJoCo reads MUJOCO_GL when it is first imported, so this is called before. EGL is looked for
    because MuJoCo's import fails if it is chosen but missing. A value set by the user remains.
    """
    has_display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if not sys.platform.startswith("linux") or has_display or "MUJOCO_GL" in os.environ:
        return
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        return
    os.environ["MUJOCO_GL"] = "egl"
