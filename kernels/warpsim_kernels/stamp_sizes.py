"""Half-widths of stamps, for the search of sources that touch an image."""

import warp as wp

from warpsim_kernels.deposit_gaussian import GaussianPsf
from warpsim_kernels.psf import TablePsf, gaussian_reach_px, table_reach_px
from warpsim_kernels.stamps import StampRule, stamp_cut


@wp.func
def half_width_of(reach_px: float, aspect: float) -> int:
    """Pixels that a source may lie outside an image, in columns or rows, and still touch it."""
    return int(wp.ceil(reach_px / wp.min(aspect, 1.0)))


@wp.kernel(enable_backward=False)
def size_gaussian_stamps_kernel(
    # in
    irradiance_w_cm2: wp.array2d[float],  # (n_band, n_source)
    psfs: wp.array[GaussianPsf],  # (n_band,)
    rule: StampRule,
    # out
    half_width_px: wp.array2d[wp.int32],  # (n_band, n_source)
):
    """Half-widths of Gaussian stamps."""
    band, source = wp.tid()
    sigma = psfs[band].sigma_px
    reach_px = gaussian_reach_px(sigma, stamp_cut(irradiance_w_cm2[band, source], band, rule))
    half_width_px[band, source] = half_width_of(reach_px, sigma[0] / sigma[1])


@wp.kernel(enable_backward=False)
def size_table_stamps_kernel(
    # in
    irradiance_w_cm2: wp.array2d[float],  # (n_band, n_source)
    psfs: wp.array[TablePsf],  # (n_band,)
    table: wp.array[float],  # pixel fractions and envelopes of all bands, flat
    rule: StampRule,
    # out
    half_width_px: wp.array2d[wp.int32],  # (n_band, n_source)
):
    """Half-widths of tabulated stamps."""
    band, source = wp.tid()
    psf = psfs[band]
    reach_px = table_reach_px(table, psf, stamp_cut(irradiance_w_cm2[band, source], band, rule))
    half_width_px[band, source] = half_width_of(reach_px, psf.pixel_aspect)
