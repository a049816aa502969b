"""Point spread functions on a device: one per band, with the launches that use them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import warp as wp
from warpsim_kernels import deposit as kernels

from warpsim.optics.psf import Psf, PsfGaussian, check_one_family
from warpsim.optics.table_upload import upload_tables
from warpsim.optics.tables import TableAccuracy, TabulatedPsf, cheapest_points, share_table

SMALLEST_STAMP_CUT = 1e-11
"""Stamps never grow beyond where a pixel holds this fraction of a source's light."""


class PsfBank(Protocol):
    """The point spread functions of all bands, all of one family."""

    def deposit(self, sources: list[wp.array], rule: Any, n_row_per_block: int, signal_w_cm2: wp.array, paths: Any = None) -> None:
        """Overwrite signal, shape (n_view, n_band, n_row, n_col), with the light of all sources.

        Args:
            sources: n_source (n_view,), xy_px (n_view, n_slot), irradiance_w_cm2 (n_view, n_band, n_slot).
            rule: StampRule.
            n_row_per_block: Rows that one thread owns.
            signal_w_cm2: Written.
        """

    def size_stamps(self, irradiance_w_cm2: wp.array, rule: Any, half_width_px: wp.array) -> None:
        """Half-width of the stamp of each source; both arrays (n_band, n_source)."""

    def measure_stamps(self, sources: list[wp.array], rule: Any, outputs: list[wp.array]) -> None:
        """Shares of a source's light in its own pixel and in its whole stamp, for the first sources of each view.

        Args:
            sources: xy_px (n_view, n_slot), irradiance_w_cm2 (n_view, n_band, n_slot).
            rule: StampRule.
            outputs: peak_share, stamp_share, each (n_view, n_band, n_source).
        """


class GaussianBank:
    """Gaussians."""

    def __init__(self, psfs: Sequence[PsfGaussian], device: Any) -> None:
        self._sigma_px = wp.array([psf.sigma_px for psf in psfs], dtype=wp.float32, device=device)
        # The kernel's own rule for the half-width, at the smallest cut there is (a hair wider, for float32); in a few
        # sizes, so that few kernels are compiled.
        reach = np.sqrt(-2 * np.log(2 * SMALLEST_STAMP_CUT)) * 1.001
        widest = 2 * int(np.ceil(reach * max(psf.sigma_px for psf in psfs))) + 1
        self._kernel = kernels.make_deposit_gaussian_kernel(max(16, 1 << (widest - 1).bit_length()))

    def deposit(self, sources: list[wp.array], rule: Any, n_row_per_block: int, signal_w_cm2: wp.array, paths: Any = None) -> None:
        """See PsfBank."""
        _launch_deposit(self._kernel, [*sources, self._sigma_px], rule, n_row_per_block, signal_w_cm2)

    def size_stamps(self, irradiance_w_cm2: wp.array, rule: Any, half_width_px: wp.array) -> None:
        """See PsfBank."""
        inputs = [irradiance_w_cm2, self._sigma_px, rule]
        kernel = kernels.size_gaussian_stamps_kernel
        wp.launch(kernel, half_width_px.shape, inputs, [half_width_px], device=half_width_px.device)

    def measure_stamps(self, sources: list[wp.array], rule: Any, outputs: list[wp.array]) -> None:
        """See PsfBank."""
        inputs = [*sources, self._sigma_px, rule]
        wp.launch(kernels.gaussian_stamp_kernel, outputs[0].shape, inputs, outputs, device=outputs[0].device)


class TableBank:
    """Patterns as tables of pixel shares."""

    def __init__(
        self, psfs: Sequence[TabulatedPsf], device: Any, pixel_aspect: float, accuracy: TableAccuracy
    ) -> None:
        n_point = accuracy.n_point or cheapest_points(psfs, pixel_aspect, accuracy.error)
        tables = [share_table(psf, pixel_aspect, accuracy.error, n_point) for psf in psfs]
        self._psf, self._table = upload_tables(tables, device)
        self._n_point = n_point

    def deposit(self, sources: list[wp.array], rule: Any, n_row_per_block: int, signal_w_cm2: wp.array, paths: Any = None) -> None:
        """See PsfBank."""
        inputs = [*sources, self._psf, self._table]
        _launch_deposit(kernels.make_deposit_table_kernel(self._n_point), inputs, rule, n_row_per_block, signal_w_cm2)

    def size_stamps(self, irradiance_w_cm2: wp.array, rule: Any, half_width_px: wp.array) -> None:
        """See PsfBank."""
        inputs = [irradiance_w_cm2, self._psf, self._table, rule]
        kernel = kernels.size_table_stamps_kernel
        wp.launch(kernel, half_width_px.shape, inputs, [half_width_px], device=half_width_px.device)

    def measure_stamps(self, sources: list[wp.array], rule: Any, outputs: list[wp.array]) -> None:
        """See PsfBank."""
        inputs = [*sources, self._psf, self._table, rule]
        kernel = kernels.make_table_stamp_kernel(self._n_point)
        wp.launch(kernel, outputs[0].shape, inputs, outputs, device=outputs[0].device)


def psf_bank(
    psfs: Sequence[Psf], device: Any, pixel_aspect: float = 1.0, accuracy: TableAccuracy | None = None
) -> PsfBank:
    """Upload the point spread functions of all bands.

    Args:
        psfs: One for each band.
        device: Where they are used.
        pixel_aspect: Height of a pixel over its width.
        accuracy: Of tables.

    Raises:
        InputError: Gaussians and others mix, or a table would be too large.
    """
    check_one_family(psfs)
    gaussians = [psf for psf in psfs if isinstance(psf, PsfGaussian)]
    if gaussians:
        return GaussianBank(gaussians, device)
    tabulated = [psf for psf in psfs if not isinstance(psf, PsfGaussian)]
    return TableBank(tabulated, device, pixel_aspect, accuracy or TableAccuracy())


def stamp_rule(cut_w_cm2: float, cut_share: float) -> Any:
    """The kernels' StampRule: what a source may leave out per pixel, absolute and relative."""
    rule: Any = kernels.StampRule()
    rule.cut_w_cm2 = cut_w_cm2
    rule.cut_share = max(cut_share, SMALLEST_STAMP_CUT)
    return rule


def _launch_deposit(kernel: wp.Kernel, inputs: list[Any], rule: Any, n_row_per_block: int, signal: wp.array) -> None:
    n_view, n_band, n_row, _ = signal.shape
    n_block = -(-n_row // n_row_per_block)
    signal.zero_()
    wp.launch(kernel, (n_view, n_band, n_block), [*inputs, rule, n_row_per_block], [signal], device=signal.device)
