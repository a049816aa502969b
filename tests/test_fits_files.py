"""FITS files of others: wrong sizes are refused before anything is read, and damage ends no process."""

from __future__ import annotations

import gzip
import io
import random

import numpy as np
import pytest
from astropy.io import fits
from astropy.table import Table

import warpsim as ws
from warpsim.optics.telescope import read_psf_file
from warpsim.tables.checked_files import CUT_OFF, checked_fits, open_fits

IMAGE = np.arange(64.0 * 64).reshape(64, 64)
CARD = 80


def written(*hdus):
    out = io.BytesIO()
    fits.HDUList(list(hdus)).writeto(out)
    return out.getvalue()


def compressed(kind):
    return written(fits.PrimaryHDU(), fits.CompImageHDU(IMAGE.astype(np.int32), compression_type=kind))


def changed(data, keyword, value, after=0):
    """The file with a card of a header replaced."""
    at = data.index(f"{keyword:8}=".encode(), after)
    return data[:at] + f"{keyword:8}= {value:>20}".ljust(CARD).encode() + data[at + CARD :]


@pytest.fixture
def file(tmp_path):
    """Write bytes to a file."""

    def write(data, name="x.fits"):
        (tmp_path / name).write_bytes(data)
        return str(tmp_path / name)

    return write


PLAIN = written(fits.PrimaryHDU(IMAGE))
WRONG = [
    ("NAXIS", 1_000_000_000, "NAXIS: must be a whole number from 0 to 999, got 1000000000"),
    ("NAXIS", 10**30, f"NAXIS: must be a whole number from 0 to 999, got {10**30}"),
    ("NAXIS", 3, "NAXIS3: must be a whole number from 0 to 281474976710656, got nothing"),
    ("NAXIS1", -64, "NAXIS1: must be a whole number from 0 to 281474976710656, got -64"),
    ("NAXIS2", "'x'", "NAXIS2: must be a whole number from 0 to 281474976710656, got 'x'"),
    ("NAXIS2", 10**9, CUT_OFF),
    ("BITPIX", 33, "BITPIX: must be one of 8, 16, 32, 64, -32, -64, got 33"),
    ("SIMPLE", "F", "SIMPLE: must be T, got 'F'"),
]


@pytest.mark.parametrize(("keyword", "value", "rule"), WRONG)
def test_wrong_sizes_of_a_psf_are_one_line(file, keyword, value, rule):
    path = file(changed(PLAIN, keyword, value))
    with pytest.raises(ws.InputError) as error:
        read_psf_file(path)
    assert str(error.value) == f"{path}: {'' if rule == CUT_OFF else 'FITS header 0: '}{rule}"


def test_a_catalog_of_a_thousand_million_columns_is_refused(file):
    table = fits.table_to_hdu(Table({"ra_deg": [1.0], "dec_deg": [2.0], "flux_A_jy": [3.0]}))
    data = written(fits.PrimaryHDU(), table)
    assert len(ws.StarCatalog.read(file(data))) == 1
    with pytest.raises(ws.InputError, match=r"FITS header 1: TFIELDS: must be a whole number from 0 to 999, got"):
        ws.StarCatalog.read(file(changed(data, "TFIELDS", 10**9)))
    with pytest.raises(ws.InputError, match=CUT_OFF):
        ws.StarCatalog.read(file(changed(data, "NAXIS2", 10**9, after=2880)))


def test_files_may_be_packed_and_images_compressed(file):
    for data in (PLAIN, gzip.compress(PLAIN), compressed("RICE_1")):
        with open_fits(file(data)) as hdus:
            assert np.array_equal(hdus[-1].data, IMAGE)
    assert np.array_equal(read_psf_file(file(compressed("GZIP_1"), "psf.fits"))[0], IMAGE)
    with (
        pytest.raises(ws.InputError, match="ends early: the gzip data are cut off"),
        open_fits(file(gzip.compress(PLAIN)[:-20])),
    ):
        pass


def test_a_compressed_image_of_terabytes_is_refused():
    data = changed(compressed("RICE_1"), "ZNAXIS1", 10**12)
    with pytest.raises(ws.InputError, match=r"ZNAXIS: a compressed image must have at most 536,870,912 pixels"):
        checked_fits(data)


@pytest.mark.ci
def test_damaged_tiles_end_no_process(file):
    """HCOMPRESS of damaged tiles overwrites memory of its process: some of these end with SIGABRT there."""
    whole = compressed("HCOMPRESS_1")
    for seed in range(12):
        rng, data = random.Random(seed), bytearray(whole)
        for _ in range(20):
            data[rng.randrange(5760, len(data))] = rng.randrange(256)
        try:
            image, _ = read_psf_file(file(bytes(data), f"psf{seed}.fits"))
        except ws.InputError as error:
            assert "has compressed images that cannot be unpacked" in str(error) or "cannot be read" in str(error)  # noqa: PT017
        else:
            assert image.shape == IMAGE.shape
