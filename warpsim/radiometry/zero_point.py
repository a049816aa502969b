"""Zero points of bands: each number follows from the others, and none contradicts them."""

from __future__ import annotations

import math
from collections.abc import Mapping

from warpsim.errors import InputError

ZERO_POINT = ("zero_mag_jy", "zero_mag_w_cm2", "w_cm2_per_jy")
"""Flux density and in-band irradiance of magnitude 0 [Jy] and [W/cm2], and their ratio [W/cm2 per Jy]."""

ZERO_POINT_RTOL = 0.01
"""How far given numbers may contradict each other: published ones are rounded, those of MSX by 0.4 %."""


def complete_zero_point(given: Mapping[str, float], flat_w_cm2_per_jy: float) -> dict[str, float]:
    """Return the numbers of a zero point, those that are left out from the others; NaN where none is known.

    Args:
        given: By name of ZERO_POINT; NaN for what is left out.
        flat_w_cm2_per_jy: Their ratio for a spectrum flat in frequency, taken where it does not follow.

    Raises:
        InputError: A number is not above 0 and finite, or two of them contradict the third.
    """
    for name in ZERO_POINT:
        if not (math.isnan(given[name]) or 0.0 < given[name] < math.inf):
            raise InputError("must be > 0 and finite, or NaN", name, given[name])
    jy, w_cm2, per_jy = (given[name] for name in ZERO_POINT)
    if math.isnan(jy) and math.isnan(w_cm2):
        return {name: given[name] for name in ZERO_POINT}
    if math.isnan(per_jy):
        per_jy = flat_w_cm2_per_jy if math.isnan(jy) or math.isnan(w_cm2) else w_cm2 / jy
    jy, w_cm2 = (w_cm2 / per_jy if math.isnan(jy) else jy), (jy * per_jy if math.isnan(w_cm2) else w_cm2)
    if abs(w_cm2 / (jy * per_jy) - 1.0) > ZERO_POINT_RTOL:
        rule = f"must be zero_mag_jy times w_cm2_per_jy, {jy * per_jy:.4g}, within 1 %; leave out one of them"
        raise InputError(rule, "zero_mag_w_cm2", w_cm2)
    return dict(zip(ZERO_POINT, (jy, w_cm2, per_jy), strict=True))
