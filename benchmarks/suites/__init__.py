"""One file for each suite of figures: `run(quick)` and `tables(figures)`; `registry` lists them."""
