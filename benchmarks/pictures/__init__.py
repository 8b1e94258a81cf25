"""The pictures and films of the pages."""
