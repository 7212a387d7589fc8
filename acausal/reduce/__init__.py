"""The reduced system: least states, elimination, invariants."""
