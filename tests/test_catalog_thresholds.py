"""Limits at which the surveys' readers change their mind, each from both sides, through files."""

import numpy as np
import pytest

import warpsim as ws


@pytest.fixture
def read(tmp_path):
    def do(text, name="x.csv", **options):
        (tmp_path / name).write_text(text)
        return ws.StarCatalog.read(tmp_path / name, **options)

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
    rows = [(7.95, 7.05, 3.75, 2.0), (8.05, 6.95, 3.85, 2.0), (9.0, 9.0, 5.0, -0.45), (9.0, 9.0, 5.0, -0.35)]
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
    with pytest.warns(UserWarning, match=r"left out 1 of 3 stars without a finite place \(lines 2\)"):
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


README = """Byte-by-byte Description of file: s.dat
--------------------------------------------------------------------------------
   Bytes Format Units   Label     Explanations
--------------------------------------------------------------------------------
   1-  6  F6.2   deg     RAdeg     Right ascension
   8- 13  F6.2   deg     DEdeg     Declination
  15- 20  F6.2   Jy      FSIIIA    ? Flux
  22- 30  A9     ---     Note      A remark
--------------------------------------------------------------------------------
"""
LINE = " 10.50  20.50   1.50 remark 01"


def test_a_last_line_that_ends_between_columns_is_cut_off(read, tmp_path):
    (tmp_path / "ReadMe").write_text(README)
    assert len(read(f"{LINE}\n{LINE}\n", "s.dat")) == len(read(f"{LINE}\n{LINE}", "s.dat")) == 2
    with pytest.raises(ws.InputError, match="line 2: the file ends in the middle of a line, at 13 of 30 bytes"):
        read(f"{LINE}\n{LINE[:13]}", "s.dat")
    assert len(read(f"{LINE}\r\n{LINE}\r\n", "s.dat")) == 2


def test_text_of_other_alphabets(read, tmp_path):
    for encoding in ("utf-8", "latin-1", "utf-8-sig"):
        (tmp_path / "x.csv").write_bytes("id,ra_deg,dec_deg,flux_A_jy\nÖst,1,2,3\n".encode(encoding))
        assert ws.StarCatalog.read(tmp_path / "x.csv").id.tolist() == ["Öst"]
