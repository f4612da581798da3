"""Editing of an XML text: elements and attributes are changed, and all other bytes stay unchanged.

A parser is used only to find the positions of elements; the text is not generated again from the parsed elements.
Therefore comments, order, quotes, blanks and line ends of the text are kept.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

ATTRIBUTE = re.compile(rb"\s+([^\s=/>]+)\s*=\s*(\"[^\"]*\"|'[^']*')")
TAG_END = re.compile(rb"\s*(/?)>")
STEP = "  "
"""Indentation that is used if the document has no indentation to copy."""


@dataclass(eq=False, slots=True)
class XmlNode:
    """Element of an XML document, with the byte offsets of its parts in the text.

    Attributes:
        tag: Tag as written, including its prefix.
        values: Values of the attributes, decoded.
        start: Offset of the first byte of the element.
        named: Offset of the byte after the name of the tag.
        spans: Three offsets for each attribute: of the blanks before it, of its value, and of the end of its value.
        inner: Offset of the byte after the start tag.
        closing: Offset of the end tag; equal to `inner` if the element has no end tag.
        end: Offset of the byte after the element.
        children: Child elements.
    """

    tag: str
    values: dict[str, str]
    start: int
    named: int
    spans: dict[str, tuple[int, int, int]]
    inner: int
    closing: int = 0
    end: int = 0
    children: list[XmlNode] = field(default_factory=list["XmlNode"])

    @property
    def is_empty(self) -> bool:
        """True if the element has no end tag."""
        return self.closing == self.end

    def find(self, tag: str) -> XmlNode | None:
        """First child element with a given tag; `None` if the element has no such child."""
        return next((child for child in self.children if child.tag == tag), None)

    def every(self, tag: str) -> list[XmlNode]:
        """All child elements with a given tag."""
        return [child for child in self.children if child.tag == tag]

    def walk(self) -> Iterator[XmlNode]:
        """This element and all its descendants, in the order of the text."""
        yield self
        for child in self.children:
            yield from child.walk()


class Document:
    """XML text with edits, which are collected first and then applied together.

    Args:
        data: Well-formed XML in UTF-8, without document type.
    """

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.root = _parse(data)
        self.newline = "\r\n" if b"\r\n" in data else "\n"
        self._edits: list[tuple[int, int, int, bytes]] = []

    def set(self, node: XmlNode, name: str, value: str) -> None:
        """Sets the value of an attribute; a new attribute is appended."""
        if name in node.spans:
            _, start, end = node.spans[name]
            # Both kinds of quotes are escaped, so the value may be enclosed in either.
            self.replace(start, end, escape(value, {'"': "&quot;", "'": "&apos;"}))
            return
        behind = max((end + 1 for _, _, end in node.spans.values()), default=node.named)
        self.replace(behind, behind, f" {name}={quoteattr(value)}")

    def drop(self, node: XmlNode, name: str) -> None:
        """Removes an attribute and the blanks before it."""
        if name in node.spans:
            start, _, end = node.spans[name]
            self.replace(start, end + 1, "")

    def first(self, node: XmlNode, lines: Sequence[str]) -> None:
        """Inserts lines of text directly after the start tag of an element."""
        if node.is_empty or not node.children:
            self.last(node, lines)
            return
        lead = self._lead(node.children[0])
        self.replace(node.inner, node.inner, "".join(lead + line for line in lines))

    def last(self, node: XmlNode, lines: Sequence[str]) -> None:
        """Inserts lines of text after the last child of an element."""
        if node.children:
            lead = self._lead(node.children[-1])
            behind = node.children[-1].end
            self.replace(behind, behind, "".join(lead + line for line in lines))
            return
        own = self._lead(node)
        lead = own + STEP if own else ""
        text = "".join(lead + line for line in lines)
        if node.is_empty:
            slash = self.data.rindex(b"/", node.start, node.inner)
            self.replace(slash, node.inner, f">{text}{own}</{node.tag}>")
        else:
            broken = b"\n" in self.data[node.inner : node.closing]
            self.replace(node.inner, node.inner, text + ("" if broken else own))

    def replace(self, start: int, end: int, text: str) -> None:
        """Replaces the bytes from offset `start` to offset `end` (not included) by a text."""
        self._edits.append((start, end, len(self._edits), text.encode()))

    def edited(self) -> bytes:
        """The text of the document with all edits applied."""
        parts: list[bytes] = []
        reached = 0
        for start, end, _, text in sorted(self._edits, key=lambda edit: (edit[0], edit[2])):
            assert start >= reached, "edits overlap"
            parts += [self.data[reached:start], text]
            reached = end
        return b"".join([*parts, self.data[reached:]])

    def _lead(self, node: XmlNode) -> str:
        """Line end and indentation before an element; empty if other text precedes the element on its line."""
        line = self.data.rfind(b"\n", 0, node.start) + 1
        before = self.data[line : node.start]
        return self.newline + before.decode() if line and not before.strip() else ""


def element_text(tag: str, attributes: Mapping[str, str]) -> str:
    """Text of an XML element without content, such as `<mass value="1"/>`."""
    return f"<{tag} {' '.join(f'{key}={quoteattr(value)}' for key, value in attributes.items())}/>"


def _parse(data: bytes) -> XmlNode:
    """Parses an XML text and returns its root element."""
    parser = expat.ParserCreate("utf-8")
    parser.ordered_attributes = False
    open_: list[XmlNode] = []
    roots: list[XmlNode] = []

    def begin(tag: str, values: dict[str, Any]) -> None:
        node = _start_tag(data, parser.CurrentByteIndex, tag, values)
        (open_[-1].children if open_ else roots).append(node)
        open_.append(node)

    def finish(tag: str) -> None:
        node = open_.pop()
        if data[node.inner - 2 : node.inner] == b"/>":  # the parser's position is already past the tag
            node.closing = node.end = node.inner
            return
        node.closing = parser.CurrentByteIndex
        node.end = data.index(b">", node.closing) + 1

    parser.StartElementHandler, parser.EndElementHandler = begin, finish
    parser.Parse(data, True)
    return roots[0]


def _start_tag(data: bytes, start: int, tag: str, values: dict[str, Any]) -> XmlNode:
    """Element with the offsets of its start tag; the offset of its end is set later.

    Args:
        data: The XML text.
        start: Offset of the start tag.
        tag: Name of the tag.
        values: Values of the attributes.
    """
    named = at = start + 1 + len(tag.encode())
    spans: dict[str, tuple[int, int, int]] = {}
    while (match := ATTRIBUTE.match(data, at)) is not None:
        spans[match[1].decode()] = (match.start(), match.start(2) + 1, match.end(2) - 1)
        at = match.end()
    close = TAG_END.match(data, at)
    assert close is not None, "the parser found a start tag here"
    return XmlNode(tag, values, start, named, spans, close.end())
