"""Stand-in for columns of the truth that are to come: error bounds and clumps. Deleted when they are there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpsim.measure.pixel_psf import PixelPsf
from warpsim.measure.point_fit import source_sigma
from warpsim.scene.instrument import Instrument

if TYPE_CHECKING:
    from astropy.table import Table


def with_bounds(truth: Table, instrument: Instrument) -> Table:
    """Return truth with x_sigma_px, y_sigma_px, irradiance_sigma_w_cm2 and clump_id, where it lacks them."""
    from scipy.cluster.hierarchy import fcluster, linkage

    if "clump_id" in truth.colnames:
        return truth
    truth = truth.copy()
    n_target = len(np.unique(truth["target"]))
    sigma, clump = np.full((len(truth), 3), np.nan), np.full(len(truth), -1)
    psfs = {band: PixelPsf(instrument.psf(band)) for band in np.unique(truth["band"]).tolist()}
    for start in range(0, len(truth), n_target):
        rows = truth[start : start + n_target]
        band = str(rows["band"][0])
        nei = instrument.nei_w_cm2(band)
        lit = np.flatnonzero((rows["irradiance_w_cm2"] > 0) & np.isfinite(rows["x_px"]) & rows["in_fov"])
        xy = np.stack([rows["x_px"], rows["y_px"]], axis=1)
        for index in lit:
            off = xy[index] - np.round(xy[index])
            sigma[start + index] = source_sigma(psfs[band], rows["irradiance_w_cm2"][index] / nei, tuple(off))
            sigma[start + index, 2] *= nei
        if len(lit) > 1:
            clump[start + lit] = fcluster(linkage(xy[lit]), psfs[band].fwhm_px, "distance") - 1
        elif len(lit):
            clump[start + lit] = 0
    for number, name in enumerate(("x_sigma_px", "y_sigma_px", "irradiance_sigma_w_cm2")):
        truth[name] = sigma[:, number]
    truth["clump_id"] = clump
    return truth
