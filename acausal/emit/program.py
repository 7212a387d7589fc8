"""Statements of the runtime's interpreter (acausal/runtime/interpreter.h): numbers where `emit` writes C. They are made in acausal/runtime/program.py."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.numerics.instructions import BINARY, UNARY

END, LOAD, STORE, NUMBER, SINCOS = range(5)
CODES = {code: k for k, code in enumerate((*UNARY, *BINARY), 5)}
MUL_ADD, MUL_SUB, SUB_MUL, MUL_MUL, MOVE, SYSTEM = range(5 + len(CODES), 11 + len(CODES))
WIDTH = 5


@dataclass(frozen=True)
class Program:
    """A function as statements (n, 5) of int32: operation, result, operands; places in bytes of a frame, for values of some lanes.

    `preparation` fills what depends on parameters only, numbers included. `frame`: values in it.
    """

    preparation: np.ndarray
    run: np.ndarray
    inputs: int
    outputs: int
    frame: int
