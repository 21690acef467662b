"""A trial in a landmark world: the robot in it, and the row of its steps."""
