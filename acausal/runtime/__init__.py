"""The integrators in C: sources that are compiled on the user's machine, and their binding."""
