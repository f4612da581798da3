"""Edits of XML that leave every other byte alone."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest

from armid.export.xml_edit import Document, element_text

ODD = b"""<?xml version='1.0' encoding="utf-8"?>\r
<!-- first\t<link name="not me"/> -->\r
<robot  name = 'odd'\r
        xmlns:x="urn:odd:x" >\r
\t<link name="a"><inertial>\r
\t\t<mass   value='1'  /> <!-- \xc3\xa9 -->\r
\t</inertial></link><link name='b > "c"'/>\r
  <x:thing y="1>2"><![CDATA[<mass value="9"/>]]></x:thing>\r
  <joint name="j"></joint>\r
</robot>\r
<!-- last -->"""
"""Both quotes, tabs, comments, a name with a bracket, a prefix, elements that share a line."""


def document() -> Document:
    return Document(ODD)


def test_without_edits_nothing_changes():
    assert document().edited() == ODD


def test_a_value_changes_between_its_quotes_and_nowhere_else():
    edited = document()
    mass = edited.root.every("link")[0].children[0].children[0]
    edited.set(mass, "value", "2.5")
    assert edited.edited() == ODD.replace(b"value='1'", b"value='2.5'")


def test_a_new_attribute_stands_behind_the_others():
    edited = document()
    mass = edited.root.every("link")[0].children[0].children[0]
    edited.set(mass, "unit", 'k"g')
    assert edited.edited() == ODD.replace(b"value='1' ", b"value='1' unit='k\"g' ")


def test_an_attribute_goes_with_the_blanks_before_it():
    edited = document()
    edited.drop(edited.root, "xmlns:x")
    assert edited.edited() == ODD.replace(b'\r\n        xmlns:x="urn:odd:x"', b"")


def test_an_empty_element_opens():
    edited = document()
    edited.first(edited.root.every("link")[1], ["<inertial/>"])
    assert edited.edited() == ODD.replace(b'"c"\'/>', b'"c"\'><inertial/></link>')


def test_lines_take_the_indentation_and_the_line_end_that_are_there():
    edited = document()
    inertial = edited.root.every("link")[0].children[0]
    edited.last(inertial, ["<inertia/>"])
    edited.last(edited.root.every("joint")[0], ["<dynamics/>"])
    found = edited.edited()
    assert b"value='1'  />\r\n\t\t<inertia/> <!-- \xc3\xa9 -->" in found
    assert b'<joint name="j">\r\n    <dynamics/>\r\n  </joint>' in found
    assert found.replace(b"\r\n\t\t<inertia/>", b"").replace(b"\r\n    <dynamics/>\r\n  ", b"") == ODD


@pytest.mark.parametrize(
    "data", [b"<a/>", b"<a></a>", b"<a><b/></a>", b"<a>\n <b/>\n</a>", b"<a>\n</a>", b"<a >\n</a >"]
)
@pytest.mark.parametrize("place", ["first", "last"])
def test_what_is_put_in_is_a_child(data: bytes, place: str):
    edited = Document(data)
    getattr(edited, place)(edited.root, [element_text("c", {"d": "\"'<&"})])
    root = ET.fromstring(edited.edited())
    child = root[0 if place == "first" else -1]
    assert (child.tag, child.attrib) == ("c", {"d": "\"'<&"})
    assert [each.tag for each in root if each is not child] == [each.tag for each in ET.fromstring(data)]


def test_values_are_escaped_for_the_quotes_that_are_there():
    edited = Document(b"<a b='x' c=\"y\"/>")
    for name in ("b", "c"):
        edited.set(edited.root, name, "'\"<&")
    assert ET.fromstring(edited.edited()).attrib == {"b": "'\"<&", "c": "'\"<&"}


def test_the_text_is_walked_in_order():
    tags = [node.tag for node in document().root.walk()]
    assert tags == ["robot", "link", "inertial", "mass", "link", "x:thing", "joint"]
