"""Settings of Sphinx: ``make docs``."""

from imitor import __version__

project = "imitor"
author = "the imitor authors"
copyright = "2026, the imitor authors"
release = version = __version__

extensions = ["myst_parser"]
myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath"]
exclude_patterns = ["_build"]

html_theme = "furo"
html_title = f"imitor {version}"
