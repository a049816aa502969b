"""Torque-free rotation of a rigid body with three moments of inertia.

Seen from axes that turn about the angular momentum at a constant rate, the body's rotation repeats itself (Landau and
Lifshitz, Mechanics, 37: "turns about the angular momentum" have a mean rate and a periodic part). So a motion is two
constant rates, those of precession and nutation, and one period of nutation as nodes: Jacobi's elliptic functions give
the angular momentum in body axes, and an integral over their period the turn about it.

What decides between the two kinds of motion, and how near they are to each other, is a difference of nearly equal
numbers; it is taken in rational arithmetic, so that motions next to the separatrix are those of the given numbers.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from warpsim.arrays import F64
from warpsim.config.fields import Number, Positive, Vector
from warpsim.config.model import config_model
from warpsim.errors import InputError
from warpsim.quaternion import conjugate, from_matrix, product, rotated, unit
from warpsim.streams import uniforms
from warpsim.target.attitude import turns
from warpsim.target.attitude_table import NORM_TOLERANCE

NODE_ERROR_RAD = 1e-11
"""Most that a cubic between two nodes of the nutation may be off, ..."""
MOST_NODES = 2**18
"""... as far as these nodes allow, at one part in 1e150 from the separatrix."""
ROUNDED = Fraction(1, 10**9)
"""By this part the largest moment may exceed the sum of the others: those of flat bodies are rounded."""
NEAREST = Fraction(1, 10**300)
"""Stands for 0 as the complement of the modulus: a body exactly on the separatrix turns over after some 700 radians."""


@config_model
class TorqueFree:
    """Free rotation of a rigid body: no torque acts on it, so its angular momentum stays.

    Args:
        moments: Principal moments of inertia about the body's x, y and z; only their ratios count, and none exceeds the
            sum of the other two.
        rates_deg_s: Angular velocity at the epoch, in body axes [deg/s].
        quaternion: Rotation (x, y, z, w) body -> GCRS at the epoch, scalar last, of norm 1 within 1e-3; seeded when
            left out, all rotations being equally likely.
    """

    moments: tuple[Positive, Positive, Positive]
    rates_deg_s: Vector
    quaternion: tuple[Number, Number, Number, Number] | None = None
    kind: Literal["torque_free"] = Field(default="torque_free", kw_only=True)

    @model_validator(mode="after")
    def _of_a_body(self) -> TorqueFree:
        largest = max(map(Fraction, self.moments))
        if 2 * largest > sum(map(Fraction, self.moments)) + ROUNDED * largest:
            raise InputError("none must exceed the sum of the other two", "moments", list(self.moments))
        if self.quaternion is not None:
            norm = float(np.linalg.norm(self.quaternion))
            if not abs(norm - 1) <= NORM_TOLERANCE:
                raise InputError(f"norm must be 1 within {NORM_TOLERANCE:g}", "quaternion", norm, ".6g")
        return self

    def motion(self, seed: int, target: int) -> TorqueFreeMotion:
        """Return the motion of a scene's target."""
        start = unit(self.quaternion or _any_rotation(*uniforms(seed, "attitude", target, 3)))
        nutation = _nutation(self.moments, self.rates_deg_s)
        return TorqueFreeMotion(unit(product(start, conjugate(nutation.quaternion[0]))), nutation)


def _any_rotation(u: float, v: float, w: float) -> F64:
    """A rotation out of all by three uniform numbers (Shoemake 1992)."""
    a, b = math.sqrt(1 - u), math.sqrt(u)
    v, w = 2 * math.pi * v, 2 * math.pi * w
    return np.array([a * math.sin(v), a * math.cos(v), b * math.sin(w), b * math.cos(w)])


@dataclass(frozen=True, eq=False)
class Nutation:
    """Rotation of a body against axes that turn about its angular momentum, their z, at a constant rate."""

    precession_rev_s: float
    """Rate of these axes."""
    rate_rev_s: float
    """Periods of the nutation in a second; 0 where it stands still."""
    quaternion: F64
    """Rotation body -> these axes at n equal steps over a period from the epoch on, (n, 4)."""
    step: F64
    """By how much it changes in a step at each, (n, 4)."""

    def at(self, phase_rev: F64) -> F64:
        """Return the rotation against the precessing axes at phases [rev], (..., 4): cubic between nodes (Hermite)."""
        n = len(self.quaternion)
        position = (phase_rev - np.floor(phase_rev)) * n
        node = np.minimum(position.astype(np.int64), n - 1)
        u, after = (position - node)[..., None], (node + 1) % n
        chord = self.quaternion[after] - self.quaternion[node]
        first, last = self.step[node], self.step[after]
        bend = 3.0 * chord - 2.0 * first - last + (first + last - 2.0 * chord) * u
        return unit(self.quaternion[node] + (first + bend * u) * u)


@dataclass(frozen=True, eq=False)
class TorqueFreeMotion:
    """A torque-free rotation in space."""

    frame: F64
    """Rotation to GCRS of axes whose z is the angular momentum, and which the precession begins with; (4,)."""
    nutation: Nutation

    @property
    def axes(self) -> F64:
        """Rows reference (the angular momentum), first, second: right-handed, unit, GCRS axes; shape (3, 3)."""
        return rotated(self.frame, np.eye(3)[[2, 0, 1]])

    def at(self, time_s: npt.ArrayLike) -> F64:
        """Rotation body -> GCRS at times after the epoch [s]; scalar last, unit, of a continuous sign, shape (n, 4)."""
        time, own = np.atleast_1d(np.asarray(time_s, dtype=np.float64)), self.nutation
        half = (
            2 * np.pi * turns(own.precession_rev_s / 2, time)
        )  # of the angle: the sign is continuous over whole turns
        return product(self.frame, product(_about_z(half), own.at(turns(own.rate_rev_s, time))))


@functools.lru_cache(maxsize=64)
def _nutation(moments: tuple[float, float, float], rates_deg_s: tuple[float, float, float]) -> Nutation:
    """Return the motion of a body in its precessing axes."""
    size = Fraction(2) ** math.frexp(max(moments))[1]  # a power of 2, by which no bit changes
    inertia, rate = [Fraction(value) / size for value in moments], [Fraction(value) for value in rates_deg_s]
    fastest = max(map(abs, rate))
    speed_rad_s = math.radians(float(fastest))
    if fastest:
        rate = [value / fastest for value in rate]
    if not any((inertia[i] - inertia[j]) * rate[i] * rate[j] for i, j in ((0, 1), (1, 2), (2, 0))):
        return _steady(np.array([float(value) for value in rate]), speed_rad_s)
    return _Jacobi.of(inertia, rate).nutation(speed_rad_s)


def _steady(rate: F64, speed_rad_s: float) -> Nutation:
    """A body that turns about an axis that is fixed in it, or not at all."""
    length = float(np.linalg.norm(rate))
    axis = rate / length if length else np.array([0.0, 0.0, 1.0])
    over = np.array([1.0, 0.0, 0.0, 0.0] if axis[2] < 0.0 else [0.0, 0.0, 0.0, 1.0])  # half a turn about x, or none
    still = product(_to_z(rotated(over, axis)), over)[None]
    return Nutation(length * speed_rad_s / (2 * np.pi), 0.0, still, np.zeros((1, 4)))


def _to_z(direction: F64) -> F64:
    """The shortest rotation that turns unit vectors (..., 3) to +z, from which they are less than half a turn."""
    x, y, z = np.moveaxis(direction, -1, 0)
    return unit(np.stack([y, -x, 0.0 * z, 1.0 + z], axis=-1))


@dataclass(frozen=True)
class _Jacobi:
    """The motion in axes 1, 2, 3: 2 that of the middle moment, 3 the one about which the turning keeps its sense.

    The rates are w1 cn, w2 sn and w3 dn of the time times `speed`; the unit of rates is the largest at the epoch.
    """

    basis: F64
    """Rows 1, 2, 3 in body axes, right-handed."""
    inertia: F64
    amplitude: F64
    """w1, w2, w3."""
    speed: float
    m1: float
    """Complement of the modulus, k'^2."""
    u0: float
    """Argument at the epoch."""

    @classmethod
    def of(cls, inertia: list[Fraction], rate: list[Fraction]) -> _Jacobi:
        """Find the constants of a motion that is not steady."""
        low, i2, high = sorted(range(3), key=lambda axis: inertia[axis])
        excess = sum((inertia[k] - inertia[i2]) * inertia[k] * rate[k] ** 2 for k in (low, high))  # L^2 - 2 E I2
        i1, i3 = (low, high) if excess >= 0 else (high, low)
        a, b, c = (inertia[k] for k in (i1, i2, i3))
        w1, w2, w3 = (rate[k] ** 2 for k in (i1, i2, i3))
        ratio = b * (b - c) / (a * (a - c))
        w1m, w3m = w1 + ratio * w2, w3 + b * (b - a) / (c * (c - a)) * w2
        m1 = max(excess / ((c - b) * c * w3m), NEAREST)
        basis = np.eye(3)[[i1, i2, i3]]
        if rate[i3] < 0:
            basis[[0, 2]] *= -1.0
        basis[1] *= np.linalg.det(basis)
        own = basis @ np.array([float(value) for value in rate])
        sine = float(own[1]) * (1.0 if c > b else -1.0)
        u0 = _first_kind(sine / math.sqrt(w2 + w1 / ratio), float(w1 / w1m), float(w3 / w3m), float(own[0]), float(m1))
        amplitude = np.sqrt([float(w1m), float(w2 + w1 / ratio), float(w3m)]) * [1.0, 1.0 if c > b else -1.0, 1.0]
        speed = math.sqrt((c - b) * (c - a) / (a * b) * w3m)
        return cls(basis, np.array([float(a), float(b), float(c)]), amplitude, speed, float(m1), u0)

    def nutation(self, speed_rad_s: float) -> Nutation:
        """Return the motion as nodes, as many as the error asks for; the unit of rates in rad/s is given."""
        quarter = _quarter_period(self.m1)
        rate_rev_s = self.speed * speed_rad_s / (4.0 * quarter)

        def with_nodes(n_node: int) -> Nutation:
            precession, *nodes = self._nodes(n_node, quarter)
            return Nutation(precession * speed_rad_s / (2 * np.pi), rate_rev_s, *nodes)

        n_node, found = 64, with_nodes(64)
        while n_node < MOST_NODES:
            n_node *= 2
            rough, found = found, with_nodes(n_node)
            off = np.linalg.norm(rough.at(np.arange(1, n_node, 2) / n_node) - found.quaternion[1::2], axis=-1).max()
            if off <= 8.0 * NODE_ERROR_RAD:  # halved steps are 16 times better; a rotation is twice its arc
                break
        return found

    def _nodes(self, n_node: int, quarter: float) -> tuple[float, F64, F64]:
        """Mean rate of precession, and rotations and their steps at n_node times of a period."""
        u = self.u0 + np.arange(n_node) * (4.0 * quarter / n_node)
        rate = self.amplitude * _elliptic(np.where(u > 2.0 * quarter, u - 4.0 * quarter, u), self.m1)
        momentum = rate * self.inertia
        length = np.linalg.norm(momentum, axis=-1, keepdims=True)
        momentum /= length
        # The turn about the momentum beyond the shortest rotation that takes it to z, and its rate.
        turning = (rate[:, 2] + np.sum(rate * momentum, axis=-1)) / (1.0 + momentum[:, 2])
        precession = float(turning.mean())
        wave = np.fft.rfft((turning - precession) / self.speed)
        wave[1:] /= 1j * np.arange(1, len(wave)) * (2 * np.pi / (4.0 * quarter))
        wave[0] = 0.0
        quaternion = product(_about_z(0.5 * np.fft.irfft(wave, n_node)), _to_z(momentum))
        turned = 0.5 * product(quaternion, _pure(rate)) - 0.5 * product(_pure(np.array([0, 0, precession])), quaternion)
        into = from_matrix(self.basis)
        return precession, product(quaternion, into), product(turned * (4.0 * quarter / n_node / self.speed), into)


def _about_z(half_rad: F64) -> F64:
    """Turns about z by twice the angles, (n, 4)."""
    zero = np.zeros(len(half_rad))
    return np.stack([zero, zero, np.sin(half_rad), np.cos(half_rad)], axis=-1)


def _pure(vector: F64) -> F64:
    """Vectors (..., 3) as quaternions without scalar."""
    return np.concatenate([vector, np.zeros((*vector.shape[:-1], 1))], axis=-1)


def _first_kind(sine: float, cosine2: float, delta2: float, cosine: float, m1: float) -> float:
    """Legendre's F at the amplitude with these functions, by Carlson's R_F, which loses no digits anywhere."""
    from scipy.special import elliprf

    value = sine * float(elliprf(cosine2, delta2, 1.0))
    return value if cosine >= 0.0 else math.copysign(2.0 * _quarter_period(m1), sine) - value


def _scale(m1: float) -> list[tuple[float, float, float]]:
    """Return the arithmetic-geometric mean's a, b, c, from (1, k', k) on."""
    a, b = 1.0, math.sqrt(m1)
    rows = [(a, b, math.sqrt(1.0 - m1))]
    while abs(rows[-1][2]) > 1e-8 * a:  # the next c is its square over 4 a
        a, b, c = 0.5 * (a + b), math.sqrt(a * b), 0.5 * (a - b)
        rows.append((a, b, c))
    return rows


def _quarter_period(m1: float) -> float:
    """Complete elliptic integral of the first kind, K."""
    return math.pi / (2.0 * _scale(m1)[-1][0])


def _elliptic(u: F64, m1: float) -> F64:
    """Jacobi's cn, sn and dn, (n, 3), by descending the scale (Abramowitz and Stegun 16.4).

    The arc sine of a step is taken by its cosine as well: next to the separatrix it is near a quarter turn.
    """
    rows = _scale(m1)
    angle = 2.0 ** (len(rows) - 1) * rows[-1][0] * u
    for a, b, c in rows[:0:-1]:
        sine, cosine = np.sin(angle), np.cos(angle)
        angle = 0.5 * (angle + np.arctan2(c * sine, np.hypot(b * sine, a * cosine)))
    cosine = np.cos(angle)
    return np.stack([cosine, np.sin(angle), np.sqrt(m1 + (1.0 - m1) * cosine**2)], axis=-1)
