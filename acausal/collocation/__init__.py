"""Collocation as values: tableaus, the problem, the solution."""
