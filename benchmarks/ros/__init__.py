"""The node's evidence: its core with simulated clocks, and the node in real processes."""
