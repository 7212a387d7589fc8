"""Constraints that neither the structure shows nor numbers: sums of equations, with weights of parameters, in which the highest derivatives cancel.

Two capacitors on both sides of an ideal transformer of adjustable ratio: with its equations u1 = n u2 and i2 = -n i1 their voltages follow from
one another, as they do where n is a number, which `dependent` finds. Here the matrix of the highest derivatives is looked at, after Pantelides'
algorithm: each vector u with u' J = 0 replaces one equation by the sum of u_k times equation k, as often differentiated as the structure says
but for what all of them are (G. Tan, N. S. Nedialkov, J. D. Pryce, Conversion methods for improving structural analysis of differential-algebraic
equation systems, BIT 57, 2017: the linear combination method).
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from acausal.scalar.linear import Sample, dependent_rows


def hidden_sums(matrix: ca.SX, counts: Sequence[int], sample: Sample, constants: set[int]) -> list[tuple[int, dict[int, ca.SX]]]:
    """Sums of equations without highest derivatives: the equation that each replaces, and the weights by equation.

    `matrix` (n, m): slopes of equations, `counts` (n,) times differentiated, by highest derivatives. Only equations whose slopes are `constants`
    (hashes of symbols) are taken, and no equation in two sums where one of them replaces it.
    """
    fixed = [i for i in range(matrix.shape[0]) if {s.element_hash() for s in ca.symvar(ca.densify(matrix[i, :]))} <= constants]
    found: list[tuple[int, dict[int, ca.SX]]] = []
    replaced: set[int] = set()
    for weights in dependent_rows(ca.sparsify(matrix[fixed, :]), sample, constants):
        own = {fixed[k]: weight for k, weight in weights.items()}
        if replaced & set(own):
            continue
        least = min(counts[i] for i in own)
        able = [i for i in own if counts[i] == least]
        sizes = np.abs(np.array(sample([own[i] for i in able]))).reshape(len(able), -1)[:, 0]
        chosen = able[int(np.argmax(sizes))]
        replaced.add(chosen)
        found.append((chosen, own))
    return found
