"""Stars of a scene on devices: catalogs and indices by kind of sensor, and what the stage gather_stars reads."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.motion import NodeGrid
from warpsim_kernels.stars import EarthOrbit, StarFeatures, StarField, make_gather_stars_kernel

from warpsim.constants import JULIAN_YEAR_DAYS
from warpsim.errors import InputError
from warpsim.instant import Instant
from warpsim.launches import struct_of, to_numpy
from warpsim.optics.psf_bank import PsfBank
from warpsim.radiometry.band import Band
from warpsim.scene.environment import BUILT_IN_CATALOGS, Sky
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario
from warpsim.scene.sensors import Sensor
from warpsim.sky.band_index import BandIndex
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.hats import is_hats
from warpsim.sky.readers.read_options import ReadOptions
from warpsim.sky.tiles import StarTiles


def tiles_of(sky: Sky) -> StarTiles | None:
    """Return the tiles of a sky whose catalog is a HATS folder, all of it; None of any other."""
    if sky.catalog in BUILT_IN_CATALOGS or sky.region or sky.limit or not is_hats(Path(sky.catalog)):
        return None
    try:
        options = ReadOptions(sky.format, sky.columns, sky.table, sky.epoch_jyear, None, sky.region, sky.limit)
        return StarTiles(Path(sky.catalog), options.checked())
    except InputError as error:
        raise _of_sky(error) from None


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
            own = sky.synthetic
            return StarCatalog.synthetic(own.n_star, limit_jy=own.limit_jy, sky=own.sky, seed=own.seed)
        names = ("columns", "table", "epoch_jyear", "region", "limit")
        return StarCatalog.read(sky.catalog, sky.format, **{name: getattr(sky, name) for name in names})
    except InputError as error:
        raise _of_sky(error) from None


def _of_sky(error: InputError) -> InputError:
    """The error of reading a catalog; one of how to read it is not of the file."""
    own = {f.name for f in fields(Sky)} - {"catalog", "synthetic"}
    return error.within("sky" if error.place in own else "sky.catalog")


def star_index(sky: Sky, epoch: Instant, catalog: StarCatalog, device: Any) -> BandIndex:
    """Return the index of a catalog, its stars moved to an epoch by the sky's physics."""
    return BandIndex(catalog.at_epoch(jyear_of(epoch), sky.physics), device)


def jyear_of(epoch: Instant) -> float:
    """Return the Julian year of an epoch."""
    return 2000.0 + (epoch.tt.jd - 2451545.0) / JULIAN_YEAR_DAYS


class Skies:
    """Stars by kind of sensor, on some devices."""

    def __init__(self, sky: Sky, epoch: Instant, devices: Sequence[Any], catalog: StarCatalog | None = None) -> None:
        self._sky, self._epoch, self._devices, self._given = sky, epoch, list(devices), catalog
        self.tiles = tiles_of(sky) if catalog is None else None
        """Where stars are read as views need them; then catalogs are empty, and so are indices."""

        self._read: StarCatalog | None = None
        self._indices: dict[int, list[BandIndex]] = {}

    def indices(self, bands: Iterable[Band]) -> list[BandIndex]:
        """Return the index on each device of the stars for a sensor of some bands."""
        catalog = self.catalog(bands)
        if id(catalog) not in self._indices:
            self._indices[id(catalog)] = [star_index(self._sky, self._epoch, catalog, one) for one in self._devices]
        return self._indices[id(catalog)]

    def indices_of(self, tiles: Sequence[int]) -> tuple[list[BandIndex], npt.NDArray[np.int64]]:
        """Return the index on each device of the stars of some tiles, and the row of each star in the folder."""
        assert self.tiles is not None
        catalog, rows = self.tiles.catalog(tiles)
        return [star_index(self._sky, self._epoch, catalog, device) for device in self._devices], rows

    def at(self, epoch: Instant) -> Skies:
        """Return the same stars at another epoch; a catalog from a file is not read again."""
        if epoch == self._epoch:
            return self
        other = copy.copy(self)
        other._epoch, other._indices = epoch, {}
        return other

    def catalog(self, bands: Iterable[Band]) -> StarCatalog:
        """Return the catalog for a sensor of some bands as it was read, the same object for the same stars."""
        if self._given is not None:
            return self._given
        if self.tiles is not None:
            if self._read is None:
                self._read = self.tiles.no_stars()
            return self._read
        if self._sky.catalog == "default":
            return load_catalog(self._sky, bands)
        if self._read is None:
            self._read = load_catalog(self._sky)
        return self._read


def catalog_checksums(scenario: Scenario) -> dict[str, str]:
    """Return the checksum of the stars of each kind of sensor, by its name; a file is read once."""
    skies = Skies(scenario.scene.sky, scenario.epoch, ())
    if skies.tiles is not None:
        return dict.fromkeys(scenario.instruments, skies.tiles.checksum)
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

    tiles: tuple[int, ...] = ()
    """Tiles that the stars are from, where they are read as views need them."""

    folder_row: npt.NDArray[np.int64] | None = None
    """Of such stars, row of each in the folder."""

    tile_radius_rad: float = 0.0
    """How far from the boresight of a view a star may lie in its tile whose stamp touches the frame [rad]."""

    def rows(self, star: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Return the rows of stars, by their numbers in cell order, in the catalog as a whole."""
        rows = self.index.star_row[star]
        return rows if self.folder_row is None else self.folder_row[rows]

    def names(self, star: npt.NDArray[np.int64]) -> npt.NDArray[np.str_]:
        """Return the names of stars, by their numbers in cell order."""
        return self.index.catalog.id_of(self.index.star_row[star])

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
    half_width = half_width_px(light, psf, stamp_rule)
    parallax_rad = np.zeros(0)
    if sky.parallax:
        # A negative parallax is a measuring error of one near 0.
        parallax_rad = np.fmax(index.catalog.parallax_mas[rows], 0.0) * _MAS_RAD
    margin_px = float(half_width.max(initial=0)) + 1.0
    # The distance to the Sun varies by 2 %: an observer may see a little more than the parallax.
    radius_rad = sensor.camera.half_diagonal_rad(margin_px) + LARGEST_SHIFT_RAD + 1.1 * parallax_rad.max(initial=0.0)
    field = struct_of(
        StarField,
        device,
        cell_start=index.cell_start_array,
        direction=index.direction_array,
        irradiance_w_cm2=light,
        half_width_px=half_width,
        parallax_rad=parallax_rad,
        radius_rad=radius_rad,
        cosine=float(np.cos(min(radius_rad, np.pi))),
    )
    orbit = struct_of(
        EarthOrbit,
        device,
        barycentric_m=scenario.tracks.earth_barycentric_m,
        heliocentric_m=scenario.tracks.earth_heliocentric_m,
        grid=grid,
    )
    return SceneStars(index, field, orbit, star_features(sky, sensor))


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


def half_width_px(irradiance: wp.array, psf: PsfBank, stamp_rule: Any) -> npt.NDArray[np.int32]:
    """Return the widest stamp of each star over the bands, by the rule that deposit follows; shape (n_star,)."""
    if irradiance.size == 0:
        return np.zeros(irradiance.shape[1], dtype=np.int32)
    half_width = wp.empty(irradiance.shape, dtype=wp.int32, device=irradiance.device)
    psf.size_stamps(irradiance, stamp_rule, half_width)
    return np.asarray(to_numpy(half_width).max(axis=0))
