"""Reduction of general scalar equations: aliases, index reduction, block lower triangular form, tearing, symbolic solution."""
