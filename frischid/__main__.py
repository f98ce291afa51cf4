"""``python -m frischid`` is the command line."""

from frischid.cli import main

main()
