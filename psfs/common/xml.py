"""Parse XML of other programs."""

from __future__ import annotations

from xml.etree import ElementTree

from cl import InputError


def parse_xml(text: str, what: str) -> ElementTree.Element:
    """Return the root of an XML document; what: description of the expected file. Raises InputError
    without the file's name, also for a document type, whose entities may grow without bound."""
    if "<!" in text.replace("<!--", "").replace("<![CDATA[", ""):
        raise InputError(f"holds a document type; expected {what}, without one")
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"{error}; expected {what}") from None
