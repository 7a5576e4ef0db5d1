"""Text from files stays text in every place it is written to; the names are those of real attacks."""

import csv
import io
import re
import shlex
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import pytest
import yaml

from dynid import text

#: What ends a comment, a string, a line, an element or a cell somewhere, or changes what a reader sees.
ATTACKS = {
    "line break": "arm\nimport os; os.system('touch HACKED')\n",
    "end of a C comment": '*/ int x = system("touch HACKED"); /*',
    "triple quotes": '"""\nimport os\n"""',
    "trigraph": "arm ??/\n*/ int x; /* ??/",
    "line splice": "arm *\\\n/ int x; /\\\n*",
    "line separators": "arm\u2028import os\u2029import os\x85import os\x0bimport os\x0cimport os",
    "NUL": "arm\x00*/\x00",
    "reordering": "\u202earm\u2066 \u2069\u200f\u061c",
    "escape sequence": "\x1b]0;owned\x07\x1b[2J",
    "XML comment": "arm --> <link/> <!-- --- --->- -",
    "element": "<script>alert(1)</script><img src=x onerror='alert(1)'>",
    "attribute": '" onload="alert(1)" x=\'',
    "entity": "&lt;b&gt; &#x3c; ]]>",
    "LaTeX": r"\input{/etc/passwd} $x$ % & _ ^^5c # {~} [1cm] *",
    "YAML": "a: !!python/object/apply:os.system ['touch HACKED'] # b",
    "shell": "arm; touch HACKED $(touch HACKED) `touch HACKED` | x > y 'z'",
    "template": "${head} {n} {{ 7 * 7 }} {% x %} %s",
    "not ASCII": "Müller Роботы 表",
    "empty": "",
    "long": "a" * 100_000,
}
every = pytest.mark.parametrize("name", ATTACKS.values(), ids=ATTACKS.keys())
PLAIN = "KUKA lwr_4-plus.v2 joint 1"


@pytest.mark.parametrize(
    "function",
    [
        text.printable,
        text.visible,
        text.code,
        text.file_name,
        text.html,
        text.label,
    ],
)
def test_plain_names_stay_as_they_are(function):
    assert function(PLAIN) == PLAIN


@every
def test_nothing_but_harmless_ascii_reaches_source_code(name):
    """Written out are all characters besides letters, digits and ``_-. +(),``; ``<U+...>`` is the only sign added."""
    rest = re.sub(r"<U\+[0-9A-F]{4,6}>", "", text.code(name))
    assert re.fullmatch(r"[A-Za-z0-9_\-. +(),]*", rest)


@every
def test_an_identifier_is_one_in_every_language(name):
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,110}", text.identifier(name))


@every
def test_a_file_name_stays_in_its_folder_and_is_seen(name, tmp_path):
    made = text.file_name(name)
    (tmp_path / f"{made}.txt").write_text("")
    assert [path.name for path in tmp_path.iterdir()] == [f"{made}.txt"]
    assert made[0] != "."


@every
def test_the_terminal_gets_one_line_without_control_characters(name):
    assert text.visible(name).isprintable()


@every
def test_a_shell_reads_the_same_words(name):
    command = text.shell("dynid", "check", name)
    assert command.isprintable()
    if name.isprintable():
        assert shlex.split(command) == ["dynid", "check", name]


@every
def test_xml_is_read_back_as_one_element_and_one_comment(name):
    """Attribute and element hold the name, with what XML forbids written out."""
    root = ET.Element("robot", name=text.printable(name))
    root.append(ET.Comment(text.xml_comment(name)))
    ET.SubElement(root, "link").text = text.printable(name)
    written = ET.tostring(root, encoding="unicode")
    assert re.fullmatch(r"(?:(?!--).)*", text.xml_comment(name))
    assert not text.xml_comment(name).endswith("-")
    again = ET.fromstring(written, parser=ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
    assert [element.tag for element in again.iter()] == ["robot", ET.Comment, "link"]
    assert again.get("name") == again.find("link").text or not name
    assert again.get("name") == text.printable(name)


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.text = [], ""

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, attrs))

    def handle_data(self, data):
        self.text += data


@every
def test_html_stays_text_in_elements_and_attributes(name):
    reader = Tags()
    reader.feed(f'<p title="{text.html(name)}">{text.html(name)}</p>')
    assert reader.tags == [("p", [("title", text.printable(name))])]
    assert reader.text == text.printable(name)


@every
def test_a_row_of_a_table_is_read_back(name):
    (row,) = csv.reader(io.StringIO(text.csv_row([name, 1.5, None])))
    assert row == [text.printable(name), "1.5", ""]


@every
def test_yaml_is_read_back_exactly_and_nothing_is_constructed(name):
    written = text.yaml_text({"robot": name, "values": {name: 1.5}}, name)
    assert written.splitlines()[0] == f"# {text.printable(name)}"
    assert yaml.safe_load(written) == {"robot": name, "values": {name: 1.5}}


def test_only_short_plain_digits_are_a_whole_number():
    assert text.whole_number("12") == 12
    for other in ("9" * 5000, "²", "-1", "", " 1", "0x1"):
        assert text.whole_number(other) == -1
