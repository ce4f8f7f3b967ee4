"""The page of a study: what it says, and what a browser makes of it."""

import contextlib
import json
import os
import re
import subprocess
import sys
import time
from dataclasses import replace
from html.parser import HTMLParser

import pytest
from browser import Browser, needs_chromium
from study_pages import HOSTILE, findings, frame, hostile, store

import ann_dc
from ann_dc.errors import JinjaMissing, OutputError, PandasMissing, PlotlyMissing
from ann_dc.report.study_page.page import page_of, write_study_page
from ann_dc.study.store import Store

READY = "document.documentElement.dataset.table && document.documentElement.dataset.figures"
FIRST = "[...document.querySelectorAll('#rows tbody tr:not(.space)')][0].children"
COUNT = "document.querySelector('#count').textContent"


class Words(HTMLParser):
    """The words of a page, its elements, and whatever could load or run something."""

    def __init__(self, page):
        super().__init__()
        self.words, self.tags, self.loads, self._inside = [], [], [], ""
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self._inside = tag
        self.loads += [
            (tag, name, value) for name, value in attrs
            if (name in ("src", "srcset", "action", "data") or name.startswith("on")
                or (name == "href" and not value.startswith("#")))
        ]  # fmt: skip

    def handle_data(self, data):
        if self._inside not in ("script", "style"):
            self.words.append(data)

    def handle_endtag(self, tag):
        self._inside = ""

    def text(self):
        return " ".join(" ".join(self.words).split())


def test_a_page_says_what_was_asked_and_found():
    found = findings(2000)
    page = Words(page_of(found))
    text = page.text()
    for words in (
        "Settling of the car on drawn parts", "2,000", "Latin hypercube", "Horizon: the number",
        "Last time at which a control is off.", "settling_time ≤ 30 us, overshoot ≤ 0.25",
        "Clopper-Pearson", "power ~ problem.N^p", "ann-dc study 'out/car study' --point",
        "numpy 2.4.6", "plotly.js", "Omitted, because less informative",
    ):  # fmt: skip
        assert words in text, words
    good = (found.frame["settling_time"] <= 30) & (found.frame["overshoot"] <= 0.25)
    good &= found.frame["outcome"] == "settled"
    assert f"{100 * good.mean():.2f} %" in text
    failed = (found.frame["outcome"] == "failed").sum()
    assert f"{failed} points have no result; run them again with" in text
    slow = found.frame["wall_time"].idxmax()
    assert f"--point {slow}" in text


def test_a_page_loads_nothing_and_is_the_same_every_time():
    page = page_of(findings(50))
    assert Words(page).loads == []
    assert page == page_of(findings(50))


def test_words_of_a_store_stay_words():
    found = hostile()
    usual, broken = Words(page_of(findings(60))), Words(page_of(found))
    assert broken.loads == []
    assert set(broken.tags) <= set(usual.tags)
    assert broken.tags.count("script") == usual.tags.count("script")
    assert HOSTILE in broken.text()


def test_a_page_says_how_many_rows_it_leaves_out(monkeypatch):
    monkeypatch.setattr("ann_dc.report.study_page.page.LARGEST_TABLE", 40)
    assert "The page holds the first 40 of 50 rows" in Words(page_of(findings(50))).text()
    assert "The page holds" not in Words(page_of(findings(40))).text()


@pytest.mark.parametrize("count", [0, 1, 2])
def test_a_study_that_has_hardly_begun_has_a_page(count):
    whole = findings(max(count, 1))
    found = replace(whole, frame=whole.frame.iloc[:count])
    assert ("No point has finished yet" in Words(page_of(found)).text()) == (count == 0)


def test_a_whole_file_or_none(tmp_path):
    file = tmp_path / "page.html"
    write_study_page(store(20), file)
    before = file.read_bytes()
    assert before.startswith(b"<!DOCTYPE html>")
    with pytest.raises(OutputError, match="cannot be written"):
        write_study_page(store(20), tmp_path / "nowhere" / "page.html")
    assert [*tmp_path.iterdir()] == [file]


def test_page_of_a_folder_is_that_of_its_store(tmp_path):
    varied = {"nonideal.mismatch": [0.001, 0.01]}
    study = ann_dc.Study(subject="double_integrator", vary=varied, samples=2)
    folder, page, again = (tmp_path / name for name in ("study", "page.html", "again.html"))
    study.run(folder, workers=0)
    ann_dc.report.write_study_page(folder, page)
    with Store.open(folder) as opened_store:
        write_study_page(opened_store, again)
    assert page.read_bytes() == again.read_bytes()


MISSING = {"pandas": PandasMissing, "plotly.offline": PlotlyMissing, "jinja2": JinjaMissing}


@pytest.mark.parametrize(("package", "error"), MISSING.items())
def test_a_missing_package_is_told(monkeypatch, tmp_path, package, error):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(error, match=r"pip install 'ann-dc\[study\]'"):
        write_study_page(store(5), tmp_path / "page.html")


# ---- in a browser ------------------------------------------------------------------------------


@contextlib.contextmanager
def opened(found, tmp_path):
    """A browser with the page drawn; nothing may go wrong meanwhile, and nothing be asked for."""
    file = tmp_path / "a page.html"
    file.write_text(page_of(found), encoding="utf-8")
    with Browser(tmp_path / "profile") as browser:
        browser.resize(1400)
        browser.open(file)
        browser.wait_for(READY)
        yield browser
        assert browser.console == []
        asked = [url for url in browser.requests if not url.startswith("data:")]
        assert asked == [file.resolve().as_uri()]


def column(browser, name):
    """The cells of a column that the page has as elements, in order."""
    script = """(() => {
        const all = (where) => [...document.querySelectorAll(where)];
        const names = all('#rows thead tr:first-child th').map((th) => th.textContent);
        const place = names.indexOf(NAME);
        return all('#rows tbody tr:not(.space)').map((tr) => tr.children[place].title);
    })()"""
    return browser.run(script.replace("NAME", json.dumps(name)))


def click(browser, name):
    browser.run(
        "[...document.querySelectorAll('#rows th button')].find("
        f"(button) => button.textContent === {json.dumps(name)}).click()"
    )


def filtered(browser, name, text):
    """How many rows are left by a filter of a column; of all columns where it has no name."""
    label = f"filter {name}" if name else "search all columns"
    browser.run("document.querySelector('#clear').click()")
    browser.run(
        f"(() => {{ const input = document.querySelector('[aria-label={json.dumps(label)}]');"
        f"input.value = {json.dumps(text)}; input.dispatchEvent(new Event('change')); }})()"
    )
    return int(browser.run(COUNT).partition(" of")[0].replace(",", ""))


@needs_chromium
def test_a_browser_draws_sorts_filters_and_prints(tmp_path):
    found = findings(400)
    rows = found.frame
    with opened(found, tmp_path) as browser:
        drawn = (
            "[...document.querySelectorAll('.plot')].map((p) => !!p.querySelector('.trace, .hm'))"
        )
        assert browser.run(drawn) == [True] * 12
        assert browser.run("document.querySelectorAll('[data-title*=hare]').length") == 0, "sent"

        assert column(browser, "point")[:3] == ["0", "1", "2"]
        click(browser, "settling_time")
        ordered = rows["settling_time"].sort_values()
        assert [float(cell) for cell in column(browser, "settling_time")[:9]] == [*ordered[:9]]
        click(browser, "settling_time")
        first = [float(cell) for cell in column(browser, "settling_time")[:9]]
        assert first == [*ordered.dropna()[::-1][:9]]
        click(browser, "seed")
        assert [int(cell) for cell in column(browser, "seed")[:9]] == sorted(rows["seed"])[:9]
        click(browser, "backend")
        assert column(browser, "backend")[0] == "ode"

        assert filtered(browser, "settling_time", ">= 10 < 20") == rows["settling_time"].between(
            10, 20, inclusive="left"
        ).sum()  # fmt: skip
        assert filtered(browser, "problem.N", "30..300") == rows["problem.N"].between(30, 300).sum()
        assert filtered(browser, "backend", "=ode") == (rows["backend"] == "ode").sum()
        assert filtered(browser, "", "DIVERGED mu[3]") == (rows["outcome"] == "diverged").sum()
        assert filtered(browser, "", "no such word") == 0
        assert filtered(browser, "", "") == 400
        browser.run("document.querySelector('#search').focus()")
        browser.ask("Input.insertText", text="failed")
        failed = (rows["outcome"] == "failed").sum()
        browser.wait_for(f"{COUNT}.startsWith('{failed} of')")
        browser.run("document.querySelector('#clear').click()")

        browser.run(f"{FIRST}[0].click()")
        row = int(column(browser, "point")[0])
        command = browser.run("document.querySelector('#detail code').textContent")
        assert command == f"ann-dc study 'out/car study' --point {row}"
        pdf = browser.pdf()
        assert pdf.startswith(b"%PDF")
        assert 5 <= len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 14


@pytest.mark.slow
@needs_chromium
def test_hostile_words_do_nothing_in_a_browser(tmp_path):
    with opened(hostile(), tmp_path) as browser:
        browser.run("document.querySelector('#rows tbody tr:not(.space)').click()")
        browser.wait_for("document.querySelector('#detail code')")
        assert browser.run("document.title") == HOSTILE
        assert browser.run("document.querySelectorAll('img').length") == 0
        browser.resize(390, 844, mobile=True)
        browser.wait_for("innerWidth === 390")
        assert browser.run("document.documentElement.scrollWidth") <= 390


WRITE = """
import resource, sys
from study_pages import store
from ann_dc.report.study_page import write_study_page
write_study_page(store(100_000), sys.argv[1])
used = resource.getrusage(resource.RUSAGE_SELF)
peak = open("/proc/self/status").read().split("VmHWM:")[1].split()[0]
print(used.ru_utime + used.ru_stime, peak)
"""
"""Seconds and kB; ``ru_maxrss`` would have the peak of the process that began this one in it."""


@pytest.mark.slow
@needs_chromium
def test_a_hundred_thousand_rows(tmp_path):
    """Written in a minute in less than a gigabyte; a hundred rows at most are in the page."""
    file = tmp_path / "page.html"
    words = [sys.executable, "-c", WRITE, str(file)]
    environment = {**os.environ, "PYTHONPATH": ":".join(sys.path)}
    reported = subprocess.run(
        words, env=environment, check=True, capture_output=True, text=True
    ).stdout
    seconds, peak = map(float, reported.split())
    assert seconds < 60
    assert peak < 1e6  # kB
    assert os.path.getsize(file) < 30e6
    with Browser(tmp_path / "profile") as browser:
        browser.open(file)
        browser.wait_for(READY)
        script = "document.querySelectorAll('#rows tbody tr').length"
        browser.run("document.querySelector('#window').scrollTop = 1e9")
        time.sleep(0.3)
        assert column(browser, "point")[-1] == "99999"
        click(browser, "settling_time")
        assert browser.run(script) <= 100
        settling = frame(100_000)["settling_time"]
        assert float(column(browser, "settling_time")[0]) == settling.min()
        assert filtered(browser, "settling_time", "< 10") == (settling < 10).sum()
        assert browser.console == []
