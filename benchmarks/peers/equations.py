"""Equations of motion of the benchmark scenes by hand, without anything of `acausal`: for the references, and for JAX.

Each is written once for any array module and float type: `numpy` with `longdouble` for references, `jax.numpy` for diffrax. In a plane, a point of a
mechanism is p = p0 + sum_j c_j exp(i phi_j) with the absolute angles phi_j of the bodies: velocities and accelerations follow by
sight, and closed loops are such sums that stay zero (index 1, multipliers by a linear system).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

Array = Any
Solve = Callable[[Array, Array], Array]
Real = Callable[[Any], Any]


@dataclass(frozen=True)
class Equations:
    """`start()`: y (ny,). `rate(y, xp, solve)`: y'. `observed(y)`: what is compared at the end (no,)."""

    start: Callable[[], np.ndarray]
    rate: Callable[[Array, Any, Solve], Array]
    observed: Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class PlanarMechanism:
    """Bodies with absolute angles. Rows of `centres` (n, n) and `loops` (m, n) hold the coefficients c_j; `pull` (n,) is the force
    on all masses per kg as a complex number; `torque(angles, xp)` (n,) adds generalised forces on the angles."""

    mass: np.ndarray
    inertia: np.ndarray
    centres: np.ndarray
    loops: np.ndarray
    gravity: complex = 0.0
    torque: Callable[[Array, Any], Array] | None = None

    def rate(self, y: Array, xp: Any, solve: Solve) -> Array:
        """(angles, rates) -> (rates, accelerations)."""
        n, m = len(self.mass), len(self.loops)
        turn = xp.exp(1j * y[:n])
        square = y[n:] ** 2
        J = 1j * self.centres * turn[None, :]
        bias = -(self.centres * turn[None, :]) @ square - self.gravity
        M = xp.real(xp.conj(J).T @ (self.mass[:, None] * J)) + xp.diag(xp.asarray(self.inertia))
        force = -xp.real(xp.conj(J).T @ (self.mass * bias))
        if self.torque is not None:
            force = force + self.torque(y[:n], xp)
        if m:
            G = 1j * self.loops * turn[None, :]
            A = xp.concatenate([xp.real(G), xp.imag(G)])
            drift = (self.loops * turn[None, :]) @ square
            zero = xp.zeros((2 * m, 2 * m), dtype=M.dtype)
            K = xp.concatenate([xp.concatenate([M, A.T], axis=1), xp.concatenate([A, zero], axis=1)])
            acceleration = solve(K, xp.concatenate([force, xp.real(drift), xp.imag(drift)]))[:n]
        else:
            acceleration = solve(M, force)
        return xp.concatenate([y[n:], acceleration])


def _closed(loops: np.ndarray, offsets: np.ndarray, angles: np.ndarray, free: int) -> np.ndarray:
    """Angles with all loops closed: Newton, holding angle `free`."""
    others = [j for j in range(len(angles)) if j != free]
    for _ in range(12):
        terms = loops * np.exp(1j * angles)
        gap = terms.sum(axis=1) + offsets
        J = (1j * terms)[:, others]
        step = gauss(np.concatenate([J.real, J.imag]), np.concatenate([gap.real, gap.imag]))
        angles = angles.copy()
        angles[others] -= step
    return angles


def _closed_rates(loops: np.ndarray, angles: np.ndarray, free: int, rate: float) -> np.ndarray:
    """Rates that keep all loops closed when angle `free` has `rate`."""
    J = 1j * loops * np.exp(1j * angles)
    others = [j for j in range(len(angles)) if j != free]
    known = J[:, free] * rate
    rates = np.zeros_like(angles)
    rates[free] = rate
    rates[others] = gauss(np.concatenate([J[:, others].real, J[:, others].imag]), -np.concatenate([known.real, known.imag]))
    return rates


def gauss(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Solution of A x = b by elimination with row pivots, in whatever float type they have."""
    n = len(b)
    W = np.concatenate([A, b[:, None]], axis=1)
    for k in range(n):
        pivot = k + int(np.argmax(np.abs(W[k:, k])))
        W[[k, pivot]] = W[[pivot, k]]
        W[k + 1 :, k:] -= np.outer(W[k + 1 :, k] / W[k, k], W[k, k:])
    x = np.zeros_like(b)
    for k in range(n - 1, -1, -1):
        x[k] = (W[k, n] - W[k, k + 1 : n] @ x[k + 1 :]) / W[k, k]
    return x


def _array(real: Real, *values: Any) -> np.ndarray:
    """Numbers or decimal strings as `real` (n,)."""
    return np.array([real(v) for v in values])


# Planar double pendulum: two uniform rods of 1 kg and 1 m; angles from x to z, so a rod that hangs has angle -pi/2.


def _double_pendulum(real: Real) -> Equations:
    rods = PlanarMechanism(
        np.ones(2), np.ones(2) * real(1) / 12, np.array([[0.5, 0], [1, 0.5]]), np.zeros((0, 2)), -1j * real("9.81")
    )

    def start() -> np.ndarray:  # turned by 0.6 about y, which leads from z to x
        angle = -np.arccos(real(0)) - real("0.6")
        return np.array([angle, angle, 0, 0], dtype=real)

    def observed(y: np.ndarray) -> np.ndarray:
        elbow = np.exp(1j * y[0])
        tip = elbow + np.exp(1j * y[1])
        return np.array([elbow.real, elbow.imag, tip.real, tip.imag])

    return Equations(start, rods.rate, observed)


# Four-bar: crank 0.4 m and 1 kg, coupler 1.2 m and 2 kg, rocker 0.8 m and 1.5 kg, ground 1 m, all uniform rods.


def _four_bar(real: Real) -> Equations:
    length, mass = _array(real, "0.4", "1.2", "0.8"), _array(real, "1", "2", "1.5")
    loops = np.array([[length[0], length[1], -length[2]]])
    centres = np.array([[length[0] / 2, 0, 0], [length[0], length[1] / 2, 0], [0, 0, length[2] / 2]])
    bars = PlanarMechanism(mass, mass * length**2 / 12, centres, loops, -1j * real("9.81"))

    def start() -> np.ndarray:
        angles = _closed(loops, np.array([real(-1)]), _array(real, "0.5", "0", "1"), 0)
        return np.concatenate([angles, _closed_rates(loops, angles, 0, -3.0)])

    def observed(y: np.ndarray) -> np.ndarray:
        crank, rocker = length[0] * np.exp(1j * y[0]), 1 + length[2] * np.exp(1j * y[2])
        return np.array([crank.real, crank.imag, rocker.real, rocker.imag])

    return Equations(start, bars.rate, observed)


# Andrews' squeezing mechanism, as in the test set of Mazzia and Magherini; absolute angles of bodies 1 ... 7.

ANDREWS_START = (
    "-0.0617138900142764496358948458001", "0", "0.455279819163070380255912382449", "0.222668390165885884674473185609",
    "0.487364979543842550225598953530", "-0.222668390165885884674473185609", "1.23054744454982119249735015568",
)  # fmt: skip


def andrews_absolute(q: np.ndarray) -> np.ndarray:
    """Absolute angles of the seven bodies from the literature's (beta, Theta, gamma, Phi, delta, Omega, epsilon)."""
    return np.array([q[0], q[0] + q[1], q[2], q[3] + q[4], q[4], q[5] + q[6], q[6]])


def directions(angles: np.ndarray) -> np.ndarray:
    """Cosines, then sines."""
    return np.concatenate([np.cos(angles), np.sin(angles)])


def _andrews(real: Real) -> Equations:
    mass = _array(real, "0.04325", "0.00365", "0.02373", "0.00706", "0.0705", "0.00706", "0.05498")
    inertia = _array(real, "2.194e-6", "4.41e-7", "5.255e-6", "5.667e-7", "1.169e-5", "5.667e-7", "1.912e-5")
    rr, d, e, zt, zf, u, ss = _array(real, "0.007", "0.028", "0.02", "0.04", "0.02", "0.04", "0.035")
    centres, loops = np.zeros((7, 7), dtype=type(1j * real(1))), np.zeros((3, 7), dtype=type(1j * real(1)))
    centres[0, 0] = real("0.00092")
    centres[1, [0, 1]] = rr, -real("0.0115")
    centres[2, 2] = real("0.01043") - 1j * real("0.01874")
    centres[3, [4, 3]] = zt, -1j * (e - real("0.01421"))
    centres[4, 4] = real("0.02308") + 1j * real("0.00916")
    centres[5, [6, 5]] = -1j * u, zf - real("0.01421")
    centres[6, 6] = -real("0.00449") - 1j * real("0.01228")
    # E reached over body 3, less E over 2, over 4 and over 6
    loops[:, 2] = -1j * ss
    loops[0, [0, 1]] = -rr, d
    loops[1, [3, 4]] = 1j * e, -zt
    loops[2, [5, 6]] = -zf, 1j * u
    B = real("-0.03635") + 1j * real("0.03273")
    C = real("0.014") + 1j * real("0.072")
    arm = real("0.02") - 1j * real("0.018")

    def torque(angles: Array, xp: Any) -> Array:
        turned = arm * xp.exp(1j * angles[2])
        reach = B + turned - C
        length = xp.abs(reach)
        pull = -real(4530) * (length - real("0.07785")) * reach / length
        moment = xp.real(xp.conj(1j * turned) * pull)
        zero = 0 * moment
        return xp.stack([zero + real("0.033"), zero, moment, zero, zero, zero, zero])

    links = PlanarMechanism(mass, inertia, centres, loops, 0.0, torque)

    def start() -> np.ndarray:
        return np.concatenate([andrews_absolute(_array(real, *ANDREWS_START)), np.zeros(7, dtype=real)])

    return Equations(start, links.rate, lambda y: directions(y[:7]))


# Quaternions, scalar first.


def quaternion_rate(q: Array, w: Array, xp: Any) -> Array:
    """q' for the angular velocity `w` in the body."""
    s, v = q[0], q[1:4]
    return xp.concatenate([-0.5 * xp.sum(v * w)[None], 0.5 * (s * w + xp.cross(v, w))])


def rotation(q: Array, xp: Any) -> Array:
    """Rotation matrix (3, 3) of a quaternion of any length."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    R = xp.stack([
        w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z,
    ])  # fmt: skip
    return R.reshape(3, 3) / xp.sum(q * q)


# Lagrange's top: 0.5 kg, centre of mass 0.05 m from the fixed point, leaning by 0.4 rad, spinning at 60 rad/s.


def _top(real: Real) -> Equations:
    inertia = _array(real, "8e-4", "8e-4", "1e-3") + real("0.5") * real("0.05") ** 2 * np.array([1, 1, 0])
    weight = real("0.5") * real("9.81") * real("0.05")

    def rate(y: Array, xp: Any, solve: Solve) -> Array:
        q, w = y[:4], y[4:]
        up = rotation(q, xp)[2]
        moment = weight * xp.stack([up[1], -up[0], 0 * up[0]])  # (0, 0, l) x (-m g up)
        return xp.concatenate([quaternion_rate(q, w, xp), (moment - xp.cross(w, inertia * w)) / inertia])

    def start() -> np.ndarray:
        half = real("0.2")
        return np.array([np.cos(half), np.sin(half), 0, 0, 0, 0, 60], dtype=real)

    return Equations(start, rate, lambda y: rotation(y[:4], np).ravel())


# Disk of 0.01 kg and radius 0.05 m, axis y of the body, rolling on z = 0.


def _disk(real: Real) -> Equations:
    m, r, g = real("0.01"), real("0.05"), real("9.81")
    inertia = m * r * r * np.array([0.25, 0.5, 0.25])

    def arm(up: Array, xp: Any) -> tuple[Array, Array]:
        """From the contact to the centre, in the body, and the length of `up` across the axis."""
        across = up * np.array([1, 0, 1])
        length = xp.sqrt(xp.sum(across**2))
        return r * across / length, length

    def rate(y: Array, xp: Any, solve: Solve) -> Array:
        q, w = y[:4], y[4:7]
        R = rotation(q, xp)
        up = R[2]
        a, length = arm(up, xp)
        turned = -xp.cross(w, up) * np.array([1, 0, 1])  # rate of `across`
        a_rate = r * turned / length - a * xp.sum(turned * a) / (r * length)
        velocity = xp.cross(w, a)
        bias = xp.cross(w, velocity) + xp.cross(w, a_rate) + g * up
        M = xp.diag(xp.asarray(inertia)) + m * (xp.sum(a * a) * xp.eye(3, dtype=y.dtype) - a[:, None] * a[None, :])
        w_rate = solve(M, -xp.cross(w, inertia * w) - m * xp.cross(a, bias))
        return xp.concatenate([quaternion_rate(q, w, xp), w_rate, (R @ velocity)[:2]])

    def start() -> np.ndarray:
        half = real("0.15")
        return np.array([np.cos(half), np.sin(half), 0, 0, "0.2", 12, "0.5", 0, 0], dtype=real)

    def observed(y: np.ndarray) -> np.ndarray:
        R = rotation(y[:4], np)
        return np.concatenate([y[7:9], [(R @ arm(R[2], np)[0])[2]], R.ravel()])

    return Equations(start, rate, observed)


# Ten links of 1 kg and 1 m, hinges about y and x in turn, by Newton and Euler with Jacobians in the world frame.

LINKS = 10
CHAIN_ANGLE = "0.3"


def _chain(real: Real) -> Equations:
    inertia = np.diag(_array(real, "0.1", "0.2", "0.25"))

    upto = np.tril(np.ones((LINKS, LINKS)))[:, :, None]  # hinge j moves link k

    def kinematics(q: Array, xp: Any) -> tuple[Array, Array, Array]:
        """Orientations (n, 3, 3), hinge axes (n, 3), and hinge positions with the tip (n + 1, 3)."""
        R, axes, orientations = xp.eye(3, dtype=q.dtype), [], []
        c, s = xp.cos(q), xp.sin(q)
        one, zero = 0 * q[0] + 1, 0 * q[0]
        for k in range(LINKS):
            if k % 2 == 0:
                turn = xp.stack([c[k], zero, s[k], zero, one, zero, -s[k], zero, c[k]]).reshape(3, 3)
            else:
                turn = xp.stack([one, zero, zero, zero, c[k], -s[k], zero, s[k], c[k]]).reshape(3, 3)
            axes.append(R[:, 1 - k % 2])
            R = R @ turn
            orientations.append(R)
        rotations = xp.stack(orientations)
        ends = -xp.cumsum(rotations[:, :, 2], axis=0)
        return rotations, xp.stack(axes), xp.concatenate([0 * ends[:1], ends])

    def rate(y: Array, xp: Any, solve: Solve) -> Array:
        q, v = y[:LINKS], y[LINKS:, None]
        R, Z, hinges = kinematics(q, xp)
        link = hinges[1:] - hinges[:-1]
        w = xp.cumsum(Z * v, axis=0)
        alpha = xp.cumsum(xp.cross(w, Z) * v, axis=0)  # with all hinges at constant rates
        swing = xp.cross(alpha, link) + xp.cross(w, xp.cross(w, link))
        centre = xp.cumsum(swing, axis=0) - swing / 2 + np.array([0, 0, real("9.81")])
        I = R @ inertia @ xp.swapaxes(R, 1, 2)  # noqa: E741
        spin = xp.einsum("kab,kb->ka", I, w)
        torque = xp.einsum("kab,kb->ka", I, alpha) + xp.cross(w, spin)
        Jw = Z[None] * upto
        Jv = xp.cross(Z[None], (hinges[:-1] + link / 2)[:, None] - hinges[None, :-1]) * upto
        M = xp.einsum("kja,kla->jl", Jv, Jv) + xp.einsum("kja,kla->jl", Jw, xp.einsum("kab,kjb->kja", I, Jw))
        force = -xp.einsum("kja,ka->j", Jv, centre) - xp.einsum("kja,ka->j", Jw, torque)
        return xp.concatenate([y[LINKS:], solve(M, force)])

    def start() -> np.ndarray:
        return np.concatenate([_array(real, *[CHAIN_ANGLE] * LINKS), np.zeros(LINKS, dtype=real)])

    def observed(y: np.ndarray) -> np.ndarray:
        hinges = kinematics(y[:LINKS], np)[2]
        return np.concatenate([hinges[5], hinges[10]])

    return Equations(start, rate, observed)


# Spring pendulum: 1 kg at a spring of 10 kN/m and 1 m, let go when horizontal.


def _spring_pendulum(real: Real) -> Equations:
    def rate(y: Array, xp: Any, solve: Solve) -> Array:
        length = xp.sqrt(y[0] ** 2 + y[1] ** 2)
        pull = -10000 * (length - 1) / length
        return xp.stack([y[2], y[3], pull * y[0], pull * y[1] - real("9.81")])

    return Equations(lambda: _array(real, 1, 0, 0, 0), rate, lambda y: np.array(y[:2]))


_SCENES: dict[str, Callable[[Real], Equations]] = {
    "double_pendulum": _double_pendulum,
    "top": _top,
    "chain": _chain,
    "four_bar": _four_bar,
    "andrews": _andrews,
    "disk": _disk,
    "spring_pendulum": _spring_pendulum,
}


def equations(name: str, real: Real = np.longdouble) -> Equations:
    """Of the scene with this name, with numbers of type `real`."""
    return _SCENES[name](real)
