"""Where the robot could go next, on the grid that it believes in: frontiers, candidates and shortest paths."""
