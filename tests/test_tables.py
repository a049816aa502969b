"""Tables of files, whatever they are of, and FITS files of others.

What tables must be and which layouts they may follow is the caller's. Of FITS wrong sizes are refused before anything
is read, and damage ends no process.
"""

from __future__ import annotations

import gzip
import io
import random

import numpy as np
import pytest
from astropy.io import fits
from astropy.table import Table

import warpsim as ws
from warpsim.errors import InputError
from warpsim.optics.telescope import read_psf_file
from warpsim.sky.readers.layouts import LAYOUTS, likely_layout
from warpsim.tables.checked_files import CUT_OFF, checked_fits, open_fits
from warpsim.tables.fixed_width import ByteField, Layout
from warpsim.tables.read_table import read_table

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


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"\x89PNG\r\n", "a PNG image"),
        (b"<html><title>No such page</title>", "a web page titled 'No such page'"),
        (b'{"a": 1}', "JSON"),
        (b"<?xml version='1.0'?><a/>", "XML that is no VOTable"),
        (b'<VOTABLE><INFO name="QUERY_STATUS" value="ERROR">no</INFO></VOTABLE>', "an error from the archive: no"),
    ],
)
def test_the_caller_says_what_a_file_must_be(tmp_path, content, found):
    path = tmp_path / "x"
    path.write_bytes(content)
    for what in ("a table of stars", "a table of directions"):
        with pytest.raises(InputError) as caught:
            read_table(path, what=what)
        assert str(caught.value) == f"must be {what}, got {found}"


def test_layouts_come_from_the_caller(tmp_path):
    path = tmp_path / "x.dat"
    path.write_text("12 34\n56  7\n")
    layout = Layout((ByteField("a", 1, 2), ByteField("b", 4, 5, "whole")), shortest=5, length=5, name="two numbers")
    table = read_table(path, layouts=[layout])
    assert table.layout == "two numbers" and table.needed("b").tolist() == [34.0, 7.0]
    assert table.where(1) == "line 2"
    with pytest.raises(InputError, match=r"^cannot be read as a table: no line names its columns"):
        read_table(path)
    path.write_text("12 34\n56\n")
    with pytest.raises(InputError, match=r"^line 2: must have 5 bytes, got 2"):
        read_table(path, likely=layout)
    assert {layout.name for layout in LAYOUTS} >= {"hipparcos", "iras-psc"} and likely_layout("x.dat", "gaia") is None


def test_rows_of_errors_become_lines(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("# comment\na,b\n1,2\n\n3,4\n")
    table = read_table(path, "csv")
    error = InputError("must be < 4", "b", 4, row=1)
    assert str(table.located(error)) == "line 5: b: must be < 4, got 4"
    whole = InputError("must have a column c")
    assert table.located(whole) is whole
