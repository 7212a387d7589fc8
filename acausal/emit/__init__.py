"""C from CasADi functions, and the compilers that take it."""
