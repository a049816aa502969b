"""Files that once misled the readers: names that collide, units and flags that got lost, tables in pieces."""

import warnings

import numpy as np
import pytest
from astropy.table import MaskedColumn, Table

import warpsim as ws

PLACE = {"ra_deg": "a", "dec_deg": "b", "flux_A_jy": "c"}


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


@pytest.mark.parametrize(
    ("header", "columns", "place"),
    [
        ("ξ,δ,S", {"ra_deg": "ξ", "dec_deg": "δ", "flux_A_jy": "S"}, (1.0, 2.0, 3.0)),
        ("ra,RA,S", {"ra_deg": "RA", "dec_deg": "ra", "flux_A_jy": "S"}, (2.0, 1.0, 3.0)),
        ("F_8,F8,b", {"ra_deg": "b", "dec_deg": "F_8", "flux_A_jy": "F8"}, (3.0, 1.0, 2.0)),
    ],
)
def test_a_column_is_the_one_that_is_named(read, header, columns, place):
    catalog = read(f"{header}\n1,2,3\n", columns=columns)
    assert (catalog.ra_deg[0], catalog.dec_deg[0], catalog.flux_jy("A")[0]) == pytest.approx(place, rel=1e-14)


def test_warpsims_exact_name_goes_before_its_like(read):
    catalog = read("radeg,RA_DEG,ra_deg,dec_deg,flux_A_jy\n1,2,15,20,3\n")
    assert catalog.ra_deg[0] == pytest.approx(15.0, rel=1e-14)


def test_one_column_is_not_two_things(read):
    text = refused(read, "a,b,c\n1,2,3\n", columns=PLACE | {"dec_deg": "a"})
    assert text == "columns: dec_deg: must be a column of its own, got 'a' a second time"


def test_a_flux_and_a_magnitude_of_one_band_are_one_too_many(read):
    columns = PLACE | {"mag_A": "d"}
    assert refused(read, "a,b,c,d\n1,2,3,4\n", columns=columns) == (
        "columns: must be one of flux_A_jy and mag_A, got both"
    )


def test_units_hold_where_a_cell_is_missing(read):
    """One "--" makes the column text; its unit must not go."""
    text = "a\tb\tc\nrad\trad\tmJy\n---\t---\t---\n0.5\t0.25\t1000\n0.5\t0.25\t--\nnull\t0.1\t5\n"
    with pytest.warns(UserWarning, match="left out 1 of 3 stars"):
        catalog = read(text, "x.tsv", columns=PLACE, fill=False)
    np.testing.assert_allclose(catalog.ra_deg, np.degrees([0.5, 0.5]), rtol=1e-14)
    np.testing.assert_allclose(catalog.dec_deg, np.degrees([0.25, 0.25]), rtol=1e-14)
    np.testing.assert_allclose(catalog.flux_jy("A"), [1.0, np.nan], rtol=1e-14)
    with pytest.warns(UserWarning, match="left out 1 of 2 stars"):
        hours = read("a,b,c\n0.5,1,2\n--,1,2\n", columns=PLACE | {"ra_deg": "a [hourangle]"})
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
    text = refused(read, "a,b,c\n1,2,3\n1,95,3\n", columns=PLACE)
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
