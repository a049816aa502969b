"""Quadrature rules for streaks, and how long a streak each can serve."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from warpsim_kernels.streaks import NO_LIMIT, StreakRules

INF = float("inf")

STREAK_ERROR = 1e-6
"""Error of a streak's quadrature in time, per pixel, as a share of the source's light."""

# fmt: off
LONGEST_STREAK = {
    1: (12, 3.6, 1.8, 1, 0.56, 0.31, 0.17, 0.099, 0.056, 0.031, 0.017, 0.0099, 0.0056, 0.0031, 0.0017, 0.00099),
    2: (INF, 9.1, 4.88, 3.29, 2.35, 1.72, 1.27, 0.949, 0.709, 0.53, 0.397, 0.297, 0.223, 0.167, 0.125, 0.0941),
    3: (INF, 16.1, 7.97, 5.59, 4.25, 3.35, 2.69, 2.18, 1.78, 1.45, 1.19, 0.985, 0.811, 0.668, 0.551, 0.454),
    4: (INF, 30.6, 11.4, 7.9, 6.14, 4.99, 4.15, 3.49, 2.97, 2.53, 2.17, 1.86, 1.6, 1.38, 1.19, 1.03),
    6: (INF, 136, 19.6, 12.7, 9.94, 8.24, 7.05, 6.13, 5.4, 4.78, 4.26, 3.82, 3.43, 3.08, 2.78, 2.51),
    8: (INF, INF, 30.5, 18, 13.8, 11.5, 9.93, 8.75, 7.81, 7.04, 6.38, 5.82, 5.32, 4.88, 4.49, 4.14),
    12: (INF, INF, 66.2, 30, 22, 18.1, 15.7, 13.9, 12.5, 11.4, 10.5, 9.78, 9.09, 8.49, 7.95, 7.46),
    16: (INF, INF, 144, 44.3, 30.9, 25.1, 21.6, 19.1, 17.3, 15.8, 14.6, 13.6, 12.8, 12, 11.3, 10.7),
    24: (INF, INF, INF, 81.8, 50.8, 39.8, 33.8, 29.8, 26.9, 24.7, 22.9, 21.4, 20.1, 19, 18, 17.2),
    32: (INF, INF, INF, 137, 73.2, 55.5, 46.5, 40.8, 36.7, 33.6, 31.2, 29.1, 27.4, 26, 24.7, 23.6),
    48: (INF, INF, INF, 362, 126, 89.9, 73.5, 63.6, 56.9, 51.9, 48, 44.8, 42.2, 40, 38, 36.3),
    64: (INF, INF, INF, 1.23e+03, 192, 127, 102, 87.4, 77.7, 70.6, 65.1, 60.7, 57.1, 54.1, 51.4, 49.1),
    96: (INF, INF, INF, INF, 381, 212, 163, 137, 120, 109, 100, 93.2, 87.4, 82.6, 78.5, 75),
    128: (INF, INF, INF, INF, 702, 311, 229, 189, 165, 148, 136, 126, 118, 111, 106, 101),
    192: (INF, INF, INF, INF, 2.73e+03, 557, 375, 301, 259, 230, 210, 194, 181, 170, 161, 154),
    256: (INF, INF, INF, INF, INF, 883, 538, 420, 357, 315, 286, 263, 245, 230, 218, 207),
}
# fmt: on
"""Nodes of a Gauss-Legendre rule: longest streak, in sigmas of a Gaussian image, that it serves within an error of
10^-0.5, 10^-1 ... 10^-8. The mean over a straight streak of the light on one side of an edge is compared with the
integral, wherever the edge lies; tests/test_streaks.py does it again."""


def streak_rules(device: Any) -> Any:
    """The kernels' StreakRules on a device."""
    counts = list(LONGEST_STREAK)
    pairs = [np.polynomial.legendre.leggauss(count) for count in counts]
    longest = np.minimum(np.array([(np.inf, *LONGEST_STREAK[count]) for count in counts]).T, NO_LIMIT)
    rules: Any = StreakRules()
    rules.count = wp.array(counts, dtype=wp.int32, device=device)
    rules.first = wp.array(np.cumsum([0, *counts[:-1]]), dtype=wp.int32, device=device)
    rules.node = wp.array(np.concatenate([node for node, _ in pairs]), dtype=wp.float64, device=device)
    rules.weight = wp.array(np.concatenate([0.5 * weight for _, weight in pairs]), dtype=wp.float64, device=device)
    rules.longest = wp.array(longest, dtype=wp.float32, device=device)
    return rules
