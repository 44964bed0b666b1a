"""Pages from files of other kinds: the changelog, which lies beside the README, and the notebooks of the tutorial."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages."""
    text = (Path(config.docs_dir).parent / "CHANGELOG.md").read_text(encoding="utf-8")
    files.append(File.generated(config, "changelog.md", content=text.replace("](docs/", "](")))
    for notebook in sorted((Path(config.docs_dir) / "tutorial").glob("*.ipynb")):
        cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
        content = "\n\n".join(shown("".join(cell["source"]), cell["cell_type"]) for cell in cells)
        files.append(File.generated(config, f"tutorial/{notebook.stem}.md", content=content))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Lead from page to page where the files lead from notebook to notebook."""
    return markdown.replace(".ipynb)", ".md)")


def shown(source: str, kind: str) -> str:
    """A cell of a notebook as Markdown."""
    return f"```python\n{source}\n```" if kind == "code" else source
