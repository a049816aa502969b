"""Hostile scenes, names and files: one printable line each, nothing outside its folder, work bounded."""

from __future__ import annotations

import copy
import json
import warnings

import fuzz
import numpy as np
import pytest
from command_line import refused, run
from conftest import slow
from exchange_samples import OEM_XML
from fuzz_cases import CHECK, PARTS, SCENE, _leaves, of_file, of_scene, whole_cases

import warpsim as ws
from warpsim.arguments import check_memory
from warpsim.detector.pixel_maps import maps_path
from warpsim.errors import InputError, one_line, printable_lines
from warpsim.exchange.curve_file import read_curve
from warpsim.optics.telescope import read_psf_file
from warpsim.tables.checked_files import npy_array
from warpsim.target.mesh import Mesh

RED = "\x1b[31mred"


def scene_with(part, **changes):
    """The small scene with a part, and changes by path as in `detector__nei_w_cm2`."""
    scene = copy.deepcopy({**SCENE, **PARTS.get(part, {})})
    for path, value in changes.items():
        *way, last = path.split("__")
        holder = scene
        for step in way:
            holder = holder[int(step) if step.isdecimal() else step]
        holder[last] = value
    return scene


@pytest.mark.parametrize(
    "value", [10**400, -(10**400), 10**5000, 1.7e308, 5e-324], ids=["400", "-400", "5000", "huge", "tiny"]
)
@pytest.mark.parametrize("part", sorted(PARTS))
def test_numbers_of_any_size_are_refused_or_taken(part, value):
    base = copy.deepcopy({**SCENE, **PARTS[part]})
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        for k in range(len(_leaves(base))):
            scene = copy.deepcopy(base)
            holder, key = _leaves(scene)[k]
            if isinstance(holder[key], bool) or not isinstance(holder[key], int | float):
                continue
            holder[key] = value
            try:
                ws.Scene.from_dict(scene)
            except ws.InputError as error:
                assert str(error).isprintable() and len(str(error)) < 1000  # noqa: PT017


MANY = {"targets": [SCENE["targets"][0], {**SCENE["targets"][0], "name": "bit", "count": 10_000}]}
BALL, TANK = SCENE["targets"][0], PARTS["heat"]["targets"][0]
BANDS, CROWD = [f"b{k}" for k in range(101)], {**SCENE["constellation"], "n_satellite": 100_000}
STEPS = [{"start_s": 0.005 * k, "ra_dec_deg": [10.0, 5.0]} for k in range(2501)]


@pytest.mark.parametrize(
    ("part", "changes", "rule"),
    [
        ("", {"duration_s": 1e18}, "duration_s: 1e+18 s are too long"),
        ("", {"duration_s": 3e6}, "duration_s: must be at most 2.6784e+06 (31 days)"),
        ("", {"frames__count": 10**9, "frames__interval_s": 6e-8}, "frames.count: must be so few that frames times"),
        ("", {"seed": 10**400}, "seed: must be below 2**64, got "),
        ("state", {"trajectory__velocity_m_s": [0.0, 5e9, 0.0]}, "velocity_m_s: must be at most 1e+06 m/s, got 5e+09"),
        ("", {"detector__nei_w_cm2": 1e-50}, "its NEI must be from 1e-35 to 1e+30 W/cm2"),
        ("electron", {"optics__aperture_m": 1e50}, "its NEI must be from 1e-35"),
        ("", {"targets": [BALL, *({**BALL, "name": name, "count": 100_000} for name in "ab")]},
         "targets: must be at most 200,000 single targets"),
        ("", {"targets": [BALL, {**TANK, "count": 50_000}]},
         "targets[1].count: 50,000 heat balances over 60 s are too much work: "),
        ("", {"band": {name: {"half_power_um": [5.0, 6.0]} for name in BANDS}, "bands": BANDS},
         "bands: must be at most 100 in all sensors, got 101"),
        ("", {"band": {"own": {"wavelength_um": np.linspace(5.0, 6.0, 20_001), "response": np.ones(20_001)}},
          "bands": ["own"]}, "wavelength_um: must have at most 20,000 nodes, got 20,001"),
        ("", {"constellation": {"kind": "mixed", "parts": [{**CROWD, "prefix": prefix} for prefix in "ab"]}},
         "parts: must hold at most 100,000 satellites"),
        ("", {"pointing": {**PARTS["schedule"]["pointing"], "steps": STEPS}},
         "pointing: must have at most 10,000 steps with a slew in all, got 10004"),
        ("", {**MANY, "pointing": {"track": "group"}}, "pointing.track: must be at most 10,000 targets, got 10001"),
        ("", {"targets": [{**BALL, "spread": {"shape.radius_m": {"choice": [0.5] * 1001}}}]},
         "must be at most 1,000 values, each of which is tried"),
    ],
)  # fmt: skip
def test_work_and_numbers_beyond_all_bounds_are_errors_of_their_field(part, changes, rule):
    with pytest.raises(ws.InputError) as error:
        ws.Scene.from_dict(scene_with(part, **changes)).scenario.tracks  # noqa: B018
    assert rule in str(error.value)


def test_memory_that_is_not_there_is_refused_before_it_is_taken(monkeypatch):
    check_memory(1e6, "this")
    with pytest.raises(ws.InputError, match=r"this would take 9.3e\+08 GB of memory, and [\d.e+]+ GB are free"):
        check_memory(1e18, "this")
    monkeypatch.setattr("warpsim.arguments.free_bytes", lambda: 1e9)
    with pytest.raises(ws.InputError, match="10,000,000 synthetic stars would take 1"):
        ws.StarCatalog.synthetic(10_000_000)


@pytest.mark.parametrize(
    "error", [MemoryError("Unable to allocate"), RuntimeError("Failed to allocate 9 bytes on device 'cpu'")]
)
def test_want_of_memory_is_one_line(capsys, monkeypatch, error):
    def fail(*_):
        raise error

    monkeypatch.setattr("warpsim.output.check.scene_report", fail)
    code, _, err = run(capsys, "check", "stss")
    assert (code, err) == (1, f"warpsim: there is not enough memory: {error}\n")


def test_a_flight_of_ages_is_refused():
    """It could not be found in a time that anybody waits."""
    with pytest.raises(ws.InputError, match=r"trajectory\.duration_s: must be at most 2678400 \(31 days\)"):
        ws.Scene.from_dict(scene_with("", trajectory__duration_s=6e11))


HEADER = b"\x93NUMPY\x01\x00\x76\x00{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }"


@pytest.mark.parametrize(
    "header",
    [HEADER.replace(b"(2, 3)", b"(2, 3"), HEADER.replace(b"(2, 3)", b"(99999999, 99999999)"), HEADER[:20],
     HEADER.replace(b"(2, 3)", b"(-2, -3)"), HEADER.replace(b"<f8", b"|O")],
    ids=["bracket", "exabytes", "short", "negative", "objects"],
)  # fmt: skip
def test_damaged_headers_of_npy_are_one_line(tmp_path, header):
    whole = header.ljust(127) + b"\n" + np.arange(6.0).tobytes()
    (tmp_path / "psf.npy").write_bytes(whole)
    with pytest.raises(ws.InputError, match=r"psf\.npy: cannot be read as a NumPy array: ") as error:
        read_psf_file(str(tmp_path / "psf.npy"))
    assert str(error.value).isprintable()
    good = HEADER.ljust(127) + b"\n" + np.arange(6.0).tobytes()
    assert np.array_equal(npy_array(good), np.arange(6.0).reshape(2, 3))


def test_negative_samples_of_a_psf_are_refused():
    with pytest.raises(ws.InputError, match="image: must hold no negative samples, clip them at 0, got 1"):
        ws.PsfTable([[1.0, -0.1]], 1.0)


def test_errors_of_a_library_do_not_leak_python(tmp_path):
    for error in (UnboundLocalError("local variable 'x'"), KeyError("x"), IndexError("list index")):
        assert one_line(error) == "it is damaged, or of another form"
    files = of_file("mesh", "body.ply", CHECK).files
    (tmp_path / "body.ply").write_bytes(files["body.ply"].replace(b"element face 4\n", b""))
    with pytest.raises(ws.InputError) as caught:
        Mesh(file=str(tmp_path / "body.ply")).surface  # noqa: B018
    assert "variable" not in str(caught.value)


def test_carriage_returns_within_lines_are_refused(tmp_path):
    (tmp_path / "x.csv").write_bytes(b"wavelength_um,response\n8.0,0.0\n8.5,\r1.0\n")
    with pytest.raises(ws.InputError, match=r"line 3: must not hold a carriage return but at its end"):
        read_curve(str(tmp_path / "x.csv"))


def test_terminal_escapes_are_printed_as_question_marks(capsys, tmp_path, monkeypatch):
    assert printable_lines(f"a{RED}\nb\x9b") == "a?[31mred\nb?"
    monkeypatch.chdir(tmp_path)
    for number, scene in enumerate([{**SCENE, RED: 1}, {**SCENE, "name": RED}, {**SCENE, "bands": [RED]},
                                    {**SCENE, "sky": {"catalog": RED}}]):  # fmt: skip
        (tmp_path / f"s{number}.json").write_text(json.dumps(scene))
        assert refused(capsys, "check", f"s{number}.json").rstrip("\n").isprintable()
    assert refused(capsys, "check", f"{RED}.toml").rstrip("\n").isprintable()
    with pytest.raises(SystemExit):
        run(capsys, "check", "stss", RED)
    assert "\x1b" not in capsys.readouterr().err


@pytest.mark.parametrize(
    "name", ["a/b", "../up", "..", ".hidden", "two\nlines", "", "nul\0", "/root", "a\\b", RED, "x" * 300]
)
@pytest.mark.parametrize("path", ["targets__0__name", "listed"])
def test_names_that_leave_their_folder_are_no_names(path, name):
    scene = scene_with("listed") if path == "listed" else scene_with("", **{path: name})
    if path == "listed":
        scene["constellation"]["satellites"][0]["name"] = name
    with pytest.raises(ws.InputError):
        ws.Scene.from_dict(scene)


def test_a_document_type_is_refused_in_every_xml(tmp_path):
    bomb = '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY f SYSTEM "file:///etc/passwd">]>'
    (tmp_path / "x.xml").write_text(OEM_XML.replace("<oem ", f"{bomb}\n<oem ", 1).replace("SAT ONE", "&f;"))
    with pytest.raises(ws.InputError, match="must have no document type of its own"):
        ws.read_ephemeris(tmp_path / "x.xml")


def test_a_symbolic_link_in_an_output_folder_leads_nowhere(capsys, tmp_path):
    """A file is renamed onto the link: what the link points to stays as it was."""
    outside, out = tmp_path / "outside.txt", tmp_path / "out.czml"
    outside.write_text("mine")
    out.symlink_to(outside)
    code, _, err = run(capsys, "czml", "stss", "-o", out, "--overwrite", "--step", "600")
    assert code == 0, err
    assert outside.read_text() == "mine" and not out.is_symlink()


def test_maps_stay_beside_each_other():
    assert maps_path("maps/{sensor}.fits", "sat11").as_posix() == "maps/sat11.fits"


@pytest.mark.parametrize("n_case", [1, slow(10)])
@pytest.mark.ci
def test_seeds_of_the_fuzz_are_whole_and_a_few_cases_end_well(tmp_path, n_case):
    fuzz.prepare()
    first = {one.kind: one for one in reversed(whole_cases()) if one.arguments == CHECK}
    for kind, one in first.items():
        (tmp_path / kind).mkdir()
        found = fuzz.run_case(one, tmp_path / kind)
        assert (found.broken, found.code) == ("", 0), (kind, found.printed)
    for number in range(n_case):
        (tmp_path / f"case{number}").mkdir()
        found = fuzz.run_case(fuzz.case(1, number), tmp_path / f"case{number}")
        assert not found.broken, (number, found.printed)


def test_the_fuzz_sees_what_is_broken():
    assert [fuzz._verdict(*arguments) for arguments in (
        (fuzz.CRASHED, "x", 0.0, []), (-11, "", 0.0, []), (0, "", 21.0, []), (2, "warpsim: a\nb", 0.0, []),
        (2, "warpsim: \x1b", 0.0, []), (0, "MemoryError", 0.0, []), (0, "", 0.0, ["up"]), (2, "warpsim: a", 0.1, []),
        (1, "warpsim: there is not enough memory: x", 0.0, []),
    )] == ["traceback", "signal", "hang", "lines", "unprintable", "memory", "outside", "", "memory"]  # fmt: skip


def test_errors_of_one_line_stay_so():
    assert str(InputError("a\nb", "c\td", RED)).isprintable()
    assert len(of_scene(["state"], CHECK).files) == 2
