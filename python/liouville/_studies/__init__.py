"""Questions that many runs answer: fits, sections and optimal controls."""
