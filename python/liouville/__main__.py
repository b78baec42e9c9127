"""The command line, as ``python -m liouville``."""

from liouville.cli import main

main()
