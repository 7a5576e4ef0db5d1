"""The page is complete, needs nothing from outside, and shows names as text."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from dynid.reports.figures import binned
from dynid.reports.page import page, summary
from dynid.reports.sections import SECTIONS
from dynid.reports.sections.verdict import lights


@pytest.fixture(scope="module")
def html(evidence):
    return page(evidence)


class Elements(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.tags, self.ids, self.links, self.text = [], [], [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        facts = dict(attrs)
        self.ids += [facts["id"]] if "id" in facts else []
        self.links += [value for key, value in attrs if key in ("src", "href", "xlink:href", "srcset", "action")]

    def handle_data(self, data):
        self.text += data


def test_all_eleven_sections_are_there_in_their_order(html):
    """And each can be reached from the list at the top."""
    found = Elements(html)
    anchors = [section.anchor for section in SECTIONS]
    assert len(anchors) == 11
    assert [each for each in found.ids if each in anchors] == anchors
    assert all(f"#{anchor}" in found.links for anchor in anchors)


def test_nothing_is_fetched_and_no_script_runs(html):
    """Links stay on the page; addresses occur only as names of XML vocabularies."""
    found = Elements(html)
    assert all(link.startswith(("#", "data:")) for link in found.links)
    assert not {"script", "iframe", "object", "embed", "img", "form"} & set(found.tags)
    assert not re.findall(r"url\((?!#)", html)
    assert "@import" not in html
    assert set(re.findall(r'https?://[^\s"<]+', html)) <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}


def test_names_are_text_wherever_they_stand(html):
    """Robot, joint, log, command, finding: none of them becomes an element."""
    assert "<b>x" not in html
    assert Elements(html).text.count('<b>x & "y"</b>') >= 6


def test_every_figure_says_how_to_read_it_and_what_would_worry(html):
    """As many captions as drawings, each with both lines, each drawing with words for those who cannot see it."""
    drawings = html.count("<svg ")
    assert drawings >= 7
    assert html.count("How to read this:") == html.count("Worrying:") == drawings
    assert html.count('role="img" aria-label=') == drawings


def test_ids_are_unique_and_drawings_are_well_formed(html):
    """Two drawings that shared a clip path would cut each other."""
    ids = Elements(html).ids
    assert len(set(ids)) == len(ids)
    for drawing in re.findall(r"<svg .*?</svg>", html, flags=re.S):
        ET.fromstring(drawing)


def test_drawings_follow_the_colours_of_the_page(html):
    """Black text would vanish in the dark."""
    assert "prefers-color-scheme: dark" in html
    for drawing in re.findall(r"<svg .*?</svg>", html, flags=re.S):
        assert "currentColor" in drawing
        assert (
            "#000000" not in re.sub(r"\.(?:wide|x)|stroke: #000000; stroke-width: 0", "", drawing) or "tick" in drawing
        )


def test_the_verdict_has_four_lights_that_words_name(evidence):
    """Colour is not the only sign."""
    found = lights(evidence)
    assert [light.name for light in found] == ["fit", "unseen motion", "knowledge", "physics"]
    assert {light.state for light in found} <= {"good", "fair", "bad", "open"}
    nothing = replace(evidence, unseen=())
    assert lights(nothing)[1].state == "open"


def test_an_old_run_without_its_other_files_still_has_a_report(evidence):
    """Only parameters.npz is needed."""
    text = page(replace(evidence, motion=None, unseen=(), singular_values=None))
    assert "No torque was kept back" in text


def test_the_summary_shows_names_as_they_are(evidence):
    """Markdown would take the angle brackets for HTML and the pipe for a column."""
    text = summary(evidence)
    assert "\\<b\\>x" in text
    assert len(text.splitlines()) < 30


def test_bins_hold_equally_many_samples_and_their_means():
    """A straight line stays one."""
    x = np.random.default_rng(1).uniform(-1, 1, 5000)
    centre, mean, spread = binned(x, 3 * x + 1)
    np.testing.assert_allclose(mean, 3 * centre + 1, atol=1e-12)
    assert np.all(np.diff(centre) > 0)
    assert np.all(spread < 0.1)
