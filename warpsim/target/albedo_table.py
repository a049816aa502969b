"""Table of Earth albedo by height and the Sun's zenith angle, on a device."""

from __future__ import annotations

from typing import Any

from warpsim.target.earth_radiation import rule_struct

N_HEIGHT = 97
N_ZENITH = 193
"""Being linear between them costs 1e-3 of the largest light that a body can have at its height, below 100 km with the
Sun on the horizon, and mostly less than 1e-4: the errors of the series still hold."""


def albedo_table(degree: int, n_node: int, device: Any = None) -> Any:
    """Harmonics up to an even degree, (N_HEIGHT, N_ZENITH, n_harmonic); an empty array for degree 0.

    Args:
        degree: Of the series, see `earth_radiation.SERIES_ERRORS`.
        n_node: Of the rule over rings of the ground, see `earth_radiation.SERIES_RINGS`.
        device: Where to; Warp's default if left out.
    """
    import warp as wp
    from warpsim_kernels.albedo_series import albedo_series_of
    from warpsim_kernels.albedo_table import make_albedo_table_kernel

    if degree == 0:
        return wp.empty((0, 0, 0), dtype=wp.float64, device=device)
    n_harmonic = wp.types.type_size(albedo_series_of(degree).Harmonics)
    table = wp.empty((N_HEIGHT, N_ZENITH, n_harmonic), dtype=wp.float64, device=device)
    kernel = make_albedo_table_kernel(degree)
    wp.launch(kernel, (N_HEIGHT, N_ZENITH), inputs=[rule_struct(n_node, device)], outputs=[table], device=device)
    return table
