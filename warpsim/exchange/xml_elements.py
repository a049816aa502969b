"""XML as elements that know their lines, which those of ElementTree do not."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NoReturn
from xml.parsers import expat

from warpsim.errors import InputError

_DEEPEST = 50


@dataclass
class Element:
    """An element, with the line it begins on; names are without their namespace."""

    tag: str
    line: int
    attributes: dict[str, str]
    text: str = ""
    children: list[Element] = field(default_factory=list)

    def find(self, tag: str) -> list[Element]:
        """Children of that name."""
        return [child for child in self.children if child.tag == tag]

    def leaves(self) -> list[Element]:
        """Elements without children, in order."""
        if not self.children:
            return [self]
        return [leaf for child in self.children for leaf in child.leaves()]


def read_xml(data: bytes | str) -> Element:
    """The root element of a document; errors of what is not valid, or not plain, know the line."""
    parser = expat.ParserCreate()
    open_elements = [Element("", 1, {})]

    def fail(line: int, rule: str) -> NoReturn:
        raise InputError(rule).of("XML").of(f"line {line}")

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(open_elements) > _DEEPEST:
            fail(parser.CurrentLineNumber, "must not be nested so deeply")
        element = Element(tag.rpartition(":")[2], parser.CurrentLineNumber, attributes)
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def characters(text: str) -> None:
        open_elements[-1].text += text

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: open_elements.pop()
    parser.CharacterDataHandler = characters
    parser.StartDoctypeDeclHandler = lambda *_: fail(parser.CurrentLineNumber, "must have no document type of its own")
    try:
        parser.Parse(data, True)
    except InputError:  # of a handler
        raise
    except expat.ExpatError as error:
        fail(error.lineno, f"{expat.errors.messages[error.code]} (the file may be cut off)")
    except (LookupError, ValueError) as error:  # an unknown encoding
        fail(1, str(error))
    return open_elements[0].children[0]
