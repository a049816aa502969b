"""The source paper's own arithmetic where it differs from the physics, so that its printed tables can be reproduced.

`warpsim.PHYSICS["paper"]` holds its numbers, `warpsim.PHYSICS["physical"]` the right ones.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from warpsim.errors import InputError
from warpsim.radiometry.magnitudes import NEI_W_CM2 as NEI_W_CM2
from warpsim.radiometry.magnitudes import PHYSICS
from warpsim.radiometry.magnitudes import SEI_W_CM2 as SEI_W_CM2

_PAPER = PHYSICS["paper"]

MAGNITUDE_BASE = _PAPER.magnitude_base
"""The paper's rounded 100^(1/5)."""

ZERO_MAG_DYNAMIC_RANGE = {name: zero.zero_mag_w_cm2 / NEI_W_CM2 for name, zero in _PAPER.zero_points.items()}
"""First row of Table 2: irradiance of a star of magnitude 0 over the NEI."""


def dynamic_range(magnitude: ArrayLike, band: str) -> Any:
    """Signal of a star over the noise equivalent irradiance: Table 2 of the paper, as printed.

    D = min(SEI / NEI, D0 * 2.512^(0 - m)), with D0 the first row of the table, NEI = 1e-18 and SEI = 3e-15 W/cm2.
    37 of the 42 printed values come out to the last digit, the other five within one unit of it, 0.001:

        A at 3     32.2155, printed 32.215
        B1 at 5     4.4400, printed  4.439
        B2 at 3    41.5438, printed 41.543
        D at 5      0.6135, printed  0.614
        E at 3      2.5235, printed  2.524

    E at 3 is the first row's own rounding: from Table 1 it is 40.00039, not 40.000. The other four follow no common
    rule. In the row of magnitude 5, no divisor of the first row, with any one threshold of rounding, gives B1 4.439,
    B2 6.584 and D 0.614 together; and of 5,700 procedures tried (other bases; factors, flux densities or successive
    steps rounded or cut to some number of digits; any first row within 0.001) none gives more than 39 values.

    It keeps what the table was computed with, not what the paper writes:

    - Eq. 6 prints 10^((m0 - m) / 2.512); the table follows 2.512^(m0 - m). Pogson's law is 10^(0.4 (m0 - m)), base
      2.5119: 0.03 % away at magnitude 6.
    - D0 is F0 * c / lambda^2 * width / NEI with F0 and lambda of Table 1, c = 3e8 m/s and the jansky of 1e-26 W/m2/Hz
      (Eq. 2 prints 1e26). With the widths of Table 1 that gives B1, C and E to the last digit and D to 0.001. B2
      needs 4.25 um where Table 1 has 4.35 um (to 0.001), or else a width of 0.22 um instead of 0.21 (to 0.004); A
      needs a width of 1.9952 um, about half of the 6.8-10.8 um there.

    The physical figure is `warpsim.PHYSICS["physical"].dynamic_range(magnitude, band)`: 819.6 for band A at magnitude
    0, where this returns 510.651.

    Args:
        magnitude: Infrared magnitude, any shape; NaN gives NaN.
        band: B1, B2, A, C, D or E.

    Returns:
        Dynamic range, dimensionless, shape of magnitude (a float for a single number).

    Raises:
        InputError: Unknown band, or magnitude is not numeric.
    """
    if not isinstance(band, str):
        raise InputError(f"must be one of {', '.join(ZERO_MAG_DYNAMIC_RANGE)}", "band", band)
    return _PAPER.dynamic_range(magnitude, band)
