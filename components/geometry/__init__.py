"""Curves and surfaces as values: what guides and contacts are made of."""
