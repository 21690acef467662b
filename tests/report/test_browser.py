"""The page in a real browser: it loads alone, plays, filters, fits a phone, darkens and prints."""

import base64
import json
import shutil
import time

import pandas as pd
import pytest

from explore_bench.records.store import Store
from explore_bench.report.render import write_report
from explore_bench.runs.suites import plan
from explore_bench.strategies.registry import strategies
from explore_bench.trial.run import run_trial
from explore_bench.world.scenario import Scenario

pytestmark = pytest.mark.slow

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
DRIVER = shutil.which("chromedriver")
OPTIONS = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--disable-dev-shm-usage"),
)
NAMES = ("random", "nearest", "clairvoyant")


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Return the folder of a report on three strategies in three worlds of 20 m and two of 30 m."""
    store = Store(tmp_path_factory.mktemp("browser") / "results")
    store.open(0, "evaluate", Scenario())
    for size, trials in ((20.0, 3), (30.0, 2)):
        for spec in plan("paper", NAMES, (size,), trials).specs:
            store.write(run_trial(spec))
    with pytest.MonkeyPatch.context() as patch:  # Table 2, though few of its methods ran
        patch.setattr("explore_bench.report.tables._printed", lambda table: set())
        write_report(store.folder)
    return store.folder


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Start headless Chromium with a fresh profile."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is missing: install the extra 'test'")
    if not CHROMIUM:
        pytest.skip("chromium is missing: install the package 'chromium'")
    if not DRIVER:
        pytest.skip("chromedriver is missing: install the package 'chromium-driver'")
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for option in (*OPTIONS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(option)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    driver.set_script_timeout(60)
    yield driver
    driver.quit()


@pytest.fixture
def page(browser, report):
    """Open the page, wide and light, and wait for the first replay."""
    look(browser, 1280, 900)
    browser.get_log("performance")
    browser.get((report / "report.html").as_uri())
    wait(browser, "return document.getElementById('step').max > 0")
    return browser


def look(browser, width, height, scheme="light", media="", motion="reduce"):
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    still = {"name": "prefers-reduced-motion", "value": motion}  # reduced, nothing moves while a test looks
    features = [{"name": "prefers-color-scheme", "value": scheme}, still]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": media, "features": features})


def wait(browser, script, seconds=30.0):
    """Wait until a script returns something true."""
    end = time.monotonic() + seconds
    while not browser.execute_script(script):
        assert time.monotonic() < end, script
        time.sleep(0.05)


def value(browser, name):
    return browser.execute_script(f"return document.getElementById('{name}').value")


def step(browser):
    return int(value(browser, "step"))


def choose(browser, name, text):
    """Choose the option that holds a text, as a user would, and wait for its replay."""
    script = """const s = document.getElementById(arguments[0]);
      s.value = [...s.options].find((o) => o.text.includes(arguments[1])).value;
      s.dispatchEvent(new Event('change', {bubbles: true}));"""
    browser.execute_script(script, name, text)
    wait(browser, "return document.getElementById('step').max > 0")
    time.sleep(0.5)


def pixels(browser, index=0, kind="map"):
    return browser.execute_script(f"return document.querySelectorAll('canvas.{kind}')[{index}].toDataURL()")


def press(browser, key, on="replay"):
    browser.execute_script(f"document.getElementById('{on}').focus()")
    browser.switch_to.active_element.send_keys(key)


def shown_rows(browser, caption):
    script = """const f = [...document.querySelectorAll('#tables figure.table')].find(
        (one) => one.querySelector('figcaption').textContent.includes(arguments[0]));
      return [...f.querySelectorAll('tbody tr')].filter((row) => row.offsetParent !== null)
        .map((row) => [...row.cells].filter((cell) => cell.offsetParent !== null).map((cell) => cell.innerText));"""
    return browser.execute_script(script, caption)


def headings(browser, caption):
    script = """const f = [...document.querySelectorAll('#tables figure.table')].find(
        (one) => one.querySelector('figcaption').textContent.includes(arguments[0]));
      return [...f.querySelectorAll('thead th')].filter((one) => one.offsetParent).map((one) => one.innerText);"""
    return browser.execute_script(script, caption)


def tick(browser, name, position, on):
    script = """const box = document.querySelectorAll(`#filter input[name=${arguments[0]}]`)[arguments[1]];
      if (box.checked !== arguments[2]) box.click();"""
    browser.execute_script(script, name, position, on)


# Alone


def test_the_page_loads_without_an_error_and_without_the_network(page):
    assert [entry for entry in page.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")] == []
    events = [json.loads(entry["message"])["message"] for entry in page.get_log("performance")]
    urls = [event["params"]["request"]["url"] for event in events if event["method"] == "Network.requestWillBeSent"]
    assert [url for url in urls if not url.startswith(("file:", "data:", "blob:"))] == []
    assert len([url for url in urls if url.startswith("file:")]) == 1, "the page itself"


def test_every_figure_is_drawn(page, report):
    widths = page.execute_script(
        "return [...document.querySelectorAll('.drawing svg')].map((svg) => svg.getBoundingClientRect().width)"
    )
    assert len(widths) == len(list((report / "figures").glob("*.svg")))
    assert all(width > 300 for width in widths)
    lost = """const lost = [];
      for (const use of document.querySelectorAll('svg use')) {
        const target = document.querySelector(use.getAttribute('xlink:href'));
        if (!target || target.closest('svg') !== use.closest('svg')) lost.push(use.getAttribute('xlink:href'));
      } return lost;"""
    assert page.execute_script(lost) == []


def test_numbers_on_the_page_are_those_of_the_summary(page, report):
    summary = pd.read_csv(report / "summary.csv")
    rows = {row[0]: row for row in shown_rows(page, "Table 2")}
    summary = summary.set_index(["table", "strategy", "size", "metric"])
    for name, label in zip(NAMES, ("Random", "Nearest", "Clairvoyant (reference)"), strict=True):
        for metric, place in (("trajectory_error", 5), ("exploration_efficiency", 9)):
            line = summary.loc["table2", name, 20.0, metric]
            digits = 2 if line["mean"] >= 10 else 3
            mean, low, high = (f"{line[key]:.{digits}f}" for key in ("mean", "ci_low", "ci_high"))
            planned = strategies()[name].fills(metric)  # a reference shows what it plans for alone
            assert rows[label][place] == (f"{mean} [{low}, {high}]" if planned else "–")


# Filters


def test_filters_of_strategies_and_sizes_hide_rows_and_columns(page):
    assert len(shown_rows(page, "paired by world")) == 2, "Random and Nearest at two sizes"
    before = shown_rows(page, "Table 2")
    tick(page, "strategy", 0, False)
    assert shown_rows(page, "paired by world") == []
    assert not [row for row in shown_rows(page, "Endings") if row[0] == "Random"]
    assert len(shown_rows(page, "Endings")) == 4
    tick(page, "strategy", 0, True)
    tick(page, "size", 0, False)
    assert {row[1] for row in shown_rows(page, "Endings")} == {"30"}
    assert any("40 m" in cell for cell in headings(page, "Table 2")), "of a size without trials there is no filter"
    assert len(shown_rows(page, "Table 2")[0]) == len(before[0]) - 4, "paper and ours of e and η at 20 m"
    tick(page, "size", 0, True)
    assert shown_rows(page, "Table 2") == before
    page.execute_script("document.querySelector('#filter [data-set=none]').click()")
    assert shown_rows(page, "Endings") == []


# The player


def test_the_player_plays_and_the_pictures_change(page):
    assert step(page) == 0
    before = pixels(page), pixels(page, 0, "curve")
    page.execute_script("document.getElementById('play').click()")
    wait(page, "return document.getElementById('step').value > 5")
    page.execute_script("document.getElementById('play').click()")
    held = step(page)
    assert pixels(page) != before[0]
    assert pixels(page, 0, "curve") != before[1]
    time.sleep(0.4)
    assert step(page) == held, "it pauses"


def test_the_player_plays_by_itself_unless_motion_is_to_be_reduced(browser, report):
    address = (report / "report.html").as_uri()
    look(browser, 1280, 900)
    browser.get(address)
    wait(browser, "return document.getElementById('step').max > 0")
    time.sleep(0.6)
    assert step(browser) == 0
    look(browser, 1280, 900, motion="no-preference")
    browser.get(address)
    wait(browser, "return document.getElementById('step').value > 3")
    assert browser.execute_script("return document.getElementById('play').getAttribute('aria-label')") == "Pause"


def test_the_first_screen_has_the_answer_and_the_player_on_it(page):
    look(page, 1400, 900)
    time.sleep(0.4)
    edge = "return document.querySelector(arguments[0]).getBoundingClientRect()[arguments[1]]"
    for place in ("h1", ".lead", ".ranking.wide"):
        assert page.execute_script(edge, place, "bottom") < 900, place
    for place in ("canvas.map", "#play"):
        assert page.execute_script(edge, place, "top") < 900, place
    hidden = "return document.querySelector(arguments[0]).offsetParent === null"
    assert page.execute_script(hidden, ".ranking.narrow")
    look(page, 400, 900)
    time.sleep(0.4)
    assert page.execute_script(hidden, ".ranking.wide")
    assert page.execute_script(edge, ".ranking.narrow svg", "width") > 300


def test_the_first_column_of_a_wide_table_stays_in_view_with_its_heading(page):
    look(page, 700, 740)
    script = """const boxes = [...document.querySelectorAll('#tables .scroll')];
      const box = boxes.find((one) => one.scrollWidth > one.clientWidth + 200);
      box.scrollLeft = box.scrollWidth;
      const left = (name) => {
        const cell = box.querySelector(name).getBoundingClientRect();
        return Math.round(cell.left - box.getBoundingClientRect().left);
      };
      return [left('thead th'), left('tbody th'), left('tbody td') < 0];"""
    assert page.execute_script(script) == [1, 1, True]


def test_the_player_stops_at_the_end_and_begins_anew(page):
    last = int(page.execute_script("return document.getElementById('step').max"))
    drag = "const s = document.getElementById('step'); s.value = arguments[0]; s.dispatchEvent(new Event('input'))"
    page.execute_script(drag, last - 1)
    page.execute_script("document.getElementById('speed').value = 150; document.getElementById('play').click()")
    wait(page, f"return document.getElementById('step').value == {last}")
    wait(page, "return document.getElementById('play').getAttribute('aria-label') === 'Play'")
    assert "explored after" in page.execute_script("return document.querySelector('.facts').innerText")


def test_the_keyboard_steps_plays_and_pauses(page):
    from selenium.webdriver.common.keys import Keys

    press(page, Keys.ARROW_RIGHT)
    press(page, Keys.ARROW_RIGHT)
    press(page, Keys.ARROW_LEFT)
    assert step(page) == 1
    press(page, Keys.ARROW_RIGHT, on="step")
    assert step(page) == 2
    press(page, " ")
    wait(page, "return document.getElementById('step').value > 4")
    place = page.execute_script("return scrollY")
    press(page, " ")
    held = step(page)
    time.sleep(0.4)
    assert step(page) == held
    assert page.execute_script("return scrollY") == place, "the space bar does not scroll"


def test_every_control_can_be_reached_and_has_a_name(page):
    from selenium.webdriver.common.keys import Keys

    unnamed = """const named = (one) => one.getAttribute('aria-label') || one.labels?.[0]?.innerText || one.innerText;
      return [...document.querySelectorAll('button, select, input, [tabindex]')].filter((one) => !named(one)?.trim())
        .map((one) => one.outerHTML);"""
    assert page.execute_script(unnamed) == []
    press(page, Keys.TAB, on="less")
    assert page.switch_to.active_element.get_attribute("id") == "play"
    assert page.execute_script("return getComputedStyle(document.activeElement).outlineStyle") == "solid"


def test_two_strategies_side_by_side_on_the_worlds_that_both_have(page):
    choose(page, "pick-a", "Random")
    choose(page, "pick-b", "Nearest")
    assert page.execute_script("return document.querySelectorAll('.stage:not([hidden])').length") == 2
    worlds = page.execute_script("return [...document.getElementById('pick-world').options].map((one) => one.text)")
    assert any(text.startswith("World 0 – common example") for text in worlds)
    page.execute_script("document.getElementById('next').click()")
    assert step(page) > 0
    assert pixels(page, 0) != pixels(page, 1)
    choose(page, "pick-map", "30 m")
    assert "30 m" in page.execute_script("return document.getElementById('pick-map').selectedOptions[0].text")
    assert step(page) == 0


def test_each_world_of_the_selector_plays(page):
    for text in page.execute_script("return [...document.getElementById('pick-world').options].map((one) => one.text)"):
        choose(page, "pick-world", text)
        assert page.execute_script("return document.getElementById('trouble').hidden")
        assert int(page.execute_script("return document.getElementById('step').max")) > 10


def test_the_truth_can_be_hidden(page):
    before = pixels(page)
    page.execute_script("document.getElementById('truth').click()")
    assert pixels(page) != before


# Screens, darkness, paper


@pytest.mark.parametrize("width", [360, 768])
def test_nothing_makes_the_page_scroll_sideways(page, width):
    look(page, width, 740)
    time.sleep(0.4)
    assert page.execute_script("return document.documentElement.scrollWidth") <= width
    assert page.execute_script("return [...document.querySelectorAll('canvas.map')][0].clientWidth") > 0.8 * width * (
        1 if width < 500 else 0.5
    )


def test_the_dark_scheme_darkens_the_page_and_leaves_figures_on_paper(page):
    colour = "return getComputedStyle(document.querySelector(arguments[0])).backgroundColor"

    def brightness(place):
        return sum(map(int, page.execute_script(colour, place).split("(")[1].rstrip(")").split(",")[:3])) / 3

    assert brightness("body") > 200
    look(page, 1280, 900, scheme="dark")
    assert brightness("body") < 60
    assert brightness(".drawing .card") > 200
    assert brightness("canvas.map") > 200


def test_paper_has_the_figures_and_the_tables_and_no_player(page):
    look(page, 1100, 800, media="print")
    hidden = "return [...document.querySelectorAll(arguments[0])].every((one) => one.offsetParent === null)"
    for place in ("#player", "#play", "canvas", "#filter", "nav"):
        assert page.execute_script(hidden, place), place
    for place in (".drawing svg path", "#tables table", "#origin table"):
        assert page.execute_script("return document.querySelector(arguments[0]).getClientRects().length > 0", place), (
            place
        )
    printed = base64.b64decode(page.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True})["data"])
    assert printed.startswith(b"%PDF")
    assert len(printed) > 50_000
