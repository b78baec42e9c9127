"""Models of SymPy; SymPy is imported when it is needed."""
