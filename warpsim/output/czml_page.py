"""A page that opens a CZML file in CesiumJS, which the user gives; it loads nothing from elsewhere."""

from __future__ import annotations

import json
import os
import re
from html import escape
from pathlib import Path
from urllib.parse import quote

from warpsim.errors import InputError
from warpsim.files import check_new_file, whole_file

SCRIPT = "Cesium.js"
"""What a folder of CesiumJS holds: Build/Cesium of a release."""

_WITHOUT = (
    "This page shows a scene in CesiumJS, which was not given: write it again with --cesium (cesium=), the URL or the "
    "folder that holds Cesium.js, Build/Cesium of a release."
)

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>@TITLE@</title>
@STYLE@<style>
html, body, #view { height: 100%; margin: 0; overflow: hidden; background: #111; }
#words { position: absolute; left: 8px; top: 8px; margin: 0; white-space: pre-line; color: #ddd;
  font: 13px/1.4 sans-serif; text-shadow: 0 0 3px #000; pointer-events: none; }
</style>
</head>
<body>
<div id="view"></div>
<p id="words">@WORDS@</p>
@SCRIPT@</body>
</html>
"""

_SCRIPT = """<script src="@BASE@Cesium.js"></script>
<script>
const words = document.getElementById("words");
async function show(file) {
  if (location.protocol === "file:") {
    throw Error("browsers do not let pages on disk read files: run `python -m http.server` in a folder above page, "
      + "CZML and CesiumJS, and open the page at http://localhost:8000");
  }
  if (typeof Cesium === "undefined") throw Error("there is no Cesium.js at @BASE@");
  const data = await Cesium.CzmlDataSource.load(file);
  await Cesium.Transforms.preloadIcrfFixed(  // else the Earth's orientation leaves out precession and nutation
    new Cesium.TimeInterval({ start: data.clock.startTime, stop: data.clock.stopTime }));
  const viewer = new Cesium.Viewer("view", {
    navigationInstructionsInitiallyVisible: false,
    baseLayerPicker: false, geocoder: false,  // these, and the usual imagery, ask servers; this one comes with CesiumJS
    baseLayer: Cesium.ImageryLayer.fromProviderAsync(Cesium.TileMapServiceImageryProvider.fromUrl(
      Cesium.buildModuleUrl("Assets/Textures/NaturalEarthII"))),
  });
  await viewer.dataSources.add(data);
  viewer.camera.flyHome(0);
  words.textContent = "";
  viewer.clock.onTick.addEventListener((clock) => {
    const bag = viewer.selectedEntity && viewer.selectedEntity.properties;
    const lines = bag ? bag.propertyNames.map((name) => [name, bag[name].getValue(clock.currentTime)]) : [];
    words.textContent = lines.filter((line) => line[1] !== undefined)
      .map(([name, value]) => name + "  " + value.toExponential(3)).join("\\n");
  });
  window.viewer = viewer;
}
show(@FILE@).catch((error) => { words.textContent = "Not shown: " + (error.message || error); });
</script>
"""


def checked_cesium(html: Path | None, cesium: str | os.PathLike[str] | None, overwrite: bool) -> str | None:
    """Return where a page finds CesiumJS, a URL that ends in a slash; None where it is not given.

    Raises:
        InputError: The page cannot be written, CesiumJS is given without a page, or the folder does not hold it.
    """
    if html is None:
        if cesium is not None:
            raise InputError("serves the page alone, which is not asked for (html)", "cesium", str(cesium))
        return None
    check_new_file(html, (".html",), overwrite)
    if cesium is None:
        return None
    if not isinstance(cesium, str | os.PathLike):
        raise InputError("must be a URL or a folder", "cesium", cesium)
    text = os.fspath(cesium)
    if re.match(r"https?://", text, re.IGNORECASE):
        if re.search(r"[?#]", text):
            raise InputError("must be the URL of a folder, without a query", "cesium", text)
        return quote(text, safe=":/%@~+,=[]").rstrip("/") + "/"
    folder = Path(text)
    if not (folder / SCRIPT).is_file():
        raise InputError(f"must be a URL (https://...), or a folder that holds {SCRIPT}", "cesium", text)
    return _link(folder, html) + "/"


def _link(path: Path, html: Path) -> str:
    return quote(Path(os.path.relpath(path, html.parent)).as_posix())


def write_page(html: Path, czml: Path, base: str | None, name: str) -> None:
    """Write the page of a CZML file.

    Args:
        html: File to write.
        czml: The CZML file, to which the page links.
        base: What `checked_cesium` gave.
        name: Name of the scene.
    """
    style = script = ""
    if base is not None:
        style = f'<link rel="stylesheet" href="{base}Widgets/widgets.css">\n'
        file = json.dumps(_link(czml, html)).replace("<", "\\u003c")
        script = _SCRIPT.replace("@BASE@", base).replace("@FILE@", file)
    words = "Loading ..." if base is not None else escape(_WITHOUT)
    parts = {"@TITLE@": escape(name), "@STYLE@": style, "@WORDS@": words, "@SCRIPT@": script}
    text = re.sub("@(?:TITLE|STYLE|WORDS|SCRIPT)@", lambda found: parts[found[0]], _PAGE)
    with whole_file(html) as partial:
        partial.write_text(text, encoding="utf-8")
