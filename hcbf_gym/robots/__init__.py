"""Robot descriptions that the package brings along."""
