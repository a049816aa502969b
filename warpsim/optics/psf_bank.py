"""Point spread functions on a device: one per band, with the launches that use them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import warp as wp
from warpsim_kernels.deposit_gaussian import make_deposit_gaussian_kernel
from warpsim_kernels.deposit_table import make_deposit_table_kernel
from warpsim_kernels.paths import Paths
from warpsim_kernels.psf import TablePsf, table_functions
from warpsim_kernels.stamp_light import make_gaussian_light_kernel, make_table_light_kernel
from warpsim_kernels.stamp_sizes import size_gaussian_stamps_kernel, size_table_stamps_kernel
from warpsim_kernels.stamps import StampRule
from warpsim_kernels.streaks import Blur

from warpsim.errors import InputError
from warpsim.optics.airy import FIRST_DARK_RING, N_MARGIN, build_airy_table
from warpsim.optics.psf import Psf, PsfAiry, PsfGaussian
from warpsim.optics.streak_rules import STREAK_ERROR, streak_rules
from warpsim.optics.transfer import airy_blur_lamf

SMALLEST_STAMP_CUT = 1e-15
"""Stamps never grow beyond where a pixel holds this fraction of a source's light."""

N_POINT = 6
"""Points per axis of the interpolation in tables."""


class PsfBank(Protocol):
    """The point spread functions of all bands, all of one family."""

    def deposit(
        self, sources: list[wp.array], rule: Any, n_row_per_block: int, signal_w_cm2: wp.array, paths: Any = None
    ) -> None:
        """Overwrite signal, shape (n_view, n_band, n_row, n_col), with the light of all sources.

        Args:
            sources: n_source (n_view,), xy_px (n_view, n_slot), irradiance_w_cm2 (n_view, n_band, n_slot).
            rule: StampRule.
            n_row_per_block: Rows that one thread owns.
            signal_w_cm2: Written.
            paths: The kernels' Paths, how sources move and change during the exposure; None: they do not.
        """

    def size_stamps(self, irradiance_w_cm2: wp.array, rule: Any, half_width_px: wp.array) -> None:
        """Half-width of the stamp of each source; both arrays (n_band, n_source)."""

    def measure_stamps(self, sources: list[wp.array], rule: Any, outputs: list[wp.array], paths: Any = None) -> None:
        """Shares of a source's light in its own pixel and in its whole stamp, for the first sources of each view.

        With paths, the own pixel is that of the middle of the exposure, and shares are means over the exposure.

        Args:
            sources: xy_px (n_view, n_slot), irradiance_w_cm2 (n_view, n_band, n_slot).
            rule: StampRule.
            outputs: peak_share, stamp_share, each (n_view, n_band, n_source).
            paths: As in deposit.
        """


class GaussianBank:
    """Gaussians.

    Args:
        psfs: One for each band.
        device: Where they are put.
        pixel_aspect: Height of a pixel over its width; sigma counts in widths.
    """

    def __init__(self, psfs: Sequence[PsfGaussian], device: Any, pixel_aspect: float = 1.0) -> None:
        sigma_px = [(psf.sigma_px, psf.sigma_px / pixel_aspect) for psf in psfs]
        self._sigma_px = wp.array(sigma_px, dtype=wp.vec2, device=device)
        self._rules = streak_rules(device)

    def deposit(
        self, sources: list[wp.array], rule: Any, n_row_per_block: int, signal_w_cm2: wp.array, paths: Any = None
    ) -> None:
        """See PsfBank."""
        kernel = make_deposit_gaussian_kernel(paths is not None)
        inputs = [*sources, self._sigma_px, rule, Paths() if paths is None else paths, self._rules]
        _launch_deposit(kernel, inputs, n_row_per_block, signal_w_cm2)

    def size_stamps(self, irradiance_w_cm2: wp.array, rule: Any, half_width_px: wp.array) -> None:
        """See PsfBank."""
        _launch(size_gaussian_stamps_kernel, [irradiance_w_cm2, self._sigma_px, rule], [half_width_px])

    def measure_stamps(self, sources: list[wp.array], rule: Any, outputs: list[wp.array], paths: Any = None) -> None:
        """See PsfBank."""
        kernel = make_gaussian_light_kernel(paths is not None)
        _launch(kernel, [*sources, self._sigma_px, rule, Paths() if paths is None else paths, self._rules], outputs)


class AiryBank:
    """Airy patterns, as tables of pixel shares."""

    def __init__(self, psfs: Sequence[PsfAiry], device: Any) -> None:
        tables = [build_airy_table(psf.radius_px, psf.obscuration) for psf in psfs]
        n_lane = table_functions(N_POINT).n_lane
        flat = [part for t in tables for part in (t.share.ravel(), t.envelope)]
        self._table = wp.array(np.concatenate([*flat, np.zeros(n_lane)]), dtype=wp.float32, device=device)
        # The same memory once more, with a vector from every float on: six neighbours in one load.
        self._lanes = wp.array(
            ptr=self._table.ptr,
            dtype=wp.types.vector(length=n_lane, dtype=wp.float32),
            shape=(self._table.size - n_lane + 1,),
            strides=(4,),
            device=device,
        )
        structs, start = [], 0
        for table in tables:
            struct: Any = TablePsf()
            struct.start = start
            struct.n_column = struct.n_row = len(table.share)
            struct.column_per_px = struct.row_per_px = table.nodes_per_px
            struct.zero_column = struct.zero_row = N_MARGIN
            struct.mirrored = 1
            struct.reach_column_px = struct.reach_row_px = table.reach_px
            struct.pixel_aspect = 1.0
            struct.wing_px3 = table.wing_px3
            struct.wing_next_px2 = 0.375
            struct.envelope = start + table.share.size
            struct.n_envelope = len(table.envelope)
            struct.tail_px3 = table.tail_bound_px3
            structs.append(struct)
            start += table.share.size + len(table.envelope)
        self._psf = wp.array(structs, dtype=TablePsf, device=device)
        self._blur = wp.array([_blur(psf) for psf in psfs], dtype=Blur, device=device)
        self._rules = streak_rules(device)

    def deposit(
        self, sources: list[wp.array], rule: Any, n_row_per_block: int, signal_w_cm2: wp.array, paths: Any = None
    ) -> None:
        """See PsfBank."""
        kernel = make_deposit_table_kernel(N_POINT, paths is not None)
        _launch_deposit(kernel, self._inputs(sources, rule, paths), n_row_per_block, signal_w_cm2)

    def size_stamps(self, irradiance_w_cm2: wp.array, rule: Any, half_width_px: wp.array) -> None:
        """See PsfBank."""
        _launch(size_table_stamps_kernel, [irradiance_w_cm2, self._psf, self._table, rule], [half_width_px])

    def measure_stamps(self, sources: list[wp.array], rule: Any, outputs: list[wp.array], paths: Any = None) -> None:
        """See PsfBank."""
        kernel = make_table_light_kernel(N_POINT, paths is not None)
        _launch(kernel, self._inputs(sources, rule, paths), outputs)

    def _inputs(self, sources: list[wp.array], rule: Any, paths: Any) -> list[Any]:
        tables = [self._psf, self._blur, self._table, self._lanes]
        return [*sources, *tables, rule, Paths() if paths is None else paths, self._rules]


def _blur(psf: PsfAiry) -> Any:
    lamf_px = psf.radius_px / FIRST_DARK_RING
    blur: Any = Blur()
    blur.width_px = airy_blur_lamf(psf.obscuration) * lamf_px
    blur.band_limit_per_px = 1.0 / lamf_px
    blur.aspect = 1.0
    return blur


def psf_bank(psfs: Sequence[Psf], device: Any) -> PsfBank:
    """Upload the point spread functions of all bands.

    Raises:
        InputError: The bands mix families.
    """
    if all(isinstance(psf, PsfGaussian) for psf in psfs):
        return GaussianBank([psf for psf in psfs if isinstance(psf, PsfGaussian)], device)
    if all(isinstance(psf, PsfAiry) for psf in psfs):
        return AiryBank([psf for psf in psfs if isinstance(psf, PsfAiry)], device)
    raise InputError(f"psf: must be of one family in all bands, got {', '.join(psf.kind for psf in psfs)}")


def stamp_rule(
    cut_w_cm2: Sequence[float], cut_share: float, device: Any, streak_error: float = STREAK_ERROR
) -> Any:
    """The kernels' StampRule on a device.

    Args:
        cut_w_cm2: What a source may leave out per pixel in each band [W/cm2].
        cut_share: The same as a share of its light; the larger of the two holds.
        device: Where the rule is put.
        streak_error: Error of a streak's quadrature in time per pixel, as a share of a source's light; where the stamp
            may leave out more, it may err by as much.
    """
    rule: Any = StampRule()
    rule.cut_w_cm2 = wp.array(cut_w_cm2, dtype=wp.float32, device=device)
    rule.cut_share = max(cut_share, SMALLEST_STAMP_CUT)
    rule.streak_error = streak_error
    return rule


def _launch_deposit(kernel: wp.Kernel, inputs: list[Any], n_row_per_block: int, signal: wp.array) -> None:
    n_view, n_band, n_row, _ = signal.shape
    n_block = -(-n_row // n_row_per_block)
    signal.zero_()
    wp.launch(kernel, (n_view, n_band, n_block), [*inputs, n_row_per_block], [signal], device=signal.device)


def _launch(kernel: wp.Kernel, inputs: list[Any], outputs: list[wp.array]) -> None:
    wp.launch(kernel, outputs[0].shape, inputs, outputs, device=outputs[0].device)
