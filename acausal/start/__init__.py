"""How a motion begins: start values, assembly, branches, and what is said of them."""
