"""Pictures: the colours, scenes seen from above, and MuJoCo scenes offscreen or in a window."""
