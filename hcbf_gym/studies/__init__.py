"""Long runs built on everything else: reproduction, identification, tuning, training."""
