"""Point spread functions on a device, with the launches that use them, and the rule of their stamps."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import warp as wp
from warpsim_kernels.canvas import canvas_functions, n_flag
from warpsim_kernels.deposit_gaussian import GAUSSIAN_SIMD_WIDTH, GaussianTables, make_deposit_gaussian_kernel
from warpsim_kernels.deposit_table import make_deposit_table_kernel, pattern_tables
from warpsim_kernels.psf_cells import layout_functions
from warpsim_kernels.records import Sources
from warpsim_kernels.resolution import make_blend_kernel
from warpsim_kernels.spots import SpotFunctions, gaussian_spots, table_spots
from warpsim_kernels.stamp_light import (
    LightFunctions,
    gaussian_light,
    make_light_kernel,
    table_light,
)
from warpsim_kernels.stamp_sizes import size_gaussian_stamps_kernel, size_table_stamps_kernel
from warpsim_kernels.stamps import StampRule
from warpsim_kernels.streaks import Blur, Paths, StreakRules
from warpsim_kernels.table_layout import TABLE_SIMD_WIDTH, TableLayout

from warpsim.launches import Launch
from warpsim.optics.psf import Psf, PsfGaussian, check_one_family
from warpsim.optics.streak_rules import STREAK_ERROR, sharpness, streak_rules
from warpsim.optics.table_upload import overlapping, upload_gaussians, upload_tables
from warpsim.optics.tables import TableAccuracy, TabulatedPsf, drawn_tables

SMALLEST_STAMP_CUT = 1e-15
"""Stamps never grow beyond where a pixel holds this fraction of a source's light."""


class PsfBank:
    """The point spread functions of all bands on a device, and the launches that use them.

    Args:
        psfs: One for each band, all of one family.
        device: Where they are put.
        pixel_aspect: Height of a pixel over its width; lengths of the functions count in widths.
        accuracy: Of the tables of patterns.

    Raises:
        InputError: Gaussians and others mix, or a table would be too large.
    """

    def __init__(
        self, psfs: Sequence[Psf], device: Any, pixel_aspect: float = 1.0, accuracy: TableAccuracy | None = None
    ) -> None:
        check_one_family(psfs)
        patterns = [psf for psf in psfs if not isinstance(psf, PsfGaussian)]
        self._layout: TableLayout | None = None  # None: Gaussians
        if patterns:
            self._layout, tables = drawn_tables(patterns, pixel_aspect, accuracy or TableAccuracy())
            self._psf, self._floats = upload_tables(tables, device)
            self._blur = wp.array([_blur(psf, pixel_aspect) for psf in patterns], dtype=Blur, device=device)
        else:
            gaussians = [psf for psf in psfs if isinstance(psf, PsfGaussian)]
            sigma_px = [(psf.sigma_px, psf.sigma_px / pixel_aspect) for psf in gaussians]
            self._psf, self._floats = upload_gaussians(sigma_px, device)

    @property
    def tables(self) -> Any:
        """The kernels' struct of the functions of all bands."""
        tables: Any
        if self._layout is None:
            tables = GaussianTables()
            tables.psfs, tables.fractions = self._psf, overlapping(self._floats, GAUSSIAN_SIMD_WIDTH)
            return tables
        tables = pattern_tables(self._layout)()
        tables.psfs, tables.blurs, tables.table = self._psf, self._blur, self._floats
        tables.nodes = overlapping(self._floats, len(layout_functions(self._layout).Nodes()))
        return tables

    @property
    def spots(self) -> SpotFunctions:
        """The kernels' functions that draw single pixels from those tables."""
        return gaussian_spots() if self._layout is None else table_spots(self._layout)

    def deposit_kernel(self, moving: bool) -> wp.Kernel:
        """Return the kernel that `deposit` launches, with or without movement during the exposure."""
        if self._layout is None:
            return make_deposit_gaussian_kernel(moving)
        return make_deposit_table_kernel(self._layout, moving)

    def deposit(
        self,
        sources: Sequence[wp.array],
        rule: Any,
        n_row_per_block: int,
        signal_w_cm2: wp.array,
        paths: Any = None,
        touched: wp.array | None = None,
    ) -> Launch:
        """Return the launch that adds the light of all sources to signal, shape (n_view, n_band, n_row, n_col).

        Args:
            sources: n_source (n_view,), xy_px (n_view, n_slot), irradiance_w_cm2 (n_view, n_band, n_slot).
            rule: StampRule.
            n_row_per_block: Rows that one thread owns.
            signal_w_cm2: Added to.
            paths: The kernels' Paths, how sources move and change during the exposure; None: they do not.
            touched: Flags, shape (n_view, n_band, n_flag), of strips: set to 1 where light was added.
        """
        n_view, n_band, n_row, n_col = signal_w_cm2.shape
        device = signal_w_cm2.device
        if touched is None:
            touched = wp.empty((n_view, n_band, n_flag(n_row * n_col)), dtype=wp.uint8, device=device)
        images = _images(signal_w_cm2, GAUSSIAN_SIMD_WIDTH if self._layout is None else TABLE_SIMD_WIDTH)
        images.n_row_per_block = n_row_per_block
        images.touched = touched.flatten()
        inputs = [_lists(sources), self.tables, rule, *_movement(paths, device)]
        dim = (n_view, n_band, -(-n_row // n_row_per_block))
        return Launch(self.deposit_kernel(paths is not None), dim, inputs, [images], device)

    def gather(
        self,
        sources: Sequence[wp.array],
        rule: Any,
        cotangent: wp.array,
        outputs: Sequence[wp.array],
        paths: Any = None,
        with_sigma: bool = False,
    ) -> Launch:
        """Return the launch of the adjoint of `deposit`: gradients by each source, for a cotangent of its images.

        Args:
            sources: As in deposit.
            rule: As in deposit.
            cotangent: Derivatives of a number by the pixels, float32, (n_view, n_band, n_row, n_col).
            outputs: Gradients by light, x, y and sigma, (n_view, n_band, n_slot), vec4d; by the coefficients of paths,
                (n_view, n_band, n_slot, n_path), vec2d, 0 before.
            paths: As in deposit.
            with_sigma: Whether sigma is asked for; it is 0 otherwise, and of patterns.
        """
        from warpsim_kernels.image_gradient import make_gather_kernel  # here: who only renders does not wait for it

        kernel = make_gather_kernel(self._light, self._stamps(with_sigma), paths is not None, self._layout is not None)
        images, device = _images(cotangent, TABLE_SIMD_WIDTH), cotangent.device
        inputs = [_lists(sources), self.tables, rule, *_movement(paths, device), images]
        return Launch(kernel, outputs[0].shape, inputs, outputs, device)

    def jacobian(
        self, sources: Sequence[wp.array], rule: Any, windows: Sequence[Any], values: wp.array, paths: Any = None
    ) -> Launch:
        """Return the launch that draws each source's fractions and their derivatives on a window of its own.

        Args:
            sources: As in deposit.
            rule: As in deposit.
            windows: The kernel's item, windows and first, (n_item,) each, and columns and rows of an image.
            values: By light, x, y and sigma, vec4d, of the pixels of all windows; 0 before.
            paths: As in deposit.
        """
        from warpsim_kernels.image_gradient import make_jacobian_kernel

        is_pattern = self._layout is not None
        kernel = make_jacobian_kernel(self._light, self._stamps(with_sigma=True), paths is not None, is_pattern)
        inputs = [_lists(sources), self.tables, rule, *_movement(paths, values.device), *windows]
        return Launch(kernel, windows[0].shape, inputs, [values], values.device)

    def _stamps(self, with_sigma: bool) -> Any:
        """The kernels' functions of stamps whose derivatives are asked for."""
        from warpsim_kernels.stamp_gradient import gaussian_stamps, table_stamps

        return gaussian_stamps(with_sigma) if self._layout is None else table_stamps(self._layout)

    def size_stamps(self, irradiance_w_cm2: wp.array, rule: Any, half_width_px: wp.array) -> None:
        """Half-width of the stamp of each source; both arrays (n_band, n_source)."""
        if self._layout is None:
            _launch(size_gaussian_stamps_kernel, [irradiance_w_cm2, self._psf, rule], [half_width_px])
        else:
            _launch(size_table_stamps_kernel, [irradiance_w_cm2, self._psf, self._floats, rule], [half_width_px])

    def measure_stamps(self, sources: list[wp.array], rule: Any, outputs: list[wp.array], paths: Any = None) -> None:
        """Fractions of a source's light in its own pixel and in its whole stamp, for the first sources of each view.

        With paths, the own pixel is that of the middle of the exposure, and fractions are means over the exposure.

        Args:
            sources: xy_px (n_view, n_slot), irradiance_w_cm2 (n_view, n_band, n_slot).
            rule: StampRule.
            outputs: peak_fraction, total_fraction, each (n_view, n_band, n_source).
            paths: As in deposit.
        """
        inputs = [*sources, self.tables, rule, *_movement(paths, outputs[0].device)]
        _launch(make_light_kernel(self._light, paths is not None), inputs, outputs)

    def measure_blends(self, targets: Any, rule: Any, outputs: list[wp.array], moving: bool) -> None:
        """Tell how near targets are and how their light mixes; structs and arrays as the kernel has them."""
        rules = streak_rules(outputs[0].device) if moving else StreakRules()
        _launch(make_blend_kernel(self._light, moving), [targets, self.tables, rule, rules], outputs)

    def measure_bounds(
        self, targets: Any, rule: Any, noise: Any, windows: list[wp.array], outputs: list[wp.array], moving: bool
    ) -> None:
        """Tell how well targets can be measured; structs and arrays as the kernel has them."""
        from warpsim_kernels.bounds import make_bounds_kernel

        rules = streak_rules(outputs[0].device) if moving else StreakRules()
        stamps = self._stamps(with_sigma=False)
        kernel = make_bounds_kernel(self._light, stamps, moving, self._layout is not None)
        _launch(kernel, [targets, self.tables, rule, rules, noise, *windows], outputs)

    @property
    def _light(self) -> LightFunctions:
        return gaussian_light() if self._layout is None else table_light(self._layout)

    def of_band(self, band: int) -> PsfBank:
        """Return the bank of one of the bands alone, with the same tables."""
        bank = copy.copy(self)
        bank._psf = self._psf[band : band + 1]
        if self._layout is not None:
            bank._blur = self._blur[band : band + 1]
        return bank


def _lists(sources: Sequence[wp.array]) -> Any:
    """The kernels' Sources of n_source, xy_px and irradiance_w_cm2."""
    lists: Any = Sources()
    lists.n_source, lists.xy_px, lists.irradiance_w_cm2 = sources
    return lists


def _images(pixels: wp.array, simd_width: int) -> Any:
    """The kernels' Images, without flags, drawn on or read simd_width pixels at a time."""
    images: Any = canvas_functions(simd_width).Images()
    images.pixels = pixels.flatten()
    images.vectors = overlapping(images.pixels, simd_width)
    images.n_row, images.n_col = pixels.shape[2:]
    return images


def _blur(psf: TabulatedPsf, pixel_aspect: float) -> Any:
    blur: Any = Blur()
    blur.width_px, blur.band_limit_per_px = sharpness(psf)
    blur.aspect = pixel_aspect
    return blur


def stamp_rule(cut_w_cm2: Sequence[float], cut_fraction: float, device: Any, streak_error: float = STREAK_ERROR) -> Any:
    """Return the kernels' StampRule on a device.

    A stamp may leave out the larger of cut_w_cm2, (n_band,), and cut_fraction of a source's light per pixel; a streak's
    quadrature in time may err by streak_error of it, or as much as the stamp may leave out.
    """
    rule: Any = StampRule()
    rule.cut_w_cm2 = wp.array(cut_w_cm2, dtype=wp.float32, device=device)
    rule.cut_fraction = max(cut_fraction, SMALLEST_STAMP_CUT)
    rule.streak_error = streak_error
    return rule


def rule_of_band(rule: Any, band: int) -> Any:
    """The StampRule of one of the bands alone."""
    one: Any = StampRule()
    one.cut_w_cm2 = rule.cut_w_cm2[band : band + 1]
    one.cut_fraction, one.streak_error = rule.cut_fraction, rule.streak_error
    return one


def paths_struct(offset_px: wp.array, brightness: wp.array, n_target: int) -> Any:
    """Return the kernels' Paths."""
    paths: Any = Paths()
    paths.offset_px, paths.brightness, paths.n_target = offset_px, brightness, n_target
    return paths


def _movement(paths: Any, device: wp.Device) -> tuple[Any, Any]:
    """Paths and StreakRules of a kernel; empty where nothing moves, as the rules take 0.1 s to find."""
    return (Paths(), StreakRules()) if paths is None else (paths, streak_rules(device))


def _launch(kernel: wp.Kernel, inputs: list[Any], outputs: list[wp.array]) -> None:
    Launch(kernel, outputs[0].shape, inputs, outputs, outputs[0].device).run()
