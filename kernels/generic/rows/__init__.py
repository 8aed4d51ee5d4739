"""What is done to every row of an island, eight rows at once on a CPU."""
