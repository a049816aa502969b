"""Angles of the kernels against 30 digits, and against signs and corners that must come out exactly."""

import mpmath
import numpy as np
import pytest
import warp as wp
from warpsim_kernels.angles import angle_from_x, cosine_sine

SEED = 161803
EPSILON = np.finfo(np.float64).eps
COSINE_ATOL = 2 * EPSILON  # units in the last place of 1; measured 0.6
ANGLE_RTOL = 4 * EPSILON  # measured 1.3


@wp.kernel(enable_backward=False)
def cosine_sine_kernel(turns: wp.array[wp.float64], out: wp.array[wp.vec2d]):
    i = wp.tid()
    out[i] = cosine_sine(turns[i])


@wp.kernel(enable_backward=False)
def angle_kernel(y: wp.array[wp.float64], x: wp.array[wp.float64], out: wp.array[wp.float64]):
    i = wp.tid()
    out[i] = angle_from_x(y[i], x[i])


def launched(kernel, dtype, device, *values):
    inputs = [wp.array(value, dtype=wp.float64, device=device) for value in values]
    out = wp.empty(len(values[0]), dtype=dtype, device=device)
    wp.launch(kernel, len(values[0]), inputs=inputs, outputs=[out], device=device)
    return out.numpy()


def some_turns():
    """Everywhere, close to 0, and on both sides of the borders between eighths of a turn."""
    rng = np.random.default_rng(SEED)
    eighths = np.arange(-24, 25) / 8
    small = rng.uniform(-1, 1, 300) * 10.0 ** rng.uniform(-15, 0, 300)
    return np.concatenate([rng.uniform(-3, 3, 1500), small, *(eighths + step for step in (0, 1e-9, -1e-9, 3e-16))])


def test_cosine_and_sine_of_turns(device):
    turns = some_turns()
    seen = launched(cosine_sine_kernel, wp.vec2d, device, turns)
    with mpmath.workdps(30):
        angles = [2 * mpmath.pi * mpmath.mpf(float(turn)) for turn in turns]
        expected = np.array([[float(mpmath.cos(angle)), float(mpmath.sin(angle))] for angle in angles])
    np.testing.assert_allclose(seen, expected, rtol=0, atol=COSINE_ATOL)


def test_quarters_of_a_turn_are_exact(device):
    """Whole numbers of quarters, near 0 and as many as fit."""
    quarters = np.concatenate([np.arange(-40, 41), [2**30 + 1, -(2**30) - 3]])
    expected = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])[quarters % 4]
    np.testing.assert_array_equal(launched(cosine_sine_kernel, wp.vec2d, device, quarters / 4), expected)


def test_angles(device):
    """Of all sizes: from 1e-12 to pi less 1e-12, on axes' and bisectors' both sides, short and long."""
    rng = np.random.default_rng(SEED)
    near = rng.uniform(-1, 1, 500) * 10.0 ** rng.uniform(-12, -1, 500)
    angle = np.concatenate([rng.uniform(0, np.pi, 1500), *(k * np.pi / 8 + near for k in range(9))])
    angle = np.abs(angle)
    length = 10.0 ** rng.uniform(-100, 100, len(angle))
    y, x = np.abs(np.sin(angle)) * length, np.cos(angle) * length
    seen = launched(angle_kernel, wp.float64, device, y, x)
    with mpmath.workdps(30):
        expected = np.array([float(mpmath.atan2(float(a), float(b))) for a, b in zip(y, x, strict=True)])
    np.testing.assert_allclose(seen, expected, rtol=ANGLE_RTOL, atol=0)


@pytest.mark.parametrize(
    ("y", "x", "expected"),
    [(0.0, 1.0, 0.0), (0.0, -1.0, np.pi), (2.0, 0.0, np.pi / 2), (2.0, -0.0, np.pi / 2), (0.0, 0.0, 0.0),
     (3.0, 3.0, np.pi / 4), (3.0, -3.0, 3 * np.pi / 4)],
)  # fmt: skip
def test_angles_of_axes_are_exact(device, y, x, expected):
    assert launched(angle_kernel, wp.float64, device, [y], [x])[0] == expected
