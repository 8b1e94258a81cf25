"""What `benchmarks.refute` searches: regions and motion of its own, and a function a claim."""
