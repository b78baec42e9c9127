"""How many examples a property is tried with."""

import os

from hypothesis import settings

TIMES = int(os.environ.get("FUZZ_TIMES", "1"))


def examples(count):
    """Try a property with `count` examples, ``FUZZ_TIMES`` as many where that is set."""
    return settings(max_examples=count * TIMES)
