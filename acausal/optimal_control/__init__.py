"""Optimal control: from parts to optimum, proven by replay."""
