"""The page is complete, needs nothing from outside, and shows names as text."""

import re
import xml.etree.ElementTree as ET
from base64 import b64decode
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from dynid.reports.page import page, summary
from dynid.text import printable

NASTY = '<b>x & "y"</b>'
#: What each drawing shows; the torques of logs name the log.
DRAWINGS = [
    "singular values of the stack with normalised columns",
    "range of positions and velocities of each joint, and its limits",
    "measured and estimated torque of each joint, training logs",
    f"measured and estimated torque of each joint, validation: {NASTY}",
    "mean and spread of the residual of each joint over velocity, position, load, time",
]


@pytest.fixture(scope="module")
def html(gathered):
    return page(gathered)


class Elements(HTMLParser):
    """Tags, ids, links, labels of drawings and text of a page, as a browser reads it."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.ids, self.links, self.labels, self.text = [], [], [], [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        facts = dict(attrs)
        self.ids += [facts["id"]] if "id" in facts else []
        self.labels += [facts.get("alt")] if tag == "img" else []
        self.links += [
            value
            for key, value in attrs
            if key in ("src", "href", "xlink:href", "srcset", "action")
        ]

    def handle_data(self, data):
        self.text += data


def by_section(html):
    """Return the text of what stands before the sections and of each section."""
    first, *rest = re.split(r'<section id="(\w+)"', html)
    return {"": Elements(first).text} | {
        a: Elements(f"<section {b}").text for a, b in zip(rest[::2], rest[1::2], strict=False)
    }


def test_all_twelve_sections_are_there_in_their_order(html):
    """And each can be reached from the list at the top."""
    found = Elements(html)
    anchors = (
        "verdict next run quality excitation parameters torque validation residual "
        "gap physics limits"
    )
    known = anchors.split()
    assert " ".join(each for each in found.ids if each in known) == anchors
    linked = [link[1:] for link in found.links if link[1:] in known]
    assert " ".join(linked) == f"verdict {anchors}"


def test_nothing_is_fetched_and_no_script_runs(html):
    """Links stay on the page."""
    found = Elements(html)
    assert all(link.startswith(("#", "data:")) for link in found.links)
    assert not {"script", "iframe", "object", "embed", "form"} & set(found.tags)
    assert not re.findall(r"url\((?!#)", html)
    assert "@import" not in html
    assert "://" not in html


def test_names_are_text_wherever_they_stand(html):
    """Robot, joint, log, command, finding: none of them becomes an element, each stands where it belongs."""
    assert "<b>x" not in html
    assert {anchor: text.count(NASTY) for anchor, text in by_section(html).items()} == {
        "": 2,  # title and heading
        "verdict": 2,  # answer and light of the validation
        "next": 1,  # the log to search
        "run": 3,  # robot, command, log
        "quality": 1,  # the finding
        "excitation": 0,
        "parameters": 1,  # a row of the grid
        "torque": 1,  # row of the joint
        "validation": 2,  # heading, list of joints
        "residual": 0,
        "gap": 0,
        "physics": 0,
        "limits": 1,  # speeds reached
    }


def test_every_figure_says_what_it_is_how_to_read_it_and_what_would_worry(html):
    """Each drawing has words for those who cannot see it."""
    assert Elements(html).labels == DRAWINGS
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", html, flags=re.S)
    assert len(captions) == len(DRAWINGS)
    for caption in captions:
        assert re.fullmatch(
            r"<p><b>How to read this:</b> [^<]{40,}\.</p><p><b>Worrying:</b> [^<]{40,}\.</p>",
            caption,
        )


def test_ids_are_unique_and_drawings_are_well_formed(html):
    ids = Elements(html).ids
    assert len(set(ids)) == len(ids)
    drawings = re.findall(r"data:image/svg\+xml;base64,([^\"]+)", html)
    assert len(drawings) == len(DRAWINGS)
    for drawing in drawings:
        assert ET.fromstring(b64decode(drawing)).tag == "{http://www.w3.org/2000/svg}svg"


def test_the_page_has_the_sentence_the_lights_and_the_steps_of_the_judgement(gathered, html):
    found, judged = by_section(html), gathered.judgement
    assert all(printable(sentence) in found["verdict"] for sentence in judged.sentences)
    for light in judged.lights:
        assert printable(light.text) in found["verdict"]
    assert re.findall(r'<li class="(good|fair|bad|open)">', html) == [
        light.state for light in judged.lights
    ]
    for step in judged.steps:
        assert step.command in found["next"]


def test_an_old_run_without_its_other_files_still_has_a_report(gathered):
    """Only parameters.npz is needed, and what is missing is said."""
    text = page(replace(gathered, motion=None, validations=(), singular_values=None))
    assert Elements(text).labels == []
    assert by_section(text)["validation"].count("No data was held out") == 1
    assert by_section(text)["torque"].count("estimatedmotion.npz is missing") == 1


def test_the_summary_shows_names_as_they_are(gathered):
    """Markdown would take the angle brackets for HTML and the pipe for a column."""
    lines = summary(gathered).splitlines()
    assert lines[0] == r'### \<b\>x \& "y"\</b\>'
    name = r'\<b\>x \& "y"\</b\>'
    percent = f"{gathered.validations[0].percent:.2g} %"
    assert f"| 🟡 fair | validation | relative torque error {percent} on {name} |" in lines
    assert "| ⚪ untested | missing effects | not searched: dynid gap |" in lines
    assert f"| {name} | 0.01 N m | 1.4 % | - |" in lines
