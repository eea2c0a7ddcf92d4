"""The documentation site: notebooks run, it builds offline, links resolve, scenes draw."""

import functools
import http.server
import io
import json
import os
import re
import shutil
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import browser
import jupytext
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
# what a page loads by itself, by element and attribute; anchors are followed by the reader alone
LOADED = {
    ("audio", "src"),
    ("embed", "src"),
    ("iframe", "src"),
    ("img", "src"),
    ("link", "href"),
    ("object", "data"),
    ("script", "src"),
    ("source", "src"),
    ("video", "poster"),
    ("video", "src"),
}
RELATED = {"index", "next", "prev", "search"}  # links in the head of a page that load nothing
# one picture of several that a `srcset` offers
CANDIDATE = re.compile(r"([^\s,]\S*[^\s,])(?:\s[^,]*)?(?:,|$)")


class Page(HTMLParser):
    """What a page refers to, and the places in it that can be referred to."""

    def __init__(self, path):
        super().__init__()
        self.path = path
        self.loaded, self.links, self.places, self.scenes = [], [], {""}, []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.places |= {values[key] for key in ("id", "name") if values.get(key)}
        for key, value in values.items():
            if key == "srcset":
                self.loaded += CANDIDATE.findall(value)
            elif (tag, key) in LOADED and values.get("rel") not in RELATED:
                self.loaded.append(value)
            elif key == "href":
                self.links.append(value)
        if tag == "iframe" and "src" in values:
            self.scenes.append(values["src"])


def sources():
    """All files that the site is made of, without those that building it makes."""
    for folder in ("notebooks", "derivations"):
        for path in (ROOT / folder).rglob("*"):
            made = {"_copied", "__pycache__", ".ipynb_checkpoints"}
            if path.is_file() and not made & set(path.relative_to(ROOT).parts):
                yield path


def build(target):
    """The folder of the site, built by the documented command from a copy of its sources.

    A build writes among them, which would disturb others, by hand or by another run of the tests.
    It runs the notebooks and the cells of pages, not the derivations: test_project.py does.
    """
    for path in sources():
        copy = target / path.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copy)
    with (target / "notebooks" / "site" / "conf.py").open("a", encoding="utf-8") as settings:
        settings.write('\nnb_execution_excludepatterns = ["derivations/*"]\n')
    command = ["-m", "sphinx", "-W", "-q", "notebooks/site", "build/site"]
    done = subprocess.run(
        [sys.executable, *command],
        cwd=target,
        text=True,
        timeout=1500,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=os.environ | {"NO_COLOR": "1", "PYTHONIOENCODING": "utf-8"},
    )
    assert done.returncode == 0, done.stdout
    return target / "build" / "site"


def check_links(pages):
    """Nothing is loaded from the network, and everything referred to exists."""
    by_path = {page.path: page for page in pages}
    for page in pages:
        for target in page.loaded:
            assert not urlsplit(target).netloc, f"{page.path} loads {target}"
        for target in page.loaded + page.links:
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                assert parts.scheme in ("data", "http", "https", "mailto"), f"{page.path}: {target}"
                continue
            path = (page.path.parent / unquote(parts.path)).resolve() if parts.path else page.path
            assert path.exists(), f"{page.path}: there is no {target}"
            if parts.fragment and path in by_path:
                found = unquote(parts.fragment) in by_path[path].places
                assert found, f"{page.path}: no such place: {target}"
    for style in pages[0].path.parent.rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        for call in ("@import", "url(http", "url('http", 'url("http', "url(//"):
            assert call not in text, f"{style} has {call}"


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves files, and remembers what it did not find."""

    def __init__(self, *args, missing, **options):
        self.missing = missing
        super().__init__(*args, **options)

    def log_message(self, *args):
        pass

    def send_error(self, code, *args, **options):
        self.missing.append(f"{code}: {self.path}")
        super().send_error(code, *args, **options)


@contextmanager
def opened(program, driver, profile):
    """Headless Chromium with software OpenGL."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = program
    for option in (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--disable-dev-shm-usage",
        "--window-size=1200,900",
        "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
        f"--user-data-dir={profile}",
    ):
        options.add_argument(option)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    chromium = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    try:
        chromium.set_page_load_timeout(120)
        yield chromium
    finally:
        chromium.quit()


def complaints(chromium):
    """Errors that pages wrote to the console since the last call."""
    return [entry["message"] for entry in chromium.get_log("browser") if entry["level"] == "SEVERE"]


def drawn(element):
    """Whether an element shows something: the spread of its pixels, in shades of 0 to 255."""
    from PIL import Image

    pixels = np.asarray(Image.open(io.BytesIO(element.screenshot_as_png)).convert("RGB"))
    return float(pixels.reshape(-1, 3).std(axis=0).max())


def check_page(chromium, address):
    """A page loads without complaint, shows all of its pictures and draws its scenes."""
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import WebDriverWait

    chromium.get(address)
    for frame in chromium.find_elements(By.TAG_NAME, "iframe"):
        chromium.execute_script("arguments[0].scrollIntoView({block: 'center'})", frame)
        there = functools.partial(lambda frame, _: drawn(frame) > 10, frame)
        WebDriverWait(chromium, 60).until(there, f"{address} has an empty frame")
    broken = chromium.execute_script(
        "return [...document.images].filter(i => i.loading != 'lazy')"
        ".filter(i => !i.complete || !i.naturalWidth).map(i => i.src)"
    )
    assert not broken, f"{address} does not show {broken}"
    wide = chromium.execute_script(
        "return document.documentElement.scrollWidth - document.documentElement.clientWidth"
    )
    assert wide <= 1, f"{address} is {wide} pixels too wide"
    said = complaints(chromium)
    assert not said, f"{address} says {said}"


def check_scene(chromium, address):
    """A scene draws itself, and turns when it is dragged."""
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import WebDriverWait

    # told to the page itself: drags by the driver do not always reach the viewer
    drag = """
        const box = arguments[0].getBoundingClientRect();
        const tell = (name, k) => arguments[0].dispatchEvent(new PointerEvent(name, {
            bubbles: true, isPrimary: true, pointerId: 1, pointerType: "mouse", button: 0,
            buttons: name == "pointerup" ? 0 : 1,
            clientX: box.x + box.width / 2 + 20 * k, clientY: box.y + box.height / 2 + 8 * k,
        }));
        tell("pointerdown", 0);
        for (let k = 1; k < 9; k++) tell("pointermove", k);
        tell("pointerup", 8);
    """

    def turned(_):
        chromium.execute_script(drag, canvas)
        time.sleep(1)
        return canvas.screenshot_as_png != before

    chromium.get(address)
    wait = WebDriverWait(chromium, 60)
    canvas = wait.until(lambda _: chromium.find_elements(By.TAG_NAME, "canvas"))[0]
    wait.until(lambda _: drawn(canvas) > 10, f"{address} draws nothing")
    before = canvas.screenshot_as_png
    wait.until(turned, f"{address} does not turn")
    assert drawn(canvas) > 10
    said = complaints(chromium)
    assert not said, f"{address} says {said}"


def look_at(folder, documents, scenes, chromium):
    """Every page and scene of a folder in a browser, as it is served."""
    missing = []
    handler = functools.partial(Quiet, directory=folder, missing=missing)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        root = f"http://127.0.0.1:{server.server_port}"
        try:
            for page in documents:
                check_page(chromium, f"{root}/{page.path.relative_to(folder).as_posix()}")
            for scene in sorted(scenes):
                check_scene(chromium, f"{root}/{scene.relative_to(folder).as_posix()}")
        finally:
            server.shutdown()
    assert not missing


def check_download(folder, script):
    """The notebook that is offered is the script, with outputs and a cell before it to install."""
    wanted = jupytext.read(script, fmt="py:percent").cells
    paths = sorted(folder.glob(f"_downloads/*/{script.stem}.ipynb"))
    found = [json.loads(path.read_text("utf-8"))["cells"] for path in paths]
    # (a derivation may have the same name)
    (found,) = ([first, *cells] for first, *cells in found if len(cells) == len(wanted))
    install, *cells = found
    assert "%pip install" in "".join(install["source"])
    assert [c["cell_type"] for c in cells] == [c.cell_type for c in wanted]
    code = [("".join(c["source"]), w.source) for c, w in zip(cells, wanted, strict=True)]
    kinds = [c.cell_type == "code" for c in wanted]
    assert all(a == b for (a, b), is_code in zip(code, kinds, strict=True) if is_code)
    assert any(c.get("outputs") for c in cells)


# One test, so that the site is built once; where there is no browser, the next one says so.
@pytest.mark.long
def test_site(tmp_path):
    folder = build(tmp_path)
    pages = [Page(path) for path in sorted(folder.rglob("*.html")) if "_static" not in path.parts]
    scenes = {page.path.parent / scene for page in pages for scene in page.scenes}
    documents = [page for page in pages if page.path not in scenes and page.links]
    assert len(documents) > 30
    for notebook in sorted((ROOT / "notebooks").glob("*.py")):
        (page,) = folder.rglob(f"notebooks/{notebook.stem}.html")
        assert "cell_output" in page.read_text(encoding="utf-8"), f"{notebook.name} was not run"
        check_download(folder, notebook)
    assert scenes
    check_links(documents)
    if (found := browser.find()) is not None:
        with opened(*found, tmp_path / "profile") as chromium:
            look_at(folder, documents, scenes, chromium)


def test_the_site_is_looked_at_in_a_browser():
    if browser.find() is None:
        pytest.skip("no chromium and chromedriver: the site is built and its links are checked")


def test_what_a_page_loads(tmp_path):
    path = tmp_path / "page.html"
    path.write_text(
        '<link rel="next" href="b.html"><link rel="stylesheet" href="a.css"><a href="c.html">'
        '<img src="a.png" srcset="a.png, b.png 2x,data:image/png;base64,AA== 3x">',
        encoding="utf-8",
    )
    page = Page(path)
    assert page.loaded == ["a.css", "a.png", "a.png", "b.png", "data:image/png;base64,AA=="]
    assert page.links == ["b.html", "c.html"]
