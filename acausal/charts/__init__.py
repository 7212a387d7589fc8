"""Charts: independent coordinates of the positions and velocities that a scene's invariants allow."""
