"""Plans of wave functions: which method, how many steps, and the bound of the error."""
