"""Readers of the MSX catalogs: V/98 by bytes and by VizieR's names, V/107 by bytes, V/114 by names."""

from __future__ import annotations

import bz2
import gzip
import lzma

import numpy as np
import pytest
from astropy.table import MaskedColumn, Table

import warpsim as ws
from warpsim.errors import InputError
from warpsim.radiometry.bands import BANDS

BANDS_V98 = ("A", "B1", "B2", "C", "D", "E")  # order of the flux columns of V/98
BANDS_PSC = ("B1", "B2", "A", "C", "D", "E")  # order of the band groups of V/107

PLACE_ATOL_DEG = 1e-11  # sums of three float64 numbers
MOTION_RTOL = 1e-12  # one product and one cosine

FLUXES_1 = (12.5, 3.25, 3.125, 6.75, 4.5, 2.25)
FLUXES_2 = (0.125, "", 0.0, 0.0625, "", 0.03125)


def v98_line(h, m, s, sign, d, arcmin, arcsec, pm_ra, pm_dec, fluxes, sp_type="K0 ", v_mag=6.54):
    """A line of msx.dat: names, place, errors, proper motions, other surveys, fluxes; from the published bytes."""
    text = "HD 123456".ljust(21)  # 0-21
    text += f"{h:02d}{m:02d}{s:6.3f}"  # 21-31
    text += f"{sign}{d:02d}{arcmin:02d}{arcsec:5.2f}"  # 31-41
    text += f"{12.0:6.1f}{15.0:5.1f}"  # 41-52
    text += f"{pm_ra:9.4f}{pm_dec:9.3f}"  # 52-70
    text += f"{2.5:6.1f}{3.5:6.1f}"  # 70-82
    text += f"{sp_type:3s}  {v_mag:5.2f}"  # 82-92
    text += "x" * 40  # 92-132
    text += "".join(f"{flux:9.5f}" if flux != "" else " " * 9 for flux in fluxes)  # 132-186
    assert len(text) == 186
    return text


def v98_lines():
    return [
        v98_line(5, 55, 10.305, "+", 7, 24, 25.43, 0.1725, 0.874, FLUXES_1),
        v98_line(0, 0, 0.5, "-", 0, 0, 30.0, -0.25, -5.5, FLUXES_2),
        v98_line(23, 59, 59.999, "-", 89, 30, 0.0, 12.0, 1.0, FLUXES_1),
    ]


def written(path, lines, end="\n"):
    path.write_bytes(("\n".join(lines) + end).encode())
    return path


def assert_v98(catalog):
    place = [((5 + 55 / 60 + 10.305 / 3600) * 15, 7 + 24 / 60 + 25.43 / 3600), (0.5 / 240, -30 / 3600),
             ((23 + 59 / 60 + 59.999 / 3600) * 15, -89.5)]  # fmt: skip
    ra_deg, dec_deg = np.transpose(place)
    np.testing.assert_allclose(catalog.ra_deg, ra_deg, rtol=0, atol=PLACE_ATOL_DEG)
    np.testing.assert_allclose(catalog.dec_deg, dec_deg, rtol=0, atol=PLACE_ATOL_DEG)
    # Seconds of time a century, not multiplied by cos(dec): 1 s = 15 arcsec; 1 arcsec a century is 10 mas a year.
    pm_ra = np.array([0.1725, -0.25, 12.0]) * 15.0 * 1000.0 / 100.0 * np.cos(np.radians(dec_deg))
    np.testing.assert_allclose(catalog.pm_ra_mas_yr, pm_ra, rtol=MOTION_RTOL)
    np.testing.assert_allclose(catalog.pm_dec_mas_yr, [8.74, -55.0, 10.0], rtol=MOTION_RTOL)
    assert catalog.epoch_jyear == 2000.0
    assert catalog.quality.tolist() == [2, 2, 2]


@pytest.mark.parametrize(
    ("suffix", "pack"), [("", bytes), (".gz", gzip.compress), (".bz2", bz2.compress), (".xz", lzma.compress)]
)
def test_v98_by_its_bytes(tmp_path, suffix, pack):
    plain = written(tmp_path / "msx.dat", v98_lines())
    file = tmp_path / f"msx.dat{suffix}"
    file.write_bytes(pack(plain.read_bytes()))
    catalog = ws.StarCatalog.read(file, fill=False)
    assert_v98(catalog)
    for place, band in enumerate(BANDS_V98):
        second = np.nan if FLUXES_2[place] in ("", 0.0) else FLUXES_2[place]  # blank and 0 are missing
        np.testing.assert_array_equal(catalog.flux_jy(band), [FLUXES_1[place], second, FLUXES_1[place]])
        assert catalog.flux_flag(band).tolist() == [2, 0 if np.isnan(second) else 2, 2]  # predictions of the catalog
    assert catalog.name.startswith("msx-irac (msx.dat")
    assert "V/98" in catalog.provenance
    assert catalog.id.tolist() == ["1", "2", "3"]


def test_v98_missing_bands_are_filled_and_flagged(tmp_path):
    catalog = ws.StarCatalog.read(written(tmp_path / "msx.dat", v98_lines()))
    for band in BANDS:
        assert np.isfinite(catalog.flux_jy(band)).all()
    assert catalog.flux_flag("B1")[1] == 3
    # A star of V = 6.54 and 0.125 Jy in A has V-K of 0; B1 and A alike; zero points 194.6 and 58.49 Jy.
    assert catalog.flux_jy("B1")[1] == pytest.approx(0.125 * 194.6 / 58.49, rel=0.1)
    assert catalog.magnitude("V") == pytest.approx([6.54] * 3)
    assert catalog.flux_flag("V").tolist() == [1, 1, 1]


@pytest.mark.parametrize("format", [None, "msx-irac"])
@pytest.mark.parametrize("suffix", ["csv", "fits", "vot", "ecsv"])
def test_v98_by_the_names_of_vizier(tmp_path, suffix, format):
    table = Table()
    table["RAJ2000"] = ["05 55 10.305", "00 00 00.500", "23 59 59.999"]
    table["DEJ2000"] = ["+07 24 25.43", "-00 00 30.00", "-89 30 00.00"]
    table["pmRA"] = [0.1725, -0.25, 12.0]
    table["pmDE"] = [0.874, -5.5, 1.0]
    for place, band in enumerate(BANDS_V98):
        values = [FLUXES_1[place], FLUXES_2[place] or 0.0, FLUXES_1[place]]
        table[f"FSIII{band}"] = MaskedColumn(values, mask=[False, FLUXES_2[place] == "", False], unit="Jy")
    file = tmp_path / f"v98.{suffix}"
    table.write(file, format="votable" if suffix == "vot" else None)
    catalog = ws.StarCatalog.read(file, format=format, fill=False)
    assert_v98(catalog)
    np.testing.assert_array_equal(catalog.flux_jy("A"), [12.5, 0.125, 12.5])
    assert np.isnan(catalog.flux_jy("B1")[1])
    assert np.isnan(catalog.flux_jy("B2")[1])


def test_v98_units_of_proper_motion_are_honoured(tmp_path):
    table = Table({"RAJ2000": [10.0], "DEJ2000": [60.0], "FSIIIA": [1.0]})
    table["pmRA"] = [0.02]
    table["pmRA"].unit = "s / yr"  # of time: 0.02 s a year are 300 mas of the angle, 150 on the sky at 60 degrees
    table["pmDE"] = [0.3]
    table["pmDE"].unit = "arcsec / yr"
    table.write(tmp_path / "v98.ecsv")
    catalog = ws.StarCatalog.read(tmp_path / "v98.ecsv")
    assert catalog.pm_ra_mas_yr[0] == pytest.approx(150.0)
    assert catalog.pm_dec_mas_yr[0] == pytest.approx(300.0)


def v107_line(name, ra, dec, groups):
    """A line in the FORTRAN format of the catalog's own documentation."""
    text = f"{name:23s} {ra:9.4f} {dec:9.4f} {2.2:4.1f} {1.2:4.1f} {-31.3:5.1f} {4:3d}"
    assert len(text) == 63
    for flux, quality in groups:
        text += f" {flux:12.4E} {quality:1d} {5.6:5.1f} {12.3:6.1f} {9.8:6.1f} {4:3d} {6.5:5.1f}"
    text += " 000000 000000 000000"
    assert len(text) == 354
    return text


def test_v98_is_the_same_when_written_and_read(tmp_path):
    """Its own predictions are flagged 2 and stay anchors; what is filled in beside them does not become one."""
    catalog = ws.StarCatalog.read(written(tmp_path / "msx.dat", v98_lines()))
    catalog.to_table().write(tmp_path / "msx.fits")
    again = ws.StarCatalog.read(tmp_path / "msx.fits")
    for band in ws.bands():
        np.testing.assert_array_equal(again.irradiance_w_cm2(band), catalog.irradiance_w_cm2(band), err_msg=band)
    for band in ("A", "B1", "V", "W1"):
        np.testing.assert_array_equal(again.flux_flag(band), catalog.flux_flag(band))
        np.testing.assert_array_equal(again.flux_jy(band), catalog.flux_jy(band))


def psc_rows():
    """Name, place and (flux, quality) in the order B1, B2, A, C, D, E."""
    return [
        ("MSX5C_G000.0043-00.0120", 266.4123, -28.9412,
         [(-2.5, 0), (9.25, 1), (4.5, 4), (3.25, 3), (2.125, 2), (1.75, 1)]),
        ("MSX5C_G120.5000+01.0000", 10.0, -0.0042,
         [(0.0, 0), (0.0, 0), (0.1125, 2), (0.0, 0), (-0.75, 1), (0.0, 0)]),
    ]  # fmt: skip


def assert_psc(catalog, ids):
    np.testing.assert_array_equal(catalog.ra_deg, [266.4123, 10.0])
    np.testing.assert_array_equal(catalog.dec_deg, [-28.9412, -0.0042])
    np.testing.assert_array_equal(catalog.flux_jy("A"), [4.5, 0.1125])
    np.testing.assert_array_equal(catalog.flux_jy("C"), [3.25, np.nan])
    np.testing.assert_array_equal(catalog.flux_jy("D"), [2.125, np.nan])
    for band in ("B1", "B2", "E"):  # quality 0 and limits are no fluxes
        assert np.isnan(catalog.flux_jy(band)).all(), band
        assert catalog.flux_flag(band).tolist() == [0, 0]
    assert catalog.flux_flag("A").tolist() == [1, 1]
    assert catalog.quality.tolist() == [4, 2]
    assert catalog.id.tolist() == ids
    assert catalog.epoch_jyear == 2000.0
    assert "no proper motions" in catalog.provenance


def test_v107_by_its_bytes(tmp_path):
    file = written(tmp_path / "gp_pm05.dat", [v107_line(*row) for row in psc_rows()])
    catalog = ws.StarCatalog.read(file, fill=False)
    assert_psc(catalog, [row[0] for row in psc_rows()])
    assert catalog.name == "msx-psc-v1 (gp_pm05.dat)"


def test_limits_hold_for_filled_bands(tmp_path):
    file = written(tmp_path / "gp_pm05.dat", [v107_line(*row) for row in psc_rows()])
    catalog = ws.StarCatalog.read(file)
    # B2 of a K giant's colour would be about 4.5 * 188.8 / 58.49 = 14.5 Jy, but is at most 9.25.
    assert catalog.flux_jy("B2")[0] == 9.25
    # E of a K giant from D: about 2.125 * 8.80 / 18.29 = 1.022 Jy, below its limit of 1.75.
    assert catalog.flux_jy("E")[0] == pytest.approx(2.125 * 8.80 / 18.29, rel=0.05)
    # D of the second: about 0.1125 * 18.29 / 58.49 = 0.035 Jy, below the limit, which has a minus sign.
    assert catalog.flux_jy("D")[1] == pytest.approx(0.1125 * 18.29 / 58.49, rel=0.05)
    assert catalog.flux_flag("E").tolist() == [3, 3]


@pytest.mark.parametrize("suffix", ["csv", "fits", "vot", "ecsv"])
def test_v114_by_the_names_of_vizier(tmp_path, suffix):
    rows = psc_rows()
    names = [f"MSX6C_{row[0][6:]}" for row in rows]
    table = Table({"MSX6C": names, "RAJ2000": [row[1] for row in rows], "DEJ2000": [row[2] for row in rows]})
    for place, band in enumerate(BANDS_PSC):
        table[band] = [row[3][place][0] for row in rows]
        table[band].unit = "Jy"
        table[f"q_{band}"] = [row[3][place][1] for row in rows]
    file = tmp_path / f"msx6.{suffix}"
    table.write(file, format="votable" if suffix == "vot" else None)
    catalog = ws.StarCatalog.read(file, fill=False)
    assert_psc(catalog, names)
    assert catalog.name.startswith("msx-psc (")


def test_v114_a_flux_needs_its_quality(tmp_path):
    Table({"RAJ2000": [1.0], "DEJ2000": [2.0], "A": [1.0], "q_A": [4], "D": [1.0]}).write(tmp_path / "x.csv")
    with pytest.raises(InputError, match=r"x\.csv: must have the column q_D, got RAJ2000, DEJ2000, A, q_A, D"):
        ws.StarCatalog.read(tmp_path / "x.csv")


def test_v114_quality_out_of_range_names_the_line(tmp_path):
    file = written(tmp_path / "x.csv", ["RAJ2000,DEJ2000,A,q_A", "1,2,3,4", "1,2,3,7"])
    with pytest.raises(InputError, match=r"x\.csv: line 3: q_A: must be in \[0, 4\], got 7$"):
        ws.StarCatalog.read(file)


def broken(line, first, last, text):
    """A line with other bytes first-last (from 1)."""
    return line[: first - 1] + text.rjust(last - first + 1) + line[last:]


@pytest.mark.parametrize(
    ("first", "last", "text", "message"),
    [
        (26, 31, "1x.4", "line 3: column RAs (bytes 26-31): must be a number, got '1x.4'"),
        (26, 31, "nan", "line 3: column RAs (bytes 26-31): must be a number, got 'nan'"),
        (26, 31, "1 2.5", "line 3: column RAs (bytes 26-31): must be a number, got '1 2.5'"),
        (22, 23, "24", "line 3: column RAh (bytes 22-23): must be in [0, 23], got '24'"),
        (32, 32, "*", "line 3: column DE- (byte 32): must be + or -, got '*'"),
        (33, 34, "91", "line 3: column DEd (bytes 33-34): must be in [0, 90], got '91'"),
        (133, 141, "1.5e", "line 3: column FSIIIA (bytes 133-141): must be a number, got '1.5e'"),
        (178, 186, "-1.25", "line 3: flux_E_jy: must be in [0, 1e+15], got -1.25"),
        (34, 41, "00000.00", None),
    ],
)
def test_v98_bad_values_name_line_column_and_bytes(tmp_path, first, last, text, message):
    lines = v98_lines()
    file = written(tmp_path / "msx.dat", [lines[0], lines[1], broken(lines[2], first, last, text)])
    if message is None:  # a legal change: the test's own lines are not refused by accident
        assert len(ws.StarCatalog.read(file)) == 3
        return
    with pytest.raises(InputError) as error:
        ws.StarCatalog.read(file)
    assert str(error.value) == f"{file}: {message}"


def test_v98_stars_without_a_place_are_left_out_with_their_lines(tmp_path):
    lines = v98_lines()
    lines.insert(1, broken(lines[0], 22, 31, ""))
    file = written(tmp_path / "msx.dat", ["", *lines])  # a blank line counts
    with pytest.warns(UserWarning, match=r"msx\.dat: left out 1 of 4 stars without a finite position \(lines 3\)"):
        catalog = ws.StarCatalog.read(file)
    assert_v98(catalog)
    assert catalog.id.tolist() == ["1", "3", "4"]


def test_v98_short_line_is_named(tmp_path):
    lines = v98_lines()
    file = written(tmp_path / "msx.dat", [lines[0], lines[1][:150], lines[2]])
    with pytest.raises(InputError) as error:
        ws.StarCatalog.read(file)
    assert str(error.value) == f"{file}: line 2: must have 186 bytes, got 150"


def test_format_names_a_survey_whose_layout_the_lines_do_not_follow(tmp_path):
    file = written(tmp_path / "stars.txt", ["hello", "world"])
    with pytest.raises(InputError) as error:
        ws.StarCatalog.read(file, format="msx-irac")
    assert str(error.value) == f"{file}: line 1: must have 186 bytes, got 5"


CUTS = [1, 21, 40, 140, 185, 186, 187, 300, 372, 373, 374, 500, 559, 560, 561]


@pytest.mark.parametrize("n_byte", CUTS)
@pytest.mark.parametrize("kind", ["v98", "v107"])
def test_cut_off_files_are_refused_or_end_with_a_row(tmp_path, kind, n_byte):
    lines = v98_lines() if kind == "v98" else [v107_line(*row) for row in psc_rows()]
    whole = ws.StarCatalog.read(written(tmp_path / "whole.dat", lines), fill=False)
    data = ("\n".join(lines) + "\n").encode()[:n_byte]
    file = tmp_path / ("msx.dat" if kind == "v98" else "lmc.dat")
    file.write_bytes(data)
    length = len(lines[0])
    try:
        part = ws.StarCatalog.read(file, fill=False)
    except InputError as error:
        text = str(error)
    else:
        text = ""
    if text:
        assert n_byte % (length + 1) not in (0, length)
        assert text.startswith(f"{file}: ")
        assert "\n" not in text
        return
    assert n_byte % (length + 1) in (0, length)  # at the end of a row, with or without its line break
    n_star = (n_byte + 1) // (length + 1)
    assert len(part) == n_star
    np.testing.assert_array_equal(part.ra_deg, whole.ra_deg[:n_star])
    for band in BANDS:
        np.testing.assert_array_equal(part.flux_jy(band), whole.flux_jy(band)[:n_star])


def test_a_gzip_file_cut_off_is_refused(tmp_path):
    data = gzip.compress(("\n".join(v98_lines()) + "\n").encode())
    for n_byte in (11, 60, len(data) - 1):
        file = tmp_path / "msx.dat.gz"
        file.write_bytes(data[:n_byte])
        with pytest.raises(InputError, match=r"msx\.dat\.gz: (ends early|cannot be unpacked)"):
            ws.StarCatalog.read(file)
