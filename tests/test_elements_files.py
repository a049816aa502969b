"""Element sets from TLE, 3LE and OMM files: equal whatever the layout, and every fault one clear line."""

from __future__ import annotations

import csv
import io
import json
import math
import random
import re
from pathlib import Path

import pytest
import sgp4
from astropy.time import Time
from element_sets import checksummed, iss, parse_element_sets, read_element_sets
from hypothesis import given, settings
from hypothesis import strategies as st

from warpsim.errors import InputError
from warpsim.exchange.element_set import plain_designator
from warpsim.exchange.elements_files import element_records, read_element_records

ISS = iss()
ISS_FIELDS = {
    "CCSDS_OMM_VERS": "3.0",
    "CREATION_DATE": "2019-12-10T00:00:00",
    "ORIGINATOR": "TEST",
    "OBJECT_NAME": "ISS (ZARYA)",
    "OBJECT_ID": "1998-067A",
    "CENTER_NAME": "EARTH",
    "REF_FRAME": "TEME",
    "TIME_SYSTEM": "UTC",
    "MEAN_ELEMENT_THEORY": "SGP4",
    "EPOCH": "2019-12-09T16:38:29.363424",
    "MEAN_MOTION": "15.50103472",
    "ECCENTRICITY": ".0007417",
    "INCLINATION": "51.6439",
    "RA_OF_ASC_NODE": "211.2001",
    "ARG_OF_PERICENTER": "17.6667",
    "MEAN_ANOMALY": "85.6398",
    "EPHEMERIS_TYPE": "0",
    "CLASSIFICATION_TYPE": "U",
    "NORAD_CAT_ID": "25544",
    "ELEMENT_SET_NO": "999",
    "REV_AT_EPOCH": "20248",
    "BSTAR": ".38792E-4",
    "MEAN_MOTION_DOT": ".1764E-4",
    "MEAN_MOTION_DDOT": "0",
}
UNITS = {"MEAN_MOTION": "rev/day", "INCLINATION": "deg", "BSTAR": "1/ER", "MEAN_MOTION_DOT": "rev/day**2"}
TABLE = {key: value for key, value in ISS_FIELDS.items() if list(ISS_FIELDS).index(key) >= 9 or key.startswith("OBJ")}
"""What CelesTrak and Space-Track put into JSON and CSV."""

ELEMENT = 1e-14  # [rad], [rad/min]: rounding of one conversion
EPOCH_D = 5.8e-12 + 0.5e-11  # days since 1950 in float64 have 3.6e-12 d; the file's microsecond is half of 1.2e-11 d


def kvn(fields):
    return "".join(
        f"{key:<20} = {value}" + (f" [{UNITS[key]}]" if key in UNITS else "") + "\n" for key, value in fields.items()
    )


def xml(fields, root="omm"):
    def tags(keys):
        return "".join(
            f"<{key}{f' units={UNITS[key]!r}' if key in UNITS else ''}>{fields[key]}</{key}>"
            for key in keys
            if key in fields
        )

    keys = list(ISS_FIELDS)
    body = (
        f'<omm id="CCSDS_OMM_VERS" version="3.0"><header>{tags(keys[1:3])}</header><body><segment>'
        f"<metadata>{tags(keys[3:9])}</metadata><data><meanElements>{tags(keys[9:16])}</meanElements>"
        f"<tleParameters>{tags(keys[16:])}</tleParameters></data></segment></body></omm>"
    )
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + (f"<ndm>{body}</ndm>" if root == "ndm" else body)


def comma(*rows):
    out = io.StringIO()
    writer = csv.DictWriter(out, list(rows[0]))
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


LAYOUTS = {
    "tle": "\n".join(ISS),
    "3le": "ISS (ZARYA)             \r\n" + "\r\n".join(ISS) + "\r\n",
    "3le with 0": "# made by hand\n\n0 ISS (ZARYA)\n" + "\n".join(ISS),
    "kvn": kvn(ISS_FIELDS),
    "xml": xml(ISS_FIELDS),
    "ndm": xml(ISS_FIELDS, "ndm"),
    "json texts": json.dumps([TABLE]),
    "json numbers": json.dumps({k: json.loads(v.replace(".", "0.", v[0] == ".")) if re.fullmatch(r"[\d.E-]+", v) else v
                                for k, v in TABLE.items()} | {"DECAYED": None}),
    "csv": comma(TABLE),
    "csv with more columns": comma({"GP_ID": 1, **TABLE, "TLE_LINE0": '0 "ISS", (ZARYA)'}),
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_satellite(tmp_path, layout):
    path = tmp_path / "stations.dat"
    path.write_bytes(("﻿" if layout == "3le" else "").encode() + LAYOUTS[layout].encode())
    (item,) = read_element_sets(path)
    assert item.name == ("" if layout == "tle" else "ISS (ZARYA)")
    assert (item.norad_id, read_element_records(path)[0].designator) == (25544, "1998-067A")
    rec = item.satrec
    for value, degrees in [(rec.inclo, 51.6439), (rec.nodeo, 211.2001), (rec.argpo, 17.6667), (rec.mo, 85.6398)]:
        assert value == pytest.approx(math.radians(degrees), abs=ELEMENT, rel=0)
    assert rec.ecco == pytest.approx(0.0007417, abs=1e-18, rel=1e-15)
    assert rec.no_kozai == pytest.approx(15.50103472 * 2 * math.pi / 1440, abs=ELEMENT, rel=0)
    assert rec.bstar == pytest.approx(0.38792e-4, abs=0, rel=1e-14)
    assert rec.ndot == pytest.approx(0.1764e-4 * 2 * math.pi / 1440**2, abs=0, rel=1e-14)
    jd, fraction = item.epoch_jd_utc
    assert (jd - 2458826.5) + fraction == pytest.approx(0.69339541, abs=EPOCH_D, rel=0)
    assert Time(jd, fraction, format="jd", scale="utc").isot == "2019-12-09T16:38:29.363"


def test_epochs_of_omm_keep_their_microseconds():
    texts = ["2019-12-09T16:38:29.363424", "2019-343T16:38:29.363424Z", "2019-12-09 16:38:29.363424"]
    sets = [parse_element_sets(json.dumps({**TABLE, "EPOCH": text}))[0] for text in texts]
    assert len({item.epoch_jd_utc for item in sets}) == 1
    later = parse_element_sets(json.dumps({**TABLE, "EPOCH": "2019-12-09T16:38:29.363425"}))[0]
    step_s = 86400 * (later.epoch_jd_utc[1] - sets[0].epoch_jd_utc[1])
    assert step_s == pytest.approx(1e-6, abs=4e-7)
    whole = parse_element_sets(json.dumps({**TABLE, "EPOCH": "2019-12-09T12:00:00"}))[0]
    assert sum(whole.epoch_jd_utc) == 2458827.0


def test_many_satellites_in_one_file(tmp_path):
    second = [checksummed(line.replace("25544", "25545")) for line in ISS]
    assert [s.norad_id for s in parse_element_sets("\n".join([*ISS, *second]))] == [25544, 25545]
    mixed = parse_element_sets("\n".join(["A", *ISS, *second, "0 2 EYES", *ISS]))
    assert [s.name for s in mixed] == ["A", "", "2 EYES"]
    assert [s.location for s in mixed] == ["line 2", "line 4", "line 7"]
    other = {**ISS_FIELDS, "OBJECT_NAME": "B"}
    assert [s.name for s in parse_element_sets(kvn(ISS_FIELDS) + "\n" + kvn(other))] == ["ISS (ZARYA)", "B"]
    del other["CCSDS_OMM_VERS"]
    assert [s.name for s in parse_element_sets(kvn(ISS_FIELDS) + kvn(dict(list(other.items())[2:])))][1] == "B"
    assert len(parse_element_sets(comma(TABLE, TABLE))) == 2
    two = f"<ndm>{xml(ISS_FIELDS).split('?>')[1]}{xml(other).split('?>')[1]}</ndm>"
    assert [s.name for s in parse_element_sets(two)] == ["ISS (ZARYA)", "B"]
    spaced = two.replace("<ndm>", '<ndm xmlns="urn:ccsds:schema:ndmxml">')
    assert len(parse_element_sets(spaced)) == 2


def test_names_that_look_like_lines():
    assert parse_element_sets("1 KUNS-PF\n" + "\n".join(ISS))[0].name == "1 KUNS-PF"


def test_catalog_numbers_beyond_five_digits():
    for text, number in [("A0000", 100000), ("Z9999", 339999), ("J0001", 180001), ("   05", 5)]:
        lines = [checksummed(f"{line[:2]}{text}{line[7:]}") for line in ISS]
        assert parse_element_sets("\n".join(lines))[0].norad_id == number
    assert parse_element_sets(json.dumps({**TABLE, "NORAD_CAT_ID": 799501234}))[0].norad_id == 799501234


def test_all_of_vallados_verification_sets_are_read():
    lines = [line.rstrip()[:69] for line in (Path(sgp4.__file__).parent / "SGP4-VER.TLE").open() if line[0] in "12"]
    lines = [checksummed(line) if line[2:7] in ("33333", "33334", "33335") else line for line in lines]
    sets = parse_element_sets("\n".join(lines))
    assert len(sets) == 33 and sets[0].norad_id == 5
    assert element_records("\n".join(lines))[0].designator == "1958-002B"


def tle(number, at, text, fix=True):
    """The ISS set with text from column `at` of line `number`."""
    lines = list(ISS)
    line = lines[number - 1]
    line = line[: at - 1] + text + line[at - 1 + len(text) :]
    lines[number - 1] = checksummed(line) if fix else line
    return "ISS\n" + "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (tle(1, 69, "3", fix=False), r"^line 2: ISS, 25544: checksum .*: must be 1, the sum of the line, got 3$"),
        (tle(2, 69, "x", fix=False), r"^line 3: ISS, 25544: checksum \(column 69\): must be a digit, got 'x'$"),
        ("\n".join(ISS)[:-1], r"^line 2: 25544: must have 69 characters, got 68$"),
        (tle(1, 69, "12", fix=False), r"line 2: ISS, 25544: must have 69 characters, got 70$"),
        (tle(2, 3, "25545"), r"^line 3: ISS, 25544: catalog number: must be that of line 2, '25544', got '25545'$"),
        (tle(1, 3, "I5544"), r"catalog number \(column 3-7\): must be five digits, or a letter \(not I or O\)"),
        (tle(1, 21, "000.5"), r"epoch day: must be in \[1, 367\), got 0\.5"),
        (tle(1, 21, "367.0"), r"epoch day: must be in \[1, 367\), got 367"),
        (tle(1, 19, "1x"), r"epoch year \(column 19-20\): must be two digits, got '1x'$"),
        (tle(1, 54, "+3879A"), r"drag term B\* \(column 54-61\): must be a sign, five digits, a sign and a digit"),
        (tle(1, 63, "4"), r"ephemeris type \(column 63\): must be 0 \(SGP4\).*SGP4-XP.*, got '4'$"),
        (tle(1, 18, "x"), r"column 18: must be blank, got 'x'$"),
        (tle(2, 19, " "), r"right ascension of the node .* must be degrees like '211.2001', got '2 1.2001'$"),
        (tle(2, 9, "180.0001"), r"^line 3: ISS, 25544: inclination: must be in \[0, 180\] deg, got 180\.0001$"),
        (tle(2, 9, " 51,6439"), r"inclination \(column 9-16\): must be degrees like ' 51\.6439', got ' 51,6439'$"),
        (tle(2, 18, "360.0001"), r"right ascension of the node: must be in \[0, 360\] deg, got 360\.0001$"),
        (tle(2, 27, "-007417"), r"eccentricity \(column 27-33\): must be seven digits, got '-007417'$"),
        (tle(2, 53, "00.00000000"), r"mean motion: must be in \(0, 18\] revolutions per day, got 00\.00000000$"),
        (tle(2, 53, "18.00000001"), r"mean motion: must be in \(0, 18\]"),
        (ISS[0], r"^line 1: must be followed by line 2 of its set$"),
        (ISS[0] + "\n" + ISS[0], r"^line 1: must be followed by line 2 of its set$"),
        (ISS[1], r"^line 1: has no line 1 before it$"),
        ("\n".join([*ISS, "LAST"]), r"^ends with a name without lines, got 'LAST'$"),
        ("A\nB\n" + "\n".join(ISS), r"^line 2: must be line 1 of the set named 'A', got 'B'$"),
        ("A\n\x0bB\x85\n" + "\n".join(ISS), r"line 2: must be line 1"),
        ("", r"^must hold element sets, as TLE or as OMM in KVN, XML, JSON or CSV$"),
        ("hello", r"^must hold element sets"),
        ("[]", r"^holds no element sets$"),
        (comma(TABLE).split("\n")[0], r"^holds no element sets$"),
    ],
)  # fmt: skip
def test_tle_faults_are_one_clear_line(text, message):
    with pytest.raises(InputError, match=message) as caught:
        parse_element_sets(text)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"MEAN_ELEMENT_THEORY": "SGP4-XP"}, "MEAN_ELEMENT_THEORY: must be SGP4 or SGP/SGP4 or SGP, got 'SGP4-XP'$"),
        ({"EPHEMERIS_TYPE": "4"}, "EPHEMERIS_TYPE: must be 0 or 2 or 3, got '4'$"),
        ({"REF_FRAME": "EME2000"}, "REF_FRAME: must be TEME, got 'EME2000'$"),
        ({"TIME_SYSTEM": "TAI"}, "TIME_SYSTEM: must be UTC, got 'TAI'$"),
        ({"CENTER_NAME": "MARS"}, "CENTER_NAME: must be EARTH, got 'MARS'$"),
        ({"ECCENTRICITY": "1.0"}, r"ECCENTRICITY: must be in \[0, 1\), got '1.0'$"),
        ({"ECCENTRICITY": "-1e-9"}, r"ECCENTRICITY: must be in \[0, 1\)"),
        ({"INCLINATION": "181"}, r"INCLINATION: must be in \[0, 180\] deg, got '181'$"),
        ({"MEAN_MOTION": "0"}, r"MEAN_MOTION: must be in \(0, 18\] revolutions per day, got '0'$"),
        ({"MEAN_MOTION": "nan"}, "MEAN_MOTION: must be a number, got 'nan'$"),
        ({"BSTAR": "1e999"}, r"BSTAR: must be in \[-1000, 1000\], got '1e999'$"),
        ({"BSTAR": ""}, "BSTAR: is required$"),
        ({"EPOCH": "yesterday"}, "EPOCH: must be a UTC instant like 2025-06-01T12:34:56.789.*, got 'yesterday'$"),
        ({"EPOCH": "2019-02-29T00:00:00"}, "EPOCH: must be a UTC instant"),
        ({"EPOCH": "2019-366T00:00:00"}, "EPOCH: must be a UTC instant"),
        ({"EPOCH": "2020-000T00:00:00"}, "EPOCH: must be a UTC instant"),
        ({"EPOCH": "2219-01-01T00:00:00"}, "EPOCH: must be a UTC instant"),
        ({"NORAD_CAT_ID": "25544X"}, "NORAD_CAT_ID: must be up to nine digits, got '25544X'$"),
    ],
)
@pytest.mark.parametrize("write", [kvn, xml, lambda fields: comma(fields), lambda fields: json.dumps([fields])])
def test_omm_faults_are_one_clear_line(write, changes, message):
    with pytest.raises(InputError, match=message) as caught:
        parse_element_sets(write({**ISS_FIELDS, **changes}))
    assert len(str(caught.value).splitlines()) == 1
    assert re.match(r"(line|record) \d+: ISS \(ZARYA\)", str(caught.value))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (kvn(ISS_FIELDS).replace("INCLINATION  ", "INCLINATION_ "), "line 1: ISS .*: INCLINATION: is required$"),
        (kvn(ISS_FIELDS).replace("[deg]", "[rad]"), r"^line 13: INCLINATION: must be in deg, got 'rad'$"),
        (kvn(ISS_FIELDS) + "EPOCH = 1\n", "^line 25: EPOCH: is given twice$"),
        (kvn(ISS_FIELDS) + "what\n", "^line 25: must be KEYWORD = value, got 'what'$"),
        (xml(ISS_FIELDS)[:-3], "^line 2: XML: .* cut off"),
        (xml(ISS_FIELDS).replace("'deg'", "'rad'"), "^line 2: INCLINATION: must be in deg, got 'rad'$"),
        ("<oem/>", "^must hold <omm> elements, got <oem>$"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><omm/>', "^line 1: XML: must have no document type of its own$"),
        ("<omm/>", "^line 1: OBJECT_NAME or NORAD_CAT_ID is required$"),
        ("[1]", "^record 1: must be an object of keywords, got 1$"),
        ('[{"EPOCH": []}]', r"^record 1: EPOCH: must be a number or a text, got \[\]$"),
        ("[{", "^line 1: is not valid JSON"),
        ("[" * 100000, "^is not valid JSON: nested too deep"),
        (comma(TABLE) + "1,2\n", "^line 3: must have 17 values, as the header has, got 2$"),
        (comma(TABLE) + '"x', "^line 4: is not valid CSV|^line 3: is not valid CSV"),
        ("EPOCH,EPOCH,MEAN_MOTION\n1,2,3", "^line 1: column names must be different$"),
    ],
)
def test_broken_layouts_are_one_clear_line(text, message):
    with pytest.raises(InputError, match=message) as caught:
        parse_element_sets(text)
    assert len(str(caught.value).splitlines()) == 1


def test_unreadable_files(tmp_path):
    with pytest.raises(InputError, match=r"gone\.tle: cannot be read: No such file"):
        read_element_sets(tmp_path / "gone.tle")
    with pytest.raises(InputError, match="must be a file, got a folder"):
        read_element_sets(tmp_path)
    (tmp_path / "x").write_bytes(b"%PDF-1.4 1 25544")
    with pytest.raises(InputError, match="x: must be text, got a PDF document"):
        read_element_sets(tmp_path / "x")


def damaged(text, seed):
    """One to four random edits; TLE checksums are mended half of the time, so that deeper rules are reached."""
    rng = random.Random(seed)
    pool = "0123456789.-+eE ,=<>[]{}\"'/\n\t\x00abzAZ²٣é\u2028"
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(text) + 1)
        kind = rng.randrange(4)
        if kind == 0:
            text = text[:at] + rng.choice(pool) + text[at + 1 :]
        elif kind == 1:
            text = text[:at] + text[at + rng.randint(1, 30) :]
        elif kind == 2:
            text = text[:at] + rng.choice(pool) + text[at:]
        else:
            start = rng.randrange(len(text) + 1)
            text = text[:at] + text[start : start + rng.randint(1, 30)] + text[at:]
    if rng.random() < 0.5:
        text = "\n".join(checksummed(x) if x[:2] in ("1 ", "2 ") and len(x) == 69 else x for x in text.split("\n"))
    return text


@pytest.mark.parametrize("layout", LAYOUTS)
@settings(max_examples=400, deadline=None)
@given(seed=st.integers(0, 2**32))
@pytest.mark.ci
def test_random_damage_is_an_error_of_one_line_or_a_valid_result(layout, seed):
    sets, complaint = [], "line 1: "
    try:
        sets = parse_element_sets(damaged(LAYOUTS[layout], seed))
    except InputError as error:
        complaint = str(error)
    assert len(complaint.splitlines()) == 1 and complaint
    for item in sets:
        rec = item.satrec
        assert 0 <= rec.ecco < 1 and 0 <= rec.inclo <= math.pi and 0 < rec.no_kozai < 0.08
        assert all(map(math.isfinite, (rec.nodeo, rec.argpo, rec.mo, rec.bstar, *item.epoch_jd_utc)))
        assert 2435839 < sum(item.epoch_jd_utc) < 2488435  # 1957 to 2101


def test_designators_of_other_digits_are_taken_as_they_stand():
    assert plain_designator(" 98067A ") == "1998-067A"
    assert plain_designator("9²067A") == "9²067A"  # a digit to Python, not to int()


@settings(max_examples=200, deadline=None)
@given(text=st.text(max_size=200))
@pytest.mark.ci
def test_random_text_is_an_error_of_one_line(text):
    with pytest.raises(InputError) as caught:
        parse_element_sets(text)
    assert len(str(caught.value).splitlines()) == 1


def test_omm_fields_are_taken_as_the_sgp4_package_takes_them():
    from sgp4 import omm
    from sgp4.api import Satrec

    fields = {**ISS_FIELDS, "MEAN_MOTION_DDOT": ".12345E-6", "BSTAR": "-.5E-3"}
    theirs = Satrec()
    omm.initialize(theirs, fields)
    mine = parse_element_sets(kvn(fields))[0].satrec
    for name in ("ecco", "inclo", "nodeo", "argpo", "mo", "no_kozai", "bstar", "ndot", "nddot", "jdsatepoch"):
        assert getattr(mine, name) == pytest.approx(getattr(theirs, name), abs=0, rel=1e-15)
    assert mine.jdsatepochF == pytest.approx(theirs.jdsatepochF, abs=4e-12, rel=0)
