"""Integrability of velocity constraints: Frobenius' test, hidden integrals, and their closed forms."""
