"""Functions of the user as expressions: calls, derivatives, constant matrices, tables."""
