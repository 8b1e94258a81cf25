"""What `benchmarks.refute` searches: regions, motion, and a function for each claim."""
