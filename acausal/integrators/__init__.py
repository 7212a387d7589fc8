"""Integrators: implicit collocation (Gauss, Radau IIA) driven from Python, and CasADi's own."""
