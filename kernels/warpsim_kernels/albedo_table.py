"""Harmonics of the light that the ground reflects (albedo_series.py), from a table: rings are summed once for a scene.

What all harmonics depend on is the height above the ground and the Sun's zenith angle at the point below. The table
holds them over limb_sine^2, at even steps of limb_sine - limb_cosine from -1 to 1 and of the angle from 0 to 180 deg.
"""

import functools
import math

import warp as wp

from warpsim_kernels.albedo_series import albedo_series_of
from warpsim_kernels.angles import angle_from_x
from warpsim_kernels.earthlight import Rule, limb_cosine

_LEAST_LIMB_SINE = wp.constant(wp.float64(1.0e-3))
_QUARTER_PI = wp.constant(wp.float64(0.7853981633974483))
_PI = wp.constant(wp.float64(3.141592653589793))


@functools.cache
def table_harmonics_of(degree: int) -> wp.Function:
    """The function (table, limb_sine, sun_up, sun_across): harmonics up to a degree, as `AlbedoSeries.harmonics`."""
    Harmonics = albedo_series_of(degree).Harmonics
    n_kept = wp.types.type_size(Harmonics)

    @wp.func
    def table_harmonics(
        table: wp.array3d[wp.float64], limb_sine: wp.float64, sun_up: wp.float64, sun_across: wp.float64
    ) -> Harmonics:
        """Linear between the table's heights and between its zenith angles."""
        one = wp.float64(1.0)
        s = wp.min(limb_sine, one)
        height = wp.float64(0.5) * (one + s - limb_cosine(s)) * wp.float64(table.shape[0] - 1)
        zenith = angle_from_x(sun_across, sun_up) / _PI * wp.float64(table.shape[1] - 1)
        row = wp.clamp(int(height), 0, table.shape[0] - 2)
        column = wp.clamp(int(zenith), 0, table.shape[1] - 2)
        u = height - wp.float64(row)
        v = zenith - wp.float64(column)
        light = Harmonics()
        for i in range(n_kept):
            low = table[row, column, i] + (table[row, column + 1, i] - table[row, column, i]) * v
            high = table[row + 1, column, i] + (table[row + 1, column + 1, i] - table[row + 1, column, i]) * v
            light[i] = (low + (high - low) * u) * (s * s)
        return light

    return table_harmonics


@functools.cache
def make_albedo_table_kernel(degree: int) -> wp.Kernel:
    """Kernel that fills the table for a degree; the rule is that of the rings."""
    # Functions of its own: they hold wp.static of loop variables, and Warp's hash of such a function changes when it is
    # compiled. Kernels that share them would be cached under names that depend on which is compiled first.
    series = albedo_series_of.__wrapped__(degree)
    n_kept = wp.types.type_size(series.Harmonics)

    @wp.kernel(module="unique", enable_backward=False)
    def albedo_table_kernel(
        # in
        rule: Rule,
        # out
        table: wp.array3d[wp.float64],  # (n_height, n_zenith, n_harmonic)
    ):
        """Harmonics of one height and zenith angle."""
        row, column = wp.tid()
        height = wp.float64(2.0) * wp.float64(row) / wp.float64(table.shape[0] - 1) - wp.float64(1.0)
        limb_rad = _QUARTER_PI + wp.asin(height * wp.float64(wp.static(math.sqrt(0.5))))
        limb_sine = wp.clamp(wp.sin(limb_rad), _LEAST_LIMB_SINE, wp.float64(1.0))
        zenith_rad = _PI * wp.float64(column) / wp.float64(table.shape[1] - 1)
        light = series.harmonics(rule, limb_sine, wp.cos(zenith_rad), wp.abs(wp.sin(zenith_rad)))
        for i in range(n_kept):
            table[row, column, i] = light[i] / (limb_sine * limb_sine)

    return albedo_table_kernel
