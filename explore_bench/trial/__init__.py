"""One trial: what defines it, the simulation loop, and the row of every step."""
