"""Drawing of SVG: text is escaped by the library, and nothing is linked."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree

INK, PALE, LINE, MARK = "#222222", "#b9c6d3", "#8a8a8a", "#1f5f8b"
_FONT = "Libertinus Serif, Georgia, serif"


class Drawing:
    """A drawing in points, y down."""

    def __init__(self, width: float, height: float, title: str) -> None:
        """Begin a drawing."""
        box = f"0 0 {width:g} {height:g}"
        attributes = {"xmlns": "http://www.w3.org/2000/svg", "viewBox": box, "role": "img"}
        self._root = ElementTree.Element("svg", attributes)
        ElementTree.SubElement(self._root, "title").text = title

    def line(
        self,
        x1: float,
        y1: float,
        x2: float,
        y2: float,
        colour: str = LINE,
        width: float = 0.6,
        dash: str = "",
    ) -> None:
        """Draw a line."""
        dashes = {"stroke-dasharray": dash} if dash else {}
        self._add("line", x1=x1, y1=y1, x2=x2, y2=y2, stroke=colour, stroke_width=width, **dashes)

    def path(self, points: Iterable[tuple[float, float]], colour: str = INK, width: float = 2.0) -> None:
        """Draw lines from point to point."""
        places = " ".join(f"{x:.2f},{y:.2f}" for x, y in points)
        self._add(
            "polyline", points=places, fill="none", stroke=colour, stroke_width=width, stroke_linejoin="round"
        )

    def bar(self, x: float, y: float, width: float, height: float, colour: str = PALE) -> None:
        """Fill a rectangle."""
        self._add("rect", x=x, y=y, width=max(width, 0.0), height=max(height, 0.0), fill=colour)

    def dot(self, x: float, y: float, radius: float = 2.4, colour: str = MARK) -> None:
        """Fill a circle."""
        self._add("circle", cx=x, cy=y, r=radius, fill=colour)

    def text(self, x: float, y: float, text: str, size: float = 8.0, anchor: str = "start") -> None:
        """Write a line."""
        element = self._add("text", x=x, y=y, fill=INK, font_size=size, font_family=_FONT, text_anchor=anchor)
        element.text = text

    def __str__(self) -> str:
        return ElementTree.tostring(self._root, encoding="unicode")

    def _add(self, tag: str, **attributes: float | str) -> ElementTree.Element:
        written = {
            name.replace("_", "-"): value if isinstance(value, str) else f"{value:.2f}"
            for name, value in attributes.items()
        }
        return ElementTree.SubElement(self._root, tag, written)
