"""Vector fields without divergence."""
