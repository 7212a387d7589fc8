"""Forces: springs and dampers between points, forces and torques from outside."""
