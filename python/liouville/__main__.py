"""The command line, as ``python -m liouville``."""

from liouville.cli import main

if __name__ == "__main__":
    main()
