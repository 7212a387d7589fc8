"""What leaves the package: C, a simulator, readable equations.

An exporter is a function of a model's functions and a folder, handed out as a method `export_...` of the model. It writes a README.txt that names
its files, and what it writes gives what the model's own functions give, at any arguments. `tests/conformance` finds and measures it.
"""
