"""The node's evidence: its core with clocks of its own, and the node itself in real processes."""
