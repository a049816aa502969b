"""Star catalogs written to files, in warpsim's own columns."""

from __future__ import annotations

from pathlib import Path

from warpsim.files import check_new_file, whole_file, write_fits_table
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.space_motion import J2000_JYEAR

FORMAT_OF_SUFFIX = {
    ".fits": "fits",
    ".fit": "fits",
    ".ecsv": "ascii.ecsv",
    ".vot": "votable",
    ".xml": "votable",
    ".csv": "ascii.csv",
}
"""astropy's names of the formats."""

_WITHOUT_META = ("votable", "ascii.csv")


def write_catalog(catalog: StarCatalog, path: str | Path, overwrite: bool = False) -> StarCatalog:
    """Write a catalog as a table that StarCatalog.read() takes as it is; whole or not at all.

    The suffix says the format. CSV and VOTable keep no epoch: there the stars are moved to J2000.0, which readers
    assume. Returns the catalog as written.
    """
    path = Path(path)
    check_new_file(path, tuple(FORMAT_OF_SUFFIX), overwrite)
    format = FORMAT_OF_SUFFIX[path.suffix.lower()]
    if format in _WITHOUT_META:
        catalog = catalog.at_epoch(J2000_JYEAR)
    table = catalog.to_table()
    with whole_file(path) as partial:
        if format == "fits":
            write_fits_table(table, partial)
            return catalog
        # Binary VOTables are a third of the size of those of text.
        options = {"tabledata_format": "binary2"} if format == "votable" else {}
        table.write(partial, format=format, overwrite=True, **options)
    return catalog
