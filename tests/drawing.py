"""Point sources on images by the kernels' own interface, without a scene."""

import numpy as np
import warp as wp

from warpsim.optics.psf_bank import PsfBank, stamp_rule


def source_lists(xy_px, flux, device):
    """Lists of views: xy_px (n_view, n_slot, 2), flux (n_view, n_band, n_slot); of one view without the first axes."""
    xy = np.asarray(xy_px, dtype=np.float64)
    light = np.asarray(flux, dtype=np.float64)
    if xy.ndim == 2:
        xy, light = xy[None], light.reshape(1, -1, len(xy))
    n_source = np.full(len(xy), xy.shape[1])
    kinds = ((n_source, wp.int32), (xy, wp.vec2d), (light, wp.float32))
    return [wp.array(values, dtype=dtype, device=device) for values, dtype in kinds]


def draw(xy_px, flux, psf, shape, device, rule, paths=None, n_row_per_block=None, aspect=1.0, touched=None):
    """Image of one view and band."""
    signal = wp.zeros((1, 1, *shape), dtype=wp.float32, device=device)
    bank, lists = PsfBank([psf], wp.get_device(device), aspect), source_lists(xy_px, flux, device)
    bank.deposit(lists, rule, n_row_per_block or shape[0], signal, paths, touched).run()
    return signal.numpy()[0, 0].astype(np.float64)


def draw_each(xy_px, psf, shape, device, cut_fraction, aspect=1.0, accuracy=None):
    """One image for each position, unit flux: many views in one launch."""
    n = len(xy_px)
    signal = wp.zeros((n, 1, *shape), dtype=wp.float32, device=device)
    lists = source_lists(np.asarray(xy_px)[:, None, :], np.ones((n, 1, 1)), device)
    bank = PsfBank([psf], wp.get_device(device), aspect, accuracy)
    bank.deposit(lists, stamp_rule([0.0], cut_fraction, device), shape[0], signal).run()
    return signal.numpy()[:, 0].astype(np.float64)


def stamp_fractions(xy_px, flux, psf, device, rule, paths=None, aspect=1.0):
    """Fractions of sources in their own pixels, and in their stamps."""
    outputs = [wp.empty((1, 1, len(xy_px)), dtype=wp.float32, device=device) for _ in range(2)]
    bank = PsfBank([psf], wp.get_device(device), aspect)
    bank.measure_stamps(source_lists(xy_px, flux, device)[1:], rule, outputs, paths)
    return [array.numpy().ravel() for array in outputs]
