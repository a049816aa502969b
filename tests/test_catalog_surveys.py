"""Surveys to catalogs: columns as each archive spells them, against hand-computed fluxes, ERFA and astropy.

The zero points that a survey quotes fluxes with are written out again here, so that a slip in the product's shows.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import erfa
import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import Angle
from astropy.io import ascii as astropy_ascii
from astropy.table import MaskedColumn, Table

from warpsim.errors import InputError
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.photometric_bands import photometric_bands
from warpsim.sky.readers import infrared
from warpsim.sky.readers.read import SURVEYS
from warpsim.sky.readers.survey import epoch_of_position, position_deg, sexagesimal_deg
from warpsim.sky.stellar_templates import GIANT, colour, colour_temperature_k
from warpsim.tables.columns import ColumnTable

# Flux density of magnitude 0 [Jy]: MSX bands (Cohen, Hammersley and Egan 2000).
MSX_ZERO_JY = {"C": 26.51, "E": 8.80}

FLUX_RTOL = 1e-12  # the same few operations in another order
PLACE_ATOL_DEG = 1e-11  # text to double and back
FK4_ATOL_ARCSEC = 0.04  # astropy and ERFA take the E-terms and the motion of FK4 differently: 0.016 arcsec at most
# Published B1950 places are rounded to 0.1 s of time and 1 arcsec.
PUBLISHED_ATOL_ARCSEC = 2.0


def convert(name, table):
    return SimpleNamespace(**{"limit_jy": {}, **SURVEYS[name].convert(ColumnTable(table))})


def catalog_of(stars):
    """The stars as a reader would pass them on: every rule of from_arrays is checked."""
    columns = {key: value for key, value in vars(stars).items() if key not in ("ra_deg", "dec_deg", "flux_jy")}
    columns.pop("limit_jy"), columns.pop("notes")
    return StarCatalog.from_arrays(stars.ra_deg, stars.dec_deg, stars.flux_jy, **columns)


def msx_jy(band, magnitude):
    return MSX_ZERO_JY[band] * 10.0 ** (-0.4 * magnitude)


def band_jy(band, magnitude):
    return photometric_bands()[band].zero_mag_jy * 10.0 ** (-0.4 * np.asarray(magnitude))


def assert_magnitudes(stars, expected):
    assert stars.flux_jy.keys() == expected.keys()
    for band, magnitudes in expected.items():
        assert stars.flux_jy[band] == close(band_jy(band, magnitudes)), band


def assert_same(stars, expected):
    """Equal fluxes, quality and names."""
    for band, flux_jy in expected.flux_jy.items():
        assert np.isfinite(flux_jy).any()
        assert stars.flux_jy[band] == close(flux_jy), band
    assert stars.quality.tolist() == expected.quality.tolist()
    assert stars.id.tolist() == expected.id.tolist()


def magnitude(flux_jy, zero_jy):
    return -2.5 * math.log10(flux_jy / zero_jy)


def close(expected):
    return pytest.approx(expected, rel=FLUX_RTOL, nan_ok=True)


def separation_arcsec(ra_1_deg, dec_1_deg, ra_2_deg, dec_2_deg):
    return np.degrees(erfa.seps(*np.radians([ra_1_deg, dec_1_deg, ra_2_deg, dec_2_deg]))) * 3600.0


def columns(table, **units):
    for name, unit in units.items():
        table[name].unit = unit
    return table


# --- places ---


def test_sexagesimal_text_agrees_with_astropy():
    random = np.random.default_rng(7)
    ra = Angle(random.uniform(0.0, 360.0, 50) * u.deg)
    dec = Angle(np.append(random.uniform(-90.0, 90.0, 46), [-0.001, 0.001, -90.0, 90.0]) * u.deg)
    for sep in (" ", ":", "fromunit"):
        ra_text = ra.to_string(u.hourangle, sep=sep, precision=9, pad=True)
        dec_text = dec.to_string(u.deg, sep=sep, precision=9, pad=True, alwayssign=True)
        np.testing.assert_allclose(sexagesimal_deg(ra_text, "ra", hours=True), ra.deg, rtol=0, atol=PLACE_ATOL_DEG)
        np.testing.assert_allclose(sexagesimal_deg(dec_text, "dec", hours=False), dec.deg, rtol=0, atol=PLACE_ATOL_DEG)


@pytest.mark.parametrize(
    ("text", "hours", "expected_deg"),
    [
        ("-00 00 36", False, -0.01),
        ("-00 30", False, -0.5),
        ("+00:00:36", False, 0.01),
        ("213.9153", True, 213.9153),  # one number: degrees, also of right ascension
        ("14h", True, 210.0),
        ("10d30m", True, 10.5),
        ("-12.5", False, -12.5),
        ("23 59 60.0", True, 360.0),  # rounded seconds
        ("", True, math.nan),
        ("--", True, math.nan),
    ],
)
def test_sexagesimal_text_by_hand(text, hours, expected_deg):
    angle = sexagesimal_deg(np.array([text]), "x", hours)[0]
    assert angle == pytest.approx(expected_deg, abs=PLACE_ATOL_DEG, nan_ok=True)


@pytest.mark.parametrize("text", ["abc", "12 61 00", "1 2 3 4", "12 -30 00", "+-3", "12.5 30 00"])
def test_text_that_is_no_angle_is_an_error(text):
    with pytest.raises(InputError, match=r"RAJ2000: must be an angle .* in row 1$"):
        sexagesimal_deg(np.array(["1 2 3", text]), "RAJ2000", hours=True)


def test_parts_with_minus_zero_degrees():
    table = Table({
        "RAh": [0, 14, 23], "RAm": [0, 13, 59], "RAs": [1.5, 22.8, 59.9],
        "DE-": ["-", "+", "-"], "DEd": [0, 19, 0], "DEm": [0, 26, 30], "DEs": [36, 31, 0],
    })  # fmt: skip
    ra_deg, dec_deg, name = position_deg(ColumnTable(table))
    np.testing.assert_allclose(ra_deg, [1.5 / 240, 15 * (14 + 13 / 60 + 22.8 / 3600), 360 - 0.1 / 240], rtol=1e-14)
    np.testing.assert_allclose(dec_deg, [-0.01, 19 + 26 / 60 + 31 / 3600, -0.5], rtol=1e-14)
    assert name == "parts"


def test_parts_without_a_sign_column_take_it_from_the_degrees():
    table = Table({"RAh": [1], "RAm": [2.5], "DEd": [-12], "DEm": [30.0]})
    ra_deg, dec_deg, _ = position_deg(ColumnTable(table))
    assert (ra_deg[0], dec_deg[0]) == (pytest.approx(15.625), pytest.approx(-12.5))
    table = Table({"RAh": [1], "RAm": [2.5], "DEd": ["-00"], "DEm": [30.0]})
    assert position_deg(ColumnTable(table))[1][0] == pytest.approx(-0.5)


@pytest.mark.parametrize(("part", "value"), [("RAh", 25), ("RAm", 75), ("DEd", 91), ("DEs", 61)])
def test_parts_out_of_range_are_an_error(part, value):
    table = Table({"RAh": [1], "RAm": [2], "RAs": [3], "DE-": ["+"], "DEd": [4], "DEm": [5], "DEs": [6]})
    table[part][0] = value
    with pytest.raises(InputError, match=rf"^{part}: must be in \[-?\d+, \d+\], got {value} in row 0$"):
        position_deg(ColumnTable(table))


def test_places_honour_the_units_of_their_columns():
    table = columns(Table({"RAJ2000": [1.0], "DEJ2000": [-1800.0]}), RAJ2000="rad", DEJ2000="arcsec")
    ra_deg, dec_deg, _ = position_deg(ColumnTable(table))
    assert ra_deg[0] == pytest.approx(math.degrees(1.0), rel=1e-15)
    assert dec_deg[0] == pytest.approx(-0.5, rel=1e-15)


def test_a_table_without_places_is_an_error():
    with pytest.raises(InputError, match=r"^must have the columns of a position \(RAJ2000 and DEJ2000.*got S09$"):
        position_deg(ColumnTable(Table({"S09": [1.0]})))


def test_missing_parts_are_missing_places():
    table = Table({"RAh": [1], "RAm": [2], "RAs": MaskedColumn([3.0], mask=[True]), "DEd": [4], "DEm": [5]})
    assert np.isnan(position_deg(ColumnTable(table))[0][0])


def test_places_computed_by_vizier_are_at_2000():
    for name in ("_RAJ2000", "RAJ2000", "_RA.icrs", "_RA_icrs"):
        assert epoch_of_position(name, 1991.25) == 2000.0
    for name in ("RAICRS", "RAdeg", "RA_ICRS", "ra"):
        assert epoch_of_position(name, 1991.25) == 1991.25


# --- IRAS ---


def iras_table(**changes):
    """VizieR TAP of II/125: B1950 places as text."""
    return Table({
        "IRAS": ["14133+1925", "00000-0012", "06429-1639"],
        "RA1950": ["14 13 20.2", "00 00 00.0", "06 42 55.0"],
        "DE1950": ["+19 25 24", "-00 12 30", "-16 38 46"],
        "Fnu_12": [790.0, 2.83, 143.1], "Fnu_25": [184.0, 0.5, 33.9],
        "q_Fnu_12": [3, 2, 3], "q_Fnu_25": [3, 1, 3], "e_Fnu_12": [4, 12, 11], "e_Fnu_25": [5, 14, 4],
    } | changes)  # fmt: skip


def test_iras_fluxes_are_those_of_the_catalog():
    stars = convert("iras-psc", iras_table())
    assert stars.flux_jy["IRAS12"] == close([790.0, 2.83, 143.1])
    assert stars.flux_jy["IRAS25"] == close([184.0, math.nan, 33.9])
    assert not hasattr(stars, "flux_flag")
    assert stars.quality.tolist() == [4, 3, 3]
    assert stars.id.tolist()[0] == "IRAS 14133+1925"


def test_iras_gives_a_dustless_star_its_visible_magnitude():
    """Sirius: A1V, so the same magnitude, -1.4, from the visible to 25 um; IRAS is good to 5 % or so."""
    catalog = catalog_of(convert("iras-psc", iras_table())).filled()
    for band in ("IRAS12", "IRAS25", "C", "E", "A"):
        assert catalog.magnitude(band)[2] == pytest.approx(-1.38, abs=0.08), band


def test_iras_limits_never_become_fluxes():
    stars = convert("iras-psc", iras_table(q_Fnu_12=[1, 2, 3]))
    assert np.isnan(stars.flux_jy["IRAS12"][0])
    # At equal magnitude; 28.3 and 6.73 Jy are IRAS's zero points, 1.45 and 1.41 its colour corrections of 10,000 K.
    limit_c, limit_e = msx_jy("C", magnitude(790.0, 28.3 * 1.45)), msx_jy("E", magnitude(0.5, 6.73 * 1.41))
    assert stars.limit_jy["C"] == pytest.approx([limit_c, math.nan, math.nan], rel=1e-4, nan_ok=True)
    assert stars.limit_jy["E"] == pytest.approx([math.nan, limit_e, math.nan], rel=1e-4, nan_ok=True)
    assert stars.quality.tolist() == [4, 3, 3]  # of the first star, that of 25 um
    both = convert("iras-psc", iras_table(q_Fnu_12=[1, 1, 1], q_Fnu_25=[1, 1, 1]))
    assert both.quality.tolist() == [0, 0, 0]
    assert np.isnan(catalog_of(both).flux_jy("IRAS25")).all()
    assert np.isnan(catalog_of(both).filled().flux_jy("E")).all()


def test_iras_without_flags_is_an_error():
    table = iras_table()
    table.remove_column("q_Fnu_25")
    with pytest.raises(InputError, match=r"^must have the column q_Fnu_25 or fqual_25, got IRAS, "):
        convert("iras-psc", table)


def test_iras_places_against_erfa():
    """ERFA's own route: fk45z to FK5 at J2000 (no motion against inertial space), fk5hz to the Hipparcos frame."""
    random = np.random.default_rng(3)
    ra_deg, dec_deg = random.uniform(0, 360, 300), np.degrees(np.arcsin(random.uniform(-1, 1, 300)))
    found = infrared.icrs_of_b1950_deg(ra_deg, dec_deg)
    ra_fk5, dec_fk5 = erfa.fk45z(np.radians(ra_deg), np.radians(dec_deg), 1983.5)
    expected = erfa.fk5hz(ra_fk5, dec_fk5, *erfa.epj2jd(1983.5))
    separation = separation_arcsec(*found, *np.degrees(expected))
    assert separation.max() < FK4_ATOL_ARCSEC
    # What the test can tell apart: without the epoch of observation the places differ by more.
    assert separation_arcsec(*found, *infrared.icrs_of_b1950_deg(ra_deg, dec_deg, 1950.0)).max() > 2 * FK4_ATOL_ARCSEC


def test_iras_place_of_arcturus():
    """B1950 14 13 22.8 +19 26 31 at epoch 1950, moved by -1.093 and -1.999 arcsec/yr to 1983.5, is the first row."""
    stars = convert("iras-psc", iras_table())
    # Hipparcos: 213.9153003, 19.1824092 at J2000.
    years = 1983.5 - 2000.0
    dec_deg = 19.1824092 - 1.99938 * years / 3600.0
    ra_deg = 213.9153003 - 1.09339 * years / 3600.0 / math.cos(math.radians(dec_deg))
    assert separation_arcsec(stars.ra_deg[0], stars.dec_deg[0], ra_deg, dec_deg) < PUBLISHED_ATOL_ARCSEC
    assert any("B1950" in note for note in stars.notes)


def test_iras_spellings_agree():
    """The same stars from VizieR TAP (text and degrees), IRSA with its J2000, II/156 and the parts of the CDS."""
    text = convert("iras-psc", iras_table())
    ra_deg = [15 * (14 + 13 / 60 + 20.2 / 3600), 0.0, 15 * (6 + 42 / 60 + 55.0 / 3600)]
    dec_deg = [19 + 25 / 60 + 24 / 3600, -(12 / 60 + 30 / 3600), -(16 + 38 / 60 + 46 / 3600)]
    degrees = iras_table(RA1950=ra_deg, DE1950=dec_deg)
    irsa = Table({
        "pscname": degrees["IRAS"], "ra": text.ra_deg, "dec": text.dec_deg, "ra1950": ra_deg, "dec1950": dec_deg,
        "fnu_12": degrees["Fnu_12"], "fnu_25": degrees["Fnu_25"], "fqual_12": degrees["q_Fnu_12"],
        "fqual_25": degrees["q_Fnu_25"], "relunc_12": degrees["e_Fnu_12"], "relunc_25": degrees["e_Fnu_25"],
    })  # fmt: skip
    faint = degrees.copy()
    faint.rename_columns(
        ("RA1950", "DE1950", "Fnu_12", "Fnu_25", "q_Fnu_12", "q_Fnu_25"),
        ("RAdeg", "DEdeg", "Fnu12", "Fnu25", "q_Fnu12", "q_Fnu25"),
    )
    added = degrees.copy()  # by the web page of VizieR
    added["_RAJ2000"], added["_DEJ2000"] = text.ra_deg, text.dec_deg
    mjy = degrees.copy()
    for name in ("Fnu_12", "Fnu_25"):
        mjy[name] = mjy[name] * 1000.0
        mjy[name].unit = "mJy"
    for table in (degrees, irsa, faint, added, mjy):
        stars = convert("iras-psc", table)
        assert separation_arcsec(stars.ra_deg, stars.dec_deg, text.ra_deg, text.dec_deg).max() < 1e-6
        assert_same(stars, text)


IRAS_README = """\
II/125      IRAS catalogue of Point Sources, Version 2.0 (IPAC 1986)
================================================================================
Byte-by-byte Description of file: main.dat
--------------------------------------------------------------------------------
   Bytes Format  Units   Label    Explanations
--------------------------------------------------------------------------------
   1- 11  A11    ---     IRAS     Name
  12- 13  I2     h       RAh      Hours
  14- 15  I2     min     RAm      Minutes
  16- 18  I3     ds      RAds     Seconds
      19  A1     ---     DE-      Sign
  20- 21  I2     deg     DEd      Degrees
  22- 23  I2     arcmin  DEm      Minutes
  24- 25  I2     arcsec  DEs      Seconds
  37- 45  E9.3   Jy      Fnu_12   Flux density
  46- 54  E9.3   Jy      Fnu_25   Flux density
      73  I1     ---   q_Fnu_12   [1,3] Quality
      74  I1     ---   q_Fnu_25   [1,3] Quality
  81- 83  I3     %     e_Fnu_12   Uncertainty
  84- 86  I3     %     e_Fnu_25   Uncertainty
--------------------------------------------------------------------------------
"""


def test_iras_as_the_cds_file_splits_it(tmp_path):
    (tmp_path / "ReadMe").write_text(IRAS_README, encoding="ascii")
    source = iras_table()
    lines = []
    for name, ra, dec, f12, f25, q12, q25, e12, e25 in source.iterrows():
        place = f"{ra.replace(' ', '').replace('.', '')}{dec.replace(' ', '')}"
        fluxes = f"{f12:9.3E}{f25:9.3E}"
        lines.append(f"{name:11s}{place}{'':11s}{fluxes}{'':18s}{q12}{q25}{'':6s}{e12:3d}{e25:3d}")
    (tmp_path / "main.dat").write_text("\n".join(lines) + "\n", encoding="ascii")
    table = astropy_ascii.read(str(tmp_path / "main.dat"), format="cds", readme=str(tmp_path / "ReadMe"))
    stars, text = convert("iras-psc", table), convert("iras-psc", source)
    assert separation_arcsec(stars.ra_deg, stars.dec_deg, text.ra_deg, text.dec_deg).max() < 1e-6
    assert stars.flux_jy["IRAS12"] == close(text.flux_jy["IRAS12"])
    assert stars.quality.tolist() == text.quality.tolist()


# --- AKARI ---


def akari_table(**changes):
    """VizieR of II/297; nulls as the file has them."""
    return Table({
        "objID": [200000001, 200000002, 200000003, 200000004],
        "objName": ["0000000+000000", "0000001+000000", "0000002+000000", "0000003+000000"],
        "RAJ2000": [10.0, 20.0, 30.0, 40.0], "DEJ2000": [-1.0, 2.0, 3.0, -4.0],
        "S09": np.array([5.626, -999.9, 1.0, 2.0], dtype=np.float32),
        "S18": np.array([1.2, 12.0, -999.9, 3.0], dtype=np.float32),
        "e_S09": [0.05, -1000.0, 0.2, 0.1], "e_S18": [0.1, 0.1, -1000.0, 0.1],
        "q_S09": [3, 0, 3, 0], "q_S18": [3, 3, 0, 3], "f09": ["0", "0", "8", "0"], "f18": ["0", "1", "0", "9"],
    } | changes)  # fmt: skip


def test_akari_filters_are_bands():
    stars = convert("akari-irc", columns(akari_table(), S09="Jy", S18="Jy"))
    nan = math.nan
    assert stars.flux_jy["S9W"] == pytest.approx([5.626, nan, 1.0, nan], rel=1e-7, nan_ok=True)  # single precision
    assert stars.flux_jy["L18W"] == pytest.approx([1.2, 12.0, nan, 3.0], rel=1e-7, nan_ok=True)
    assert not hasattr(stars, "flux_flag")
    assert stars.quality.tolist() == [4, 4, 1, 1]  # 18 um counts where 9 um is missing; bit 8: edge of the image
    assert stars.id.tolist()[0] == "AKARI-IRC-V1 J0000000+000000"
    catalog = catalog_of(stars)
    assert catalog.flux_flag("S9W").tolist() == [1, 0, 1, 0]
    assert catalog.filled().flux_flag("D").tolist() == [3, 3, 3, 3]


def test_akari_fluxes_of_low_quality_are_counted():
    stars = convert("akari-irc", akari_table(q_S09=[3, 1, 2, 0], q_S18=[3, 1, 0, 2]))
    for band in ("S9W", "L18W"):
        assert np.isfinite(stars.flux_jy[band]).tolist() == [True] + [False] * 3
    assert stars.notes[-1] == "3 of 4 stars have no flux of quality 3, so no flux"


def test_akari_errors_and_units():
    plain = akari_table(S09=[5.0, 5.0, 5.0, 5.0], e_S09=[0.5, 0.51, -1000.0, 0.1], q_S09=[3, 3, 3, 3], f09=["0"] * 4)
    stars = convert("akari-irc", plain)
    assert stars.quality.tolist() == [4, 3, 3, 4]  # up to 10 % is excellent; unknown is not
    plain["S09"] = [5000.0] * 4
    plain["e_S09"] = [0.5, 0.51, 0.6, 0.1]
    columns(plain, S09="mJy", e_S09="Jy")
    again = convert("akari-irc", plain)
    assert again.flux_jy["S9W"] == close(stars.flux_jy["S9W"])
    assert again.quality.tolist() == [4, 3, 3, 4]


def test_akari_zero_flux_is_no_flux():
    with np.errstate(all="raise"):
        stars = convert("akari-irc", akari_table(S09=[0.0, -1.0, 1.0, 1.0], q_S09=[3, 3, 3, 3]))
    assert np.isnan(stars.flux_jy["S9W"][:2]).all()


# --- AllWISE ---


def allwise_table(**changes):
    """VizieR of II/328."""
    return Table({
        "AllWISE": [f"J00000{row}.00+000000.0" for row in range(6)],
        "RAJ2000": np.arange(6.0), "DEJ2000": np.arange(6.0) - 3.0,
        "W1mag": [6.0, 8.5, 9.0, 6.0, 6.0, 6.0], "W2mag": [6.0, 6.0, 6.0, 7.5, 6.0, 6.0],
        "W3mag": [5.0, 3.0, 8.0, 6.0, 7.0, 4.0], "W4mag": [4.0, 2.0, 7.0, 6.0, -1.0, 4.0],
        "Jmag": [6.0, 4.0, 9.0, 6.5, 8.0, 5.0],
        "Hmag": [5.2, 3.2, 8.2, 6.1, 7.2, 4.6], "Kmag": [5.0, 3.0, 8.0, 6.0, 7.0, 4.5],
        "e_Jmag": [0.1] * 6, "e_Hmag": [0.1] * 6, "e_Kmag": [0.1] * 6,
        "ccf": ["0000", "0000", "00d0", "00D0", "0000", "0000"],
        "qph": ["AAAA", "AAAA", "AAUU", "AABX", "AACA", "AAXZ"],
        "pmRA": [500] * 6, "pmDE": [-500] * 6,
    } | changes)  # fmt: skip


def test_allwise_uses_what_is_not_saturated():
    stars = convert("allwise", allwise_table())
    nan = math.nan
    expected = {
        "J": [6.0, 4.0, 9.0, 6.5, 8.0, 5.0],
        "H": [5.2, 3.2, 8.2, 6.1, 7.2, 4.6],
        "Ks": [5.0, 3.0, 8.0, 6.0, 7.0, 4.5],
        "W1": [nan, 8.5, 9.0, nan, nan, nan],
        "W2": [nan, nan, nan, 7.5, nan, nan],
        "W3": [5.0, 3.0, nan, 6.0, 7.0, nan],
        "W4": [4.0, 2.0, nan, nan, nan, nan],
    }
    assert_magnitudes(stars, expected)
    # Limits hold for predictions of the neighbouring MSX band, at equal magnitude.
    assert stars.limit_jy["C"] == close([nan, nan, msx_jy("C", 8.0), nan, nan, nan])
    assert stars.limit_jy["E"] == close([nan, nan, msx_jy("E", 7.0), nan, nan, nan])
    # Of W3; else of a prediction from shorter waves, which K alone would make uncertain where it is saturated.
    assert stars.quality.tolist() == [4, 4, 2, 1, 2, 2]
    assert not hasattr(stars, "pm_ra_mas_yr")
    assert any("motions" in note for note in stars.notes)
    assert "4 of 6 stars with W1 < 8 saturated, not used" in stars.notes
    catalog = catalog_of(stars)
    assert catalog.flux_flag("W3").tolist() == [1, 1, 0, 1, 1, 0]
    assert catalog.spectrum_temperature_k[0] == pytest.approx(float(colour_temperature_k(1.0, "J-K", GIANT)))


def test_allwise_limits_in_j_or_k_have_no_error():
    gap = [False, True] + [False] * 4
    no_w1 = {"W1mag": [6.0] * 6, "qph": ["AAXA"] * 6}
    table = allwise_table(e_Jmag=MaskedColumn([0.1] * 6, mask=gap), **no_w1)
    stars = convert("allwise", table)
    assert np.isnan(stars.flux_jy["J"][1])
    assert stars.quality[1] == 1  # K alone
    table["e_Hmag"] = table["e_Kmag"] = MaskedColumn([0.1] * 6, mask=gap)
    assert convert("allwise", table).quality[1] == 4  # of W4


def test_allwise_saturated_k_is_uncertain_without_w1_and_w2():
    stars = convert("allwise", allwise_table(W1mag=[6.0] * 6, W2mag=[6.0] * 6, W3mag=[5.0, 0.9, 8.0, 6.0, 7.0, 4.0]))
    assert stars.quality.tolist() == [4, 1, 2, 1, 2, 2]


def test_allwise_by_the_names_of_irsa():
    table = allwise_table()
    names = {
        "AllWISE": "designation", "RAJ2000": "ra", "DEJ2000": "dec", "W1mag": "w1mpro", "W2mag": "w2mpro",
        "W3mag": "w3mpro", "W4mag": "w4mpro", "Jmag": "j_m_2mass", "Hmag": "h_m_2mass", "Kmag": "k_m_2mass",
        "e_Jmag": "j_msig_2mass", "e_Hmag": "h_msig_2mass", "e_Kmag": "k_msig_2mass", "ccf": "cc_flags",
        "qph": "ph_qual", "pmRA": "pmra", "pmDE": "pmdec",
    }  # fmt: skip
    vizier = convert("allwise", table)
    table.rename_columns(tuple(names), tuple(names.values()))
    irsa = convert("allwise", columns(table, ra="deg", dec="deg", w3mpro="mag"))
    assert_same(irsa, vizier)


# --- Hipparcos ---


def v_minus_ic(v_minus_i, luminosity):
    """V-Ic of the template that has a V-I as Hipparcos lists it."""
    kelvin = colour_temperature_k(np.array([v_minus_i]), "V-I", np.array([luminosity]))
    found = float(colour("V", "Ic", np.array([luminosity]), kelvin)[0])
    assert found == pytest.approx(v_minus_i, abs=0.12)
    return found


def hipparcos_table(**changes):
    """I/239 by its ReadMe; the last star has no solution, so no RAdeg."""
    gap = [False, False, False, True]
    return Table({
        "HIP": [1, 2, 3, 55],
        "RAhms": ["00 00 00.22", "00 00 00.91", "00 00 01.20", "00 00 36.00"],
        "DEdms": ["+01 05 20.4", "-19 29 55.8", "+38 51 33.4", "-00 00 36.0"],
        "Vmag": [9.10, 9.27, 6.61, 8.0],
        "RAdeg": MaskedColumn([0.00091185, 0.00379738, 0.00500795, 0.0], mask=gap),
        "DEdeg": MaskedColumn([1.08901332, -19.49883745, 38.85928608, 0.0], mask=gap),
        "Plx": MaskedColumn([3.54, 21.90, 2.81, 0.0], mask=gap),
        "pmRA": MaskedColumn([-5.20, 181.21, 5.24, 0.0], mask=gap),
        "pmDE": MaskedColumn([-1.88, -0.93, -2.91, 0.0], mask=gap),
        "B-V": MaskedColumn([0.482, 0.999, 1.6, 0.0], mask=gap),
        "V-I": MaskedColumn([0.55, 0.0, 0.0, 0.0], mask=[False, False, True, True]),
        "Hpmag": [9.2043, 9.4017, 6.6081, 8.1],
    } | changes)  # fmt: skip


def test_hipparcos():
    stars = convert("hipparcos", hipparcos_table())
    assert stars.ra_deg == pytest.approx([0.00091185, 0.00379738, 0.00500795, 0.15], abs=PLACE_ATOL_DEG)
    assert stars.dec_deg == pytest.approx([1.08901332, -19.49883745, 38.85928608, -0.01], abs=PLACE_ATOL_DEG)
    nan = math.nan
    expected = {
        "Hp": [9.2043, 9.4017, 6.6081, 8.1],
        "V": [9.10, 9.27, 6.61, 8.0],
        "B": [9.582, 10.269, 8.21, nan],
        # V-I as listed tells the template, which tells V-Ic; a few hundredths apart.
        "Ic": [9.10 - v_minus_ic(0.55, 1), 9.27 - v_minus_ic(0.0, 1), nan, nan],
    }
    assert_magnitudes(stars, expected)
    # The colours of the second contradict each other, the third's B-V says little, the last has no colour.
    assert stars.quality.tolist() == [2, 1, 1, 1]
    assert stars.id.tolist() == ["HIP 1", "HIP 2", "HIP 3", "HIP 55"]
    assert stars.pm_ra_mas_yr[:3] == close([-5.20, 181.21, 5.24])
    catalog = catalog_of(stars)
    assert catalog.pm_ra_mas_yr[3] == 0.0
    assert catalog.parallax_mas[:3] == close([3.54, 21.90, 2.81])
    assert "1 of 4 stars have no colour" in stars.notes
    assert "1 of 4 stars have B-V as their only colour" in stars.notes


def test_hipparcos_with_units_and_other_places():
    table = hipparcos_table()
    table["pmRA"] = table["pmRA"] / 1000.0
    columns(table, pmRA="arcsec / yr", Plx="mas")
    assert convert("hipparcos", table).pm_ra_mas_yr[1] == pytest.approx(181.21)
    table.remove_columns(["RAdeg", "DEdeg"])  # as VizieR lists them by default: text, and degrees at 2000.0
    assert convert("hipparcos", table).ra_deg[0] == pytest.approx(15 * 0.22 / 3600)
    table.remove_columns(["RAhms", "DEdms"])
    table["_RAJ2000"], table["_DEJ2000"] = [1.0] * 4, [2.0] * 4
    assert convert("hipparcos", table).epoch_jyear == 2000.0


def test_hipparcos_distrusts_v_minus_i_of_faint_red_dwarfs():
    """Proxima Centauri: a dwarf of absolute magnitude 15 at whatever V-I."""
    changes = {"Hpmag": [10.76] * 4, "Vmag": [11.01] * 4, "B-V": [1.807] * 4, "V-I": [3.62, 2.0, 1.5, 1.2]}
    stars = convert("hipparcos", hipparcos_table(Plx=[772.3] * 4, **changes))
    assert stars.luminosity.tolist() == [0] * 4
    np.testing.assert_allclose(stars.temperature_k[:3], stars.temperature_k[0])
    assert 2700 < stars.temperature_k[0] < 3100
    assert np.isnan(stars.flux_jy["Ic"]).tolist() == [True, True, True, False]
    assert stars.quality.tolist()[:3] == [1, 1, 1]
    assert "3 of 4 stars have a guessed V-I: temperature from the absolute magnitude" in stars.notes


def hipparcos_2_table(**changes):
    """I/311: radians; 0 stands for a colour that is missing."""
    return Table({
        "HIP": [1, 2, 3], "RArad": [1.59148e-5, 3.0, 6.2], "DErad": [0.01900680, -1.5, 0.67821],
        "Plx": [4.55, 20.85, 2.26], "pmRA": [-4.55, 179.7, 6.37], "pmDE": [-2.29, 1.2, -3.22],
        "Hpmag": [9.2043, 9.4017, 6.6081], "B-V": [0.482, 0.999, 0.0], "V-I": [0.55, 0.0, 0.0],
    } | changes)  # fmt: skip


def test_hipparcos_2_reads_radians_and_zeros():
    stars = convert("hipparcos-2", hipparcos_2_table())
    assert stars.ra_deg == close([math.degrees(x) for x in (1.59148e-5, 3.0, 6.2)])
    assert stars.dec_deg == close([math.degrees(x) for x in (0.01900680, -1.5, 0.67821)])
    assert stars.flux_jy["Hp"] == close(band_jy("Hp", [9.2043, 9.4017, 6.6081]))
    # Hipparcos-1 has V = 9.10, 9.27 and 6.61 of these; without a colour Hp stands for V.
    v_mag = -2.5 * np.log10(stars.flux_jy["V"] / band_jy("V", 0.0))
    assert v_mag == pytest.approx([9.10, 9.27, 6.61], abs=0.015)
    assert stars.flux_jy["B"] == close(band_jy("B", v_mag + np.array([0.482, 0.999, math.nan])))
    assert stars.flux_jy["Ic"] == close(band_jy("Ic", v_mag - [v_minus_ic(0.55, 1), math.nan, math.nan]))
    assert stars.quality.tolist() == [2, 2, 1]
    assert len(catalog_of(stars)) == 3


def test_hipparcos_2_in_degrees_with_and_without_unit():
    """VizieR exports degrees under the names of radians; CSV then loses the unit."""
    radians = convert("hipparcos-2", hipparcos_2_table())
    degrees = hipparcos_2_table(RArad=radians.ra_deg, DErad=radians.dec_deg)
    for table in (degrees, columns(degrees.copy(), RArad="deg", DErad="deg")):
        assert convert("hipparcos-2", table).ra_deg == close(radians.ra_deg)
    stated = columns(hipparcos_2_table(), RArad="rad", DErad="rad")
    assert convert("hipparcos-2", stated).dec_deg == close(radians.dec_deg)


def test_hipparcos_2_through_fits(tmp_path):
    """FITS turns B-V into a legal name as it is, VOTable into B_V; both are found."""
    radians = convert("hipparcos-2", hipparcos_2_table())
    for name, format in (("a.fits", "fits"), ("a.vot", "votable"), ("a.ecsv", "ascii.ecsv")):
        columns(hipparcos_2_table(), RArad="rad", DErad="rad", pmRA="mas / yr", Plx="mas", Hpmag="mag").write(
            tmp_path / name, format=format
        )
        stars = convert("hipparcos-2", Table.read(tmp_path / name, format=format))
        assert_same(stars, radians)
        assert stars.dec_deg == close(radians.dec_deg)


# --- Gaia ---


def gaia_table(**changes):
    """gaia_source of the Gaia archive, DR3."""
    gap = [False, False, True, False]
    return Table({
        "source_id": np.array([4295806720, 38655544960, 5853498713190525696, 7], dtype=np.int64),
        "ref_epoch": [2016.0] * 4, "ra": [44.99, 45.00, 217.39, 1.0], "dec": [0.005, -0.02, -62.67, 2.0],
        "pmra": MaskedColumn([-3.4, 6.9, -3781.7, 0.0], mask=[False, False, False, True]),
        "pmdec": MaskedColumn([-1.2, -7.0, 769.5, 0.0], mask=[False, False, False, True]),
        "parallax": MaskedColumn([1.3, -0.4, 768.1, 0.0], mask=[False, False, False, True]),
        "phot_g_mean_mag": [3.0, 8.0, 9.0, 7.0],
        "phot_bp_mean_mag": MaskedColumn([3.5, 8.5, 11.4, 12.0], mask=gap),
        "phot_rp_mean_mag": MaskedColumn([2.5, 7.5, 7.6, 4.0], mask=gap),
        "bp_rp": MaskedColumn([1.0, 1.0, 3.8, 8.0], mask=gap),
    } | changes)  # fmt: skip


def test_gaia():
    stars = convert("gaia", gaia_table())
    expected = {"G": [3.0, 8.0, 9.0, 7.0], "BP": [3.5, 8.5, math.nan, 12.0], "RP": [2.5, 7.5, math.nan, 4.0]}
    assert_magnitudes(stars, expected)
    assert stars.quality.tolist() == [1, 2, 1, 1]  # saturated, fair, no colour, redder than any star
    assert stars.id.tolist()[2] == "Gaia 5853498713190525696"
    assert stars.notes == ("1 of 4 stars have no BP-RP, so no colour",)
    catalog = catalog_of(stars)
    assert len(catalog) == 4
    assert catalog.pm_ra_mas_yr.tolist() == [-3.4, 6.9, -3781.7, 0.0]
    assert np.isnan(catalog.parallax_mas[3])
    assert catalog.flux_flag("BP").tolist() == [1, 1, 0, 1]
    assert catalog.filled().flux_flag("A").tolist() == [3, 3, 3, 3]
    # Parallaxes of 1.3 and -0.4 mas, and motions as small, make both giants.
    assert catalog.spectrum_luminosity[:2].tolist() == [1, 1]
    assert catalog.spectrum_temperature_k[:2] == pytest.approx([float(colour_temperature_k(1.0, "BP-RP", GIANT))] * 2)


def test_gaia_by_the_names_of_vizier():
    archive = convert("gaia", gaia_table())
    table = gaia_table()
    table.remove_columns(["ref_epoch", "bp_rp"])  # the colour follows from BP and RP
    table.rename_columns(
        ("source_id", "ra", "dec", "pmra", "pmdec", "parallax"),
        ("Source", "RA_ICRS", "DE_ICRS", "pmRA", "pmDE", "Plx"),
    )
    table.rename_columns(
        ("phot_g_mean_mag", "phot_bp_mean_mag", "phot_rp_mean_mag"),
        ("Gmag", "BPmag", "RPmag"),
    )
    vizier = convert("gaia", columns(table, RA_ICRS="deg", Gmag="mag", pmRA="mas / yr", Plx="mas"))
    for key in ("ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "parallax_mas", "quality"):
        np.testing.assert_array_equal(getattr(vizier, key), getattr(archive, key))
    for band, flux_jy in archive.flux_jy.items():
        assert vizier.flux_jy[band] == close(flux_jy)
    assert vizier.epoch_jyear == 2016.0


def test_gaia_with_the_colour_alone():
    """BP and RP follow from G and BP-RP: a star of colour 0, HIP 1 and Proxima Centauri (DR3)."""
    g, bp, rp = np.array([[8.0, 8.0, 8.0], [9.00, 9.22, 8.62], [8.985, 11.373, 7.569]]).T
    table = gaia_table()[:3]
    table["phot_g_mean_mag"], table["bp_rp"] = g, bp - rp
    table.remove_columns(["phot_bp_mean_mag", "phot_rp_mean_mag"])
    stars = convert("gaia", table)
    found = [-2.5 * np.log10(stars.flux_jy[band] / band_jy(band, 0.0)) for band in ("BP", "RP")]
    np.testing.assert_allclose(found[0] - found[1], bp - rp, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found[1], rp, rtol=0, atol=0.03)  # scatter of the relation for red stars
    assert "3 of 3 stars have no BP or RP: from G and BP-RP" in stars.notes
    assert stars.quality.tolist() == [2, 2, 1]  # the last is redder than what the templates are sure of


def test_gaia_epochs():
    assert convert("gaia", gaia_table(ref_epoch=[2015.5] * 4)).epoch_jyear == 2015.5
    with pytest.raises(InputError, match=r"^ref_epoch: must be the same in all rows, got 2015.5 and 2016$"):
        convert("gaia", gaia_table(ref_epoch=[2016.0, 2015.5, 2016.0, 2016.0]))
    table = gaia_table()
    table.remove_column("ref_epoch")
    assert convert("gaia", table).epoch_jyear == 2016.0
    table["designation"] = [f"Gaia DR2 {source}" for source in table["source_id"]]
    stars = convert("gaia", table)
    assert stars.epoch_jyear == 2015.5
    assert stars.id.tolist()[3] == "Gaia DR2 7"
    table.remove_column("designation")
    table.meta["name"] = "I/345/gaia2"
    stars = convert("gaia", table)
    assert (stars.epoch_jyear, stars.notes[-1]) == (2015.5, "of DR2 by its header")
    table.rename_columns(("ra", "dec"), ("RAJ2000", "DEJ2000"))  # moved there by the CDS
    assert convert("gaia", table).epoch_jyear == 2000.0


def test_an_empty_table_is_legal():
    for name, table in (
        ("gaia", gaia_table()), ("iras-psc", iras_table()), ("akari-irc", akari_table()),
        ("allwise", allwise_table()), ("hipparcos", hipparcos_table()), ("hipparcos-2", hipparcos_2_table()),
        ("2mass", twomass_table()),
    ):  # fmt: skip
        assert len(catalog_of(convert(name, table[:0]))) == 0


# --- 2MASS ---


def twomass_table(**changes):
    """VizieR of II/246."""
    return Table({
        "RAJ2000": np.arange(6.0), "DEJ2000": -np.arange(6.0),
        "2MASS": [f"0000000+00000{row}" for row in range(6)],
        "Jmag": [6.0, 4.0, 9.0, 6.5, 8.0, 9.0],
        "Hmag": [5.2, 3.2, 8.2, 6.1, 7.2, 6.8], "Kmag": [5.0, 3.0, 8.0, 6.0, 7.0, 6.0],
        "Qflg": ["AAA", "DDD", "UAA", "AAU", "AAE", "AAA"], "Cflg": ["000", "000", "000", "000", "000", "0d0"],
    } | changes)  # fmt: skip


def test_twomass():
    stars = convert("2mass", twomass_table())
    nan = math.nan
    expected = {
        "J": [6.0, 4.0, nan, 6.5, 8.0, 9.0],
        "H": [5.2, 3.2, 8.2, 6.1, 7.2, 6.8],
        "Ks": [5.0, 3.0, 8.0, nan, 7.0, 6.0],
    }
    assert_magnitudes(stars, expected)
    assert stars.quality.tolist() == [2, 1, 1, 1, 1, 2]  # fair, saturated, limits, poor fit, fair
    assert stars.id.tolist()[0] == "2MASS J0000000+000000"
    assert stars.notes == ("2 of 6 stars were not measured in both J and K, so have no colour",)
    assert catalog_of(stars).flux_flag("Ks").tolist() == [1, 1, 1, 0, 1, 1]
    assert catalog_of(stars).spectrum_temperature_k[0] == pytest.approx(float(colour_temperature_k(1.0, "J-K", GIANT)))


def test_twomass_without_h_or_any_flux():
    table = twomass_table(Qflg=["UUU", "AAA", "AUA", "AAA", "AAA", "AAA"])
    stars = convert("2mass", table)
    assert np.isnan(stars.flux_jy["H"][:3]).tolist() == [True, False, True]
    assert stars.quality[0] == 0
    assert stars.notes[-1] == "1 of 6 stars were not measured, so have no flux"
    table.remove_column("Hmag")
    assert np.isnan(convert("2mass", table).flux_jy["H"]).all()


def test_twomass_artefacts_count_in_j_and_k_only():
    stars = convert("2mass", twomass_table(Cflg=["0c0", "000", "000", "000", "000", "000"]))
    assert stars.quality[0] == 2
    for flags in ("c00", "00d"):
        assert convert("2mass", twomass_table(Cflg=[flags] + ["000"] * 5)).quality[0] == 1


def test_twomass_from_irsa_as_csv(tmp_path):
    vizier = convert("2mass", twomass_table())
    table = twomass_table()
    table.rename_columns(
        ("RAJ2000", "DEJ2000", "2MASS", "Jmag", "Hmag", "Kmag", "Qflg", "Cflg"),
        ("ra", "dec", "designation", "j_m", "h_m", "k_m", "ph_qual", "cc_flg"),
    )
    table["cc_flg"] = ["000"] * 6  # which CSV reads as the number 0
    table.write(tmp_path / "a.csv", format="ascii.csv")
    irsa = convert("2mass", Table.read(tmp_path / "a.csv", format="ascii.csv"))
    assert_same(irsa, vizier)


def test_limits_cannot_pass_for_measurements_where_the_flags_are_missing():
    for name, make, flag in (("2mass", twomass_table, "Qflg"), ("allwise", allwise_table, "qph")):
        table = make()
        table.remove_column(flag)
        with pytest.raises(InputError, match=rf"^must have the column {flag} or (Qfl or )?ph_qual, got "):
            convert(name, table)


# --- every survey: epoch and bands ---


def msx_table(*names):
    columns = {name: [1.0] for name in ("RAJ2000", "DEJ2000", *names)}
    return Table(columns | {name: [4] for name in names if name.startswith("q_")})


def irac_table():
    return msx_table("FSIIIA", "FSIIIB1", "FSIIIB2", "FSIIIC", "FSIIID", "FSIIIE", "Vmag", "pmRA", "pmDE")


def psc_table():
    return msx_table("B1", "q_B1", "B2", "q_B2", "A", "q_A", "C", "q_C", "D", "q_D", "E", "q_E")


MSX = {"A", "B1", "B2", "C", "D", "E"}
EPOCHS_AND_BANDS = {
    "msx-irac": (irac_table, 2000.0, {*MSX, "V"}),
    "msx-psc": (psc_table, 1996.6, MSX),
    "msx-psc-v1": (psc_table, 1996.6, MSX),
    "iras-psc": (iras_table, 1983.5, {"IRAS12", "IRAS25"}),
    "akari-irc": (akari_table, 2007.0, {"S9W", "L18W"}),
    "allwise": (allwise_table, 2010.5, {"J", "H", "Ks", "W1", "W2", "W3", "W4"}),
    "2mass": (twomass_table, 2000.0, {"J", "H", "Ks"}),
    "hipparcos": (hipparcos_table, 1991.25, {"Hp", "V", "B", "Ic"}),
    "hipparcos-2": (hipparcos_2_table, 1991.25, {"Hp", "V", "B", "Ic"}),
    "gaia": (gaia_table, 2016.0, {"G", "BP", "RP"}),
}


def test_no_survey_is_left_out():
    assert EPOCHS_AND_BANDS.keys() == SURVEYS.keys()


@pytest.mark.parametrize("name", EPOCHS_AND_BANDS)
def test_the_epoch_and_the_bands_of_a_survey(name):
    make, epoch_jyear, bands = EPOCHS_AND_BANDS[name]
    stars = convert(name, make())
    assert stars.epoch_jyear == epoch_jyear
    assert stars.flux_jy.keys() == bands
    assert all(band in photometric_bands() for band in bands)


# --- recognition ---


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (iras_table, "iras-psc"),
        (akari_table, "akari-irc"),
        (allwise_table, "allwise"),
        (hipparcos_table, "hipparcos"),
        (hipparcos_2_table, "hipparcos-2"),
        (gaia_table, "gaia"),
        (twomass_table, "2mass"),
    ],
)
def test_each_survey_is_known_by_its_columns(make, name):
    table = ColumnTable(make())
    assert [survey.name for survey in SURVEYS.values() if survey.fits(table)] == [name]


def test_masked_text_is_missing_text():
    """VOTable gives text as objects: a masked place is no place, and no error."""
    texts = MaskedColumn(["10 00 00", "10 00 00"], mask=[False, True], dtype=object)
    table = Table({"RAJ2000": texts, "DEJ2000": [1.0, 2.0]})
    ra_deg, _, _ = position_deg(ColumnTable(table))
    assert ra_deg[0] == pytest.approx(150.0)
    assert np.isnan(ra_deg[1])


# --- limits at which the readers change their mind, each from both sides, through files ---


@pytest.fixture
def read(tmp_path):
    def do(text, name="x.csv", **options):
        (tmp_path / name).write_text(text)
        return StarCatalog.read(tmp_path / name, **options)

    return do


def test_gaia_saturates_at_magnitude_3_5(read):
    catalog = read("ra,dec,phot_g_mean_mag,bp_rp\n1,2,3.45,1\n1,2,3.5,1\n1,2,3.55,1\n")
    assert catalog.quality.tolist() == [1, 1, 2]


def test_2mass_saturates_at_k_4_and_its_letters_count(read):
    rows = [("3.9", "AAA"), ("4.1", "AAA"), ("5", "AAX"), ("5", "AAU"), ("5", "AAF"), ("5", "AAE"), ("5", "XAA")]
    text = "2MASS,RAJ2000,DEJ2000,Jmag,Hmag,Kmag,Qflg\n"
    catalog = read(text + "".join(f"s,1,2,{float(k) + 0.5},{k},{k},{flags}\n" for k, flags in rows))
    assert catalog.quality.tolist() == [1, 2, 1, 1, 1, 1, 1]  # with J or K alone there is no colour
    assert [int(flag) for flag in catalog.flux_flag("Ks")] == [1, 1, 3, 3, 1, 1, 1]
    assert [int(flag) for flag in catalog.flux_flag("J")] == [1, 1, 1, 1, 1, 1, 3]


def test_wise_saturates_at_its_limits(read):
    rows = [(7.95, 7.05, 0.95, 2.0), (8.05, 6.95, 1.05, 2.0), (9.0, 9.0, 5.0, -0.45), (9.0, 9.0, 5.0, -0.35)]
    text = "designation,ra,dec,w1mpro,w2mpro,w3mpro,w4mpro,ph_qual\n"
    catalog = read(text + "".join(f"s,1,2,{w1},{w2},{w3},{w4},AAAA\n" for w1, w2, w3, w4 in rows), fill=False)
    assert catalog.flux_flag("W1").tolist() == [0, 1, 1, 1]
    assert catalog.flux_flag("W2").tolist() == [1, 0, 1, 1]
    assert catalog.flux_flag("W3").tolist() == [0, 1, 1, 1]
    assert catalog.flux_flag("W4").tolist() == [1, 1, 0, 1]


@pytest.mark.parametrize(("letter", "quality"), [("A", 4), ("B", 3), ("C", 2), ("X", 0), ("Z", 0)])
def test_wise_letters(read, letter, quality):
    catalog = read(f"designation,ra,dec,w3mpro,w4mpro,ph_qual\ns,1,2,5.0,4.0,AA{letter}X\n", fill=False)
    assert catalog.quality[0] == quality
    assert catalog.flux_flag("W3")[0] == (quality > 0)


@pytest.mark.parametrize(("dec", "degrees"), [("1.5", False), ("1.6", True), ("-1.6", True)])
def test_i311_beyond_half_pi_is_in_degrees(read, dec, degrees):
    catalog = read(f"HIP,RArad,DErad,Hpmag,V-I,B-V,pmRA,pmDE\n1,0.5,{dec},5.0,0.8,0.7,0,0\n")
    assert catalog.dec_deg[0] == pytest.approx(float(dec) if degrees else np.degrees(float(dec)), abs=1e-12)


def test_akari_takes_quality_3_only(read):
    text = "objID,RAJ2000,DEJ2000,S09,q_S09,S18,q_S18\n1,1,2,5,2,3,3\n2,1,2,5,3,3,2\n"
    catalog = read(text, fill=False)
    assert catalog.flux_flag("S9W").tolist() == [0, 1]
    assert catalog.flux_flag("L18W").tolist() == [1, 0]


def test_limits_belong_to_their_rows_when_others_are_left_out(read):
    """The first star has no place; the limit that bounds the second's A is its own."""
    header = "MSX6C\tRAJ2000\tDEJ2000\tA\tq_A\tC\tq_C\n"
    rows = "a\t\t\t0.001\t1\t1.0\t4\nb\t10.0\t20.0\t0.5\t1\t1.0\t4\nc\t11.0\t21.0\t50.0\t1\t1.0\t4\n"
    with pytest.warns(UserWarning, match=r"left out 1 of 3 stars without a finite position \(lines 2\)"):
        catalog = read(header + rows, "x.tsv")
    free = 58.49 / 26.51 * 1.0  # by equal magnitude, nearly: a K giant
    assert catalog.flux_jy("A")[0] == 0.5
    assert catalog.flux_jy("A")[1] == pytest.approx(free, rel=0.03)
    assert catalog.flux_flag("A").tolist() == [3, 3]


def test_a_measured_band_of_low_quality_is_none(read):
    header = "MSX6C\tRAJ2000\tDEJ2000\tA\tq_A\tC\tq_C\tD\tq_D\n"
    catalog = read(header + "b\t10.0\t20.0\t0.5\t0\t0\t4\t2.0\t2\n", "x.tsv", fill=False)
    assert [catalog.flux_flag(band)[0] for band in "ACD"] == [0, 0, 1]
    assert catalog.quality[0] == 2
