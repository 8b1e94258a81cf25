"""A playground in the browser: `hcbf play`."""
