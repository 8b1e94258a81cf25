"""How a walker follows the velocities that it is commanded, measured."""
