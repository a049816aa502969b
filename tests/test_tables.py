"""Tables of files, whatever they are of: what they must be and which layouts they may follow is the caller's."""

import pytest

from warpsim.errors import InputError
from warpsim.sky.readers.layouts import LAYOUTS, likely_layout
from warpsim.tables.fixed_width import ByteField, Layout
from warpsim.tables.read_table import read_table


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
