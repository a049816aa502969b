"""Meshes: areas against closed forms and hulls, what is read from files, and what is refused."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest
from bodies import CORNERS, QUADS, TRIANGLES, unit_vectors
from refusals import refused_in_one_line
from scipy.spatial import ConvexHull

import warpsim as ws
from warpsim.errors import InputError
from warpsim.scene.provenance import input_checksums
from warpsim.scene.scene_files import to_toml
from warpsim.target.closed_surface import MOST_FACES, closed_surface

SEED = 6371

AREA_TOL = 1e-13  # of the surface: a sum of some hundred terms
SINGLE_RTOL = 1e-6  # STL and GLB hold single precision

BOX_VERTICES = (CORNERS + 0.5) * [1.0, 2.0, 3.0]
TETRA_OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def directions(n, seed=SEED):
    return unit_vectors(seed, n)


def box():
    return ws.Mesh(vertices_m=BOX_VERTICES, faces=TRIANGLES)


def hull_mesh(points):
    """The convex hull of points as a mesh, wound outwards."""
    hull = ConvexHull(points)
    faces = hull.simplices.copy()
    a, b, c = np.moveaxis(points[faces], 1, 0)
    inwards = np.sum(np.cross(b - a, c - a) * hull.equations[:, :3], axis=1) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return ws.Mesh(vertices_m=points, faces=faces)


def prism(outline, triangles, height=1.0):
    """A prism over a polygon that is given with its triangles, counter-clockwise."""
    n = len(outline)
    low, high = (np.column_stack([outline, np.full(n, z)]) for z in (0.0, height))
    here, there = np.arange(n), (np.arange(n) + 1) % n
    sides = np.vstack([np.column_stack([here, there, n + there]), np.column_stack([here, n + there, n + here])])
    caps = np.array(triangles)
    return ws.Mesh(vertices_m=np.vstack([low, high]), faces=np.vstack([caps[:, ::-1], caps + n, sides]))


def angle_iron():
    """A prism over an L: not convex."""
    outline = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]
    return prism(np.array(outline, dtype=float), [[0, 1, 2], [0, 2, 3], [0, 3, 5], [3, 4, 5]])


def double_pyramid(n_corner, stride):
    """Two pyramids over a (star) polygon; with stride 2 it goes twice round its axis and has no re-entrant edge."""
    phi = np.arange(n_corner) * stride * 2 * np.pi / n_corner
    ring = np.column_stack([np.cos(phi), np.sin(phi), 0 * phi])
    here, there = np.arange(n_corner), (np.arange(n_corner) + 1) % n_corner
    up = np.column_stack([here, there, np.full(n_corner, n_corner)])
    down = np.column_stack([there, here, np.full(n_corner, n_corner + 1)])
    return ws.Mesh(vertices_m=np.vstack([ring, [[0, 0, 2.0], [0, 0, -2.0]]]), faces=np.vstack([up, down]))


def together(*meshes):
    """Several meshes as one, moved as given."""
    vertices, faces, count = [], [], 0
    for mesh, shift, flip in meshes:
        surface = mesh.surface
        vertices.append(surface.vertices_m + shift)
        faces.append((surface.faces[:, ::-1] if flip else surface.faces) + count)
        count += len(surface.vertices_m)
    return ws.Mesh(vertices_m=np.vstack(vertices), faces=np.vstack(faces))


def test_a_box_is_six_facets_with_closed_forms():
    mesh = box()
    assert mesh.convex and len(mesh.surface.area_m2) == 6
    assert mesh.surface_m2 == pytest.approx(22.0, rel=1e-15, abs=0)
    assert mesh.surface.volume_m3 == pytest.approx(6.0, rel=1e-14, abs=0)
    view, sun, sides = directions(200), directions(200, SEED + 1), np.array([6.0, 3.0, 2.0])
    np.testing.assert_allclose(mesh.projected_area_along_m2(view), np.abs(view) @ sides, rtol=1e-14, atol=0)
    lit = np.maximum(view * sun, 0) @ sides  # each axis has a face that is seen; it is lit if the Sun is on its side
    np.testing.assert_allclose(mesh.reflected_area_m2(view, sun), lit, rtol=1e-13, atol=1e-15)


def test_outlines_of_polytopes_are_convex_hulls():
    for seed in range(5):
        points = np.random.default_rng(seed).normal(size=(60, 3)) * [1.0, 0.3, 2.0] + [5.0, 0.0, -3.0]
        mesh = hull_mesh(points)
        assert mesh.convex and mesh.notes() == []
        assert mesh.surface_m2 == pytest.approx(ConvexHull(points).area, rel=1e-13, abs=0)
        assert mesh.surface.volume_m3 == pytest.approx(ConvexHull(points).volume, rel=1e-12, abs=0)
        for view in directions(20, seed):
            across = np.linalg.svd(view[None])[2][1:]
            outline = ConvexHull(points @ across.T).volume
            assert abs(mesh.projected_area_along_m2(view) - outline) < AREA_TOL * mesh.surface_m2


def test_reflected_area_is_the_sum_over_triangles():
    """Merged facets have the light of the triangles of the mesh as given, also where it is not convex."""
    for mesh in (box(), angle_iron(), hull_mesh(directions(300))):
        a, b, c = np.moveaxis(mesh.surface.vertices_m[mesh.surface.faces], 1, 0)
        vector = np.cross(b - a, c - a) / 2
        normal = vector / np.linalg.norm(vector, axis=1, keepdims=True)
        view, sun = directions(50), directions(50, SEED + 1)
        seen, lit = np.maximum(view @ normal.T, 0), np.maximum(sun @ normal.T, 0)
        expected = (seen * lit) @ np.linalg.norm(vector, axis=1)
        assert np.abs(mesh.reflected_area_m2(view, sun) - expected).max() < AREA_TOL * mesh.surface_m2
        swapped = mesh.reflected_area_m2(sun, view)
        np.testing.assert_allclose(mesh.reflected_area_m2(view, sun), swapped, rtol=1e-13, atol=1e-15)


def test_mean_over_all_directions_is_a_quarter_of_the_surface():
    """Exact per facet: the mean of max(0, n.v) is 1/4. Quadrature of a function with kinks."""
    mesh = hull_mesh(directions(40))
    x, weight = np.polynomial.legendre.leggauss(300)
    azimuth = np.arange(600) * 2 * np.pi / 600
    ring = np.sqrt(1 - x**2)
    view = np.stack(
        [ring[:, None] * np.cos(azimuth), ring[:, None] * np.sin(azimuth), np.broadcast_to(x[:, None], (300, 600))], -1
    )
    mean = np.sum(weight / 2 / 600 * mesh.projected_area_along_m2(view).sum(axis=1))
    assert mean == pytest.approx(mesh.surface_m2 / 4, rel=1e-5, abs=0)


def test_a_mesh_inside_out_is_turned():
    inwards = ws.Mesh(vertices_m=BOX_VERTICES, faces=TRIANGLES[:, ::-1])
    np.testing.assert_array_equal(np.sort(inwards.surface.normal, axis=0), np.sort(box().surface.normal, axis=0))
    middle = inwards.surface.vertices_m.mean(axis=0)
    corner = inwards.surface.vertices_m[inwards.surface.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (np.sum((corner[:, 0] - middle) * normal, axis=1) > 0).all()
    assert inwards.reflected_area_m2([1, 0, 0], [1, 0, 0]) == 6.0


NOT_CONVEX = {
    "angle iron": angle_iron,
    "two boxes": lambda: together((box(), [0, 0, 0], False), (box(), [5, 0, 0], False)),
    "hollow box": lambda: together((hull_mesh(BOX_VERTICES * 3 - [1, 2, 3]), 0.0, False), (box(), 0.0, True)),
    "twice round": lambda: double_pyramid(5, 2),
}


@pytest.mark.parametrize("make", NOT_CONVEX.values(), ids=NOT_CONVEX)
def test_what_is_not_convex_says_so(make):
    mesh = make()
    assert not mesh.convex
    (note,) = mesh.notes()
    assert "is not convex" in note and "not modelled" in note and "\n" not in note


def test_convex_bodies_that_are_nearly_not():
    rounded = np.round(hull_mesh(directions(2000)).surface.vertices_m, 6)  # as files hold it
    assert ws.Mesh(vertices_m=rounded, faces=hull_mesh(directions(2000)).surface.faces).convex
    assert double_pyramid(5, 1).convex
    dented = hull_mesh(directions(2000)).surface
    vertices = dented.vertices_m.copy()
    vertices[17] *= 0.99
    assert not ws.Mesh(vertices_m=vertices, faces=dented.faces).convex
    for scale in ([1, 1, 1e4], [1, 1, 1e-4], [1e-5, 1e-5, 1e-5], [3e4, 3e4, 3e4]):
        assert ws.Mesh(vertices_m=BOX_VERTICES * scale, faces=TRIANGLES).convex
        assert ws.Mesh(vertices_m=hull_mesh(directions(99)).surface.vertices_m * scale + 7, faces=hull_mesh(
            directions(99)).surface.faces).convex  # fmt: skip


def test_an_aspect_is_not_enough():
    with pytest.raises(InputError, match=r"use projected_area_along_m2\(view\)"):
        box().projected_area_m2(0.3)


@pytest.mark.parametrize("ending", ["obj", "stl", "ply", "off", "glb", "STL"])
def test_files_of_all_kinds(ending, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / f"box.{ending}"
    trimesh.Trimesh(BOX_VERTICES * 1000, TRIANGLES, process=False).export(path, file_type=ending.lower())
    mesh = ws.Mesh(file=path, scale_m=1e-3)
    content = path.read_bytes()
    assert mesh.convex and len(mesh.surface.faces) == 12
    path.unlink()  # read once, on first use
    assert mesh.checksum == hashlib.sha256(content).hexdigest() and box().checksum is None
    view, sun = directions(30), directions(30, SEED + 1)
    for method, given in (("projected_area_along_m2", [view]), ("reflected_area_m2", [view, sun])):
        expected = getattr(box(), method)(*given)
        np.testing.assert_allclose(getattr(mesh, method)(*given), expected, rtol=SINGLE_RTOL, atol=SINGLE_RTOL)


def test_files_with_several_parts_polygons_and_text(tmp_path):
    pytest.importorskip("trimesh")
    quads = "".join("f " + " ".join(f"{k + 1}//1" for k in quad) + "\n" for quad in QUADS)
    lines = "".join(f"v {x} {y} {z}\n" for x, y, z in BOX_VERTICES)
    (tmp_path / "box.obj").write_text(f"mtllib none.mtl\no box # a box\n{lines}vn 0 0 1\nusemtl grey\n{quads}")
    assert ws.Mesh(file=tmp_path / "box.obj").reflected_area_m2([1, 0, 0], [1, 0, 0]) == 6.0
    trimesh = pytest.importorskip("trimesh")
    text = trimesh.Trimesh(BOX_VERTICES, TRIANGLES, process=False).export(file_type="stl_ascii")
    (tmp_path / "box.stl").write_text(text)
    assert ws.Mesh(file=str(tmp_path / "box.stl")).convex


def obj(text):
    return "body.obj", text.encode()


BAD_FILES = {
    "empty": (*obj(""), "must hold data, got an empty file"),
    "no faces": (*obj("v 0 0 0\n"), "must hold faces, got none"),
    "three faces at an edge": (
        *obj(TETRA_OBJ + "f 1 2 3\n"),
        "each edge must belong to two faces, one belongs to faces",
    ),
    "open": (*obj(TETRA_OBJ.replace("v 0 0 1", "v 0 0 1\nv 0 0 2").replace("f 2 3 4", "f 2 3 5")), "has 4 open edges"),
    "too few": (*obj(TETRA_OBJ.replace("f 1 4 3\n", "")), "must have at least 4 faces to be closed, got 3"),
    "flipped": (*obj(TETRA_OBJ.replace("f 1 4 3", "f 1 3 4")), "faces must all be wound in one sense, those of faces"),
    "out of range": (*obj(TETRA_OBJ.replace("f 1 4 3", "f 1 4 9")), "line 8: face names vertex 9 of 4"),
    "vertex 0": (*obj(TETRA_OBJ.replace("f 1 4 3", "f 0 4 3")), "line 8: numbers of vertices must count from 1"),
    "backwards": (*obj(TETRA_OBJ.replace("f 1 4 3", "f -4 4 3")), r"line 8: .*\(not backwards\), got -4"),
    "two corners": (*obj(TETRA_OBJ.replace("f 1 4 3", "f 1 4")), "line 8: a face must have at least 3 corners, got 2"),
    "no number": (
        *obj(TETRA_OBJ.replace("f 1 4 3", "f 1 4 x")),
        "line 8: corners must be numbers of vertices, got 'x'",
    ),
    "two coordinates": (*obj(TETRA_OBJ.replace("v 1 0 0", "v 1 0")), "line 2: a vertex must have 3 coordinates, got 2"),
    "NaN": (*obj(TETRA_OBJ.replace("v 1 0 0", "v nan 0 0")), "line 2: must be a finite number, got 'nan'"),
    "no area": (*obj(TETRA_OBJ.replace("v 0 0 1", "v 2 0 0")), "face 1 has no area"),
    "no volume": (*obj(TETRA_OBJ.replace("v 0 0 1", "v .3 .3 0")), "lie on each other|must enclose a volume"),
    "short STL": ("body.stl", b"\0" * 80 + b"\2\0\0\0" + b"\0" * 60, "must be a whole STL file"),
    "short text STL": ("body.stl", b"solid x\nfacet normal 0 0 1\nouter loop\n", "must be a whole STL file"),
    "no STL": ("body.stl", TETRA_OBJ.encode(), "must be a whole STL file"),
    "bad OFF": ("body.off", b"hello", "cannot be read as OFF"),
    "unknown ending": ("body.xyzq", b"hello", "cannot be read as XYZQ"),
    "no ending": ("body", b"hello", "cannot be read as a mesh"),
}


@pytest.mark.parametrize(("name", "content", "message"), BAD_FILES.values(), ids=BAD_FILES)
def test_bad_files(name, content, message, tmp_path):
    pytest.importorskip("trimesh")
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        ws.Mesh(file=tmp_path / name).surface  # noqa: B018  # read on first use
    assert name in str(caught.value) and "\n" not in str(caught.value)


def test_missing_files(tmp_path):
    missing, folder = ws.Mesh(file=tmp_path / "no.obj"), ws.Mesh(file=tmp_path)
    for use in (lambda mesh: mesh.surface_m2, lambda mesh: mesh.convex, lambda mesh: mesh.checksum):
        with pytest.raises(InputError, match=r"^/.*no\.obj: cannot be read: No such file"):
            use(missing)
        with pytest.raises(InputError, match="must be a file, got a folder"):
            use(folder)


def test_polygons_that_are_not_convex_are_refused(tmp_path):
    """Cut as a fan, an arrowhead's triangles lie on each other and would have too much area."""
    pytest.importorskip("trimesh")
    outline = [(0, 0), (2, 2), (0, 1), (-2, 2)]
    lines = [f"v {x} {y} {z}" for z in (0, 1) for x, y in outline]
    faces = ["f 5 6 7 8", "f 3 2 1 4", *(f"f {k + 1} {(k + 1) % 4 + 1} {(k + 1) % 4 + 5} {k + 5}" for k in range(4))]
    (tmp_path / "good.obj").write_text("\n".join([*lines, *faces, ""]))
    assert not ws.Mesh(file=tmp_path / "good.obj").convex  # its fans start at the right corner
    faces[0] = "f 6 7 8 5"
    (tmp_path / "bad.obj").write_text("\n".join([*lines, *faces, ""]))
    with pytest.raises(InputError, match="lie on each other"):
        ws.Mesh(file=tmp_path / "bad.obj").surface  # noqa: B018


GOOD = {"vertices_m": BOX_VERTICES, "faces": TRIANGLES}


def changed(name, row, value):
    values = {"vertices_m": BOX_VERTICES.tolist(), "faces": TRIANGLES.tolist()}
    values[name][row] = value
    return values


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "exactly one of a file, or vertices_m with faces, must be given"),
        ({"file": "x.obj", **GOOD}, "exactly one of a file, or vertices_m with faces, must be given"),
        ({"faces": TRIANGLES}, "vertices_m, faces: both must be given"),
        ({**GOOD, "scale_m": 2.0}, "scale_m: belongs to a file, which is not given, got 2"),
        ({"file": "x.obj", "scale_m": 0.0}, "scale_m: must be > 0"),
        ({**GOOD, "vertices_m": BOX_VERTICES[:, :2]}, "vertices_m: must be rows of three numbers"),
        ({**GOOD, "vertices_m": [[0, 0, 0], [1, 2]]}, "vertices_m: must be rows of three numbers"),
        ({**GOOD, "vertices_m": [["0", "0", "1"]]}, "vertices_m: must be rows of three numbers"),
        ({**GOOD, "vertices_m": []}, "vertices_m: must be rows of three numbers"),
        ({**GOOD, "faces": TRIANGLES * 1.0}, "faces: must be rows of three whole numbers"),
        ({**GOOD, "faces": TRIANGLES[:-1]}, "faces: must be closed, has 3 open edges, one of them at face"),
        (changed("faces", 3, [0, 1, 8]), r"faces: face 3 names vertex 8 of 8 \(counted from 0\)"),
        (changed("faces", 3, [0, 1, -1]), "faces: face 3 names vertex -1 of 8"),
        (changed("faces", 3, [6, 6, 7]), "faces: face 3 has no area"),
        (changed("faces", 0, TRIANGLES[0][::-1]), "those of faces 0 and [0-9]+ are opposite|faces [0-9]+ and 0 are"),
        (
            changed("vertices_m", 2, [0, np.nan, 0]),
            r"faces: vertices must be finite, got \[0.0, nan, 0.0\] as vertex 2",
        ),
        ({**GOOD, "vertices_m": BOX_VERTICES * 0}, "must extend over 0 to 100000 m, got 0 m"),
        ({**GOOD, "vertices_m": BOX_VERTICES * 1e5}, "must extend over 0 to 100000 m, got 300000 m"),
        ({**GOOD, "vertices_m": BOX_VERTICES * 1e300}, "must extend over 0 to 100000 m, got 3e"),
        ({**GOOD, "colour": 1}, "colour: is not a known field"),
    ],
)
def test_bad_meshes(fields, message):
    with refused_in_one_line(message):
        ws.Mesh(**fields)


def test_too_many_faces():
    with pytest.raises(InputError, match=f"must have at most {MOST_FACES} faces, got {MOST_FACES + 1}"):
        closed_surface(BOX_VERTICES, np.zeros((MOST_FACES + 1, 3), dtype=np.int64))


def test_numbers_may_have_units():
    import astropy.units as u

    assert ws.Mesh(vertices_m=BOX_VERTICES * 100 * u.cm, faces=TRIANGLES).surface_m2 == pytest.approx(22, rel=1e-14)
    with pytest.raises(InputError, match="vertices_m: must be convertible to m"):
        ws.Mesh(vertices_m=BOX_VERTICES * u.s, faces=TRIANGLES)


def test_scenes_find_meshes_beside_their_file(scene, tmp_path):
    """A relative path is taken from the scene file's folder; the scene goes into a file and back, mesh included."""
    pytest.importorskip("trimesh")
    (tmp_path / "body.obj").write_text(TETRA_OBJ)
    inline = scene.replace(targets__0__shape=box())
    inline.save(tmp_path / "inline.toml")
    assert ws.Scene.load(tmp_path / "inline.toml") == inline
    data = inline.to_dict()
    data["groups"][0]["targets"][0]["shape"] = {"kind": "mesh", "file": "body.obj", "scale_m": 0.5}
    named = to_toml(data)
    (tmp_path / "named.toml").write_text(named)
    loaded = ws.Scene.load(tmp_path / "named.toml")
    mesh = loaded.scenario.targets[0].spec.shape
    assert mesh.surface.volume_m3 == pytest.approx(1 / 48, rel=1e-14, abs=0)
    assert input_checksums(loaded.scenario) == {str(tmp_path / "body.obj"): mesh.checksum}
    (tmp_path / "named.toml").write_text(named.replace("body.obj", "no.obj"))
    with pytest.raises(InputError, match=r"targets\[0\].shape: .*no\.obj: cannot be read: No such file"):
        _ = ws.Scene.load(tmp_path / "named.toml").scenario


def test_without_trimesh_a_file_says_what_is_missing(tmp_path, checkout_environment):
    (tmp_path / "body.obj").write_text(TETRA_OBJ)
    code = (
        "import sys; sys.modules['trimesh'] = None; import warpsim as ws\n"
        "try: ws.Mesh(file='body.obj').surface\n"
        "except ws.InputError as error: print(error)\n"
        "print(ws.Mesh(vertices_m=[[0,0,0],[1,0,0],[0,1,0],[0,0,1]], faces=[[0,2,1],[0,1,3],[0,3,2],[1,2,3]]).convex)\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=checkout_environment, capture_output=True, text=True, check=True
    )
    line, convex = run.stdout.splitlines()[-2:]
    assert "body.obj: a mesh file needs trimesh" in line and "pip install 'warpsim[mesh]'" in line
    assert convex == "True"
