"""HTML pages as a test sees them: well formed, and in need of nothing from elsewhere."""

from __future__ import annotations

import base64
import io
from html.parser import HTMLParser
from xml.etree import ElementTree

from PIL import Image

VOID = {"meta", "img", "br", "hr", "link"}


class Page(HTMLParser):
    """Checks that tags nest, and collects what the page refers to and what it says."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []
        self.tags: list[str] = []
        self.words = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.references += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "action", "data")]
        assert not [name for name, _ in attrs if name.startswith("on")], "a script in an attribute"
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data


def check_self_contained(text: str) -> Page:
    """The page, whose pictures stand in it and whose code does nothing."""
    page = Page(text)
    assert not {"script", "link", "iframe", "object"} & set(page.tags)
    assert "url(" not in text
    assert "@import" not in text
    for reference in page.references:
        kind, _, data = reference.partition(",")
        assert kind in ("data:image/svg+xml;base64", "data:image/png;base64")
        if kind.startswith("data:image/svg"):
            drawing = ElementTree.fromstring(base64.b64decode(data))
            assert drawing.tag == "{http://www.w3.org/2000/svg}svg"
            links = [v for element in drawing.iter() for name, v in element.attrib.items() if name.endswith("href")]
            assert all(link.startswith(("#", "data:image/png;base64,")) for link in links)
        else:
            Image.open(io.BytesIO(base64.b64decode(data))).verify()
    return page
