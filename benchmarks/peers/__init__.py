"""Other codes on the library's problems, each with ``run(setting) -> (seconds, q, v)``.

A setting is a tolerance, or a number of steps for codes that take equal ones. What a code needs
once (symbols, C, compilers, warm functions) is done before; only the integration is timed.
"""
