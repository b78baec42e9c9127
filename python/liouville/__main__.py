"""The command line, as the program ``liouville`` and as ``python -m liouville``."""

import sys


def main() -> None:
    """Run the command line; without its extra say in a line what to install."""
    try:
        from liouville._cli import main as run
    except ImportError as error:
        sys.exit(str(error).replace("\nhint: ", ": "))
    run()


if __name__ == "__main__":
    main()
