"""Decisions by numbers: solvers, ranks, kernels for values; knows no model."""
