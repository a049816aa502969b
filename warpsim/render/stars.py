"""Stars of a scene on devices: catalogs and indices by kind of sensor, and what the stage gather_stars reads."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.motion import NodeGrid
from warpsim_kernels.stars import EarthOrbit, StarFeatures, StarField, make_gather_stars_kernel

from warpsim.constants import JULIAN_YEAR_DAYS
from warpsim.errors import InputError
from warpsim.instant import Instant
from warpsim.launches import to_numpy
from warpsim.optics.psf_bank import PsfBank
from warpsim.radiometry.band import Band
from warpsim.scene.environment import Sky
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario
from warpsim.scene.sensors import Sensor
from warpsim.scene.tracks import Tracks
from warpsim.sky.band_index import BandIndex
from warpsim.sky.catalog import StarCatalog


def load_catalog(sky: Sky, bands: Iterable[Band] = ()) -> StarCatalog:
    """Return the star catalog of a sky."""
    try:
        if sky.catalog == "none":
            return StarCatalog.from_arrays([], [], {})
        if sky.catalog == "default":
            return StarCatalog.default(*bands)
        if sky.catalog == "union":
            return StarCatalog.union()
        if sky.synthetic is not None:
            synthetic = sky.synthetic
            return StarCatalog.synthetic(
                synthetic.n_star, limit_jy=synthetic.limit_jy, sky=synthetic.sky, seed=synthetic.seed
            )
        return StarCatalog.read(
            sky.catalog,
            sky.format,
            columns=sky.columns,
            table=sky.table,
            epoch_jyear=sky.epoch_jyear,
            region=sky.region,
            limit=sky.limit,
        )
    except InputError as error:
        raise error.within("sky.catalog") from None


def star_index(sky: Sky, epoch: Instant, catalog: StarCatalog, device: Any) -> BandIndex:
    """Return the index of a catalog, its stars moved to an epoch by the sky's physics."""
    jyear = 2000.0 + (epoch.tt.jd - 2451545.0) / JULIAN_YEAR_DAYS
    return BandIndex(catalog.at_epoch(jyear, sky.physics), device)


class Skies:
    """Stars by kind of sensor, on some devices."""

    def __init__(self, sky: Sky, epoch: Instant, devices: Sequence[Any], catalog: StarCatalog | None = None) -> None:
        self._sky, self._epoch, self._devices, self._given = sky, epoch, list(devices), catalog
        self._read: StarCatalog | None = None
        self._indices: dict[int, list[BandIndex]] = {}

    def indices(self, bands: Iterable[Band]) -> list[BandIndex]:
        """Return the index on each device of the stars for a sensor of some bands."""
        catalog = self.catalog(bands)
        if id(catalog) not in self._indices:
            self._indices[id(catalog)] = [star_index(self._sky, self._epoch, catalog, one) for one in self._devices]
        return self._indices[id(catalog)]

    def at(self, epoch: Instant) -> Skies:
        """Return the same stars at another epoch; a catalog from a file is not read again."""
        if epoch == self._epoch:
            return self
        other = Skies(self._sky, epoch, self._devices, self._given)
        other._read = self._read
        return other

    def catalog(self, bands: Iterable[Band]) -> StarCatalog:
        """Return the catalog for a sensor of some bands as it was read, the same object for the same stars."""
        if self._given is not None:
            return self._given
        if self._sky.catalog == "default":
            return load_catalog(self._sky, bands)
        if self._read is None:
            self._read = load_catalog(self._sky)
        return self._read


def catalog_checksums(scenario: Scenario) -> dict[str, str]:
    """Return the checksum of the stars of each kind of sensor, by its name; a file is read once."""
    skies = Skies(scenario.scene.sky, scenario.epoch, ())
    return {kind: skies.catalog(one.bands.values()).checksum for kind, one in scenario.instruments.items()}


LARGEST_SHIFT_RAD = 2.0e-4
"""41 arcsec, how far apparent positions lie from those of the index: 28.5 of aberration (the Earth's 30.3 km/s and an
orbit at escape speed) and, close to the Sun, 6 of deflection. Parallaxes are added from the catalog."""

_MAS_RAD = np.pi / 180 / 3.6e6


@dataclass(frozen=True)
class SceneStars:
    """The star catalog on the device, in cell order, and what of a star's position is looked at."""

    index: BandIndex
    field: Any
    orbit: Any
    features: StarFeatures

    @property
    def device_bytes(self) -> int:
        """Memory that the stars take on the device [bytes]."""
        field = self.field
        arrays = (field.cell_start, field.direction, field.irradiance_w_cm2, field.half_width_px, field.parallax_rad)
        return sum(int(array.capacity) for array in arrays)


def make_stars(
    scenario: Scenario,
    instrument: Instrument,
    bands: Sequence[str],
    index: BandIndex,
    psf: PsfBank,
    stamp_rule: Any,
    grid: NodeGrid,
) -> SceneStars:
    """Put what the star stage reads on the index's device."""
    sensor, sky, rows, device = instrument.sensor, scenario.scene.sky, index.star_row, index.device
    irradiance = np.stack([index.catalog.irradiance_w_cm2(instrument.bands[name], sky.physics)[rows] for name in bands])
    light = wp.array(irradiance.astype(np.float32), dtype=wp.float32, device=device)
    half_width = _half_width_px(light, psf, stamp_rule)
    parallax_rad = np.zeros(0)
    if sky.parallax:
        # A negative parallax is a measuring error of one near 0.
        parallax_rad = np.fmax(index.catalog.parallax_mas[rows], 0.0) * _MAS_RAD
    margin_px = float(half_width.max(initial=0)) + 1.0
    field: Any = StarField()
    field.cell_start = index.cell_start_array
    field.direction = index.direction_array
    field.irradiance_w_cm2 = light
    field.half_width_px = wp.array(half_width, dtype=wp.int32, device=device)
    field.parallax_rad = wp.array(parallax_rad, dtype=wp.float32, device=device)
    # The distance to the Sun varies by 2 %: an observer may see a little more than the parallax.
    field.radius_rad = (
        sensor.camera.half_diagonal_rad(margin_px) + LARGEST_SHIFT_RAD + 1.1 * parallax_rad.max(initial=0.0)
    )
    field.cosine = float(np.cos(min(field.radius_rad, np.pi)))
    return SceneStars(index, field, _earth_orbit(scenario.tracks, grid, device), star_features(sky, sensor))


def star_threads(device: wp.Device) -> int:
    """Return the threads of the block that gathers the stars of a view: as many as run in step on CUDA."""
    return 32 if device.is_cuda else 1


def star_features(sky: Sky, sensor: Sensor) -> StarFeatures:
    """Return what the stage `gather_stars` holds for a sky and a kind of sensor."""
    distorted = sensor.camera.lens is not None
    return StarFeatures(sky.parallax, sky.light_deflection, sky.aberration, distorted, sensor.streaks)


def star_kernel(features: StarFeatures, device: wp.Device) -> wp.Kernel:
    """Return the kernel of the stage for a device."""
    return make_gather_stars_kernel(features, star_threads(device))


def _earth_orbit(tracks: Tracks, grid: NodeGrid, device: wp.Device) -> Any:
    orbit: Any = EarthOrbit()
    orbit.barycentric_m = wp.array(tracks.earth_barycentric_m, dtype=wp.vec3d, device=device)
    orbit.heliocentric_m = wp.array(tracks.earth_heliocentric_m, dtype=wp.vec3d, device=device)
    orbit.grid = grid
    return orbit


def _half_width_px(irradiance: wp.array, psf: PsfBank, stamp_rule: Any) -> npt.NDArray[np.int32]:
    """Widest stamp of each star over the bands, by the rule that deposit follows; shape (n_star,)."""
    if irradiance.size == 0:
        return np.zeros(irradiance.shape[1], dtype=np.int32)
    half_width = wp.empty(irradiance.shape, dtype=wp.int32, device=irradiance.device)
    psf.size_stamps(irradiance, stamp_rule, half_width)
    return np.asarray(to_numpy(half_width).max(axis=0))
