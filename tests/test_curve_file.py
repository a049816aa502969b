"""Files of curves over wavelength."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from warpsim.errors import InputError
from warpsim.exchange.curve_file import read_curve

ECSV = """# %ECSV 1.0
# ---
# datatype:
# - {{name: wavelength, datatype: float64, unit: {unit}}}
# - {{name: response, datatype: float64, unit: "{of_response}"}}
wavelength response
{first} 10
{last} 80
"""


def write(folder, name, text):
    path = folder / name
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", "wavelength_um,response\n3,0.5\n4,1\n5,0\n"),
        ("b.csv", "Wavelength [nm],QE\n3000,0.5\n4000,1\n5000,0\n"),
        ("c.txt", "# of a filter\nlambda_nm transmission\n3000 0.5\n4000 1\n5000 0\n"),
        ("d.csv", "WAVELENGTH (Angstrom),T\n30000,0.5\n40000,1\n50000,0\n"),
        ("e.csv", "Wavelength (ANGSTROMS),T [%]\n30000,50\n40000,100\n50000,0\n"),
        ("f.csv", "wavelength_micrometers,T_percent\n3,50\n4,100\n5,0\n"),
        ("g.csv", "wave [\u00b5m],QE (%)\n3,50\n4,100\n5,0\n"),
        ("h.csv", "wave [\u03bcm],QE %\n3,50\n4,100\n5,0\n"),
        ("i.txt", "lambda_nanometer T_pct\n3000 50\n4000 100\n5000 0\n"),
        ("j.csv", "wl [mm],T\n0.003,0.5\n0.004,1\n0.005,0\n"),
        ("k.csv", "Wavelength [A],T\n30000,0.5\n40000,1\n50000,0\n"),
        ("l.csv", "Wavelength (A),QE%\n30000,50\n40000,100\n50000,0\n"),
        ("m.csv", "wavelength_A,QE_%\n30000,50\n40000,100\n50000,0\n"),
        ("n.csv", "WAVELENGTH [\u212b],T_PCT\n30000,50\n40000,100\n50000,0\n"),
        ("o.csv", "WAVELENGTH_\u00b5M,QE [ % ]\n3,50\n4,100\n5,0\n"),
        ("p.csv", "wl [Mm],T\n3e-12,0.5\n4e-12,1\n5e-12,0\n"),
    ],
)
def test_units_are_those_of_the_file(tmp_path, name, text):
    path = write(tmp_path, name, text)
    curve = read_curve(path)
    np.testing.assert_allclose(curve.wavelength_um, [3.0, 4.0, 5.0], rtol=1e-15)
    np.testing.assert_array_equal(curve.value, [0.5, 1.0, 0.0])
    assert curve.sha256 == hashlib.sha256(text.encode()).hexdigest()


@pytest.mark.parametrize("of_response", ["%", "percent"])
@pytest.mark.parametrize(
    ("unit", "first", "last"),
    [
        ("nm", 300, 400),
        ("um", 0.3, 0.4),
        ("Angstrom", 3000, 4000),
        ("ANGSTROMS", 3000, 4000),
        ("Microns", 0.3, 0.4),
        ("µm", 0.3, 0.4),
        ("nanometers", 300, 400),
    ],
)
def test_ecsv_states_units_of_both_columns(tmp_path, unit, first, last, of_response):
    text = ECSV.format(unit=unit, of_response=of_response, first=first, last=last)
    curve = read_curve(write(tmp_path, "curve.ecsv", text))
    np.testing.assert_allclose(curve.wavelength_um, [0.3, 0.4], rtol=1e-15)
    np.testing.assert_allclose(curve.value, [0.1, 0.8], rtol=1e-15)


@pytest.mark.parametrize("unit", ["Angstrom", "ANGSTROMS"])
def test_fits_table(tmp_path, unit):
    from astropy.io import fits

    path = str(tmp_path / "curve.fits")
    columns = [
        fits.Column("wavelength", "D", unit, array=[3000.0, 4000.0]),
        fits.Column("response", "D", "percent", array=[25.0, 100.0]),
    ]
    fits.BinTableHDU.from_columns(columns).writeto(path)
    np.testing.assert_allclose(read_curve(path).wavelength_um, [0.3, 0.4], rtol=1e-15)
    np.testing.assert_array_equal(read_curve(path).value, [0.25, 1.0])


def test_latin_1_micro_sign(tmp_path):
    path = tmp_path / "curve.csv"
    path.write_bytes("wavelength [µm],response\n3,1\n4,1\n".encode("latin-1"))
    np.testing.assert_array_equal(read_curve(str(path)).wavelength_um, [3.0, 4.0])


def test_column_says_which_values(tmp_path):
    path = write(tmp_path, "curves.csv", "wavelength_nm,filter,QE\n300,0,0.1\n400,0.5,0.2\n")
    np.testing.assert_array_equal(read_curve(path, "QE").value, [0.1, 0.2])
    with pytest.raises(InputError, match=r"curves.csv: must have one column of values, .* got filter, QE$"):
        read_curve(path)
    with pytest.raises(InputError, match=r"column: must be a column of the file \(filter, QE\), got 'lens'$"):
        read_curve(path, "lens")


def test_a_changed_file_is_read_again(tmp_path):
    path = write(tmp_path, "curve.csv", "wavelength_um,response\n3,1\n4,1\n")
    before = read_curve(path)
    write(tmp_path, "curve.csv", "wavelength_um,response\n3,1\n4,1\n5,1\n")
    assert len(read_curve(path).value) == len(before.value) + 1


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("wavelength,response\n3,0\n4,1\n", "column wavelength: must state its unit"),
        ("wavelength_um,response\n3,0\n2,1\n", r"column wavelength_um: must increase, got 3 then 2$"),
        ("wavelength_um,response\n0,0\n2,1\n", r"column wavelength_um: must be > 0, got 0$"),
        ("wavelength_um,response\n3,0\nx,1\n", r"line 3: column wavelength_um: must be a number, got 'x'$"),
        ("wavelength_um,response\n3,0\n4,nan\n", r"column response: must be finite, got nan at node 1$"),
        ("wavelength_um,response\n3,0\n4,-1\n", r"column response: must be >= 0, got -1$"),
        ("wavelength_um,response\n3,1\n", r"must be a vector of at least 2 nodes"),
        ("a,b\n1,2\n", r"must have a column of wavelengths, such as wavelength_um, got a, b$"),
        ("wavelength_um\n1\n2\n", r"cannot be read as a table"),
        ("", r"got an empty file$"),
    ],
)
def test_bad_files_give_one_line(tmp_path, text, rule):
    path = write(tmp_path, "curve.csv", text)
    with pytest.raises(InputError, match=rule) as caught:
        read_curve(path)
    assert str(caught.value).startswith(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("unit", ["kg", "furlong", "K"])
def test_unit_that_is_no_length(tmp_path, unit):
    path = write(tmp_path, "curve.ecsv", ECSV.format(unit=unit, of_response="", first=1, last=2))
    rule = rf"unknown unit '{unit}'; must be a length such as um, nm or Angstrom$"
    with pytest.raises(InputError, match=rf"column wavelength: {rule}"):
        read_curve(path)
    path = write(tmp_path, "curve.csv", f"wavelength [{unit}],response\n1,1\n2,1\n")
    with pytest.raises(InputError, match=rf"column wavelength \[{unit}\]: {rule}"):
        read_curve(path)


def test_missing_file(tmp_path):
    with pytest.raises(InputError, match=r"none.csv: cannot be read: No such file or directory$"):
        read_curve(str(tmp_path / "none.csv"))
