"""Star catalogs of a scene's sensors with their indices on devices; kinds with the same stars have one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from warpsim.constants import JULIAN_YEAR_DAYS
from warpsim.errors import InputError
from warpsim.instant import Instant
from warpsim.radiometry.band import Band
from warpsim.scene.scenario import Scenario
from warpsim.scene.sky import Sky
from warpsim.sky.band_index import BandIndex
from warpsim.sky.catalog import StarCatalog


def load_catalog(sky: Sky, bands: Iterable[Band] = ()) -> StarCatalog:
    """Return the star catalog of a sky.

    Args:
        sky: The sky.
        bands: Bands of the sensor that it is for: the default catalog holds the stars that are brightest in them.

    Raises:
        InputError: It cannot be read, or needs packages that are not installed.
    """
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
        return StarCatalog.read(sky.catalog)
    except InputError as error:
        raise error.within("sky.catalog") from None


def star_index(sky: Sky, epoch: Instant, catalog: StarCatalog, device: Any) -> BandIndex:
    """Return the index of a catalog, its stars moved to an epoch by the sky's physics."""
    jyear = 2000.0 + (epoch.tt.jd - 2451545.0) / JULIAN_YEAR_DAYS
    return BandIndex(catalog.at_epoch(jyear, sky.physics), device)


class Skies:
    """Stars by kind of sensor, on some devices.

    Args:
        sky: The sky.
        epoch: Instant to which the stars are moved.
        devices: Where indices are put.
        catalog: Stars instead of the sky's.
    """

    def __init__(self, sky: Sky, epoch: Instant, devices: Sequence[Any], catalog: StarCatalog | None = None) -> None:
        self._sky, self._epoch, self._devices, self._given = sky, epoch, list(devices), catalog
        self._read: StarCatalog | None = None
        self._indices: dict[int, list[BandIndex]] = {}

    def indices(self, bands: Iterable[Band]) -> list[BandIndex]:
        """Return the index on each device of the stars for a sensor of some bands.

        Raises:
            InputError: The catalog cannot be read.
        """
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
        """Return the catalog for a sensor of some bands as it was read, the same object for the same stars.

        Raises:
            InputError: It cannot be read.
        """
        if self._given is not None:
            return self._given
        if self._sky.catalog == "default":
            return load_catalog(self._sky, bands)
        if self._read is None:
            self._read = load_catalog(self._sky)
        return self._read


def catalog_checksums(scenario: Scenario) -> dict[str, str]:
    """Return the checksum of the stars of each kind of sensor, by its name; a file is read once.

    Raises:
        InputError: The catalog cannot be read.
    """
    skies = Skies(scenario.scene.sky, scenario.epoch, ())
    return {kind: skies.catalog(one.bands.values()).checksum for kind, one in scenario.instruments.items()}
