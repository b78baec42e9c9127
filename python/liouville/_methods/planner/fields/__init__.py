"""Plans of polynomial fields: which pieces, in which order."""
