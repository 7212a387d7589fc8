"""Questions about a reduced model beside its motion: linear systems and modes, equilibria and steady motions, needed forces."""
