"""A self-contained page of HTML: a file, or a frame in a notebook."""

from __future__ import annotations

import html
from dataclasses import dataclass

from hdplan.scenes.output import check_writable, write_output
from hdplan.scenes.values import FilePath, checked, path_of

PAGES = (".html",)
HEIGHT = 620  # [px] in a notebook
FRAME = '<iframe srcdoc="{}" style="width:100%;height:{}px;border:1px solid #ccc" title="{}"></iframe>'


@dataclass(frozen=True)
class HtmlPage:
    """A page, which shows itself in a notebook."""

    title: str
    html: str

    def __repr__(self) -> str:
        """Name it, and say how large it is."""
        return f"<HtmlPage {self.title}: {len(self.html) / 1e6:.1f} MB>"

    def save(self, path: FilePath) -> None:
        """Write it as .html, whole or not at all. Raises InputError for a path that cannot be written."""
        file = checked(path_of, path, "path")
        check_writable(file, PAGES)
        write_output(file, self.html.encode())

    def _repr_html_(self) -> str:
        """Return the HTML of a notebook: the page in a frame."""
        return FRAME.format(html.escape(self.html), HEIGHT, html.escape(self.title))
