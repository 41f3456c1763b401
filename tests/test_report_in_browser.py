"""The report and the animations in a real browser, without a network."""

import io
import re
import time
from pathlib import Path

import chromium
import nbformat
import numpy as np
import pytest
from PIL import Image

import hexakin as hk
from hexakin.report.__main__ import main

ROOT = Path(__file__).resolve().parent.parent
WALK = """
import hexakin as hk
robot = hk.load_robot("hwr")
plan = hk.plan_walk(robot, hk.terrain.Plane(), num_steps=2, step_length=0.05, samples_per_step=20)
hk.animation.animate(robot, plan, hk.terrain.Plane(), speed=0.5)
"""


@pytest.fixture
def browser(tmp_path):
    if chromium.find() is None:
        missing = f"no browser: none of {', '.join(chromium.NAMES)} is there (Debian: apt-get install chromium)"
        (pytest.fail if chromium.REQUIRED else pytest.skip)(missing)
    (tmp_path / "profile").mkdir()
    opened = chromium.Browser(tmp_path / "profile")
    yield opened
    opened.close()


def open_offline(browser, path, **size):
    """Open a page that must complain of nothing, ask for nothing outside its folder and show every picture."""
    browser.open(path, **size)
    here = path.parent.resolve().as_uri()
    assert [url for url in browser.requests if not url.startswith((here, "data:", "blob:", "about:"))] == []
    pictures = browser.value("[...document.images].map(i => [i.complete && i.naturalWidth, i.src.slice(0, 80)])")
    assert [source for width, source in pictures if not width] == []
    assert browser.complaints == []
    return len(pictures)


def pixels(browser):
    return np.asarray(Image.open(io.BytesIO(browser.screenshot())).convert("RGB")).astype(int)


def test_the_browser_does_not_hide_what_is_wrong(browser, tmp_path):
    for name, body in {
        "request": '<img src="https://example.org/a.png">',
        "missing": '<img src="a.png">',
        "console": "<script>console.error('a reason')</script>",
        "thrown": "<script>nowhere.at.all</script>",
    }.items():
        (tmp_path / f"{name}.html").write_text(f"<!DOCTYPE html><title>{name}</title>{body}")
        with pytest.raises(AssertionError):
            open_offline(browser, tmp_path / f"{name}.html")


def test_a_page_shows_its_formulas_pictures_animation_and_error_offline(browser, tmp_path):
    for name, cells in {
        "a_fails": ["raise ValueError('a reason')"],
        "b_draws": ["import matplotlib.pyplot as plt\nplt.plot([0, 1]);", WALK],
        "c_formulas": ["import sympy\nsympy.Matrix([[sympy.Symbol('theta_1'), 0]])"],
    }.items():
        notebook = nbformat.v4.new_notebook(
            cells=[nbformat.v4.new_markdown_cell(f"# {name}\n\nHere $\\tfrac{{a}}{{b}}$.")]
        )
        notebook.cells += [nbformat.v4.new_code_cell(cell) for cell in cells]
        nbformat.write(notebook, tmp_path / f"{name}.ipynb")
    report = tmp_path / "report"
    assert main([str(tmp_path), str(report)]) == 1

    open_offline(browser, report / "index.html")
    assert "ValueError: a reason" in browser.value("document.body.innerText")
    open_offline(browser, report / "a_fails.html")
    assert "ValueError: a reason" in browser.value("document.body.innerText")

    open_offline(browser, report / "c_formulas.html")
    fraction, matrix = browser.value(
        "['mfrac', 'mtable'].map(n => document.querySelector(n).getBoundingClientRect()).map(r => [r.width, r.height])"
    )
    assert min(fraction) > 3.0 and matrix[0] > matrix[1] > 10.0
    assert "$" not in browser.value("document.querySelector('.jp-MarkdownCell').innerText")

    assert open_offline(browser, report / "b_draws.html") == 1
    browser.value("document.querySelector('iframe').scrollIntoView()")
    frame = "document.querySelector('iframe').contentWindow.document"
    assert browser.value(f"{frame}.querySelector('canvas').width") > 300
    assert browser.value("(o => o.scrollWidth - o.clientWidth)(document.querySelector('iframe').parentElement)") == 0
    clock = f"{frame}.getElementById('clock').innerText"
    before, first = browser.value(clock), pixels(browser)
    until(lambda: browser.value(clock) != before)
    until(lambda: changed(first, pixels(browser)).sum() > 200)
    assert browser.complaints == []


def changed(before, after):
    return np.abs(after - before).max(axis=-1) > 20


def until(true, seconds=300.0):
    """Wait until a function returns true, on a machine that may be busy."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "this has not happened"
        time.sleep(0.05)


def test_an_animation_moves_the_robot_and_nothing_else_and_stops_when_asked(browser, tmp_path):
    hwr, plane = hk.load_robot("hwr"), hk.terrain.Plane()
    plan = hk.plan_walk(hwr, plane, num_steps=4, step_length=0.05, samples_per_step=20)
    shown = hk.animation.animate(hwr, plan, plane, follow=False, show=())
    path = shown.save(tmp_path / "walk.html")
    open_offline(browser, path, width=800, height=600)
    where = """(() => {
        const box = new THREE.Box3().setFromObject(node("robot")), at = [];
        for (const x of [box.min.x, box.max.x])
            for (const y of [box.min.y, box.max.y])
                for (const z of [box.min.z, box.max.z]) {
                    const p = new THREE.Vector3(x, y, z).project(viewer.camera);
                    at.push([400 * (1 + p.x), 300 * (1 - p.y)]);
                }
        return at;
    })()"""
    drawn = "new Promise(done => { let n = 3; (function next() { n-- ? requestAnimationFrame(next) : done(); })(); })"
    corners, pictures = [], []
    for instant in (0.5, 1.5):  # [s]
        browser.value(f"slider.value = {instant}, slider.oninput()")
        browser.value(drawn)
        corners.append(browser.value(where))
        pictures.append(pixels(browser))
    moved = changed(*pictures)[:540]  # above the bar with the clock
    (left, top), (right, bottom) = np.min(corners, axis=(0, 1)), np.max(corners, axis=(0, 1))
    robot = np.zeros_like(moved)
    robot[max(0, int(top) - 15) : int(bottom) + 15, max(0, int(left) - 15) : int(right) + 15] = True
    assert moved[robot].sum() > 1000
    assert moved[~robot].sum() < 0.05 * moved[robot].sum()  # its shadow
    browser.value("play.click()")
    until(lambda: float(browser.value("slider.value")) != 1.5)
    browser.value("play.click()")
    browser.value(drawn)
    still, stopped = pixels(browser), browser.value("slider.value")
    time.sleep(0.5)
    assert browser.value("slider.value") == stopped and not changed(still, pixels(browser)).any()
    assert browser.complaints == []


def test_every_page_of_the_report_is_whole_offline(browser, tmp_path):
    report = tmp_path / "report"
    assert main([str(ROOT / "notebooks"), str(report), "--stored"]) == 0
    pages = {path.name for path in report.glob("*.html")}
    assert pages == {f"{path.stem}.html" for path in (ROOT / "notebooks").glob("*.ipynb")} | {"index.html"}

    for width in (1280, 400):
        cards = open_offline(browser, report / "index.html", width=width)
        assert cards == browser.value("document.querySelectorAll('.card').length") > 30
        assert browser.value("document.documentElement.scrollWidth") <= width
    links = browser.value("[...document.querySelectorAll('a')].map(a => a.getAttribute('href'))")
    assert pages - {"index.html"} <= set(links)

    for page in sorted(pages - {"index.html"}):
        open_offline(browser, report / page)
        assert browser.value("document.querySelectorAll('code.latex').length") == 0, f"{page}: a formula is not MathML"
        for link in {link for link in links if link.startswith(f"{page}#")}:
            anchor = re.sub(".*#", "", link)
            assert browser.value(f"document.getElementById({anchor!r})?.querySelector('img')?.naturalWidth") > 0, link
