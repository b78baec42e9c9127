"""Models of sites: spins, fermions and bosons, by sums of products of local operators."""
