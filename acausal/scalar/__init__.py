"""Scalar equations: aliases, index reduction, block lower triangular form, tearing, and their coupling with mechanics."""
