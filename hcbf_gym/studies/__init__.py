"""Long runs built on everything else: reproduction, tuning, training, Monte Carlo."""
