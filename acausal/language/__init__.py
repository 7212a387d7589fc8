"""What a user writes: components, connectors, variables, equations; and the flattened scene."""
