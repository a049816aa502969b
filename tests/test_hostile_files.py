"""Names, links, archives and texts that lead elsewhere: files stay in their folder, words on their line."""

from __future__ import annotations

import copy
import gzip
import io
import json
import shutil
import tarfile
import zipfile

import numpy as np
import pytest
from astropy.io import fits
from command_line import printed, refused, run
from element_sets import low_orbit, read_element_sets
from exchange_samples import OEM, OEM_XML
from fuzz_cases import PARTS, SCENE

import warpsim as ws
from warpsim.files import whole_file
from warpsim.output.checkpoints import whole_folder
from warpsim.output.output_folder import PARTS as RUN_PARTS
from warpsim.output.star_catalogs import write_catalog

EVIL = "\x1b]0;x\x07\x1b[31mred\x9b\u202e\r\x7f"
"""Escapes of terminals, a bell, the 8-bit form of both, a turn of the reading direction, a return, a deletion."""
DOLLARS = r"../$\frac$ of 5 $ and \$x_{y"
"""What matplotlib would take for formulas, of which the first is broken."""
XML_HEAD = '<?xml version="1.0"?>'


def small(**changes):
    """A scene of one small image for each of two satellites, which are always asked for."""
    fixed = {"kind": "fixed", "ra_dec_deg": [10.0, 20.0]}
    scene = {**copy.deepcopy(SCENE), "pointing": fixed, "frames": {"count": 2, "interval_s": 10.0}, "access_rules": {}}
    return ws.Scene.from_dict({**scene, "camera": {"n_row": 16, "n_col": 16, "fov_deg": 2.0}, **changes})


def is_plain(text):
    return all(c.isprintable() or c == "\n" for c in text)


@pytest.fixture
def outside(tmp_path):
    """A folder that nobody may touch, and what says whether it was."""
    folder = tmp_path / "outside"
    (folder / "deep").mkdir(parents=True)
    for name in ("lock", "mine.txt", "deep/mine.json"):
        (folder / name).write_text("mine")
    before = sorted((path.relative_to(folder), path.is_file() and path.read_text()) for path in folder.rglob("*"))

    def check():
        now = sorted((path.relative_to(folder), path.is_file() and path.read_text()) for path in folder.rglob("*"))
        assert now == before

    folder_and_check = folder, check
    yield folder_and_check
    check()


# --- texts ---


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """A scene whose satellites, stars, description and file names are hostile, as a file."""
    folder = tmp_path_factory.mktemp("hostile")
    rng = np.random.default_rng(3)
    first, second = low_orbit(1, rng), low_orbit(2, rng)
    first[0], second[0] = f"SAT {EVIL.replace(chr(13), '')}ONE", "X" * 300
    (folder / "sets.tle").write_text("\n".join([*first, *second, *low_orbit(3, rng)[:2]]))
    stars = "".join(f"{10.0 + 0.05 * k},{20.0},{1e-3},{EVIL[:-2]}{k}\n" for k in range(-5, 6))
    (folder / "stars.csv").write_bytes(f"ra_deg,dec_deg,flux_A_jy,id\n{stars}".encode())
    scene = small(
        name=DOLLARS, description=f"<script>alert(1)</script>{EVIL}\nsecond line",
        constellation={"kind": "tle", "file": str(folder / "sets.tle")}, sky={"catalog": str(folder / "stars.csv")},
    )  # fmt: skip
    scene.save(folder / "scene.json")
    return folder


@pytest.mark.ci
def test_reports_and_tables_of_hostile_files_are_plain(capsys, hostile, tmp_path):
    path = hostile / "scene.json"
    assert is_plain(printed(capsys, "check", path))
    for form in ("table", "csv", "ecsv"):
        assert is_plain(printed(capsys, "access", path, "--format", form))
    scenario = ws.Scene.load(path).scenario
    assert scenario.satellite_names == ["SAT_0_x_31mred_ONE", "X" * 100]
    assert all(is_plain(str(row)) for row in scenario.left_out)
    assert is_plain(printed(capsys, "catalog", hostile / "stars.csv"))


@pytest.mark.ci
def test_files_of_runs_say_hostile_names_plainly(capsys, hostile, tmp_path, monkeypatch):
    """FITS headers and tables, the manifest, CZML and the words on the contact sheet."""
    import OpenImageIO as oiio

    drawn, draw = [], oiio.ImageBufAlgo.render_text
    monkeypatch.setattr(oiio.ImageBufAlgo, "render_text", lambda *given: drawn.append(given[3]) or draw(*given))
    path, folder = hostile / "scene.json", tmp_path / "run"
    assert is_plain(printed(capsys, "render", path, "-o", folder, "--stars", "--every-frame"))
    assert any(DOLLARS in text for text in drawn) and all(map(is_plain, drawn))
    assert is_plain((folder / "manifest.json").read_text())
    names = [path.name for path in folder.rglob("*")]
    assert "SAT_0_x_31mred_ONE_A.fits" in names and f"{'X' * 100}_A.fits" in names
    ids = set()
    for file in folder.glob("*.fits"):
        with fits.open(file) as units:
            assert all(is_plain(str(card)) for unit in units for card in unit.header.cards)
            assert units[0].header.get("SCENE", DOLLARS) == DOLLARS
            if file.name == "stars.fits":
                texts = [name for name in units[1].columns.names if units[1].data[name].dtype.kind == "U"]
                ids = {str(text) for name in texts for text in units[1].data[name]}
    assert any("red" in text for text in ids) and all(map(is_plain, ids))
    assert is_plain(printed(capsys, "czml", path, "-o", tmp_path / "x.czml", "--step", "30"))
    czml = (tmp_path / "x.czml").read_text()
    assert is_plain(czml) and json.loads(czml)[0]["description"].startswith(
        "&lt;script&gt;alert(1)&lt;/script&gt;?]0;x"
    )


@pytest.mark.parametrize("suffix", ["fits", "ecsv", "vot", "csv"])
def test_catalogs_of_hostile_names_come_back_from_every_format(tmp_path, hostile, suffix):
    """Control characters made VOTables that nobody reads, and took name and provenance from FITS."""
    table = ws.StarCatalog.read(hostile / "stars.csv").to_table()
    table["id"] = [f"{EVIL}{k}" for k in range(len(table))]
    table.meta |= {"name": EVIL, "provenance": f"{EVIL}\n\xe9"}
    catalog = ws.StarCatalog.from_table(table)
    assert (catalog.name, catalog.provenance[-2:]) == ("?]0;x??[31mred?? ?", " \xe9")
    write_catalog(catalog, tmp_path / f"x.{suffix}")
    again = ws.StarCatalog.read(tmp_path / f"x.{suffix}")
    assert again.to_table()["id"].tolist() == [f"?]0;x??[31mred?? ?{k}" for k in range(len(table))]
    if suffix in ("fits", "ecsv"):
        assert again.name == catalog.name and again.provenance[:-1].startswith(catalog.provenance[:-1])


@pytest.fixture
def svg_text(monkeypatch):
    """SVG whose texts are texts."""
    matplotlib = pytest.importorskip("matplotlib")
    monkeypatch.setitem(matplotlib.rcParams, "svg.fonttype", "none")
    return DOLLARS.replace("&", "&amp;")


def test_dollars_in_names_are_drawn_as_they_are(capsys, tmp_path, hostile, svg_text):
    printed(capsys, "access", hostile / "scene.json", "--plot", tmp_path / "access.svg")
    assert (tmp_path / "access.svg").read_text().count(svg_text) >= 2  # above each of two charts
    table = ws.StarCatalog.read(hostile / "stars.csv").to_table()
    table.meta["name"] = f"{DOLLARS}{EVIL}"
    write_catalog(ws.StarCatalog.from_table(table), tmp_path / "x.ecsv")
    printed(capsys, "catalog", tmp_path / "x.ecsv", "--plot", tmp_path / "counts.svg")
    assert f"{svg_text}?]0;x" in (tmp_path / "counts.svg").read_text() and is_plain(
        (tmp_path / "counts.svg").read_text()
    )


@pytest.mark.ci
def test_every_figure_of_a_scene_draws_dollars(capsys, tmp_path, svg_text):
    """All are drawn; their titles are read from matplotlib, as nobody reads those of a PNG."""
    from matplotlib.figure import Figure

    titles, save = [], Figure.savefig

    def saved(figure, *given, **more):
        titles.extend(ax.get_title() for ax in figure.axes)
        return save(figure, *given, **more)

    ws.Scene.from_dict({**SCENE, **PARTS["group"], "name": DOLLARS}).save(tmp_path / "s.toml")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", saved)
        printed(capsys, "plot", tmp_path / "s.toml", "-o", tmp_path / "figures")
    named = [title for title in titles if "frac" in title]
    assert len(named) >= 6
    assert all(title.replace(r"\$", "$").count("$") == DOLLARS.count("$") and r"\$\frac\$" in title for title in named)


def test_paths_that_steer_terminals_are_printed_plainly(capsys, tmp_path):
    folder = tmp_path / "\x1b[31mred"
    folder.mkdir()
    small().save(folder / "s.json")
    out = printed(capsys, "detect", folder / "s.json", "-o", folder / "d.csv", "--frames", "0")
    assert "detections in" in out and is_plain(out)
    assert is_plain(printed(capsys, "access", folder / "s.json", "--plot", folder / "a.png"))
    assert is_plain(refused(capsys, "export", folder, "-o", folder / "e", "--format", "yolo"))
    code, out, err = run(capsys, "bench", folder / "none.json", "--json", folder / "b.json")
    assert code == 2 and is_plain(out + err)


# --- names of files ---

LEAVING = [
    "../up",
    "a/b",
    "..",
    ".hidden",
    "two\nlines",
    "x\n",
    "",
    "nul\0",
    "/root",
    "a\\b",
    EVIL,
    "x" * 300,
    "~",
    "-o",
]


@pytest.mark.parametrize("name", LEAVING)
@pytest.mark.parametrize(
    "path", ["target", "class", "group", "sensor", "satellite", "band", "own band", "psf band", "split", "crossing"]
)
def test_names_that_become_files_are_plain(tmp_path, path, name):
    scene = copy.deepcopy({**SCENE, **PARTS["airy"], **PARTS["listed"]})
    scene["groups"] = [{"name": "main", "trajectory": scene.pop("trajectory"), "targets": scene.pop("targets")}]
    parts = ("bands", "camera", "optics", "detector", "pointing")
    scene["sensors"] = [{"name": "cam", **{part: scene.pop(part) for part in parts}}]
    recipe = {"n_sequence": 1, "n_frame": 1}
    holder, key = {
        "target": (scene["groups"][0]["targets"][0], "name"), "class": (scene["groups"][0]["targets"][0], "class"),
        "group": (scene["groups"][0], "name"), "sensor": (scene["sensors"][0], "name"),
        "satellite": (scene["constellation"]["satellites"][0], "name"), "band": (scene["sensors"][0]["bands"], 0),
        "own band": (scene["band"], name), "psf band": (scene["sensors"][0]["optics"], "psf_file"),
        "split": (recipe, "split"), "crossing": (recipe, "crossings"),
    }[path]  # fmt: skip
    values = {"own band": {"half_power_um": [8.0, 9.0]}, "psf band": {name: "x.fits"}, "split": {name: 1.0},
              "crossing": {name: {"range_km": [10.0, 20.0], "speed_m_s": [1.0, 2.0]}}}  # fmt: skip
    holder[key] = values.get(path, name)
    with pytest.raises(ws.InputError) as caught:
        ws.Recipe(scene=ws.Scene.from_dict(scene), **recipe)
    assert str(caught.value).isprintable()


def test_long_names_of_files_of_others_are_cut(tmp_path):
    """Element sets and orbits may call objects by any name; two that begin alike are told apart."""
    lines = [line for number in (1, 2) for line in ["N" * 300, *low_orbit(number, np.random.default_rng(number))[1:]]]
    names = ws.TleSatellites(lines=lines).names
    assert names == ["N" * 100 + "-00001", "N" * 100 + "-00002"]
    (tmp_path / "x.oem").write_text(OEM.replace("SAT ONE", "../../" + "N" * 300))
    assert ws.EphemerisSatellites(tmp_path / "x.oem").names[0] == "N" * 100


def test_names_too_long_together_are_refused_before_the_work(tmp_path):
    """Of satellite, kind of sensor and band: file systems take 255 letters."""
    scene = small(**PARTS["listed"]).to_dict()
    scene["constellation"]["satellites"][0]["name"] = "s" * 100
    own = {"half_power_um": [8.0, 9.0]}
    scene |= {"band": {"b" * 100: own, "c" * 100: own}, "sensors": [
        {**scene["sensors"][0], "name": "k" * 100, "bands": ["b" * 100]},
        {**scene["sensors"][0], "name": "l" * 100, "bands": ["c" * 100]}]}  # fmt: skip
    with pytest.raises(ws.InputError, match="names of sensor and band: must have at most 220 letters together, got 's"):
        ws.render_to_folder(ws.Scene.from_dict(scene), tmp_path / "run", every_frame=True, device="cpu")
    assert not (tmp_path / "run").exists()
    with pytest.raises(ws.InputError, match=r"must be names of letters, digits, '_', '\.' or '-', at most 100"):
        ws.Scene.from_dict(scene | {"band": {"b" * 101: own}})


@pytest.mark.ci
def test_archives_hold_long_names_and_nothing_that_leads_out(tmp_path):
    """Headers of plain tar end at 100 letters; those of short names stay as they were."""
    pytest.importorskip("pyarrow")
    scene = small(**PARTS["listed"]).to_dict()
    members = {}
    for name in ("s", "s" * 100):
        scene["constellation"]["satellites"][0]["name"] = name
        recipe = ws.Recipe(scene=ws.Scene.from_dict(scene), n_sequence=1, n_frame=1, every_frame=True,
                           format="webdataset", split={"all": 1})  # fmt: skip
        ws.write_dataset(recipe, tmp_path / name, n_worker=1, device="cpu")
        data = (tmp_path / name / "all" / "000000.tar").read_bytes()
        with tarfile.open(fileobj=io.BytesIO(data)) as tar:
            members[name] = {one.name: tar.extractfile(one).read() for one in tar}
            if name == "s":
                plain = io.BytesIO()
                with tarfile.open(fileobj=plain, mode="w", format=tarfile.USTAR_FORMAT) as other:
                    for one in tar:
                        other.addfile(one, io.BytesIO(members[name][one.name]))
                assert plain.getvalue() == data
    assert [key.replace("s" * 100, "s") for key in members["s" * 100]] == list(members["s"])
    for name in ("s", "s" * 100):
        ws.export_dataset(tmp_path / name, tmp_path / f"{name}-yolo", "yolo")


# --- archives and XML on the way in ---


def _zip(name, text):
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        archive.writestr(name, text)
    return data.getvalue()


def _tar(name, text):
    data = io.BytesIO()
    with tarfile.open(fileobj=data, mode="w") as archive:
        member = tarfile.TarInfo(name)
        member.size = len(text)
        archive.addfile(member, io.BytesIO(text.encode()))
        archive.addfile(tarfile.TarInfo(name="link"))
    return data.getvalue()


@pytest.mark.parametrize("name", ["../../up.txt", "/tmp/up.txt", "x.oem"])
@pytest.mark.parametrize("pack", [_zip, _tar, lambda name, text: gzip.compress(_tar(name, text))])
@pytest.mark.parametrize(
    "read", [ws.read_ephemeris, ws.read_attitude, read_element_sets, ws.StarCatalog.read,
             lambda path: ws.Mesh(file=path).surface],
)  # fmt: skip
def test_archives_are_no_files_that_are_read(tmp_path, outside, pack, name, read):
    """Nothing is unpacked: what holds several files is refused, whatever it is called."""
    home = outside[0] / "deep"
    inner = tmp_path / "inner"
    inner.mkdir()
    for suffix in ("oem", "csv", "obj", "zip"):
        (inner / f"x.{suffix}").write_bytes(pack(name, OEM))
        with pytest.raises(ws.InputError) as caught:
            read(str(inner / f"x.{suffix}"))
        assert str(caught.value).isprintable()
    assert sorted(path.name for path in inner.iterdir()) == ["x.csv", "x.obj", "x.oem", "x.zip"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["inner", "outside"] and home.is_dir()


def test_names_within_gzip_are_not_followed(tmp_path, outside):
    data = io.BytesIO()
    with gzip.GzipFile("../outside/mine.txt", "wb", fileobj=data) as packed:
        packed.write(OEM.encode())
    (tmp_path / "x.oem").write_bytes(data.getvalue())
    assert len(ws.read_ephemeris(tmp_path / "x.oem")) == len(OEM.split("META_START")) - 1


OMM_XML = f"""{XML_HEAD}
<ndm><omm id="CCSDS_OMM_VERS" version="2.0"><body><segment><metadata><OBJECT_NAME>A</OBJECT_NAME></metadata>
<data><meanElements><EPOCH>2025-03-20T12:00:00</EPOCH></meanElements></data></segment></body></omm></ndm>
"""
VOTABLE = f"""{XML_HEAD}
<VOTABLE version="1.4" xmlns="http://www.ivoa.net/xml/VOTable/v1.3"><RESOURCE><TABLE>
<FIELD name="ra_deg" datatype="double" unit="deg"/><FIELD name="dec_deg" datatype="double" unit="deg"/>
<FIELD name="flux_A_jy" datatype="double" unit="Jy"/><FIELD name="id" datatype="char" arraysize="*"/>
<DATA><TABLEDATA><TR><TD>1</TD><TD>1</TD><TD>1</TD><TD>A</TD></TR></TABLEDATA></DATA></TABLE></RESOURCE></VOTABLE>
"""
LAUGHS = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10 if k else "lol"}">' for k in range(12))


@pytest.mark.parametrize("entities", [f"<!DOCTYPE x [{LAUGHS}]>", '<!DOCTYPE x [<!ENTITY l11 SYSTEM "file://{}">]>'])
@pytest.mark.parametrize(
    ("text", "read"),
    [
        (OMM_XML, read_element_sets),
        (OEM_XML.replace("SAT ONE", "A"), ws.read_ephemeris),
        (VOTABLE, ws.StarCatalog.read),
    ],
    ids=["omm", "oem", "votable"],
)
def test_entities_of_xml_are_refused(tmp_path, outside, text, read, entities):
    """Neither laughed at a billion times nor read from files."""
    head = f"{XML_HEAD}\n{entities.replace('{}', str(outside[0] / 'mine.txt'))}"
    body = text.partition("?>")[2].replace(">A<", ">&l11;<")
    assert "&l11;" in body
    (tmp_path / "x.xml").write_text(f"{head}\n{body}")
    with pytest.raises(
        ws.InputError, match=r"must have no document type of its own|must declare no entities"
    ) as caught:
        read(tmp_path / "x.xml")
    assert "mine" not in str(caught.value).partition("x.xml")[2]


def test_the_old_document_type_of_votables_is_read(tmp_path):
    """VOTable 1.0 names a file on the web, which nobody reads."""
    old = VOTABLE.replace(XML_HEAD, f'{XML_HEAD}\n<!DOCTYPE VOTABLE SYSTEM "http://us-vo.org/xml/VOTable.dtd">')
    (tmp_path / "x.vot").write_text(old)
    with pytest.warns(UserWarning, match="no colour"):
        assert len(ws.StarCatalog.read(tmp_path / "x.vot")) == 1


# --- links ---


def test_a_partial_file_that_is_a_link_is_not_written_through(tmp_path, outside):
    """The name that a file has until it is whole."""
    (tmp_path / ".x.txt.partial").symlink_to(outside[0] / "mine.txt")
    with whole_file(tmp_path / "x.txt") as partial:
        partial.write_text("ours")
    assert (tmp_path / "x.txt").read_text() == "ours" and not (tmp_path / "x.txt").is_symlink()


@pytest.mark.parametrize("target", ["mine.txt", "new.txt"])
@pytest.mark.parametrize("name", [".d.csv.partial", "d.csv", ".d.json.partial", "d.json"])
def test_links_beside_a_file_of_a_command_lead_nowhere(capsys, tmp_path, outside, name, target):
    small().save(tmp_path / "s.json")
    (tmp_path / name).symlink_to(outside[0] / target)
    code, out, err = run(
        capsys, "detect", tmp_path / "s.json", "-o", tmp_path / "d.csv", "--frames", "0", "--overwrite"
    )
    assert code == 0, out + err
    assert not (tmp_path / name).is_symlink()


LINKS = [RUN_PARTS, f"{RUN_PARTS}/lock", f"{RUN_PARTS}/checkpoints", f"{RUN_PARTS}/planned", f"{RUN_PARTS}/work",
         f"{RUN_PARTS}/growing", f"{RUN_PARTS}/run.json", f"{RUN_PARTS}/finish.json"]  # fmt: skip


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("name", LINKS)
def test_links_in_the_folder_of_a_run_are_refused(tmp_path, outside, name, overwrite):
    """They would be written through, emptied and removed."""
    link = tmp_path / "run" / name
    link.parent.mkdir(parents=True)
    link.symlink_to(outside[0] if name != f"{RUN_PARTS}/lock" else outside[0] / "lock")
    with pytest.raises(ws.InputError, match=f"{link.name}: must not be a link: the files behind it may be others'"):
        ws.render_to_folder(small(), tmp_path / "run", [0], every_frame=True, overwrite=overwrite, device="cpu")
    assert link.is_symlink()


@pytest.mark.ci
@pytest.mark.parametrize(
    "name", ["sat11_A.fits", "truth.fits", "manifest.json", ".truth.fits.partial", "sat11_A/x.png"]
)
def test_links_among_the_files_of_a_finished_run_lead_nowhere(tmp_path, outside, name):
    """One is in place of a file when the run is repaired, and when it is replaced by another."""
    folder = tmp_path / "run"
    form = "png" if "/" in name else "fits"
    given = {"every_frame": True, "formats": form, "device": "cpu"}
    ws.render_to_folder(small(), folder, [0], **given)
    link = folder / name if "/" not in name else folder / "sat11_A"
    if link.is_dir():
        shutil.rmtree(link)
    link.unlink(missing_ok=True)
    link.symlink_to(outside[0] / "mine.txt" if "/" not in name else outside[0])
    for scene, overwrite in ((small(), False), (small(seed=2), True)):
        try:
            ws.render_to_folder(scene, folder, [0], **given, overwrite=overwrite)
        except ws.InputError as error:
            assert "must not be a link" in str(error) or "did not write it" in str(error)  # noqa: PT017
        outside[1]()


@pytest.mark.ci
@pytest.mark.parametrize("format", ["png", "zarr"])
def test_links_deep_in_a_data_set_are_refused(tmp_path, outside, format):
    """Below a split, which is the data set's own: a sequence's folder, or one of an array, leads elsewhere."""
    pytest.importorskip("pyarrow")
    if format == "zarr":
        pytest.importorskip("zarr", minversion="3")
    recipe = ws.Recipe(scene=small(), n_sequence=2, n_frame=1, every_frame=True, format=format, split={"all": 1})
    ws.write_dataset(recipe, tmp_path / "set", n_worker=1, device="cpu")
    inner = tmp_path / "set" / "all" / ("000000" if format == "png" else "images.zarr")
    shutil.rmtree(inner)
    inner.symlink_to(outside[0])
    with pytest.raises((ws.InputError, OSError), match="must not be a link"):
        ws.write_dataset(recipe, tmp_path / "set", n_worker=1, device="cpu")


@pytest.mark.parametrize("name", [".new.partial", ".new.partial/lock", ".new.partial/new"])
def test_links_where_a_folder_becomes_whole_are_refused(tmp_path, outside, name):
    link = tmp_path / name
    link.parent.mkdir(exist_ok=True)
    link.symlink_to(outside[0] / "lock" if name.endswith("lock") else outside[0])
    with pytest.raises(ws.InputError, match="must not be a link"), whole_folder(tmp_path / "new"):
        raise AssertionError


# --- data sets of others ---


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    pytest.importorskip("pyarrow")
    scene = small(description=f"a{EVIL}\nb: c")
    recipe = ws.Recipe(scene=scene, n_sequence=1, n_frame=1, every_frame=True, format="png", split={"all": 1})
    folder = tmp_path_factory.mktemp("sets") / "set"
    ws.write_dataset(recipe, folder, n_worker=1, device="cpu")
    return folder


@pytest.mark.ci
@pytest.mark.parametrize("layout", ["yolo", "mot", "huggingface"])
def test_texts_of_exports_are_plain(dataset, tmp_path, layout):
    ws.export_dataset(dataset, tmp_path / "out", layout)
    texts = [path for path in (tmp_path / "out").rglob("*") if path.suffix in (".md", ".yaml", ".txt", ".json", ".csv")]
    assert texts and all(is_plain(path.read_text()) for path in texts)


@pytest.mark.ci
@pytest.mark.parametrize("value", ["../../outside/x", "{}/x", "a\nb", EVIL, "..", ""])
@pytest.mark.parametrize("field", ["split", "sensor", "band", "file", "target", "class"])
def test_exports_of_hostile_data_sets_stay_in_their_folder(dataset, tmp_path, outside, field, value):
    from pyarrow import parquet

    folder = shutil.copytree(dataset, tmp_path / "in" / "set")
    value = value.replace("{}", str(outside[0]))
    if field == "split":
        manifest = json.loads((folder / "manifest.json").read_text())
        manifest["splits"] = {value: manifest["splits"]["all"]}
        (folder / "manifest.json").write_text(json.dumps(manifest))
    else:
        name = "truth" if field in ("target", "class") else "images"
        path = folder / "all" / "000000" / f"{name}.parquet"
        table = parquet.read_table(path)
        column = table.column_names.index(field)
        changed = type(table).from_pydict({**table.to_pydict(), field: [value] * len(table)})
        assert changed.column_names[column] == field
        parquet.write_table(changed.replace_schema_metadata(table.schema.metadata), path)
    (tmp_path / "home").mkdir()
    for layout in ("yolo", "mot", "huggingface"):
        with pytest.raises(ws.InputError, match="must have plain names of splits, sensors") as caught:
            ws.export_dataset(folder, tmp_path / "home" / layout, layout)
        assert str(caught.value).isprintable()
    assert list((tmp_path / "home").iterdir()) == []
