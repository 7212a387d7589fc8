"""Any expression of a scene by time, states, inputs and parameters, and the functions that give it."""
