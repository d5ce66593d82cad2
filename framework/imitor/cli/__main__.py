"""``python -m imitor.cli``: the command line where the script ``imitor`` is not on the path."""

from imitor.cli import main

raise SystemExit(main())
