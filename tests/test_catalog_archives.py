"""Files in the exact layouts in which archives give them, with the number that each must give.

Each stands for files that were once read wrongly without a word, or refused without need: names that collide, units and
flags that got lost, tables in pieces.
"""

import io
import warnings

import numpy as np
import pytest
from astropy.io import fits
from astropy.table import MaskedColumn, Table

import warpsim as ws
from warpsim.radiometry.band import Band
from warpsim.render.device_stars import load_catalog
from warpsim.sky.photometric_bands import photometric_bands, sloan_g
from warpsim.sky.stellar_templates import GIANT, band_nodes

PLACE_ATOL_DEG = 1e-10
FLUX_RTOL = 1e-12

COLUMNS = {"ra_deg": "a", "dec_deg": "b", "flux_A_jy": "c"}


@pytest.fixture
def read(tmp_path):
    """Read a text or bytes as a file."""

    def do(content, name="x.csv", **options):
        file = tmp_path / name
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        return ws.StarCatalog.read(file, **options)

    return do


def refused(read, *arguments, **options):
    with pytest.raises(ws.InputError) as caught:
        read(*arguments, **options)
    text = str(caught.value)
    assert "\n" not in text
    return text.split(": ", 1)[1]


def flux_jy(band, magnitude):
    return photometric_bands()[band].zero_mag_jy * 10.0 ** (-0.4 * np.asarray(magnitude))


# --- Sloan's g and Gaia's G ---

M_DWARF = "RAJ2000,DEJ2000,{}\n10,20,{}\n"


def test_sloans_g_is_not_gaias(read):
    """An M dwarf with g = 16.53 and G = 14.70: taken for G, g is 1.83 mag too faint."""
    both = read(M_DWARF.format("gmag,rmag,imag,Gmag,BPmag,RPmag", "16.53,15.1,13.5,14.70,15.9,13.4"))
    alone = read(M_DWARF.format("Gmag,BPmag,RPmag", "14.70,15.9,13.4"))
    assert both.flux_jy("G")[0] == pytest.approx(flux_jy("G", 14.70), rel=FLUX_RTOL)
    for band in "VA":
        assert both.irradiance_w_cm2(band).tolist() == alone.irradiance_w_cm2(band).tolist()


def test_gaias_names_in_small_letters_are_gaias(read):
    catalog = read(M_DWARF.format("gmag,bpmag,rpmag", "14.70,15.9,13.4"))
    assert catalog.flux_jy("G")[0] == pytest.approx(flux_jy("G", 14.70), rel=FLUX_RTOL)


@pytest.mark.parametrize("names", ["gmag,rmag,imag,BPmag,RPmag", "GMAG,RMAG,IMAG,BPMAG,RPMAG"])
def test_sloans_g_alone_is_refused_and_named(read, names):
    text = refused(read, M_DWARF.format(names, "16.53,15.1,13.5,15.9,13.4"))
    assert text.startswith("looks like gaia, which must have the column phot_g_mean_mag or Gmag, got ")
    assert f"{names[:4]} (Sloan's, not Gaia's)" in text


def test_sloans_g_by_warpsims_names(read):
    text = "ra_deg,dec_deg,mag_g,mag_r\n10,20,16.53,15.1\n"
    assert "mag_g (Sloan's, not Gaia's)" in refused(read, text)
    mapped = read(text, columns={"mag_G": "mag_g", "mag_RP": "mag_r"})  # whoever says so has it so
    assert mapped.flux_jy("G")[0] == pytest.approx(flux_jy("G", 16.53), rel=FLUX_RTOL)
    with_unit = read(text, columns={"mag_G": "mag_g [mag]"})
    assert with_unit.flux_jy("G")[0] == pytest.approx(flux_jy("G", 16.53), rel=FLUX_RTOL)


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (("g", "r", "i"), ["g"]),
        (("gmag", "imag"), ["gmag"]),
        (("g_mag", "r_mag"), ["g_mag"]),
        (("flux_g_jy", "flux_r_jy"), ["flux_g_jy"]),
        (("MAG_G", "MAG_I"), ["MAG_G"]),
        (("Gmag", "rmag", "imag"), []),  # Gaia's by its capital
        (("Gmag", "Rmag", "Imag"), []),  # and Johnson's or Cousins' R and I
        (("gmag", "bp_rp"), []),
        (("gmag", "Rmag"), []),
        (("mag_G", "mag_r"), []),
    ],
)
def test_case_and_neighbours_tell_sloans_g(names, found):
    assert sloan_g(names) == found


# --- Gaia's releases ---

BARNARD = "269.44850,4.73942,-802.8,10362.5,8.2,2.8"
MOTION_DEG = 10362.5 / 3.6e6


def gaia_csv(more="", value=""):
    return f"ra,dec,pmra,pmdec,phot_g_mean_mag,bp_rp{more}\n{BARNARD}{value}\n"


def gaia_tsv(header, ra="RA_ICRS", dec="DE_ICRS"):
    rows = BARNARD.replace(",", "\t")
    return f"{header}\n{ra}\t{dec}\tpmRA\tpmDE\tGmag\tBP-RP\n \t \t \t \t \t \n---\t---\t---\t---\t---\t---\n{rows}\n"


def gaia_fits(**header):
    values = [np.array([float(text)]) for text in BARNARD.split(",")]
    table = Table(values, names=["RA_ICRS", "DE_ICRS", "pmRA", "pmDE", "Gmag", "BP-RP"])
    hdu = fits.BinTableHDU(table)
    hdu.header.update(header)
    buffer = io.BytesIO()
    fits.HDUList([fits.PrimaryHDU(), hdu]).writeto(buffer)
    return buffer.getvalue()


def gaia_votable(frame):
    table = Table(
        [np.array([float(text)]) for text in BARNARD.split(",")], names=["ra", "dec", "pmra", "pmdec", "Gmag", "bp_rp"]
    )
    buffer = io.BytesIO()
    table.write(buffer, format="votable")
    return buffer.getvalue().replace(b"<TABLE", frame.encode() + b"<TABLE", 1)


DR2 = {
    "frame of VizieR's text": (gaia_tsv("#Coosys\tH_2015.500:\tICRS"), "x.tsv"),
    "CDS number": (gaia_tsv("#Name: I/345/gaia2"), "x.tsv"),
    "name of a table": (gaia_tsv("#Table\tI_345_gaia2:"), "x.tsv"),
    "frame of a VOTable": (gaia_votable('<COOSYS ID="C" system="ICRS" epoch="J2015.5"/>'), "x.vot"),
    "frame of VizieR's VOTable": (gaia_votable('<COOSYS ID="H_2015.500" system="ICRS"/>'), "x.vot"),
    "name of a FITS table": (gaia_fits(EXTNAME="I_345_gaia2"), "x.fits"),
    "archive's name in FITS": (gaia_fits(ORIGIN="gaiadr2.gaia_source"), "x.fits"),
    "names of sources": (gaia_csv(",designation", ",Gaia DR2 4472832130942575872"), "x.csv"),
    "a column of DR2 alone": (gaia_csv(",radius_val,teff_val", ",0.2,3300"), "x.csv"),
    "another one": (gaia_csv(",astrometric_pseudo_colour", ",1.1"), "x.csv"),
    "its own epoch": (gaia_csv(",ref_epoch", ",2015.5"), "x.csv"),
}  # fmt: skip
DR3 = {
    "frame of VizieR's text": (gaia_tsv("#Coosys\tH_2016.000:\tICRS\n#Name: I/355"), "x.tsv"),
    "EDR3": (gaia_tsv("#Name: I/350/gaiaedr3"), "x.tsv"),
    "frame of a VOTable": (gaia_votable('<COOSYS ID="C" system="ICRS" epoch="2016.0"/>'), "x.vot"),
    "its frame goes before what is spoken of": (
        gaia_tsv("#Coosys\tH_2016.000:\tICRS\n#Title: DR3, with the names of Gaia DR2"), "x.tsv",
    ),
    "a column of DR3 alone": (gaia_csv(",ruwe", ",1.0"), "x.csv"),
    "nothing": (gaia_csv(), "x.csv"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("content", "name", "years"),
    [pytest.param(*file, 15.5, id=f"DR2-{key}") for key, file in DR2.items()]
    + [pytest.param(*file, 16.0, id=f"DR3-{key}") for key, file in DR3.items()],
)
def test_gaias_releases_are_told_apart(read, content, name, years):
    """Barnard's star moves by 5.2 arcsec between the epochs of DR2 and DR3."""
    catalog = read(content, name)
    assert catalog.dec_deg[0] == pytest.approx(4.73942 - years * MOTION_DEG, abs=1e-8)
    assert ("assumed" in catalog.provenance) == (content == DR3["nothing"][0])


def test_a_table_of_both_releases_says_what_it_takes(read):
    text = gaia_csv(",ruwe,teff_val", ",1.0,3300")
    assert "reference epoch 2016 assumed, that of DR3" in read(text).provenance
    assert "assumed" not in read(text, epoch_jyear=2015.5).provenance


def test_positions_at_2000_stay_there(read):
    catalog = read(gaia_tsv("#Name: I/345/gaia2", "RAJ2000", "DEJ2000"), "x.tsv")
    assert catalog.dec_deg[0] == pytest.approx(4.73942, abs=PLACE_ATOL_DEG)


# --- stars that lost their light or their place ---


def test_very_red_stars_keep_their_light_shortward_of_j(read):
    """The light between 1.15 and 1.20 um follows J, whatever K is; it once went down by 13 mag at J-K = 8."""
    rows = "".join(f"{k},{k},s,12.0,{12 - 0.6 * k:g},{12 - k:g},AAA\n" for k in range(1, 9))
    catalog = read("RAJ2000,DEJ2000,2MASS,Jmag,Hmag,Kmag,Qflg\n" + rows)
    for names in (("J", "Ks"), ("J", "H", "Ks")):
        one = ws.StarCatalog.from_arrays(
            catalog.ra_deg, catalog.dec_deg, {name: catalog.flux_jy(name) for name in names}
        )
        light = one.filled().irradiance_w_cm2(Band.top_hat("edge", 1.15, 1.20))
        drop_mag = -2.5 * np.log10(light / light[1])
        assert np.abs(drop_mag).max() < 0.75, names
        assert (np.diff(one.filled().irradiance_w_cm2(Band.top_hat("red", 1.95, 2.3))) > 0.0).all()


def test_light_shortward_of_j_against_a_power_law():
    """A template times a power law, as dust reddens, J-K = 2.6 to 7.4: once 10 mag too faint, now within 0.65."""

    def light_of(band, slope):
        node_um, weight_um, spectra = band_nodes(band)
        return 1e-20 * float((weight_um * spectra[GIANT, 0] * node_um**slope).sum())  # of the coolest giant

    anchors = [photometric_bands()[name] for name in ("J", "Ks")]
    for slope in (2.0, 5.0, 8.0, 10.0):
        flux = {band.name: [light_of(band, slope) / band.w_cm2_per_jy] for band in anchors}
        star = ws.StarCatalog.from_arrays([1.0], [2.0], flux).filled()
        for low_um in (1.1, 1.15):
            band = Band.top_hat("x", low_um, low_um * 1.05)
            error_mag = -2.5 * np.log10(star.irradiance_w_cm2(band)[0] / light_of(band, slope))
            assert abs(error_mag) < 0.65, (slope, low_um, error_mag)


ALLWISE = "AllWISE,RAJ2000,DEJ2000,W1mag,W2mag,W3mag,W4mag,Jmag,Hmag,Kmag,ccf,ex,var,qph\n"


def test_bright_stars_in_w3_are_used(read):
    """W3 = 2.10 at K = 2.5: used, 0.05 mag; predicted it would be 0.4 mag fainter here."""
    catalog = read(ALLWISE + "a,10,20,2.4,2.2,2.10,1.9,3.6,2.8,2.5,0000,0,0000,AAAA\n")
    assert catalog.flux_flag("W3").tolist() == [1]
    assert catalog.flux_jy("W3")[0] == pytest.approx(flux_jy("W3", 2.10), rel=FLUX_RTOL)
    assert catalog.quality.tolist() == [4]
    predicted = read(ALLWISE + "a,10,20,2.4,2.2,0.95,,3.6,2.8,2.5,0000,0,0000,AAAX\n")
    assert predicted.flux_flag("W3").tolist() == [3]


VIZIER_HIPPARCOS = (
    "#Name: I/239/hip_main\nHIP\tRAhms\tDEdms\tVmag\tRAICRS\tDEICRS\tPlx\tpmRA\tpmDE\te_Plx\tB-V\tNotes\n"
    ' \t"h:m:s"\t"d:m:s"\tmag\tdeg\tdeg\tmas\tmas/yr\tmas/yr\tmas\tmag\t\n'
    "------\t-----------\t-----------\t-----\t------------\t------------\t-------\t--------\t--------\t------\t------\t-\n"
    "1\t00 00 00.22\t+01 05 20.4\t 9.10\t000.00091185\t+01.08901332\t   3.54\t   -5.20\t   -1.88\t  1.39\t 0.482\t\n"
    "675\t00 08 20.11\t+25 50 02.1\t 9.66\t            \t            \t       \t        \t        \t      \t 0.900\t\n"
)


def test_viziers_default_columns_of_hipparcos(read):
    """V and B-V, no Hp; HIP 1 moves by 8.75 years to J2000, HIP 675 has the rough place that is all there is."""
    catalog = read(VIZIER_HIPPARCOS, "x.tsv")
    assert catalog.id.tolist() == ["HIP 1", "HIP 675"]
    ra_deg = [0.00091185 - 5.20 * 8.75 / 3.6e6 / np.cos(np.radians(1.089)), 15.0 * (8 / 60 + 20.11 / 3600)]
    dec_deg = [1.08901332 - 1.88 * 8.75 / 3.6e6, 25.0 + 50 / 60 + 2.1 / 3600]
    np.testing.assert_allclose(catalog.ra_deg, ra_deg, atol=1e-9)
    np.testing.assert_allclose(catalog.dec_deg, dec_deg, atol=1e-9)
    np.testing.assert_allclose(catalog.flux_jy("V"), flux_jy("V", [9.10, 9.66]), rtol=FLUX_RTOL)
    np.testing.assert_allclose(catalog.flux_jy("B"), flux_jy("B", [9.10 + 0.482, 9.66 + 0.9]), rtol=FLUX_RTOL)


def test_hipparcos_stars_without_a_solution_keep_their_place_in_bytes(read):
    line = bytearray(b" " * 449)

    def put(first, text):
        line[first - 1 : first - 1 + len(text)] = text.encode()

    for byte in (2, 15, 17, 29, 41, 47, 49, 51, 64, 77, 79, 87, 96, 105, 252, 265, 274, 282):
        put(byte, "|")
    for first, text in ((1, "H"), (9, "   675"), (18, "00 08 20.11"), (30, "+25 50 02.1"), (42, " 9.66")):
        put(first, text)
    put(246, " 0.900")
    put(275, " 9.8000")
    catalog = read(bytes(line) + b"\n", "hip_main.dat")
    assert catalog.ra_deg[0] == pytest.approx(15.0 * (8 / 60 + 20.11 / 3600), abs=PLACE_ATOL_DEG)
    assert catalog.dec_deg[0] == pytest.approx(25.0 + 50 / 60 + 2.1 / 3600, abs=PLACE_ATOL_DEG)


# --- what the user states beside a survey ---


def test_the_epoch_that_the_user_states_holds(read):
    catalog = read(gaia_csv(), epoch_jyear=2010.25)
    assert catalog.dec_deg[0] == pytest.approx(4.73942 - 10.25 * MOTION_DEG, abs=1e-8)
    own = read("ra_deg,dec_deg,mag_V,B-V\n1,2,3,0.5\n", epoch_jyear=1991.25)
    assert (own.epoch_jyear, own.dec_deg[0]) == (1991.25, 2.0)
    text = "x.csv: epoch_jyear: must be left out where the column t has it"
    columns = {"epoch_jyear": "t"}
    assert refused(read, "ra_deg,dec_deg,mag_V,B-V,t\n1,2,3,0.5,2000\n", columns=columns, epoch_jyear=1.0) in text


def test_columns_beside_a_survey(read):
    """By the survey's names what its reader looks for, by warpsim's what goes before the survey's."""
    text = gaia_csv(",G_new,v,ra_x,dec_x", ",7.0,9.5,11.0,12.0")
    renamed = read(text, format="gaia", columns={"phot_g_mean_mag": "G_new", "mag_V": "v"})
    assert renamed.flux_jy("G")[0] == pytest.approx(flux_jy("G", 7.0), rel=FLUX_RTOL)
    assert renamed.flux_jy("V")[0] == pytest.approx(flux_jy("V", 9.5), rel=FLUX_RTOL)
    assert renamed.flux_flag("V")[0] == 1
    places = {"ra_deg": "ra_x", "dec_deg": "dec_x"}
    assert "epoch_jyear: must be given with columns of a position" in refused(read, text, format="gaia", columns=places)
    moved = read(text, format="gaia", columns=places, epoch_jyear=2000.0)
    assert (moved.ra_deg[0], moved.dec_deg[0]) == pytest.approx((11.0, 12.0), abs=PLACE_ATOL_DEG)
    wrong = refused(read, text, format="gaia", columns={"Hmag": "v"})
    assert wrong == "columns: must be a column that the reader of gaia looks for, got 'Hmag'"
    missing = refused(read, text, format="gaia", columns={"Gmag": "none"})
    assert missing.startswith("columns: Gmag: must be a column of the file (")


@pytest.mark.parametrize(
    ("option", "value"), [("columns", ["a"]), ("table", 1.5), ("table", True), ("epoch_jyear", "x")]
)
def test_options_of_other_types_are_named(read, option, value):
    with pytest.raises(ws.InputError, match=rf"^{option}: must be "):
        read(gaia_csv(), **{option: value})


# --- files of several tables ---


def several(first, second):
    """VizieR's text of two tables, one below the other, as a download of Gaia EDR3 is."""
    head = "#\n#   VizieR Astronomical Server vizier.cds.unistra.fr\n#Coosys\tH_2016.000:\tICRS\n#RESOURCE=yCat_1350\n"
    return (
        f"{head}#Name: I/350\n#Table\tI_350_{first[0]}:\n{first[1]}\n#Table\tI_350_{second[0]}:\n{second[1]}\n#END#\n"
    )


GAIA_TABLE = "gaiaedr3", gaia_tsv("#Column\tRA_ICRS\t(F15.11)")
OTHER_TABLE = (
    "tboasmas",
    "#Column\tSource\t(I19)\nSource\tBest\n \t \n---\t---\n4472832130942575872\t1\n4472832130942575873\t0\n",
)


@pytest.mark.parametrize("tables", [(GAIA_TABLE, OTHER_TABLE), (OTHER_TABLE, GAIA_TABLE)], ids=["first", "second"])
def test_viziers_text_of_several_tables(read, tables):
    number = tables.index(GAIA_TABLE) + 1
    said = f"the text holds 2 tables, and only number {number}, I_350_gaiaedr3, is read; the argument table"
    with pytest.warns(UserWarning, match=said):
        catalog = read(several(*tables), "x.tsv")
    assert catalog.dec_deg[0] == pytest.approx(4.73942 - 16.0 * MOTION_DEG, abs=1e-8)
    for table in (number, str(number), "I_350_gaiaedr3", "i_350_GAIAEDR3"):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert len(read(several(*tables), "x.tsv", table=table)) == 1


def test_errors_in_a_second_table_name_its_line(read):
    text = several(OTHER_TABLE, GAIA_TABLE).replace("4.73942", "94.73942")
    line = text[: text.index("94.73942")].count("\n") + 1
    assert refused(read, text, "x.tsv", table=2) == f"line {line}: dec_deg: must be in [-90, 90], got 94.7394"


def test_a_table_that_is_not_there(read):
    text = several(GAIA_TABLE, OTHER_TABLE)
    rule = "table: must be a number from 1 to 2, or of I_350_gaiaedr3, I_350_tboasmas, got "
    for table, shown in ((3, "3"), (0, "0"), ("tboasmas", "'tboasmas'")):
        assert refused(read, text, "x.tsv", table=table) == rule + shown


def test_a_kind_of_file_that_holds_one_table(read):
    columns = "".join(f"# - {{name: {name}, datatype: float64}}\n" for name in ("ra_deg", "dec_deg", "mag_V"))
    text = f"# %ECSV 1.0\n# ---\n# datatype:\n{columns}ra_deg dec_deg mag_V\n1.0 2.0 3.0\n"
    assert len(read(text, "x.ecsv", table=1)) == 1
    assert refused(read, text, "x.ecsv", table=2) == "table: must be left out, a file of this kind holds one, got 2"


def fits_of(*tables):
    buffer = io.BytesIO()
    fits.HDUList(
        [fits.PrimaryHDU(), *(fits.BinTableHDU(table, name=f"T{k}") for k, table in enumerate(tables, 1))]
    ).writeto(buffer)
    return buffer.getvalue()


def votable_of(*tables):
    buffers = [io.BytesIO() for _ in tables]
    pieces = []
    for k, (table, buffer) in enumerate(zip(tables, buffers, strict=True), 1):
        table.write(buffer, format="votable")
        text = buffer.getvalue().decode()
        pieces.append(
            text[text.index("<TABLE") : text.index("</TABLE>") + 8].replace("<TABLE", f'<TABLE name="T{k}"', 1)
        )
    return text.replace(text[text.index("<TABLE") : text.index("</TABLE>") + 8], "\n".join(pieces)).encode()


@pytest.mark.parametrize(("of", "kind"), [(fits_of, "FITS file"), (votable_of, "VOTable")], ids=["fits", "votable"])
def test_the_table_with_stars_among_several(read, of, kind):
    log = Table({"time": [1.0, 2.0], "exposure": [3.0, 4.0]})
    stars = Table({"ra_deg": [1.0, 2.0, 3.0], "dec_deg": [3.0, 4.0, 5.0], "flux_A_jy": [5.0, 6.0, 7.0]})
    with pytest.warns(UserWarning, match=f"the {kind} holds 2 tables, and only number 2, T2, is read; the argument"):
        assert len(read(of(log, stars), "x.dat")) == 3
    with pytest.warns(UserWarning, match="only number 1, T1, is read; 2 of them would do; the argument"):
        assert len(read(of(stars, stars[:1]), "x.dat")) == 3
    assert read(of(stars, stars[:1]), "x.dat", table="t2").ra_deg.tolist() == [1.0]
    text = refused(read, of(log, log), "x.dat", table=1)
    assert text.startswith("must have the columns ra_deg, dec_deg and flux_A_jy") and text.endswith(
        "got time, exposure"
    )


def test_a_votable_of_many_tables_is_not_parsed_whole(read):
    """The other 164 tables are no VOTable's at all: whoever parsed them would fail."""
    rows = "<DATA><TABLEDATA><TR><TD>?</TR></TABLEDATA></DATA>"
    broken = f'<TABLE name="x"><FIELD name="y" datatype="nonsense"/>{rows}</TABLE>'
    good = votable_of(Table({"ra_deg": [1.0], "dec_deg": [3.0], "flux_A_jy": [5.0]})).decode()
    text = good.replace("<TABLE", broken * 100 + "<TABLE", 1).replace("</TABLE>\n", "</TABLE>\n" + broken * 64, 1)
    assert text.count("<TABLE ") == 165
    with pytest.warns(UserWarning, match="holds 165 tables, and only number 101, T1, is read"):
        assert read(text, "x.vot").flux_jy("A").tolist() == [5.0]


# --- names that archives use ---


def test_xmatchs_names_of_2mass(read):
    text = "angDist,2MASS,RAJ2000,DEJ2000,errHalfMaj,Jmag,Hmag,Kmag,e_Jmag,Qfl,Rfl,X,MeasureJD\n"
    catalog = read(text + "0.1,00400000+2000000,10,20,0.06,10.0,9.5,9.0,0.02,AAU,222,0,2451000.5\n", fill=False)
    assert catalog.flux_jy("J")[0] == pytest.approx(flux_jy("J", 10.0), rel=FLUX_RTOL)
    assert catalog.flux_flag("Ks").tolist() == [0]  # an upper limit


def test_columns_of_equal_names_are_numbered_and_said(read):
    text = "angDist,ra,dec,name,2MASS,ra,dec,Jmag,Hmag,Kmag,Qfl\n0.1,10,20,me,a,10.5,20.5,10,9.5,9,AAA\n"
    with pytest.warns(
        UserWarning, match="columns of equal names: the first keeps it, the next ra is ra_2, dec is dec_2"
    ):
        assert read(text).ra_deg.tolist() == [10.0]
    columns = {"ra_deg": "ra_2", "dec_deg": "dec_2", "mag_J": "Jmag", "mag_Ks": "Kmag"}
    with pytest.warns(UserWarning, match="equal names"):
        assert read(text, columns=columns).ra_deg.tolist() == [10.5]


def test_irsas_sexagesimal_places(read):
    text = "2MASS,clon,clat,j_m,h_m,k_m,ph_qual\na,00h40m00.12s,-00d30m00.0s,10,9.5,9,AAA\n"
    catalog = read(text)
    assert catalog.ra_deg[0] == pytest.approx(10.0005, abs=PLACE_ATOL_DEG)
    assert catalog.dec_deg[0] == pytest.approx(-0.5, abs=PLACE_ATOL_DEG)


OWN = {
    "V and B-V": ({"mag_V": "Vm", "B-V": "BV"}, "9.0,1.2", {"V": 9.0, "B": 10.2}),
    "Gaia": ({"mag_G": "g1", "mag_BP": "b1", "mag_RP": "r1"}, "9.0,9.5,8.4", {"G": 9.0, "BP": 9.5, "RP": 8.4}),
    "2MASS": ({"mag_J": "j1", "mag_H": "h1", "mag_K": "k1"}, "9.0,8.5,8.4", {"J": 9.0, "H": 8.5, "Ks": 8.4}),
    "WISE": ({f"mag_W{k}": f"w{k}" for k in (1, 2, 3, 4)}, "9,8.9,8.8,8.7", {"W1": 9, "W2": 8.9, "W3": 8.8, "W4": 8.7}),
}


@pytest.mark.parametrize("case", OWN)
def test_magnitudes_of_ones_own_table(read, case):
    columns, row, magnitudes = OWN[case]
    text = f"lon,lat,{','.join(columns.values())}\n10,20,{row}\n"
    catalog = read(text, columns={"ra_deg": "lon", "dec_deg": "lat", **columns})
    for band, magnitude in magnitudes.items():
        assert catalog.flux_jy(band)[0] == pytest.approx(flux_jy(band, magnitude), rel=FLUX_RTOL), band
        assert catalog.flux_flag(band)[0] == 1


def test_a_table_looks_like_hipparcos_only_where_it_does(read):
    published = "HIP,RAJ2000,DEJ2000,Vmag,B-V,SpType\n1,10,20,9,0.5,G0\n"
    assert refused(read, published).startswith("must have the columns ra_deg, dec_deg and flux_A_jy or the like")
    assert refused(read, "HIP,Name,ra,dec,RV\n1,a,10,20,9\n").startswith("must have the columns ra_deg")
    without_v = "HIP,RAdeg,DEdeg,Hpmag\n1,10,20,9\n"
    assert refused(read, without_v).startswith("looks like hipparcos, which must have the column Vmag, got HIP")
    mapped = read(published, columns={"ra_deg": "RAJ2000", "dec_deg": "DEJ2000", "mag_V": "Vmag"})
    assert mapped.flux_jy("B")[0] == pytest.approx(flux_jy("B", 9.5), rel=FLUX_RTOL)  # B-V goes by its name


# --- in a scene ---


def test_a_scene_says_how_to_read_its_catalog(tmp_path):
    file = tmp_path / "mine.csv"
    file.write_text("lon,lat,Vm,BV\n10,20,5.0,1.2\n")
    sky = {"catalog": str(file), "columns": {"ra_deg": "lon", "dec_deg": "lat", "mag_V": "Vm"}, "epoch_jyear": 2010.0}
    scene = ws.Scene.load("stss").replace(sky=sky)
    scene.save(tmp_path / "scene.toml")
    again = ws.Scene.load(tmp_path / "scene.toml")
    assert again == scene
    catalog = load_catalog(again.sky)
    assert (catalog.epoch_jyear, catalog.flux_jy("V")[0]) == (2010.0, pytest.approx(flux_jy("V", 5.0), rel=FLUX_RTOL))
    for name, value in (("format", "gaia"), ("table", 1), ("columns", {"a": "b"}), ("epoch_jyear", 2000.0)):
        with pytest.raises(ws.InputError, match=rf"sky.{name}: must be given with the path of a catalog file"):
            ws.Scene.load("stss").replace(sky={name: value})
    with pytest.raises(ws.InputError, match=r"sky.columns: must be a table such as"):
        ws.Scene.load("stss").replace(sky={"catalog": str(file), "columns": {"ra_deg": 1}})


@pytest.mark.parametrize(
    ("header", "columns", "values"),
    [
        ("ξ,δ,S", {"ra_deg": "ξ", "dec_deg": "δ", "flux_A_jy": "S"}, (1.0, 2.0, 3.0)),
        ("ra,RA,S", {"ra_deg": "RA", "dec_deg": "ra", "flux_A_jy": "S"}, (2.0, 1.0, 3.0)),
        ("F_8,F8,b", {"ra_deg": "b", "dec_deg": "F_8", "flux_A_jy": "F8"}, (3.0, 1.0, 2.0)),
    ],
)
def test_a_column_is_the_one_that_is_named(read, header, columns, values):
    catalog = read(f"{header}\n1,2,3\n", columns=columns)
    assert (catalog.ra_deg[0], catalog.dec_deg[0], catalog.flux_jy("A")[0]) == pytest.approx(values, rel=1e-14)


def test_warpsims_exact_name_goes_before_its_like(read):
    catalog = read("radeg,RA_DEG,ra_deg,dec_deg,flux_A_jy\n1,2,15,20,3\n")
    assert catalog.ra_deg[0] == pytest.approx(15.0, rel=1e-14)


def test_one_column_is_not_two_things(read):
    text = refused(read, "a,b,c\n1,2,3\n", columns=COLUMNS | {"dec_deg": "a"})
    assert text == "columns: dec_deg: must be a column of its own, got 'a' a second time"


def test_a_flux_and_a_magnitude_of_one_band_are_one_too_many(read):
    columns = COLUMNS | {"mag_A": "d"}
    assert refused(read, "a,b,c,d\n1,2,3,4\n", columns=columns) == (
        "columns: must be one of flux_A_jy and mag_A, got both"
    )


def test_units_hold_where_a_cell_is_missing(read):
    """One "--" makes the column text; its unit must not go."""
    text = "a\tb\tc\nrad\trad\tmJy\n---\t---\t---\n0.5\t0.25\t1000\n0.5\t0.25\t--\nnull\t0.1\t5\n"
    with pytest.warns(UserWarning, match="left out 1 of 3 stars"):
        catalog = read(text, "x.tsv", columns=COLUMNS, fill=False)
    np.testing.assert_allclose(catalog.ra_deg, np.degrees([0.5, 0.5]), rtol=1e-14)
    np.testing.assert_allclose(catalog.dec_deg, np.degrees([0.25, 0.25]), rtol=1e-14)
    np.testing.assert_allclose(catalog.flux_jy("A"), [1.0, np.nan], rtol=1e-14)
    with pytest.warns(UserWarning, match="left out 1 of 2 stars"):
        hours = read("a,b,c\n0.5,1,2\n--,1,2\n", columns=COLUMNS | {"ra_deg": "a [hourangle]"})
    assert hours.ra_deg[0] == pytest.approx(7.5, rel=1e-14)


def test_v98_motions_in_another_unit(read):
    text = (
        "RAJ2000\tDEJ2000\tpmRA\tpmDE\tFSIIIA\ndeg\tdeg\t{0}\t{1}\tJy\n---\t---\t---\t---\t---\n180\t0\t100\t50\t1.5\n"
    )
    seconds = read(text.format("s/ha", "arcsec/ha"), "x.tsv")  # the CDS's hundred years
    assert (seconds.pm_ra_mas_yr[0], seconds.pm_dec_mas_yr[0]) == pytest.approx((15_000.0, 500.0), rel=1e-12)
    for unit in ("mas/yr", "mas/year", "parsnip/yr"):  # with or without cos(dec)? nobody knows
        assert refused(read, text.format(unit, unit), "x.tsv").startswith("pmRA: must be ")


GAIA = "ra,dec,pmra,pmdec,bp_rp,phot_g_mean_mag\n1,10,20,8.2,1.5,11.2\n2,10,20,8.2,1.5,1"


@pytest.mark.parametrize("format", [None, "csv", "ascii.csv"])
def test_a_cut_archive_file_is_refused_whatever_the_format(read, format):
    assert "must end with a line break" in refused(read, GAIA, format=format)


def test_the_epoch_of_gaia_dr2_from_viziers_comments(read):
    rows = (
        "RA_ICRS\tDE_ICRS\tpmRA\tpmDE\tGmag\tBP-RP\ndeg\tdeg\tmas/yr\tmas/yr\tmag\tmag\n---\t---\t---\t---\t---\t---\n"
    )
    star = "269.44850\t4.73942\t-802.8\t10362.5\t8.2\t2.8\n"
    dr2 = read(f"#Name: I/345/gaia2\n{rows}{star}", "x.tsv")
    dr3 = read(f"#Name: I/355/gaiadr3\n{rows}{star}", "x.tsv")
    assert (dr2.dec_deg[0] - dr3.dec_deg[0]) * 3.6e6 == pytest.approx(0.5 * 10362.5, rel=1e-4)
    assert "assumed" not in dr3.provenance
    assert "reference epoch 2016 assumed" in read(f"{rows}{star}", "x.tsv").provenance


def test_codes_for_missing_magnitudes_are_no_light(read):
    hipparcos = "HIP,RAdeg,DEdeg,Vmag,Hpmag,B-V,V-I\n1,10,20,5,5.1,99.999,99.999\n2,11,20,5,5.1,0.5,0.6\n"
    for band in ("B", "Ic"):
        assert np.isfinite(read(hipparcos, fill=False).flux_jy(band)).tolist() == [False, True]
    assert read(hipparcos).quality.tolist() == [1, 2]
    own = read("ra_deg,dec_deg,mag_A\n10,20,99.999\n11,20,5\n")
    assert np.isfinite(own.flux_jy("A")).tolist() == [False, True]


def test_negative_parts_are_no_angle(read):
    parts = "RAh,RAm,RAs,DE-,DEd,DEm,DEs,flux_A_jy\n10,-5,0,+,10,0,0,1\n"
    assert refused(read, parts).endswith("line 2: RAm: must be in [0, 60], got -5")


def test_akaris_edge_flag_in_irsas_spelling(read):
    text = "objname,ra,dec,flux09,ferr09,fqual09,flags09\n{0},10,20,1.5,0.01,3,{1}\n"
    assert read(text.format("x", 0)).quality[0] == 4
    assert read(text.format("x", 8)).quality[0] == 1


def test_masked_whole_numbers_make_no_names(tmp_path):
    table = Table({"ra": [1.0, 2.0], "dec": [3.0, 4.0], "phot_g_mean_mag": [5.0, 6.0], "bp_rp": [1.0, 1.0]})
    table["source_id"] = MaskedColumn([12345678901234567, 1], mask=[False, True])
    table.write(tmp_path / "x.fits")
    assert ws.StarCatalog.read(tmp_path / "x.fits").id.tolist() == ["Gaia 12345678901234567", ""]


def test_a_mapped_flux_has_no_flag_of_another(read):
    text = "RA,DE,F8,flux_A_jy,flux_A_flag\n10,20,7,1,2\n"
    catalog = read(text, columns={"ra_deg": "RA", "dec_deg": "DE", "flux_A_jy": "F8"})
    assert (catalog.flux_jy("A")[0], catalog.flux_flag("A")[0], catalog.flux_flag("C")[0]) == (7.0, 1, 3)


@pytest.mark.parametrize("column", ["ra_deg", "flux_A_jy", "id"])
def test_several_values_a_row_are_refused(tmp_path, column):
    table = Table({"ra_deg": [1.0, 2.0], "dec_deg": [3.0, 4.0], "flux_A_jy": [5.0, 6.0], "id": ["a", "b"]})
    table[column] = np.array([table[column]] * 2).T
    table.write(tmp_path / "x.fits")
    with pytest.raises(ws.InputError, match=rf"{column}: must hold one (real number|value) a row, got shape \(2, 2\)"):
        ws.StarCatalog.read(tmp_path / "x.fits")


def test_complex_fluxes_are_refused(tmp_path):
    table = Table({"ra_deg": [1.0], "dec_deg": [3.0], "flux_A_jy": [5.0 + 1.0j]})
    table.write(tmp_path / "x.fits")
    with pytest.raises(ws.InputError, match="flux_A_jy: must hold one real number a row, got complex numbers"):
        ws.StarCatalog.read(tmp_path / "x.fits")


README = """Byte-by-byte Description of file: s.dat
--------------------------------------------------------------------------------
   Bytes Format Units   Label     Explanations
--------------------------------------------------------------------------------
   1- 6  F6.2   deg     RAdeg     Right ascension
   {0}  F6.2   deg     DEdeg     Declination
  15- 20 F6.2   Jy      FSIIIA    ? Flux
  22- 30 A9     ---     Note      A remark
--------------------------------------------------------------------------------
"""


@pytest.mark.parametrize("span", ["13-  8", "0 -  5"])
def test_a_readme_with_bytes_the_wrong_way_round(read, tmp_path, span):
    (tmp_path / "ReadMe").write_text(README.format(span))
    assert "column DEdeg: bytes must grow from 1" in refused(
        read, " 10.50  20.50   1.50\n", "s.dat", readme=tmp_path / "ReadMe"
    )


def test_any_other_readme_beside_the_data_is_left_alone(read, tmp_path):
    (tmp_path / "README").write_text("My project. Run make.\n")
    assert len(read("ra_deg dec_deg flux_A_jy\n1 2 3\n", "stars.dat")) == 1


def test_gaias_bulk_files_write_null(read):
    """ECSV with "null" for what is missing, and a byte order mark before it."""
    names = ("ra", "dec", "pmra", "pmdec", "phot_g_mean_mag", "bp_rp")
    header = "\n".join(f"# - {{name: {name}, datatype: float64}}" for name in names)
    text = f"# %ECSV 1.0\n# ---\n# delimiter: ','\n# datatype:\n{header}\n{','.join(names)}\n"
    text += "10.0,20.0,null,null,5.0,1.0\n11.0,21.0,3.5,-4.5,6.0,null\n"
    for start in ("", "\ufeff"):
        catalog = read(start + text, "GaiaSource.csv")
        assert catalog.pm_ra_mas_yr.tolist() == pytest.approx([0.0, 3.5], rel=1e-6)
        assert catalog.quality.tolist() == [2, 1]


def test_rows_behind_a_hash_are_spoken_of(read):
    text = "id,ra_deg,dec_deg,flux_A_jy\n#1,1,2,3\n2,4,5,6\n# a remark\n"
    with pytest.warns(UserWarning, match=r"1 lines that look like rows begin with # and are left out \(lines 2\)"):
        assert len(read(text)) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read("# a remark, of, four, words\nid,ra_deg,dec_deg,flux_A_jy,temperature_k\n# another\n2,4,5,6,4e3\n")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"path": b"x.csv"}, "path: must be a file name, got bytes"),
        ({"path": "a\0b"}, "path: must be a file name, got str"),
        ({"path": "x.csv", "format": []}, "format: must be a name, got []"),
        ({"path": "x.csv", "readme": 5}, "readme: must be a file name, got 5"),
    ],
)
def test_arguments_of_other_types_are_named(arguments, text):
    with pytest.raises(ws.InputError) as caught:
        ws.StarCatalog.read(**arguments)
    assert str(caught.value) == text


def test_errors_name_the_files_column(read):
    text = refused(read, "a,b,c\n1,2,3\n1,95,3\n", columns=COLUMNS)
    assert text == "line 3: column b: dec_deg: must be in [-90, 90], got 95"
    assert refused(read, "ra_deg,dec_deg,flux_A_jy\n1,95,3\n").startswith("line 2: dec_deg: must be")


LINE = " 10.50  20.50   1.50 remark 01"


def test_a_last_line_that_ends_between_columns_is_cut_off(read, tmp_path):
    (tmp_path / "ReadMe").write_text(README.format(" 8- 13"))
    assert len(read(f"{LINE}\n{LINE}\n", "s.dat")) == len(read(f"{LINE}\n{LINE}", "s.dat")) == 2
    with pytest.raises(ws.InputError, match="line 2: the file ends in the middle of a line, at 13 of 30 bytes"):
        read(f"{LINE}\n{LINE[:13]}", "s.dat")
    assert len(read(f"{LINE}\r\n{LINE}\r\n", "s.dat")) == 2


def test_text_of_other_alphabets(read, tmp_path):
    for encoding in ("utf-8", "latin-1", "utf-8-sig"):
        (tmp_path / "x.csv").write_bytes("id,ra_deg,dec_deg,flux_A_jy\nÖst,1,2,3\n".encode(encoding))
        assert ws.StarCatalog.read(tmp_path / "x.csv").id.tolist() == ["Öst"]
