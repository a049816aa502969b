"""The source paper's own arithmetic where it differs from the physics, so that its printed tables can be reproduced.

Nothing else in warpsim uses these numbers: `warpsim.BANDS` holds the physical zero points.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from warpsim.errors import InputError

NEI_W_CM2 = 1e-18
SEI_W_CM2 = 3e-15

MAGNITUDE_BASE = 2.512
"""The paper's rounded 100^(1/5)."""

ZERO_MAG_DYNAMIC_RANGE = {"A": 510.651, "B1": 444.097, "B2": 658.514, "C": 113.509, "D": 61.359, "E": 40.000}
"""First row of Table 2: irradiance of a star of magnitude 0 over the NEI."""


def dynamic_range(magnitude: ArrayLike, band: str) -> Any:
    """Signal of a star over the noise equivalent irradiance: Table 2 of the paper, as printed.

    D = min(SEI / NEI, D0 * 2.512^(0 - m)), with D0 the first row of the table, NEI = 1e-18 and SEI = 3e-15 W/cm2.
    37 of the 42 printed values come out to the last digit, the other five (A at magnitude 3, B1 at 5, B2 at 3, D at 5,
    E at 3) within one unit of it: 0.001.

    It keeps what the table was computed with, not what the paper writes:

    - Eq. 6 prints 10^((m0 - m) / 2.512); the table follows 2.512^(m0 - m). Pogson's law is 10^(0.4 (m0 - m)), base
      2.5119: 0.03 % away at magnitude 6.
    - D0 is F0 * c / lambda^2 * width / NEI with F0 and lambda of Table 1, c = 3e8 m/s and the jansky of 1e-26 W/m2/Hz
      (Eq. 2 prints 1e26). With the widths of Table 1 that gives B1, C and E to the last digit and D to 0.001. B2 needs
      0.22 um, where Table 1 has 4.24-4.45; A needs 1.995 um, half of the 6.8-10.8 um there.

    The physical figure is `BANDS[band].zero_mag_w_cm2 * 10**(-0.4 * magnitude) / nei_w_cm2`: 819.6 for band A at
    magnitude 0, where this returns 510.651.

    Args:
        magnitude: Infrared magnitude, any shape; NaN gives NaN.
        band: B1, B2, A, C, D or E.

    Returns:
        Dynamic range, dimensionless, shape of magnitude (a float for a single number).

    Raises:
        InputError: Unknown band, or magnitude is not numeric.
    """
    if not isinstance(band, str) or band not in ZERO_MAG_DYNAMIC_RANGE:
        raise InputError(f"band: must be one of {', '.join(ZERO_MAG_DYNAMIC_RANGE)}, got {band!r}")
    try:
        magnitudes = np.asarray(magnitude, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"magnitude must be numbers, got {type(magnitude).__name__}") from None
    with np.errstate(over="ignore"):  # an absurdly bright star saturates like any other
        in_nei = ZERO_MAG_DYNAMIC_RANGE[band] * MAGNITUDE_BASE**-magnitudes
    result = np.minimum(in_nei, SEI_W_CM2 / NEI_W_CM2)
    return result if magnitudes.ndim else float(result)
