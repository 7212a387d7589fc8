"""Inertia of a body that deforms in given shapes: floating frame of reference with modal amplitudes.

A mass m_k at r_k of the undeformed body stands at p_k = r_k + Phi_k q in a reference frame that moves with the body. Kinetic energy and
inertial forces need sums over the masses of products of r_k and Phi_k only, which are numbers (shape integrals): the cost of the
equations does not depend on how many masses there are. Exact for any motion of the reference frame; elastic forces are those of linear
elasticity, so that deformations must be small and no centrifugal stiffening appears.

Shabana, Dynamics of Multibody Systems (5th ed. 2020), chapter 5; Wallrapp, Mechanics of Structures and Machines 22 (1994), for the sums.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.parts.inertia import Inertia
from acausal.parts.motion import Motion
from acausal.parts.pose import Matrix, symbolic

_ROUNDING = 1e-14


@dataclass(frozen=True)
class ShapeIntegrals:
    """Averages over the mass of a body with n shapes, of places r (3,) divided by a length and of shapes Phi (3, n).

    `first` (3,): r; `first_shapes` (3, n): Phi; `second` (3, 3): r_a r_b; `mixed` (3, 3, n): r_a Phi_bi; `second_shapes` (3, 3, n, n):
    Phi_ai Phi_bj. Axes are those of the reference frame, its origin is where r is zero.
    """

    first: np.ndarray
    first_shapes: np.ndarray
    second: np.ndarray
    mixed: np.ndarray
    second_shapes: np.ndarray

    @classmethod
    def of_masses(cls, masses: np.ndarray, places: np.ndarray, shapes: np.ndarray) -> ShapeIntegrals:
        """Of masses (m,) at places (m, 3) with shapes (m, 3, n); rounding errors beside larger entries become zeros."""
        shares = masses / np.sum(masses)
        sums = (
            np.einsum("k,ka->a", shares, places),
            np.einsum("k,kai->ai", shares, shapes),
            np.einsum("k,ka,kb->ab", shares, places, places),
            np.einsum("k,ka,kbi->abi", shares, places, shapes),
            np.einsum("k,kai,kbj->abij", shares, shapes, shapes),
        )
        return cls(*(without_rounding(s) for s in sums))

    @property
    def count(self) -> int:
        """Number of shapes."""
        return self.first_shapes.shape[1]

    @property
    def modal_mass(self) -> np.ndarray:
        """Phi' Phi (n, n)."""
        return np.einsum("aaij->ij", self.second_shapes)

    @property
    def turning(self) -> np.ndarray:
        """r x Phi_j (3, n)."""
        return _axial(self.mixed)

    @property
    def turning_shapes(self) -> np.ndarray:
        """Phi_i x Phi_j (3, n, n)."""
        return _axial(self.second_shapes)

    def mass_matrix(self) -> np.ndarray:
        """Undeformed, for unit mass and length, (6 + n, 6 + n): turning and motion of the reference frame, amplitudes."""
        x, y, z = self.first
        moment = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        second = np.trace(self.second) * np.eye(3) - self.second
        frame = np.block([[second, moment], [moment.T, np.eye(3)]])
        coupling = np.vstack([self.turning, self.first_shapes])
        return np.block([[frame, coupling], [coupling.T, self.modal_mass]])


@dataclass(frozen=True)
class ElasticBody:
    """A body with n shapes, and a tip. `mass` [kg], and the `length` [m] that `integrals` are divided by.

    `turning_inertia` (3, 3) [kg m^2]: further, of what turns with the reference frame. `stiffness` (n, n) and `damping` (n, n) against
    amplitudes and their rates. The tip is at `tip` (3,) [m] plus `tip_shapes` (3, n) q, turned by the small angles `tip_turns` (3, n) q.
    """

    integrals: ShapeIntegrals
    mass: float | ca.SX
    length: float | ca.SX
    turning_inertia: Matrix
    stiffness: Matrix
    damping: Matrix
    tip: Matrix
    tip_shapes: Matrix
    tip_turns: Matrix


@dataclass(frozen=True)
class ModalInertia:
    """Inertia of an elastic body with amplitudes q (n, 1) and their rates v (n, 1), in the frame of link `seat`.

    [[K_rr, K_rv], [K_rv', K_vv]] acts on ([w'; a], v'): K_rr is the inertia of the deformed body as if it were frozen. `near`: the seat is
    before the motion of v, not behind it.
    """

    body: ElasticBody
    q: ca.SX
    v: ca.SX
    seat: int
    near: bool

    def frozen(self) -> Inertia:
        """K_rr."""
        body, sums = self.body, self.body.integrals
        m, L = ca.SX(body.mass), ca.SX(body.length)
        mixed = _times(sums.mixed, self.q)
        second = L * L * _number(sums.second) + L * (mixed + mixed.T)
        for j in range(sums.count):
            second += self.q[j] * _times(sums.second_shapes[..., j], self.q)
        second = ca.tril2symm(ca.tril(second))
        turning = m * (ca.trace(second) * ca.SX.eye(3) - second) + symbolic(body.turning_inertia)
        return Inertia(body.mass, m * (L * _number(sums.first) + _number(sums.first_shapes) @ self.q), turning)

    def frame_coupling(self) -> ca.SX:
        """K_rv (6, n)."""
        body, sums = self.body, self.body.integrals
        turning = ca.SX(body.length) * _number(sums.turning) + self._turned(self.q)
        return ca.SX(body.mass) * ca.vertcat(turning, _number(sums.first_shapes))

    def modal_mass(self) -> ca.SX:
        """K_vv (n, n)."""
        return ca.SX(self.body.mass) * _number(self.body.integrals.modal_mass)

    def coupling(self, motion: Motion) -> tuple[ca.SX, ca.SX]:
        """(C (6, n), E (n, n)) so that U = I S + C and D = S' I S + E for an inertia I behind the motion, K_rr included if it is there."""
        C, E = self.frame_coupling(), self.modal_mass()
        if not self.near:
            mixed = motion.subspace.T @ C
            return C, E + mixed + mixed.T
        R, p = symbolic(motion.pose.rotation), symbolic(motion.pose.position)
        return ca.vertcat(R.T @ (C[:3, :] - ca.skew(p) @ C[3:, :]), R.T @ C[3:, :]), E

    def bias(self, w: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Torque, force, and forces on the amplitudes (n, 1) for v' = 0 and an unaccelerated frame with angular velocity w, K_rr's not included.

        Forces on the amplitudes are inertial, elastic and of damping.
        """
        body, sums = self.body, self.body.integrals
        m, L = ca.SX(body.mass), ca.SX(body.length)
        flow = L * _times(sums.mixed, self.v)  # p (Phi v)'
        for j in range(sums.count):
            flow += self.v[j] * _times(sums.second_shapes[..., j], self.q)
        torque = 2 * m * (ca.trace(flow) * w - flow.T @ w)
        force = 2 * m * ca.cross(w, _number(sums.first_shapes) @ self.v)
        coriolis = 2 * self._turned(self.v).T @ w
        centrifugal = ca.SX(sums.count, 1)
        for j in range(sums.count):  # p Phi_j'
            moment = L * _number(sums.mixed[..., j]) + _times(sums.second_shapes[..., j], self.q)
            centrifugal[j] = ca.dot(w, moment @ w) - ca.trace(moment) * ca.dot(w, w)
        elastic = symbolic(body.stiffness) @ self.q + symbolic(body.damping) @ self.v
        return torque, force, m * (coriolis + centrifugal) + elastic

    def momentum(self) -> tuple[ca.SX, ca.SX]:
        """Angular and linear momentum (3, 1) of the deformation, about and in the frame of the seat."""
        both = self.frame_coupling() @ self.v
        return both[:3], both[3:]

    def _turned(self, amplitudes: ca.SX) -> ca.SX:
        """(Phi amplitudes) x Phi_j, (3, n)."""
        shapes = self.body.integrals.turning_shapes
        return ca.horzcat(*(_number(shapes[..., j]) @ amplitudes for j in range(shapes.shape[2])))


def without_rounding(sums: np.ndarray) -> np.ndarray:
    """Entries that are rounding errors of larger ones become zero, so that they fold away in symbolic code."""
    return np.where(np.abs(sums) < _ROUNDING * np.max(np.abs(sums), initial=0.0), 0.0, sums)


def _axial(products: np.ndarray) -> np.ndarray:
    """a x b from a b' (3, 3, ...)."""
    return np.stack([products[1, 2] - products[2, 1], products[2, 0] - products[0, 2], products[0, 1] - products[1, 0]])


def _times(numbers: np.ndarray, amplitudes: ca.SX) -> ca.SX:
    """(3, 3, n) times (n, 1), (3, 3)."""
    return ca.reshape(_number(numbers.reshape(9, -1)) @ amplitudes, 3, 3).T


def _number(array: np.ndarray) -> ca.SX:
    return ca.SX(ca.DM(array))
