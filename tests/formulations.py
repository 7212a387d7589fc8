"""Mechanisms as plain numbers, and their motion by formulations that share no code with the package.

A `Sketch` is a mechanism at one assembled configuration with consistent velocities. `newton_euler` finds its accelerations in
maximal coordinates: six for each body, three for each particle, none eliminated. What joints allow is built here from turns and
slides in world axes, constraints are the orthogonal complement, and dependent rows are left to singular values.
`script` is a program that composes the same mechanism from the package's parts; tests run it, and print it when they fail.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

Array = np.ndarray
Place = tuple[Array, Array]
"""R (3, 3) and p (3,) of a frame in another one."""

HELD = (np.eye(3), np.zeros(3))
_RANK = 1e-8


def after(X: Place, Y: Place) -> Place:
    """X_AB and X_BC to X_AC."""
    return X[0] @ Y[0], X[1] + X[0] @ Y[1]


def inverse(X: Place) -> Place:
    """X_AB to X_BA."""
    return X[0].T, -X[0].T @ X[1]


def skew(u: Array) -> Array:
    """The matrix of u x."""
    return np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])


def turned(axis: Array, angle: float) -> Array:
    """Rotation by `angle` [rad] about `axis`, of any length: Rodrigues' formula."""
    K = skew(np.asarray(axis) / np.linalg.norm(axis))
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def of_quaternion(e: Array) -> Array:
    """Rotation of a unit quaternion, scalar first: 1 + 2 w [u]x + 2 [u]x^2."""
    K = skew(e[1:])
    return np.eye(3) + 2 * e[0] * K + 2 * K @ K


def quaternion(R: Array) -> Array:
    """Unit quaternion, scalar first: the eigenvector of Bar-Itzhack's matrix with the largest eigenvalue."""
    S = R + R.T - np.trace(R) * np.eye(3)
    z = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    e = np.linalg.eigh(np.block([[np.array([[np.trace(R)]]), z[None]], [z[:, None], S]]))[1][:, -1]
    return e / np.linalg.norm(e)


@dataclass(frozen=True)
class Body:
    """A `body`, a `particle` (no orientation) or a `massless` part, and its frame in the world."""

    place: Place
    mass: float = 0.0
    centre: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    """About the centre of mass, in the axes of the body's frame."""
    kind: str = "body"


@dataclass(frozen=True)
class Joint:
    """A component of class `kind` made with `options`, between frames of `a` and `b` (-1: the world), at coordinates q."""

    kind: str
    a: int
    b: int
    frame_a: Place
    frame_b: Place
    options: dict[str, Any]
    q: Array


@dataclass(frozen=True)
class Action:
    """A force component between points of bodies (number, position) or on one of them."""

    kind: str
    options: dict[str, Any]
    ends: tuple[tuple[int, Array], ...]


@dataclass(frozen=True)
class Sketch:
    """A mechanism; `twists` (bodies, 6): angular velocity and velocity of each body's frame, in world axes."""

    gravity: Array
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    actions: tuple[Action, ...] = ()
    twists: Array = field(default_factory=lambda: np.zeros((0, 6)))

    def place(self, body: int) -> Place:
        """Of a body or the world."""
        return self.bodies[body].place if body >= 0 else HELD

    def twist(self, body: int) -> tuple[Array, Array]:
        """Angular velocity, velocity."""
        return (self.twists[body, :3], self.twists[body, 3:]) if body >= 0 else (np.zeros(3), np.zeros(3))


# what joints allow ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Moving:
    """A frame that moves in frame_a, in whose axes all is given. `dw`, `dv`: accelerations with rates held."""

    R: Array = field(default_factory=lambda: np.eye(3))
    p: Array = field(default_factory=lambda: np.zeros(3))
    w: Array = field(default_factory=lambda: np.zeros(3))
    v: Array = field(default_factory=lambda: np.zeros(3))
    dw: Array = field(default_factory=lambda: np.zeros(3))
    dv: Array = field(default_factory=lambda: np.zeros(3))

    def turn(self, axis: Array, angle: float, rate: float) -> Moving:
        """About an axis of its own."""
        s = self.R @ axis
        return replace(self, R=self.R @ turned(axis, angle), w=self.w + s * rate, dw=self.dw + np.cross(self.w, s) * rate)

    def ball(self, e: Array, rate: Array) -> Moving:
        """By a quaternion, with the angular velocity `rate` in the turned frame."""
        R = self.R @ of_quaternion(e)
        return replace(self, R=R, w=self.w + R @ rate, dw=self.dw + np.cross(self.w, R @ rate))

    def slide(self, axis: Array, distance: float, rate: float) -> Moving:
        """Along an axis of its own."""
        s, w = self.R @ axis, self.w
        r = s * distance
        bias = np.cross(self.dw, r) + np.cross(w, np.cross(w, r)) + 2 * np.cross(w, s) * rate
        return replace(self, p=self.p + r, v=self.v + np.cross(w, r) + s * rate, dv=self.dv + bias)


def relative(joint: Joint, q: Array, v: Array) -> Moving:
    """frame_b in frame_a."""
    o, still = joint.options, Moving()
    x, y, z = np.eye(3)
    match joint.kind:
        case "Revolute":
            return still.turn(o["axis"], q[0], v[0])
        case "Prismatic":
            return still.slide(o["axis"], q[0], v[0])
        case "Cylindrical":
            return still.slide(o["axis"], q[1], v[1]).turn(o["axis"], q[0], v[0])
        case "Screw":
            lead = o["pitch"] / (2 * np.pi)
            return still.slide(o["axis"], lead * q[0], lead * v[0]).turn(o["axis"], q[0], v[0])
        case "Universal":
            return still.turn(o["axis_a"], q[0], v[0]).turn(o["axis_b"], q[1], v[1])
        case "Spherical":
            return still.ball(q, v)
        case "Planar":
            first, second = {"x": (y, z), "y": (z, x), "z": (x, y)}[o["normal"]]
            return still.slide(first, q[0], v[0]).slide(second, q[1], v[1]).turn(np.cross(first, second), q[2], v[2])
        case "CartesianTranslation":
            return still.slide(x, q[0], v[0]).slide(y, q[1], v[1]).slide(z, q[2], v[2])
        case "Free":
            moved = still.slide(x, q[4], v[3]).slide(y, q[5], v[4]).slide(z, q[6], v[5])
            return moved.ball(q[:4], v[:3])
        case "Fixed":
            return Moving(*_fixed(o))
        case _:
            return _rolling(joint, q, v)


def _fixed(options: dict[str, Any]) -> Place:
    return np.asarray(options["rotation"]), np.asarray(options["position"])


def contact(joint: Joint, n: Array) -> Array:
    """The lowest point in frame_b, when `n` of frame_b points up; `n` may be complex."""
    o = joint.options
    if joint.kind == "RollingBall":
        return -o["radius"] * n
    if joint.kind == "RollingEllipsoid":
        squares = np.asarray(o["semi_axes"]) ** 2
        return -squares * n / np.sqrt(np.sum(squares * n * n))
    across = n * np.array([1, 0, 1])  # the wheel's axis is y
    return -o["radius"] * across / np.sqrt(np.sum(across * across)) - o.get("tube", 0.0) * n


def _rolling(joint: Joint, q: Array, v: Array) -> Moving:
    """The material point at the contact rests. v: angular velocity in frame_b; of a wheel, in axes that do not spin with it."""
    x, y, z = np.eye(3)
    if joint.kind in WHEELS:
        yaw = v[2] / np.cos(q[1])
        heading = Moving().turn(z, q[0], yaw).turn(x, q[1], v[0])
        moved = heading.turn(y, q[2], v[1] - np.sin(q[1]) * yaw)
        axes, turning = heading.R, heading.w
    else:
        moved = Moving().ball(q[:4], v)
        axes, turning = moved.R, moved.w
    n, w = moved.R[2], moved.w
    c = contact(joint, n)
    c_rate = contact(joint, n + 1e-30j * (np.cross(w, z) @ -moved.R)).imag / 1e-30  # n rests in frame_a
    arm = moved.R @ c
    dw = np.cross(turning, axes @ v)
    bias = np.cross(np.cross(w, arm) + moved.R @ c_rate, w) + np.cross(arm, dw)
    return Moving(moved.R, np.array([q[-2], q[-1], -n @ c]), w, np.cross(arm, w), dw, bias)


WHEELS = ("RollingDisk", "RollingTorus")
FREEDOMS = {
    "Revolute": 1, "Prismatic": 1, "Screw": 1, "Cylindrical": 2, "Universal": 2, "Spherical": 3, "Planar": 3,
    "CartesianTranslation": 3, "RollingBall": 3, "RollingDisk": 3, "RollingTorus": 3, "RollingEllipsoid": 3, "Free": 6, "Fixed": 0,
}  # fmt: skip


def subspace(joint: Joint) -> Array:
    """(6, freedoms): angular velocity and rate of the position of frame_b against frame_a, in frame_a, for unit velocities."""
    moves = [relative(joint, joint.q, unit) for unit in np.eye(FREEDOMS[joint.kind])]
    return np.array([np.concatenate([m.w, m.v]) for m in moves]).T.reshape(6, -1)


def between(kind: str, sketch: Sketch, a: int, b: int, world: Place, q: Array, **options: Any) -> Joint:
    """A joint that fits: its frame_a at the place `world`, frame_b where the coordinates q put it."""
    joint = Joint(kind, a, b, after(inverse(sketch.place(a)), world), HELD, options, np.asarray(q, dtype=float))
    moved = relative(joint, joint.q, np.zeros(FREEDOMS[kind]))
    return replace(joint, frame_b=after(inverse(sketch.place(b)), after(world, (moved.R, moved.p))))


def flipped(joint: Joint) -> Joint:
    """The same hold with frame_a and frame_b exchanged; rolling contacts have no such twin."""
    moved = relative(joint, joint.q, np.zeros(FREEDOMS[joint.kind]))
    R, p = inverse((moved.R, moved.p))
    options, q = joint.options, -joint.q
    match joint.kind:
        case "Universal":
            options, q = {"axis_a": options["axis_b"], "axis_b": options["axis_a"]}, q[::-1]
        case "Spherical":
            q = quaternion(R)
        case "Free":
            q = np.concatenate([quaternion(R), p])
        case "Planar":
            q = np.array([*np.delete(np.roll(p, {"x": -1, "y": -2, "z": 0}[options["normal"]]), 2), q[2]])
        case "Fixed":
            options = {"position": p, "rotation": R}
        case _:
            pass
    return Joint(joint.kind, joint.b, joint.a, joint.frame_b, joint.frame_a, options, q)


# maximal coordinates --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Constraint:
    """Rows of one joint: `rows` (m, 6 bodies) times accelerations = `right` (m,). `basis` (6, m): unit wrenches on b at frame_b,
    in world axes, torque first."""

    rows: Array
    right: Array
    basis: Array


@dataclass(frozen=True)
class Maximal:
    """`accelerations` (bodies, 6) in world axes, of body frames; `freedoms`; `wrenches` (joints, 6) on b at frame_b, torque first, where
    `unique`; `conditioning`: smallest over largest singular value of the constraints, but for zeros.
    """

    accelerations: Array
    freedoms: int
    wrenches: Array
    unique: Array
    conditioning: float


def velocities(sketch: Sketch, joint: Joint) -> Array:
    """v of a joint from the twists. A particle has the orientation of what its slider is fixed to."""
    if joint.a >= 0 and sketch.bodies[joint.a].kind == "particle":
        return -velocities(sketch, flipped(joint))
    return np.linalg.lstsq(subspace(joint), _relative_rates(sketch, joint)[0], rcond=None)[0]


def _relative_rates(sketch: Sketch, joint: Joint) -> tuple[Array, Array, Array]:
    """Angular velocity and rate of the position of frame_b in frame_a (6,), their rate without accelerations (6,), and what
    accelerations of the bodies add to it (6, 6 bodies)."""
    R_A, p_A = sketch.place(joint.a)
    R_B, p_B = sketch.place(joint.b)
    (w_A, v_A), (w_B, v_B) = sketch.twist(joint.a), sketch.twist(joint.b)
    R = R_A @ joint.frame_a[0]
    r_b = after((R_B, p_B), joint.frame_b)[1]
    arm, reach = r_b - p_B, r_b - p_A
    reach_rate = v_B + np.cross(w_B, arm) - v_A
    slip = reach_rate - np.cross(w_A, reach)
    bias = np.cross(w_B, np.cross(w_B, arm)) - np.cross(w_A, reach_rate) - np.cross(w_A, slip)
    rate = np.concatenate([R.T @ (w_B - w_A), R.T @ slip])
    J = np.zeros((6, 6 * len(sketch.bodies)))
    for body, sign, r in ((joint.a, -1, reach), (joint.b, 1, arm)):
        if body >= 0:
            J[:3, 6 * body : 6 * body + 3] = sign * R.T
            J[3:, 6 * body : 6 * body + 6] = sign * np.hstack([-R.T @ skew(r), R.T])
    return rate, np.concatenate([-R.T @ np.cross(w_A, w_B), R.T @ bias]), J


def constraint(sketch: Sketch, joint: Joint) -> Constraint:
    """What the joint does not allow: the orthogonal complement of its subspace."""
    S = subspace(joint)
    point = joint.b >= 0 and sketch.bodies[joint.b].kind == "particle"
    entries = slice(3, 6) if point else slice(0, 6)
    U, s, _ = np.linalg.svd(S[entries], full_matrices=True)
    T = np.zeros((6, U.shape[1] - int(np.sum(s > _RANK))))
    T[entries] = U[:, int(np.sum(s > _RANK)) :]
    _, bias, J = _relative_rates(sketch, joint)
    moved = relative(joint, joint.q, velocities(sketch, joint))
    R = after(sketch.place(joint.a), joint.frame_a)[0]
    world = np.vstack([R @ T[:3], R @ T[3:]])
    return Constraint(T.T @ J, T.T @ (np.concatenate([moved.dw, moved.dv]) - bias), world)


def free_columns(sketch: Sketch) -> Array:
    """Which of the six accelerations of each body there are: particles have three."""
    return np.array([body.kind != "particle" or k >= 3 for body in sketch.bodies for k in range(6)])


def moving(sketch: Sketch, rng: np.random.Generator, speed: float = 1.0) -> Sketch:
    """With random twists that all joints allow."""
    still = replace(sketch, twists=np.zeros((len(sketch.bodies), 6)))
    free = free_columns(still)
    G = np.vstack([constraint(still, j).rows for j in still.joints] or [np.zeros((0, free.size))])[:, free]
    Z = _null(G)[0]
    twists = np.zeros(free.size)
    twists[free] = Z @ (Z.T @ rng.normal(size=Z.shape[0]))
    return replace(still, twists=speed * twists.reshape(-1, 6))


def _null(G: Array) -> tuple[Array, Array, float]:
    """Null space (n, k), pseudoinverse (n, m) and conditioning."""
    U, s, Vt = np.linalg.svd(G, full_matrices=True)
    rank = int(np.sum(s > _RANK * max(1.0, s[0] if s.size else 0.0)))
    condition = float(s[rank - 1] / s[0]) if rank else 1.0
    return Vt[rank:].T, Vt[:rank].T @ (U[:, :rank] / s[:rank]).T, condition


def newton_euler(sketch: Sketch) -> Maximal:
    """M a = f + G' y with G a = g, whatever the rank of G: a = G^+ g + Z u, with Z the null space of G, and Z'(M a - f) = 0."""
    free = free_columns(sketch)
    parts = [constraint(sketch, joint) for joint in sketch.joints]
    G = np.vstack([part.rows for part in parts] or [np.zeros((0, free.size))])[:, free]
    right = np.concatenate([part.right for part in parts] or [np.zeros(0)])
    M, f = mass_matrix(sketch)[np.ix_(free, free)], applied(sketch)[free]
    Z, inverse_G, condition = _null(G)
    start = inverse_G @ right
    a = start + Z @ np.linalg.solve(Z.T @ M @ Z, Z.T @ (f - M @ start))
    y = inverse_G.T @ (M @ a - f)
    loose = _null(G.T)[0]
    wrenches, unique, first = [], [], 0
    for part in parts:
        rows = slice(first, first + part.right.size)
        wrenches.append(part.basis @ y[rows])
        unique.append(np.max(np.abs(loose[rows]), initial=0.0) < 1e-6)
        first += part.right.size
    full = np.zeros(free.size)
    full[free] = a
    return Maximal(full.reshape(-1, 6), Z.shape[1], np.array(wrenches).reshape(-1, 6), np.array(unique, dtype=bool), condition)


def mass_matrix(sketch: Sketch) -> Array:
    """Of all bodies about the origins of their frames, in world axes."""
    M = np.zeros((6 * len(sketch.bodies),) * 2)
    for k, body in enumerate(sketch.bodies):
        R = body.place[0]
        c = skew(R @ body.centre)
        own = np.block([[R @ body.inertia @ R.T - body.mass * c @ c, body.mass * c], [-body.mass * c, body.mass * np.eye(3)]])
        M[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = own
    return M


def applied(sketch: Sketch) -> Array:
    """Wrenches of gravity and of all actions on the bodies, less what they need without accelerations."""
    f = np.zeros((len(sketch.bodies), 6))
    for k, body in enumerate(sketch.bodies):
        R, (w, _) = body.place[0], sketch.twist(k)
        c = R @ body.centre
        about_origin = R @ body.inertia @ R.T - body.mass * skew(c) @ skew(c)
        f[k, :3] = np.cross(c, body.mass * sketch.gravity) - np.cross(w, about_origin @ w)
        f[k, 3:] = body.mass * (sketch.gravity - np.cross(w, np.cross(w, c)))
    for action in sketch.actions:
        for (body, point), (torque, force) in zip(action.ends, _exerted(sketch, action), strict=True):
            if body >= 0:
                f[body, :3] += torque + np.cross(sketch.place(body)[0] @ point, force)
                f[body, 3:] += force
    return f.ravel()


def _end(sketch: Sketch, end: tuple[int, Array]) -> tuple[Array, Array]:
    """Position and velocity of a point."""
    (R, p), (w, v) = sketch.place(end[0]), sketch.twist(end[0])
    return p + R @ end[1], v + np.cross(w, R @ end[1])


def _exerted(sketch: Sketch, action: Action) -> list[tuple[Array, Array]]:
    """Torque and force on each end."""
    o, none = action.options, np.zeros(3)
    if action.kind in ("Force", "Torque"):
        value = np.asarray(o["force" if action.kind == "Force" else "torque"])
        value = sketch.place(action.ends[0][0])[0] @ value if o["resolved_in"] == "body" else value
        return [(none, value) if action.kind == "Force" else (value, none)]
    (r_a, v_a), (r_b, v_b) = (_end(sketch, end) for end in action.ends)
    length = np.linalg.norm(r_b - r_a)
    along = (r_b - r_a) / length
    tension = o.get("stiffness", 0.0) * (length - o.get("natural_length", 0.0)) + o.get("damping", 0.0) * (along @ (v_b - v_a))
    return [(none, tension * along), (none, -tension * along)]


def kinetic_energy(sketch: Sketch) -> float:
    """[J]."""
    return float(0.5 * sketch.twists.ravel() @ mass_matrix(sketch) @ sketch.twists.ravel())


def momenta(sketch: Sketch) -> Array:
    """Angular momentum about the world's origin, and momentum (6,)."""
    h = (mass_matrix(sketch) @ sketch.twists.ravel()).reshape(-1, 6)
    about_origin = [h[k, :3] + np.cross(body.place[1], h[k, 3:]) for k, body in enumerate(sketch.bodies)]
    return np.concatenate([np.sum(about_origin, axis=0), np.sum(h[:, 3:], axis=0)])


def displaced(sketch: Sketch, X: Place) -> Sketch:
    """The whole scene turned and shifted, gravity as well; what was held by the world is held where it went."""
    R = X[0]
    bodies = tuple(replace(body, place=after(X, body.place)) for body in sketch.bodies)
    joints = tuple(
        replace(j, frame_a=after(X, j.frame_a) if j.a < 0 else j.frame_a, frame_b=after(X, j.frame_b) if j.b < 0 else j.frame_b)
        for j in sketch.joints
    )
    actions = []
    for action in sketch.actions:
        o, ends = dict(action.options), tuple((b, R @ r + X[1] if b < 0 else r) for b, r in action.ends)
        for key in ("force", "torque"):
            if key in o and o["resolved_in"] == "world":
                o[key] = R @ o[key]
        actions.append(Action(action.kind, o, ends))
    twists = np.hstack([sketch.twists[:, :3] @ R.T, sketch.twists[:, 3:] @ R.T])
    return Sketch(R @ sketch.gravity, bodies, joints, tuple(actions), twists)


def relabelled(sketch: Sketch, bodies: Array, joints: Array) -> Sketch:
    """Other names and another order: body `bodies[k]` becomes number k, joint `joints[k]` number k."""
    number = {int(old): new for new, old in enumerate(bodies)} | {-1: -1}
    held = tuple(replace(sketch.joints[k], a=number[sketch.joints[k].a], b=number[sketch.joints[k].b]) for k in joints)
    actions = tuple(replace(x, ends=tuple((number[b], r) for b, r in x.ends)) for x in sketch.actions)
    return Sketch(sketch.gravity, tuple(sketch.bodies[k] for k in bodies), held, actions, sketch.twists[bodies])


# the same from the package's parts ------------------------------------------------------------------------------------


def script(sketch: Sketch, backwards: bool = False) -> str:
    """A program that composes the sketch as `scene`, with bodies `b0`, joints `j0`, actions `f0`.

    `backwards`: joints before bodies, connections last to first and their ends exchanged.
    """
    lines, links = [f"scene.world = World({_text(sketch.gravity)})"], _Links(sketch)
    for k, body in enumerate(sketch.bodies):
        R, p = body.place
        if body.kind == "particle":
            lines.append(f"scene.b{k} = Particle({float(body.mass)!r})")
        elif body.kind == "body":
            lines.append(
                f"scene.b{k} = RigidBody({float(body.mass)!r}, np.array({_text(body.inertia)}), {_text(body.centre)}, "
                f"position={_text(p)}, rotation=np.array({_text(R)}))"
            )
    for k, joint in enumerate(sketch.joints):
        lines.append(f"scene.j{k} = {joint.kind}({_options(joint.options)})")
        for body, frame, name in ((joint.a, joint.frame_a, "frame_a"), (joint.b, joint.frame_b, "frame_b")):
            links.add(lines, body, frame, f"scene.j{k}.{name}")
    for k, action in enumerate(sketch.actions):
        lines.append(f"scene.f{k} = {action.kind}({_options(action.options)})")
        names = {"Force": ["point"], "Torque": ["frame"]}.get(action.kind, ["point_a", "point_b"])
        for (body, point), name in zip(action.ends, names, strict=True):
            links.add(lines, body, (np.eye(3), point), f"scene.f{k}.{name}")
    pairs = [(b, a) for a, b in reversed(links.pairs)] if backwards else links.pairs
    lines = lines[::-1] if backwards else lines
    lines += [f"scene.connect({a}, {b})" for a, b in pairs]
    head = ["import numpy as np", "", "import acausal as ac", "from components import *", "", "scene = ac.System()"]
    return "\n".join([*head, *lines, ""])


class _Links:
    """Connections. A massless part is a star of rigid connections, one for each of its frames."""

    def __init__(self, sketch: Sketch) -> None:
        self.sketch, self.pairs, self.stars = sketch, [], {}

    def add(self, lines: list[str], body: int, frame: Place, connector: str) -> None:
        kind = self.sketch.bodies[body].kind if body >= 0 else "world"
        R, p = frame
        if kind == "particle":
            self.pairs.append((f"scene.b{body}.point", connector))
        elif kind == "massless":
            count = self.stars[body] = self.stars.get(body, -1) + 1
            name = f"scene.b{body}_{count}"
            lines.append(f"{name} = Fixed({_text(p)}, np.array({_text(R)}))")
            self.pairs.append((f"{name}.frame_b", connector))
            if count:
                self.pairs.append((f"scene.b{body}_0.frame_a", f"{name}.frame_a"))
        else:
            part = "scene.world" if body < 0 else f"scene.b{body}"
            turn = "" if np.array_equal(R, np.eye(3)) else f", np.array({_text(R)})"
            self.pairs.append((f"{part}.at({_text(p)}{turn})", connector))


def _options(options: dict[str, Any]) -> str:
    return ", ".join(f"{name}={_text(value)}" for name, value in options.items())


def _text(value: Any) -> str:
    if isinstance(value, np.ndarray) and value.ndim == 2:
        return repr(value.tolist())
    return repr(tuple(float(x) for x in value)) if isinstance(value, np.ndarray | tuple | list) else repr(value)


def composed(source: str) -> Any:
    """The scene of a script."""
    names: dict[str, Any] = {}
    exec(compile(source, "sketch.py", "exec"), names)
    return names["scene"]
