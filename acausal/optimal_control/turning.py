"""How a body turns from one attitude to another: on from the spin that it has, the short way or the other one."""

from __future__ import annotations

import numpy as np

_SLOW = 1e-6
"""How far a spin would turn in the whole time [rad]: it does not."""
FAR = np.pi / 2
"""How far the short way goes at least [rad], where the other one is tried, too: no more than three times as far."""


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of quaternions (4, ...), scalar first."""
    return np.array(
        [
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        ]
    )


def turned(angles: np.ndarray) -> np.ndarray:
    """The quaternion (4, ...) of a rotation vector (3, ...) [rad]."""
    size = np.linalg.norm(angles, axis=0)
    return np.concatenate([np.cos(size / 2)[None], 0.5 * np.sinc(size / (2 * np.pi)) * angles])


def angles_of(q: np.ndarray) -> np.ndarray:
    """The rotation vector (3,) [rad] of a unit quaternion (4,), from 0 to 2 pi long: of q and -q one goes the other way round."""
    size = float(np.linalg.norm(q[1:]))
    return q[1:] * (2 * np.arctan2(size, q[0]) / size) if size > 0 else np.zeros(3)


def spins(w: np.ndarray, duration: float) -> bool:
    """Whether a body that turns like this (3,) [rad/s] turns at all."""
    return float(np.linalg.norm(w)) * duration > _SLOW


def turning_path(
    ends: tuple[np.ndarray, np.ndarray],
    w: tuple[np.ndarray, np.ndarray],
    duration: float,
    s: np.ndarray,
    *,
    told: bool,
    around: bool,
) -> np.ndarray:
    """Attitudes (n, 4) at parts s (n,) of the duration [s], between attitudes (4,) with spins (3,) [rad/s] in axes of the body: the one ends as the other begins,
    each steadily; and what is left goes smoothly, the short way, or the other one (`around`). Not at all where the last attitude is not `told`.
    """
    first, last = (one / np.linalg.norm(one) for one in ends)
    slower, faster = (turned(np.outer(0.5 * duration * w[0], 2 * s - s * s)), turned(np.outer(0.5 * duration * w[1], s * s)))
    before, after = (turned(0.5 * duration * one) * [1, -1, -1, -1] for one in w)
    rest = product(product(before, product(first * [1, -1, -1, -1], last)), after)
    rest = rest if (rest[0] < 0) == around else -rest
    smooth = s**3 * (10 - 15 * s + 6 * s * s)
    middle = turned(np.outer(angles_of(rest) if told else np.zeros(3), smooth))
    return product(product(product(first[:, None], slower), middle), faster).T


def short_way(first: np.ndarray, last: np.ndarray) -> float:
    """The angle [rad] between two attitudes (4,)."""
    return float(2 * np.arccos(min(1.0, abs(first @ last) / (np.linalg.norm(first) * np.linalg.norm(last)))))
